"""What a capture file's numbers mean: unit, upward axis, root, rest pose, told from the figure itself.

The outcome is always in metres, Y up, on a skeleton whose rest pose is a T-pose facing +Z; where every
joint is in the world is kept exactly, only the joints' own frames are chosen anew.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.skeleton import Index
from bunraku.motion import rotation as rot
from bunraku.motion.body import figure_of, leg_length
from bunraku.motion.clip import Clip, ClipError
from bunraku.motion.roles import roles_of

Array = NDArray[np.float64]

UNITS: Mapping[str, float] = {
    "m": 1.0, "dm": 0.1, "ASF units": 0.0254 / 0.45, "inches": 0.0254, "cm": 0.01, "mm": 0.001,
}  # fmt: skip
"""Metres in one unit of the files that are met; an ASF unit is 1/0.45 inch in the CMU and HDM05 collections."""

TYPICAL_LEG = 0.85  # m, thigh and shin of an adult
LEG_RANGE = (0.62, 1.12)  # m that a known unit may give
STRAIGHT = np.radians(5.0)  # a limb this near to its T-pose direction is left as the file has it
T_POSE = np.radians(25.0)
LEAP = 5.0  # rad/s, root mean square over the joints: faster than any motion begins
LEAP_FRAMES = 24  # that a leap out of a T-pose may take
SAMPLE = 240  # frames looked at to decide about the file


class CaptureError(ClipError):
    """A capture file that cannot be read; one line with the file, the line number and what is wrong."""


@dataclass
class Raw:
    """A file's joints and numbers as they stand there, in its own unit and axes."""

    name: str
    names: list[str]
    parents: list[int]
    offsets: Array  # (J, 3)
    ends: dict[int, Array]  # where bones of joints without children end
    positions: list[Array | None]  # a joint's (F, 3) position channels; they replace its offset
    rotations: Array  # (F, J, 4)
    fps: float
    findings: list[str] = field(default_factory=list)
    unit: float | None = None  # m, where the file says so


@dataclass(frozen=True, eq=False)
class Capture:
    """A clip read from a file, with what was found out on the way."""

    clip: Clip
    unit: float  # m in one unit of the file
    up: str  # the file's upward axis
    root: str  # "absolute" or "added": how the root's position was read
    rest: str  # where the T-pose came from: "rest pose", "first frame" or "upright frame"
    findings: tuple[str, ...]  # what was mended or is doubtful, a line each


def interpret(raw: Raw, *, unit: float | None = None, up: str | None = None, root: str | None = None) -> Capture:
    """The clip of a file's numbers; see `bunraku.motion.bvh.read_bvh` for the overrides."""
    if unit is not None and not (np.isfinite(unit) and unit > 0.0):
        raise CaptureError(f"{raw.name}: unit {unit}; give metres in one unit of the file, as 0.01")
    if up not in (None, "x", "y", "z"):
        raise CaptureError(f"{raw.name}: upward axis {up!r}; give x, y or z")
    if root not in (None, "absolute", "added"):
        raise CaptureError(f"{raw.name}: root {root!r}; give absolute or added")
    findings = list(raw.findings)
    offsets = _settle_offsets(raw, findings)
    roles = roles_of(raw.names, raw.parents)
    places = {kind: _root_track(raw, kind) for kind in ("absolute", "added")}
    tree = _Tree(list(raw.names), list(raw.parents), offsets, dict(raw.ends), roles, raw.rotations)
    if roles and roles["hips"] != 0:
        places = {kind: _world_of(roles["hips"], raw, tree, track) for kind, track in places.items()}
        tree = _below_hips(tree, findings)
    leg = leg_length(tree.offsets, tree.parents, tree.roles)
    rest_is_pose = _is_pose(tree, _rest(tree), leg)
    axis = up or _upward(tree, leg, rest_is_pose)
    tree, places = _turned_up(tree, places, axis)
    metres = _unit(raw, tree, leg, unit, findings)
    tree = replace(tree, offsets=tree.offsets * metres, ends={j: e * metres for j, e in tree.ends.items()})
    kind = root or _root_rule(tree, places["absolute"] * metres, places["added"] * metres)
    roots = places[kind] * metres
    first = _t_pose_frames(tree, roots, raw.fps)
    tree, source = _rested(tree, rest_is_pose)
    if source == "upright frame":
        findings.append("neither the rest pose nor the first frame is a T-pose; one was made from an upright frame")
    if first:
        findings.append(f"the motion begins with a T-pose; {first} frame{'s' if first > 1 else ''} left out")
    rest = _rest(tree)
    low = min([float(p[1]) for p in rest] + [float((rest[j] + e)[1]) for j, e in tree.ends.items()])
    shaped = np.array(tree.offsets)
    shaped[0] = (0.0, -low, 0.0)
    skeleton = figure_of(tree.names, tree.parents, shaped, tree.roles)
    clip = Clip(raw.name, skeleton, raw.fps, roots[first:], tree.rotations[first:])
    if not tree.roles:
        findings.append("no humanoid: legs, arms or head were not told from the joint names")
    return Capture(clip, metres, axis, kind, source, tuple(findings))


