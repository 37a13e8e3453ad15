"""The generated walk and run beside captured ones: joint curves over the cycle, numbers and a picture.

    python studies/gait.py [-o docs/motion-synth.png]

Reads captures from $BUNRAKU_MOCAP (default ../shared/mocap beside the repository). Prints the table of
docs/motion-synth.md: for each curve how far the generated one is from the captures' mean and how far the captures
themselves are from it; how the generated one correlates with that mean, and each capture with the mean of the others.
"""

import argparse
import os
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from bunraku.figure.default import default_figure
from bunraku.motion import rotation as rot
from bunraku.motion.analysis_contacts import contacts
from bunraku.motion.analysis_gait import gait_cycles
from bunraku.motion.build import Source
from bunraku.motion.build_edit import closed, levelled, repeated
from bunraku.motion.build_plan import best_loop
from bunraku.motion.bvh import read_bvh
from bunraku.motion.clip import Clip
from bunraku.motion.parameters import cycle_path
from bunraku.motion.synth_body import Frame
from bunraku.motion.synth_curves import Gait, running, walking
from bunraku.motion.synth_gait import gait_clip

Array = NDArray[np.float64]
Curves = dict[str, Array]

PHASES = np.linspace(0.0, 1.0, 101)
FOLDER = Path(os.environ.get("BUNRAKU_MOCAP") or Path(__file__).resolve().parents[2] / "shared" / "mocap")
UNITS = {"root height": "cm", "sway": "cm", "ankle height": "cm", "ankle ahead": "cm"}

# title: gait made, captures at about that speed
SETS: dict[str, tuple[float, bool, tuple[str, ...]]] = {
    "slow walk": (0.70, False, ("walk_slow_8609", "walk_slow_8601")),
    "walk": (1.30, False, ("walk_normal_0201", "walk_0702", "walk_0706", "walk_0707", "walk_0102", "walk_0703")),
    "brisk walk": (1.75, False, ("walk_brisk_0202", "walk_0709", "walk_0710", "walk_0711", "walk_0712")),
    "run": (3.2, True, ("jog_0203", "run_0906", "run_0905", "run_0911", "dm_jog")),
}


def curves(clip: Clip, start: float, end: float) -> tuple[Curves, float, float]:
    """Curves of the left side over one cycle (seconds start..end), its speed (m/s) and its length (s)."""
    times = start + (end - start) * PHASES
    roots, rotations = clip.samples(times)
    piece = Clip(clip.name, clip.skeleton, 100.0 / (end - start), roots, rotations)
    places, turns = piece.world
    path = cycle_path(roots[:, [0, 2]], piece.headings, piece.fps)
    facing = path.directions
    ahead = np.stack([np.sin(facing), np.zeros_like(facing), np.cos(facing)], -1)
    aside = np.stack([np.cos(facing), np.zeros_like(facing), -np.sin(facing)], -1)
    joint = piece.skeleton.role

    def between(a: str, b: str) -> Array:
        return places[:, joint(b)] - places[:, joint(a)]

    def swing(v: Array) -> Array:
        return np.degrees(np.arctan2((v * ahead).sum(-1), -v[:, 1]))

    thigh, shin = swing(between("leftUpperLeg", "leftLowerLeg")), swing(between("leftLowerLeg", "leftFoot"))
    upper, lower = between("leftUpperArm", "leftLowerArm"), between("leftLowerArm", "leftHand")
    toe = rot.rotate(turns[:, joint("leftFoot")], np.array([0.0, 0.0, 1.0]))
    bend = (upper * lower).sum(-1) / np.linalg.norm(upper, axis=-1) / np.linalg.norm(lower, axis=-1)
    hips, chest = between("rightUpperLeg", "leftUpperLeg"), between("rightUpperArm", "leftUpperArm")
    neck = places[:, joint("neck")] - places[:, 0]
    offset = roots[:, [0, 2]] - path.places
    ankle = places[:, joint("leftFoot")] - places[:, 0]
    out = {
        "thigh": thigh,
        "knee": thigh - shin,
        "foot pitch": np.degrees(np.unwrap(np.arctan2(toe[:, 1], (toe * ahead).sum(-1)))),
        "ankle ahead": 100.0 * (ankle * ahead).sum(-1),
        "ankle height": 100.0 * (places[:, joint("leftFoot"), 1] - places[:, joint("leftFoot"), 1].min()),
        "root height": 100.0 * (places[:, 0, 1] - places[:, 0, 1].mean()),
        "sway": 100.0 * (offset[:, 0] * aside[:, 0] + offset[:, 1] * aside[:, 2]),
        "pelvis turn": np.degrees(np.arctan2(-(hips * ahead).sum(-1), (hips * aside).sum(-1))),
        "chest turn": np.degrees(np.arctan2(-(chest * ahead).sum(-1), (chest * aside).sum(-1))),
        "lean": np.degrees(np.arctan2((neck * ahead).sum(-1), neck[:, 1])),
        "upper arm": swing(upper),
        "elbow": np.degrees(np.arccos(np.clip(bend, -1.0, 1.0))),
    }
    return out, path.speed, end - start


