"""The point pose and its two directions: point pose to full pose (Oshita 2013 eqs 1-6) and back.

A point pose P is five positions (pelvis, hands, feet) and two orientations (trunk, head) in the world; here
it also holds the four swivels and how each foot is turned where it stands, so that a full pose survives
the way to P and back. Everything that P does not say (shoulders, wrists, the roll of each bone) comes from
a base pose: the rest pose, or a frame of a motion that P is laid over.
"""

from dataclasses import dataclass
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.fk import fk_into
from bunraku.figure.jit import kernel
from bunraku.figure.limb import frame_quat, pole_direction, soft_reach, swivel_of, two_bone
from bunraku.figure.quat import inv_mul, inv_rotate, mul, mul_inv, rotate, scale, slerp, swing_twist_y
from bunraku.figure.rig import PELVIS_BACK_RATIO, Rig, rig_of
from bunraku.figure.skeleton import Skeleton
from bunraku.figure.swivel import blend_swivel

Array = NDArray[np.float64]

LEVEL_FROM, LEVEL_TO = 0.02, 0.16
"""A foot is level up to the first height of its sole (m) and free of the ground from the second."""


@dataclass
class PointPose:
    """P, for one figure or with leading axes for many. Arrays are float64, positions in metres, xyzw."""

    points: Array  # (..., 5, 3) pelvis, left hand, right hand, left foot, right foot
    turns: Array  # (..., 2, 4) trunk, head
    swivels: Array  # (..., 4) rad: left arm, right arm, left leg, right leg
    feet: Array  # (..., 2, 4) world orientation of each foot where it stands

    def copy(self) -> "PointPose":
        return PointPose(self.points.copy(), self.turns.copy(), self.swivels.copy(), self.feet.copy())


class Base(NamedTuple):
    """What a base pose gives to a reconstruction over it."""

    rotations_ls: Array  # (J, 4)
    rotations_ws: Array  # (J, 4)
    rolls: Array  # (4, 2, 4) from a bone's (direction, hinge) frame to its joint
    exact: Array  # (4,) m up to which each limb reaches exactly: the rig's, or farther where the base does
    floors: Array  # (2,) m, the floor under each foot: 0, or lower where the base's own sole, toes unbent, is


@kernel
def default_swivel(rig: Rig, limb: int, end: Array, root: Array, parent: Array) -> float:
    """The swivel (rad) that the examples give for a limb's end at world ``end`` (3).

    ``root`` (3) is where the limb hangs and ``parent`` (4) the world orientation of what it hangs from.
    """
    v = np.empty(3)
    for k in range(3):
        v[k] = (end[k] - root[k]) / (rig.lengths[limb, 0] + rig.lengths[limb, 1])
    inv_rotate(parent, v, v)
    kind = limb // 2
    if limb % 2 == 1:
        v[0] = -v[0]  # the examples are the left side's
    return blend_swivel(v, rig.places[kind], rig.angles[limb], rig.radii[kind])


@kernel
def level_weight(height: float) -> float:
    """How much of a foot is turned by the ground (1..0) when its sole would be ``height`` (m) above it."""
    t = (height - LEVEL_FROM) / (LEVEL_TO - LEVEL_FROM)
    t = min(1.0, max(0.0, t))
    return 1.0 - t * t * (3.0 - 2.0 * t)


@kernel
def sole_bottom(rig: Rig, side: int, turn: Array) -> float:
    """The lowest point of a sole below its ankle (m, negative) when the foot is turned by ``turn`` (4)."""
    v = np.empty(3)
    low = 0.0
    for n in range(4):
        rotate(turn, rig.soles[side, n], v)
        if n == 0 or v[1] < low:
            low = v[1]
    return low


@kernel
def keep_above_floor(rig: Rig, side: int, ankle_height: float, turn: Array) -> None:
    """Turn a foot toward level, in place, just as far as it takes to keep its sole above the floor."""
    if ankle_height + sole_bottom(rig, side, turn) >= -1e-6:
        return
    swing, level, trial = np.empty(4), np.empty(4), np.empty(4)
    swing_twist_y(turn, swing, level)
    low, high = 0.0, 1.0
    for _ in range(14):
        t = 0.5 * (low + high)
        slerp(turn, level, t, trial)
        if ankle_height + sole_bottom(rig, side, trial) >= 0.0:
            high = t
        else:
            low = t
    slerp(turn, level, high, trial)
    for k in range(4):
        turn[k] = trial[k]


