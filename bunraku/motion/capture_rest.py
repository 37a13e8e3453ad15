"""The rest pose of a captured figure: whether it stands in a T-pose, and new joint frames in which it does."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.skeleton import Index
from bunraku.motion import rotation as rot

Array = NDArray[np.float64]

STRAIGHT = np.radians(5.0)  # a limb this near to its T-pose direction is left as the file has it
T_POSE = np.radians(25.0)  # as near as this every limb is in a T-pose
LEAP = 5.0  # rad/s, root mean square over the joints: faster than any motion begins
LEAP_FRAMES = 24  # that a leap out of a T-pose may take
SAMPLE = 240  # frames looked at to decide about the file


@dataclass(frozen=True, eq=False)
class Tree:
    """J joints over F frames while their frames and unit are being settled; lengths in the file's unit or in metres."""

    names: list[str]
    parents: list[int]  # parents first, -1 for the root
    offsets: Array  # (J, 3) in the parent's frame
    ends: dict[int, Array]  # (3) in the joint's frame: where bones of joints without children end
    roles: dict[str, int]  # VRM role -> joint; empty for what is no humanoid
    rotations: Array  # (F, J, 4) relative to the parent

    def orientations(self, frames: Index | slice) -> Array:
        """(f, J, 4) of the frames in the world."""
        out = np.array(self.rotations[frames])
        for joint in range(1, len(self.names)):
            out[:, joint] = rot.mul(out[:, self.parents[joint]], out[:, joint])
        return out

    def positions(self, orientations: Array) -> Array:
        """(f, J, 3) with the root at zero, for orientations (f, J, 4)."""
        out = np.zeros((*orientations.shape[:2], 3))
        for joint in range(1, len(self.names)):
            parent = self.parents[joint]
            out[:, joint] = out[:, parent] + rot.rotate(orientations[:, parent], self.offsets[joint])
        return out

    def sample(self) -> Index:
        """Frames spread evenly over the file, `SAMPLE` at most."""
        frames = len(self.rotations)
        return np.unique(np.linspace(0, frames - 1, min(frames, SAMPLE)).astype(np.int64))


def rest_places(tree: Tree) -> Array:
    """(J, 3) places at rest, the root at zero."""
    places = np.zeros((len(tree.names), 3))
    for joint in range(1, len(tree.names)):
        places[joint] = places[tree.parents[joint]] + tree.offsets[joint]
    return places


def head_and_feet(tree: Tree, places: Array) -> Array:
    """(..., 3) from between the feet to the head (or neck, or chest, whichever there is)."""
    top = next((tree.roles[r] for r in ("head", "neck", "upperChest", "chest", "spine") if r in tree.roles), 0)
    feet = [tree.roles[r] for r in ("leftFoot", "rightFoot", "leftLowerLeg", "rightLowerLeg") if r in tree.roles][:2]
    return np.asarray(places[..., top, :] - places[..., feet, :].mean(axis=-2), dtype=np.float64)


def is_pose(tree: Tree, places: Array, leg: float) -> bool:
    """Whether ``places`` (J, 3) is a standing figure rather than bones laid along an axis."""
    if not tree.roles or leg == 0.0:
        return True  # nothing else to go by
    trunk = head_and_feet(tree, places)
    tall = float(np.linalg.norm(trunk))
    across = places[tree.roles["leftUpperLeg"]] - places[tree.roles["rightUpperLeg"]]
    if tall < 1.3 * leg or np.linalg.norm(across) < 0.05 * leg:
        return False
    up = np.eye(3)[np.argmax(np.abs(trunk))] * np.sign(trunk[np.argmax(np.abs(trunk))])
    if trunk @ up < 0.9 * tall or abs(across @ up) > 0.5 * np.linalg.norm(across):
        return False
    hands = [tree.roles.get(side + "Hand", tree.roles.get(side + "LowerArm")) for side in ("left", "right")]
    if hands[0] is None or hands[1] is None:
        return True
    return bool((places[hands[0]] - places[hands[1]]) @ across > 0.0)


_FAR_END = {"UpperArm": "LowerArm", "LowerArm": "Hand", "UpperLeg": "LowerLeg", "LowerLeg": "Foot"}


def _limbs(tree: Tree) -> dict[int, tuple[int, Array]]:
    """Limb joint -> the joint at the far end of its bone, and the bone's direction in a T-pose facing +Z."""
    found = {}
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for part, end in _FAR_END.items():
            if side + part in tree.roles and side + end in tree.roles:
                direction = np.array([sign, 0.0, 0.0] if part.endswith("Arm") else [0.0, -1.0, 0.0])
                found[tree.roles[side + part]] = (tree.roles[side + end], direction)
    return found


def _facing(tree: Tree, places: Array) -> float:
    """The yaw (rad) that a pose (J, 3) faces by its hip joints; 0 is +Z."""
    if not tree.roles:
        return 0.0
    left = places[tree.roles["leftUpperLeg"]] - places[tree.roles["rightUpperLeg"]]
    forward = np.cross(left, rot.UP)
    return float(np.arctan2(forward[0], forward[2])) if np.linalg.norm(forward) > 1e-9 else 0.0