@dataclass(frozen=True, eq=False)
class _Tree:
    """The joints while their frames and unit are being settled."""

    names: list[str]
    parents: list[int]
    offsets: Array
    ends: dict[int, Array]
    roles: dict[str, int]
    rotations: Array  # (F, J, 4) relative to the parent

    def orientations(self, frames: Index | slice) -> Array:
        out = np.array(self.rotations[frames])
        for joint in range(1, len(self.names)):
            out[:, joint] = rot.mul(out[:, self.parents[joint]], out[:, joint])
        return out

    def positions(self, orientations: Array) -> Array:
        """(f, J, 3) with the root at zero."""
        out = np.zeros((*orientations.shape[:2], 3))
        for joint in range(1, len(self.names)):
            parent = self.parents[joint]
            out[:, joint] = out[:, parent] + rot.rotate(orientations[:, parent], self.offsets[joint])
        return out

    def sample(self) -> Index:
        frames = len(self.rotations)
        return np.unique(np.linspace(0, frames - 1, min(frames, SAMPLE)).astype(np.int64))


def _settle_offsets(raw: Raw, findings: list[str]) -> Array:
    """(J, 3) offsets, where a joint has position channels of its own their median."""
    offsets = np.array(raw.offsets, dtype=np.float64)
    size = float(np.abs(offsets).max(initial=0.0))
    for joint in range(1, len(raw.names)):
        track = raw.positions[joint]
        if track is None:
            continue
        middle = np.median(track, axis=0)
        offsets[joint] = middle
        drift = float(np.abs(track - middle).max())
        if drift > 0.05 * max(size, float(np.abs(middle).max())) and drift > 1e-6:
            findings.append(
                f"joint {raw.names[joint]!r} slides by {drift:.3g} units on its bone; its median place is used"
            )
    return offsets


def _root_track(raw: Raw, kind: str) -> Array:
    """(F, 3) the root's place, its position channels read as absolute or as added to its OFFSET."""
    track = raw.positions[0]
    start = raw.offsets[0]
    if track is None:
        return np.tile(start, (len(raw.rotations), 1))
    return track + start if kind == "added" else np.array(track)


def _world_of(joint: int, raw: Raw, tree: _Tree, track: Array) -> Array:
    """(F, 3) the world place of a joint below the root, with the sliding joints above it as the file has them."""
    chain = [joint]
    while tree.parents[chain[-1]] >= 0:
        chain.append(tree.parents[chain[-1]])
    place = np.array(track)
    turn = np.array(tree.rotations[:, 0])
    for here in reversed(chain[:-1]):
        own = raw.positions[here]
        place = place + rot.rotate(turn, own if own is not None else tree.offsets[here])
        turn = rot.mul(turn, tree.rotations[:, here])
    return place


