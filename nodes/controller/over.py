"""Over a motion: free parts are where the motion has them, plus what a touch has left, which evens out.

The motion's own movement is never smoothed; only the way from it to the figure is, as a critically damped spring.
What a touch asks for may change at once (a foot comes down, an arm goes the other way round): trunk and pelvis
take it up at a pace (`keep_pace`), limbs as a fading difference (`even_limbs`; inertial blending, Bollo 2018). An arm
that is let go joins the motion by such a difference alone: its hand's way would lead through the shoulder.
"""

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel
from bunraku.figure.quat import angle, between, exp, inv_mul, inv_rotate, log, mul, mul_inv, rotate, slerp
from bunraku.figure.rig import Rig
from bunraku.figure.spring import spring_decay_into
from bunraku.nodes.controller.placing import carry_from
from bunraku.nodes.controller.state import Gains, Held, State, Under

Array = NDArray[np.float64]

PELVIS_PER_WAY, PELVIS_PACE = 1.2, 0.4
"""How far the pelvis leaves its motion for every metre of what is held, and m/s on top."""
TRUNK_PER_WAY, TRUNK_PACE = 3.0, 1.0
"""rad/m and rad/s: the same for the trunk's turn."""
LIMB_PER_WAY, LIMB_PACE = 1.5, 1.2
"""How far an elbow, a knee or an end leaves its motion for every metre of its goal, and m/s on top."""
HINGE_PACE = 2.5
"""m/s: the most that the end under a held elbow or knee counts for."""
MOST_LEAD = 8.0
"""rad/s: the most that a joint of an arm that is let go goes on with."""
LEAST_SPAN = 1.0 / 120.0
"""s: the shortest step over which speeds are measured."""
BY_BALANCE = 0.15
"""Share of its way by which pelvis or trunk follow what does not pull them."""
MOST_DRIFT, MOST_SPIN = 1.0, 1.5
"""m/s and rad/s: how much of their own movement pelvis and trunk go on with beside that."""
TRUNK_LEVER = 0.5
"""m from the pelvis to the shoulders."""
TOES = 0.15
"""m: how far a foot reaches from its ankle."""
AT_MOTION = 0.03
"""m from its motion's place within which a free foot is kept out of what fades in its leg."""
SKIN = 0.1
"""m from a bone to where its turn about itself is seen."""


@kernel
def way_from_motion(st: State, goals: Array, goal_turns: Array, ways: Array, turns: Array) -> None:
    """From the motion's parts to the figure's: ``ways`` (5, 3) m, hands against their shoulders, ``turns`` (2, 3)."""
    q = np.empty(4)
    for n in range(5):
        for k in range(3):
            ways[n, k] = st.points[n, k] - goals[n, k]
            if n == 1 or n == 2:
                ways[n, k] -= st.roots[n - 1, k]
    for n in range(2):
        mul_inv(st.turns[n], goal_turns[n], q)
        log(q, turns[n])


@kernel
def ease_point(way: Array, velocity: Array, goal: Array, half_life: float, dt: float, out: Array) -> None:
    """Where a free part (3, m) is: at the motion's place with what is left of the way (3) from it."""
    spring_decay_into(way, velocity, half_life, dt)
    for k in range(3):
        out[k] = goal[k] + way[k]


@kernel
def ease_turn(way: Array, spin: Array, goal: Array, half_life: float, dt: float, out: Array) -> None:
    """`ease_point` for an orientation (4); the way (3) is a rotation vector."""
    q = np.empty(4)
    spring_decay_into(way, spin, half_life, dt)
    exp(way, q)
    mul(q, goal, out)


@kernel
def remember_ways(
    st: State, held: Held, flags: Array, before: Array, turned: Array, goals: Array, goal_turns: Array, paces: Array,
    span: float,
) -> None:  # fmt: skip
    """Keep how fast held parts and feet move against the motion, so that one that is let go goes on as it moved.

    ``before`` (5, 3) and ``turned`` (2, 3) are the ways of the last step (`way_from_motion`), ``paces`` (4,) m/s how
    fast limbs may have gone (`even_limbs`): what jumped does not go on. A pelvis or trunk that a held limb pulls along
    keeps no speed of that, or it would swing past where it is pulled to, and back.
    """
    ways, turns = np.empty((5, 3)), np.empty((2, 3))
    way_from_motion(st, goals, goal_turns, ways, turns)
    for n in range(5):
        if n == 0 and flags[0] < 0.5:
            continue
        for k in range(3):
            st.velocities[n, k] = (ways[n, k] - before[n, k]) / span
        if n > 0:
            slower = min(1.0, paces[n - 1] / max(size_of(st.velocities[n]), 1e-9))
            for k in range(3):
                st.velocities[n, k] *= slower
    for n in range(2):
        if n == 0 and held.flags[5] < 0.5:
            continue
        for k in range(3):
            st.spins[n, k] = (turns[n, k] - turned[n, k]) / span