@kernel
def reconstruct_trunk(rig: Rig, base: Base, points: Array, turns: Array, rotations_ls: Array) -> None:
    """Local rotations of pelvis, back and neck from P (eqs 1-4); the rest of ``rotations_ls`` is kept."""
    change, swing, twist = np.empty(4), np.empty(4), np.empty(4)
    part, world, below = np.empty(4), np.empty(4), np.empty(4)
    top = rig.back[rig.back.shape[0] - 1]
    mul_inv(turns[0], base.rotations_ws[top], change)
    swing_twist_y(change, swing, twist)
    scale(PELVIS_BACK_RATIO, swing, part)
    mul(part, twist, part)
    mul(part, base.rotations_ws[0], below)
    for k in range(4):
        rotations_ls[0, k] = below[k]
    for n in range(rig.back.shape[0]):
        joint = rig.back[n]
        scale(rig.back_shares[n], swing, part)
        mul(part, twist, part)
        mul(part, base.rotations_ws[joint], world)
        inv_mul(below, world, rotations_ls[joint])
        for k in range(4):
            below[k] = world[k]
    # Neck: the head's turn against the trunk, shared evenly by the joints from neck to head.
    relative, relative_base = np.empty(4), np.empty(4)
    count = rig.neck.shape[0]
    head = rig.neck[count - 1]
    inv_mul(turns[0], turns[1], relative)
    inv_mul(base.rotations_ws[top], base.rotations_ws[head], relative_base)
    mul_inv(relative, relative_base, change)
    for k in range(4):
        below[k] = turns[0, k]
    for n in range(count):
        joint = rig.neck[n]
        scale((n + 1.0) / count, change, part)
        mul(turns[0], part, part)
        inv_mul(base.rotations_ws[top], base.rotations_ws[joint], world)
        mul(part, world, world)
        inv_mul(below, world, rotations_ls[joint])
        for k in range(4):
            below[k] = world[k]


@kernel
def reconstruct_limb(
    rig: Rig, base: Base, limb: int, end: Array, swivel: float, positions_ws: Array, rotations_ws: Array,
    rotations_ls: Array,
) -> None:  # fmt: skip
    """Local rotations of a limb's two bones, whose root and parent stand in the world arrays already."""
    upper, lower = rig.limbs[limb, 0], rig.limbs[limb, 1]
    parent = rig.parents[upper]
    axis, pole = np.empty(3), np.empty(3)
    upper_dir, lower_dir, hinge = np.empty(3), np.empty(3), np.empty(3)
    d = 0.0
    for k in range(3):
        axis[k] = end[k] - positions_ws[upper, k]
        d += axis[k] * axis[k]
    d = sqrt(d)
    inv_rotate(rotations_ws[parent], axis, axis)
    for k in range(3):
        axis[k] = axis[k] / d if d > 1e-9 else rig.references[limb, 0, k]
    reach = soft_reach(d, rig.reach[limb, 2], rig.reach[limb, 0], base.exact[limb] / rig.reach[limb, 2])
    pole_direction(axis, rig.references[limb, 0], rig.references[limb, 1], swivel, pole)
    two_bone(axis, pole, reach, rig.lengths[limb, 0], rig.lengths[limb, 1], upper_dir, lower_dir)
    hinge[0] = pole[1] * axis[2] - pole[2] * axis[1]
    hinge[1] = pole[2] * axis[0] - pole[0] * axis[2]
    hinge[2] = pole[0] * axis[1] - pole[1] * axis[0]
    frame, above = np.empty(4), np.empty(4)
    # In the parent's frame, so that the upper bone's rotation is local at once.
    frame_quat(upper_dir, hinge, frame)
    mul(frame, base.rolls[limb, 0], above)
    for k in range(4):
        rotations_ls[upper, k] = above[k]
    frame_quat(lower_dir, hinge, frame)
    mul(frame, base.rolls[limb, 1], frame)
    inv_mul(above, frame, rotations_ls[lower])


