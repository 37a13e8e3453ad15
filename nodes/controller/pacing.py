"""Legs in the air: how fast their joints turn at most, and when a free foot has landed."""

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel
from bunraku.figure.limits import Limits, joint_excess
from bunraku.figure.pointpose import keep_above_floor, sole_bottom
from bunraku.figure.quat import angle, exp, inv_mul, mul, mul_inv, slerp
from bunraku.figure.rig import Rig
from bunraku.nodes.controller.contacts import Contacts, contact_place, deepest_contact, turn_to_leave
from bunraku.nodes.controller.placing import carry_from, keep_in_range
from bunraku.nodes.controller.state import State, Under
from bunraku.nodes.controller.step import IDLE, PHASE

Array = NDArray[np.float64]

LEG_SPEED, LEG_RUSH = 16.0, 100.0
"""rad/s: the fastest that hip, knee and ankle of a foot in the air turn. Where joint limits hold a foot off its place
there may be two ways to be near it; the leg goes from one to the other in some frames, not in one.
rad/s² by which those of a free one, or one that has still to get to its target, get faster: a straight knee would
bend at once for little way of its foot."""
FOLLOWS = 0.02
"""m of offset up to which a held foot follows its target."""
RETURN, RETURN_WAY = 0.8, 6.0
"""rad/s, and rad/m of its foot's way, at which a leg that limits have turned aside goes back to its swivel."""
OVERLAP, STAY = 2e-3, 4e-3
"""m that a leg on its way from one to the other, and one that stays where it was, may overlap the rest."""
PUSHES, PUSHED = 4, 0.5
"""Most times that such a leg is turned out of what it runs into, and share of `LEG_SPEED` by which it is at most."""
STANDS = 4e-3
"""m above its standing height up to which a foot that comes down has landed."""
RESTS, HOVERS, SINKS = 5e-4, 0.04, 0.01
"""m above its standing height, from and to, where a free foot that sinks slower than so many m/s is held off the
ground."""
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
def turn_out(rig: Rig, side: int, push: Array, depth: float, most: float, positions_ws: Array, turn: Array) -> float:
    """The turn (4) about a hip that moves a contact of its leg ``depth`` (m) out, by at most ``most`` (rad); its angle.

    ``push`` (4) is the way out (3) and where on the leg it lies, see `deepest_contact`.
    """
    lever, vector, size = np.empty(3), np.empty(3), 0.0
    contact_place(rig, 2 + side, push[3], positions_ws, lever)
    for k in range(3):
        lever[k] -= positions_ws[rig.limbs[2 + side, 0], k]
    turn_to_leave(lever, push[:3], depth, vector)
    for k in range(3):
        size += vector[k] * vector[k]
    size = sqrt(size)
    share = min(1.0, most / max(size, 1e-9))
    for k in range(3):
        vector[k] *= share
    exp(vector, turn)
    return float(share * size)


@kernel
def above_floor(rig: Rig, under: Under, side: int, positions_ws: Array, rotations_ws: Array) -> float:
    """How far (m) a sole is above the floor; negative below it."""
    end = rig.limbs[2 + side, 2]
    return float(positions_ws[end, 1] + sole_bottom(rig, side, rotations_ws[end]) - under.base.floors[side])


@kernel
def pose_leg_between(
    rig: Rig, under: Under, contacts: Contacts, side: int, before: Array, wanted: Array, share: float,
    deepest: float, most: float, yielding: Array, centers: Array, axes: Array, rotations_ls: Array,
    positions_ws: Array, rotations_ws: Array,
) -> float:  # fmt: skip
    """Pose a leg a share of the way from one to another, and turn it out of what it runs into there, or the floor.

    Args:
        before, wanted: (3, 4) local rotations of hip, knee and ankle.
        deepest: m that it may overlap the rest without being turned; ``most`` rad by which it is turned at most.

    Returns:
        The gap (m) that it ends with.
    """
    upper, end = rig.limbs[2 + side, 0], rig.limbs[2 + side, 2]
    push, turn, parent = np.empty(4), np.empty(4), rotations_ws[rig.parents[upper]]
    for n in range(3):
        joint = rig.limbs[2 + side, n]
        slerp(before[n], wanted[n], share, rotations_ls[joint])
        keep_in_range(contacts.limits, joint, rotations_ls[joint])
    gap, turned = 0.0, 0.0
    for n in range(PUSHES + 1):
        carry_from(rig, upper, rotations_ls, positions_ws, rotations_ws)
        keep_above_floor(rig, side, positions_ws[end, 1] - under.base.floors[side], rotations_ws[end])
        inv_mul(rotations_ws[rig.parents[end]], rotations_ws[end], rotations_ls[end])
        keep_in_range(contacts.limits, end, rotations_ls[end])
        carry_from(rig, end, rotations_ls, positions_ws, rotations_ws)
        gap = deepest_contact(rig, contacts, 2 + side, yielding, positions_ws, rotations_ws, centers, axes, push)
        above = above_floor(rig, under, side, positions_ws, rotations_ws)
        if above < min(gap, 0.0):
            gap, push[0], push[1], push[2], push[3] = above, 0.0, 1.0, 0.0, 2.0
        if gap > -deepest or n == PUSHES or turned >= most:
            break
        turned += turn_out(rig, side, push, -gap, most - turned, positions_ws, turn)
        mul(turn, rotations_ws[upper], turn)
        inv_mul(parent, turn, rotations_ls[upper])
        keep_in_range(contacts.limits, upper, rotations_ls[upper])
    return gap


