"""Measures, contacts, cycles and flaws: on motion whose numbers are known, and against a catalogue of captures."""

import csv
import os
from pathlib import Path

import numpy as np
import pytest

from bunraku.figure.default import default_figure
from bunraku.motion import rotation as rot
from bunraku.motion.analysis import ducks, hips, lean, measure, path_speed
from bunraku.motion.analysis_contacts import contacts, foot_skate, on_floor, runs, sole_points
from bunraku.motion.analysis_flaws import flaws
from bunraku.motion.analysis_gait import gait_cycles, jump_keys, step_keys, stride_signal, swings
from bunraku.motion.bvh import read_bvh
from bunraku.motion.clip import Clip
from bunraku.motion.files import load_capture
from bunraku.motion.retarget import retarget

MOCAP = Path(os.environ.get("BUNRAKU_MOCAP", Path(__file__).parents[2].parent / "shared" / "mocap"))
needs_mocap = pytest.mark.skipif(not MOCAP.is_dir(), reason=f"no motion capture at {MOCAP} (set BUNRAKU_MOCAP)")
FIGURE = default_figure()


def standing(frames: int = 61, fps: float = 60.0) -> Clip:
    root, turns = FIGURE.rest_pose()
    return Clip("stand", FIGURE, fps, np.tile(root, (frames, 1)), np.tile(turns, (frames, 1, 1)))


def with_roots(clip: Clip, roots) -> Clip:
    return Clip(clip.name, clip.skeleton, clip.fps, roots, clip.rotations)


def walker(speed: float = 1.2, period: float = 1.0, seconds: float = 4.0, fps: float = 60.0, turn: float = 0.0) -> Clip:
    """Stiff legs that swing like scissors, lifted by the knee on the way forward: strikes at known times."""
    times = np.arange(round(seconds * fps) + 1) / fps
    clip = standing(len(times), fps)
    turns = np.array(clip.rotations)
    stride = 0.5 * speed * period
    swing = np.arcsin(0.5 * stride / 0.83)
    for side, phase in (("left", 0.0), ("right", 0.5)):
        u = (times / period + phase) % 1.0  # 0: strike; 0..0.5 the foot goes back on the ground, then forward
        x = np.where(u < 0.5, 1.0 - 4.0 * u, -1.0 + 4.0 * (u - 0.5))
        lift = np.where(u >= 0.5, np.sin((u - 0.5) * 2.0 * np.pi), 0.0) * 0.9
        ahead = x * swing
        turns[:, FIGURE.role(side + "UpperLeg")] = rot.axis_angle([1.0, 0, 0], -ahead - 0.5 * lift)
        turns[:, FIGURE.role(side + "LowerLeg")] = rot.axis_angle([1.0, 0, 0], lift)
        turns[:, FIGURE.role(side + "Foot")] = rot.axis_angle([1.0, 0, 0], ahead - 0.5 * lift)
    heading = turn * times
    step = np.stack([np.sin(heading), np.zeros_like(heading), np.cos(heading)], 1) * speed / fps
    roots = np.cumsum(step, axis=0) - step[0] + clip.roots
    turns[:, 0] = rot.yaw(heading)
    return on_floor(Clip("scissors", FIGURE, fps, roots, turns))


def test_standing_still_is_all_zero_and_both_feet_stand():
    clip = standing()
    m = measure(clip)
    zero = "speed distance heading_change turn_rate rise bend_max tilt_max duck_max flight_height"
    for name in zero.split():
        assert getattr(m, name) == pytest.approx(0.0, abs=1e-6), name
    assert m.hips_max == pytest.approx(0.915)
    assert m.foot_skate == 0.0
    assert contacts(clip).all()
    assert flaws(clip) == []
    assert gait_cycles(clip) == []
    assert np.abs(sole_points(clip)[..., 1]).max() < 1e-9
    single = measure(clip.slice(0, 1))
    assert (single.seconds, single.speed) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("x", "z", "direction"), [(0.0, 2.0, 0.0), (2.0, 0.0, 90.0), (0.0, -2.0, 180.0), (-1.0, 1.0, -45.0)]
)
def test_speed_distance_and_direction(x, z, direction):
    clip = standing(121)
    share = np.linspace(0.0, 1.0, 121)[:, None]
    m = measure(with_roots(clip, clip.roots + share * np.array([x, 0.0, z])))
    assert m.speed == pytest.approx(np.hypot(x, z) / 2.0)
    assert m.distance == pytest.approx(np.hypot(x, z))
    assert np.degrees(m.direction) == pytest.approx(direction)
    assert (m.net_left, m.net_forward) == pytest.approx((x, z))


