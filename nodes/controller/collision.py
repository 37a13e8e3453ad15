"""Self-collision avoidance: limbs keep out of the body (Oshita 2013 section 6.5, eqs 27-28).

A limb goes from its place of the last step, which was free, toward the new one in small strides (the search
of eq. 27 from its safe end) and is pushed out along the separating axis of the boxes after each (instead
of eq. 28, which pushes both arms the same way round), so it slides along the body on the side on which it
is. Part of a push on a forearm or shin turns the elbow or knee.
"""

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.boxes import place_boxes_into
from bunraku.figure.jit import kernel, kernel_inline
from bunraku.figure.quat import angle, mul_inv
from bunraku.figure.rig import Rig
from bunraku.nodes.controller.contacts import NEAR, Contacts, deepest_contact, push_limb, yields
from bunraku.nodes.controller.pacing import pace_leg
from bunraku.nodes.controller.placing import place_limb
from bunraku.nodes.controller.state import Gains, State, Under

Array = NDArray[np.float64]

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
WAIT = 0.5
"""s that a free limb rests on something before it slides on."""
TOUCH, LEAN = 1e-3, 4e-4
"""m between what a push has moved apart: farther, and what slides would bounce away from what it slides along; the
same for a free limb, which leans on what it touches."""
SHALLOW = 0.005
"""m: an overlap that is mended gently."""
GENTLER = 5
"""Times that a gentle push is halved until it turns nothing fast."""
PUSH_HALF_LIFE, PUSH_SPEED, PUSH_TURN = 0.25, 0.5, 2.0
"""s in which the turn of an elbow or knee that avoided something goes back; rad/s, and rad/m of its end's way, at
most."""
BETTER = 0.25
"""Share of a gentle push by which it must lessen the deepest overlap."""


@kernel
def turn_back(push: float, most: float, dt: float) -> float:
    """What is left of the turn (rad) of an elbow or knee that avoided something: it goes back by ``most`` at most."""
    back = push * (1.0 - 0.5 ** (dt / PUSH_HALF_LIFE))
    return float(push - min(most, max(-most, back)))


@kernel
def distance(a: Array, b: Array) -> float:
    """Between two points (3), m."""
    return sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


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
def is_fixed(st: State, under: Under, flags: Array, limb: int) -> bool:
    """Whether a limb stays as it is: planted legs, and a motion's own limbs (for its arms see `dodge`)."""
    own = under.active[0] > 0.5 and flags[1 + limb] < 0.5
    return bool((limb >= 2 and st.planted[limb - 2] > 0.5) or own)


@kernel_inline
def own_limits(st: State, under: Under, flags: Array, out: Array) -> None:
    """Which limbs (4,) keep their joints' ranges: 1 or 0; what a motion does with its own is its maker's."""
    for limb in range(4):
        keeps = flags[1 + limb] > 0.5 or under.active[0] < 0.5
        out[limb] = 1.0 if keeps and not is_fixed(st, under, flags, limb) else 0.0


