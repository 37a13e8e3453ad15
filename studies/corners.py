"""Every module at its parameters' corners, with the most alike captured clip beside it: sheets and films to look at.

    python studies/corners.py [-o docs/motions] [--films FOLDER] [--set set.npz] [MODULE ...]

Each row is one corner: on the left what the player makes of the motion set (root constraints and foot lock on), on the
right the capture whose measured parameters are nearest. Captures are read from $BUNRAKU_MOCAP (default ../shared/mocap
beside the repository); without them the right side stays empty. A film shows the same, corner by corner, at speed.
"""

import argparse
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from bunraku.figure.default import default_figure
from bunraku.motion import rotation as rot
from bunraku.motion.analysis import DUCK_SHARE, hips, lean, measure
from bunraku.motion.build import Source, example_of, load_source
from bunraku.motion.build_plan import candidates
from bunraku.motion.clip import Clip, ClipError
from bunraku.motion.constraint import Ground, path_of
from bunraku.motion.files import find_captures
from bunraku.motion.motionset import MODULES, Example, MotionSet
from bunraku.motion.parameters import embed
from bunraku.motion.player import Player
from bunraku.motion.synth import builtin_set
from bunraku.nodes.renderer.engine import open_engine
from bunraku.nodes.renderer.sheet import strip
from bunraku.nodes.renderer.video import Video
from bunraku.nodes.renderer.view import Engine

Array = NDArray[np.float64]

FPS = 60.0
FOLDER = Path(os.environ.get("BUNRAKU_MOCAP") or Path(__file__).resolve().parents[2] / "shared" / "mocap") / "clips"
POSES, WIDE, HIGH, HEAD = 8, 620, 148, 18
TURN = np.radians(62.0)  # the way ahead goes to the right and a little toward the eye
SCALES = {"speed": 0.6, "turn": 0.7, "tilt": 0.2, "bend": 0.3, "duck": 0.3, "distance": 0.3, "height": 0.15}
UNITS = {"speed": "m/s", "turn": "°/s", "tilt": "°", "bend": "°", "duck": "", "angle": "°", "distance": "m",
         "height": "m"}  # fmt: skip
DEGREES = ("turn", "tilt", "bend", "angle")


@dataclass(frozen=True, eq=False)
class Row:
    """One corner: what was asked, what came out, and the most alike capture."""

    title: str
    made: Clip
    real: Clip | None
    real_title: str


def told(parameters: tuple[str, ...], values: Array) -> str:
    """Values in words, those at zero left out."""
    parts = []
    for name, value in zip(parameters, values, strict=True):
        shown = np.degrees(value) if name in DEGREES else value
        if abs(shown) > 0.02 or len(parameters) < 3:
            parts.append(f"{name} {shown:.0f}{UNITS[name]}" if name in DEGREES else f"{name} {shown:.2f} {UNITS[name]}")
    return ", ".join(parts)


def corners(name: str, values: Array) -> list[Array]:
    """The ends of each parameter (with the others as usual) and of pairs of them, as the examples (n, m) have them."""
    low, high = values.min(axis=0), values.max(axis=0)
    if name == "locomotion":
        rows = [
            (low[0], 0, 0, 0, 0), (0.6, 0, 0, 0, 0), (1.3, 0, 0, 0, 0), (2.0, 0, 0, 0, 0), (high[0], 0, 0, 0, 0),
            (0.8, high[1], 0, 0, 0), (0.8, low[1], 0, 0, 0), (2.3, 0.8, 0, 0, 0), (2.3, -0.8, 0, 0, 0),
            (1.0, 0, high[2], 0, 0), (1.0, 0, low[2], 0, 0), (1.0, 0, 0, high[3], 0), (1.0, 0, 0, low[3], 0),
            (0.85, 0, 0, 0, high[4]), (2.5, 0, 0, 0, 0.5), (0.9, 0.5, 0, 0.4, 0.5),
        ]  # fmt: skip
        return [np.array(row, dtype=np.float64) for row in rows]
    if name == "stand":
        rows = [(0, 0, 0), (high[0], 0, 0), (low[0], 0, 0), (0, high[1], 0), (0, low[1], 0), (0, 0, 1.0),
                (high[0], 0.3, 0.4), (0, 0.6, 0.9)]  # fmt: skip
        return [np.array(row, dtype=np.float64) for row in rows]
    if len(low) == 1:
        return [low, 0.5 * (low + high), high]
    # Directions and ways of the examples themselves: the outermost in each direction, and the shortest.
    angles = np.unique(np.round(np.degrees(values[values[:, 1] > 0.1, 0]) / 15.0) * 15.0)
    out = []
    for angle in angles:
        mine = values[np.abs(np.degrees(values[:, 0]) - angle) < 8.0]
        out.append(mine[np.argmax(mine[:, 1])])
    return [*out, values[np.argmin(np.where(values[:, 1] > 0.1, values[:, 1], np.inf))]]


