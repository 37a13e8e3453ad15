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
from bunraku.figure.jit import kernel, kernel_inline
from bunraku.figure.limits import Limits
from bunraku.figure.quat import angle, mul_inv, rotate
from bunraku.figure.rig import Rig
from bunraku.nodes.controller.placing import place_limb
from bunraku.nodes.controller.state import Gains, State, Under

Array = NDArray[np.float64]
Index = NDArray[np.int64]

NEAR = 0.031
"""m: what is farther apart is not measured."""
SOON = 1.0 / 15.0
"""s: two of the longest steps, so that a limb that is about to touch something does so at the contact's own rate."""
ARM, CARRIED = 0.6, 0.02
"""m from the back's joint to where the trunk's turn carries an arm, and m/s from which it is carried."""
STRIDE = 0.04
"""m: the longest way between two looks."""
MOST_STRIDES = 10
PUSHES = 6
"""Most pushes after one stride."""
RESCUES = 20
"""The same for a limb that the body has run into."""
TRIES = 3
"""Shares of the way that are tried, each half of the one before (eq. 27)."""
SLIDE, CREEP = 1.5, 0.15
"""How much faster than its goal a limb slides along something, and m/s at which it does where the goal rests."""
SLIDE_TURN, CREEP_TURN = 8.0, 0.7
"""rad/m and rad/s: the same for the turn of its elbow or knee."""
LEAST_PROGRESS, LEAST_FREE = 0.012, 0.002
"""m/s: a driven and a free one that come no nearer than this stay where they are."""
LEAST_LEVER, LEAST_BEND, MOST_PUSH = 0.1, 0.02, 0.05
"""Share of the upper bone below which a contact is taken for farther out; m that an elbow stands out before it is
turned; m that one push moves the end at most."""
WAIT = 0.5
"""s that a free limb rests on something before it slides on."""
TOUCH, LEAN = 1e-3, 4e-4
"""m between what a push has moved apart: farther, and what slides would bounce away from what it slides along; the
same for a free limb, which leans on what it touches."""
SHALLOW = 0.005
"""m: an overlap that is mended gently."""
GENTLER = 5
"""Times that a gentle push is halved until it turns nothing fast."""
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
def contact_point(center: Array, axes: Array, half: Array, way: Array, out: Array) -> None:
    """Where a box (its centre, axes and half extents) is touched from the side to which ``way`` (3, unit) points."""
    for k in range(3):
        out[k] = center[k]
    for n in range(3):
        along = axes[n, 0] * way[0] + axes[n, 1] * way[1] + axes[n, 2] * way[2]
        # The middle of a face that is touched flat, a corner where it is pointed at.
        share = half[n] * min(1.0, max(-1.0, 3.0 * along))
        for k in range(3):
            out[k] += share * axes[n, k]


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
    axis, v, point = np.empty(3), np.empty(3), np.empty(3)
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
                    contact_point(centers[other], axes[other], rig.box_sizes[other], axis, point)
                    along, length = 0.0, 0.0
                    for k in range(3):
                        v[k] = positions_ws[far, k] - positions_ws[bone, k]
                        along += v[k] * (point[k] - positions_ws[bone, k])
                        length += v[k] * v[k]
                    push[3] = n + min(1.0, max(0.0, along / max(length, 1e-9)))
    return least


