"""Carry a clip over to another figure: joints find each other by their VRM roles.

World orientations are copied, each taken from its own T-pose; a limb's bone points where the source's bone
points even where the two T-poses differ a little. The root's way is scaled by the leg length.
"""

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.skeleton import Skeleton, SkeletonError
from bunraku.motion import rotation as rot
from bunraku.motion.analysis_contacts import on_floor
from bunraku.motion.body import leg_length
from bunraku.motion.clip import Clip, local

Array = NDArray[np.float64]

_LIMB_BONES = tuple(
    (side + start, side + end)
    for side in ("left", "right")
    for start, end in (("UpperArm", "LowerArm"), ("LowerArm", "Hand"), ("UpperLeg", "LowerLeg"), ("LowerLeg", "Foot"))
)
_BACK = ("spine", "chest", "upperChest")


def retarget(clip: Clip, skeleton: Skeleton, *, scale: float | None = None, floor: bool = False) -> Clip:
    """The clip's motion on another humanoid skeleton (both at rest in a T-pose facing +Z).

    A back with another number of joints shares the source's bend out evenly by height; joints whose role the
    source does not play, or that have none, keep their rest rotation relative to the parent.

    Args:
        scale: of the root's way; the ratio of the leg lengths when None.
        floor: put the lowest place of the soles (the 5th percentile over time) on the floor.

    Raises:
        SkeletonError: a skeleton is no humanoid.
    """
    source = clip.skeleton
    for figure in (source, skeleton):
        if not {"hips", "leftUpperLeg", "rightUpperLeg"} <= set(figure.roles):
            raise SkeletonError(f"clip {clip.name!r}: no humanoid; its joints' names tell no hips and legs")
    if source.hash == skeleton.hash and scale is None and not floor:
        return clip
    ratio = scale if scale is not None else _leg(skeleton) / _leg(source)
    from_ws = clip.world[1]
    to_ws = np.zeros((len(clip), len(skeleton), 4))
    role_of = {joint: role for role, joint in skeleton.roles.items()}
    align = _alignments(source, skeleton)
    spread = _back_orientations(clip, skeleton)
    for joint in range(len(skeleton)):
        role = role_of.get(joint, "")
        parent = int(skeleton.parents[joint])
        if joint in spread:
            to_ws[:, joint] = spread[joint]
        elif role in source.roles:
            turn = from_ws[:, source.roles[role]]
            to_ws[:, joint] = rot.mul(turn, align[role]) if role in align else turn
        elif parent >= 0:
            to_ws[:, joint] = to_ws[:, parent]
        else:
            to_ws[:, joint] = from_ws[:, source.roles["hips"]]
    roots = _hips(clip, skeleton, to_ws, ratio)
    moved = Clip(clip.name, skeleton, clip.fps, roots, local(skeleton, to_ws))
    return on_floor(moved) if floor else moved


def _leg(skeleton: Skeleton) -> float:
    length = leg_length(skeleton.offsets, [int(p) for p in skeleton.parents], skeleton.roles)
    if length <= 0.0:
        raise SkeletonError("no humanoid: thigh, shin and foot of both legs must be told from the joint names")
    return length


def _bone(skeleton: Skeleton, start: str, end: str) -> Array | None:
    """The rest direction of the bone between two roles; None where a role is not played."""
    if start not in skeleton.roles or end not in skeleton.roles:
        return None
    rest = skeleton.rest_positions
    return np.array(rest[skeleton.roles[end]] - rest[skeleton.roles[start]])


def _alignments(source: Skeleton, target: Skeleton) -> dict[str, Array]:
    """Role -> the smallest rotation from the target's rest bone to the source's, for the limbs."""
    found = {}
    for start, end in _LIMB_BONES:
        a, b = _bone(target, start, end), _bone(source, start, end)
        if a is not None and b is not None:
            found[start] = rot.between(a, b)
    for side in ("left", "right"):
        if side + "LowerArm" in found:  # the hand has no bone of its own to go by
            found[side + "Hand"] = found[side + "LowerArm"]
    return found


def _back_orientations(clip: Clip, target: Skeleton) -> dict[int, Array]:
    """World orientations (F, 4) of the target's back joints where the two backs differ in number."""
    mine = [target.roles[r] for r in _BACK if r in target.roles]
    theirs = [clip.skeleton.roles[r] for r in _BACK if r in clip.skeleton.roles]
    if not theirs or not mine or len(mine) == len(theirs):
        return {}
    turns = clip.world[1]
    knots = [clip.skeleton.roles["hips"], *theirs]
    found = {}
    for k, joint in enumerate(mine, 1):
        at = k / len(mine) * len(theirs)
        low = min(int(at), len(theirs) - 1)
        found[joint] = rot.slerp(turns[:, knots[low]], turns[:, knots[low + 1]], np.array(at - low))
    return found


def _hips(clip: Clip, target: Skeleton, to_ws: Array, ratio: float) -> Array:
    """(F, 3) the target's root so that the middle of its hip joints goes the source's way, scaled."""
    places = clip.world[0]
    source = clip.skeleton
    middle = 0.5 * (places[:, source.role("leftUpperLeg")] + places[:, source.role("rightUpperLeg")])
    rest = target.rest_positions
    own = 0.5 * (rest[target.role("leftUpperLeg")] + rest[target.role("rightUpperLeg")]) - rest[target.role("hips")]
    hips = middle * ratio - rot.rotate(to_ws[:, target.role("hips")], own)
    if target.role("hips") != 0:
        raise SkeletonError("the figure's root joint must play 'hips'")
    # Ankles are higher above the sole in one figure than in another.
    source_ankle = float(source.rest_positions[source.role("leftFoot"), 1])
    ankle = float(rest[target.role("leftFoot"), 1])
    return np.asarray(hips + np.array([0.0, ankle - source_ankle * ratio, 0.0]), dtype=np.float64)