@kernel
def reconstruct_into(
    rig: Rig, base: Base, points: Array, turns: Array, swivels: Array, feet: Array, feet_level: Array,
    rotations_ls: Array, positions_ws: Array, rotations_ws: Array,
) -> None:  # fmt: skip
    """The full pose of a point pose: local rotations, world positions and orientations.

    Args:
        feet_level: (2,) 1 for a foot turned as ``feet`` says, 0 for one that follows its shin, between on
            the way; no sole goes under the floor in any case.
    """
    joints = rig.parents.shape[0]
    for joint in range(joints):
        for k in range(4):
            rotations_ls[joint, k] = base.rotations_ls[joint, k]
    reconstruct_trunk(rig, base, points, turns, rotations_ls)
    fk_into(rig.parents, rig.offsets, points[0], rotations_ls, positions_ws, rotations_ws)
    for limb in range(4):
        reconstruct_limb(
            rig, base, limb, points[limb + 1], swivels[limb], positions_ws, rotations_ws, rotations_ls
        )  # fmt: skip
    shin, turn = np.empty(4), np.empty(4)
    for side in range(2):
        upper, lower, foot = rig.limbs[2 + side, 0], rig.limbs[2 + side, 1], rig.limbs[2 + side, 2]
        mul(rotations_ws[rig.parents[upper]], rotations_ls[upper], shin)
        mul(shin, rotations_ls[lower], shin)
        mul(shin, base.rotations_ls[foot], turn)
        slerp(turn, feet[side], feet_level[side], turn)
        keep_above_floor(rig, side, max(points[3 + side, 1], rig.ankle_heights[side]) - base.floors[side], turn)
        inv_mul(shin, turn, rotations_ls[foot])
    fk_into(rig.parents, rig.offsets, points[0], rotations_ls, positions_ws, rotations_ws)


@kernel
def reconstruct_batch_into(
    rig: Rig, base: Base, points: Array, turns: Array, swivels: Array, feet: Array, feet_level: Array,
    rotations_ls: Array, positions_ws: Array, rotations_ws: Array,
) -> None:  # fmt: skip
    """`reconstruct_into` for N figures over one base: every pose array has a leading axis N."""
    for n in range(points.shape[0]):
        reconstruct_into(
            rig, base, points[n], turns[n], swivels[n], feet[n], feet_level[n], rotations_ls[n],
            positions_ws[n], rotations_ws[n],
        )  # fmt: skip


@kernel
def analyse_into(
    rig: Rig, rotations_ls: Array, positions_ws: Array, rotations_ws: Array, points: Array, turns: Array,
    swivels: Array, feet: Array, rolls: Array, exact: Array, floors: Array,
) -> None:  # fmt: skip
    """The point pose of a full pose, with a `Base`'s rolls, exact reaches and floors: reconstruction's inverse."""
    for k in range(3):
        points[0, k] = positions_ws[0, k]
    for k in range(4):
        turns[0, k] = rotations_ws[rig.back[rig.back.shape[0] - 1], k]
        turns[1, k] = rotations_ws[rig.neck[rig.neck.shape[0] - 1], k]
    axis, pole, hinge, elbow = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    upper_dir, lower_dir = np.empty(3), np.empty(3)
    frame, above = np.empty(4), np.empty(4)
    for limb in range(4):
        upper, lower, end = rig.limbs[limb, 0], rig.limbs[limb, 1], rig.limbs[limb, 2]
        parent = rig.parents[upper]
        for k in range(3):
            points[limb + 1, k] = positions_ws[end, k]
            axis[k] = positions_ws[end, k] - positions_ws[upper, k]
            elbow[k] = positions_ws[lower, k] - positions_ws[upper, k]
        n = max(sqrt(axis[0] ** 2 + axis[1] ** 2 + axis[2] ** 2), 1e-9)
        # Where the elbow stands out says the swivel; where it is straight, the hinge as at rest does.
        along = (elbow[0] * axis[0] + elbow[1] * axis[1] + elbow[2] * axis[2]) / (n * n)
        out2 = 0.0
        for k in range(3):
            pole[k] = elbow[k] - along * axis[k]
            out2 += pole[k] * pole[k]
            axis[k] /= n
        if out2 < 1e-8:
            rotate(rotations_ws[upper], rig.hinges[limb], hinge)
            pole[0] = axis[1] * hinge[2] - axis[2] * hinge[1]
            pole[1] = axis[2] * hinge[0] - axis[0] * hinge[2]
            pole[2] = axis[0] * hinge[1] - axis[1] * hinge[0]
        inv_rotate(rotations_ws[parent], axis, axis)
        inv_rotate(rotations_ws[parent], pole, pole)
        swivels[limb] = swivel_of(axis, pole, rig.references[limb, 0], rig.references[limb, 1])
        pole_direction(axis, rig.references[limb, 0], rig.references[limb, 1], swivels[limb], pole)
        reach = min(n, rig.reach[limb, 2] * (1.0 - 1e-9))
        exact[limb] = max(rig.reach[limb, 1], reach)
        two_bone(axis, pole, reach, rig.lengths[limb, 0], rig.lengths[limb, 1], upper_dir, lower_dir)
        hinge[0] = pole[1] * axis[2] - pole[2] * axis[1]
        hinge[1] = pole[2] * axis[0] - pole[0] * axis[2]
        hinge[2] = pole[0] * axis[1] - pole[1] * axis[0]
        frame_quat(upper_dir, hinge, frame)
        inv_mul(frame, rotations_ls[upper], rolls[limb, 0])
        mul(rotations_ls[upper], rotations_ls[lower], above)
        frame_quat(lower_dir, hinge, frame)
        inv_mul(frame, above, rolls[limb, 1])
    for side in range(2):
        for k in range(4):
            feet[side, k] = rotations_ws[rig.limbs[2 + side, 2], k]
        floors[side] = min(0.0, points[3 + side, 1] + sole_bottom(rig, side, feet[side]))