def _below_hips(tree: _Tree, findings: list[str]) -> _Tree:
    """The hips as the root; joints above them, and what hangs there, are left out."""
    hips = tree.roles["hips"]
    keep = [hips]
    for joint in range(hips + 1, len(tree.names)):
        if tree.parents[joint] in keep:
            keep.append(joint)
    index = {old: new for new, old in enumerate(keep)}
    lost = [tree.names[j] for j in range(len(tree.names)) if j not in index]
    findings.append(
        f"{tree.names[hips]!r} is the root; left out: {', '.join(lost[:4])}{' ...' if len(lost) > 4 else ''}"
    )
    turn = np.array(tree.rotations[:, 0])
    chain = [hips]
    while tree.parents[chain[-1]] > 0:
        chain.append(tree.parents[chain[-1]])
    for here in reversed(chain):
        turn = rot.mul(turn, tree.rotations[:, here])
    rotations = tree.rotations[:, keep]
    rotations[:, 0] = turn
    return _Tree(
        [tree.names[j] for j in keep],
        [-1, *(index[tree.parents[j]] for j in keep[1:])],
        tree.offsets[keep],
        {index[j]: e for j, e in tree.ends.items() if j in index},
        {role: index[j] for role, j in tree.roles.items() if j in index},
        rotations,
    )


def _rest(tree: _Tree) -> Array:
    """(J, 3) places at rest, the root at zero."""
    places = np.zeros((len(tree.names), 3))
    for joint in range(1, len(tree.names)):
        places[joint] = places[tree.parents[joint]] + tree.offsets[joint]
    return places


def _head_and_feet(tree: _Tree, places: Array) -> Array:
    """(..., 3) from between the feet to the head (or neck, or chest, whichever there is)."""
    top = next((tree.roles[r] for r in ("head", "neck", "upperChest", "chest", "spine") if r in tree.roles), 0)
    feet = [tree.roles[r] for r in ("leftFoot", "rightFoot", "leftLowerLeg", "rightLowerLeg") if r in tree.roles][:2]
    return np.asarray(places[..., top, :] - places[..., feet, :].mean(axis=-2), dtype=np.float64)


def _is_pose(tree: _Tree, places: Array, leg: float) -> bool:
    """Whether ``places`` (J, 3) is a standing figure rather than bones laid along an axis."""
    if not tree.roles or leg == 0.0:
        return True  # nothing else to go by
    trunk = _head_and_feet(tree, places)
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


def _upward(tree: _Tree, leg: float, rest_is_pose: bool) -> str:
    """The file's upward axis from the rest pose or, where that says nothing, from the motion."""
    if not tree.roles or leg == 0.0:
        return "y"
    if rest_is_pose:
        trunk = _head_and_feet(tree, _rest(tree))
    else:
        frames = tree.sample()
        trunk = _head_and_feet(tree, tree.positions(tree.orientations(frames)))
        # A T-pose is at the beginning where there is one; else the figure stands most of the time.
        trunk = trunk[0] if _aligned(trunk[0]) else np.median(trunk, axis=0)
    return "xyz"[int(np.argmax(np.abs(trunk)))]


def _aligned(v: Array) -> bool:
    return bool(np.abs(v).max() > 0.95 * np.linalg.norm(v))


_TO_Y: Mapping[str, Array] = {
    "y": np.array([0.0, 0.0, 0.0, 1.0]),
    "z": np.array([-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]),  # (x, y, z) -> (x, z, -y)
    "x": np.array([0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]),  # (x, y, z) -> (-y, x, z)
}


def _turned_up(tree: _Tree, places: dict[str, Array], axis: str) -> tuple[_Tree, dict[str, Array]]:
    """The same with the world's and every joint's axes turned so that Y is up."""
    if axis == "y":
        return tree, places
    turn = _TO_Y[axis]
    return (
        replace(
            tree,
            offsets=rot.rotate(turn, tree.offsets),
            ends={j: rot.rotate(turn, e) for j, e in tree.ends.items()},
            rotations=rot.mul(rot.mul(turn, tree.rotations), rot.inverse(turn)),
        ),
        {kind: rot.rotate(turn, track) for kind, track in places.items()},
    )


