"""The stack on other bodies than the default figure's, off both feet, and with its modules switched off one by one."""

import numpy as np
import pytest

from bunraku.figure.default import default_figure
from bunraku.figure.metrics import balance_margin, self_penetration
from bunraku.figure.skeleton import Skeleton
from bunraku.nodes.controller.core import Stack
from bunraku.nodes.controller.state import Gains

BASE = default_figure()
START = Stack(BASE).state.points.copy()


def humanoid(scale: float = 1.0, drop: tuple[str, ...] = ()) -> Skeleton:
    """The default figure at another size, without the joints of some roles."""
    gone = {BASE.roles[role] for role in drop}
    keep = [joint for joint in range(len(BASE)) if joint not in gone]
    offsets, parents = [], []
    for joint in keep:
        offset, parent = scale * BASE.offsets[joint], int(BASE.parents[joint])
        while parent in gone:
            offset, parent = offset + scale * BASE.offsets[parent], int(BASE.parents[parent])
        offsets.append(offset)
        parents.append(keep.index(parent) if parent >= 0 else -1)
    roles = {role: keep.index(joint) for role, joint in BASE.roles.items() if joint in keep}
    return Skeleton(
        tuple(BASE.names[joint] for joint in keep), np.array(parents), np.array(offsets), roles, BASE.masses[keep],
        scale * BASE.mass_centers[keep], scale * BASE.box_centers[keep], scale * BASE.box_sizes[keep],
    )  # fmt: skip


def run(stack: Stack, seconds: float) -> None:
    for _ in range(round(seconds * 60)):
        stack.step(1 / 60)


@pytest.mark.parametrize(
    ("scale", "drop"),
    [(0.6, ()), (1.3, ()), (1.0, ("chest",)), (1.0, ("neck",)),
     (1.0, ("leftShoulder", "rightShoulder", "leftToes", "rightToes"))],
)  # fmt: skip
def test_any_humanoid_reaches_and_steps(scale: float, drop: tuple[str, ...]) -> None:
    stack = Stack(humanoid(scale, drop))
    limbs = stack.rig.limbs
    run(stack, 0.3)
    target = stack.positions_ws[limbs[0, 2]] + scale * np.array([0.1, 0.35, 0.3])
    stack.hold("left_hand", target)
    run(stack, 1.5)
    np.testing.assert_allclose(stack.positions_ws[limbs[0, 2]], target, atol=1e-3)
    stack.hold("left_hand", None)
    feet = stack.positions_ws[limbs[2:, 2]].copy()
    stack.ask_step(np.array([0.5 * scale, 0.0, 0.0]))
    run(stack, 3.5)
    np.testing.assert_allclose(stack.positions_ws[limbs[2:, 2]] - feet, [[0.5 * scale, 0.0, 0.0]] * 2, atol=2e-3)
    assert stack.balanced()


def test_with_no_foot_on_the_ground_balance_abstains_and_both_come_down_again() -> None:
    stack = Stack(BASE)
    run(stack, 0.2)
    for n in range(120):
        for part, row, side in (("left_foot", 3, 1.0), ("right_foot", 4, -1.0)):
            stack.hold(part, START[row] + np.array([0.05 * side, 0.2, 0.1]) * min(1.0, n / 60))
        stack.step(1 / 60)
    assert stack.hull_size == 0
    assert not stack.state.planted.any()
    assert np.abs(stack.positions_ws[0, [0, 2]] - START[0, [0, 2]]).max() < 0.15
    stack.hold("left_foot", None)
    stack.hold("right_foot", None)
    run(stack, 4.0)
    assert stack.state.planted.all()
    assert stack.balanced()


def played(gains: Gains, part: str, way: tuple[float, float, float], release: float = 0.0) -> Stack:
    """A part taken along a way (m) in 0.6 s, held 0.9 s, and let go for a while."""
    stack = Stack(BASE, gains)
    row = ("pelvis", "left_hand", "right_hand").index(part)
    for n in range(90):
        stack.hold(part, START[row] + np.array(way) * min(1.0, n / 36))
        stack.step(1 / 60)
    if release > 0.0:
        stack.hold(part, None)
        run(stack, release)
    return stack


def lean(stack: Stack) -> float:
    """rad that the trunk leans."""
    x, _, z, _ = stack.state.turns[0]
    return float(2.0 * np.arcsin(min(1.0, float(np.hypot(x, z)))))


def test_without_tracking_nothing_is_pulled_along() -> None:
    far = (0.1, 0.45, 0.75)
    assert lean(played(Gains(), "left_hand", far)) > 0.2
    assert lean(played(Gains(w_tracking=0.0, w_interaction=0.0), "left_hand", far)) < 0.05


def test_without_balance_a_reach_goes_beyond_the_feet() -> None:
    def margin(gains: Gains) -> float:
        stack = played(gains, "left_hand", (0.8, 0.0, 0.9))
        planted = stack.state.planted[None] > 0.5
        return float(balance_margin(BASE, stack.positions_ws[None], stack.rotations_ws[None], planted)[0])

    assert margin(Gains()) > 0.0
    assert margin(Gains(w_balance=0.0)) < margin(Gains()) - 0.02


def test_without_interaction_the_trunk_does_not_sway_with_a_hand() -> None:
    def sway(gains: Gains) -> float:
        stack, most = Stack(BASE, gains), 0.0
        for n in range(45):
            stack.hold("left_hand", START[1] + np.array([0.0, 0.3, 0.35]) * min(1.0, n / 15))
            stack.step(1 / 60)
            most = max(most, lean(stack))
        return most

    assert sway(Gains()) > sway(Gains(w_interaction=0.0)) + 0.01


def test_without_relaxing_s_speeds_nothing_comes_back() -> None:
    way = (0.2, 0.5, 0.6)
    back, stays = played(Gains(), "left_hand", way, 3.0), played(Gains(relax_ends=0.0), "left_hand", way, 3.0)
    assert back.positions_ws[BASE.role("leftHand"), 1] < 1.0
    assert stays.positions_ws[BASE.role("leftHand"), 1] > 1.2


def test_without_avoidance_a_hand_goes_into_the_chest() -> None:
    def depth(gains: Gains) -> float:
        stack = played(gains, "left_hand", (-0.26, 0.4, -0.05))
        return float(self_penetration(BASE, stack.positions_ws[None], stack.rotations_ws[None])[0])

    assert depth(Gains()) <= 0.005
    assert depth(Gains(w_collision=0.0)) > 0.02
