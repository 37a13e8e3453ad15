import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from bunraku.motion.parameters import cycle_path, embed, unembed
from bunraku.motion.weights import Weights, bspline

NAMES = ("speed", "turn", "tilt", "bend", "duck")


def _layout(seed: int, count: int, size: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(count, size)) * rng.uniform(0.1, 30.0, size)


@given(st.integers(0, 10**6), st.integers(1, 16), st.integers(1, 5))
@settings(max_examples=60, deadline=None)
def test_weights_are_exact_at_every_example(seed, count, size):
    values = _layout(seed, count, size)
    weights = Weights(NAMES[:size], values)
    for i, row in enumerate(values):
        np.testing.assert_allclose(weights(row), np.eye(count)[i], atol=1e-6)


@given(st.integers(0, 10**6), st.integers(2, 16), st.integers(1, 5), st.integers(0, 10**6))
@settings(max_examples=100, deadline=None)
def test_weights_sum_to_one_and_give_the_parameters_back(seed, count, size, where):
    values = _layout(seed, count, size)
    weights = Weights(NAMES[:size], values)
    rng = np.random.default_rng(where)
    inside = rng.dirichlet(np.ones(count)) @ values
    w = weights(inside)
    assert w.sum() == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_allclose(w @ values, inside, atol=1e-6 * np.abs(values).max())
    far = inside + rng.normal(size=size) * 1e3
    w = weights(far)
    assert w.sum() == pytest.approx(1.0, abs=1e-9)
    assert np.isfinite(w).all()
    assert np.abs(w).max() < 50.0


@given(arrays(float, 5, elements=st.floats(-1e6, 1e6)))
@example(np.full(5, 5.0))
@settings(max_examples=100, deadline=None)
def test_what_is_asked_beyond_the_examples_is_drawn_back_to_hull_and_a_tenth(asked):
    values = np.array(
        [[0, 0, 0, 0, 0], [4, 0, 0, 0, 0], [2, 1, 0, 0, 0], [2, -1, 0, 0, 0], [1, 0, 0.4, 0, 0], [1, 0, -0.4, 0, 0],
         [1, 0, 0, 0.8, 0], [1, 0, 0, -0.3, 0], [1, 0, 0, 0.2, 1], [0, 0, 0, 0.2, 1]],
        dtype=float,
    )  # fmt: skip
    w = Weights(NAMES, values)(asked)
    got = w @ values
    low, high = values.min(axis=0), values.max(axis=0)
    margin = 0.1001 * (high - low) + 1e-6
    assert np.all(got >= low - margin)
    assert np.all(got <= high + margin)


def test_inside_the_hull_nothing_is_drawn_back():
    weights = Weights(("height",), [[0.2], [0.5]])
    assert weights.within([0.35])
    assert weights.within([0.52])
    assert not weights.within([0.60])
    np.testing.assert_allclose(weights([0.35]), [0.5, 0.5], atol=1e-9)
    np.testing.assert_allclose(weights([9.0]) @ [0.2, 0.5], 0.53, atol=1e-6)


def test_negative_weights_are_kept():
    weights = Weights(("height",), [[0.2], [0.5]])
    assert weights([0.52])[0] < 0.0


def test_one_example_has_all_the_weight():
    np.testing.assert_allclose(Weights(("height",), [[0.3]])([7.0]), [1.0])


@given(st.floats(-np.pi + 1e-6, np.pi), st.floats(0.01, 3.0))
@settings(deadline=None)
def test_a_way_is_blended_as_a_vector_and_comes_back(angle, distance):
    names = ("angle", "distance")
    place = embed(names, [angle, distance])
    assert np.hypot(*place) == pytest.approx(distance)
    np.testing.assert_allclose(unembed(names, place), [angle, distance], atol=1e-9)


def test_between_two_directions_no_way_is_cut_short():
    values = [[a, d] for a in (0.0, 0.8, 1.6) for d in (0.3, 0.6)]
    weights = Weights(("angle", "distance"), values)
    w = weights([0.4, 0.5])
    np.testing.assert_allclose(
        w @ embed(("angle", "distance"), values), [0.5 * np.sin(0.4), 0.5 * np.cos(0.4)], atol=1e-9
    )


@given(st.floats(0.2, 4.0), st.floats(-2.0, 2.0), st.floats(-3.0, 3.0), st.floats(0.0, 0.06))
@settings(max_examples=80, deadline=None)
def test_the_path_of_a_cycle_has_no_sway(speed, turn, start, sway):
    assume(speed > 0.3)
    fps, frames = 60.0, 66
    t = np.arange(frames + 1) / fps
    span = t[-1]
    facing = start + turn * t
    if abs(turn) < 1e-6:
        x, z = speed * t * np.sin(start), speed * t * np.cos(start)
    else:
        x = speed / turn * (np.cos(start) - np.cos(facing))
        z = speed / turn * (np.sin(facing) - np.sin(start))
    aside = sway * np.sin(2 * np.pi * t / span + 0.7)
    places = np.stack([x + aside * np.cos(facing), z - aside * np.sin(facing)], -1)
    path = cycle_path(places, facing, fps)
    assert path.speed == pytest.approx(speed, abs=0.01 + 0.02 * abs(turn))
    assert path.turn == pytest.approx(turn, abs=1e-9)
    off = path.places - np.stack([x, z], -1)
    assert np.abs(off).max() < 0.02
    np.testing.assert_allclose(np.cos(path.directions - facing), 1.0, atol=0.01)


def test_the_spline_is_smooth_and_ends():
    x = np.linspace(-3, 3, 601)
    y = np.array([bspline(v) for v in x])
    assert y.max() == pytest.approx(2 / 3)
    assert np.abs(np.diff(y, 2)).max() < 3e-4
    assert y[0] == y[-1] == 0.0