def test_jitter_of_a_capture_is_no_way_gone():
    clip = standing(601)
    noise = np.random.default_rng(0).normal(size=clip.roots.shape) * 0.001
    assert path_speed(hips(with_roots(clip, clip.roots + noise)), 60.0) < 0.03


def test_turns_are_counted_through():
    clip = standing(121)
    turns = np.array(clip.rotations)
    turns[:, 0] = rot.yaw(np.linspace(0.3, 0.3 + 4 * np.pi, 121))
    m = measure(Clip("spin", FIGURE, 60.0, clip.roots, turns))
    assert m.heading_change == pytest.approx(4 * np.pi)
    assert m.turn_rate == pytest.approx(2 * np.pi)


def test_lean_is_seen_from_the_body_whatever_way_it_faces():
    clip = standing(3)
    for yaw in (0.0, 2.0, -3.0):
        turns = np.array(clip.rotations)
        turns[:, 0] = rot.yaw(yaw)
        turns[:, FIGURE.role("spine")] = rot.exp([0.6, 0.0, 0.0])
        tilt, bend = lean(Clip("bow", FIGURE, 60.0, clip.roots, turns))
        assert tilt[0] == pytest.approx(0.0, abs=1e-9)
        assert 0.4 < bend[0] < 0.6
        turns[:, FIGURE.role("spine")] = rot.exp([0.0, 0.0, -0.6])
        tilt, bend = lean(Clip("lean", FIGURE, 60.0, clip.roots, turns))
        assert 0.4 < tilt[0] < 0.6


def test_duck_counts_in_leg_lengths():
    clip = standing(3)
    low = with_roots(clip, clip.roots - np.array([0.0, 0.4 * 0.83 * 0.5, 0.0]))
    assert ducks(low)[0] == pytest.approx(0.5)


@pytest.mark.parametrize("speed", [0.6, 1.0, 1.4])
@pytest.mark.parametrize("fps", [30.0, 60.0, 120.0])
def test_strikes_of_a_known_walk_are_found(speed, fps):
    clip = walker(speed, period=1.1, fps=fps)
    cycles = gait_cycles(clip)
    assert len(cycles) >= 2
    for cycle in cycles:
        assert cycle.seconds == pytest.approx(1.1, abs=2.5 / fps)
        phase = cycle.keys[0] / 1.1 % 1.0
        assert min(phase, 1.0 - phase) < 0.07
        assert (cycle.keys[2] - cycle.keys[0]) / 1.1 == pytest.approx(0.5, abs=0.06)
        assert (cycle.keys[1] - cycle.keys[0]) / 1.1 == pytest.approx(0.25, abs=0.07)
    on = contacts(clip)
    assert 0.33 < on.mean() < 0.65
    assert foot_skate(clip, on) < 0.12 * speed + 0.08


@pytest.mark.parametrize("fps", [30.0, 60.0, 120.0])
def test_backward_turning_and_mirrored_walks_have_their_cycles(fps):
    clip = walker(1.0, fps=fps)
    back = clip.reversed()
    assert len(gait_cycles(back)) >= 2
    assert stride_signal(back).max() > 0.2
    assert len(gait_cycles(walker(1.0, fps=fps, turn=0.7))) >= 2
    ours, mirrored = gait_cycles(clip), gait_cycles(clip.mirrored())
    # The mirrored walk's left strikes are the walk's right ones.
    assert mirrored[0].keys[0] == pytest.approx(ours[0].keys[2], abs=0.05) or mirrored[0].keys[2] == pytest.approx(
        ours[0].keys[0], abs=0.05
    )


def test_a_raised_foot_and_a_sloping_floor():
    clip = standing(121)
    turns = np.array(clip.rotations)
    up = slice(40, 90)
    turns[up, FIGURE.role("leftUpperLeg")] = rot.exp([-1.0, 0, 0])
    turns[up, FIGURE.role("leftLowerLeg")] = rot.exp([1.0, 0, 0])
    on = contacts(Clip("stork", FIGURE, 60.0, clip.roots, turns))
    assert on[:, 1].all()
    assert not on[45:85, 0].any()
    assert on[:35, 0].all()
    assert on[95:, 0].all()
    assert swings(on, 60.0)[0][0] == 0
    level = walker(1.2)
    slope = with_roots(level, level.roots + np.linspace(0.0, 0.08, len(level))[:, None] * np.array([0.0, 1.0, 0.0]))
    assert (contacts(slope) == contacts(level)).mean() > 0.93
    assert [f.kind for f in flaws(slope)] == ["slope"]