def _unit(raw: Raw, tree: _Tree, leg: float, given: float | None, findings: list[str]) -> float:
    """Metres in one unit: as given, as the file says, or what makes the legs a person's."""
    if given is not None:
        return given
    if raw.unit is not None:
        return raw.unit
    if leg > 0.0:
        fitting = [u for u in UNITS.values() if LEG_RANGE[0] <= u * leg <= LEG_RANGE[1]]
        if fitting:
            return min(fitting, key=lambda u: abs(np.log(u * leg / TYPICAL_LEG)))
        findings.append(f"legs of {leg:.3g} units fit no known unit; scaled to legs of {TYPICAL_LEG} m")
        return TYPICAL_LEG / leg
    size = float(np.ptp(_rest(tree), axis=0).max(initial=0.0))
    metres = 0.01 if size > 5.0 else 1.0
    findings.append(f"the unit is a guess ({metres} m): no legs to tell it from; say it if it is wrong")
    return metres


def _feet(tree: _Tree) -> list[int]:
    parts = ("Toes", "Foot") if "leftToes" in tree.roles else ("Foot",)
    return [tree.roles[side + part] for side in ("left", "right") for part in parts if side + part in tree.roles]


def _root_rule(tree: _Tree, absolute: Array, added: Array) -> str:
    """The reading whose lowest foot is nearer to the floor."""
    feet = _feet(tree)
    if not feet or np.abs(absolute - added).max() < 1e-9:
        return "absolute"
    frames = tree.sample()
    low = tree.positions(tree.orientations(frames))[:, feet, 1].min(axis=1)
    heights = {kind: abs(float(np.percentile(low + track[frames, 1], 5))) for kind, track in
               (("absolute", absolute), ("added", added))}  # fmt: skip
    return "added" if heights["added"] < heights["absolute"] - 0.01 else "absolute"


_T_DIRECTION = {"UpperArm": 0, "LowerArm": 0, "UpperLeg": 1, "LowerLeg": 1}
_FAR_END = {"UpperArm": "LowerArm", "LowerArm": "Hand", "UpperLeg": "LowerLeg", "LowerLeg": "Foot"}


def _limbs(tree: _Tree) -> dict[int, tuple[int, Array]]:
    """Limb joint -> the joint at the far end of its bone, and the bone's direction in a T-pose facing +Z."""
    found = {}
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for part, end in _FAR_END.items():
            if side + part in tree.roles and side + end in tree.roles:
                arm = _T_DIRECTION[part] == 0
                direction = np.array([sign, 0.0, 0.0]) if arm else np.array([0.0, -1.0, 0.0])
                found[tree.roles[side + part]] = (tree.roles[side + end], direction)
    return found


def _facing(tree: _Tree, places: Array) -> float:
    """The yaw (rad) that a pose (J, 3) faces by its hip joints; 0 is +Z."""
    if not tree.roles:
        return 0.0
    left = places[tree.roles["leftUpperLeg"]] - places[tree.roles["rightUpperLeg"]]
    forward = np.cross(left, rot.UP)
    return float(np.arctan2(forward[0], forward[2])) if np.linalg.norm(forward) > 1e-9 else 0.0


def _is_t_pose(tree: _Tree, places: Array) -> bool:
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


def _t_pose_frames(tree: _Tree, roots: Array, fps: float) -> int:
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


def _rested(tree: _Tree, rest_is_pose: bool) -> tuple[_Tree, str]:
    """New joint frames whose identity is a T-pose facing +Z; where the joints are in the world stays.

    The T-pose is the rest pose or, where that is none, the first frame or the most upright one, with arms
    and legs turned the shortest way onto its axes where they are more than 5 degrees off.
    """
    if not tree.roles:
        return tree, "rest pose"
    identity = np.zeros((len(tree.names), 4))
    identity[:, 3] = 1.0
    source = "rest pose"
    reference, places = identity, _rest(tree)
    if not rest_is_pose:
        frames = tree.sample()
        orientations = tree.orientations(frames)
        tracks = tree.positions(orientations)
        if _is_t_pose(tree, tracks[0]):
            at, source = 0, "first frame"
        else:
            at, source = int(np.argmax(_head_and_feet(tree, tracks)[:, 1])), "upright frame"
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
    if rest_is_pose:
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


def _level_feet(tree: _Tree, turns: Array, back: Array, frames_of: Array) -> None:
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
