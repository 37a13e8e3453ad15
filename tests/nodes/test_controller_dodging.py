"""Over a motion free arms keep out of the body, by no more than that takes; what touches nothing is the motion."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as any_of

from bunraku.figure.default import default_figure
from bunraku.figure.fk import fk
from bunraku.figure.metrics import joint_speeds, limit_violation, self_penetration
from bunraku.figure.quat import exp, rotate
from bunraku.motion.player import Player
from bunraku.motion.synth import builtin_set
from bunraku.nodes.controller.contacts import contact_place, turn_to_leave
from bunraku.nodes.controller.core import Stack
from bunraku.nodes.controller.dodging import LEFT, LET, left_over

FIGURE = default_figure()
DT = 1 / 60
ARMS = [joint for joint, name in enumerate(FIGURE.names) if name.endswith(("arm", "hand"))]
Frame = tuple[np.ndarray, np.ndarray, tuple[bool, bool]]


def depths_of_arms(positions: np.ndarray, orientations: np.ndarray) -> np.ndarray:
    """The deepest (F) m that an arm is in anything."""
    return self_penetration(FIGURE, positions, orientations, ARMS)


def playing(module: str, value: float, seconds: float) -> list[Frame]:
    """What the player makes of a move, or of a ducking stance."""
    player = Player(builtin_set())
    frames: list[Frame] = []
    for n in range(round(seconds / DT)):
        if n == 30 and module == "stand":
            player.stand(bend=value, duck=0.9)
        elif n == 30:
            player.move(module, [value])
        player.update(DT)
        left, right = player.contacts
        frames.append((player.root.copy(), player.rotations.copy(), (bool(left), bool(right))))
    return frames


def over(frames: list[Frame], stack: Stack, held: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places, orientations and local turns of the figure over a motion; ``held`` from the first second on, for two."""
    for _ in range(120):
        stack.lie_over(*frames[0])
        stack.step(DT)
    posed = []
    for n, frame in enumerate(frames):
        stack.lie_over(*frame)
        share = min(1.0, max(0.0, n / 60 - 1.0))
        for name, place in held.items():
            joint = 0 if name == "pelvis" else FIGURE.names.index(name)
            at, _ = fk(FIGURE, frame[0], frame[1])
            stack.hold(name, at[joint] + share * place if 60 <= n < 180 else None)
        stack.step(DT)
        posed.append((stack.positions_ws.copy(), stack.rotations_ws.copy(), stack.rotations_ls.copy()))
    positions, orientations, rotations = (np.array([one[k] for one in posed]) for k in range(3))
    return positions, orientations, rotations


@given(any_of.floats(0.0, 0.3), any_of.floats(1e-6, 0.01))
def test_shallow_overlaps_are_let_be_and_deep_ones_leave_little(depth: float, more: float) -> None:
    left = left_over(depth)
    assert left == depth if depth <= LET else left < LEFT
    assert 0.0 <= left_over(depth + more) - left <= more + 1e-12


def test_a_contact_lies_along_the_bones() -> None:
    stack, out = Stack(FIGURE), np.empty(3)
    shoulder, elbow, hand = (stack.positions_ws[joint] for joint in stack.rig.limbs[1, :3])
    contact_place(stack.rig, 1, 0.25, stack.positions_ws, out)
    np.testing.assert_allclose(out, shoulder + 0.25 * (elbow - shoulder))
    contact_place(stack.rig, 1, 1.5, stack.positions_ws, out)
    np.testing.assert_allclose(out, 0.5 * (elbow + hand))
    contact_place(stack.rig, 1, 2.0, stack.positions_ws, out)
    np.testing.assert_allclose(out, hand)


def test_an_arm_turns_by_what_moves_the_contact_out() -> None:
    vector, turn, moved = np.empty(3), np.empty(4), np.empty(3)
    lever = np.array([0.0, -0.5, 0.0])
    # A centimetre to the left half a metre below the shoulder: a fiftieth of a radian about +Z.
    assert turn_to_leave(lever, np.array([1.0, 0.0, 0.0]), 0.01, vector) == pytest.approx(0.01)
    np.testing.assert_allclose(vector, [0.0, 0.0, 0.02])
    exp(vector, turn)
    rotate(turn, lever, moved)
    np.testing.assert_allclose(moved - lever, [0.01, 0.0, 0.0], atol=2e-4)
    # Along the arm no turn helps, and near the shoulder none goes far.
    assert turn_to_leave(lever, np.array([0.0, 1.0, 0.0]), 0.01, vector) == 0.0
    turn_to_leave(0.02 * lever, np.array([1.0, 0.0, 0.0]), 0.01, vector)
    assert np.linalg.norm(vector) < 0.01


LEANING = {"pelvis": np.array([0.07, -0.06, 0.0]), "right_hand": np.array([-0.55, 0.95, 0.1])}


def test_an_arm_that_the_trunk_leans_on_hangs_beside_it_and_comes_back() -> None:
    """The right hand is pulled up and aside, the trunk follows and comes down on the left arm."""
    frames = playing("turn_left", 0.0, 5.0)
    frames = frames[:1] * len(frames)
    stack, free = Stack(FIGURE), Stack(FIGURE)
    free.gains = free.gains._replace(w_collision=0.0)
    deep = over(frames, free, LEANING)
    assert depths_of_arms(deep[0], deep[1]).max() > 0.02
    kept = over(frames, stack, LEANING)
    assert depths_of_arms(kept[0], kept[1]).max() < 0.005
    left = FIGURE.names.index("left_upper_arm")
    assert joint_speeds(kept[2], DT)[:, left].max() < joint_speeds(deep[2], DT)[:, left].max() + 1.5
    assert np.degrees(limit_violation(FIGURE, kept[2]).max()) < 1.0
    expected, _ = fk(FIGURE, frames[0][0], frames[0][1])
    np.testing.assert_allclose(kept[0][-1], expected, atol=1e-3)


@pytest.mark.parametrize(("module", "value"), [("stand", -0.3), ("stand", 0.6), ("jump_up", 0.5), ("turn_right", -2.0)])
def test_what_nobody_touches_keeps_out_of_itself_by_as_much_as_it_must(module: str, value: float) -> None:
    frames = playing(module, value, 4.0)
    positions, orientations, rotations = over(frames, Stack(FIGURE), {})
    moved = [fk(FIGURE, frame[0], frame[1]) for frame in frames]
    before = depths_of_arms(*(np.array(column) for column in zip(*moved, strict=True)))
    after = depths_of_arms(positions, orientations)
    assert after.max() < 0.005
    off = np.linalg.norm(positions - np.array([one[0] for one in moved]), axis=2)
    assert np.delete(off, ARMS, axis=1).max() < 1e-3
    # (What touches near the shoulder is a lever of the hand's way.)
    assert off.max() < 2.5 * before.max() + 1e-3
    own = joint_speeds(np.array([frame[1] for frame in frames]), DT)
    assert joint_speeds(rotations, DT).max() < own.max() + 0.5


def test_where_nothing_collides_nothing_changes() -> None:
    frames = playing("jump_up", 0.3, 3.0)
    positions, _, _ = over(frames, Stack(FIGURE), {})
    moved = [fk(FIGURE, frame[0], frame[1]) for frame in frames]
    assert depths_of_arms(*(np.array(column) for column in zip(*moved, strict=True))).max() < LET
    np.testing.assert_allclose(positions, [one[0] for one in moved], atol=1e-3)
