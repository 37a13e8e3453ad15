"""Oriented boxes by the separating-axis test."""

from math import cos, radians, sin, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bunraku.figure.boxes import (
    box_axes,
    box_gap,
    collision_pairs,
    deepest_overlap,
    deepest_overlap_batch_into,
    place_boxes_into,
)
from bunraku.figure.default import default_figure
from bunraku.figure.fk import fk

UNTURNED = np.eye(3)
HALF = np.array([0.5, 0.5, 0.5])


def gap(a_center, a_axes, a_half, b_center, b_axes, b_half):
    axis = np.empty(3)
    return box_gap(
        np.array(a_center, dtype=float), a_axes, a_half, np.array(b_center, dtype=float), b_axes, b_half, axis
    ), axis


def test_unit_cubes_by_hand() -> None:
    value, axis = gap([2.0, 0, 0], UNTURNED, HALF, [0, 0, 0], UNTURNED, HALF)
    assert value == pytest.approx(1.0)
    np.testing.assert_allclose(axis, [1, 0, 0])
    value, axis = gap([0.2, -0.9, 0.1], UNTURNED, HALF, [0, 0, 0], UNTURNED, HALF)
    assert value == pytest.approx(-0.1)
    np.testing.assert_allclose(axis, [0, -1, 0])


def test_a_cube_on_its_edge() -> None:
    # Turned 45 degrees about Z its corner reaches sqrt(2)/2 along X.
    axes = np.empty((3, 3))
    half = radians(45) / 2
    box_axes(np.array([0.0, 0.0, sin(half), cos(half)]), axes)
    value, _ = gap([1.3, 0, 0], axes, HALF, [0, 0, 0], UNTURNED, HALF)
    assert value == pytest.approx(1.3 - 0.5 - sqrt(2) / 2)


def turned(seed: int) -> np.ndarray:
    q = np.random.default_rng(seed).normal(size=4)
    axes = np.empty((3, 3))
    box_axes(q / np.linalg.norm(q), axes)
    return axes


@settings(deadline=None)
@given(st.integers(0, 2**31), st.integers(0, 2**31))
def test_pushing_out_by_the_depth_along_the_axis_ends_the_overlap(seed: int, other: int) -> None:
    rng = np.random.default_rng(seed + other)
    a, b = turned(seed), turned(other)
    a_half, b_half = rng.uniform(0.05, 0.4, 3), rng.uniform(0.05, 0.4, 3)
    center = rng.uniform(-0.2, 0.2, 3)
    depth, axis = gap(center, a, a_half, [0, 0, 0], b, b_half)
    if depth < 0:
        after, _ = gap(center - (depth - 1e-6) * axis, a, a_half, [0, 0, 0], b, b_half)
        assert after >= -1e-6
        assert after <= 2e-6


@settings(deadline=None)
@given(st.integers(0, 2**31), st.integers(0, 2**31))
def test_sampled_points_agree(seed: int, other: int) -> None:
    """No point of one box is in another that is said to be apart."""
    rng = np.random.default_rng(seed ^ other)
    a, b = turned(seed), turned(other)
    a_half, b_half = rng.uniform(0.05, 0.4, 3), rng.uniform(0.05, 0.4, 3)
    center = rng.uniform(-0.6, 0.6, 3)
    value, _ = gap(center, a, a_half, [0, 0, 0], b, b_half)
    points = center + (rng.uniform(-1, 1, (400, 3)) * a_half) @ a
    inside = (np.abs(points @ b.T) <= b_half).all(axis=1)
    assert not (value > 0 and inside.any())


def test_pairs_of_the_default_figure() -> None:
    figure = default_figure()
    pairs = {(figure.names[a], figure.names[b]) for a, b in collision_pairs(figure)}
    assert ("chest", "left_lower_arm") in pairs
    assert ("chest", "left_upper_arm") not in pairs  # it hangs there
    assert ("left_upper_leg", "right_upper_leg") in pairs
    positions, rotations = fk(figure, *figure.rest_pose())
    centers, axes = np.empty((len(figure), 3)), np.empty((len(figure), 3, 3))
    place_boxes_into(figure.box_centers, positions, rotations, centers, axes)
    assert deepest_overlap(collision_pairs(figure), centers, axes, figure.box_sizes) == 0.0


def test_batch_gives_what_one_gives() -> None:
    figure = default_figure()
    root, rotations = figure.rest_pose()
    many = np.stack([rotations, rotations])
    half = radians(100) / 2
    many[1, figure.role("leftUpperArm")] = [0, 0, sin(half), cos(half)]
    many[1, figure.role("leftLowerArm")] = [0, 0, sin(half), cos(half)]
    positions, orientations = fk(figure, np.stack([root, root]), many)
    depths = np.empty(2)
    deepest_overlap_batch_into(
        collision_pairs(figure), figure.box_centers, figure.box_sizes, positions, orientations, depths
    )
    assert depths[0] == 0.0
    assert depths[1] > 0.01  # the forearm is in the head
