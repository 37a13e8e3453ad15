"""Legs in the air at their own pace, on numbers worked out by hand: turned out of what is in the way."""

from math import radians, sin

import numpy as np
import pytest

from bunraku.figure.boxes import place_boxes_into
from bunraku.figure.default import default_figure
from bunraku.figure.quat import angle, mul_inv, rotate
from bunraku.nodes.controller.core import Stack
from bunraku.nodes.controller.pacing import OVERLAP, above_floor, legs_into, pose_leg_between, turn_out

FIGURE = default_figure()


def legs(stack: Stack) -> np.ndarray:
    out = np.empty((2, 3, 4))
    legs_into(stack.rig, stack.rotations_ls, out)
    return out


def pose(stack: Stack, wanted: np.ndarray, share: float, deepest: float, most: float) -> float:
    """The left leg on its way from where it is."""
    centers, axes = np.empty((len(FIGURE), 3)), np.empty((len(FIGURE), 3, 3))
    place_boxes_into(stack.rig.box_centers, stack.positions_ws, stack.rotations_ws, centers, axes)
    return pose_leg_between(
        stack.rig, stack.under, stack.contacts, 0, legs(stack)[0], wanted, share, deepest, most,
        np.zeros(len(FIGURE)), centers, axes, stack.rotations_ls, stack.positions_ws, stack.rotations_ws,
    )  # fmt: skip


def lifted(up: float = 0.35, ahead: float = 0.3) -> Stack:
    """The left foot in the air, m from where it stands."""
    stack = Stack(FIGURE)
    place = stack.positions_ws[stack.rig.limbs[2, 2]] + np.array([0.02, up, ahead])
    stack.hold("left_foot", place)
    for _ in range(120):
        stack.step(1 / 60)
    return stack


def turned(stack: Stack, axis: str, degrees: float) -> np.ndarray:
    """The left leg (3, 4) with its hip turned about an axis of the pelvis."""
    out, q = legs(stack)[0], np.zeros(4)
    q["xyz".index(axis)], q[3] = sin(radians(degrees) / 2), np.cos(radians(degrees) / 2)
    x, y, z, w = out[0]
    a, b, c, s = q
    out[0] = [
        s * x + a * w + b * z - c * y, s * y - a * z + b * w + c * x,
        s * z + a * y - b * x + c * w, s * w - a * x - b * y - c * z,
    ]  # fmt: skip
    return out


def test_a_leg_turns_about_its_hip_just_so_far_that_a_contact_moves_out() -> None:
    stack, turn, moved = Stack(FIGURE), np.empty(4), np.empty(3)
    hip, knee, ankle = (stack.positions_ws[joint] for joint in stack.rig.limbs[2])
    for place, at in ((0.5, hip + 0.5 * (knee - hip)), (1.5, knee + 0.5 * (ankle - knee))):
        push = np.array([1.0, 0.0, 0.0, place])
        went = turn_out(stack.rig, 0, push, 0.01, 1.0, stack.positions_ws, turn)
        rotate(turn, at - hip, moved)
        assert (moved - (at - hip))[0] == pytest.approx(0.01, rel=0.02)
        assert went == pytest.approx(0.01 / np.linalg.norm((at - hip)[1:]), rel=1e-6)
    assert turn_out(stack.rig, 0, push, 0.5, 0.1, stack.positions_ws, turn) == pytest.approx(0.1)
    assert angle(turn) == pytest.approx(0.1)


def test_a_leg_on_its_way_is_turned_out_of_the_other_one() -> None:
    through = turned(lifted(0.06, 0.0), "z", -15.0)  # the foot goes to the right
    assert pose(lifted(0.06, 0.0), through, 1.0, OVERLAP, 0.0) < -0.02  # nothing turns it: it is in the other leg
    assert pose(lifted(0.06, 0.0), through, 1.0, OVERLAP, 1.0) > -OVERLAP


def test_a_leg_on_its_way_is_turned_off_the_floor() -> None:
    stack = lifted(0.05, 0.35)
    stack.positions_ws[:, 1] -= 0.07  # the whole body down: the foot is under the floor
    legs_as_they_are = legs(stack)[0]
    assert above_floor(stack.rig, stack.under, 0, stack.positions_ws, stack.rotations_ws) < -0.01
    assert pose(stack, legs_as_they_are, 1.0, OVERLAP, 0.0) < -0.01
    assert pose(stack, legs_as_they_are, 1.0, OVERLAP, 1.5) > -OVERLAP


def test_a_share_of_the_way_is_a_share_of_the_turn() -> None:
    stack, q = lifted(), np.empty(4)
    before = legs(stack)[0]
    wanted = turned(stack, "x", -10.0)
    pose(stack, wanted, 0.25, OVERLAP, 0.5)
    mul_inv(legs(stack)[0, 0], before[0], q)
    assert np.degrees(angle(q)) == pytest.approx(2.5, abs=0.05)


def test_no_joint_of_a_leg_outruns_a_person_when_its_foot_is_torn_about() -> None:
    stack, q = lifted(), np.empty(4)
    start = stack.positions_ws[stack.rig.limbs[2, 2]].copy()
    fastest = 0.0
    for n in range(60):
        stack.hold("left_foot", start + np.array([0.3 * (-1) ** n, 0.2, -0.5 * (n % 2)]))
        before = legs(stack)[0]
        stack.step(1 / 60)
        after = legs(stack)[0]
        for joint in range(3):
            mul_inv(after[joint], before[joint], q)
            fastest = max(fastest, angle(q) * 60)
    assert 1.0 < fastest <= 16.0 + 1.0
