"""The motion control model: one step of the whole stack (Oshita 2013 section 6).

Free parts relax and held ones follow their targets; interaction votes on top (eq. 13 with `blend`); then
tracking and balance agree on trunk and pelvis (`agreement`), elbows and knees find their places (`hinges`), and
limbs get out of the body's way (`collision`). Every module is a file of its own; this one is their order.
"""

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import bare, kernel, kernel_inline
from bunraku.figure.mass import center_of_mass_into
from bunraku.figure.pointpose import reconstruct_into
from bunraku.figure.quat import log, mul_inv
from bunraku.figure.rig import Rig, unpack_rig
from bunraku.figure.spring import lag, spring_to_into
from bunraku.nodes.controller.agreement import agree, hold_back, nothing_driven
from bunraku.nodes.controller.collision import avoid, own_limits
from bunraku.nodes.controller.contacts import Contacts, unpack_contacts
from bunraku.nodes.controller.dodging import dodge
from bunraku.nodes.controller.ends import move_ends
from bunraku.nodes.controller.heading import seek_step, turn_feet, update_heading
from bunraku.nodes.controller.hinges import turn_hinges
from bunraku.nodes.controller.interaction import sway_hands, sway_trunk
from bunraku.nodes.controller.legs import RISE_TO_STEP, knee_pace, lean_room, reach_gently, rise_to_step
from bunraku.nodes.controller.over import (
    LEAST_SPAN,
    ease_point,
    ease_turn,
    even_limbs,
    forget_limbs,
    keep_pace,
    remember_ways,
    way_from_motion,
)
from bunraku.nodes.controller.pacing import LEG_SPEED, allow_return, legs_into, remember_legs, see_landings
from bunraku.nodes.controller.placing import hang_free_hands, place_body
from bunraku.nodes.controller.relaxing import (
    carry_turn,
    keep_head,
    relax_point,
    relax_turn,
    take_away,
    twist_of,
    wanted_velocity,
)
from bunraku.nodes.controller.rest import find_goals, start_standing
from bunraku.nodes.controller.state import (
    Gains,
    Held,
    State,
    Under,
    unpack_gains,
    unpack_held,
    unpack_state,
    unpack_under,
)
from bunraku.nodes.controller.step import IDLE, PHASE, advance_step
from bunraku.nodes.controller.tracking import follow_point, follow_turn, keep_lean

Array = NDArray[np.float64]
Index = NDArray[np.int64]

FASTEST_TURN = 20.0
"""rad/s: a held orientation that turns faster has jumped."""
FREE_WAY = 0.3
"""Share of its relaxing speed with which a free limb slides along something."""
HURRY_HALF_LIFE = 0.08
"""s in which the speed of a limb's goal is forgotten."""


@kernel
def advance_packed(
    rig_ints: Index, rig_floats: Array, gains: Array, state: Array, held: Array, under: Array,
    contact_ints: Index, contact_floats: Array, mass_share: float, dt: float, hull: Array, center: Array,
    rotations_ls: Array, positions_ws: Array, rotations_ws: Array,
) -> int:  # fmt: skip
    """`advance` with every record packed into one or two arrays: handing over a hundred arrays takes longer
    than the step itself."""
    joints = rotations_ls.shape[0]
    return advance(
        unpack_rig(bare(rig_ints), bare(rig_floats)), unpack_gains(gains), unpack_state(bare(state)),
        unpack_held(bare(held)), unpack_under(bare(under), joints),
        unpack_contacts(bare(contact_ints), bare(contact_floats), joints), mass_share, dt, bare(hull), bare(center),
        bare(rotations_ls), bare(positions_ws), bare(rotations_ws),
    )  # fmt: skip


