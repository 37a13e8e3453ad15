"""A skeleton with a body from bare joints: the default figure's masses and boxes, fitted to the bones."""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.default import default_figure
from bunraku.figure.skeleton import Skeleton

Array = NDArray[np.float64]

# The joint at the far end of each role's bone, and the axis that the bone lies along at rest.
_NEXT = {
    "UpperArm": ("LowerArm", 0), "LowerArm": ("Hand", 0), "Shoulder": ("UpperArm", 0),
    "UpperLeg": ("LowerLeg", 1), "LowerLeg": ("Foot", 1), "Foot": ("Toes", 2),
}  # fmt: skip
_BACK = ("spine", "chest", "upperChest")


def leg_length(offsets: Array, parents: Sequence[int], roles: Mapping[str, int]) -> float:
    """Thigh and shin of both sides, averaged, in the unit of ``offsets`` (J, 3); 0 where a leg has no roles."""
    total = 0.0
    for side in ("left", "right"):
        chain = [roles.get(side + part) for part in ("UpperLeg", "LowerLeg", "Foot")]
        for start, end in pairwise(chain):
            if start is None or end is None:
                return 0.0
            total += float(np.linalg.norm(_reach(start, end, offsets, parents)))
    return 0.5 * total


def _reach(start: int, end: int, offsets: Array, parents: Sequence[int]) -> Array:
    """The vector at rest from joint ``start`` to ``end`` below it."""
    vector = np.zeros(3)  # from the floor where start is -1
    while end not in (start, -1):
        vector = vector + offsets[end]
        end = int(parents[end])
    return vector


def figure_of(names: Sequence[str], parents: Sequence[int], offsets: Array, roles: Mapping[str, int]) -> Skeleton:
    """A skeleton in T-pose with masses (70 kg in all) and boxes like the default figure's.

    Boxes and mass centres stretch with each bone along it and with the leg length across it; joints
    without a role have neither. What is no humanoid gets neither anywhere.

    Args:
        names: J joints, parents first. parents: J indices, -1 for the root.
        offsets: (J, 3) m at rest from the parent; the root's own is its height at rest.
        roles: VRM role -> joint.
    """
    model = default_figure()
    count = len(names)
    masses, centers = np.zeros(count), np.zeros((count, 3))
    box_centers, box_sizes = np.zeros((count, 3)), np.zeros((count, 3))
    size = leg_length(offsets, parents, roles) / leg_length(model.offsets, [int(p) for p in model.parents], model.roles)
    if size > 0.0:
        for role, joint in roles.items():
            if role in _BACK or role not in model.roles:
                continue
            source = model.roles[role]
            scale = np.full(3, size)
            side = "left" if role.startswith("left") else "right" if role.startswith("right") else ""
            following, axis = _NEXT.get(role.removeprefix(side), ("", 0)) if side else ("", 0)
            if following and side + following in roles:
                bone = np.linalg.norm(_reach(joint, roles[side + following], offsets, parents))
                known = np.linalg.norm(
                    _reach(source, model.roles[side + following], model.offsets, [int(p) for p in model.parents])
                )
                scale[axis] = bone / known
            masses[joint] = model.masses[source]
            centers[joint] = model.mass_centers[source] * scale
            box_centers[joint] = model.box_centers[source] * scale
            box_sizes[joint] = model.box_sizes[source] * scale
        _fit_back(parents, offsets, roles, size, masses, centers, box_centers, box_sizes)
        _fit_soles(parents, offsets, roles, size, box_centers, box_sizes)
    return Skeleton(
        tuple(names), np.asarray(parents, dtype=np.int64), offsets, roles, masses, centers, box_centers, box_sizes
    )


def _fit_back(
    parents: Sequence[int], offsets: Array, roles: Mapping[str, int], size: float,
    masses: Array, centers: Array, box_centers: Array, box_sizes: Array,
) -> None:  # fmt: skip
    """Share the default's two back boxes and masses out over any number of back joints, by height."""
    model = default_figure()
    back = [roles[role] for role in _BACK if role in roles]
    if not back:
        return
    top = roles.get("neck", roles.get("head"))
    ends = [*back[1:], top]
    heights = [
        float(_reach(joint, end, offsets, parents)[1]) if end is not None else 0.25 * size
        for joint, end in zip(back, ends, strict=True)
    ]
    heights = [max(height, 0.02 * size) for height in heights]
    total = sum(heights)
    known = [model.roles["spine"], model.roles["chest"]]
    if len(back) == len(known):
        model_heights = [model.offsets[known[1], 1], model.offsets[model.roles["neck"], 1]]
        for joint, source, height, usual in zip(back, known, heights, model_heights, strict=True):
            scale = np.array([size, height / usual, size])
            masses[joint] = model.masses[source]
            centers[joint] = model.mass_centers[source] * scale
            box_centers[joint] = model.box_centers[source] * scale
            box_sizes[joint] = model.box_sizes[source] * scale
        return
    mass = float(model.masses[known].sum())
    start = 0.0
    for joint, height in zip(back, heights, strict=True):
        part = (start + 0.5 * height) / total  # 0 at the waist, 1 at the neck
        start += height
        low, high = model.box_sizes[known[0]], model.box_sizes[known[1]]
        half = (low + (high - low) * part) * size
        half[1] = 0.5 * height
        masses[joint] = mass * height / total
        centers[joint] = box_centers[joint] = (0.0, 0.5 * height, 0.0)
        box_sizes[joint] = half


def _fit_soles(
    parents: Sequence[int],
    offsets: Array,
    roles: Mapping[str, int],
    size: float,
    box_centers: Array,
    box_sizes: Array,
) -> None:
    """Let the boxes of feet and toes end on the floor, wherever their joints are above it at rest."""
    for side in ("left", "right"):
        for part, top in (("Foot", -0.005 * size), ("Toes", 0.010 * size)):
            joint = roles.get(side + part)
            if joint is None:
                continue
            height = float(_reach(-1, joint, offsets, parents)[1])
            low = min(-height, top - 0.01 * size)
            box_centers[joint, 1] = 0.5 * (top + low)
            box_sizes[joint, 1] = 0.5 * (top - low)


def tip_of(skeleton: Skeleton, joint: int) -> Array:
    """(3) m in the joint's frame: where the bone of a joint without children ends.

    The far end of its box, for feet and toes at the sole; without a box a third of the bone before it.
    """
    center, half = skeleton.box_centers[joint], skeleton.box_sizes[joint]
    if not half.any():
        return np.array(skeleton.offsets[joint]) / 3.0
    axis = int(np.argmax(np.abs(center)))
    tip = np.array(center)
    tip[axis] += np.copysign(half[axis], center[axis])
    if any(skeleton.roles.get(side + part) == joint for side in ("left", "right") for part in ("Toes", "Foot")):
        tip[1] = center[1] - half[1]
    return tip