@kernel
def size_of(v: Array) -> float:
    """Length of a vector (3)."""
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@kernel
def keep_pace(
    st: State, held: Held, flags: Array, goals: Array, goal_turns: Array, ways: Array, turns: Array,
    aims_before: Array, dt: float,
) -> float:  # fmt: skip
    """Let pelvis and trunk leave their motion only about as fast as what is held moves, in place.

    ``ways`` (5, 3) and ``turns`` (2, 3) are the last step's (`way_from_motion`), ``aims_before`` (5, 3, m) where held
    ends were wanted, taken along by the motion.

    Returns:
        How far (m) shoulders and hips may have moved against the motion.
    """
    moved, leaned = 0.0, 0.0
    v, q, carried = np.empty(3), np.empty(4), np.empty(4)
    for limb in range(4):
        if flags[1 + limb] > 0.5:
            for k in range(3):
                v[k] = st.aims[1 + limb, k] - aims_before[1 + limb, k]
            # An elbow or knee pulls nothing along, a foot not the trunk: they only shift the balance.
            hinge = held.flags[8 + limb] > 0.5
            moved += size_of(v) * (BY_BALANCE if hinge else 1.0)
            leaned += size_of(v) * (BY_BALANCE if hinge or limb >= 2 else 1.0)
    for k in range(3):
        v[k] = st.velocities[0, k] * dt
        if flags[0] > 0.5:
            v[k] -= goals[0, k] - st.goals[0, k]
    if flags[0] > 0.5:
        most = PELVIS_PER_WAY * moved + size_of(v) + PELVIS_PACE * dt
        leaned += size_of(v)
    else:
        most = PELVIS_PER_WAY * moved + min(size_of(v), MOST_DRIFT * dt) + PELVIS_PACE * dt
    for k in range(3):
        v[k] = st.points[0, k] - goals[0, k] - ways[0, k]
    way = size_of(v)
    if way > most:
        for k in range(3):
            st.points[0, k] = goals[0, k] + ways[0, k] + most / way * v[k]
    exp(turns[0], q)
    mul(q, goal_turns[0], carried)
    mul_inv(st.turns[0], carried, q)
    turned = angle(q)
    widest = TRUNK_PER_WAY * leaned + (min(size_of(st.spins[0]), MOST_SPIN) + TRUNK_PACE) * dt
    if held.flags[5] < 0.5 and turned > widest:
        slerp(carried, st.turns[0], widest / turned, st.turns[0])
        turned = widest
    return min(way, most) + TRUNK_LEVER * turned


@kernel
def limb_places(rig: Rig, limb: int, turns: Array, out: Array) -> None:
    """Where a limb's hinge, end and tip are, and what its bones' skins face (5, 3, m), by its joints' turns (3, 4).

    All in the frame that it hangs from.
    """
    turn, v = np.empty(4), np.empty(3)
    turn[0], turn[1], turn[2], turn[3] = 0.0, 0.0, 0.0, 1.0
    for n in range(3):
        mul(turn, turns[n], turn)
        if n < 2:
            v[0], v[1], v[2] = 0.0, 0.0, SKIN
            rotate(turn, v, out[3 + n])
            if n == 1:
                for k in range(3):
                    out[4, k] += out[0, k]
        if n < 2:
            rotate(turn, rig.offsets[rig.limbs[limb, n + 1]], v)
        else:
            v[0], v[1], v[2] = 0.0, 0.0, TOES if limb >= 2 else 0.0
            rotate(turn, v, v)
        for k in range(3):
            out[n, k] = v[k] + (out[n - 1, k] if n > 0 else 0.0)


@kernel
def farthest_apart(a: Array, b: Array) -> float:
    """The largest distance (m) of two sets of points (n, 3)."""
    most = 0.0
    for n in range(a.shape[0]):
        most = max(most, sqrt((a[n, 0] - b[n, 0]) ** 2 + (a[n, 1] - b[n, 1]) ** 2 + (a[n, 2] - b[n, 2]) ** 2))
    return most


@kernel
def forget_limbs(st: State) -> None:
    """Over no motion nothing is kept of one."""
    st.leads[:] = 0.0
    st.bases[:] = 0.0
    st.reaches[:] = 0.0
    st.fades[:] = 0.0
    st.fade_rates[:] = 0.0
    st.lead_rates[:] = 0.0
    st.dodges[:] = 0.0
    st.dodge_rates[:] = 0.0


