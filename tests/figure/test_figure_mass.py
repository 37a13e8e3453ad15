"""Masses and the centre of mass."""

import numpy as np
import pytest

from bunraku.figure.default import default_figure
from bunraku.figure.mass import center_of_mass, upper_body_share
from bunraku.figure.skeleton import Skeleton


def two_joints(masses: list[float]) -> Skeleton:
    return Skeleton(
        ("a", "b"), np.array([-1, 0]), np.array([[0.0, 1, 0], [0.0, 1, 0]]), {}, np.array(masses),
        np.array([[0.0, 0, 0], [0.5, 0, 0]]), np.zeros((2, 3)), np.zeros((2, 3)),
    )  # fmt: skip


def test_two_masses_by_hand() -> None:
    # 1 kg at (0, 1, 0) and 3 kg at (0.5, 2, 0).
    skeleton = two_joints([1.0, 3.0])
    np.testing.assert_allclose(center_of_mass(skeleton, *skeleton.rest_pose()), [0.375, 1.75, 0.0])


def test_turning_a_joint_carries_its_mass() -> None:
    skeleton = two_joints([1.0, 3.0])
    root, rotations = skeleton.rest_pose()
    rotations[1] = [0, np.sin(np.pi / 4), 0, np.cos(np.pi / 4)]  # a quarter turn: +X goes to -Z
    np.testing.assert_allclose(center_of_mass(skeleton, root, rotations), [0.0, 1.75, -0.375], atol=1e-12)


def test_without_masses_the_root_stands_for_all() -> None:
    skeleton = two_joints([0.0, 0.0])
    np.testing.assert_allclose(center_of_mass(skeleton, *skeleton.rest_pose()), [0, 1, 0])


def test_default_figure_and_many_at_once() -> None:
    figure = default_figure()
    root, rotations = figure.rest_pose()
    one = center_of_mass(figure, root, rotations)
    assert 0.9 < one[1] < 1.05  # 55 to 57 % of the height in adults, less with arms out
    assert abs(one[0]) < 1e-12
    many = center_of_mass(figure, np.stack([root, root + 1.0]), np.stack([rotations, rotations]))
    np.testing.assert_allclose(many[1], one + 1.0)


def test_upper_body_share() -> None:
    # De Leva: everything but thighs, shanks and feet.
    assert upper_body_share(default_figure()) == pytest.approx(1 - 2 * (0.1447 + 0.0457 + 0.0110 + 0.0023), abs=1e-9)