@kernel
def advance(
    rig: Rig, gains: Gains, st: State, held: Held, under: Under, contacts: Contacts, mass_share: float, dt: float,
    hull: Array, center: Array, rotations_ls: Array, positions_ws: Array, rotations_ws: Array,
) -> int:  # fmt: skip
    """One step of ``dt`` s; the world arrays hold the last pose before and the new one after.

    Returns:
        The number of corners of the support polygon in ``hull`` (16, 2); ``center`` (3) is the centre of mass.
    """
    over = under.active[0] > 0.5
    goals, goal_turns = np.empty((5, 3)), np.empty((2, 4))
    before, trunk_before, carried = np.empty((5, 3)), np.empty((2, 4)), np.empty((5, 3))
    arms, flags = np.zeros((2, 3)), np.zeros(5)
    relaxed_trunk, relaxed_pelvis, room = np.empty(4), np.empty(3), np.empty(2)
    swivels_before, plain, aims_before, moved = np.empty(4), np.empty(4), np.empty((5, 3)), np.empty(4)
    exact, limited, hips, legs_before = np.empty(4), np.empty(4), np.empty((2, 3)), np.empty((2, 3, 4))
    if st.mode[0] < 0.5:
        start(rig, gains, st, held, under, goals, goal_turns, plain, rotations_ls, positions_ws, rotations_ws)
    ways, ways_turned, ways_before, turned_before = (
        np.empty((5, 3)),
        np.empty((2, 3)),
        np.empty((5, 3)),
        np.empty((2, 3)),
    )
    before[:] = st.points
    legs_into(rig, rotations_ls, legs_before)
    swivels_before[:] = st.swivels
    go_on_as_drawn(st, held)

    # Where everything would rest, and whether the feet have to go somewhere.
    update_heading(gains, st, held, under, dt)
    find_goals(rig, st, under, goals, goal_turns)
    if st.mode[1] != under.active[0]:
        change_base(st, under, goals, goal_turns)
    yaws = np.array([twist_of(st.feet[0]), twist_of(st.feet[1])])
    way_from_motion(st, st.goals, st.goal_turns, ways, ways_turned)
    ways_before[:] = ways
    turned_before[:] = ways_turned
    seek_step(rig, gains, st, held, over, goals)
    stepping = st.step[PHASE] != IDLE

    # Every part by itself: held ones to their targets, free ones toward rest.
    move_turns(gains, st, held, over, goal_turns, ways_turned, trunk_before, dt)
    move_pelvis(rig, gains, st, held, over, goals, ways, positions_ws, carried, flags, dt)
    # What a motion carries along does not count as moved.
    for n in range(5):
        for k in range(3):
            aims_before[n, k] = st.aims[n, k] if st.held[n] > 0.5 else st.points[n, k]
            if over:
                aims_before[n, k] += goals[0, k] - st.goals[0, k]
    move_ends(rig, gains, st, held, goals, over, ways, positions_ws, arms, flags, dt)
    if stepping:
        advance_step(
            st.step, st.points[0], st.points, yaws, st.planted, rig.ankle_heights, gains.step_lift,
            gains.step_time, gains.step_pace, dt,
        )  # fmt: skip
        st.pelvis_rest[0], st.pelvis_rest[2] = 0.0, 0.0
        if st.step[PHASE] != IDLE:
            for k in range(3):
                for side in range(2):
                    hips[side, k] = positions_ws[rig.limbs[2 + side, 0], k] - positions_ws[0, k]
            rise_to_step(rig, st.step, st.points[0], hips, st.points, st.planted, yaws, RISE_TO_STEP * dt)
    allow_return(st, before, dt)
    turn_feet(rig, gains, st, under, yaws, before, aims_before, dt)
    lean_room(rig, positions_ws, st.planted, st.heading[0], room)
    keep_lean(st.turns[0], st.heading[0], under.turns[0], room)
    if not over:
        sway_trunk(rig, gains, st, held, flags, aims_before, positions_ws)
    keep_lean(st.turns[0], st.heading[0], under.turns[0], room)
    relaxed_trunk[:] = st.turns[0]
    relaxed_pelvis[:] = st.points[0]
    keep_head(st, under)

    # The body together.
    untouched = over and nothing_driven(held, ways, ways_turned)
    reach_gently(rig, under.base.exact, positions_ws, st.points, st.planted, flags[0] > 0.5 and not over, dt, exact)
    size = agree(
        rig, gains, st, held, under, contacts, exact, untouched, arms, flags, mass_share, hull, center, rotations_ls,
        positions_ws, rotations_ws,
    )  # fmt: skip
    around = 0.0
    if over and not untouched:
        around = keep_pace(st, held, flags, goals, goal_turns, ways_before, turned_before, aims_before, dt)
        reconstruct_into(
            rig, under.base, st.points, st.turns, st.swivels, st.feet, st.feet_level, rotations_ls, positions_ws,
            rotations_ws,
        )  # fmt: skip
    elif not (stepping or over) and hold_back(
        rig, gains, st, held, under, flags, aims_before, relaxed_pelvis, relaxed_trunk, positions_ws, dt
    ):  # fmt: skip
        reconstruct_into(
            rig, under.base, st.points, st.turns, st.swivels, st.feet, st.feet_level, rotations_ls, positions_ws,
            rotations_ws,
        )  # fmt: skip
    if not over:
        sway_hands(rig, gains, st, flags, trunk_before[0], carried[0], arms, positions_ws)
        hang_free_hands(rig, st, flags, arms, positions_ws)
    turn_hinges(rig, gains, st, held, under, positions_ws, rotations_ws, before, plain, dt)
    own_limits(st, under, flags, limited)
    place_body(rig, st, under, contacts.limits, flags, arms, limited, rotations_ls, positions_ws, rotations_ws)
    measure_ways(rig, gains, st, over, flags, aims_before, before, positions_ws, moved, dt)
    avoid(
        rig, gains, st, under, contacts, flags, limited, swivels_before, plain, moved, legs_before,
        rotations_ls, positions_ws, rotations_ws, dt,
    )  # fmt: skip
    paces = np.empty(4)
    see_landings(rig, st, contacts.limits, before, positions_ws, rotations_ls, rotations_ws, dt)
    remember_legs(rig, st, rotations_ls)
    if over:
        # (A motion's own legs are the way to go on from.)
        st.legs_kept[:] = 0.0
        st.leg_rates[:] = LEG_SPEED
        even_limbs(
            rig, gains, st, held, under, flags, around, rotations_ls, positions_ws, rotations_ws, paces, dt
        )  # fmt: skip
        if gains.w_collision > 0.0:
            dodge(rig, st, contacts, flags, rotations_ls, positions_ws, rotations_ws, dt)
    remember(
        rig, st, held, flags, before, trunk_before[0], carried[0], relaxed_trunk, relaxed_pelvis, arms, goals,
        goal_turns, positions_ws, max(dt, LEAST_SPAN),
    )  # fmt: skip
    if over:
        remember_ways(
            st, held, flags, ways_before, turned_before, goals, goal_turns, paces, max(dt, LEAST_SPAN)
        )  # fmt: skip
    else:
        forget_limbs(st)
    center_of_mass_into(rig.masses, rig.mass_centers, positions_ws, rotations_ws, center)
    return size


