"""Posing one limb for its point and swivel, within its joints' ranges and as near to the point as they let it."""

from math import atan2

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel, kernel_inline
from bunraku.figure.limb import flexion_of
from bunraku.figure.limits import Limits, clamp_joint
from bunraku.figure.pointpose import keep_above_floor, reconstruct_into, reconstruct_limb
from bunraku.figure.quat import between, exp, inv_mul, inv_rotate, mul, rotate, slerp
from bunraku.figure.rig import Rig
from bunraku.nodes.controller.state import State, Under

Array = NDArray[np.float64]

SEEK_ROUNDS = 8
"""Most rounds in which shoulder or hip, and elbow or knee, come nearer to a point that the ranges hold off."""
SETTLED = 1e-6
"""Change of the upper bone's quaternion below which they end."""


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
) -> None:  # fmt: skip
    """Bring a limb whose upper joint was held back by its range nearer to its end's place (3, world m).

    By turns (cyclic coordinate descent within limits): the elbow or knee opens or closes for the upper bone as it
    is, then the whole limb turns toward the place and into its range again.
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


@kernel
def place_limb(
    rig: Rig, st: State, under: Under, limits: Limits, limb: int, limited: bool, rotations_ls: Array,
    positions_ws: Array, rotations_ws: Array,
) -> None:  # fmt: skip
    """Pose one limb for its point and swivel, within its limits, and bring its world arrays up to date."""
    reconstruct_limb(
        rig, under.base, limb, st.points[1 + limb], st.swivels[limb], positions_ws, rotations_ws, rotations_ls
    )  # fmt: skip
    upper, lower, end = rig.limbs[limb, 0], rig.limbs[limb, 1], rig.limbs[limb, 2]
    if limited and clamp_joint(limits, upper, rotations_ls[upper]) > 0.0:
        seek_within_limits(rig, under, limits, limb, st.points[1 + limb], positions_ws, rotations_ws, rotations_ls)
    v = np.empty(3)
    for joint in range(upper, rig.parents.shape[0]):
        parent = rig.parents[joint]
        if joint != upper and parent < upper:
            break
        if joint == end and limb >= 2:
            turn = np.empty(4)
            side = limb - 2
            mul(rotations_ws[lower], under.base.rotations_ls[end], turn)
            slerp(turn, st.feet[side], st.feet_level[side], turn)
            height = max(st.points[3 + side, 1], rig.ankle_heights[side])
            keep_above_floor(rig, side, height - under.base.floors[side], turn)
            inv_mul(rotations_ws[lower], turn, rotations_ls[end])
        rotate(rotations_ws[parent], rig.offsets[joint], v)
        for k in range(3):
            positions_ws[joint, k] = positions_ws[parent, k] + v[k]
        mul(rotations_ws[parent], rotations_ls[joint], rotations_ws[joint])


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
        if again or (keeps and clamp_joint(limits, upper, rotations_ls[upper]) > 0.0):
            place_limb(rig, st, under, limits, limb, keeps, rotations_ls, positions_ws, rotations_ws)