@kernel
def push_limb(
    rig: Rig, st: State, limb: int, push: Array, depth: float, most_turn: float, positions_ws: Array,
    rotations_ws: Array,
) -> None:  # fmt: skip
    """Move a limb's end, and turn its elbow or knee, by the least that moves the contact ``depth`` (m) out.

    With the end at ``d u`` from the root and the hinge at ``a u + h p`` (``u``, ``p`` the axis and the pole), a
    small movement ``v`` of the end and ``t`` of the swivel moves the hinge by ``(a' u + h' p)(v·u) + (a/d) v_t -
    (h/d)(v·p) u + h t (u x p)``; the contact lies on the bone above or below it, and the push is the least-squares
    solution of that one equation along its way out.
    """
    upper, lower, end = rig.limbs[limb, 0], rig.limbs[limb, 1], rig.limbs[limb, 2]
    axis, pole, lead = np.empty(3), np.empty(3), np.empty(3)
    d = 0.0
    for k in range(3):
        axis[k] = positions_ws[end, k] - positions_ws[upper, k]
        d += axis[k] * axis[k]
    d = max(sqrt(d), 1e-6)
    a = 0.0
    for k in range(3):
        axis[k] /= d
        pole[k] = positions_ws[lower, k] - positions_ws[upper, k]
        a += pole[k] * axis[k]
    h = 0.0
    for k in range(3):
        pole[k] -= a * axis[k]
        h += pole[k] * pole[k]
    radius = sqrt(h)
    h = max(radius, LEAST_BEND)
    out_axis, out_pole = 0.0, 0.0
    for k in range(3):
        pole[k] /= max(radius, 1e-9)
        out_axis += push[k] * axis[k]
        out_pole += push[k] * pole[k]
    # How much of the hinge's and of the end's movement the contact makes.
    place = push[3]
    by_hinge = max(LEAST_LEVER, place) if place < 1.0 else 2.0 - place
    by_end = max(0.0, place - 1.0)
    grow = 1.0 - a / d
    radial = grow * out_axis - a * grow / h * out_pole
    total = 0.0
    for k in range(3):
        across = push[k] - out_axis * axis[k]
        lead[k] = by_hinge * (radial * axis[k] + a / d * across - h / d * out_axis * pole[k]) + by_end * push[k]
        total += lead[k] * lead[k]
    square = (axis[1] * pole[2] - axis[2] * pole[1]) * push[0]
    square += (axis[2] * pole[0] - axis[0] * pole[2]) * push[1]
    square += (axis[0] * pole[1] - axis[1] * pole[0]) * push[2]
    square = by_hinge * square if radius > LEAST_BEND else 0.0
    total += square * square
    if total < 1e-4:
        return
    size = 0.0
    for k in range(3):
        lead[k] *= depth / total
        size += lead[k] * lead[k]
    shorter = min(1.0, MOST_PUSH / max(sqrt(size), 1e-9))
    for k in range(3):
        st.points[limb + 1, k] += shorter * lead[k]
    if radius > LEAST_BEND:
        turn = depth * square / total / radius
        st.swivels[limb] += min(most_turn, max(-most_turn, turn))


@kernel
def distance(a: Array, b: Array) -> float:
    """Between two points (3), m."""
    return sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@kernel
def mark_limb(rig: Rig, limb: int, value: float, out: Array) -> None:
    """Set a value of ``out`` (J,) for all joints of a limb."""
    upper = rig.limbs[limb, 0]
    for joint in range(upper, rig.parents.shape[0]):
        if joint != upper and rig.parents[joint] < upper:
            break
        out[joint] = value


@kernel_inline
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
            mark_limb(rig, other, 1.0, out)


@kernel
def go(
    rig: Rig, gains: Gains, st: State, under: Under, contacts: Contacts, limb: int, start: Array, swivel: float,
    goal: Array, wanted: float, share: float, pushes: int, most_turn: float, deepest: float, apart: float,
    yielding: Array, limited: bool, rotations_ls: Array, positions_ws: Array, rotations_ws: Array, centers: Array,
    axes: Array, push: Array,
) -> float:  # fmt: skip
    """Take a limb a share of the way from its last place to its goal, pushed out of the body after every stride.

    Args:
        start, swivel: where it was (3, m; rad); ``goal``, ``wanted`` where it should be.
        pushes: most pushes after a stride, each of at most ``deepest`` m and ``most_turn`` rad, to a gap of
            ``apart`` m.

    Returns:
        The gap (m) that it ends with; the world arrays hold its pose.
    """
    row = limb + 1
    for k in range(3):
        st.points[row, k] = start[k]
    st.swivels[limb] = swivel
    way = share * distance(goal, start)
    strides = min(MOST_STRIDES, max(1, int(np.ceil(way / STRIDE))))
    turn = share * (wanted - swivel) / strides
    gap = 0.0
    for stride in range(strides):
        for k in range(3):
            st.points[row, k] += (goal[k] - st.points[row, k]) * share / (strides - stride * share)
        st.swivels[limb] += turn
        for n in range(pushes + 1):
            place_limb(rig, st, under, contacts.limits, limb, limited, rotations_ls, positions_ws, rotations_ws)
            gap = deepest_contact(rig, contacts, limb, yielding, positions_ws, rotations_ws, centers, axes, push)
            if gap >= 0.0 or n == pushes:
                break
            push_limb(
                rig, st, limb, push, min(deepest, apart - gap), most_turn, positions_ws, rotations_ws
            )  # fmt: skip
    return gap