@kernel
def pace_leg(
    rig: Rig, st: State, under: Under, contacts: Contacts, side: int, held: bool, gap: float, before: Array,
    yielding: Array, rotations_ls: Array, positions_ws: Array, rotations_ws: Array, centers: Array, axes: Array,
    dt: float,
) -> None:  # fmt: skip
    """Let no joint of a leg in the air turn faster than `LEG_SPEED`; the leg follows late instead.

    One that was let go or grabbed away from its target takes up its speed by `LEG_RUSH`.

    Args:
        gap: m to what is nearest to it; negative where it overlaps that.
        before: (3, 4) hip, knee and ankle at the last step (`legs_into`).
        yielding: (J,) 1 for joints that get out of its way.
        centers, axes: (J, 3) and (J, 3, 3) of all boxes.
    """
    q, most, fastest = np.empty(4), LEG_SPEED * dt, 0.0
    offset = 0.0
    for k in range(3):
        offset += st.offsets[3 + side, k] ** 2
    if st.step[PHASE] == IDLE and (not held or offset > FOLLOWS * FOLLOWS):
        most = min(most, (st.leg_rates[side] + LEG_RUSH * dt) * dt)
    wanted = np.empty((3, 4))
    for n in range(3):
        wanted[n] = rotations_ls[rig.limbs[2 + side, n]]
        mul_inv(wanted[n], before[n], q)
        fastest = max(fastest, angle(q))
    st.leg_rates[side] = min(fastest, most) / max(dt, 1e-9)
    if fastest <= most and min(gap, above_floor(rig, under, side, positions_ws, rotations_ws)) > -OVERLAP:
        return
    share = min(1.0, most / max(fastest, 1e-9))
    for way in range(3):
        gap = pose_leg_between(
            rig, under, contacts, side, before, wanted, share, OVERLAP, PUSHED * LEG_SPEED * dt if way < 2 else 0.0,
            yielding, centers, axes, rotations_ls, positions_ws, rotations_ws,
        )  # fmt: skip
        if gap > -(OVERLAP if way == 0 else STAY):
            break
        # Where it cannot go straight over a held foot stays; where that is no place either, it is put over.
        share = 0.0 if way == 0 and held else 1.0
    # From here on, the way that it is nearest to.
    st.sought[side] = 1.0
    if st.step[PHASE] == IDLE:
        end = rig.limbs[2 + side, 2]
        for k in range(3):
            st.points[3 + side, k] = positions_ws[end, k]
            if not held:
                st.wishes[2 + side, k] = positions_ws[end, k]


@kernel
def see_landings(
    rig: Rig, st: State, limits: Limits, before: Array, positions_ws: Array, rotations_ls: Array, rotations_ws: Array,
    dt: float,
) -> None:  # fmt: skip
    """Which free feet are where they can stand: on the ground, level, with their legs within their ranges.

    And which are not, but come no nearer to the ground; ``before`` (5, 3) m are the points of the last step.
    """
    q = np.empty(4)
    for side in range(2):
        st.landed[side] = 0.0
        end = rig.limbs[2 + side, 2]
        height = positions_ws[end, 1] - rig.ankle_heights[side]
        sinks = before[3 + side, 1] - positions_ws[end, 1] >= SINKS * dt
        if st.planted[side] < 0.5 and st.held[3 + side] < 0.5 and RESTS < height < HOVERS and not sinks:
            st.landed[side] = -1.0
            continue
        if st.planted[side] > 0.5 or st.sought[side] > 0.5 or height > STANDS:
            continue
        mul_inv(rotations_ws[end], st.feet[side], q)
        off_level = angle(q)
        over = joint_excess(limits, rig.limbs[2 + side, 0], rotations_ls[rig.limbs[2 + side, 0]])
        # (As it will stand, not as it hangs.)
        inv_mul(rotations_ws[rig.parents[end]], st.feet[side], q)
        over = max(over, joint_excess(limits, end, q))
        if off_level < OFF_LEVEL and over < OVER_RANGE:
            st.landed[side] = 1.0


@kernel
def remember_legs(rig: Rig, st: State, rotations_ls: Array) -> None:
    """Keep how the legs are that joint limits hold off their feet's places, to go on from there."""
    for side in range(2):
        if st.planted[side] > 0.5:
            st.sought[side], st.leg_rates[side] = 0.0, 0.0
        st.legs_kept[side] = st.sought[side]
        st.sought[side] = 0.0
        for n in range(2):
            for k in range(4):
                st.legs[side, n, k] = rotations_ls[rig.limbs[2 + side, n], k]