def recorded(player: Player, seconds: float, until_free: bool = False) -> Clip:
    roots, turns = [], []
    for _ in range(round(seconds * FPS)):
        player.update(1.0 / FPS)
        roots.append(player.root.copy())
        turns.append(player.rotations.copy())
        if until_free and player.free:
            break
    return Clip("made", player.skeleton, FPS, np.array(roots), np.array(turns))


def played(motion_set: MotionSet, module: str, asked: Array) -> Clip:
    """What the player makes of values: one cycle of a walk under way, two seconds of standing, or a whole move."""
    player = Player(motion_set)
    if module == "stand":
        player.stand(*(float(v) for v in asked))
        recorded(player, 1.5)
        return recorded(player, 2.0)
    if module == "locomotion":
        speed, turn = max(float(asked[0]), 0.06), float(asked[1])
        way = np.arange(0.0, 30.0, 0.02)
        bend = turn / speed
        points = np.stack([way * 0.0, way], -1) if abs(bend) < 1e-6 else np.stack(
            [(1.0 - np.cos(bend * way)) / bend, np.sin(bend * way) / bend], -1)  # fmt: skip
        count = len(points)
        weights = player.voices["locomotion"].weights
        usual = weights.neutral(np.array([speed, turn, 0.0, 0.0, 0.0]))
        posture = np.where(asked[2:] == 0.0, 0.0, asked[2:] - usual[2:] * [1.0, 1.0, 0.0])
        player.follow(path_of(points, speeds=np.full(count, speed), postures=np.tile(posture, (count, 1))))
        recorded(player, 3.0)
        begin = player.u
        frames = []
        for _ in range(round(2.2 * FPS)):
            before = player.u
            frames.append(recorded(player, 1.0 / FPS))
            if before < begin <= player.u or (player.u < before and begin <= player.u):
                break
        return Clip("made", player.skeleton, FPS, np.concatenate([f.roots for f in frames]),
                    np.concatenate([f.rotations for f in frames]))  # fmt: skip
    goal = Ground()
    if len(asked) == 2:
        goal = goal.after(float(asked[1] * np.sin(asked[0])), float(asked[1] * np.cos(asked[0])), 0.0)
    elif module.startswith("turn"):
        goal = goal.after(0.0, 0.0, float(asked[0]))
    recorded(player, 0.2)
    player.move(module, asked, goal)
    return recorded(player, 6.0, until_free=True)


def captured() -> dict[str, list[tuple[Array, Example, str]]]:
    """(values, example, file) of all that the captures hold, by module."""
    out: dict[str, list[tuple[Array, Example, str]]] = {}
    if not FOLDER.is_dir():
        print(f"no captures in {FOLDER}: the right side stays empty (set BUNRAKU_MOCAP)")
        return out
    figure = default_figure()
    for path in find_captures(FOLDER):
        try:
            source = load_source(FOLDER, path.name, figure)
            for module, one in candidates(source, []):
                piece = replace(one.piece, calm=0.0)
                if module != "stand":
                    out.setdefault(module, []).append((one.values, example_of(piece, source), path.stem))
            posture = postured(source)
            if posture is not None:
                out.setdefault("stand", []).append((*posture, path.stem))
        except ClipError:
            continue
    return out


