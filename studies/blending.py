"""How well blended motion does what it is asked to, in numbers: the tables of docs/blending.md.

    python studies/blending.py

The built-in set is measured, and beside it one that is built from captures ($BUNRAKU_MOCAP, default ../shared/mocap
beside the repository), where there are any. *Before constraints*: one cycle or one motion is played for parameters
drawn over the module's range, and measured from its poses as any clip is. *After*: the player walks drawn paths and
makes moves; footprints, feet, reach and joint velocities are taken from the poses that it gives.
"""

import argparse
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path as File

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.default import default_figure
from bunraku.figure.metrics import (
    floor_penetration,
    foot_drift,
    joint_velocities,
    limit_violation,
    path_error,
    self_penetration,
)
from bunraku.figure.quat import from_axis_angle, mul
from bunraku.motion import rotation as rot
from bunraku.motion.blend import pose_into, speeds_into, way_into
from bunraku.motion.build import make
from bunraku.motion.build_plan import plan
from bunraku.motion.build_plant import prints
from bunraku.motion.clip import Clip
from bunraku.motion.constraint import Ground, path_of
from bunraku.motion.motionset import MODULES, MotionSet
from bunraku.motion.parameters import cycle_path, embed, measured, unembed
from bunraku.motion.player import Player, Transition, Voice, voices
from bunraku.motion.synth import builtin_set
from bunraku.motion.timewarp import advance, seconds_between

Array = NDArray[np.float64]

FPS = 60.0
UNITS = {
    "speed": "m/s",
    "turn": "°/s",
    "tilt": "°",
    "bend": "°",
    "duck": "",
    "angle": "°",
    "distance": "m",
    "height": "m",
}
DRIFT, BEYOND = "drift of a locked foot, largest", "a locked foot beyond its leg's reach, largest"
BOUNDS = (("boxes in each other", "mm"), ("boxes in the floor", "mm"), ("beyond a joint's range", "°"))
DEGREES = ("turn", "tilt", "bend", "angle")


def played(motion_set: MotionSet, voice: Voice, asked: Array) -> tuple[Clip, NDArray[np.bool_]]:
    """One cycle or motion with constant parameters, neither constrained nor foot-locked."""
    table, skeleton = voice.table, motion_set.skeleton
    weights = voice.weights(asked)
    span = seconds_between(table.generic, table.spans, weights, 0.0, 1.0)
    frames = max(2, round(span * FPS))
    dt = span / frames
    roots, turns = np.empty((frames + 1, 3)), np.empty((frames + 1, len(skeleton), 4))
    flags = np.empty((frames + 1, 2), np.bool_)
    place, signal, pace, way, yaw = np.empty(3), np.empty(2), np.empty(2), np.empty(3), np.empty(4)
    u, spot = 0.0, Ground()
    for frame in range(frames + 1):
        pose_into(table, weights, u if u < 1.0 or not table.cycle else u - 1.0, place, turns[frame], signal)
        if not table.cycle:
            way_into(table, weights, min(u, 1.0), way)
            spot = Ground().after(*(float(v) for v in way))
        at = spot.after(float(place[0]), float(place[2]), 0.0)
        roots[frame] = at.x, place[1], at.z
        from_axis_angle(0.0, 1.0, 0.0, spot.heading, yaw)
        mul(yaw, turns[frame, 0], turns[frame, 0])
        flags[frame] = signal > 0.0
        u = advance(table.generic, table.spans, weights, u, dt)
        if frame == frames - 1:
            u = 1.0
        if table.cycle:
            speeds_into(table, weights, pace)
            turned = float(pace[1]) * dt
            spot = spot.after(
                float(pace[0]) * dt * np.sin(0.5 * turned), float(pace[0]) * dt * np.cos(0.5 * turned), turned
            )
    return Clip(voice.name, skeleton, 1.0 / dt, roots, turns), flags


def inside(voice: Voice, values: Array, count: int, seed: int = 1) -> Iterator[Array]:
    """Parameter values drawn within the hull of the examples."""
    random = np.random.default_rng(seed)
    place = embed(voice.parameters, values)
    # Mixes of few examples lie far out, mixes of many in the middle.
    for k in range(count):
        share = random.dirichlet(np.full(len(values), (0.08, 0.3, 1.0)[k % 3]))
        yield unembed(voice.parameters, share @ place)


@dataclass
class Row:
    """What one parameter of one module was off by."""

    module: str
    parameter: str
    low: float
    high: float
    mean: float
    most: float