@kernel
def start(
    rig: Rig, gains: Gains, st: State, held: Held, under: Under, goals: Array, goal_turns: Array, plain: Array,
    rotations_ls: Array, positions_ws: Array, rotations_ws: Array,
) -> None:  # fmt: skip
    """Stand in the start pose, with hands and elbows where they rest."""
    start_standing(rig, st, under, positions_ws)
    find_goals(rig, st, under, goals, goal_turns)
    before = np.zeros((5, 3))
    for _ in range(2):
        reconstruct_into(
            rig, under.base, st.points, st.turns, st.swivels, st.feet, st.feet_level, rotations_ls, positions_ws,
            rotations_ws,
        )  # fmt: skip
        shoulders_of(rig, positions_ws, st.roots)
        for limb in range(2):
            for k in range(3):
                st.points[1 + limb, k] = st.roots[limb, k] + goals[1 + limb, k]
        turn_hinges(rig, gains, st, held, under, positions_ws, rotations_ws, before, plain, 0.0)
    st.wishes[:] = st.points[1:]
    st.mode[0] = 2.0


@kernel
def shoulders_of(rig: Rig, positions_ws: Array, out: Array) -> None:
    """Where the four limbs hang (4, 3, m)."""
    for limb in range(4):
        for k in range(3):
            out[limb, k] = positions_ws[rig.limbs[limb, 0], k]


