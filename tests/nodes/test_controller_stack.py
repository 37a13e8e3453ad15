"""The stack as a whole: standing, reaching, letting go, turning, stepping, lying over a motion."""

from math import cos, pi, radians, sin

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bunraku.figure.default import default_figure
from bunraku.figure.fk import fk
from bunraku.figure.metrics import balance_margin, joint_velocities
from bunraku.figure.quat import angle, mul_inv
from bunraku.figure.rig import rig_of
from bunraku.nodes.controller.core import Stack
from bunraku.nodes.controller.relaxing import twist_of
from bunraku.nodes.controller.state import Gains

FIGURE = default_figure()
RIG = rig_of(FIGURE)


def hand(stack: Stack, side: int = 0) -> np.ndarray:
    return stack.positions_ws[RIG.limbs[side, 2]].copy()


def feet(stack: Stack) -> np.ndarray:
    return stack.positions_ws[RIG.limbs[2:, 2]].copy()


def run(stack: Stack, seconds: float, hz: float = 60.0) -> None:
    for _ in range(round(seconds * hz)):
        stack.step(1 / hz)


def margin(stack: Stack) -> float:
    planted = stack.state.planted[None] > 0.5
    return float(balance_margin(FIGURE, stack.positions_ws[None], stack.rotations_ws[None], planted)[0])


def test_it_stands_at_ease_with_its_arms_at_its_sides_and_keeps_standing() -> None:
    stack = Stack(FIGURE)
    before = stack.positions_ws.copy()
    for side, sign in ((0, 1.0), (1, -1.0)):
        arm = hand(stack, side) - stack.positions_ws[RIG.limbs[side, 0]]
        assert arm[1] < -0.4
        assert 0.0 < sign * arm[0] < 0.2
    run(stack, 2.0)
    np.testing.assert_allclose(stack.positions_ws, before, atol=1e-4)
    assert margin(stack) > 0.03


def test_place_and_heading_of_the_start_pose() -> None:
    stack = Stack(FIGURE, place=np.array([1.0, 0.0, -2.0]), yaw=pi / 2)
    np.testing.assert_allclose(stack.positions_ws[0, [0, 2]], [1.0, -2.0], atol=1e-3)
    left, right = feet(stack)
    assert left[2] < right[2] - 0.15  # facing +X its left is -Z
    same = Stack(FIGURE)
    np.testing.assert_allclose(stack.rotations_ls[1:], same.rotations_ls[1:], atol=1e-6)


def test_a_reachable_hand_is_exactly_where_it_is_held() -> None:
    stack = Stack(FIGURE)
    stack.hold("left_hand", (0.4, 1.3, 0.4))
    run(stack, 1.5)
    np.testing.assert_allclose(hand(stack), (0.4, 1.3, 0.4), atol=1e-3)


def test_a_hand_beyond_the_arm_takes_trunk_and_pelvis_along_and_the_feet_stay() -> None:
    stack = Stack(FIGURE)
    start = feet(stack)
    stack.hold("left_hand", (0.35, 1.35, 0.75))
    run(stack, 2.0)
    np.testing.assert_allclose(hand(stack), (0.35, 1.35, 0.75), atol=1e-3)
    assert 2 * np.arcsin(np.linalg.norm(stack.state.turns[0, :3])) > radians(10)
    np.testing.assert_allclose(feet(stack), start, atol=1e-3)
    assert margin(stack) > 0.0
    stack.hold("left_hand", None)
    run(stack, 6.0)
    assert 2 * np.arcsin(np.linalg.norm(stack.state.turns[0, :3])) < radians(1)


def test_a_dragged_hand_stays_under_the_finger() -> None:
    stack = Stack(FIGURE)
    p = hand(stack)
    worst = 0.0
    for n in range(120):
        t = n / 60
        target = p + np.array([0.1 * sin(3 * t), 0.25 * (1 - cos(2 * t)), 0.2 * (1 - cos(2 * t))])
        stack.hold("left_hand", target)
        stack.step(1 / 60)
        worst = max(worst, float(np.linalg.norm(hand(stack) - target)))
    assert worst < 0.02


