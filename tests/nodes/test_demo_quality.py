"""What `bunraku demo` shows, in numbers: out of itself, within its joints' ranges, on the floor, without a jump."""

from functools import cache
from pathlib import Path

import numpy as np

from bunraku.figure.default import default_figure
from bunraku.figure.fk import fk
from bunraku.figure.metrics import floor_penetration, joint_speeds, limit_violation, self_penetration
from bunraku.nodes.blender.node import Blender
from bunraku.nodes.controller.node import Controller
from bunraku.nodes.input_pen.node import InputPen
from bunraku.nodes.input_touch.node import InputTouch
from bunraku.nodes.input_touch.performance import load
from bunraku.nodes.interpreter.node import Interpreter
from bunraku.runtime.memory import MemoryStage

LAUNCH = Path(__file__).resolve().parents[2] / "launch"
FIGURE = default_figure()
HZ = 60
ENDS = [FIGURE.names.index(name) for name in ("left_hand", "right_hand", "left_foot", "right_foot")]
ARMS = [joint for joint, name in enumerate(FIGURE.names) if name.endswith(("arm", "hand"))]
LEGS = [joint for joint, name in enumerate(FIGURE.names) if name.endswith(("leg", "foot", "toes"))]


class Shown:
    """Poses (P) and the motion under them (M), frame by frame."""

    def __init__(self, poses: list[tuple[np.ndarray, np.ndarray]], held: list[list[bool]]):
        self.rotations = np.array([one[1] for one in poses])
        self.rotations /= np.linalg.norm(self.rotations, axis=2)[:, :, None]
        placed = [fk(FIGURE, root, turns) for (root, _), turns in zip(poses, self.rotations, strict=True)]
        self.positions = np.array([one[0] for one in placed])
        self.orientations = np.array([one[1] for one in placed])
        self.held = np.array(held)


@cache
def demo() -> tuple[Shown, Shown]:
    """The demonstration on a stage in memory: what is shown, and its motion; ``held`` (F, 7) hands, feet and more."""
    stage = MemoryStage()
    stage.add(Interpreter)
    stage.add(Blender)
    stage.add(Controller, show_overlay=False)
    stage.advance(1.0)
    began = stage.clock.now()
    script = LAUNCH / "demo.touch"
    stage.add(InputPen, drivers=["script"], script=str(LAUNCH / "demo.pen"))
    stage.add(InputTouch, script=str(script))
    shown: list[tuple[np.ndarray, np.ndarray]] = []
    moved: list[tuple[np.ndarray, np.ndarray]] = []
    held = []
    pose, motion, target = stage.last("pose"), stage.last("motion"), None
    for frame in range(round(load(script).length * HZ)):
        stage.clear()
        stage.advance((frame + 1) / HZ - (stage.clock.now() - began) / 1e9)
        pose, motion = stage.last("pose") or pose, stage.last("motion") or motion
        target = stage.last("target") or target
        for one, out in ((pose, shown), (motion, moved)):
            out.append((np.asarray(one.root, dtype=float), np.asarray(one.rotations, dtype=float)))
        parts = ("left_hand", "right_hand", "left_foot", "right_foot", "pelvis", "trunk", "head")
        held.append([target is not None and getattr(target, part) is not None for part in parts])
    return Shown(shown, held), Shown(moved, held)


def depths(one: Shown, joints: list[int]) -> np.ndarray:
    """How deep (F) m any of some parts is in another."""
    return self_penetration(FIGURE, one.positions, one.orientations, joints)


def since_held(held: np.ndarray, seconds: float) -> np.ndarray:
    """Frames (F) in which something is held, or was for the last ``seconds``."""
    out, last = np.zeros(len(held), dtype=bool), -(10**9)
    for frame in range(len(held)):
        last = frame if held[frame] else last
        out[frame] = frame - last <= seconds * HZ
    return out


def test_no_arm_goes_through_the_figure() -> None:
    shown, _ = demo()
    deep = depths(shown, ARMS)
    free = ~since_held(np.asarray(shown.held[:, :2].any(axis=1)), 0.0)
    assert deep[free].max() < 0.005
    # A hand that is waved before the face while the figure walks into it.
    assert deep.max() < 0.012


def test_legs_are_in_each_other_no_deeper_than_their_motion_has_them() -> None:
    shown, moved = demo()
    assert (depths(shown, LEGS) - np.maximum(depths(moved, LEGS), 0.005)).max() < 0.001


def test_joints_stay_within_their_ranges_where_their_motion_does() -> None:
    shown, moved = demo()
    beyond = np.degrees(limit_violation(FIGURE, shown.rotations) - limit_violation(FIGURE, moved.rotations))
    assert beyond.max() < 1.0


def test_feet_are_on_the_floor_where_their_motion_has_them() -> None:
    shown, moved = demo()
    deep, own = (floor_penetration(FIGURE, one.positions, one.orientations) for one in (shown, moved))
    assert (deep - np.maximum(own, 0.005)).max() < 0.002
    for side in range(2):
        off = np.linalg.norm(shown.positions[:, ENDS[2 + side]] - moved.positions[:, ENDS[2 + side]], axis=1)
        assert off[~since_held(np.asarray(shown.held[:, 2:5].any(axis=1)), 1.5)].max() < 0.002


def test_what_no_finger_holds_is_no_faster_than_its_motion() -> None:
    shown, moved = demo()
    fast, own = (np.degrees(joint_speeds(one.rotations, 1 / HZ)) for one in (shown, moved))
    free = ~since_held(np.asarray(shown.held[1:].any(axis=1)), 1.0)
    assert (fast - own)[free].max() < 60.0
    for limb, joints in enumerate((ARMS[:3], ARMS[3:], LEGS[:4], LEGS[4:])):
        free = ~since_held(shown.held[1:, limb], 1.0)
        assert fast[free][:, joints].max() < max(own[:, joints].max(), 300.0) * 1.1, limb


def test_arms_are_found_where_they_are_in_the_body() -> None:
    turns = np.tile([0.0, 0.0, 0.0, 1.0], (len(FIGURE), 1))
    inward = turns.copy()
    inward[FIGURE.names.index("left_upper_arm")] = [0.0, 0.0, -np.sin(0.93), np.cos(0.93)]  # down, and 17 degrees on
    root = np.array([0.0, 0.95, 0.0])
    deep = depths(Shown([(root, turns), (root, inward)], [[False] * 7] * 2), ARMS)
    assert deep[0] == 0.0
    assert deep[1] > 0.02
