"""Self-collision avoidance: limbs keep out of the body (Oshita 2013 section 6.5, eqs 27-28).

A limb goes from its place of the last step, which was free, toward the new one in small strides (the search
of eq. 27 from its safe end) and is pushed out along the separating axis of the boxes after each (instead
of eq. 28, which pushes both arms the same way round), so it slides along the body on the side on which it
is. Part of a push on a forearm or shin turns the elbow or knee.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.boxes import box_axes, pair_gap, place_boxes_into
from bunraku.figure.jit import kernel
from bunraku.figure.limits import Limits, clamp_joint
from bunraku.figure.pointpose import keep_above_floor, reconstruct_limb
from bunraku.figure.quat import inv_mul, mul, rotate, slerp
from bunraku.figure.rig import Rig
from bunraku.nodes.controller.state import Gains, State, Under

Array = NDArray[np.float64]
Index = NDArray[np.int64]

NEAR = 0.031
"""m: what is farther apart is not measured."""
STRIDE = 0.04
"""m: the longest way between two looks."""
MOST_STRIDES = 10
PUSHES = 6
"""Most pushes after one stride."""
SLIDE, CREEP = 1.5, 0.15
"""How much faster than its goal a limb slides along something, and m/s at which it does where the goal rests."""
SLIDE_TURN, CREEP_TURN = 8.0, 0.7
"""rad/m and rad/s: the same for the turn of its elbow or knee."""
LEAST_PROGRESS = 0.012
"""m/s: one that comes no nearer than this stays where it is."""
WAIT = 0.5
"""s that a free limb rests on something before it slides on."""
SHALLOW = 0.005
"""m: an overlap that is mended gently."""
PUSH_HALF_LIFE = 0.25
"""s in which the turn of an elbow that avoided something goes back."""


class Contacts(NamedTuple):
    """What may touch what, and how far joints go."""

    parts: Index  # (4, 4) joints with a box of each limb, from upper on; -1 for none
    others: Index  # (4, 4, K) joints that each part must not overlap; -1 for none
    limits: Limits


def pack_contacts(contacts: Contacts) -> tuple[Index, Array]:
    """Contacts in two arrays; see `unpack_contacts`."""
    limits = contacts.limits
    ints = [np.array([contacts.others.shape[2]]), contacts.parts, contacts.others, limits.kinds]
    floats = [limits.centers, limits.axes, limits.ranges]
    return np.concatenate([a.ravel() for a in ints]), np.concatenate([a.ravel() for a in floats])


@kernel
def unpack_contacts(ints: Index, floats: Array, joints: int) -> Contacts:
    """What `pack_contacts` packed, as views."""
    widest = ints[0]
    i = 17 + 16 * widest
    limits = Limits(
        ints[i : i + joints],
        floats[0 : 4 * joints].reshape(joints, 4),
        floats[4 * joints : 13 * joints].reshape(joints, 3, 3),
        floats[13 * joints : 19 * joints].reshape(joints, 3, 2),
    )
    return Contacts(ints[1:17].reshape(4, 4), ints[17:i].reshape(4, 4, widest), limits)


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
    if limited:
        clamp_joint(limits, upper, rotations_ls[upper])
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
            keep_above_floor(rig, side, max(st.points[3 + side, 1], rig.ankle_heights[side]), turn)
            inv_mul(rotations_ws[lower], turn, rotations_ls[end])
        rotate(rotations_ws[parent], rig.offsets[joint], v)
        for k in range(3):
            positions_ws[joint, k] = positions_ws[parent, k] + v[k]
        mul(rotations_ws[parent], rotations_ls[joint], rotations_ws[joint])


@kernel
def deepest_contact(
    rig: Rig, contacts: Contacts, limb: int, yielding: Array, positions_ws: Array, rotations_ws: Array,
    centers: Array, axes: Array, push: Array,
) -> float:  # fmt: skip
    """The smallest gap (m, negative for an overlap) of a limb with the rest.

    ``yielding`` (J,) is 1 for joints that get out of this limb's way.
    ``push`` (4): the way out (3) and where on its bone: 0 upper bone's root .. 1 elbow .. 2 end and beyond.
    """
    least = 1e9
    axis, v = np.empty(3), np.empty(3)
    upper, lower = rig.limbs[limb, 0], rig.limbs[limb, 1]
    for n in range(4):
        part = contacts.parts[limb, n]
        if part < 0:
            continue
        rotate(rotations_ws[part], rig.box_centers[part], centers[part])
        for k in range(3):
            centers[part, k] += positions_ws[part, k]
        box_axes(rotations_ws[part], axes[part])
        for m in range(contacts.others.shape[2]):
            other = contacts.others[limb, n, m]
            if other < 0:
                break
            if yielding[other] > 0.5:
                continue
            gap = pair_gap(centers, axes, rig.box_sizes, part, other, axis, NEAR)
            if gap < least:
                least = gap
                for k in range(3):
                    push[k] = axis[k]
                if n >= 2:
                    push[3] = 2.0
                else:
                    bone = upper if n == 0 else lower
                    far = lower if n == 0 else rig.limbs[limb, 2]
                    along, length = 0.0, 0.0
                    for k in range(3):
                        v[k] = positions_ws[far, k] - positions_ws[bone, k]
                        along += v[k] * (centers[other, k] - positions_ws[bone, k])
                        length += v[k] * v[k]
                    push[3] = n + min(1.0, max(0.0, along / max(length, 1e-9)))
    return least


@kernel
def push_limb(
    rig: Rig,
    st: State,
    limb: int,
    push: Array,
    depth: float,
    most_turn: float,
    positions_ws: Array,
    rotations_ws: Array,
) -> None:
    """Move a limb's end, and turn its elbow or knee, so that the contact moves ``depth`` (m) out."""
    upper, lower, end = rig.limbs[limb, 0], rig.limbs[limb, 1], rig.limbs[limb, 2]
    row = limb + 1
    place = push[3]
    to_end = min(1.0, max(0.0, place - 1.0))
    to_hinge = 1.0 - to_end if place >= 1.0 else place
    # The elbow moves by its swivel alone, so only across the line from root to end.
    axis, pole, square = np.empty(3), np.empty(3), np.empty(3)
    n = 0.0
    for k in range(3):
        axis[k] = positions_ws[end, k] - positions_ws[upper, k]
        n += axis[k] * axis[k]
    n = max(sqrt(n), 1e-6)
    along = 0.0
    for k in range(3):
        axis[k] /= n
        pole[k] = positions_ws[lower, k] - positions_ws[upper, k]
        along += pole[k] * axis[k]
    radius = 0.0
    for k in range(3):
        pole[k] -= along * axis[k]
        radius += pole[k] * pole[k]
    radius = sqrt(radius)
    square[0] = axis[1] * pole[2] - axis[2] * pole[1]
    square[1] = axis[2] * pole[0] - axis[0] * pole[2]
    square[2] = axis[0] * pole[1] - axis[1] * pole[0]
    across = 0.0
    if radius > 0.02:
        across = (square[0] * push[0] + square[1] * push[1] + square[2] * push[2]) / radius
    # Shares by lever: hinge moves `to_hinge * across`, end moves `to_end` (or as a lever beyond the hinge).
    by_end = 0.5 * place * along / n if place < 1.0 else to_end + (1.0 - to_end) * along / n
    by_hinge = to_hinge * across
    total = by_end * by_end + by_hinge * by_hinge
    if total < 0.01:
        return
    move = depth * by_end / total
    for k in range(3):
        st.points[row, k] += move * push[k]
    if radius > 0.02:
        turn = depth * by_hinge / total / radius
        turn = min(most_turn, max(-most_turn, turn))
        st.swivels[limb] += turn