def test_grab_and_release_make_no_step_of_velocity_beyond_a_damped_spring() -> None:
    """Acceleration of the hand stays within what a spring of 0.1 s gives to the offset and speed there were."""
    stack = Stack(FIGURE)
    p = hand(stack)
    run(stack, 0.2)
    offset = np.array([0.05, 0.10, 0.05])  # grabbed 12 cm beside the hand
    track = [hand(stack)]
    for n in range(90):
        stack.hold("left_hand", p + offset if n < 45 else None)
        stack.step(1 / 60)
        track.append(hand(stack))
    velocity = np.diff(np.array(track), axis=0) * 60
    steps = np.linalg.norm(np.diff(velocity, axis=0), axis=1)
    # Critically damped from rest at a distance d: x'' = y²(y t - 1) e^(-y t) d, at most y² d, at t = 0.
    y = 2 * np.log(2) / 0.1
    assert steps.max() <= y * y * np.linalg.norm(offset) / 60
    assert steps[43:50].max() < 0.1  # let go at rest: nothing happens at once


def test_a_touched_part_is_not_pulled_off_by_the_others() -> None:
    stack = Stack(FIGURE)
    stack.hold("left_hand", (0.3, 1.5, 0.3))
    stack.hold("right_hand", (-0.3, 1.0, 0.4))
    run(stack, 1.5)
    np.testing.assert_allclose(hand(stack, 0), (0.3, 1.5, 0.3), atol=1e-3)
    np.testing.assert_allclose(hand(stack, 1), (-0.3, 1.0, 0.4), atol=1e-3)


def test_a_lifted_foot_moves_the_weight_over_the_other_and_comes_down_again() -> None:
    stack = Stack(FIGURE)
    foot = feet(stack)[1]
    for n in range(120):
        stack.hold("right_foot", foot + np.array([0.0, 0.35, 0.25]) * min(1.0, n / 40))
        stack.step(1 / 60)
    np.testing.assert_allclose(feet(stack)[1], foot + np.array([0.0, 0.35, 0.25]), atol=1e-3)
    assert stack.state.planted[1] == 0.0
    assert margin(stack) > 0.0
    stack.hold("right_foot", None)
    run(stack, 5.0)
    assert stack.state.planted[1] == 1.0
    assert feet(stack)[1][1] == pytest.approx(RIG.ankle_heights[1], abs=1e-6)
    assert margin(stack) > 0.02


def test_a_pelvis_that_was_let_go_stays_or_comes_back_as_asked() -> None:
    for speed, low in ((0.0, True), (0.3, False)):
        stack = Stack(FIGURE, Gains(relax_pelvis=speed))
        height = stack.positions_ws[0, 1]
        for n in range(60):
            stack.hold("pelvis", (0.0, height - 0.15 * min(1.0, n / 40), -0.03))
            stack.step(1 / 60)
        stack.hold("pelvis", None)
        run(stack, 4.0)
        assert (stack.positions_ws[0, 1] < height - 0.1) == low


def test_a_held_elbow_stands_out_toward_its_point() -> None:
    stack = Stack(FIGURE)
    stack.hold("left_hand", (0.35, 1.2, 0.25))
    run(stack, 1.0)
    for point in ((0.9, 1.4, 0.0), (0.3, 0.2, 0.1)):
        stack.hold("left_elbow", point)
        run(stack, 1.5)
        shoulder, elbow = stack.positions_ws[RIG.limbs[0, 0]], stack.positions_ws[RIG.limbs[0, 1]]
        axis = hand(stack) - shoulder
        axis /= np.linalg.norm(axis)
        a = (elbow - shoulder) - ((elbow - shoulder) @ axis) * axis
        b = (np.array(point) - shoulder) - ((np.array(point) - shoulder) @ axis) * axis
        # (The second point is behind the chest, on which the arm then leans.)
        assert a @ b / np.linalg.norm(a) / np.linalg.norm(b) > 0.96
        np.testing.assert_allclose(hand(stack), (0.35, 1.2, 0.25), atol=1e-3)