def _is_t_pose(tree: Tree, places: Array) -> bool:
    """Whether a pose (J, 3) is a T-pose facing anywhere."""
    limbs = _limbs(tree)
    if len(limbs) < 8:
        return False
    back = rot.yaw(-_facing(tree, places))
    for joint, (end, direction) in limbs.items():
        bone = rot.rotate(back, places[end] - places[joint])
        if bone @ direction < np.cos(T_POSE) * np.linalg.norm(bone):
            return False
    return True


def t_pose_frames(tree: Tree, roots: Array, fps: float) -> int:
    """How many frames to leave out: a T-pose put before the motion, and the leap from it to where the motion begins.

    The leap takes one frame or, where somebody smoothed it, a few.
    """
    if len(tree.rotations) < 4 or not tree.roles:
        return 0
    places = tree.positions(tree.orientations(slice(0, 1)))[0]
    if not _is_t_pose(tree, places):
        return 0
    near = tree.rotations[: LEAP_FRAMES + 4]
    turns = np.linalg.norm(rot.log(rot.mul(rot.inverse(near[:-1]), near[1:])), axis=-1)
    steps = np.sqrt(np.mean(turns**2, axis=1))
    shifts = np.linalg.norm(np.diff(roots[:4], axis=0), axis=1)
    if shifts[0] > 0.2 + 5.0 * shifts[1:].max() or (steps[0] > LEAP / fps and steps[0] > 4.0 * steps[1:3].max()):
        return 1
    top = float(steps[:6].max())
    if top * fps < LEAP:
        return 0
    calm = steps < 0.1 * top
    for frame in range(1, min(LEAP_FRAMES, len(calm) - 2)):
        if calm[frame : frame + 3].all():
            return frame
    return 0


def rested(tree: Tree, restis_pose: bool) -> tuple[Tree, str]:
    """New joint frames whose identity is a T-pose facing +Z; where the joints are in the world stays.

    The T-pose is the rest pose or, where that is none, the first frame or the most upright one, with arms
    and legs turned the shortest way onto its axes where they are more than 5 degrees off.
    """
    if not tree.roles:
        return tree, "rest pose"
    identity = np.zeros((len(tree.names), 4))
    identity[:, 3] = 1.0
    source = "rest pose"
    reference, places = identity, rest_places(tree)
    if not restis_pose:
        frames = tree.sample()
        orientations = tree.orientations(frames)
        tracks = tree.positions(orientations)
        if _is_t_pose(tree, tracks[0]):
            at, source = 0, "first frame"
        else:
            at, source = int(np.argmax(head_and_feet(tree, tracks)[:, 1])), "upright frame"
        reference, places = orientations[at], tracks[at]
    back = rot.yaw(-_facing(tree, places))
    if abs(back[1]) < 1e-6:
        back = np.array([0.0, 0.0, 0.0, 1.0])
    limbs = _limbs(tree)
    turns = np.array(identity)
    for joint in range(len(tree.names)):
        parent = tree.parents[joint]
        if joint in limbs:
            end, direction = limbs[joint]
            bone = rot.rotate(back, places[end] - places[joint])
            turn = rot.between(bone, direction)
            if 2.0 * np.arccos(min(1.0, abs(float(turn[3])))) > STRAIGHT:
                turns[joint] = turn
        elif parent >= 0:
            turns[joint] = turns[parent]
    frames_of = rot.mul(turns, rot.mul(back, reference))  # each joint's old frame in the T-pose
    if restis_pose:
        _level_feet(tree, turns, back, frames_of)
    if np.abs(np.abs(frames_of[:, 3]) - 1.0).max() < 1e-14:
        return tree, source
    parents = [max(p, 0) for p in tree.parents]
    offsets = rot.rotate(frames_of[parents], tree.offsets)
    offsets[0] = tree.offsets[0]
    rotations = rot.mul(tree.rotations, rot.inverse(frames_of))
    rotations[:, 1:] = rot.mul(frames_of[parents[1:]], rotations[:, 1:])
    ends = {joint: rot.rotate(frames_of[joint], end) for joint, end in tree.ends.items()}
    return replace(tree, offsets=offsets, ends=ends, rotations=rotations), source


def _level_feet(tree: Tree, turns: Array, back: Array, frames_of: Array) -> None:
    """Feet below legs that were turned: turned with them or not, whichever stands flatter in the motion."""
    frames = tree.sample()
    orientations = tree.orientations(frames)
    heights = tree.positions(orientations)[..., 1]
    for side in ("left", "right"):
        foot = tree.roles.get(side + "Foot")
        if foot is None or abs(turns[foot, 3]) > np.cos(np.radians(1.5)):
            continue
        low = heights[:, foot] <= np.percentile(heights[:, foot], 25)
        tilts = []
        for turn in (turns[foot], np.array([0.0, 0.0, 0.0, 1.0])):
            frame = rot.mul(turn, back)
            up = rot.rotate(rot.mul(orientations[low, foot], rot.inverse(frame)), rot.UP)
            tilts.append(float(np.mean(np.arccos(np.clip(up[:, 1], -1.0, 1.0)))))
        if tilts[1] < tilts[0]:
            for joint in range(foot, len(tree.names)):
                chain = joint
                while chain > foot:
                    chain = tree.parents[chain]
                if chain == foot:
                    frames_of[joint] = back