def before_constraints(motion_set: MotionSet, count: int) -> list[Row]:
    """Asked against achieved, module by module."""
    out = []
    for name, voice in voices(motion_set).items():
        if name.startswith("canonical/"):
            continue
        module = motion_set.module(name)
        asked = list(inside(voice, module.values, count))
        got = []
        for one in asked:
            clip, flags = played(motion_set, voice, one)
            got.append(measured(module.parameters, clip, flags, turns=name.startswith("turn")))
        off = np.abs(np.array(got) - np.array(asked))
        for k, parameter in enumerate(module.parameters):
            if parameter == "angle":
                wrapped = (off[:, k] + np.pi) % (2 * np.pi) - np.pi
                off[:, k] = np.abs(wrapped)
                if "distance" in module.parameters:  # the direction of a way of no length says nothing
                    far = np.array(asked)[:, module.parameters.index("distance")] > 0.05
                    off[~far, k] = 0.0
            scale = 180.0 / np.pi if parameter in DEGREES else 1.0
            values = module.values[:, k]
            out.append(Row(name, parameter, scale * float(values.min()), scale * float(values.max()),
                           scale * float(off[:, k].mean()), scale * float(off[:, k].max())))  # fmt: skip
    return out


def recorded(player: Player, frames: list[tuple[Array, ...]]) -> Clip:
    return Clip("played", player.skeleton, FPS, np.array([f[0] for f in frames]), np.array([f[1] for f in frames]))


def play(player: Player, seconds: float, frames: list[tuple[Array, ...]], until_free: bool = True) -> None:
    """Run the player, keeping what is measured of each frame."""
    for _ in range(int(seconds * FPS)):
        player.update(1.0 / FPS)
        here = np.array([player.place.x, player.place.z, player.place.heading])
        state = player.state
        frames.append((player.root.copy(), player.rotations.copy(), state.mode.copy(), state.prints.copy(), here,
                       np.array([player.beyond, player.u])))  # fmt: skip
        if until_free and player.free:
            return


def drift(player: Player, clip: Clip, frames: Sequence[tuple[Array, ...]]) -> float:
    """The farthest, m, that the point on the ground of a locked foot moved along it while it carried."""
    places, turns = clip.world
    worst = 0.0
    for side in range(2):
        height, heel, ball = (float(v) for v in player.feet.soles[side])
        foot = int(player.feet.joints[side, 2])
        slope = np.sin([frame[3][side, 4] for frame in frames])  # of the ground under the print
        pitch = rot.rotate(turns[:, foot], np.array([0.0, 0.0, 1.0]))[:, 1] - slope
        points = [places[:, foot] + rot.rotate(turns[:, foot], np.array([0.0, -height, z])) for z in (heel, ball)]
        locked = np.array([frame[2][side] == 1 for frame in frames])
        edges = np.flatnonzero(np.diff(np.concatenate([[0], locked.astype(int), [0]])))
        for first, last in zip(edges[::2], edges[1::2], strict=True):
            for point, bears in zip(points, (pitch > -1e-3, pitch < 1e-3), strict=True):
                span = (point * [1.0, 0.0, 1.0])[first:last][bears[first:last]]
                if len(span) > 1:
                    worst = max(worst, foot_drift(span[:, None], np.ones((len(span), 1), np.bool_)))
    return worst


def velocity_steps(clip: Clip) -> Array:
    """(F - 2, J) degrees/s by which each joint's velocity changes from one frame to the next."""
    steps = np.diff(joint_velocities(clip.rotations, 1.0 / clip.fps), axis=0)
    return np.asarray(np.degrees(np.linalg.norm(steps, axis=-1)), dtype=np.float64)


def bounds(clip: Clip) -> tuple[float, float, float]:
    """The largest overlap of two boxes and depth of one in the floor, m, and excess over a joint's range, degrees."""
    places, turns = clip.world
    return (
        float(self_penetration(clip.skeleton, places, turns).max()),
        float(floor_penetration(clip.skeleton, places, turns).max()),
        float(np.degrees(limit_violation(clip.skeleton, clip.rotations).max())),
    )


def walked_path(seed: int) -> Array:
    """A path as drawn: 4-9 m with bends, jittered by a millimetre."""
    random = np.random.default_rng(seed)
    steps = np.cumsum(random.normal(0.0, 0.06, 140))
    steps = np.convolve(np.pad(steps, 12, mode="edge"), np.hanning(25) / np.hanning(25).sum(), "valid")[:140]
    heading = np.concatenate([np.zeros(10), steps - steps[0]])
    way = np.cumsum(0.05 * np.stack([np.sin(heading), np.cos(heading)], -1), axis=0)
    return np.vstack([[0.0, 0.0], way]) + random.normal(0.0, 0.001, (len(way) + 1, 2))


