"""The controller under a corpus of scripted targets: what must hold for every one of them.

Targets as the interpreter would send them (60 a second), made without chance: drags within reach and beyond
it, through the body and behind it, jumps of a metre a frame, several touches, pelvis drags, steps, turns,
elbows and knees, releases. Run as a program it prints the table of measurements.
"""

import itertools
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from math import cos, log, pi, radians, sin

import numpy as np
import pytest

from bunraku.figure.default import default_figure
from bunraku.figure.metrics import (
    balance_margin,
    floor_penetration,
    foot_drift,
    joint_speeds,
    largest_velocity_step,
    limit_violation,
    self_penetration,
)
from bunraku.figure.rig import rig_of
from bunraku.nodes.controller.core import HINGES, PARTS, Stack

FIGURE = default_figure()
RIG = rig_of(FIGURE)
Targets = dict[str, object]
RATES = (30.0, 60.0, 120.0)


@dataclass(frozen=True)
class Script:
    """What is held over time; ``at(t, start)`` gives all that is held at ``t`` s from the start pose."""

    name: str
    seconds: float
    at: Callable[[float, dict[str, np.ndarray]], Targets]
    steps: tuple[tuple[float, tuple[float, float, float]], ...] = ()
    reachable: tuple[str, ...] = ()
    """Held parts whose last target limits and body allow."""


def glide(t: float, points: list[tuple[float, np.ndarray]]) -> np.ndarray:
    """Piecewise reaching movements through (time, place)."""
    if t <= points[0][0]:
        return points[0][1]
    for (t0, a), (t1, b) in itertools.pairwise(points):
        if t < t1:
            s = (t - t0) / (t1 - t0)
            return a + (b - a) * (s * s * (3 - 2 * s))
    return points[-1][1]


def q(axis: str, degrees: float) -> np.ndarray:
    out = np.zeros(4)
    out["xyz".index(axis)], out[3] = sin(radians(degrees) / 2), cos(radians(degrees) / 2)
    return out


def drag(part: str, *places: tuple[float, float, float], pace: float = 0.8, hold: float = 2.0, name: str = "",
         release: float = 0.0, reachable: bool = False) -> Script:  # fmt: skip
    """Grab a part after 0.2 s, take it through places relative to where it was, hold it still, let it go."""
    drags = len(places) * pace
    seconds = 0.2 + drags + hold + release

    def at(t: float, start: dict[str, np.ndarray]) -> Targets:
        if t < 0.2 or (release and t > 0.2 + drags + hold):
            return {}
        stops = [(0.2, start[part])]
        stops += [(0.2 + (n + 1) * pace, start[part] + np.array(p)) for n, p in enumerate(places)]
        return {part: glide(t, stops)}

    return Script(name or f"{part} {places[-1]}", seconds, at, reachable=(part,) if reachable and not release else ())


def jumps(part: str, places: list[tuple[float, float, float]], every: float, name: str, reachable: bool) -> Script:
    def at(t: float, start: dict[str, np.ndarray]) -> Targets:
        if t < 0.2:
            return {}
        n = min(int((t - 0.2) / every), len(places) - 1)
        return {part: start[part] + np.array(places[n])}

    return Script(name, 0.2 + every * len(places) + 2.5, at, reachable=(part,) if reachable else ())


def together(name: str, *scripts: Script, steps: tuple = ()) -> Script:
    def at(t: float, start: dict[str, np.ndarray]) -> Targets:
        held: Targets = {}
        for script in scripts:
            held.update(script.at(t, start))
        return held

    reachable = tuple(part for script in scripts for part in script.reachable)
    return Script(name, max(s.seconds for s in scripts), at, steps, reachable)


def turning(part: str, value: Callable[[float], object], seconds: float, name: str) -> Script:
    return Script(name, seconds, lambda t, start: {part: value(t)} if t >= 0.2 else {})


def stepping(goal: tuple[float, float, float], name: str) -> Script:
    return Script(name, 4.5, lambda t, start: {}, steps=((0.3, goal),))


def crouching(down: float, goal: tuple[float, float, float], name: str) -> Script:
    """The pelvis is pulled down, let go after 1.2 s, then a step."""

    def at(t: float, start: dict[str, np.ndarray]) -> Targets:
        if not 0.2 <= t < 1.2:
            return {}
        return {"pelvis": glide(t, [(0.2, start["pelvis"]), (1.0, start["pelvis"] - [0.0, down, 0.0])])}

    return Script(name, 5.5, at, steps=((1.3, goal),))


