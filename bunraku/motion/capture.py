"""What a capture file's numbers mean: unit, upward axis, root, rest pose, told from the figure itself.

The outcome is always in metres, Y up, on a skeleton whose rest pose is a T-pose facing +Z; where every
joint is in the world is kept exactly, only the joints' own frames are chosen anew.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from bunraku.motion import rotation as rot
from bunraku.motion.body import figure_of, leg_length
from bunraku.motion.capture_rest import Tree, head_and_feet, is_pose, rest_places, rested, t_pose_frames
from bunraku.motion.clip import Clip, ClipError
from bunraku.motion.roles import roles_of

Array = NDArray[np.float64]

UNITS: Mapping[str, float] = {
    "m": 1.0, "dm": 0.1, "ASF units": 0.0254 / 0.45, "inches": 0.0254, "cm": 0.01, "mm": 0.001,
}  # fmt: skip
"""Metres in one unit of the files that are met; an ASF unit is 1/0.45 inch in the CMU and HDM05 collections."""

TYPICAL_LEG = 0.85  # m, thigh and shin of an adult
LEG_RANGE = (0.62, 1.12)  # m that a known unit may give


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
    tree = Tree(list(raw.names), list(raw.parents), offsets, dict(raw.ends), roles, raw.rotations)
    if roles and roles["hips"] != 0:
        places = {kind: _world_of(roles["hips"], raw, tree, track) for kind, track in places.items()}
        tree = _below_hips(tree, findings)
    leg = leg_length(tree.offsets, tree.parents, tree.roles)
    restis_pose = is_pose(tree, rest_places(tree), leg)
    axis = up or _upward(tree, leg, restis_pose)
    tree, places = _turned_up(tree, places, axis)
    metres = _unit(raw, tree, leg, unit, findings)
    tree = replace(tree, offsets=tree.offsets * metres, ends={j: e * metres for j, e in tree.ends.items()})
    kind = root or _root_rule(tree, places["absolute"] * metres, places["added"] * metres)
    roots = places[kind] * metres
    first = t_pose_frames(tree, roots, raw.fps)
    tree, source = rested(tree, restis_pose)
    if source == "upright frame":
        findings.append("neither the rest pose nor the first frame is a T-pose; one was made from an upright frame")
    if first:
        findings.append(f"the motion begins with a T-pose; {first} frame{'s' if first > 1 else ''} left out")
    rest = rest_places(tree)
    low = min([float(p[1]) for p in rest] + [float((rest[j] + e)[1]) for j, e in tree.ends.items()])
    shaped = np.array(tree.offsets)
    shaped[0] = (0.0, -low, 0.0)
    skeleton = figure_of(tree.names, tree.parents, shaped, tree.roles)
    clip = Clip(raw.name, skeleton, raw.fps, roots[first:], tree.rotations[first:])
    if not tree.roles:
        findings.append("no humanoid: legs, arms or head were not told from the joint names")
    return Capture(clip, metres, axis, kind, source, tuple(findings))


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


def _world_of(joint: int, raw: Raw, tree: Tree, track: Array) -> Array:
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


def _below_hips(tree: Tree, findings: list[str]) -> Tree:
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
    return Tree(
        [tree.names[j] for j in keep],
        [-1, *(index[tree.parents[j]] for j in keep[1:])],
        tree.offsets[keep],
        {index[j]: e for j, e in tree.ends.items() if j in index},
        {role: index[j] for role, j in tree.roles.items() if j in index},
        rotations,
    )


def _upward(tree: Tree, leg: float, restis_pose: bool) -> str:
    """The file's upward axis from the rest pose or, where that says nothing, from the motion."""
    if not tree.roles or leg == 0.0:
        return "y"
    if restis_pose:
        trunk = head_and_feet(tree, rest_places(tree))
    else:
        frames = tree.sample()
        trunk = head_and_feet(tree, tree.positions(tree.orientations(frames)))
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


def _turned_up(tree: Tree, places: dict[str, Array], axis: str) -> tuple[Tree, dict[str, Array]]:
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


def _unit(raw: Raw, tree: Tree, leg: float, given: float | None, findings: list[str]) -> float:
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
    size = float(np.ptp(rest_places(tree), axis=0).max(initial=0.0))
    metres = 0.01 if size > 5.0 else 1.0
    findings.append(f"the unit is a guess ({metres} m): no legs to tell it from; say it if it is wrong")
    return metres


def _feet(tree: Tree) -> list[int]:
    parts = ("Toes", "Foot") if "leftToes" in tree.roles else ("Foot",)
    return [tree.roles[side + part] for side in ("left", "right") for part in parts if side + part in tree.roles]


def _root_rule(tree: Tree, absolute: Array, added: Array) -> str:
    """The reading whose lowest foot is nearer to the floor."""
    feet = _feet(tree)
    if not feet or np.abs(absolute - added).max() < 1e-9:
        return "absolute"
    frames = tree.sample()
    low = tree.positions(tree.orientations(frames))[:, feet, 1].min(axis=1)
    heights = {kind: abs(float(np.percentile(low + track[frames, 1], 5))) for kind, track in
               (("absolute", absolute), ("added", added))}  # fmt: skip
    return "added" if heights["added"] < heights["absolute"] - 0.01 else "absolute"
