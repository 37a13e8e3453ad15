"""Springs by half-life: exact for any step, so the same at every rate."""

from math import exp, log

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bunraku.figure.spring import decay_rate, lag, spring_decay_into, spring_to_into


@settings(deadline=None)
@given(st.floats(-2, 2), st.floats(-5, 5), st.floats(0.02, 0.5), st.floats(0.001, 0.1), st.integers(2, 7))
def test_many_small_steps_are_one_long_step(x: float, v: float, half_life: float, dt: float, parts: int) -> None:
    one, one_v = np.array([x]), np.array([v])
    spring_decay_into(one, one_v, half_life, dt)
    many, many_v = np.array([x]), np.array([v])
    for _ in range(parts):
        spring_decay_into(many, many_v, half_life, dt / parts)
    np.testing.assert_allclose(many, one, atol=1e-9)
    np.testing.assert_allclose(many_v, one_v, atol=1e-7)


def test_decay_from_rest_by_hand() -> None:
    # x(t) = x0 (1 + y t) e^(-y t) with y = 2 ln 2 / h: after one half-life e^(-2 ln 2) (1 + 2 ln 2) of it is left.
    offset, velocity = np.array([1.0]), np.array([0.0])
    spring_decay_into(offset, velocity, 0.1, 0.1)
    assert offset[0] == pytest.approx((1 + 2 * log(2)) / 4)
    y = decay_rate(0.1)
    assert velocity[0] == pytest.approx(-y * y * 0.1 * exp(-y * 0.1))


def test_spring_to_a_goal_is_decay_of_the_difference() -> None:
    x, v, goal = np.array([3.0]), np.array([0.5]), np.array([1.0])
    offset, rate = x - goal, v.copy()
    spring_to_into(x, v, goal, 0.2, 0.05)
    spring_decay_into(offset, rate, 0.2, 0.05)
    np.testing.assert_allclose(x - goal, offset, atol=1e-12)


def test_lag_goes_half_way_in_a_half_life() -> None:
    assert lag(0.1, 0.1) == pytest.approx(0.5)
    assert lag(0.1, 0.0) == 0.0
