"""The support polygon and the point in it nearest to the centre of mass."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull, QhullError

from bunraku.figure.support import closest_point, convex_hull_into, margin_in_hull, support_polygon

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def test_hull_of_a_square_with_points_inside() -> None:
    inside = np.array([[0.5, 0.5], [0.2, 0.8], [0.5, 0.0]])
    np.testing.assert_array_equal(support_polygon(np.vstack([inside, SQUARE])), SQUARE)


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(3, 8))
def test_hull_agrees_with_qhull(seed: int, count: int) -> None:
    points = np.random.default_rng(seed).uniform(-1, 1, (count, 2))
    try:
        expected = {tuple(points[n]) for n in ConvexHull(points).vertices}
    except QhullError:
        return
    assert {tuple(p) for p in support_polygon(points)} == expected


def test_margin_by_hand() -> None:
    assert margin_in_hull(SQUARE, 4, 0.5, 0.3) == pytest.approx(0.3)
    assert margin_in_hull(SQUARE, 4, 1.5, 0.5) == pytest.approx(-0.5)
    assert margin_in_hull(SQUARE, 4, 2.0, 2.0) == pytest.approx(-np.sqrt(2))


def test_closest_point_keeps_inside_and_comes_to_the_edge() -> None:
    np.testing.assert_allclose(closest_point(SQUARE, np.array([0.4, 0.6])), [0.4, 0.6])
    np.testing.assert_allclose(closest_point(SQUARE, np.array([3.0, 0.5])), [1.0, 0.5], atol=1e-6)
    np.testing.assert_allclose(closest_point(SQUARE, np.array([3.0, 0.5]), margin=0.1), [0.9, 0.5], atol=1e-6)
    np.testing.assert_allclose(closest_point(SQUARE, np.array([3.0, -3.0]), margin=0.1), [0.9, 0.1], atol=1e-5)


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(-2, 2), st.floats(-2, 2))
def test_closest_point_is_in_the_polygon_with_its_margin(seed: int, x: float, z: float) -> None:
    points = np.random.default_rng(seed).uniform(-0.3, 0.3, (8, 2))
    hull = support_polygon(points)
    found = closest_point(hull, np.array([x, z]), margin=0.01)
    assert margin_in_hull(hull, len(hull), found[0], found[1]) >= 0.004


def test_degenerate_sets() -> None:
    hull = np.empty((8, 2))
    assert convex_hull_into(np.array([[1.0, 2.0]]), 1, hull) == 1
    np.testing.assert_allclose(closest_point(hull[:1], np.array([5.0, 5.0])), [1.0, 2.0])
    line = support_polygon(np.array([[0.0, 0.0], [1.0, 0.0], [0.5, 0.0]]))
    assert len(line) == 2