@cache
def corpus() -> tuple[Script, ...]:
    """At least 40 scripts."""
    wave = [(0.25 + 0.15 * (-1) ** n, 0.75, 0.1) for n in range(6)]
    out = [
        # Within reach.
        drag("left_hand", (0.05, 0.45, 0.35), name="reach ahead", reachable=True),
        drag("right_hand", (-0.15, 0.60, 0.15), name="reach aside", reachable=True),
        drag("left_hand", (0.0, 0.85, 0.15), name="reach up", reachable=True),
        drag("right_hand", (0.15, 0.35, 0.30), name="across the chest", reachable=True),
        drag("left_hand", (-0.15, 0.70, 0.15), name="to the face", reachable=False),
        drag("left_hand", *wave, pace=0.3, name="wave", reachable=True),
        drag("right_hand", (0.10, 0.35, 0.20), (0.10, 0.45, 0.75), pace=0.25, name="punch", reachable=True),
        drag("left_hand", (0.02, 0.40, 0.50), name="point", release=5.0),
        drag("right_hand", (-0.10, 0.80, 0.30), name="release overhead", release=6.0),
        drag("left_hand", (0.1, 0.30, 0.40), pace=0.15, hold=0.1, name="flick and let go", release=4.0),
        # Beyond reach.
        drag("left_hand", (0.1, 0.45, 0.75), name="lean ahead", reachable=True),
        drag("left_hand", (0.05, -0.32, 0.35), name="down to the knee", reachable=True),
        drag("right_hand", (0.0, -0.80, 0.40), name="down to the floor"),
        drag("right_hand", (-0.65, 0.55, 0.0), name="lean aside"),
        drag("left_hand", (0.0, 1.60, 0.0), name="far up"),
        drag("left_hand", (3.0, 1.0, 3.0), name="far away"),
        drag("right_hand", (0.0, 0.4, -2.0), name="far behind"),
        drag("left_hand", (0.1, 0.6, 2.0), (0.1, 0.5, 0.4), name="far and back", reachable=True),
        # Through and behind the body.
        drag("left_hand", (-0.3, 0.35, 0.25), (-0.3, 0.35, -0.5), name="through the chest"),
        drag("right_hand", (0.6, 0.25, -0.1), name="straight into the belly and out"),
        drag("left_hand", (-0.2, 0.85, -0.05), (-0.55, 0.85, -0.05), name="through the head"),
        drag("right_hand", (0.15, 0.1, -0.35), name="behind the back"),
        drag("left_hand", (-0.55, -0.1, 0.1), name="through the thighs"),
        drag("left_hand", (-0.26, 0.4, -0.05), hold=2.0, name="into the chest and stay"),
        drag("left_foot", (-0.35, 0.15, 0.0), name="leg through leg"),
        # Jumps.
        jumps("left_hand", [(0.0, 0.9, 0.1), (0.2, 0.0, 0.5)] * 3, 1 / 60, "metre jumps a frame", True),
        jumps("right_hand", [(0.0, 0.9, 0.1), (-0.3, 0.3, 0.4), (0.2, 0.4, 0.4)], 0.4, "jumps", True),
        jumps("left_hand", [(0.3, 1.0, 1.0), (-1.0, 0.0, -1.0)] * 4, 1 / 30, "wild jumps", False),
        jumps("right_foot", [(0.0, 0.5, 0.4), (-0.2, 0.3, 0.1)], 0.5, "foot jumps", True),
        # Feet.
        drag("right_foot", (0.0, 0.45, 0.35), name="raise a knee", reachable=True),
        drag("right_foot", (0.0, 0.35, 0.1), (0.0, 0.75, 0.75), pace=0.3, name="kick", release=4.0),
        drag("left_foot", (0.45, 0.35, 0.05), name="kick aside"),
        drag("left_foot", (0.0, 0.20, -0.35), name="leg behind", reachable=True),
        drag("right_foot", (-0.25, 0.12, 0.15), (-0.25, 0.0, 0.15), name="place a foot", release=3.0),
        drag("left_foot", (0.0, 2.5, 0.5), name="foot out of reach"),
        # Pelvis.
        drag("pelvis", (0.0, -0.18, -0.07), name="duck", reachable=True),
        drag("pelvis", (0.0, -0.80, 0.0), name="duck into the floor"),
        drag("pelvis", (0.05, -0.05, 0.04), name="sway", reachable=True),
        drag("pelvis", (0.6, 0.0, 0.0), name="pelvis out of its support"),
        drag("pelvis", (0.0, 0.5, 0.0), name="pelvis up"),
        drag("pelvis", (0.0, -0.2, 0.0), name="duck and let go", release=1.5),
        # Trunk and head.
        turning("trunk", lambda t: q("x", min(60.0, 60 * (t - 0.2))), 2.5, "bow"),
        turning("trunk", lambda t: q("x", -60.0), 2.0, "bend backward too far"),
        turning("trunk", lambda t: q("z", min(30.0, 60 * (t - 0.2))), 2.0, "bend aside"),
        turning("head", lambda t: q("x", 20 * sin(4 * t)), 2.5, "nod"),
        turning("head", lambda t: q("y", 170.0), 2.0, "head too far round"),
        # Turns and steps.
        turning("yaw", lambda t: min(1.2, t - 0.2), 4.0, "turn"),
        turning("yaw", lambda t: pi, 6.0, "turn about"),
        stepping((0.6, 0.0, 0.0), "step aside"),
        stepping((0.0, 0.0, 0.7), "step ahead"),
        stepping((-0.4, 0.0, -0.5), "step back"),
        together(
            "step with the pelvis held", drag("pelvis", (0.8, 0.0, 0.0), hold=2.5), steps=((0.7, (0.7, 0.0, 0.0)),)
        ),
        # Several touches.
        together(
            "both hands ahead", drag("left_hand", (-0.05, 0.4, 0.4)), drag("right_hand", (0.05, 0.4, 0.4)),
        ),
        together("hands apart", drag("left_hand", (1.0, 0.6, 0.0)), drag("right_hand", (-1.0, 0.6, 0.0))),
        together("punch and duck", drag("right_hand", (0.1, 0.3, 0.6)), drag("pelvis", (0.0, -0.2, 0.02))),
        together("hand and foot", drag("left_hand", (0.3, 0.6, 0.1)), drag("right_foot", (-0.2, 0.3, 0.2))),
        together(
            "five at once", drag("left_hand", (0.2, 0.7, 0.2)), drag("right_hand", (-0.2, 0.7, 0.2)),
            drag("pelvis", (0.0, -0.15, 0.0)), drag("left_foot", (0.15, 0.1, 0.1)),
            turning("trunk", lambda t: q("x", 20.0), 2.2, ""),
        ),
        # Elbows and knees.
        drag("left_elbow", (0.25, 0.15, 0.1), name="elbow out"),
        drag("right_knee", (0.0, 0.30, 0.25), name="knee up"),
        # As far as it goes.
        stepping((0.0, 0.0, 0.8), "longest step ahead"),
        stepping((0.0, 0.0, -0.8), "longest step back"),
        stepping((-0.8, 0.0, 0.0), "longest step aside"),
        stepping((0.56, 0.0, -0.56), "longest step back and aside"),
        crouching(0.30, (0.0, 0.0, 0.8), "crouch and step ahead"),
        crouching(0.15, (0.0, 0.0, -0.8), "crouch and step back"),
        drag("left_foot", (0.0, 0.9, 0.3), pace=3.0, hold=1.0, name="foot up slowly", release=3.0),
        drag("left_foot", (0.0, 0.8, 0.1), pace=3.0, hold=1.0, name="foot straight up slowly", release=3.0),
        drag("left_foot", (0.45, 0.5, 0.3), (0.55, 0.0, -0.3), pace=0.8, name="foot from above", release=3.0),
        drag("right_foot", (0.35, 0.20, 0.25), (0.45, 0.05, 0.2), hold=0.6, name="crossed foot let go", release=3.0),
        turning("head", lambda t: q("x", min(80.0, 80 * (t - 0.2))), 2.5, "head down as far as it goes"),
        turning("head", lambda t: q("z", min(80.0, 80 * (t - 0.2))), 2.5, "head aside as far as it goes"),
    ]  # fmt: skip
    return tuple(out)