@kernel
def even_limbs(
    rig: Rig, gains: Gains, st: State, held: Held, under: Under, flags: Array, around: float, rotations_ls: Array,
    positions_ws: Array, rotations_ws: Array, paces: Array, dt: float,
) -> None:  # fmt: skip
    """Even out what a limb does at once, in place.

    A held limb may move against what it hangs from, and a free one against its motion, as fast as its goal does and
    `LIMB_PACE` on top; the rest of a change goes into a difference that fades. What the shoulders or hips of a free
    one moved (``around``, m) counts as its goal's. ``paces`` (4,) m/s is written: the fastest against the motion.
    """
    base, joints = np.empty((3, 4)), np.empty((3, 4))
    last, change = np.empty((3, 4)), np.empty((3, 3))
    places, places_before, swung = np.empty((5, 3)), np.empty((5, 3)), np.empty((5, 3))
    q, v, foot = np.empty(4), np.empty(3), np.empty(4)
    for limb in range(4):
        driven = flags[1 + limb] > 0.5
        let_go = not driven and size_of(st.reaches[limb]) > 0.0
        upper = rig.limbs[limb, 0]
        known = st.leads[limb, 0, 3] != 0.0 or st.leads[limb, 0, 0] != 0.0
        known = known or st.leads[limb, 0, 1] != 0.0 or st.leads[limb, 0, 2] != 0.0
        for n in range(3):
            joint = rig.limbs[limb, n]
            for k in range(4):
                base[n, k] = under.base.rotations_ls[joint, k]
                joints[n, k] = rotations_ls[joint, k]
        goal = size_of(st.velocities[1 + limb]) * dt + around
        if driven:
            for k in range(3):
                v[k] = st.aims[1 + limb, k] - positions_ws[upper, k]
            inv_rotate(rotations_ws[rig.parents[upper]], v, v)
            goal = 0.0
            if size_of(st.reaches[limb]) > 0.0:
                for k in range(3):
                    goal += (v[k] - st.reaches[limb, k]) ** 2
            goal = sqrt(goal)
            for k in range(3):
                st.reaches[limb, k] = v[k]
        else:
            for k in range(3):
                st.reaches[limb, k] = 0.0
        if held.flags[8 + limb] > 0.5:
            # Where the end under a held elbow or knee goes may turn round at once near the root.
            goal = min(goal, HINGE_PACE * dt)
        most = LIMB_PER_WAY * goal + LIMB_PACE * dt
        paces[limb] = most / max(dt, 1e-6)
        fade, rate = st.fades[limb], st.fade_rates[limb]
        faded = False
        if known:
            limb_places(rig, limb, base, swung)
            limb_places(rig, limb, st.bases[limb], places)
            swing = farthest_apart(swung, places)
            if driven:
                paces[limb] += swing / max(dt, 1e-6)
            for n in range(3):
                for k in range(4):
                    last[n, k] = st.leads[limb, n, k]
                if not driven:
                    # The last difference from the motion on the motion as it is now.
                    inv_mul(st.bases[limb, n], last[n], q)
                    mul(base[n], q, last[n])
            limb_places(rig, limb, joints, places)
            limb_places(rig, limb, last, places_before)
            share = max(0.0, 1.0 - most / max(farthest_apart(places, places_before), 1e-9))
            if limb < 2:
                if driven:
                    measure_lead(st, limb, base, joints, max(dt, LEAST_SPAN))
                elif let_go:
                    # An arm that is let go joins the motion joint by joint, with the speed that it had.
                    share = 1.0
                    for n in range(3):
                        inv_mul(joints[n], last[n], q)
                        go_on(q, st.lead_rates[limb, n], rate[n])
            for n in range(3):
                spring_decay_into(fade[n], rate[n], gains.motion_half_life, dt)
                if share > 0.0:
                    inv_mul(joints[n], last[n], q)
                    log(q, change[n])
                    for k in range(3):
                        change[n, k] *= share
                    exp(change[n], q)
                    add_turn(q, fade[n])
                faded = faded or size_of(fade[n]) > 1e-5
        for n in range(3):
            for k in range(4):
                st.leads[limb, n, k] = joints[n, k]
                st.bases[limb, n, k] = base[n, k]
        if not faded:
            continue
        end = rig.limbs[limb, 2]
        foot[:] = rotations_ws[end]
        for k in range(3):
            v[k] = positions_ws[end, k]
        for n in range(3):
            exp(fade[n], q)
            joint = rig.limbs[limb, n]
            mul(rotations_ls[joint], q, rotations_ls[joint])
        carry_from(rig, upper, rotations_ls, positions_ws, rotations_ws)
        if limb >= 2 and not driven:
            off = 0.0
            for k in range(3):
                off += (st.points[1 + limb, k] - under.points[1 + limb, k]) ** 2
            share = max(0.0, 1.0 - sqrt(off) / AT_MOTION) ** 2
            if share > 0.0:
                slerp(rotations_ws[end], foot, share, foot)
                for k in range(3):
                    v[k] = positions_ws[end, k] + share * (v[k] - positions_ws[end, k])
                keep_foot(rig, limb, v, foot, rotations_ls, positions_ws, rotations_ws)