@kernel_inline
def go_on_as_drawn(st: State, held: Held) -> None:
    """Where a part has just been let go, what it drew along goes on as it moved."""
    for n in range(7):
        if st.held[n] > 0.5 and held.flags[n] < 0.5:
            st.velocities[0] = st.drifts[0]
            st.spins[0] = st.drifts[1]
            return


@kernel
def change_base(st: State, under: Under, goals: Array, goal_turns: Array) -> None:
    """Lie over another base from now on, without a jump of what is kept against it."""
    st.mode[1] = under.active[0]
    for limb in range(4):
        st.extra[limb] = st.swivels[limb] - under.swivels[limb]
    st.pelvis_rest[:] = 0.0
    st.step[PHASE] = IDLE
    st.goals[:] = goals
    st.goal_turns[:] = goal_turns


@kernel_inline
def move_turns(
    gains: Gains, st: State, held: Held, over: bool, goal_turns: Array, ways: Array, trunk_before: Array, dt: float
) -> None:
    """Trunk and head; ``trunk_before`` (2, 4) is written: as they were, taken along with their rest."""
    for n in range(2):
        carry_turn(st.turns[n], st.goal_turns[n], goal_turns[n])
        trunk_before[n] = st.turns[n]
        if held.flags[5 + n] > 0.5:
            follow_turn(
                held.turns[n], st.target_turns[n], st.held[5 + n] < 0.5, st.turns[n], st.spins[n],
                st.turn_offsets[n], st.turn_offset_rates[n], FASTEST_TURN, gains.half_life, dt,
            )  # fmt: skip
        elif over:
            ease_turn(ways[n], st.spins[n], goal_turns[n], gains.motion_half_life, dt, st.turns[n])
        else:
            relax_turn(
                st.turns[n], st.spins[n], goal_turns[n], gains.relax_trunk, gains.relax_time, gains.ease_time, dt
            )
        st.held[5 + n] = held.flags[5 + n]


@kernel
def move_pelvis(
    rig: Rig, gains: Gains, st: State, held: Held, over: bool, goals: Array, ways: Array, positions_ws: Array,
    carried: Array, flags: Array, dt: float,
) -> None:  # fmt: skip
    """The pelvis; a free one comes back over its feet, or to where it was let go.

    Writes ``carried[0]`` (3): where it was, taken along by the motion; ``flags[0]``: whether it is driven.
    """
    stepping = st.step[PHASE] != IDLE
    flags[0] = 1.0 if held.flags[0] > 0.5 and not stepping else 0.0
    if over:
        for k in range(3):
            st.points[0, k] += goals[0, k] - st.goals[0, k]
    carried[0] = st.points[0]
    if flags[0] > 0.5:
        follow_point(
            held.points[0], st.targets[0], st.held[0] < 0.5, st.points[0], st.aims[0], st.velocities[0],
            st.offsets[0], st.offset_rates[0], gains.input_speed, gains.half_life, dt,
        )  # fmt: skip
        st.points[0] = st.aims[0]
    elif over:
        ease_point(ways[0], st.velocities[0], goals[0], gains.motion_half_life, dt, st.points[0])
    else:
        if st.held[0] > 0.5 and not stepping:
            for k in range(3):
                st.pelvis_rest[k] += st.points[0, k] - goals[0, k]
                goals[0, k] = st.points[0, k]
        if gains.relax_pelvis > 0.0:
            nowhere, at_once = np.zeros(3), np.zeros(3)
            relax_point(st.pelvis_rest, at_once, nowhere, gains.relax_pelvis, gains.relax_time, 1e-6, dt)
        wanted, calm = np.empty(3), 1.0
        low, sinking = st.points[0, 1:2].copy(), st.velocities[0, 1:2].copy()
        wanted_velocity(st.points[0], goals[0], gains.relax_reach, gains.relax_time, wanted)
        for side in range(2):
            if st.planted[side] > 0.5:
                pace = knee_pace(rig, 2 + side, positions_ws[rig.limbs[2 + side, 0]], st.points[3 + side], wanted)
                calm = min(calm, max(0.05, pace))
        relax_point(
            st.points[0], st.velocities[0], goals[0], calm * gains.relax_reach, gains.relax_time / calm,
            gains.ease_time, dt,
        )  # fmt: skip
        if goals[0, 1] < low[0] and foot_lands(st):
            # Down to meet a foot that lands as fast as it comes.
            spring_to_into(low, sinking, goals[0, 1:2], gains.landing_half_life, dt)
            st.points[0, 1], st.velocities[0, 1] = low[0], sinking[0]
    st.held[0] = flags[0]