def postured(source: Source) -> tuple[Array, Example] | None:
    """The posture that a capture on the spot reaches farthest (tilt, bend, duck), and the two seconds about it."""
    clip, flags = source.clip, source.flags
    m = measure(clip, flags)
    if m.distance > 0.4 or clip.duration > 8.0 or flags.mean() < 0.97 or abs(m.heading_change) > 0.5:
        return None
    tilt, bend = lean(clip)
    height = hips(clip)[:, 1]
    duck = (height.max() - height) / (DUCK_SHARE * (height.max() - 0.08))
    at = int(np.argmax(np.abs(tilt) / 0.3 + np.abs(bend) / 0.6 + duck / 0.6))
    first, last = max(0, at - 75), min(len(clip) - 1, at + 45)
    if last - first < 20:
        return None
    part = clip.slice(first, last + 1)
    values = np.array([tilt[at], bend[at], duck[at]])
    return values, Example(part, values, np.array([0.0, part.duration]), flags[first : last + 1], False)


def nearest(module: str, asked: Array, pool: dict[str, list[tuple[Array, Example, str]]]) -> tuple[Clip | None, str]:
    """The capture whose values are nearest; of jumps and turns that of any direction."""
    parameters = MODULES[module]
    found = [(one, module) for one in pool.get(module, [])]
    for other in pool:
        if not found and other.split("_")[0] == module.split("_")[0] and MODULES[other] == parameters:
            found += [(one, other) for one in pool[other]]
    if not found:
        return None, "nothing alike was captured"
    scale = np.array([SCALES.get(p, 0.4) for p in parameters])
    goal = embed(parameters, asked) / (0.3 if "angle" in parameters else scale)
    places = [embed(parameters, one[0]) / (0.3 if "angle" in parameters else scale) for one, _ in found]
    values, example, file = found[int(np.argmin([np.linalg.norm(place - goal) for place in places]))][0]
    mark = ", mirrored" if example.clip.name.endswith("mirrored") else ""
    return example.clip, f"{file}{mark}: {told(parameters, values)}"


def rows(motion_set: MotionSet, module: str, pool: dict[str, list[tuple[Array, Example, str]]]) -> Iterator[Row]:
    """All corners of a module, or of ``canonical`` the eight clips."""
    if module == "canonical":
        for name, example in motion_set.canonical.items():
            kind = "locomotion" if example.cycle else ("jump_up" if name == "jump_up" else "jump_forward")
            asked = example.values if example.cycle else (
                example.values[1:] if name == "jump_up" else np.array([0.0, example.values[0]]))  # fmt: skip
            real, label = nearest(kind, asked, pool)
            yield Row(f"{name}: {told(MODULES[kind], asked)}", example.clip, real, label)
        return
    for asked in corners(module, motion_set.module(module).values):
        real, label = nearest(module, asked, pool)
        yield Row(told(MODULES[module], asked) or "upright", played(motion_set, module, asked), real, label)


def poses(engine: Engine, clip: Clip) -> Image.Image:
    """Eight moments of a clip side by side, each seen from the same side."""
    frames = np.linspace(0, len(clip) - 1, POSES).round().astype(int)
    turn = rot.yaw(TURN - float(clip.headings[0]))
    roots, turns = np.array(clip.roots[frames]), np.array(clip.rotations[frames])
    turns[:, 0] = rot.mul(turn, turns[:, 0])
    pixels = strip(engine, clip.skeleton, roots, turns, width=WIDE, height=HIGH, spacing=0.85)
    return Image.fromarray(np.ascontiguousarray(pixels[..., :3]))


