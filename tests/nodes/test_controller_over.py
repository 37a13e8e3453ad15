"""The stack laid over a motion: what nobody touches is the motion; a touch adds what it needs and takes it back."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from bunraku.figure.default import default_figure
from bunraku.figure.fk import fk
from bunraku.figure.metrics import unexplained_ways
from bunraku.figure.quat import mul
from bunraku.figure.rig import rig_of
from bunraku.motion.constraint import path_of
from bunraku.motion.player import Player
from bunraku.motion.synth import builtin_set
from bunraku.nodes.controller.core import Stack
from bunraku.nodes.controller.over import even_limbs

FIGURE = default_figure()
RIG = rig_of(FIGURE)
ENDS = RIG.limbs[:, 2]
Frame = tuple[np.ndarray, np.ndarray, tuple[bool, bool]]


@cache
def canonical(name: str) -> tuple[Frame, ...]:
    """A clip of the built-in set at 60 frames a second, with the feet that stand."""
    example = builtin_set().canonical[name]
    clip = example.clip
    count = round((len(clip.roots) - 1) / clip.fps * 60)
    frames = []
    for n in range(count):
        at = min(round(n * clip.fps / 60), len(clip.roots) - 1)
        left, right = example.contacts[at]
        frames.append((clip.roots[at], clip.rotations[at], (bool(left), bool(right))))
    return tuple(frames)


@cache
def walking(seconds: float = 6.0) -> tuple[Frame, ...]:
    """A walk straight ahead from standing, as the blender plays it."""
    player = Player(builtin_set())
    player.follow(path_of([[0.0, 0.0], [0.0, 12.0]], speeds=np.full(2, 1.2)))
    frames = []
    for _ in range(round(seconds * 60)):
        player.update(1 / 60)
        left, right = player.contacts
        frames.append((player.root.copy(), player.rotations.copy(), (bool(left), bool(right))))
    return tuple(frames)


def settled(frame: Frame) -> Stack:
    """A stack that has come over to a motion that stands still at its first frame."""
    stack = Stack(FIGURE)
    for _ in range(120):
        stack.lie_over(*frame)
        stack.step(1 / 60)
    return stack


@pytest.mark.parametrize("name", ["jump_up", "long_jump", "run", "jog", "sneak"])
def test_what_nobody_touches_is_the_motion(name: str) -> None:
    frames = canonical(name)
    stack = settled(frames[0])
    for frame in frames:
        stack.lie_over(*frame)
        stack.step(1 / 60)
        expected, _ = fk(FIGURE, frame[0], frame[1])
        np.testing.assert_allclose(stack.positions_ws, expected, atol=1e-3)


@pytest.mark.parametrize("place", [(0.30, 0.35, 0.40), (0.45, 0.60, 0.05)])
def test_a_held_hand_leaves_the_rest_of_a_walk_and_comes_back_to_it(place: tuple[float, float, float]) -> None:
    frames = walking()
    stack = settled(frames[0])
    other = [int(ENDS[1]), int(ENDS[2]), int(ENDS[3])]
    grabbed = stack.positions_ws[ENDS[0]] - frames[0][0]
    for n, frame in enumerate(frames):
        stack.lie_over(*frame)
        share = min(1.0, n / 40)
        target = frame[0] + grabbed + (np.array(place) - grabbed) * share
        held = n < 240
        stack.hold("left_hand", target if held else None)
        stack.step(1 / 60)
        expected, _ = fk(FIGURE, frame[0], frame[1])
        off = np.linalg.norm(stack.positions_ws - expected, axis=1)
        if held:
            # The other hand goes with the shoulders, which the held one takes along a little.
            assert off[other].max() < 0.032
            assert off[0] < 0.05
            assert n < 20 or np.linalg.norm(stack.positions_ws[ENDS[0]] - target) < 0.01
        elif n >= 300:
            # (What the walk takes into the thigh, a hand by up to 10 mm, keeps out of it.)
            assert off.max() < (0.015 if n < 330 else 0.006)


@pytest.mark.parametrize("part", ["pelvis", "right_foot", "left_elbow"])
def test_what_was_let_go_joins_the_motion_within_a_second_without_a_jump(part: str) -> None:
    frames = walking()
    stack = settled(frames[0])
    offset = np.array([-0.04, -0.08 if part == "pelvis" else 0.12, 0.06])
    before, worst = None, 0.0
    for n, frame in enumerate(frames):
        stack.lie_over(*frame)
        expected, _ = fk(FIGURE, frame[0], frame[1])
        joint = {"pelvis": 0, "right_foot": int(ENDS[3]), "left_elbow": int(RIG.limbs[0, 1])}[part]
        stack.hold(part, expected[joint] + offset * min(1.0, n / 40) if n < 120 else None)
        stack.step(1 / 60)
        off = stack.positions_ws - expected
        if before is not None and n > 60:
            worst = max(worst, float(np.linalg.norm(off - before, axis=1).max()))
        before = off
        if n >= 180:
            # (What the walk takes into the thigh, a hand by up to 10 mm, keeps out of it.)
            np.testing.assert_allclose(off, 0.0, atol=0.015 if n < 210 else 0.005)
    # The way back of 0.14 m along a damped spring of 0.15 s goes at most 0.5 m/s; limbs are levers.
    assert worst < 0.06


@pytest.mark.parametrize(
    ("part", "offset"),
    [
        ("left_foot", (-0.08, 0.0, 0.0)),  # the other leg is in the way
        ("right_foot", (0.08, 0.0, 0.0)),
        ("right_foot", (0.25, 0.0, 0.0)),
        ("pelvis", (0.0, 0.12, 0.0)),  # standing legs do not reach
        ("pelvis", (0.0, 0.0, -0.20)),
        ("left_hand", (0.0, -0.35, 0.20)),  # out of reach
        ("left_elbow", (0.0, 0.35, 0.0)),
    ],
)
def test_what_is_in_the_way_over_a_walk_makes_no_joint_jump(part: str, offset: tuple[float, float, float]) -> None:
    """Seen from the motion's root no joint goes farther in a frame than the motion, the finger and a damped spring."""
    frames = walking()
    stack = settled(frames[0])
    joints = {"pelvis": 0, "left_elbow": int(RIG.limbs[0, 1])}
    joints |= {name: int(ENDS[n]) for n, name in enumerate(("left_hand", "right_hand", "left_foot", "right_foot"))}
    posed, moved, targets = [], [], []
    for n, frame in enumerate(frames[:290]):
        stack.lie_over(*frame)
        expected, _ = fk(FIGURE, frame[0], frame[1])
        share = min(1.0, max(0.0, (n - 60) / 20))
        wanted = expected[joints[part]] + np.array(offset) * share * share * (3.0 - 2.0 * share)
        stack.hold(part, wanted if 60 <= n < 210 else None)
        stack.step(1 / 60)
        posed.append(stack.positions_ws.copy())
        moved.append(expected)
        targets.append(wanted - expected[0] if 60 <= n < 210 else np.full(3, np.nan))
    led = np.nan_to_num(np.linalg.norm(np.diff(targets, axis=0), axis=1))
    assert unexplained_ways(np.array(posed), np.array(moved), led).max() < 0.05
    np.testing.assert_allclose(posed[-1] - moved[-1], 0.0, atol=0.005)


