"""Two-bone inverse kinematics: exact, smooth, never backwards, never NaN."""

from math import cos, exp, pi, radians, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bunraku.figure.limb import (
    flexed_distance,
    flexion_of,
    frame_quat,
    pole_direction,
    soft_reach,
    swivel_of,
    two_bone,
)
from bunraku.figure.quat import rotate
from bunraku.figure.swivel import ARM_REFERENCE, reference_frame

unit = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda v: np.linalg.norm(v) > 0.05)


def direction(v: tuple[float, float, float]) -> np.ndarray:
    return np.array(v) / np.linalg.norm(v)


def test_reach_is_exact_inside_soft_outside_and_clamped_near() -> None:
    assert soft_reach(0.30, 0.53, 0.14, 0.97) == 0.30
    assert soft_reach(0.05, 0.53, 0.14, 0.97) == 0.14
    # 1 cm past the soft start of a limb of 1 m softened over 3 cm: 0.97 + 0.03 (1 - e^(-1/3))
    assert soft_reach(0.98, 1.0, 0.1, 0.97) == pytest.approx(0.97 + 0.03 * (1 - exp(-1 / 3)))
    assert soft_reach(100.0, 0.53, 0.14, 0.97) < 0.53


def test_flexion_and_distance_by_hand() -> None:
    assert flexed_distance(3.0, 4.0, pi / 2) == pytest.approx(5.0)  # the right-angled triangle
    assert flexion_of(3.0, 4.0, 5.0) == pytest.approx(pi / 2)
    assert flexed_distance(0.28, 0.25, 0.0) == pytest.approx(0.53)


@settings(deadline=None)
@given(unit, st.floats(-pi, pi), st.floats(0.14, 0.5299))
def test_two_bones_reach_the_end_and_bend_toward_the_pole(v, swivel: float, distance: float) -> None:
    axis = direction(v)
    reference, zero = reference_frame(ARM_REFERENCE, 1.0)
    pole, upper, lower = np.empty(3), np.empty(3), np.empty(3)
    pole_direction(axis, reference, zero, swivel, pole)
    assert abs(pole @ axis) < 1e-9
    two_bone(axis, pole, distance, 0.28, 0.25, upper, lower)
    np.testing.assert_allclose(0.28 * upper + 0.25 * lower, distance * axis, atol=1e-9)
    assert upper @ pole > 0  # the elbow stands out on the pole's side
    hinge = np.cross(pole, axis)
    assert np.cross(upper, lower) @ hinge > 0  # and bends the one way round


@settings(deadline=None)
@given(unit, st.floats(-3.1, 3.1))
def test_swivel_of_the_pole_is_the_swivel(v, swivel: float) -> None:
    axis = direction(v)
    reference, zero = reference_frame(ARM_REFERENCE, -1.0)
    pole = np.empty(3)
    pole_direction(axis, reference, zero, swivel, pole)
    assert swivel_of(axis, pole, reference, zero) == pytest.approx(swivel, abs=1e-6)


def test_swivel_along_the_axis_is_zero_and_not_undefined() -> None:
    reference, zero = reference_frame(ARM_REFERENCE, 1.0)
    assert swivel_of(reference, reference.copy(), reference, zero) == 0.0


@settings(deadline=None)
@given(unit, unit)
def test_frame_quat_carries_the_axes(a, b) -> None:
    x = direction(a)
    y = np.array(b) - (np.array(b) @ x) * x
    if np.linalg.norm(y) < 1e-3:
        return
    y /= np.linalg.norm(y)
    q, out = np.empty(4), np.empty(3)
    frame_quat(x, y, q)
    rotate(q, np.array([1.0, 0.0, 0.0]), out)
    np.testing.assert_allclose(out, x, atol=1e-9)
    rotate(q, np.array([0.0, 1.0, 0.0]), out)
    np.testing.assert_allclose(out, y, atol=1e-9)


def test_right_angle_by_hand() -> None:
    # Bones of 1 and 1, end at sqrt 2 along +X, elbow up: the upper bone points 45 degrees up.
    upper, lower = np.empty(3), np.empty(3)
    two_bone(np.array([1.0, 0, 0]), np.array([0.0, 1, 0]), sqrt(2), 1.0, 1.0, upper, lower)
    c = cos(radians(45))
    np.testing.assert_allclose(upper, [c, c, 0], atol=1e-12)
    np.testing.assert_allclose(lower, [c, -c, 0], atol=1e-12)
