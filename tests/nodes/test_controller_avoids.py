"""Self-collision avoidance on numbers worked out by hand: where boxes touch, how a limb is pushed, who yields."""

import numpy as np
import pytest

from bunraku.figure.boxes import place_boxes_into
from bunraku.figure.default import default_figure
from bunraku.figure.metrics import self_penetration
from bunraku.nodes.controller.contacts import contact_point, deepest_contact, push_limb, yields
from bunraku.nodes.controller.core import Stack, contacts_of
from bunraku.nodes.controller.placing import place_limb
from bunraku.nodes.controller.state import Gains

FIGURE = default_figure()


def test_a_box_is_touched_at_its_face_s_middle_or_its_corner() -> None:
    out, half = np.empty(3), np.array([0.1, 0.2, 0.3])
    contact_point(np.zeros(3), np.eye(3), half, np.array([0.0, 0.0, 1.0]), out)
    np.testing.assert_allclose(out, [0.0, 0.0, 0.3])
    contact_point(np.ones(3), np.eye(3), half, np.array([1.0, -1.0, 1.0]) / np.sqrt(3), out)
    np.testing.assert_allclose(out, [1.1, 0.8, 1.3])


def test_a_limb_may_touch_all_but_itself_and_its_neighbours() -> None:
    contacts = contacts_of(FIGURE, Stack(FIGURE).rig)
    hand, arm, chest = (FIGURE.role(role) for role in ("leftHand", "leftLowerArm", "chest"))
    assert contacts.parts[0].tolist()[1:3] == [arm, hand]
    others = contacts.others[0, 2].tolist()
    assert chest in others
    assert arm not in others
    assert FIGURE.role("rightHand") in others


def test_free_limbs_yield_to_driven_ones_and_arms_to_legs() -> None:
    stack, out = Stack(FIGURE), np.empty(len(FIGURE))
    st, rig = stack.state, stack.rig
    hands = FIGURE.role("leftHand"), FIGURE.role("rightHand")
    yields(rig, st, np.array([0.0, 1.0, 0.0, 0.0, 0.0]), 0, out)
    assert (out[hands[0]], out[hands[1]]) == (0.0, 1.0)  # the right hand makes way for the held left one
    assert out[FIGURE.role("leftFoot")] == 0.0  # a planted foot for nobody
    yields(rig, st, np.array([0.0, 1.0, 0.0, 0.0, 0.0]), 1, out)
    assert out[hands[0]] == 0.0
    st.planted[:] = 0.0
    yields(rig, st, np.zeros(5), 2, out)
    assert (out[hands[0]], out[hands[1]]) == (1.0, 1.0)
    yields(rig, st, np.zeros(5), 0, out)
    assert out[FIGURE.role("leftFoot")] == 0.0


@pytest.mark.parametrize("depth", [0.004, 0.012])
def test_a_push_moves_the_contact_out_by_its_depth(depth: float) -> None:
    stack = Stack(FIGURE)
    stack.hold("left_hand", (0.10, 1.15, 0.22))
    for _ in range(90):
        stack.step(1 / 60)
    st, rig, contacts = stack.state, stack.rig, stack.contacts
    arrays = stack.positions_ws, stack.rotations_ws
    way = np.array([0.0, 0.0, 1.0])
    end = stack.positions_ws[rig.limbs[0, 2]].copy()
    push_limb(rig, st, 0, np.array([*way, 2.0]), depth, 0.2, *arrays)
    np.testing.assert_allclose(st.points[1] - end, depth * way, atol=2e-4)  # at the end it is simply moved
    st.points[1] = end
    middle = 0.5 * (stack.positions_ws[rig.limbs[0, 1]] + end)
    push_limb(rig, st, 0, np.array([*way, 1.5]), depth, 0.2, *arrays)  # half-way along the forearm
    place_limb(rig, st, stack.under, contacts.limits, 0, False, stack.rotations_ls, *arrays)
    moved = 0.5 * (stack.positions_ws[rig.limbs[0, 1]] + stack.positions_ws[rig.limbs[0, 2]]) - middle
    assert moved @ way == pytest.approx(depth, rel=0.15)


def test_the_deepest_contact_says_gap_and_way_out() -> None:
    stack = Stack(FIGURE, Gains(w_collision=0.0))
    stack.hold("left_hand", (0.05, 1.25, 0.09))  # within the chest
    for _ in range(90):
        stack.step(1 / 60)
    joints = len(FIGURE)
    push = np.empty(4)
    gap = deepest_contact(
        stack.rig, stack.contacts, 0, np.zeros(joints), stack.positions_ws, stack.rotations_ws,
        *boxes(stack), push,
    )  # fmt: skip
    inside = self_penetration(FIGURE, stack.positions_ws[None], stack.rotations_ws[None])[0]
    assert inside > 0.02
    assert -gap == pytest.approx(inside, abs=1e-6)
    assert np.linalg.norm(push[:3]) == pytest.approx(1.0)
    assert 0.0 <= push[3] <= 2.0


def boxes(stack: Stack) -> tuple[np.ndarray, np.ndarray]:
    centers, axes = np.empty((len(FIGURE), 3)), np.empty((len(FIGURE), 3, 3))
    place_boxes_into(stack.rig.box_centers, stack.positions_ws, stack.rotations_ws, centers, axes)
    return centers, axes