@kernel
def keep_foot(
    rig: Rig, limb: int, place: Array, turn: Array, rotations_ls: Array, positions_ws: Array, rotations_ws: Array
) -> None:  # fmt: skip
    """Bring a leg's foot back to its place (3, m) and orientation (4), the knee to the side on which it is."""
    upper, lower, end = rig.limbs[limb, 0], rig.limbs[limb, 1], rig.limbs[limb, 2]
    axis, bone, wanted, q = np.empty(3), np.empty(3), np.empty(3), np.empty(4)
    d, along = 0.0, 0.0
    for k in range(3):
        axis[k] = place[k] - positions_ws[upper, k]
        d += axis[k] * axis[k]
    d = max(sqrt(d), 1e-6)
    for k in range(3):
        axis[k] /= d
        bone[k] = positions_ws[lower, k] - positions_ws[upper, k]
        along += bone[k] * axis[k]
    long, short = rig.lengths[limb, 0], rig.lengths[limb, 1]
    ahead = 0.5 * (d + (long * long - short * short) / d)
    out = sqrt(max(long * long - ahead * ahead, 0.0))
    aside = 0.0
    for k in range(3):
        wanted[k] = bone[k] - along * axis[k]
        aside += wanted[k] * wanted[k]
    aside = max(sqrt(aside), 1e-6)
    for k in range(3):
        wanted[k] = ahead * axis[k] + out / aside * wanted[k]
    between(bone, wanted, q)
    mul(q, rotations_ws[upper], q)
    inv_mul(rotations_ws[rig.parents[upper]], q, rotations_ls[upper])
    carry_from(rig, upper, rotations_ls, positions_ws, rotations_ws)
    for k in range(3):
        bone[k] = positions_ws[end, k] - positions_ws[lower, k]
        wanted[k] = place[k] - positions_ws[lower, k]
    between(bone, wanted, q)
    mul(q, rotations_ws[lower], q)
    inv_mul(rotations_ws[upper], q, rotations_ls[lower])
    inv_mul(q, turn, rotations_ls[end])
    carry_from(rig, lower, rotations_ls, positions_ws, rotations_ws)


@kernel
def measure_lead(st: State, limb: int, base: Array, joints: Array, span: float) -> None:
    """How fast (rad/s) an arm's joints (3, 4), held for ``span`` s, leave their motion (3, 4), into the state."""
    before, now = np.empty(4), np.empty(4)
    for n in range(3):
        inv_mul(st.bases[limb, n], st.leads[limb, n], before)
        inv_mul(base[n], joints[n], now)
        inv_mul(before, now, now)
        log(now, st.lead_rates[limb, n])
        slower = min(1.0, MOST_LEAD / max(size_of(st.lead_rates[limb, n]) / span, 1e-9)) / span
        for k in range(3):
            st.lead_rates[limb, n, k] *= slower


@kernel
def go_on(turn: Array, speed: Array, rate: Array) -> None:
    """Add to ``rate`` (3, rad/s) that of the rotation vector of a turn (4) that goes on with ``speed`` (3, rad/s)."""
    q, v, later = np.empty(4), np.empty(3), np.empty(3)
    log(turn, v)
    for k in range(3):
        later[k] = 1e-3 * speed[k]
    exp(later, q)
    mul(turn, q, q)
    log(q, later)
    change = 0.0
    for k in range(3):
        later[k] = (later[k] - v[k]) * 1e3
        change += later[k] ** 2
    # (Half a turn away the vector flips.)
    if change < 4.0 * MOST_LEAD * MOST_LEAD:
        for k in range(3):
            rate[k] += later[k]


@kernel
def add_turn(turn: Array, vector: Array) -> None:
    """Put a turn (4) before a rotation vector (3), in place."""
    q = np.empty(4)
    exp(vector, q)
    mul(turn, q, q)
    log(q, vector)