def after_constraints(motion_set: MotionSet, transition: Transition, count: int = 8) -> dict[str, float]:
    """Paths walked at 0.7 to 3 m/s and moves made to given places."""
    errors: list[float] = []
    ends: list[float] = []
    print_off: list[float] = []
    print_as: list[float] = []
    apart: list[float] = []
    lateral = source_prints(motion_set)
    found = {DRIFT: 0.0, BEYOND: 0.0}
    switch_steps: list[float] = []
    all_steps: list[float] = []
    beyond: list[tuple[float, float, float]] = []
    for seed in range(count):
        player = Player(motion_set, transition=transition)
        frames: list[tuple[Array, ...]] = []
        play(player, 0.5, frames, until_free=False)
        drawn = walked_path(seed)
        begin = len(frames)
        speed = float(np.interp(seed, [0, count - 1], [0.7, 2.8]))
        path = path_of(drawn, speeds=np.full(len(drawn), speed))
        player.follow(path)
        while player.activity == "go" and len(frames) < begin + 30 * FPS:
            was = player.state.mode.copy()
            play(player, 1.0 / FPS, frames, until_free=False)
            for side in range(2):
                if was[side] != 1 and player.state.mode[side] == 1 and player.activity == "go":
                    mark = player.state.prints[side][[0, 2]]
                    x, z, heading = path.at(path.nearest(float(mark[0]), float(mark[1])))
                    aside = (mark[0] - x) * np.cos(heading) - (mark[1] - z) * np.sin(heading)
                    expected = float(player.weights @ lateral[:, side])
                    print_off.append(abs(float(aside)))
                    print_as.append(abs(expected))
                    apart.append(float(aside) - expected)
        arrived = len(frames)
        here = np.array([frame[4][:2] for frame in frames[begin:]])
        errors.extend(path_error(here, drawn).tolist())
        ends.append(float(np.hypot(*(here[-1] - drawn[-1]))))
        play(player, 1.5, frames, until_free=False)
        clip = recorded(player, frames)
        found[DRIFT] = max(found[DRIFT], drift(player, clip, frames))
        found[BEYOND] = max(found[BEYOND], max(float(frame[5][0]) for frame in frames))
        steps = velocity_steps(clip)
        all_steps.append(float(steps.max()))
        beyond.append(bounds(clip))
        for at in (begin, arrived):
            switch_steps.append(float(steps[max(at - 2, 0) : at + 6].max()))
    moves: list[float] = []
    for name in player.voices:
        if not name.startswith(("step", "jump_", "turn")):
            continue
        values = motion_set.module(name).values if name in motion_set.modules else None
        if values is None:
            continue
        for asked in inside(player.voices[name], values, 4, seed=3):
            player = Player(motion_set, transition=transition)
            frames = []
            play(player, 0.3, frames, until_free=False)
            goal = Ground()
            if name.startswith(("step", "jump_")) and len(asked) == 2:
                goal = goal.after(float(asked[1] * np.sin(asked[0])), float(asked[1] * np.cos(asked[0])), 0.0)
            elif name.startswith("turn"):
                goal = goal.after(0.0, 0.0, float(asked[0]))
            begin = len(frames)
            player.move(name, asked, goal)
            play(player, 6.0, frames)
            arrived = len(frames)
            play(player, 0.8, frames, until_free=False)
            clip = recorded(player, frames)
            moves.append(float(np.hypot(player.place.x - goal.x, player.place.z - goal.z)))
            found[DRIFT] = max(found[DRIFT], drift(player, clip, frames))
            found[BEYOND] = max(found[BEYOND], max(float(frame[5][0]) for frame in frames))
            steps = velocity_steps(clip)
            all_steps.append(float(steps.max()))
            beyond.append(bounds(clip))
            for at in (begin, arrived):
                switch_steps.append(float(steps[max(at - 2, 0) : at + 6].max()))
    sources = [float(velocity_steps(e.clip).max()) for m in motion_set.modules.values() for e in m.examples]
    own = [bounds(e.clip) for m in motion_set.modules.values() for e in m.examples]
    for k, (name, _) in enumerate(BOUNDS):
        for word, rows in (("", beyond), (", in sources", own)):
            found[f"{name}{word}, largest"] = max(row[k] for row in rows)
            found[f"{name}{word}, median of the largest"] = float(np.median([row[k] for row in rows]))
    found |= {
        "path, rms": float(np.sqrt(np.mean(np.square(errors)))),
        "path, largest": float(np.max(errors)),
        "end of a walk, largest": float(np.max(ends)),
        "end of a move, largest": float(np.max(moves)) if moves else 0.0,
        "prints to path, mean": float(np.mean(print_off)),
        "prints to path in the sources so blended, mean": float(np.mean(print_as)),
        "a print from where the sources have it, rms": float(np.sqrt(np.mean(np.square(apart)))),
        "velocity step at switches, max": float(np.max(switch_steps)),
        "velocity step at switches, median": float(np.median(switch_steps)),
        "velocity step anywhere, max": float(np.max(all_steps)),
        "velocity step anywhere, median of the largest": float(np.median(all_steps)),
        "velocity step in sources, max": float(np.max(sources)),
        "velocity step in sources, median of the largest": float(np.median(sources)),
    }
    return found