@dataclass
class Recording:
    hz: float
    positions: np.ndarray
    orientations: np.ndarray
    rotations: np.ndarray
    planted: np.ndarray
    swivels: np.ndarray
    ends: np.ndarray
    stepping: np.ndarray
    targets: list[Targets] = field(default_factory=list)
    quiet: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))


def start_of(stack: Stack) -> dict[str, np.ndarray]:
    start = {part: stack.state.points[n].copy() for n, part in enumerate(PARTS)}
    start.update({part: stack.positions_ws[RIG.limbs[n, 1]].copy() for n, part in enumerate(HINGES)})
    return start


def same(a: Targets, b: Targets, dt: float) -> bool:
    """Whether the input is slower than 1 cm/s."""
    if a.keys() != b.keys():
        return False
    return all(np.abs(np.asarray(a[key]) - np.asarray(b[key])).max() < 0.01 * dt for key in a)


@cache
def play(script: Script, hz: float = 60.0) -> Recording:
    stack = Stack(FIGURE)
    start = start_of(stack)
    frames: list[tuple] = []
    targets: list[Targets] = []
    dt = 1.0 / hz
    asked = 0
    # The input comes as often as the controller steps, which is when it comes.
    for n in range(round(script.seconds * hz)):
        t = (n + 1) * dt
        held = script.at(t, start)
        targets.append(held)
        for part in (*PARTS, *HINGES, "trunk", "head", "yaw"):
            stack.hold(part, held.get(part))
        while asked < len(script.steps) and t >= script.steps[asked][0]:
            stack.ask_step(np.array(script.steps[asked][1]), None, asked)
            asked += 1
        stack.step(dt)
        frames.append((
            stack.positions_ws.copy(), stack.rotations_ws.copy(), stack.rotations_ls.copy(),
            stack.state.planted > 0.5, stack.state.swivels.copy(), stack.state.points[1:].copy(), stack.stepping,
        ))  # fmt: skip
    columns = [np.array(column) for column in zip(*frames, strict=True)]
    recording = Recording(hz, *columns, targets=targets)
    quiet = np.zeros(len(frames), dtype=bool)
    for n in range(1, len(frames)):
        quiet[n] = same(targets[n], targets[n - 1], dt) and not columns[6][n]
    half = round(hz / 2)
    recording.quiet = np.array([n >= half and bool(quiet[n - half + 1 : n + 1].all()) for n in range(len(frames))])
    return recording