def rest_base(rig: Rig) -> Base:
    """The rest pose as a base: every joint turned as the world."""
    joints = rig.parents.shape[0]
    rotations = np.zeros((joints, 4))
    rotations[:, 3] = 1.0
    return Base(rotations, rotations.copy(), rig.rolls, rig.reach[:, 1].copy(), np.zeros(2))


def analyse(skeleton: Skeleton, root: Array, rotations_ls: Array) -> tuple[PointPose, Base]:
    """A full pose as a point pose and a base; `reconstruct` over that base gives the pose back.

    Args:
        root: (3) m, world position of the root joint.
        rotations_ls: (J, 4) xyzw, relative to the parent.
    """
    rig = rig_of(skeleton)
    local = np.ascontiguousarray(rotations_ls, dtype=np.float64)
    positions_ws, rotations_ws = np.empty((len(skeleton), 3)), np.empty((len(skeleton), 4))
    fk_into(rig.parents, rig.offsets, np.asarray(root, dtype=np.float64), local, positions_ws, rotations_ws)
    pose = PointPose(np.empty((5, 3)), np.empty((2, 4)), np.empty(4), np.empty((2, 4)))
    rolls, exact, floors = np.empty((4, 2, 4)), np.empty(4), np.empty(2)
    analyse_into(
        rig, local, positions_ws, rotations_ws, pose.points, pose.turns, pose.swivels, pose.feet, rolls, exact,
        floors,
    )  # fmt: skip
    return pose, Base(local, rotations_ws, rolls, exact, floors)


def reconstruct(
    skeleton: Skeleton, pose: PointPose, base: Base | None = None, feet_level: Array | None = None
) -> tuple[Array, Array]:
    """Local rotations (..., J, 4) and world positions (..., J, 3) of one point pose or many.

    Args:
        base: what the point pose is laid over; the rest pose where none is given.
        feet_level: (..., 2) see `reconstruct_into`; by each ankle's height where none is given.
    """
    rig = rig_of(skeleton)
    joints = len(skeleton)
    points = np.ascontiguousarray(pose.points, dtype=np.float64)
    lead = points.shape[:-2]
    if feet_level is None:
        heights = points[..., 3:, 1] - rig.ankle_heights
        t = np.clip((heights - LEVEL_FROM) / (LEVEL_TO - LEVEL_FROM), 0.0, 1.0)
        feet_level = 1.0 - t * t * (3.0 - 2.0 * t)
    rotations_ls = np.empty((*lead, joints, 4))
    positions_ws, rotations_ws = np.empty((*lead, joints, 3)), np.empty((*lead, joints, 4))
    reconstruct_batch_into(
        rig, rest_base(rig) if base is None else base, points.reshape(-1, 5, 3),
        np.ascontiguousarray(pose.turns, dtype=np.float64).reshape(-1, 2, 4),
        np.ascontiguousarray(pose.swivels, dtype=np.float64).reshape(-1, 4),
        np.ascontiguousarray(pose.feet, dtype=np.float64).reshape(-1, 2, 4),
        np.ascontiguousarray(feet_level, dtype=np.float64).reshape(-1, 2),
        rotations_ls.reshape(-1, joints, 4), positions_ws.reshape(-1, joints, 3), rotations_ws.reshape(-1, joints, 4),
    )  # fmt: skip
    return rotations_ls, positions_ws
