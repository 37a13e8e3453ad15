"""Point pose to full pose and back."""

from math import cos, radians, sin

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bunraku.figure.default import default_figure
from bunraku.figure.fk import fk
from bunraku.figure.pointpose import PointPose, analyse, default_swivel, keep_above_floor, reconstruct, sole_bottom
from bunraku.figure.rig import HEAD, LEFT_FOOT, PELVIS, RIGHT_FOOT, TRUNK, rig_of
from bunraku.figure.skeleton import Skeleton

FIGURE = default_figure()
RIG = rig_of(FIGURE)


def turn(axis: str, degrees: float) -> np.ndarray:
    half = radians(degrees) / 2
    q = np.zeros(4)
    q["xyz".index(axis)], q[3] = sin(half), cos(half)
    return q


def standing() -> PointPose:
    pose, _ = analyse(FIGURE, *FIGURE.rest_pose())
    pose.points[PELVIS, 1] -= 0.02
    pose.points[1], pose.points[2] = (0.26, 0.92, 0.05), (-0.26, 0.92, 0.05)
    return pose


def same_rotation(a: np.ndarray, b: np.ndarray, atol: float = 1e-9) -> None:
    np.testing.assert_allclose(np.abs((a * b).sum(axis=-1)), 1.0, atol=atol)


def test_trunk_is_shared_by_pelvis_and_back_joints_eqs_1_to_3() -> None:
    pose = standing()
    pose.points[:, 1] += 3.0  # nothing near the floor
    pose.turns[TRUNK] = turn("x", 40.0)
    pose.turns[HEAD] = turn("x", 40.0)
    rotations, _ = reconstruct(FIGURE, pose)
    # w = 0.5: the pelvis bends 20 degrees and the two back joints 10 each.
    same_rotation(rotations[FIGURE.role("hips")], turn("x", 20.0))
    same_rotation(rotations[FIGURE.role("spine")], turn("x", 10.0))
    same_rotation(rotations[FIGURE.role("chest")], turn("x", 10.0))


def test_heading_goes_to_the_pelvis_alone() -> None:
    pose = standing()
    pose.turns[:] = turn("y", 30.0)
    rotations, _ = reconstruct(FIGURE, pose)
    same_rotation(rotations[FIGURE.role("hips")], turn("y", 30.0))
    same_rotation(rotations[FIGURE.role("spine")], turn("y", 0.0))


def test_neck_takes_the_head_against_the_trunk_eq_4() -> None:
    pose = standing()
    pose.turns[TRUNK] = turn("x", 30.0)
    pose.turns[HEAD] = turn("y", 20.0)
    rotations, _ = reconstruct(FIGURE, pose)
    _, world = fk(FIGURE, pose.points[PELVIS], rotations)
    same_rotation(world[FIGURE.role("chest")], pose.turns[TRUNK])
    same_rotation(world[FIGURE.role("head")], pose.turns[HEAD])


def test_hands_and_feet_stand_where_the_point_pose_says() -> None:
    pose = standing()
    pose.turns[TRUNK] = turn("x", 20.0)
    pose.points[1] = (0.3, 1.2, 0.35)
    _, positions = reconstruct(FIGURE, pose)
    for limb in range(4):
        np.testing.assert_allclose(positions[RIG.limbs[limb, 2]], pose.points[limb + 1], atol=1e-6)