@kernel_inline
def is_fixed(st: State, under: Under, flags: Array, untouched: bool, limb: int) -> bool:
    """Whether a limb stays as it is: planted legs, a motion's own legs, all of a motion that nobody touches."""
    own = under.active[0] > 0.5 and flags[1 + limb] < 0.5
    return (limb >= 2 and st.planted[limb - 2] > 0.5) or (own and (limb >= 2 or untouched))


@kernel_inline
def own_limits(st: State, under: Under, flags: Array, untouched: bool, out: Array) -> None:
    """Which limbs (4,) keep their joints' ranges: 1 or 0; what a motion does with its own is its maker's."""
    for limb in range(4):
        keeps = flags[1 + limb] > 0.5 or under.active[0] < 0.5
        out[limb] = 1.0 if keeps and not is_fixed(st, under, flags, untouched, limb) else 0.0


@kernel
def avoid(
    rig: Rig, gains: Gains, st: State, under: Under, contacts: Contacts, untouched: bool, flags: Array,
    limits_kept: Array, swivels_before: Array, plain: Array, moved: Array, rotations_ls: Array, positions_ws: Array,
    rotations_ws: Array, dt: float,
) -> None:  # fmt: skip
    """Move limbs out of the body and into their limits, in place.

    A limb that is in the way goes on only where that brings it nearer to its goal, so one that cannot come
    nearer rests.

    Args:
        untouched: nothing is held and everything is where its motion has it.
        flags: (5,) which points are driven.
        limits_kept: (4,) which limbs keep their ranges (`own_limits`); the world arrays hold them so already.
        swivels_before: (4,) rad, of the last step.
        plain: (4,) rad, the swivels without what earlier contacts added.
        moved: (4,) m, how far each limb's goal has moved: what touches something slides about as fast.
    """
    joints = rig.parents.shape[0]
    centers, axes, push = np.empty((joints, 3)), np.empty((joints, 3, 3)), np.empty(4)
    yielding = np.empty(joints)
    place_boxes_into(rig.box_centers, positions_ws, rotations_ws, centers, axes)
    goal, start, at_start = np.empty(3), np.empty(3), np.empty(3)
    turn_before, change = np.empty(4), np.empty(4)
    driven = flags.max() > 0.5
    body = 0.0
    for k in range(3):
        body += abs(st.drifts[0, k]) + ARM * abs(st.drifts[1, k])
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
        own = under.active[0] > 0.5 and flags[row] < 0.5
        if is_fixed(st, under, flags, untouched, limb):
            st.pushes[limb] *= 0.5 ** (dt / PUSH_HALF_LIFE)
            for k in range(3):
                st.wishes[limb, k] = st.points[row, k]
            continue
        if own:
            # Of a motion's own arms only what the touched limbs do to them counts.
            for joint in range(joints):
                yielding[joint] = 1.0
            for other in range(4):
                if flags[1 + other] > 0.5:
                    mark_limb(rig, other, 0.0, yielding)
        else:
            yields(rig, st, flags, limb, yielding)
        limited = limits_kept[limb] > 0.5
        st.stuck[limb] = max(0.0, st.stuck[limb] - dt) if flags[row] < 0.5 else 0.0
        root = positions_ws[rig.limbs[limb, 0]]
        for k in range(3):
            goal[k] = st.points[row, k]
            # The last place, taken along with the shoulder or hip.
            start[k] = st.wishes[limb, k] + root[k] - st.roots[limb, k]
        wanted = st.swivels[limb]
        gap = deepest_contact(rig, contacts, limb, yielding, positions_ws, rotations_ws, centers, axes, push)
        way = distance(goal, start)
        nearing = NEAR if flags[row] < 0.5 and body > CARRIED else SOON * (moved[limb] / max(dt, 1e-9) + body)
        if driven and gap < min(NEAR, nearing):
            st.mode[2] = 1.0
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
        apart = TOUCH if flags[row] > 0.5 else LEAN
        # From the last place, where it was free unless the body moved.
        gap = go(
            rig, gains, st, under, contacts, limb, start, swivels_before[limb], goal, wanted, 0.0, 0, 1.0, 1.0,
            apart, yielding, limited, rotations_ls, positions_ws, rotations_ws, centers, axes, push,
        )  # fmt: skip
        gap_before = gap
        upper = rig.limbs[limb, 0]
        turn_before[:] = rotations_ws[upper]
        far = distance(goal, positions_ws[rig.limbs[limb, 2]])
        for k in range(3):
            at_start[k] = positions_ws[rig.limbs[limb, 2], k]
        farthest = SLIDE * moved[limb] + CREEP * dt
        share = min(1.0, farthest / max(way, 1e-9))
        done = False
        # No deeper than it was where the body has moved into it, and never deep.
        least_gap = -1e-4 if gap_before >= -1e-4 else max(gap_before, -0.8 * SHALLOW)
        for _ in range(TRIES):
            gap = go(
                rig, gains, st, under, contacts, limb, start, swivels_before[limb], goal, wanted, share, PUSHES, 0.2,
                1.0, apart, yielding, limited, rotations_ls, positions_ws, rotations_ws, centers, axes, push,
            )  # fmt: skip
            nearer = far - distance(goal, positions_ws[rig.limbs[limb, 2]])
            mul_inv(rotations_ws[upper], turn_before, change)
            turned = max(abs(st.swivels[limb] - swivels_before[limb]), angle(change))
            slips = turned > SLIDE_TURN * moved[limb] + CREEP_TURN * dt
            slips = slips or distance(at_start, positions_ws[rig.limbs[limb, 2]]) > 2.0 * farthest
            # A free limb's goal is always just ahead: after a while it may also slide past what is in its way.
            least = LEAST_PROGRESS if flags[row] > 0.5 else LEAST_FREE
            rests = nearer < least * dt and (flags[row] > 0.5 or st.stuck[limb] < WAIT)
            done = gap >= least_gap and not rests and not slips
            if done:
                break
            share *= 0.5
        if not done:
            st.stuck[limb] = min(1.0, st.stuck[limb] + 2.0 * dt)
            # It stays (eq. 27 with t = 0); where the body has moved into it, it only gets out, gently if it can.
            pushes, most_turn, deepest = 0, 0.0, 0.0
            if gap_before < -1e-4:
                pushes, most_turn, deepest = RESCUES, 0.2, 1.0
                if gap_before > -SHALLOW:
                    pushes, most_turn, deepest = 1, CREEP_TURN * dt, CREEP * dt
            for n in range(GENTLER + 1):
                go(
                    rig, gains, st, under, contacts, limb, start, swivels_before[limb], goal, wanted, 0.0, pushes,
                    most_turn, deepest, apart, yielding, limited, rotations_ls, positions_ws, rotations_ws, centers,
                    axes, push,
                )  # fmt: skip
                mul_inv(rotations_ws[upper], turn_before, change)
                if pushes != 1 or angle(change) <= SLIDE_TURN * moved[limb] + CREEP_TURN * dt:
                    break
                # (Where joints are at their limits, a small push may turn them far.)
                deepest *= 0.5 if n < GENTLER - 1 else 0.0
        off = st.swivels[limb] - plain[limb]
        st.pushes[limb] = min(1.6, max(-1.6, off))
        st.extra[limb] = st.swivels[limb] - under.swivels[limb]
        st.extra_rates[limb] = 0.0
        for k in range(3):
            st.wishes[limb, k] = st.points[row, k]
            st.points[row, k] = positions_ws[rig.limbs[limb, 2], k]
            if flags[row] < 0.5:
                st.wishes[limb, k] = st.points[row, k]
