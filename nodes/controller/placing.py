"""Posing one limb for its point and swivel, within its joints' ranges and as near to the point as they let it."""

from math import atan2, sqrt

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel, kernel_inline
from bunraku.figure.limb import flexion_of
from bunraku.figure.limits import Limits, clamp_joint, joint_excess
from bunraku.figure.pointpose import keep_above_floor, reconstruct_into, reconstruct_limb, sole_bottom
from bunraku.figure.quat import angle, between, exp, inv_mul, inv_rotate, mul, mul_inv, rotate, slerp
from bunraku.figure.rig import Rig
from bunraku.nodes.controller.state import State, Under

Array = NDArray[np.float64]

SEEK_ROUNDS = 8
"""Most rounds in which shoulder or hip, and elbow or knee, come nearer to a point that the ranges hold off."""
SETTLED = 1e-6
"""Change of the upper bone's quaternion below which they end."""
NEARER = 0.02
"""m by which another way of being near a place must be nearer to be gone to."""
SAME = 0.03
"""rad between two ways of being at a place that are taken for one."""
RANGE_EASE = 0.02
"""rad over its range within which a joint that was in it is turned back."""
FLOOR_ROUNDS, UNDER_FLOOR = 5, 1e-3
"""Most times that a foot under the floor is aimed higher, and m that it may be under it."""


@kernel
def turn_about(a: Array, c: Array, w: Array) -> float:
    """The angle (rad) about the unit axis ``a`` (3) that brings ``c`` (3) nearest to ``w`` (3)."""
    ac = a[0] * c[0] + a[1] * c[1] + a[2] * c[2]
    aw = a[0] * w[0] + a[1] * w[1] + a[2] * w[2]
    along = c[0] * w[0] + c[1] * w[1] + c[2] * w[2] - ac * aw
    across = a[0] * (c[1] * w[2] - c[2] * w[1])
    across += a[1] * (c[2] * w[0] - c[0] * w[2])
    across += a[2] * (c[0] * w[1] - c[1] * w[0])
    return float(atan2(across, along)) if across * across + along * along > 1e-18 else 0.0


@kernel
def seek_within_limits(
    rig: Rig, under: Under, limits: Limits, limb: int, end: Array, positions_ws: Array, rotations_ws: Array,
    rotations_ls: Array,
) -> float:  # fmt: skip
    """Bring a limb whose upper joint was held back by its range nearer to its end's place (3, world m).

    By turns (cyclic coordinate descent within limits): the elbow or knee opens or closes for the upper bone as it
    is, then the whole limb turns toward the place and into its range again. Returns how far off it stays (m).
    """
    upper, lower, tip = rig.limbs[limb, 0], rig.limbs[limb, 1], rig.limbs[limb, 2]
    target, axis, shin, knee, reach = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    turn, vector, last = np.empty(4), np.empty(3), np.empty(4)
    for k in range(3):
        target[k] = end[k] - positions_ws[upper, k]
    inv_rotate(rotations_ws[rig.parents[upper]], target, target)
    vector[0], vector[1], vector[2] = 0.0, 1.0, 0.0
    inv_rotate(under.base.rolls[limb, 0], vector, axis)
    long, short = rig.lengths[limb, 0], rig.lengths[limb, 1]
    straightest = flexion_of(long, short, under.base.exact[limb])
    most = flexion_of(long, short, rig.reach[limb, 0])
    for _ in range(SEEK_ROUNDS):
        rotate(rotations_ls[lower], rig.offsets[tip], shin)
        inv_rotate(rotations_ls[upper], target, knee)
        for k in range(3):
            knee[k] -= rig.offsets[lower, k]
        bend = turn_about(axis, rig.offsets[lower], shin)
        least = min(straightest, bend)
        wanted = min(most, max(least, bend + turn_about(axis, shin, knee)))
        for k in range(3):
            vector[k] = (wanted - bend) * axis[k]
        exp(vector, turn)
        mul(turn, rotations_ls[lower], rotations_ls[lower])
        rotate(rotations_ls[lower], rig.offsets[tip], shin)
        for k in range(3):
            reach[k] = rig.offsets[lower, k] + shin[k]
        rotate(rotations_ls[upper], reach, reach)
        between(reach, target, turn)
        for k in range(4):
            last[k] = rotations_ls[upper, k]
        mul(turn, rotations_ls[upper], rotations_ls[upper])
        clamp_joint(limits, upper, rotations_ls[upper])
        changed = 0.0
        for k in range(4):
            changed += abs(rotations_ls[upper, k] - last[k])
        if changed < SETTLED:
            break
    off = 0.0
    for k in range(3):
        reach[k] = rig.offsets[lower, k] + shin[k]
    rotate(rotations_ls[upper], reach, reach)
    for k in range(3):
        off += (reach[k] - target[k]) ** 2
    return sqrt(off)