def swivel_rates(recording: Recording) -> np.ndarray:
    """Degrees of swivel per millimetre of the end's way, frames with at least 2 mm of it."""
    roots = recording.positions[:, RIG.limbs[:, 0]]
    ends = recording.positions[:, RIG.limbs[:, 2]] - roots
    way = np.linalg.norm(np.diff(ends, axis=0), axis=-1) * 1e3
    turn = np.degrees(np.abs((np.diff(recording.swivels, axis=0) + pi) % (2 * pi) - pi))
    return np.where(way > 2.0, turn / np.maximum(way, 2.0), 0.0)


def fastest_while_still(r: Recording) -> float:
    """Degrees a second of the fastest joint in quiet frames; 0 where there are none."""
    still = r.quiet[1:] & r.quiet[:-1]  # a speed lies between two frames
    speeds = joint_speeds(r.rotations, 1.0 / r.hz)[still]
    return float(np.degrees(speeds.max())) if still.any() else 0.0


def worst_jolt(r: Recording) -> float:
    """The largest velocity step of any joint in the two frames after a grab or release, as a share of what a
    critically damped spring of 0.1 s half-life makes.

    A spring that takes a joint as far (d, m) as it goes within the next second, from the speed (v, m/s) that it has,
    accelerates by at most y²d + 2yv. An elbow or knee goes with the end of its limb, and a grabbed end as far as its
    target is away, even where that jumps again before it is there; a grabbed trunk or head adds its own angle and
    speed, half a metre out. Steps below 10 cm/s do not count.
    """
    y = 2.0 * log(2.0) / 0.1
    velocities = np.diff(r.positions, axis=0) * r.hz
    worst = 0.0
    for n in range(2, len(r.positions) - 1):
        if r.targets[n].keys() == r.targets[n - 1].keys():
            continue
        way = np.linalg.norm(r.positions[n - 1 : n + round(r.hz)] - r.positions[n - 1], axis=-1).max(axis=0)
        for limb, part in enumerate(PARTS[1:]):
            _, hinge, end = RIG.limbs[limb]
            if part in r.targets[n] and part not in r.targets[n - 1]:
                way[end] = max(way[end], np.linalg.norm(np.asarray(r.targets[n + 1][part]) - r.positions[n - 1, end]))
            way[hinge] = max(way[hinge], way[end])
        bound = (y * y * way + 2.0 * y * np.linalg.norm(velocities[n - 2], axis=-1)) / r.hz
        for part in ("trunk", "head"):
            if part in r.targets[n] and part not in r.targets[n - 1]:
                a, b = np.asarray(r.targets[n][part]), np.asarray(r.targets[n + 1][part])
                angle, turned = 2.0 * np.arccos(min(1.0, abs(a[3]))), 2.0 * np.arccos(min(1.0, abs(float(a @ b))))
                bound = bound + 0.5 * (y * y * angle / r.hz + turned * r.hz)
        for frame in (n, n + 1):
            step = np.linalg.norm(velocities[frame - 1] - velocities[frame - 2], axis=-1)
            share = np.where(step > 0.1, step / np.maximum(bound, 1e-6), 0.0)
            worst = max(worst, float(share.max()))
    return worst


