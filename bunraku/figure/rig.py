"""What the kernels need to know of a skeleton, worked out once: chains, limbs, soles, masses, boxes."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel
from bunraku.figure.limb import frame_quat
from bunraku.figure.skeleton import Skeleton, SkeletonError
from bunraku.figure.swivel import (
    ARM_EXAMPLES,
    ARM_REFERENCE,
    LEG_EXAMPLES,
    LEG_REFERENCE,
    example_arrays,
    reference_frame,
)

Array = NDArray[np.float64]
Index = NDArray[np.int64]

PELVIS, LEFT_HAND, RIGHT_HAND, LEFT_FOOT, RIGHT_FOOT = range(5)
"""Rows of a point pose's positions."""
TRUNK, HEAD = range(2)
"""Rows of its orientations."""
LEFT_ARM, RIGHT_ARM, LEFT_LEG, RIGHT_LEG = range(4)
"""Rows of everything that is kept by limb; limb + 1 is the row of its end among the positions."""

DEEPEST_CROUCH = 0.55
"""Shortest hip to ankle, with the foot on the ground, as a share of the leg."""
PELVIS_BACK_RATIO = 0.5
"""The pelvis's share of the trunk's swing (Oshita 2013 eq. 2)."""
ARM_SOFTEN, LEG_SOFTEN = 0.97, 0.992
"""Share of a limb's length up to which it reaches exactly."""
ARM_FLEXION, LEG_FLEXION = np.radians(150.0), np.radians(145.0)
"""Largest bend of elbow and knee (see `bunraku.figure.limits` for the source)."""


class Rig(NamedTuple):
    """Arrays of one skeleton for the kernels. J joints, B back joints, N neck joints, E examples."""

    parents: Index  # (J,)
    offsets: Array  # (J, 3) m
    masses: Array  # (J,) kg
    mass_centers: Array  # (J, 3) m
    box_centers: Array  # (J, 3) m
    box_sizes: Array  # (J, 3) m, half extents
    back: Index  # (B,) from the pelvis up
    back_shares: Array  # (B,) share of the trunk's swing that each turns by in the world, the last 1
    neck: Index  # (N,) from the trunk to the head
    limbs: Index  # (4, 3) upper, lower, end joints: left arm, right arm, left leg, right leg
    lengths: Array  # (4, 2) m
    reach: Array  # (4, 3) m: nearest, exact up to, never beyond
    references: Array  # (4, 2, 3) direction of the swivel's zero and that zero, in the parent's frame
    rolls: Array  # (4, 2, 4) from a bone's (direction, hinge) frame to the joint at rest
    hinges: Array  # (4, 3) axis of elbow or knee at rest; positive flexion bends
    places: Array  # (2, E, 3) swivel examples of arm and leg (left side), limb lengths
    angles: Array  # (4, E) rad
    radii: Array  # (2, E)
    soles: Array  # (2, 4, 3) m, corners of the left and right sole in the foot's frame
    ankle_heights: Array  # (2,) m above the ground where the sole is flat on it
    rest_positions: Array  # (J, 3) m
    leg_length: float  # m, hip to ankle, both sides' mean


def _chain(skeleton: Skeleton, top: int, bottom: int) -> Index:
    """Joints from below ``bottom`` up to ``top``, in order."""
    joints: list[int] = []
    joint = top
    while joint != bottom:
        if joint < 0:
            raise SkeletonError(f"{skeleton.names[top]!r} does not hang from {skeleton.names[bottom]!r}")
        joints.append(joint)
        joint = int(skeleton.parents[joint])
    return np.array(joints[::-1], dtype=np.int64)