def sheet(engine: Engine, module: str, found: list[Row]) -> Image.Image:
    """All rows of a module on one picture."""
    image = Image.new("RGB", (2 * WIDE + 6, 30 + len(found) * (HIGH + HEAD)), (246, 247, 249))
    draw = ImageDraw.Draw(image)
    font, small = ImageFont.load_default(16), ImageFont.load_default(12)
    draw.text((8, 5), f"{module}: played", fill=(20, 24, 30), font=font)
    draw.text((WIDE + 14, 5), "nearest capture", fill=(20, 24, 30), font=font)
    for k, row in enumerate(found):
        y = 30 + k * (HIGH + HEAD)
        draw.text((8, y + 2), f"{row.title}   ({row.made.duration:.2f} s)", fill=(60, 66, 78), font=small)
        image.paste(poses(engine, row.made), (0, y + HEAD))
        label = row.real_title if row.real is None else f"{row.real_title}   ({row.real.duration:.2f} s)"
        draw.text((WIDE + 14, y + 2), label, fill=(60, 66, 78), font=small)
        if row.real is not None:
            image.paste(poses(engine, row.real), (WIDE + 6, y + HEAD))
    return image


def film(engine: Engine, found: list[Row], path: Path) -> None:
    """The rows one after the other, twice each, made and captured beside each other, at speed."""
    width, height = 480, 360
    with_label = ImageFont.load_default(16)
    video = Video(path, 2 * width, height, 30, quality=28)
    for row in found:
        seconds = 2.0 * max(row.made.duration, row.real.duration if row.real is not None else 0.0)
        for k in range(round(min(seconds, 6.0) * 30)):
            image = Image.new("RGB", (2 * width, height), (219, 225, 232))
            for side, clip in enumerate((row.made, row.real)):
                if clip is None:
                    continue
                at = min((k / 30.0) % (clip.duration + 0.2), clip.duration)
                roots, turns = clip.samples(np.array([at]))
                turns = np.array(turns)
                turns[:, 0] = rot.mul(rot.yaw(TURN - float(clip.headings[0])), turns[:, 0])
                pixels = strip(engine, clip.skeleton, roots, turns, width=width, height=height, spacing=1.0)
                image.paste(Image.fromarray(np.ascontiguousarray(pixels[..., :3])), (side * width, 0))
            draw = ImageDraw.Draw(image)
            draw.text((8, 6), row.title, fill=(30, 34, 40), font=with_label)
            draw.text((width + 8, 6), row.real_title, fill=(30, 34, 40), font=with_label)
            pixels = np.dstack([np.asarray(image), np.full((height, 2 * width), 255, np.uint8)])
            video.write(pixels)
    video.close()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("modules", nargs="*", help=f"{', '.join(MODULES)}, canonical; all when none is given")
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/motions"), help="folder of the sheets")
    parser.add_argument("--films", type=Path, help="folder of films, one a module; none when not given")
    parser.add_argument("--set", type=Path, help="a motion set; the built-in one when not given")
    arguments = parser.parse_args()
    motion_set = builtin_set() if arguments.set is None else MotionSet.load(arguments.set)
    pool = captured()
    engine = open_engine()
    for module in arguments.modules or ["canonical", *MODULES]:
        found = list(rows(motion_set, module, pool))
        arguments.output.mkdir(parents=True, exist_ok=True)
        target = arguments.output / f"{module}.png"
        sheet(engine, module, found).quantize(64, dither=Image.Dither.NONE).save(target, optimize=True)
        print(f"{target}: {len(found)} rows, {target.stat().st_size / 1e3:.0f} kB", flush=True)
        if arguments.films is not None:
            arguments.films.mkdir(parents=True, exist_ok=True)
            film(engine, found, arguments.films / f"{module}.mp4")
            print(arguments.films / f"{module}.mp4", flush=True)
    engine.close()


if __name__ == "__main__":
    main()