@kernel
def carry_from(rig: Rig, first: int, rotations_ls: Array, positions_ws: Array, rotations_ws: Array) -> None:
    """Bring the world arrays of a joint and of all that hangs on it up to date."""
    v = np.empty(3)
    for joint in range(first, rig.parents.shape[0]):
        parent = rig.parents[joint]
        if joint != first and parent < first:
            break
        rotate(rotations_ws[parent], rig.offsets[joint], v)
        for k in range(3):
            positions_ws[joint, k] = positions_ws[parent, k] + v[k]
        mul(rotations_ws[parent], rotations_ls[joint], rotations_ws[joint])


@kernel
def go_on_from_last(
    rig: Rig, st: State, under: Under, limits: Limits, side: int, outside: bool, place: Array, positions_ws: Array,
    rotations_ws: Array, rotations_ls: Array,
) -> bool:  # fmt: skip
    """Pose a leg that joint limits held off its foot's place (3, m) at the last step; whether they still do.

    There may be several ways to be near a place, so it goes on from the last one. Where what its swivel says anew is
    nearer, or in reach again, it goes over to that at `State.leg_pace`: hip and knee come in as that and are replaced.

    Args:
        outside: the hip of what the swivel says was held back by its range.
    """
    upper, lower = rig.limbs[2 + side, 0], rig.limbs[2 + side, 1]
    anew, q, off = np.empty((2, 4)), np.empty(4), 0.0
    if outside:
        off = seek_within_limits(rig, under, limits, 2 + side, place, positions_ws, rotations_ws, rotations_ls)
    anew[0], anew[1] = rotations_ls[upper], rotations_ls[lower]
    way = 0.0
    for n in range(2):
        mul_inv(anew[n], st.legs[side, n], q)
        way = max(way, angle(q))
    if way <= (st.leg_pace[side] if outside else max(st.leg_pace[side], SAME)):
        return outside
    share = st.leg_pace[side] / way
    slerp(st.legs[side, 0], anew[0], 0.0 if outside else share, rotations_ls[upper])
    slerp(st.legs[side, 1], anew[1], 0.0 if outside else share, rotations_ls[lower])
    kept = seek_within_limits(rig, under, limits, 2 + side, place, positions_ws, rotations_ws, rotations_ls)
    if kept > off + NEARER:
        slerp(st.legs[side, 0], anew[0], share, rotations_ls[upper])
        slerp(st.legs[side, 1], anew[1], share, rotations_ls[lower])
        clamp_joint(limits, upper, rotations_ls[upper])
    return True


@kernel
def keep_in_range(limits: Limits, joint: int, turn: Array) -> bool:
    """Bring a joint's local rotation (4) into its range, in place; False for one that is in it.

    By ever more of the way, so that one just beyond it does not jump to where the range is soft.
    """
    excess = joint_excess(limits, joint, turn)
    if excess <= 0.0:
        return False
    kept = turn.copy()
    clamp_joint(limits, joint, kept)
    slerp(turn, kept, min(1.0, excess / RANGE_EASE), turn)
    return True


@kernel
def place_foot(
    rig: Rig, st: State, under: Under, limits: Limits, side: int, limited: bool, rotations_ls: Array,
    positions_ws: Array, rotations_ws: Array,
) -> float:  # fmt: skip
    """Turn a foot as the ground, its shin and its ankle's range say; how far (m) its sole is under the floor then."""
    lower, end = rig.limbs[2 + side, 1], rig.limbs[2 + side, 2]
    turn = np.empty(4)
    mul(rotations_ws[lower], under.base.rotations_ls[end], turn)
    slerp(turn, st.feet[side], st.feet_level[side], turn)
    height = positions_ws[end, 1] if limited else max(st.points[3 + side, 1], rig.ankle_heights[side])
    keep_above_floor(rig, side, height - under.base.floors[side], turn)
    inv_mul(rotations_ws[lower], turn, rotations_ls[end])
    if not limited:
        return 0.0
    if keep_in_range(limits, end, rotations_ls[end]):
        mul(rotations_ws[lower], rotations_ls[end], turn)
    return float(under.base.floors[side] - positions_ws[end, 1] - sole_bottom(rig, side, turn))