def test_quick_changes_of_a_limb_fade_and_nothing_stays() -> None:
    """A joint that is half a radian off its last place at once begins where it was and ends where it should be."""
    frames = walking()
    stack = settled(frames[0])
    st, rig = stack.state, stack.rig
    paces, flags = np.empty(4), np.zeros(5)
    upper = int(rig.limbs[0, 0])
    gaps = []
    for n in range(90):
        stack.rotations_ls[:] = stack.under.base.rotations_ls
        if n > 0:
            turn = np.array([0.0, 0.0, np.sin(0.25), np.cos(0.25)])
            mul(stack.rotations_ls[upper], turn, stack.rotations_ls[upper])
        goal = stack.rotations_ls[upper].copy()
        even_limbs(
            rig, stack.gains, st, stack.held, stack.under, flags, 0.0, stack.rotations_ls, stack.positions_ws,
             stack.rotations_ws, paces, 1 / 60,
        )  # fmt: skip
        gaps.append(2.0 * np.arccos(min(1.0, abs(float(goal @ stack.rotations_ls[upper])))))
    assert gaps[0] < 1e-6
    reach = rig.lengths[0].sum()
    # The arm's end went 1.2 m/s for one frame, the rest is left.
    assert 0.5 - gaps[1] == pytest.approx(1.2 / 60 / (2.0 * np.sin(0.25) / 0.5 * reach), rel=0.03)
    assert all(b < a + 1e-9 for a, b in pairwise(gaps[1:]))
    assert gaps[-1] < 0.01