@kernel
def foot_lands(st: State) -> bool:
    """Whether a free foot is on its way to the ground while the other one stands."""
    for side in range(2):
        if st.planted[side] < 0.5 and st.held[3 + side] < 0.5 and st.planted[1 - side] > 0.5:
            return bool(st.step[PHASE] == IDLE)
    return False


@kernel_inline
def measure_ways(
    rig: Rig, gains: Gains, st: State, over: bool, flags: Array, aims_before: Array, before: Array,
    positions_ws: Array, moved: Array, dt: float,
) -> None:  # fmt: skip
    """How far each limb's goal has moved (4, m): what touches something slides about as fast."""
    for limb in range(4):
        way = 0.0
        for k in range(3):
            if flags[1 + limb] > 0.5:
                way += (st.aims[1 + limb, k] - aims_before[1 + limb, k]) ** 2
            else:
                root = positions_ws[rig.limbs[limb, 0], k] - st.roots[limb, k]
                way += (st.points[1 + limb, k] - before[1 + limb, k] - root) ** 2
        moved[limb] = sqrt(way)
        if flags[1 + limb] < 0.5 and limb < 2 and not over:
            # A free hand moves only as fast as it relaxes.
            moved[limb] = min(moved[limb], FREE_WAY * gains.relax_ends * dt)
        if over and flags[1 + limb] < 0.5:
            st.hurry[limb] = 0.0
        elif dt > 0.0:
            # What was quick a moment ago may still be made up for.
            st.hurry[limb] += (moved[limb] / dt - st.hurry[limb]) * lag(HURRY_HALF_LIFE, dt)
            moved[limb] = max(moved[limb], st.hurry[limb] * dt)


@kernel_inline
def remember(
    rig: Rig, st: State, held: Held, flags: Array, before: Array, trunk_before: Array, pelvis_before: Array,
    relaxed_trunk: Array, relaxed_pelvis: Array, arms: Array, goals: Array, goal_turns: Array, positions_ws: Array,
    span: float,
) -> None:  # fmt: skip
    """Keep what the next step needs to know of this one of ``span`` s: velocities, shoulders, goals."""
    q, v = np.empty(4), np.empty(3)
    mul_inv(st.turns[0], trunk_before, q)
    log(q, v)
    for k in range(3):
        st.drifts[0, k] = (st.points[0, k] - pelvis_before[k]) / span
        st.drifts[1, k] = v[k] / span
    if held.flags[5] < 0.5:
        mul_inv(st.turns[0], relaxed_trunk, q)
        log(q, v)
        take_away(st.spins[0], v, span)
    if flags[0] < 0.5:
        for k in range(3):
            v[k] = st.points[0, k] - relaxed_pelvis[k]
        take_away(st.velocities[0], v, span)
    for limb in range(2):
        row = 1 + limb
        for k in range(3):
            shoulder = positions_ws[rig.limbs[limb, 0], k]
            if flags[row] < 0.5:
                v[k] = st.points[row, k] - shoulder - arms[limb, k]
            else:
                st.velocities[row, k] = (st.points[row, k] - before[row, k] - shoulder + st.roots[limb, k]) / span
        if flags[row] < 0.5:
            take_away(st.velocities[row], v, span)
    shoulders_of(rig, positions_ws, st.roots)
    st.goals[:] = goals
    st.goal_turns[:] = goal_turns
