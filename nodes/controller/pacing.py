"""Legs in the air: how fast their joints turn at most, and when a free foot has landed."""

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.boxes import place_boxes_into
from bunraku.figure.jit import kernel
from bunraku.figure.limits import Limits, clamp_joint, joint_excess
from bunraku.figure.pointpose import keep_above_floor
from bunraku.figure.quat import angle, inv_mul, mul_inv, slerp
from bunraku.figure.rig import Rig
from bunraku.nodes.controller.collision import Contacts, deepest_contact
from bunraku.nodes.controller.placing import carry_from
from bunraku.nodes.controller.state import State, Under
from bunraku.nodes.controller.step import IDLE, PHASE

Array = NDArray[np.float64]

LEG_SPEED = 16.0
"""rad/s: the fastest that hip, knee and ankle of a foot in the air turn. Where joint limits hold a foot off its place
there may be two ways to be near it; the leg goes from one to the other in some frames, not in one."""
RETURN, RETURN_WAY = 0.8, 6.0
"""rad/s, and rad/m of its foot's way, at which a leg that limits have turned aside goes back to its swivel."""
OVERLAP = 2e-3
"""m that a leg on its way from one to the other may overlap the rest."""
STANDS = 4e-3
"""m above its standing height up to which a foot that comes down has landed."""
OVER_RANGE, OFF_LEVEL = 0.01, 0.05
"""rad that a landing leg's joints may be over their ranges, and its foot off the level."""


@kernel
def legs_into(rig: Rig, rotations_ls: Array, out: Array) -> None:
    """The local rotations (2, 3, 4) of hip, knee and ankle of both legs."""
    for side in range(2):
        for n in range(3):
            for k in range(4):
                out[side, n, k] = rotations_ls[rig.limbs[2 + side, n], k]


@kernel
def allow_return(st: State, before: Array, dt: float) -> None:
    """How far each leg may go back to its swivel in this step; ``before`` (5, 3) m are the points of the last one."""
    for side in range(2):
        way = 0.0
        for k in range(3):
            way += (st.points[3 + side, k] - before[3 + side, k]) ** 2
        st.leg_pace[side] = RETURN * dt + RETURN_WAY * sqrt(way)


@kernel
def pace_legs(
    rig: Rig, st: State, under: Under, contacts: Contacts, flags: Array, before: Array, rotations_ls: Array,
    positions_ws: Array, rotations_ws: Array, dt: float,
) -> None:  # fmt: skip
    """Let no joint of a leg in the air turn faster than `LEG_SPEED`; the leg follows late instead.

    Args:
        before: (2, 3, 4) hip, knee and ankle at the last step (`legs_into`).
        flags: (5,) which points are driven.
    """
    q, most = np.empty(4), LEG_SPEED * dt
    joints = rig.parents.shape[0]
    wanted = np.empty((3, 4))
    for side in range(2):
        if st.planted[side] > 0.5:
            continue
        fastest = 0.0
        for n in range(3):
            wanted[n] = rotations_ls[rig.limbs[2 + side, n]]
            mul_inv(wanted[n], before[side, n], q)
            fastest = max(fastest, angle(q))
        if fastest <= most:
            continue
        end = rig.limbs[2 + side, 2]
        centers, axes, push, nobody = np.empty((joints, 3)), np.empty((joints, 3, 3)), np.empty(4), np.zeros(joints)
        place_boxes_into(rig.box_centers, positions_ws, rotations_ws, centers, axes)
        share = most / fastest
        for way in range(3):
            for n in range(3):
                joint = rig.limbs[2 + side, n]
                slerp(before[side, n], wanted[n], share, rotations_ls[joint])
                clamp_joint(contacts.limits, joint, rotations_ls[joint])
            carry_from(rig, rig.limbs[2 + side, 0], rotations_ls, positions_ws, rotations_ws)
            keep_above_floor(rig, side, positions_ws[end, 1] - under.base.floors[side], rotations_ws[end])
            inv_mul(rotations_ws[rig.parents[end]], rotations_ws[end], rotations_ls[end])
            clamp_joint(contacts.limits, end, rotations_ls[end])
            carry_from(rig, end, rotations_ls, positions_ws, rotations_ws)
            gap = deepest_contact(
                rig, contacts, 2 + side, nobody, positions_ws, rotations_ws, centers, axes, push
            )  # fmt: skip
            if gap > -OVERLAP:
                break
            # Where it cannot go straight over a held foot stays; where that is no place either, it is put over.
            share = 0.0 if way == 0 and flags[3 + side] > 0.5 else 1.0
        # From here on, the way that it is nearest to.
        st.sought[side] = 1.0
        if st.step[PHASE] == IDLE:
            for k in range(3):
                st.points[3 + side, k] = positions_ws[end, k]
                if flags[3 + side] < 0.5:
                    st.wishes[2 + side, k] = positions_ws[end, k]


@kernel
def see_landings(
    rig: Rig, st: State, limits: Limits, positions_ws: Array, rotations_ls: Array, rotations_ws: Array
) -> None:
    """Which free feet are where they can stand: on the ground, level, with their legs within their ranges."""
    q = np.empty(4)
    for side in range(2):
        st.landed[side] = 0.0
        if st.planted[side] > 0.5 or st.sought[side] > 0.5:
            continue
        end = rig.limbs[2 + side, 2]
        if positions_ws[end, 1] > rig.ankle_heights[side] + STANDS:
            continue
        mul_inv(rotations_ws[end], st.feet[side], q)
        over = joint_excess(limits, rig.limbs[2 + side, 0], rotations_ls[rig.limbs[2 + side, 0]])
        over = max(over, joint_excess(limits, end, rotations_ls[end]))
        if angle(q) < OFF_LEVEL and over < OVER_RANGE:
            st.landed[side] = 1.0


@kernel
def remember_legs(rig: Rig, st: State, rotations_ls: Array) -> None:
    """Keep how the legs are that joint limits hold off their feet's places, to go on from there."""
    for side in range(2):
        if st.planted[side] > 0.5:
            st.sought[side] = 0.0
        st.legs_kept[side] = st.sought[side]
        st.sought[side] = 0.0
        for n in range(2):
            for k in range(4):
                st.legs[side, n, k] = rotations_ls[rig.limbs[2 + side, n], k]