def test_it_turns_by_steps_without_sliding() -> None:
    stack = Stack(FIGURE)
    drift, prints = 0.0, feet(stack)
    was = stack.state.planted.copy()
    for n in range(480):
        stack.hold("yaw", min(2.0, n / 60))
        stack.step(1 / 60)
        now = feet(stack)
        for side in range(2):
            if stack.state.planted[side] > 0.5 and was[side] > 0.5:
                drift = max(drift, float(np.linalg.norm(now[side] - prints[side])))
            else:
                prints[side] = now[side]
        was = stack.state.planted.copy()
    assert drift < 2e-3
    assert stack.state.heading[0] == pytest.approx(2.0, abs=0.02)
    for side in range(2):
        assert twist_of(stack.state.feet[side]) == pytest.approx(2.0, abs=0.12)


@pytest.mark.parametrize("goal", [(0.6, 0.0, 0.0), (-0.3, 0.0, 0.5), (0.0, 0.0, -0.6)])
def test_a_step_brings_pelvis_and_feet_to_the_goal(goal: tuple[float, float, float]) -> None:
    stack = Stack(FIGURE)
    start = feet(stack)
    stack.ask_step(np.array(goal))
    run(stack, 4.0)
    assert not stack.stepping
    np.testing.assert_allclose(feet(stack) - start, [np.array(goal)] * 2, atol=2e-3)
    np.testing.assert_allclose(stack.positions_ws[0, [0, 2]], np.array(goal)[[0, 2]], atol=0.01)


def test_while_a_step_is_under_way_another_waits() -> None:
    stack = Stack(FIGURE)
    stack.ask_step(np.array([0.5, 0.0, 0.0]))
    run(stack, 0.4)
    stack.ask_step(np.array([0.5, 0.0, 0.5]))
    run(stack, 6.0)
    np.testing.assert_allclose(stack.positions_ws[0, [0, 2]], [0.5, 0.5], atol=0.02)


def walking(n: int) -> tuple[np.ndarray, np.ndarray]:
    """A made-up motion: a root that moves, arms and legs that swing."""
    root, rotations = FIGURE.rest_pose()
    t = n / 60
    root = root + np.array([0.1 * sin(t), 0.25, 1.2 * t])

    def about(role: str, axis: int, angle: float) -> None:
        q = np.zeros(4)
        q[axis], q[3] = sin(angle / 2), cos(angle / 2)
        rotations[FIGURE.role(role)] = q

    about("leftUpperArm", 2, -1.3)
    about("rightUpperArm", 2, 1.3)
    about("leftLowerArm", 1, -0.4 - 0.2 * sin(4 * t))
    about("rightLowerArm", 1, 0.4 + 0.2 * sin(4 * t))
    about("leftUpperLeg", 0, 0.4 * sin(4 * t) - 0.2)
    about("rightUpperLeg", 0, -0.4 * sin(4 * t) - 0.2)
    about("leftLowerLeg", 0, 0.5)
    about("rightLowerLeg", 0, 0.5)
    about("spine", 1, 0.1 * sin(4 * t))
    about("leftHand", 2, 0.3)
    about("leftShoulder", 2, 0.1)
    return root, rotations


def test_over_a_motion_that_nobody_touches_the_pose_is_the_motion() -> None:
    stack = Stack(FIGURE)
    for n in range(240):
        root, rotations = walking(n)
        stack.lie_over(root, rotations, (False, False))
        stack.step(1 / 60)
        if n > 200:  # what the start pose differed by has evened out
            expected, _ = fk(FIGURE, root, rotations)
            np.testing.assert_allclose(stack.positions_ws, expected, atol=2e-3)