@kernel
def avoid_with(
    rig: Rig, gains: Gains, st: State, under: Under, contacts: Contacts, limb: int, flags: Array, limited: bool,
    yielding: Array, body: float, swivel_before: float, plain: float, moved: float, rotations_ls: Array,
    positions_ws: Array, rotations_ws: Array, centers: Array, axes: Array, dt: float,
) -> float:  # fmt: skip
    """Move one limb out of the body and into its limits, in place; see `avoid`.

    Args:
        yielding: (J,) 1 for joints that get out of this limb's way.
        body: m/s at which trunk and pelvis move about.

    Returns:
        The gap (m) that it ends with.
    """
    row = limb + 1
    goal, start, at_start, push = np.empty(3), np.empty(3), np.empty(3), np.empty(4)
    turn_before, change = np.empty(4), np.empty(4)
    st.stuck[limb] = max(0.0, st.stuck[limb] - dt) if flags[row] < 0.5 else 0.0
    root = positions_ws[rig.limbs[limb, 0]]
    for k in range(3):
        goal[k] = st.points[row, k]
        # The last place, taken along with the shoulder or hip.
        start[k] = st.wishes[limb, k] + root[k] - st.roots[limb, k]
    wanted = st.swivels[limb]
    gap = deepest_contact(rig, contacts, limb, yielding, positions_ws, rotations_ws, centers, axes, push)
    way = distance(goal, start)
    nearing = NEAR if flags[row] < 0.5 and body > CARRIED else SOON * (moved / max(dt, 1e-9) + body)
    if flags.max() > 0.5 and gap < min(NEAR, nearing):
        st.mode[2] = 1.0
    if gains.w_collision <= 0.0 or (gap >= gains.clearance and way <= 2.0 * STRIDE):
        if gap > 0.008:
            most = PUSH_SPEED * dt + PUSH_TURN * moved if under.active[0] < 0.5 else 1.0
            st.pushes[limb] = turn_back(st.pushes[limb], most, dt)
        for k in range(3):
            st.wishes[limb, k] = goal[k]
            if limited:
                st.points[row, k] = positions_ws[rig.limbs[limb, 2], k]
            if flags[row] < 0.5:
                st.wishes[limb, k] = st.points[row, k]
        return float(gap) if gains.w_collision > 0.0 else NEAR
    st.mode[2] = 1.0
    apart = TOUCH if flags[row] > 0.5 else LEAN
    # From the last place, where it was free unless the body moved.
    gap = go(
        rig, gains, st, under, contacts, limb, start, swivel_before, goal, wanted, 0.0, 0, 1.0, 1.0,
        apart, yielding, limited, rotations_ls, positions_ws, rotations_ws, centers, axes, push,
    )  # fmt: skip
    gap_before = gap
    upper = rig.limbs[limb, 0]
    turn_before[:] = rotations_ws[upper]
    far = distance(goal, positions_ws[rig.limbs[limb, 2]])
    for k in range(3):
        at_start[k] = positions_ws[rig.limbs[limb, 2], k]
    farthest = SLIDE * moved + CREEP * dt
    share = min(1.0, farthest / max(way, 1e-9))
    done = False
    # No deeper than it was where the body has moved into it, and never deep.
    least_gap = -1e-4 if gap_before >= -1e-4 else max(gap_before, -0.8 * SHALLOW)
    for _ in range(TRIES):
        gap = go(
            rig, gains, st, under, contacts, limb, start, swivel_before, goal, wanted, share, PUSHES, 0.2,
            1.0, apart, yielding, limited, rotations_ls, positions_ws, rotations_ws, centers, axes, push,
        )  # fmt: skip
        nearer = far - distance(goal, positions_ws[rig.limbs[limb, 2]])
        mul_inv(rotations_ws[upper], turn_before, change)
        turned = max(abs(st.swivels[limb] - swivel_before), angle(change))
        slips = turned > SLIDE_TURN * moved + CREEP_TURN * dt
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
            gap = go(
                rig, gains, st, under, contacts, limb, start, swivel_before, goal, wanted, 0.0, pushes,
                most_turn, deepest, apart, yielding, limited, rotations_ls, positions_ws, rotations_ws, centers,
                axes, push,
            )  # fmt: skip
            mul_inv(rotations_ws[upper], turn_before, change)
            helps = gap - gap_before >= BETTER * min(deepest, apart - gap_before)
            if pushes != 1 or (helps and angle(change) <= SLIDE_TURN * moved + CREEP_TURN * dt):
                break
            # (Where joints are at their limits, a small push may turn them far; between two things it may push into
            # the other one.)
            deepest *= 0.5 if n < GENTLER - 1 else 0.0
    off = st.swivels[limb] - plain
    st.pushes[limb] = min(1.6, max(-1.6, off))
    st.extra[limb] = st.swivels[limb] - under.swivels[limb]
    st.extra_rates[limb] = 0.0
    for k in range(3):
        st.wishes[limb, k] = st.points[row, k]
        st.points[row, k] = positions_ws[rig.limbs[limb, 2], k]
        if flags[row] < 0.5:
            st.wishes[limb, k] = st.points[row, k]
    return float(gap)


@kernel
def avoid(
    rig: Rig, gains: Gains, st: State, under: Under, contacts: Contacts, flags: Array,
    limits_kept: Array, swivels_before: Array, plain: Array, moved: Array, legs_before: Array, rotations_ls: Array,
    positions_ws: Array, rotations_ws: Array, dt: float,
) -> None:  # fmt: skip
    """Move limbs out of the body and into their limits, in place; legs in the air at their own pace.

    A limb that is in the way goes on only where that brings it nearer to its goal, so one that cannot come
    nearer rests. Driven limbs come first, then legs, then arms: each gets out of the way of those before it.

    Args:
        flags: (5,) which points are driven.
        limits_kept: (4,) which limbs keep their ranges (`own_limits`); the world arrays hold them so already.
        swivels_before: (4,) rad, of the last step.
        plain: (4,) rad, the swivels without what earlier contacts added.
        moved: (4,) m, how far each limb's goal has moved: what touches something slides about as fast.
        legs_before: (2, 3, 4) hips, knees and ankles at the last step (`legs_into`).
    """
    joints = rig.parents.shape[0]
    centers, axes, yielding = np.empty((joints, 3)), np.empty((joints, 3, 3)), np.empty(joints)
    place_boxes_into(rig.box_centers, positions_ws, rotations_ws, centers, axes)
    body = 0.0
    for k in range(3):
        body += abs(st.drifts[0, k]) + ARM * abs(st.drifts[1, k])
    for rank in range(3):
        for limb in range(4):
            row = limb + 1
            if rank != (0 if flags[row] > 0.5 else (1 if limb >= 2 else 2)):
                continue
            if is_fixed(st, under, flags, limb):
                # (Over a motion what it adds goes as fast as the rest of what a touch has left.)
                most = PUSH_SPEED * dt if under.active[0] < 0.5 else 1.0
                st.pushes[limb] = turn_back(st.pushes[limb], most, dt)
                for k in range(3):
                    st.wishes[limb, k] = st.points[row, k]
                continue
            yields(rig, st, flags, limb, yielding)
            gap = avoid_with(
                rig, gains, st, under, contacts, limb, flags, limits_kept[limb] > 0.5, yielding, body,
                swivels_before[limb], plain[limb], moved[limb], rotations_ls, positions_ws, rotations_ws, centers,
                axes, dt,
            )  # fmt: skip
            if limb >= 2 and under.active[0] < 0.5:
                pace_leg(
                    rig, st, under, contacts, limb - 2, flags[row] > 0.5, gap, legs_before[limb - 2],
                    yielding, rotations_ls, positions_ws, rotations_ws, centers, axes, dt,
                )  # fmt: skip