values = st.floats(-1.0, 1.0)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_full_pose_survives_the_way_to_a_point_pose_and_back(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rotations = rng.normal(size=(len(FIGURE), 4)) * 0.25
    rotations[:, 3] += 1.0
    rotations /= np.linalg.norm(rotations, axis=1)[:, None]
    for limb in range(4):
        half = rng.uniform(0.02, 2.4) / 2
        rotations[RIG.limbs[limb, 1]] = [*(RIG.hinges[limb] * sin(half)), cos(half)]
    root = np.array([0.3, 3.0, -0.2])
    pose, base = analyse(FIGURE, root, rotations)
    again, positions = reconstruct(FIGURE, pose, base)
    before, _ = fk(FIGURE, root, rotations)
    np.testing.assert_allclose(positions, before, atol=1e-9)
    same_rotation(again, rotations)


@settings(max_examples=80, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_any_point_pose_gives_a_figure_without_nan_with_its_bones(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turns = rng.normal(size=(2, 4))
    turns /= np.linalg.norm(turns, axis=1)[:, None]
    pose = PointPose(rng.uniform(-5, 5, (5, 3)), turns, rng.uniform(-4, 4, 4), np.array([[0.0, 0, 0, 1]] * 2))
    if seed % 5 == 0:
        pose.points[:] = pose.points[0]  # everything at one place
    rotations, positions = reconstruct(FIGURE, pose)
    assert np.isfinite(rotations).all()
    np.testing.assert_allclose(np.linalg.norm(rotations, axis=1), 1.0, atol=1e-9)
    for joint in range(1, len(FIGURE)):
        bone = positions[joint] - positions[FIGURE.parents[joint]]
        assert np.linalg.norm(bone) == pytest.approx(np.linalg.norm(FIGURE.offsets[joint]), abs=1e-9)


def test_foot_on_the_ground_is_level_and_a_lifted_one_follows_the_shin() -> None:
    pose = standing()
    pose.points[PELVIS, 1] = 0.80  # knees bent
    rotations, _ = reconstruct(FIGURE, pose)
    _, world = fk(FIGURE, pose.points[PELVIS], rotations)
    same_rotation(world[FIGURE.role("leftFoot")], turn("y", 0.0))
    pose.points[LEFT_FOOT] = (0.1, 0.6, 0.3)
    rotations, _ = reconstruct(FIGURE, pose)
    same_rotation(rotations[FIGURE.role("leftFoot")], turn("y", 0.0))  # the ankle at rest


@settings(deadline=None)
@given(st.floats(0.085, 0.4), st.floats(-80, 80), st.floats(-40, 40))
def test_toes_never_go_under_the_floor(height: float, pitch: float, roll: float) -> None:
    x, z = turn("x", pitch), turn("z", roll)
    foot = np.array([
        x[3] * z[0] + x[0] * z[3], -x[0] * z[2], x[3] * z[2], x[3] * z[3],
    ])  # x applied after z  # fmt: skip
    before = foot.copy()
    keep_above_floor(RIG, 0, height, foot)
    assert height + sole_bottom(RIG, 0, foot) >= -1e-9
    if height + sole_bottom(RIG, 0, before) >= 0:
        np.testing.assert_array_equal(foot, before)


@settings(deadline=None)
@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1))
def test_default_swivel_is_mirrored(x: float, y: float, z: float) -> None:
    unturned, root = np.array([0.0, 0, 0, 1]), np.zeros(3)
    for left, right in ((0, 1), (2, 3)):
        a = default_swivel(RIG, left, np.array([x, y, z]), root, unturned)
        b = default_swivel(RIG, right, np.array([-x, y, z]), root, unturned)
        assert a == pytest.approx(-b, abs=1e-9)
        assert np.isfinite(a)


def test_default_swivel_moves_less_than_a_degree_a_millimetre_everywhere() -> None:
    unturned, root = np.array([0.0, 0, 0, 1]), np.zeros(3)
    rng = np.random.default_rng(3)
    for limb in (0, 2):
        for _ in range(2000):
            end = rng.uniform(-0.9, 0.9, 3)
            step = rng.normal(size=3)
            step *= 1e-3 / np.linalg.norm(step)
            a = default_swivel(RIG, limb, end, root, unturned)
            b = default_swivel(RIG, limb, end + step, root, unturned)
            assert abs(np.degrees(b - a)) < 1.0


def test_batch_gives_what_one_at_a_time_gives() -> None:
    one = standing()
    many = PointPose(*(np.stack([a, a]) for a in (one.points, one.turns, one.swivels, one.feet)))
    many.points[1, 1] = (0.2, 1.3, 0.3)
    rotations, positions = reconstruct(FIGURE, many)
    for n in range(2):
        each = PointPose(many.points[n], many.turns[n], many.swivels[n], many.feet[n])
        r, p = reconstruct(FIGURE, each)
        np.testing.assert_array_equal(rotations[n], r)
        np.testing.assert_array_equal(positions[n], p)


def with_back_joints(count: int) -> Skeleton:
    """The default figure with another number of back joints."""
    names, parents, offsets, roles = ["hips"], [-1], [FIGURE.offsets[0]], {"hips": 0}
    for n in range(count):
        names.append(f"back{n}")
        parents.append(n)
        offsets.append(np.array([0.0, 0.24 / count, 0.0]))
    for n, role in zip(range(1, count + 1), ("spine", "chest", "upperChest"), strict=False):
        roles[role] = n
    if count > 3:
        roles["upperChest"] = count
    place = {0: 0, 1: 1, 2: count}
    for joint in range(3, len(FIGURE)):
        place[joint] = len(names)
        names.append(FIGURE.names[joint])
        parents.append(place[int(FIGURE.parents[joint])])
        offsets.append(FIGURE.offsets[joint])
    for role, joint in FIGURE.roles.items():
        if joint >= 3:
            roles[role] = place[joint]
    zero = np.zeros((len(names), 3))
    return Skeleton(tuple(names), np.array(parents), np.array(offsets), roles, np.ones(len(names)), zero, zero, zero)


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_any_number_of_back_joints_ends_at_the_trunks_orientation(count: int) -> None:
    skeleton = with_back_joints(count)
    pose, _ = analyse(skeleton, *skeleton.rest_pose())
    pose.turns[TRUNK] = turn("x", 50.0)
    rotations, _ = reconstruct(skeleton, pose)
    _, world = fk(skeleton, pose.points[PELVIS], rotations)
    same_rotation(world[skeleton.back[-1]], turn("x", 50.0))
    same_rotation(world[0], turn("x", 25.0))
    same_rotation(rotations[1], turn("x", 25.0 / count))


def test_right_foot_row_is_the_right_foot() -> None:
    pose = standing()
    assert pose.points[RIGHT_FOOT, 0] < 0 < pose.points[LEFT_FOOT, 0]