def _sole(skeleton: Skeleton, foot: int, toes: int | None) -> tuple[Array, float]:
    """Corners of a sole (4, 3) in the foot's frame and the ankle's height above it."""
    rest = skeleton.rest_positions
    corners: list[Array] = []
    for joint in (foot, toes):
        if joint is None or not skeleton.box_sizes[joint].any():
            continue
        for sx in (-1.0, 1.0):
            for sz in (-1.0, 1.0):
                corner = skeleton.box_centers[joint] + skeleton.box_sizes[joint] * np.array([sx, -1.0, sz])
                corners.append(rest[joint] + corner - rest[foot])
    if not corners:
        # A skeleton without boxes on its feet: a sole of common size under the ankle.
        height = float(rest[foot][1])
        corners = [np.array([x, -height, z]) for x in (-0.04, 0.04) for z in (-0.05, 0.18)]
    points = np.array(corners)
    low = float(points[:, 1].min())
    (x0, z0), (x1, z1) = points[:, [0, 2]].min(axis=0), points[:, [0, 2]].max(axis=0)
    sole = np.array([[x0, low, z0], [x0, low, z1], [x1, low, z1], [x1, low, z0]])
    return sole, -low


@lru_cache(maxsize=32)
def rig_of(skeleton: Skeleton) -> Rig:
    """The rig of a humanoid skeleton; raises `SkeletonError` for one that lacks a required role."""
    skeleton.check_humanoid()
    rest = skeleton.rest_positions
    hips = skeleton.role("hips")
    if hips != 0:
        raise SkeletonError(f"the hips must be the root joint, not {skeleton.names[hips]!r} at {hips}")
    trunk_top = int(skeleton.back[-1])
    back = _chain(skeleton, trunk_top, hips)
    head = skeleton.role("head")
    neck = _chain(skeleton, head, trunk_top)
    steps = np.arange(1, len(back) + 1) / len(back)
    limbs = np.empty((4, 3), dtype=np.int64)
    lengths, reach = np.empty((4, 2)), np.empty((4, 3))
    references, rolls, hinges = np.empty((4, 2, 3)), np.empty((4, 2, 4)), np.empty((4, 3))
    count = max(len(ARM_EXAMPLES), len(LEG_EXAMPLES))
    places, radii, angles = np.full((2, count, 3), 1e3), np.ones((2, count)), np.zeros((4, count))
    for limb, (prefix, kind) in enumerate((("left", "Arm"), ("right", "Arm"), ("left", "Leg"), ("right", "Leg"))):
        arm = kind == "Arm"
        side = 1.0 if prefix == "left" else -1.0
        end = "Hand" if arm else "Foot"
        joints = [skeleton.role(f"{prefix}{part}") for part in (f"Upper{kind}", f"Lower{kind}", end)]
        limbs[limb] = joints
        bones = [rest[joints[1]] - rest[joints[0]], rest[joints[2]] - rest[joints[1]]]
        lengths[limb] = [np.linalg.norm(bone) for bone in bones]
        if lengths[limb].min() < 1e-4:
            raise SkeletonError(f"{skeleton.names[joints[1]]!r} or {skeleton.names[joints[2]]!r} has no length")
        upper, lower = lengths[limb]
        full = upper + lower
        flexion = ARM_FLEXION if arm else LEG_FLEXION
        least = np.sqrt(upper**2 + lower**2 + 2 * upper * lower * np.cos(flexion))
        reach[limb] = [least, full * (ARM_SOFTEN if arm else LEG_SOFTEN), full]
        hinge = np.array([0.0, -side, 0.0]) if arm else np.array([1.0, 0.0, 0.0])
        hinges[limb] = hinge
        for bone in range(2):
            direction = bones[bone] / lengths[limb, bone]
            square = hinge - (hinge @ direction) * direction
            square /= np.linalg.norm(square)
            frame = np.empty(4)
            frame_quat(direction, square, frame)
            rolls[limb, bone] = frame * np.array([-1.0, -1.0, -1.0, 1.0])
        references[limb] = reference_frame(ARM_REFERENCE if arm else LEG_REFERENCE, side)
        examples = ARM_EXAMPLES if arm else LEG_EXAMPLES
        ends, swivels, widths = example_arrays(examples, side, references[limb, 0], references[limb, 1])
        angles[limb, : len(examples)] = swivels
        if side > 0:
            places[limb // 2, : len(examples)] = ends
            radii[limb // 2, : len(examples)] = widths
    soles, heights = np.empty((2, 4, 3)), np.empty(2)
    for n, prefix in enumerate(("left", "right")):
        soles[n], heights[n] = _sole(skeleton, skeleton.role(f"{prefix}Foot"), skeleton.roles.get(f"{prefix}Toes"))
    return Rig(
        parents=np.array(skeleton.parents), offsets=np.array(skeleton.offsets), masses=np.array(skeleton.masses),
        mass_centers=np.array(skeleton.mass_centers), box_centers=np.array(skeleton.box_centers),
        box_sizes=np.array(skeleton.box_sizes), back=back,
        back_shares=PELVIS_BACK_RATIO + (1.0 - PELVIS_BACK_RATIO) * steps, neck=neck, limbs=limbs, lengths=lengths,
        reach=reach, references=references, rolls=rolls, hinges=hinges, places=places, angles=angles, radii=radii,
        soles=soles, ankle_heights=heights, rest_positions=np.array(rest),
        leg_length=float(lengths[2:].sum() / 2),
    )  # fmt: skip


def pack_rig(rig: Rig) -> tuple[Index, Array]:
    """A rig in two arrays, which cost less to hand to a compiled kernel than its two dozen; see `unpack_rig`."""
    ints = [np.array([len(rig.parents), len(rig.back), len(rig.neck), rig.angles.shape[1]])]
    ints += [np.ravel(a) for a in (rig.parents, rig.back, rig.neck, rig.limbs)]
    floats = [np.ravel(np.asarray(a, dtype=np.float64)) for a in rig if not _is_index(a)]
    return np.concatenate(ints).astype(np.int64), np.concatenate(floats)


def _is_index(a: object) -> bool:
    return isinstance(a, np.ndarray) and a.dtype == np.int64


@kernel
def unpack_rig(ints: Index, floats: Array) -> Rig:
    """The rig that `pack_rig` packed, as views."""
    j, b, n, e = ints[0], ints[1], ints[2], ints[3]
    i = 4
    parents = ints[i : i + j]
    i += j
    back = ints[i : i + b]
    i += b
    neck = ints[i : i + n]
    i += n
    limbs = ints[i : i + 12].reshape(4, 3)
    k = 0
    offsets = floats[k : k + 3 * j].reshape(j, 3)
    k += 3 * j
    masses = floats[k : k + j]
    k += j
    mass_centers = floats[k : k + 3 * j].reshape(j, 3)
    k += 3 * j
    box_centers = floats[k : k + 3 * j].reshape(j, 3)
    k += 3 * j
    box_sizes = floats[k : k + 3 * j].reshape(j, 3)
    k += 3 * j
    back_shares = floats[k : k + b]
    k += b
    lengths = floats[k : k + 8].reshape(4, 2)
    k += 8
    reach = floats[k : k + 12].reshape(4, 3)
    k += 12
    references = floats[k : k + 24].reshape(4, 2, 3)
    k += 24
    rolls = floats[k : k + 32].reshape(4, 2, 4)
    k += 32
    hinges = floats[k : k + 12].reshape(4, 3)
    k += 12
    places = floats[k : k + 6 * e].reshape(2, e, 3)
    k += 6 * e
    angles = floats[k : k + 4 * e].reshape(4, e)
    k += 4 * e
    radii = floats[k : k + 2 * e].reshape(2, e)
    k += 2 * e
    soles = floats[k : k + 24].reshape(2, 4, 3)
    k += 24
    ankle_heights = floats[k : k + 2]
    k += 2
    rest_positions = floats[k : k + 3 * j].reshape(j, 3)
    k += 3 * j
    return Rig(
        parents, offsets, masses, mass_centers, box_centers, box_sizes, back, back_shares, neck, limbs, lengths,
        reach, references, rolls, hinges, places, angles, radii, soles, ankle_heights, rest_positions, floats[k],
    )  # fmt: skip