def test_a_touch_over_a_motion_moves_its_hand_and_leaves_the_legs() -> None:
    stack = Stack(FIGURE)
    for n in range(300):
        root, rotations = walking(n)
        stack.lie_over(root, rotations, (False, False))
        target = root + np.array([0.35, 0.35, 0.3])
        stack.hold("left_hand", target if n > 120 else None)
        stack.step(1 / 60)
    np.testing.assert_allclose(hand(stack), target, atol=2e-3)
    expected, _ = fk(FIGURE, root, rotations)
    np.testing.assert_allclose(feet(stack), expected[RIG.limbs[2:, 2]], atol=2e-3)


def test_saved_state_goes_on_exactly() -> None:
    stack = Stack(FIGURE)
    stack.hold("left_hand", (0.4, 1.5, 0.5))
    run(stack, 0.4)
    other = Stack(FIGURE)
    other.restore(stack.save())
    np.testing.assert_allclose(other.positions_ws, stack.positions_ws, atol=0.002)
    other.hold("left_hand", (0.4, 1.5, 0.5))
    run(stack, 0.5)
    run(other, 0.5)
    np.testing.assert_allclose(other.positions_ws, stack.positions_ws, atol=1e-4)
    with pytest.raises(ValueError, match="no state"):
        other.restore(b"nonsense")


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_whatever_is_held_wherever_nothing_breaks(seed: int) -> None:
    rng = np.random.default_rng(seed)
    stack = Stack(FIGURE)
    parts = ["pelvis", "left_hand", "right_hand", "left_foot", "right_foot", "left_elbow", "right_knee"]
    for _ in range(6):
        for part in parts:
            if rng.random() < 0.5:
                stack.hold(part, rng.uniform(-3, 3, 3) if rng.random() < 0.7 else None)
        if rng.random() < 0.3:
            stack.hold("trunk", rng.normal(size=4))
        if rng.random() < 0.3:
            stack.hold("yaw", rng.uniform(-10, 10))
        if rng.random() < 0.3:
            stack.ask_step(rng.uniform(-2, 2, 3))
        for _ in range(12):
            stack.step(float(rng.uniform(0, 0.04)))
            assert np.isfinite(stack.positions_ws).all()
            assert np.isfinite(stack.buffer).all()
            np.testing.assert_allclose(np.linalg.norm(stack.rotations_ls, axis=1), 1.0, atol=1e-6)


def test_a_step_of_no_time_moves_nothing() -> None:
    stack = Stack(FIGURE)
    before = stack.rotations_ls.copy()
    stack.hold("left_hand", (0.5, 1.5, 0.4))
    stack.step(0.0)
    assert np.abs(joint_velocities(np.stack([before, stack.rotations_ls]), 1.0)).max() < 1e-3


@pytest.mark.parametrize(("axis", "degrees"), [(0, 10.0), (0, 40.0), (0, 60.0), (0, -25.0), (2, 25.0)])
def test_a_held_trunk_stays_and_the_pelvis_stays_over_its_feet(axis: int, degrees: float) -> None:
    """A held trunk leaves all of balance to the pelvis (eq. 17); hips and back bend against each other, so that the
    centre of mass stays over the soles and the pelvis hardly goes anywhere."""
    stack = Stack(FIGURE)
    before = stack.positions_ws[0].copy()
    turn, off = np.zeros(4), np.empty(4)
    for n in range(240):
        bend = radians(degrees) * min(1.0, n / 60)
        turn[axis], turn[3] = sin(bend / 2), cos(bend / 2)
        stack.hold("trunk", turn)
        stack.step(1 / 60)
    mul_inv(stack.state.turns[0], turn, off)
    assert angle(off) < radians(0.1)
    way = stack.positions_ws[0] - before
    level = float(np.hypot(way[0], way[2]))
    assert margin(stack) > Gains().margin - 2e-3
    assert level < 0.02