def hop(height: float = 0.4, ahead: float = 1.0) -> Clip:
    """Sinks, flies a parabola, sinks and rises; feet flat on the ground before and after by bent knees."""
    fps = 60.0
    flight = 2.0 * np.sqrt(2.0 * height / 9.81)
    times = np.arange(round((1.6 + flight) * fps) + 1) / fps
    clip = standing(len(times), fps)
    turns = np.array(clip.rotations)
    t = times - 0.8
    sink = np.where(t < 0.0, np.sin(np.clip(times / 0.8, 0, 1) * np.pi), 0.0)
    sink += np.where(t > flight, np.sin(np.clip((t - flight) / 0.8, 0, 1) * np.pi), 0.0)
    air = (t >= 0.0) & (t <= flight)
    up = np.where(air, np.sqrt(2 * 9.81 * height) * t - 0.5 * 9.81 * t**2, 0.0)
    bend = 0.7 * sink
    for side in ("left", "right"):
        turns[:, FIGURE.role(side + "UpperLeg")] = rot.axis_angle([1.0, 0, 0], -bend)
        turns[:, FIGURE.role(side + "LowerLeg")] = rot.axis_angle([1.0, 0, 0], 2.0 * bend)
        turns[:, FIGURE.role(side + "Foot")] = rot.axis_angle([1.0, 0, 0], -bend)
    lowered = 0.83 * (1.0 - np.cos(bend))
    roots = clip.roots + np.stack([0 * t, up - lowered, ahead * np.clip(t / flight, 0.0, 1.0)], 1)
    return Clip("hop", FIGURE, fps, roots, turns)


def test_a_jump_s_key_times_height_and_distance():
    height = 0.4
    flight = 2.0 * np.sqrt(2.0 * height / 9.81)
    clip = hop(height)
    on = contacts(clip)
    m = measure(clip, on)
    assert m.flight_seconds == pytest.approx(flight, abs=0.09)
    assert m.distance == pytest.approx(1.0, abs=1e-6)
    assert m.rise == pytest.approx(height, abs=0.01)
    keys = jump_keys(clip, on)
    assert keys is not None
    assert np.allclose(keys[1:5], [0.4, 0.8, 0.8 + flight / 2, 0.8 + flight], atol=0.09)
    assert jump_keys(standing(), contacts(standing())) is None


def test_a_step_is_two_swings():
    flags = np.ones((120, 2), dtype=bool)
    flags[30:50, 1] = False
    flags[60:80, 0] = False
    found = step_keys(standing(120), flags)
    assert found is not None
    lead, keys = found
    assert lead == 1
    assert np.allclose(keys, np.array([15, 30, 50, 60, 80, 95]) / 60)
    assert step_keys(standing(120), np.ones((120, 2), dtype=bool)) is None


def test_runs():
    assert runs(np.array([True, True, False, True])) == [(0, 2), (3, 4)]
    assert runs(np.zeros(3, dtype=bool)) == []


def kinds(clip: Clip) -> set[str]:
    return {flaw.kind for flaw in flaws(clip)}


def test_flaws_are_named_with_joint_and_frame():
    clip = standing(60)
    turns = np.array(clip.rotations)
    turns[30, FIGURE.role("leftUpperLeg")] = [0.0, 1.0, 0.0, 0.0]
    found = flaws(Clip("flip", FIGURE, 60.0, clip.roots, turns))
    flip = next(f for f in found if f.kind == "flip")
    assert flip.frame in (30, 31)
    assert "left_upper_leg" in flip.text
    assert "180 degrees" in flip.text
    roots = np.array(clip.roots)
    roots[20, 0] += 0.3
    assert "spike" in kinds(with_roots(clip, roots))
    assert kinds(with_roots(clip, clip.roots + np.array([0, 0.08, 0]))) == {"floor"}
    sunk = np.array(clip.roots)
    sunk[40:42, 1] -= 1.5
    assert "under" in kinds(with_roots(clip, sunk))
    slid = standing(120)
    slid = with_roots(slid, slid.roots + np.linspace(0, 1, 120)[:, None] * np.array([0, 0, 2.5]))
    assert "flat" in kinds(slid)