@cache
def measure(script: Script) -> dict[str, float]:
    """All measurements of one script."""
    r = play(script)
    dt = 1.0 / r.hz
    feet = r.positions[:, RIG.limbs[2:, 2]]
    found = {
        "penetration_mm": 1e3 * self_penetration(FIGURE, r.positions, r.orientations).max(),
        "limit_deg": np.degrees(limit_violation(FIGURE, r.rotations).max()),
        "drift_mm": 1e3 * foot_drift(feet, r.planted),
        "swivel_deg_mm": swivel_rates(r).max(),
        "floor_mm": 1e3 * floor_penetration(FIGURE, r.positions, r.orientations).max(),
        "hips_mm": 1e3 * np.linalg.norm(np.diff(r.positions[r.stepping, 0], axis=0), axis=-1).max(initial=0.0),
        "step_rad_s": largest_velocity_step(r.rotations, dt),
    }
    margins = balance_margin(FIGURE, r.positions, r.orientations, r.planted)
    quiet = r.quiet & np.isfinite(margins)
    found["unbalanced"] = float((margins[quiet] < 0).sum())
    found["quiet"] = float(quiet.sum())
    found["still_deg_s"] = max(fastest_while_still(play(script, hz)) for hz in RATES)
    found["jolt"] = max(worst_jolt(play(script, hz)) for hz in RATES)
    reach = 0.0
    for part in script.reachable:
        joint = 0 if part == "pelvis" else RIG.limbs[PARTS.index(part) - 1, 2]
        reach = max(reach, float(np.linalg.norm(r.positions[-1, joint] - np.asarray(r.targets[-1][part]))))
    found["reach_mm"] = 1e3 * reach
    ends = [play(script, hz).positions[-1] for hz in RATES]
    found["rates_mm"] = 1e3 * max(
        float(np.linalg.norm(ends[a] - ends[b], axis=-1).max()) for a, b in ((0, 1), (1, 2), (0, 2))
    )
    return found


each = pytest.mark.parametrize("script", corpus(), ids=lambda s: s.name)


def test_the_corpus_is_large_and_its_names_are_unique() -> None:
    names = [script.name for script in corpus()]
    assert len(names) == len(set(names)) >= 40


@each
def test_no_value_is_undefined(script: Script) -> None:
    r = play(script)
    assert np.isfinite(r.positions).all()
    np.testing.assert_allclose(np.linalg.norm(r.rotations, axis=-1), 1.0, atol=1e-6)


@each
def test_body_limits_and_ground_are_kept(script: Script) -> None:
    found = measure(script)
    assert found["penetration_mm"] <= 5.0
    assert found["limit_deg"] <= 1.0
    assert found["drift_mm"] <= 2.0
    assert found["floor_mm"] <= 10.0
    assert found["hips_mm"] <= 40.0  # a frame of a step


def test_feet_that_were_let_go_come_to_stand() -> None:
    for script in corpus():
        if script.name in ("foot from above", "crossed foot let go", "kick", "foot up slowly", "place a foot"):
            for hz in RATES:
                assert play(script, hz).planted[-1].all(), (script.name, hz)


@each
def test_held_parts_arrive(script: Script) -> None:
    assert measure(script)["reach_mm"] < 1.0


@each
def test_elbows_and_knees_turn_smoothly(script: Script) -> None:
    assert measure(script)["swivel_deg_mm"] < 1.0


@each
def test_nothing_moves_fast_while_the_input_is_still(script: Script) -> None:
    assert measure(script)["still_deg_s"] <= 60.0


@each
def test_grab_and_release_move_no_joint_harder_than_a_damped_spring(script: Script) -> None:
    assert measure(script)["jolt"] <= 1.25


def test_it_is_in_balance_in_quiet_frames() -> None:
    every = [measure(script) for script in corpus()]
    assert sum(found["unbalanced"] for found in every) <= 0.01 * sum(found["quiet"] for found in every)


@each
def test_the_same_targets_end_alike_at_every_rate(script: Script) -> None:
    assert measure(script)["rates_mm"] <= 20.0


if __name__ == "__main__":
    chosen = [s for s in corpus() if not os.environ.get("ONLY") or os.environ["ONLY"] in s.name]
    keys: list[str] = []
    for script in chosen:
        found = measure(script)
        if not keys:
            keys = list(found)
            print(" " * 34 + " ".join(f"{key[:9]:>9}" for key in keys))
        print(f"{script.name:34}" + " ".join(f"{found[key]:9.2f}" for key in keys))