@kernel
def place_limb(
    rig: Rig, st: State, under: Under, limits: Limits, limb: int, limited: bool, rotations_ls: Array,
    positions_ws: Array, rotations_ws: Array,
) -> None:  # fmt: skip
    """Pose one limb for its point and swivel, within its limits, and bring its world arrays up to date.

    A foot that its leg's or its own ankle's range would hold under the floor is aimed higher.
    """
    upper = rig.limbs[limb, 0]
    place = st.points[1 + limb].copy()
    for round_ in range(FLOOR_ROUNDS):
        reconstruct_limb(
            rig, under.base, limb, place, st.swivels[limb], positions_ws, rotations_ws, rotations_ls
        )  # fmt: skip
        outside = limited and clamp_joint(limits, upper, rotations_ls[upper]) > 0.0
        if limb >= 2 and limited and st.legs_kept[limb - 2] > 0.5:
            outside = go_on_from_last(
                rig, st, under, limits, limb - 2, outside, place, positions_ws, rotations_ws, rotations_ls
            )  # fmt: skip
        elif outside:
            seek_within_limits(rig, under, limits, limb, place, positions_ws, rotations_ws, rotations_ls)
        if limb >= 2 and limited:
            st.sought[limb - 2] = 1.0 if outside else 0.0
        carry_from(rig, upper, rotations_ls, positions_ws, rotations_ws)
        if limb < 2:
            return
        own = limited and under.active[0] < 0.5  # (a motion's own ankles may be beyond a range)
        under_floor = place_foot(rig, st, under, limits, limb - 2, own, rotations_ls, positions_ws, rotations_ws)
        if under_floor < UNDER_FLOOR or round_ == FLOOR_ROUNDS - 1:
            break
        place[1] += under_floor
    carry_from(rig, rig.limbs[limb, 2], rotations_ls, positions_ws, rotations_ws)


@kernel_inline
def hang_free_hands(rig: Rig, st: State, free: Array, arms: Array, positions_ws: Array) -> float:
    """Put free hands where their arms (2, 3, m) lead from the shoulders; how far (m, summed) they moved."""
    moved = 0.0
    for limb in range(2):
        if free[1 + limb] < 0.5:
            for k in range(3):
                at = positions_ws[rig.limbs[limb, 0], k] + arms[limb, k]
                moved += abs(at - st.points[1 + limb, k])
                st.points[1 + limb, k] = at
    return moved


@kernel
def place_body(
    rig: Rig, st: State, under: Under, limits: Limits, free: Array, arms: Array, limited: Array, rotations_ls: Array,
    positions_ws: Array, rotations_ws: Array,
) -> None:  # fmt: skip
    """The full pose of the point pose (see `reconstruct_into`), limbs within their limits where that is asked.

    Args:
        free: (5,) below 0.5 for a point that is not driven; a free hand hangs on its shoulder by its row of
            ``arms`` (2, 3, m), and its point is brought up to date.
        limited: (4,) above 0.5 for a limb that keeps its joints' ranges.
    """
    hang_free_hands(rig, st, free, arms, positions_ws)
    reconstruct_into(
        rig, under.base, st.points, st.turns, st.swivels, st.feet, st.feet_level, rotations_ls, positions_ws,
        rotations_ws,
    )  # fmt: skip
    # (The shoulders may have moved from where the hands were hung on them.)
    off = hang_free_hands(rig, st, free, arms, positions_ws) > 1e-9
    for limb in range(4):
        upper = rig.limbs[limb, 0]
        keeps = limited[limb] > 0.5
        again = off and limb < 2 and free[1 + limb] < 0.5
        if keeps and limb >= 2:
            st.sought[limb - 2] = 0.0
            end = rig.limbs[limb, 2]
            again = st.legs_kept[limb - 2] > 0.5
            again = again or (under.active[0] < 0.5 and joint_excess(limits, end, rotations_ls[end]) > 0.0)
        if again or (keeps and clamp_joint(limits, upper, rotations_ls[upper]) > 0.0):
            place_limb(rig, st, under, limits, limb, keeps, rotations_ls, positions_ws, rotations_ws)
