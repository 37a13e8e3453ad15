"""Joint limits: how much a pose exceeds them, and the soft clamp."""

from math import cos, radians, sin

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bunraku.figure.default import default_figure
from bunraku.figure.limits import SOFT, clamp_joint, joint_excess, limit_excess, limits_of, soft_share, worst_excess

FIGURE = default_figure()
LIMITS = limits_of(FIGURE)


def turn(axis: str, degrees: float) -> np.ndarray:
    half = radians(degrees) / 2
    q = np.zeros(4)
    q["xyz".index(axis)], q[3] = sin(half), cos(half)
    return q


@pytest.mark.parametrize(
    ("joint", "axis", "degrees", "excess"),
    [
        ("left_lower_leg", "x", 100.0, 0.0),
        ("left_lower_leg", "x", 150.0, 5.0),  # beyond 145
        ("left_lower_leg", "x", -10.0, 10.0),  # backwards
        ("left_lower_arm", "y", -140.0, 0.0),
        ("left_lower_arm", "y", 20.0, 20.0),  # backwards
        ("right_lower_arm", "y", 140.0, 0.0),
        ("left_upper_leg", "x", -110.0, 0.0),
        ("left_upper_leg", "x", -130.0, 10.0),  # flexion beyond 120
        ("left_upper_leg", "x", 45.0, 15.0),  # extension beyond 30
        ("left_upper_leg", "z", 60.0, 15.0),  # abduction beyond 45
        ("right_upper_leg", "z", -60.0, 15.0),
        ("left_upper_leg", "z", -40.0, 10.0),  # adduction beyond 30
        ("left_upper_leg", "y", 60.0, 15.0),  # rotation beyond 45
        ("left_foot", "x", -50.0, 5.0),  # dorsiflexion beyond 45
    ],
)
def test_excess_by_hand(joint: str, axis: str, degrees: float, excess: float) -> None:
    index = FIGURE.names.index(joint)
    assert np.degrees(joint_excess(LIMITS, index, turn(axis, degrees))) == pytest.approx(excess, abs=1e-6)


def test_the_rest_pose_and_a_raised_arm_are_within() -> None:
    _, rotations = FIGURE.rest_pose()
    assert limit_excess(FIGURE, rotations).max() == 0.0
    assert worst_excess(LIMITS, rotations) == 0.0
    rotations[FIGURE.role("leftUpperArm")] = turn("z", 80.0)
    assert limit_excess(FIGURE, rotations).max() == 0.0


def test_an_arm_twisted_far_behind_the_back_is_not() -> None:
    _, rotations = FIGURE.rest_pose()
    rotations[FIGURE.role("leftUpperArm")] = turn("y", 150.0)  # the arm points back and inward
    assert np.degrees(limit_excess(FIGURE, rotations).max()) > 10.0


def test_soft_share_is_exact_inside_smooth_and_bounded() -> None:
    assert soft_share(0.5) == 0.5
    assert soft_share(SOFT) == SOFT
    assert (soft_share(SOFT + 1e-6) - SOFT) / 1e-6 == pytest.approx(1.0, abs=1e-3)
    assert soft_share(50.0) <= 1.0


@settings(deadline=None, max_examples=200)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["left_upper_arm", "right_upper_leg", "spine", "neck", "left_foot"]))
def test_clamped_joints_are_within_and_inner_ones_untouched(seed: int, name: str) -> None:
    joint = FIGURE.names.index(name)
    q = np.random.default_rng(seed).normal(size=4)
    q /= np.linalg.norm(q)
    before = q.copy()
    moved = clamp_joint(LIMITS, joint, q)
    assert joint_excess(LIMITS, joint, q) < 1e-6
    assert np.linalg.norm(q) == pytest.approx(1.0)
    if moved == 0.0:
        np.testing.assert_array_equal(q, before)


def test_mirrored_joints_have_mirrored_ranges() -> None:
    rng = np.random.default_rng(5)
    for left, right in (("left_upper_arm", "right_upper_arm"), ("left_upper_leg", "right_upper_leg")):
        for _ in range(100):
            q = rng.normal(size=4)
            q /= np.linalg.norm(q)
            mirrored = q * np.array([1.0, -1.0, -1.0, 1.0])  # reflected in the plane x = 0
            a = joint_excess(LIMITS, FIGURE.names.index(left), q)
            b = joint_excess(LIMITS, FIGURE.names.index(right), mirrored)
            assert a == pytest.approx(b, abs=1e-9)