@kernel
def distance(a: Array, b: Array) -> float:
    """Between two points (3), m."""
    return sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@kernel
def yields(rig: Rig, st: State, flags: Array, limb: int, out: Array) -> None:
    """Which joints (J,) get out of a limb's way: free limbs yield to driven ones, arms to legs."""
    for joint in range(out.shape[0]):
        out[joint] = 0.0
    mine = 3.0 if flags[1 + limb] > 0.5 else (2.0 if limb >= 2 else 1.0)
    for other in range(4):
        rank = 3.0 if flags[1 + other] > 0.5 else (2.0 if other >= 2 else 1.0)
        if other >= 2 and st.planted[other - 2] > 0.5:
            rank = 4.0
        if rank < mine:
            upper = rig.limbs[other, 0]
            for joint in range(upper, rig.parents.shape[0]):
                if joint != upper and rig.parents[joint] < upper:
                    break
                out[joint] = 1.0


@kernel
def avoid(
    rig: Rig, gains: Gains, st: State, under: Under, contacts: Contacts, untouched: bool, flags: Array,
    swivels_before: Array, plain: Array, moved: Array, rotations_ls: Array, positions_ws: Array,
    rotations_ws: Array, dt: float,
) -> None:  # fmt: skip
    """Move limbs out of the body and into their limits, in place.

    A limb that is in the way goes on only where that brings it nearer to its goal, so one that cannot come
    nearer rests.

    Args:
        untouched: nothing is held and everything is where its motion has it.
        flags: (5,) which points are driven.
        swivels_before: (4,) rad, of the last step.
        plain: (4,) rad, the swivels without what earlier contacts added.
        moved: (4,) m, how far each limb's goal has moved: what touches something slides about as fast.
    """
    joints = rig.parents.shape[0]
    centers, axes, push = np.empty((joints, 3)), np.empty((joints, 3, 3)), np.empty(4)
    yielding = np.empty(joints)
    place_boxes_into(rig.box_centers, positions_ws, rotations_ws, centers, axes)
    goal, start, at_start = np.empty(3), np.empty(3), np.empty(3)
    limits = contacts.limits
    st.mode[2] = 0.0
    order = np.array([0, 1, 2, 3])
    count = 0
    for rank in range(3):
        for limb in range(4):
            own = 0 if flags[1 + limb] > 0.5 else (1 if limb >= 2 else 2)
            if own == rank:
                order[count] = limb
                count += 1
    for turn in range(4):
        limb = order[turn]
        row = limb + 1
        fixed = limb >= 2 and st.planted[limb - 2] > 0.5
        # A motion's own legs, and all of a motion that nobody touches, are as its maker wanted them.
        own = under.active[0] > 0.5 and flags[row] < 0.5
        fixed = fixed or (own and (limb >= 2 or untouched))
        if fixed:
            st.pushes[limb] *= 0.5 ** (dt / PUSH_HALF_LIFE)
            for k in range(3):
                st.wishes[limb, k] = st.points[row, k]
            continue
        limited = flags[row] > 0.5 or under.active[0] < 0.5
        st.stuck[limb] = max(0.0, st.stuck[limb] - dt) if flags[row] < 0.5 else 0.0
        root = positions_ws[rig.limbs[limb, 0]]
        for k in range(3):
            goal[k] = st.points[row, k]
            # The last place, taken along with the shoulder or hip.
            start[k] = st.wishes[limb, k] + root[k] - st.roots[limb, k]
        wanted = st.swivels[limb]
        yields(rig, st, flags, limb, yielding)
        place_limb(rig, st, under, limits, limb, limited, rotations_ls, positions_ws, rotations_ws)
        gap = deepest_contact(rig, contacts, limb, yielding, positions_ws, rotations_ws, centers, axes, push)
        way = distance(goal, start)
        if gains.w_collision <= 0.0 or (gap >= gains.clearance and way <= 2.0 * STRIDE):
            if gap > 0.008:
                st.pushes[limb] *= 0.5 ** (dt / PUSH_HALF_LIFE)
            for k in range(3):
                st.wishes[limb, k] = goal[k]
                if limited:
                    st.points[row, k] = positions_ws[rig.limbs[limb, 2], k]
                if flags[row] < 0.5:
                    st.wishes[limb, k] = st.points[row, k]
            continue
        st.mode[2] = 1.0
        # From the last place, where it was free unless the body moved.
        for k in range(3):
            st.points[row, k] = start[k]
        st.swivels[limb] = swivels_before[limb]
        place_limb(rig, st, under, limits, limb, limited, rotations_ls, positions_ws, rotations_ws)
        gap = deepest_contact(rig, contacts, limb, yielding, positions_ws, rotations_ws, centers, axes, push)
        was_free = gap >= -1e-4
        far = distance(goal, positions_ws[rig.limbs[limb, 2]])
        for k in range(3):
            at_start[k] = positions_ws[rig.limbs[limb, 2], k]
        farthest = SLIDE * moved[limb] + CREEP * dt
        share = min(1.0, farthest / max(way, 1e-9))
        strides = min(MOST_STRIDES, max(1, int(np.ceil(way * share / STRIDE))))
        pushes, most_turn, deepest = PUSHES, 0.2, 1.0
        if not was_free:
            # The body moved into it: only out, not on; and gently while it is hardly in.
            share, strides = 0.0, 1
            if gap > -SHALLOW:
                pushes, most_turn, deepest = 1, CREEP_TURN * dt, CREEP * dt
        turn_left = share * (wanted - swivels_before[limb])
        for stride in range(strides):
            for k in range(3):
                st.points[row, k] += (goal[k] - st.points[row, k]) * share / (strides - stride * share)
            st.swivels[limb] += turn_left / strides
            for _ in range(pushes):
                place_limb(rig, st, under, limits, limb, limited, rotations_ls, positions_ws, rotations_ws)
                gap = deepest_contact(rig, contacts, limb, yielding, positions_ws, rotations_ws, centers, axes, push)
                if gap >= 0.0:
                    break
                push_limb(
                    rig, st, limb, push, min(deepest, gains.clearance - gap), most_turn, positions_ws, rotations_ws
                )  # fmt: skip
        place_limb(rig, st, under, limits, limb, limited, rotations_ls, positions_ws, rotations_ws)
        gap = deepest_contact(rig, contacts, limb, yielding, positions_ws, rotations_ws, centers, axes, push)
        nearer = far - distance(goal, positions_ws[rig.limbs[limb, 2]])
        turned = abs(st.swivels[limb] - swivels_before[limb])
        slips = turned > SLIDE_TURN * moved[limb] + CREEP_TURN * dt
        slips = slips or distance(at_start, positions_ws[rig.limbs[limb, 2]]) > 2.0 * farthest
        # A free limb's goal is always just ahead: after a while it may also slide past what is in its way.
        rests = nearer < LEAST_PROGRESS * dt and (flags[row] > 0.5 or st.stuck[limb] < WAIT)
        if was_free and (gap < -1e-4 or rests or slips):
            st.stuck[limb] = min(1.0, st.stuck[limb] + 2.0 * dt)
            # Back to the last free place (eq. 27 with t = 0).
            for k in range(3):
                st.points[row, k] = start[k]
            st.swivels[limb] = swivels_before[limb]
            place_limb(rig, st, under, limits, limb, limited, rotations_ls, positions_ws, rotations_ws)
            deepest_contact(rig, contacts, limb, yielding, positions_ws, rotations_ws, centers, axes, push)
        off = st.swivels[limb] - plain[limb]
        st.pushes[limb] = min(1.6, max(-1.6, off))
        st.extra[limb] = st.swivels[limb] - under.swivels[limb]
        st.extra_rates[limb] = 0.0
        for k in range(3):
            st.wishes[limb, k] = st.points[row, k]
            st.points[row, k] = positions_ws[rig.limbs[limb, 2], k]
            if flags[row] < 0.5:
                st.wishes[limb, k] = st.points[row, k]