# Against the catalogue that came with the captures: somebody else measured the same files.


def rows() -> list[dict[str, str]]:
    if not MOCAP.is_dir():
        return []
    with (MOCAP / "index.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@needs_mocap
def test_every_catalogued_capture_measures_as_catalogued():
    """Clips and takes: speed within 5 %, turn within 5 degrees, height within 2 cm."""
    catalogue = rows()
    assert len(catalogue) >= 259
    for row in catalogue:
        clip = read_bvh(MOCAP / row["file"])
        assert len(clip) == int(row["frames"])
        m = measure(clip)
        name = row["file"]
        turned = np.degrees(m.heading_change) - float(row["heading_change_deg"])
        assert abs((turned + 180) % 360 - 180) <= 1.0, name
        for ours, theirs in (
            (m.hips_min, "root_height_min_m"), (m.hips_max, "max_root_height_m"),
            (m.flight_height, "flight_height_m"),
            (m.left_foot_max, "left_foot_max_m"), (m.right_foot_max, "right_foot_max_m"),
            (m.net_forward, "net_forward_m"), (m.net_left, "net_left_m"),
        ):  # fmt: skip
            assert abs(ours - float(row[theirs])) <= 0.006, (name, theirs)
        assert abs(np.degrees(m.bend_max) - float(row["bend_fwd_max_deg"])) <= 1.0, name
        # The catalogue leaves out the way of the last part tenth of a second, but divides by the whole time.
        whole = (len(clip) - 1) // 6 * 6
        part = clip.slice(0, whole + 1)
        theirs = path_speed(hips(part), clip.fps) * part.duration / clip.duration
        listed = float(row["mean_root_speed_mps"])
        assert abs(theirs - listed) <= 0.05 * listed + 0.006, name
        assert m.speed >= theirs - 0.006, name


ORIGINALS = (
    ("originals/02_04.amc", "clips/jumpup_0204.bvh", 30, 280),
    ("originals/86_01.amc", "takes/take_cmu_86_01.bvh", 0, 4580),
    ("originals/HDM_bd_kickLFront1Reps_001_120.amc", "clips/kickL_bd001.bvh", 0, 162),
)


@needs_mocap
@pytest.mark.parametrize(("original", "known", "first", "last"), ORIGINALS)
def test_originals_measure_as_what_was_made_of_them(original, known, first, last):
    row = next(r for r in rows() if r["file"] == known)
    clip = read_bvh(MOCAP / known)
    raw = load_capture(MOCAP / original).clip.slice(first, last).resampled(60.0)
    ours = retarget(raw, clip.skeleton, scale=float(row["length_scale"]))
    a, b = measure(ours), measure(clip)
    assert a.speed == pytest.approx(b.speed, rel=0.05)
    assert np.degrees(abs(a.heading_change - b.heading_change)) < 5.0
    assert abs((a.hips_max - a.hips_min) - (b.hips_max - b.hips_min)) < 0.02
    assert a.flight_height == pytest.approx(b.flight_height, abs=0.02)


@needs_mocap
def test_known_flaws_are_found():
    expected = {
        "duck_dg025": "flip", "duck_dg031": "flip", "liedown_dg011": "flip", "stand_8609": "sitting",
        "lookaround_8609": "sitting", "dm_run": "spike", "dm_kick": "spike", "dm_roll": "spike",
    }  # fmt: skip
    for name, kind in expected.items():
        assert kind in kinds(read_bvh(MOCAP / "clips" / f"{name}.bvh")), name
    assert "spike" in kinds(read_bvh(MOCAP / "takes" / "take_daz_09_12.bvh"))


@needs_mocap
def test_straight_walks_have_cycles_of_a_person():
    count = 0
    for row in rows():
        if row["kind"] == "loco_walk" and float(row["seconds"]) > 2.4 and float(row["mean_root_speed_mps"]) > 0.9:
            clip = read_bvh(MOCAP / row["file"])
            for cycle in gait_cycles(clip):
                count += 1
                assert 0.8 < cycle.seconds < 1.6, row["file"]
                assert 0.4 < (cycle.keys[2] - cycle.keys[0]) / cycle.seconds < 0.6, row["file"]
    assert count >= 25