def generated(gait: Gait) -> tuple[Curves, float, float]:
    clip, keys, _ = gait_clip("generated", Frame(default_figure()), gait)
    return curves(clip, float(keys[0]), float(keys[-1]))


def captured(name: str) -> list[tuple[Curves, float, float]]:
    """All whole cycles of a capture, of both sides; of a short one the cycle that closes best, repeated."""
    clip = read_bvh(FOLDER / "clips" / f"{name}.bvh")
    on = contacts(clip)
    clip = levelled(clip, on)  # captured floors rise by centimetres on the way
    sides = ((clip, on), (clip.mirrored(), on[:, ::-1]))
    found = [(one, cycle) for one, flags in sides for cycle in gait_cycles(one, flags)]
    if not found:
        source = Source(name, clip, on)
        loop = best_loop(source)
        if loop is not None:
            first, last = loop
            flags = source.flags[first : last + 1]
            whole = repeated(closed(clip.slice(first, last + 1)), 3)
            thrice = np.concatenate([flags, flags[1:], flags[1:]])
            for one, feet in ((whole, thrice), (whole.mirrored(), thrice[:, ::-1])):
                found += [(one, cycle) for cycle in gait_cycles(one, feet)[:1]]
    return [curves(one, cycle.keys[0], cycle.keys[-1]) for one, cycle in found]


def agreement(found: list[Array]) -> float:
    """Mean correlation of each captured curve with the mean of the others."""
    every = np.array(found)
    others = (every.sum(axis=0) - every) / max(len(every) - 1, 1)
    return float(np.mean([np.corrcoef(one, rest)[0, 1] for one, rest in zip(every, others, strict=True)]))


def panel(draw: ImageDraw.ImageDraw, at: tuple[int, int], name: str, made: Array, real: list[Array]) -> None:
    """One curve: the captures thin and grey, the generated one thick."""
    x, y = at
    width, height = 230, 118
    low = min(float(made.min()), *(float(r.min()) for r in real))
    high = max(float(made.max()), *(float(r.max()) for r in real))
    room = max(high - low, 1.0)
    draw.rectangle([x, y, x + width, y + height], outline=(205, 205, 200), fill=(255, 255, 255))

    def line(values: Array, color: tuple[int, int, int], thick: int) -> None:
        points = [
            (x + width * p, y + height - 6 - (height - 12) * (float(v) - low) / room)
            for p, v in zip(PHASES, values, strict=True)
        ]
        draw.line(points, fill=color, width=thick)

    for one in real:
        line(one, (150, 155, 160), 1)
    line(made, (222, 84, 46), 3)
    unit = UNITS.get(name, "°")
    draw.text((x + 4, y + 2), f"{name}  {low:.0f}..{high:.0f} {unit}", fill=(30, 34, 40))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("-o", "--output", type=Path, help="picture to write (png)")
    output = parser.parse_args().output
    if not (FOLDER / "clips").is_dir():
        sys.exit(f"no captures in {FOLDER}; set BUNRAKU_MOCAP to the folder that holds clips/")
    names: list[str] = []
    rows: dict[str, list[str]] = {}
    sheet = Image.new("RGB", (12 + 6 * 242, 8 + len(SETS) * 282), (246, 246, 243))
    draw = ImageDraw.Draw(sheet)
    for number, (title, (speed, runs, clips)) in enumerate(SETS.items()):
        made, own_speed, own_time = generated(running(speed) if runs else walking(speed))
        real = [cycle for name in clips for cycle in captured(name)]
        if not real:
            sys.exit(f"no cycle found in {', '.join(clips)}")
        speeds, times = [r[1] for r in real], [r[2] for r in real]
        head = f"{title}: generated {own_speed:.2f} m/s, cycle {own_time:.2f} s; {len(real)} captured cycles of "
        head += f"{min(speeds):.2f}..{max(speeds):.2f} m/s, {min(times):.2f}..{max(times):.2f} s"
        print(f"- {head}")
        draw.text((12, 6 + number * 282), head, fill=(20, 24, 30))
        for k, name in enumerate(made):
            curves_of = [r[0][name] for r in real]
            panel(draw, (12 + (k % 6) * 242, 24 + number * 282 + (k // 6) * 126), name, made[name], curves_of)
            mean = np.mean(curves_of, axis=0)
            off = float(np.sqrt(np.mean((made[name] - mean) ** 2)))
            spread = float(np.mean([np.sqrt(np.mean((c - mean) ** 2)) for c in curves_of]))
            shape = float(np.corrcoef(made[name], mean)[0, 1])
            rows.setdefault(name, []).append(f"{off:.1f} / {spread:.1f} / {shape:.2f} / {agreement(curves_of):.2f}")
        names.append(title)
    print(f"\n| curve | {' | '.join(names)} |\n|---{'|---' * len(names)}|")
    for name, cells in rows.items():
        print(f"| {name}, {UNITS.get(name, '°')} | {' | '.join(cells)} |")
    if output is not None:
        output.parent.mkdir(parents=True, exist_ok=True)
        sheet.save(output, optimize=True)


if __name__ == "__main__":
    main()