def source_prints(motion_set: MotionSet) -> Array:
    """(n, 2) m to the left of the arc of the root's way at which either foot stands, on average, in each example.

    In bends that are run, both feet stand outside of the root's path: the body leans in.
    """
    out = []
    for example in motion_set.module("locomotion").examples:
        clip = example.clip
        path = cycle_path(clip.roots[:, [0, 2]], clip.headings, clip.fps)
        row = []
        marks = prints(clip)
        for side in range(2):
            on = example.contacts[:, side]
            off = marks[on, side] - path.places[on]
            left = np.stack([np.cos(path.directions[on]), -np.sin(path.directions[on])], -1)
            radius = path.speed / path.turn if abs(path.turn) > 0.02 and path.speed > 0.2 else 1e4
            far = np.linalg.norm(off - radius * left, axis=1)
            row.append(float(np.mean(np.sign(radius) * (abs(radius) - far))))
        out.append(row)
    return np.array(out)


def sums(motion_set: MotionSet, count: int = 20_000) -> float:
    """The farthest that a sum of weights is from one, over and far beyond the parameters' range."""
    random = np.random.default_rng(5)
    worst = 0.0
    for voice in voices(motion_set).values():
        size = len(voice.parameters)
        for _ in range(count // 10):
            worst = max(worst, abs(float(voice.weights(random.normal(0.0, 4.0, size)).sum()) - 1.0))
    return worst


LIMITS = {"speed": 0.03, "turn": 2.0, "distance": 0.02, "height": 0.02}
"""Mean errors asked for, in the units of the table."""


def from_captures(folder: File) -> MotionSet:
    """The set that `bunraku motion build` makes of a folder."""
    figure = default_figure()
    planned = plan(folder, figure, "captures")
    return make(planned.recipe, folder, figure)


def report(sets: list[MotionSet], count: int) -> None:
    """Print the tables, all sets beside each other."""
    found = {motion_set.name: before_constraints(motion_set, count) for motion_set in sets}
    print("### Asked against achieved before root constraints\n")
    heads = "".join(f" {name}: range | mean error | largest |" for name in found)
    print(f"| module | parameter |{heads}\n|---|---|{'---|---|---|' * len(found)}")
    for module, parameters in MODULES.items():
        for parameter in parameters:
            cells = []
            for rows in found.values():
                row = next((r for r in rows if (r.module, r.parameter) == (module, parameter)), None)
                if row is None:
                    cells.append(" | | |")
                    continue
                span = f"{row.low:.2f}..{row.high:.2f} {UNITS[parameter]}"
                cells.append(f" {span} | {row.mean:.3f} | {row.most:.3f} |")
                if row.mean > LIMITS.get(parameter, np.inf):
                    raise SystemExit(f"{module} {parameter}: mean error {row.mean:.3f} is beyond its limit")
            print(f"| {module} | {parameter} |{''.join(cells)}")
    worst = ", ".join(f"{motion_set.name} {sums(motion_set):.1e}" for motion_set in sets)
    print(f"\nLargest distance of a sum of weights from one: {worst}\n")
    kinds: tuple[Transition, ...] = ("inertialise", "example")
    after = {(one.name, kind): after_constraints(one, kind) for one in sets for kind in kinds}
    print("### After root constraints\n")
    words = {"inertialise": "inertialised", "example": "(n+1)-th example"}
    print(f"| measure |{''.join(f' {name}, {words[kind]} |' for name, kind in after)}")
    print(f"|---|{'---|' * len(after)}")
    for key in next(iter(after.values())):
        unit, scale = ("°/s", 1.0) if "velocity" in key else ("°", 1.0) if "range" in key else ("mm", 1000.0)
        print(f"| {key} |{''.join(f' {row[key] * scale:.1f} {unit} |' for row in after.values())}")


def main() -> None:
    default = (
        File(os.environ.get("BUNRAKU_MOCAP") or File(__file__).resolve().parents[2] / "shared" / "mocap") / "clips"
    )
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument(
        "--captures", type=File, default=default, help="folder of captures that a second set is built from"
    )
    parser.add_argument(
        "--set", type=File, action="append", default=[], help="a motion set instead of one from captures"
    )
    parser.add_argument("--count", type=int, default=90, help="parameter values a module")
    arguments = parser.parse_args()
    sets = [builtin_set(), *(MotionSet.load(path) for path in arguments.set)]
    if not arguments.set and arguments.captures.is_dir():
        sets.append(from_captures(arguments.captures))
    elif not arguments.set:
        print(
            f"no captures in {arguments.captures}: the built-in set alone (set BUNRAKU_MOCAP, or --captures FOLDER)\n"
        )
    report(sets, arguments.count)


if __name__ == "__main__":
    main()
