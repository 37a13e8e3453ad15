"""The motion control model: all modules on one point pose, blended by eq. 13 (Oshita 2013 section 6).

One step: free parts relax and held ones follow their targets; interaction votes on top; then tracking and
balance each say what the trunk and the pelvis would have to do, and the weighted mean of their votes is
taken again and again until both agree (averaged projections, so that the order does not matter); what the
legs and the ground allow is kept in every round. Self-collision works on the result.
"""

from math import cos, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel
from bunraku.figure.limb import swivel_of
from bunraku.figure.mass import center_of_mass_into
from bunraku.figure.pointpose import default_swivel, level_weight, reconstruct_into
from bunraku.figure.quat import angle, exp, inv_rotate, log, mul_inv, slerp
from bunraku.figure.rig import Rig, unpack_rig
from bunraku.figure.spring import lag, spring_to_into
from bunraku.nodes.controller.balance import balance_shift, pelvis_correction, sole_polygon, trunk_correction
from bunraku.nodes.controller.blend import blend_point, blend_turn
from bunraku.nodes.controller.collision import Contacts, avoid, place_limb, unpack_contacts
from bunraku.nodes.controller.interaction import end_from_trunk, trunk_from_ends
from bunraku.nodes.controller.legs import (
    keep_pelvis_over_feet,
    knee_pace,
    landing_place,
    lean_room,
    pelvis_home,
    sink_to_land,
)
from bunraku.nodes.controller.relaxing import (
    carry_hand,
    carry_turn,
    move_with,
    relax_hand,
    relax_point,
    relax_turn,
    twist_of,
    wanted_velocity,
    yaw_turn,
)
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
from bunraku.nodes.controller.step import HEADING, IDLE, PHASE, advance_step, begin_step, wrap
from bunraku.nodes.controller.tracking import follow_point, follow_turn, keep_lean, reach_with_trunk, root_shift

Array = NDArray[np.float64]
Index = NDArray[np.int64]

ROUNDS = 10
"""Most rounds of tracking and balance in one step."""
PULL = 0.06
"""m by which tracking pulls a limb's root in one round."""
LAST_ROUNDS = 6
"""Most rounds in which balance alone has the last word."""
ENOUGH = 2e-4
"""m: shifts below this end the rounds."""
YAW_STEP, YAW_REST, YAW_MOST = 0.40, 0.10, 0.75
"""rad: twist against the feet that makes them step while turning, when turned; most per step."""
HIP_TWIST = 0.60
"""rad that the hips turn over planted feet."""
UNPLANT = 0.01
"""m that a held foot is pulled before it leaves its place."""
KNEE_LIFT = 0.10
"""m that a held knee is pulled before it lifts its foot."""
SWIVEL_PER_WAY, SWIVEL_RATE = 8.0, 0.3
"""rad/m and rad/s: the fastest that an elbow or knee turns by itself."""
STUCK, DETOUR = 0.3, 3.0
"""s after which an arm that something stops goes round it, and how far out."""
LANDING_TIME = 0.45
"""Time constant of the last bit of a sinking foot, s."""
STILL_BENDS = 0.04
"""rad by which the trunk bends in a round in which the knees still wait."""
REACH_DUCK = 0.74
"""Shortest hip to ankle that a reach pulls the pelvis down to, as a share of the leg."""
BODY_WAY, BODY_SPEED, BODY_TURN, BODY_SPIN = 2.5, 0.06, 8.0, 0.4
"""How far the pelvis goes for every metre of the held ends, m/s on top, rad/m and rad/s for the trunk."""
SHIFT_WEIGHT = 0.8
"""m/s of the same for a foot that leaves the ground."""
HANG = (0.17, -0.97, 0.10)
"""Direction of the left arm at rest."""


@kernel
def hanging_arm(rig: Rig, limb: int, heading: float, out: Array) -> None:
    """From shoulder to hand (3, m) with the arm at rest: at the side, a little bent."""
    sign = 1.0 if limb == 0 else -1.0
    x, y, z = sign * HANG[0], HANG[1], HANG[2]
    n = rig.reach[limb, 1] * 0.985 / sqrt(x * x + y * y + z * z)
    c, s = cos(heading), sin(heading)
    out[0], out[1], out[2] = n * (c * x + s * z), n * y, n * (c * z - s * x)


@kernel
def foot_yaw(st: State) -> float:
    """The heading (rad) half-way between both feet."""
    left = twist_of(st.feet[0])
    return left + 0.5 * wrap(twist_of(st.feet[1]) - left)


@kernel
def update_heading(gains: Gains, st: State, held: Held, under: Under, dt: float) -> None:
    """The figure's heading: the motion's, or toward the held one as far as hips and feet allow."""
    if under.active[0] > 0.5:
        st.heading[0], st.heading[1] = twist_of(under.turns[0]), 0.0
        return
    feet = foot_yaw(st)
    wanted = held.yaw[0] if held.flags[7] > 0.5 else feet
    if st.step[PHASE] != IDLE:
        wanted = feet + wrap(st.step[HEADING] - feet)
    off = min(HIP_TWIST, max(-HIP_TWIST, wrap(wanted - feet)))
    way = wrap(feet + off - st.heading[0])
    speed = np.array([min(gains.turn_speed, max(-gains.turn_speed, way / 0.15))])
    move_with(st.heading[0:1], st.heading[1:2], speed, gains.ease_time, dt)
    st.heading[0] = wrap(st.heading[0])


@kernel
def find_goals(rig: Rig, st: State, under: Under, goals: Array, goal_turns: Array) -> None:
    """Where every part would rest now: goals (5, 3), hands against their shoulders, and turns (2, 4)."""
    heading = st.heading[0]
    if under.active[0] > 0.5:
        for k in range(3):
            goals[0, k] = under.points[0, k]
            for limb in range(2):
                goals[1 + limb, k] = under.points[1 + limb, k] - under.roots[limb, k]
                goals[3 + limb, k] = under.points[3 + limb, k]
        for n in range(2):
            for k in range(4):
                goal_turns[n, k] = under.turns[n, k]
        return
    pelvis_home(rig, st.points, st.support, heading, goals[0])
    for k in range(3):
        goals[0, k] += st.pelvis_rest[k]
    for limb in range(2):
        hanging_arm(rig, limb, heading, goals[1 + limb])
        other = 1 - limb
        if st.planted[other] > 0.5:
            landing_place(rig, limb, st.points[3 + limb], st.points[3 + other], True, heading, goals[3 + limb])
        else:
            landing_place(rig, limb, st.points[3 + limb], st.points[0], False, heading, goals[3 + limb])
    for limb in range(2):
        if st.planted[limb] < 0.5 and st.planted[1 - limb] > 0.5:
            goals[0, 1] -= sink_to_land(rig, limb, st.points[3 + limb], goals[3 + limb], goals[0], heading)
    yaw_turn(heading, goal_turns[0])
    yaw_turn(heading, goal_turns[1])


@kernel
def start_standing(rig: Rig, st: State, under: Under, positions_ws: Array) -> None:
    """Put the figure into its start pose: standing where its feet are, or as the motion has it."""
    over = under.active[0] > 0.5
    for side in range(2):
        if over:
            for k in range(4):
                st.feet[side, k] = under.feet[side, k]
            st.planted[side] = under.contacts[side]
        else:
            yaw_turn(st.heading[0], st.feet[side])
            st.planted[side] = 1.0
        st.support[side] = st.planted[side]
    find_goals(rig, st, under, st.goals, st.goal_turns)
    for n in range(5):
        for k in range(3):
            if not (n >= 3 and not over):
                st.points[n, k] = st.goals[n, k]
    for n in range(2):
        for k in range(4):
            st.turns[n, k] = st.goal_turns[n, k]
    st.mode[0], st.mode[1] = 1.0, under.active[0]


@kernel
def shoulders_of(rig: Rig, positions_ws: Array, out: Array) -> None:
    """Where the four limbs hang (4, 3, m)."""
    for limb in range(4):
        for k in range(3):
            out[limb, k] = positions_ws[rig.limbs[limb, 0], k]


@kernel
def held_hinge(rig: Rig, st: State, limb: int, held: Held, positions_ws: Array, out: Array) -> None:
    """Where a limb's end goes (3, m) when its elbow or knee is held: the bone beyond keeps its direction."""
    upper, lower, end = rig.limbs[limb, 0], rig.limbs[limb, 1], rig.limbs[limb, 2]
    if st.held[8 + limb] < 0.5:
        for k in range(3):
            st.beyond[limb, k] = positions_ws[end, k] - positions_ws[lower, k]
        st.held[8 + limb] = 1.0
    d = 0.0
    for k in range(3):
        out[k] = held.hinges[limb, k] - positions_ws[upper, k]
        d += out[k] * out[k]
    d = max(sqrt(d), 1e-6)
    for k in range(3):
        out[k] = positions_ws[upper, k] + out[k] * rig.lengths[limb, 0] / d + st.beyond[limb, k]


@kernel
def move_ends(
    rig: Rig, gains: Gains, st: State, held: Held, goals: Array, over: bool, positions_ws: Array, ends: Array,
    arms: Array, flags: Array, dt: float,
) -> None:  # fmt: skip
    """Held ends to their targets, free ones toward rest.

    Writes flags (5,): which points are driven now; arms (2, 3): free hands against their shoulders.
    """
    aim, aside, wanted = np.empty(3), np.empty(3), np.empty(3)
    c, s = cos(st.heading[0]), sin(st.heading[0])
    for limb in range(4):
        row = limb + 1
        driven = held.flags[row] > 0.5
        if held.flags[8 + limb] < 0.5:
            st.held[8 + limb] = 0.0
        for k in range(3):
            aim[k] = held.points[row, k]
        if not driven and held.flags[8 + limb] > 0.5:
            held_hinge(rig, st, limb, held, positions_ws, aim)
            driven = True
            if limb >= 2 and st.lift[limb - 2] < 0.5:
                away = 0.0
                for k in range(3):
                    away += (held.hinges[limb, k] - positions_ws[rig.limbs[limb, 1], k]) ** 2
                driven = away > KNEE_LIFT * KNEE_LIFT or st.planted[limb - 2] < 0.5
                if driven:
                    st.lift[limb - 2] = 1.0
        elif limb >= 2:
            st.lift[limb - 2] = 0.0
        if limb >= 2:
            side = limb - 2
            if st.step[PHASE] != IDLE:
                driven = False
            if driven:
                aim[1] = max(aim[1], rig.ankle_heights[side])
                if st.planted[side] > 0.5 and not over:
                    away = 0.0
                    for k in range(3):
                        away += (aim[k] - st.points[row, k]) ** 2
                    if away > UNPLANT * UNPLANT:
                        st.planted[side] = 0.0
                    else:
                        driven = False
        flags[row] = 1.0 if driven else 0.0
        if driven:
            follow_point(
                aim, st.targets[row], st.held[row] < 0.5, st.points[row], st.aims[row], st.velocities[row],
                st.offsets[row], st.offset_rates[row], gains.input_speed, gains.half_life, dt,
            )  # fmt: skip
            if limb >= 2:
                st.aims[row, 1] = max(st.aims[row, 1], rig.ankle_heights[limb - 2])
            for k in range(3):
                st.points[row, k] = st.aims[row, k]
        elif limb < 2:
            for k in range(3):
                arms[limb, k] = st.points[row, k] - st.roots[limb, k]
                if st.held[row] > 0.5:
                    st.wishes[limb, k] = st.points[row, k]
            carry_hand(arms[limb], st.goals[row], goals[row])
            for k in range(3):
                ends[row, k] = arms[limb, k]
            sign = 1.0 if limb == 0 else -1.0
            aside[0], aside[1], aside[2] = 0.85 * sign * c + 0.5 * s, 0.0, 0.5 * c - 0.85 * sign * s
            # An arm that cannot go on tries farther out.
            detour = DETOUR * min(1.0, st.stuck[limb] / STUCK) if st.stuck[limb] > 0.0 else 0.0
            reach = sqrt(goals[row, 0] ** 2 + goals[row, 1] ** 2 + goals[row, 2] ** 2)
            size = 0.0
            for k in range(3):
                wanted[k] = goals[row, k] / reach + detour * aside[k]
                size += wanted[k] * wanted[k]
            for k in range(3):
                wanted[k] *= reach / sqrt(size)
            relax_hand(
                arms[limb], st.velocities[row], wanted, aside, rig.lengths[limb, 0], rig.lengths[limb, 1],
                gains.relax_ends, gains.relax_time, gains.ease_time, dt,
            )  # fmt: skip
        elif over:
            for k in range(3):
                st.points[row, k] += goals[row, k] - st.goals[row, k]
            relax_point(
                st.points[row], st.velocities[row], goals[row], gains.relax_feet, LANDING_TIME,
                gains.ease_time, dt,
            )  # fmt: skip
        elif st.planted[limb - 2] < 0.5 and st.step[PHASE] == IDLE:
            side = limb - 2
            wanted_velocity(st.points[row], goals[row], gains.relax_feet, LANDING_TIME, wanted)
            calm = max(0.05, knee_pace(rig, limb, positions_ws[rig.limbs[limb, 0]], st.points[row], wanted))
            relax_point(
                st.points[row], st.velocities[row], goals[row], calm * gains.relax_feet, LANDING_TIME / calm,
                gains.ease_time, dt,
            )  # fmt: skip
            if st.points[row, 1] <= rig.ankle_heights[side] + 5e-4:
                st.points[row, 1] = rig.ankle_heights[side]
                st.planted[side] = 1.0
                for k in range(3):
                    st.velocities[row, k] = 0.0
        st.held[row] = flags[row]


@kernel
def turn_feet(rig: Rig, gains: Gains, st: State, under: Under, yaws: Array, dt: float) -> None:
    """How each foot stands and how much of that the ground decides; how much it supports."""
    over = under.active[0] > 0.5
    facing = np.empty(4)
    for side in range(2):
        height = st.points[3 + side, 1] - rig.ankle_heights[side]
        if over:
            for k in range(4):
                st.feet[side, k] = under.feet[side, k]
            off = 0.0
            for k in range(3):
                off += (st.points[3 + side, k] - under.points[3 + side, k]) ** 2
            away = min(1.0, sqrt(off) / 0.10)
            st.feet_level[side] = 1.0 - away + away * level_weight(height)
            st.planted[side] = under.contacts[side] if off < 1e-6 else 0.0
        else:
            if st.step[PHASE] != IDLE:
                yaw_turn(yaws[side], st.feet[side])
            elif st.planted[side] < 0.5:
                yaw_turn(st.heading[0], facing)
                slerp(st.feet[side], facing, lag(0.08, dt), st.feet[side])
            st.feet_level[side] = level_weight(height)
        # A foot that comes down supports at once; one that is lifted leaves the polygon bit by bit.
        st.support[side] += (st.planted[side] - st.support[side]) * lag(gains.support_time, dt)
        if st.planted[side] > 0.5 or st.support[side] < 1e-3:
            st.support[side] = st.planted[side]


@kernel
def agree(
    rig: Rig, gains: Gains, st: State, held: Held, under: Under, contacts: Contacts, untouched: bool, arms: Array,
    flags: Array, mass_share: float, hull: Array, center: Array, rotations_ls: Array, positions_ws: Array,
    rotations_ws: Array,
) -> int:  # fmt: skip
    """Rounds of tracking and balance on trunk and pelvis until both are content; returns the hull's size.

    On return the world arrays hold the agreed pose, with the swivels of the last step.
    """
    shift, part, rest, chest, shoulder = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    pelvis_votes, trunk_votes = np.empty((2, 3)), np.empty((2, 4))
    pelvis_weights, trunk_weights = np.empty(2), np.empty(2)
    hips, start, turn, room = np.empty((2, 3)), np.empty(3), np.empty(4), np.empty(2)
    pelvis_free, trunk_free = flags[0] < 0.5, held.flags[5] < 0.5
    stepping = st.step[PHASE] != IDLE
    over = under.active[0] > 0.5
    # A pelvis that is held, or was left low, may be low; a reach alone does not pull it far down.
    low = not pelvis_free or st.pelvis_rest[1] < -0.02
    duck = gains.duck if low else max(gains.duck, REACH_DUCK)
    back = rig.back[0]
    size = 0
    # A pelvis that is held where no leg reaches must not be looked at there.
    for k in range(3):
        for side in range(2):
            hips[side, k] = positions_ws[rig.limbs[2 + side, 0], k] - positions_ws[0, k]
    keep_pelvis_over_feet(
        rig, under.base.exact, st.points[0], hips, st.points, st.feet, st.planted, duck, False,
        not stepping and not over,
    )  # fmt: skip
    for round_ in range(ROUNDS + LAST_ROUNDS):
        last_word = round_ >= ROUNDS
        reconstruct_into(
            rig, under.base, st.points, st.turns, st.swivels, st.feet, st.feet_level, rotations_ls, positions_ws,
            rotations_ws,
        )  # fmt: skip
        for limb in range(4):
            if flags[1 + limb] > 0.5:
                # As far as its joints go: what they hold back weighs where it is.
                place_limb(rig, st, under, contacts.limits, limb, True, rotations_ls, positions_ws, rotations_ws)
            elif limb < 2:
                for k in range(3):
                    st.points[1 + limb, k] = positions_ws[rig.limbs[limb, 0], k] + arms[limb, k]
        center_of_mass_into(rig.masses, rig.mass_centers, positions_ws, rotations_ws, center)
        size = sole_polygon(rig, st.points, st.feet, st.support, hull)
        lean_room(rig, positions_ws, st.planted, st.heading[0], room)
        for k in range(3):
            start[k] = st.points[0, k]
            chest[k] = positions_ws[rig.neck[0], k]
            for side in range(2):
                hips[side, k] = positions_ws[rig.limbs[2 + side, 0], k] - st.points[0, k]
        for k in range(2):
            pelvis_weights[k], trunk_weights[k] = 0.0, 0.0
        most = 0.0
        # Tracking: the mean of what the held ends still lack.
        if not last_word:
            for k in range(3):
                shift[k] = 0.0
            lacking, arms_lacking = 0, 0
            for k in range(3):
                shoulder[k] = 0.0
            for limb in range(4):
                # (An end that a held elbow takes along asks for nothing.)
                if held.flags[1 + limb] > 0.5 and flags[1 + limb] > 0.5:
                    lack = root_shift(
                        st.points[1 + limb], positions_ws[rig.limbs[limb, 0]], under.base.exact[limb], part
                    )  # fmt: skip
                    if lack > 0.0:
                        most = max(most, lack)
                        lacking += 1
                        if limb < 2:
                            arms_lacking += 1
                            for k in range(3):
                                shoulder[k] += positions_ws[rig.limbs[limb, 0], k]
                        for k in range(3):
                            shift[k] += part[k]
            if lacking > 0:
                size_ = 0.0
                for k in range(3):
                    shift[k] /= lacking
                    size_ += shift[k] * shift[k]
                # In small strides: the legs' limits then turn the pelvis aside instead of pulling it down.
                stride = min(1.0, PULL / max(sqrt(size_), 1e-9))
                for k in range(3):
                    shift[k] *= stride
                    rest[k] = shift[k]
                if arms_lacking > 0 and trunk_free:
                    for k in range(3):
                        shoulder[k] /= arms_lacking
                    reach_with_trunk(
                        shift, shoulder, positions_ws[back], st.turns[0], st.heading[0],
                        under.turns[0], room, trunk_votes[0], rest,
                    )  # fmt: skip
                    trunk_weights[0] = gains.w_tracking
                    mul_inv(trunk_votes[0], st.turns[0], turn)
                    if rest[1] < 0.0:
                        # Down with the trunk first, then with the knees.
                        rest[1] *= 1.0 - 0.9 * min(1.0, angle(turn) / STILL_BENDS)
                if pelvis_free:
                    for k in range(3):
                        pelvis_votes[0, k] = st.points[0, k] + rest[k]
                    pelvis_weights[0] = gains.w_tracking
        # Balance, but not in the middle of a step, nor for a motion that nobody touches.
        if size > 0 and not stepping and not untouched:
            balance_shift(hull, size, center, gains.margin, shift)
            if over:
                # A motion may be out of balance by itself, as every walk is: only what is added counts.
                balance_shift(hull, size, under.center, gains.margin, part)
                for k in range(3):
                    shift[k] -= part[k]
            lack = sqrt(shift[0] ** 2 + shift[2] ** 2)
            if lack > 1e-6:
                most = max(most, lack)
                share = gains.pelvis_trunk
                if not trunk_free or last_word:
                    share = 1.0
                elif not pelvis_free:
                    share = 0.0
                if share > 0.0 and (pelvis_free or last_word):
                    pelvis_correction(shift, share, max(mass_share, 0.1), part)
                    for k in range(3):
                        pelvis_votes[1, k] = st.points[0, k] + part[k]
                    pelvis_weights[1] = gains.w_balance
                if share < 1.0:
                    trunk_correction(
                        shift, 1.0 - share, max(mass_share, 0.1), chest, positions_ws[back], st.turns[0],
                        trunk_votes[1],
                    )  # fmt: skip
                    trunk_weights[1] = gains.w_balance
        blend_point(pelvis_votes, pelvis_weights, start, st.points[0])
        if trunk_weights[0] + trunk_weights[1] > 0.0:
            for k in range(4):
                turn[k] = st.turns[0, k]
            blend_turn(trunk_votes, trunk_weights, turn, st.turns[0])
            keep_lean(st.turns[0], st.heading[0], under.turns[0], room)
        keep_pelvis_over_feet(
            rig, under.base.exact, st.points[0], hips, st.points, st.feet, st.planted, duck, last_word,
            not stepping and not over,
        )  # fmt: skip
        moved = 0.0
        for k in range(3):
            moved += (st.points[0, k] - start[k]) ** 2
        if most < ENOUGH and moved < 1e-8:
            break
    return size


@kernel
def hold_back(
    rig: Rig, gains: Gains, st: State, under: Under, flags: Array, aims_before: Array, pelvis: Array, trunk: Array,
    positions_ws: Array, dt: float,
) -> bool:  # fmt: skip
    """Let trunk and pelvis go to what tracking and balance agreed on only about as fast as the held ends move.

    The agreement may jump from one way of reaching to another; the body takes its time. True if it was held back.
    """
    moved = 0.0
    for limb in range(4):
        if flags[1 + limb] > 0.5:
            way = 0.0
            for k in range(3):
                way += (st.aims[1 + limb, k] - aims_before[1 + limb, k]) ** 2
            moved += sqrt(way)
    for side in range(2):
        if st.support[side] > 0.0 and st.planted[side] < 0.5:
            moved += SHIFT_WEIGHT * dt
    way = 0.0
    for k in range(3):
        way += (st.points[0, k] - pelvis[k]) ** 2
    q = np.empty(4)
    mul_inv(st.turns[0], trunk, q)
    most = min(1.0, (BODY_WAY * moved + BODY_SPEED * dt) / max(sqrt(way), 1e-9))
    most = min(most, (BODY_TURN * moved + BODY_SPIN * dt) / max(angle(q), 1e-9))
    if most >= 1.0:
        return False
    hips = np.empty((2, 3))
    for k in range(3):
        st.points[0, k] = pelvis[k] + most * (st.points[0, k] - pelvis[k])
        for side in range(2):
            hips[side, k] = positions_ws[rig.limbs[2 + side, 0], k] - positions_ws[0, k]
    slerp(trunk, st.turns[0], most, st.turns[0])
    keep_pelvis_over_feet(
        rig, under.base.exact, st.points[0], hips, st.points, st.feet, st.planted, gains.duck, False, True
    )  # fmt: skip
    return True


@kernel
def nothing_driven(st: State, flags: Array, held: Held, goals: Array, arms: Array) -> bool:
    """Whether nothing is held and every part is where its motion has it."""
    for n in range(held.flags.shape[0]):
        if held.flags[n] > 0.5:
            return False
    off = 0.0
    for k in range(3):
        off += abs(st.points[0, k] - goals[0, k])
        for limb in range(2):
            off += abs(arms[limb, k] - goals[1 + limb, k])
            off += abs(st.points[3 + limb, k] - goals[3 + limb, k])
    return off < 2e-3


@kernel
def turn_hinges(
    rig: Rig, gains: Gains, st: State, held: Held, under: Under, positions_ws: Array, rotations_ws: Array,
    before: Array, plain: Array, dt: float,
) -> None:  # fmt: skip
    """The swivels: the examples', the motion's difference from them, a held elbow or knee, collisions'.

    ``before`` (5, 3) are the points of the last step; ``plain`` (4) is written: where the swivels go without
    collisions.
    """
    axis, pole = np.empty(3), np.empty(3)
    for limb in range(4):
        upper = rig.limbs[limb, 0]
        parent = rotations_ws[rig.parents[upper]]
        goal = default_swivel(rig, limb, st.points[1 + limb], positions_ws[upper], parent)
        if limb >= 2 and under.active[0] < 0.5:
            goal -= 0.5 * wrap(twist_of(st.feet[limb - 2]) - st.heading[0])
        if held.flags[8 + limb] > 0.5:
            n = 0.0
            for k in range(3):
                axis[k] = st.points[1 + limb, k] - positions_ws[upper, k]
                pole[k] = held.hinges[limb, k] - positions_ws[upper, k]
                n += axis[k] * axis[k]
            n = max(sqrt(n), 1e-6)
            for k in range(3):
                axis[k] /= n
            along = axis[0] * pole[0] + axis[1] * pole[1] + axis[2] * pole[2]
            out = 0.0
            for k in range(3):
                out += (pole[k] - along * axis[k]) ** 2
            inv_rotate(parent, axis, axis)
            inv_rotate(parent, pole, pole)
            wanted = swivel_of(axis, pole, rig.references[limb, 0], rig.references[limb, 1])
            wanted -= under.swivels[limb]
            goal += min(1.0, sqrt(out) / 0.05) * wrap(wanted - goal)
        now = st.extra[limb]
        plain[limb] = under.swivels[limb] + now + wrap(goal - now)
        aim = np.array([now + wrap(goal + st.pushes[limb] - now)])
        spring_to_into(st.extra[limb : limb + 1], st.extra_rates[limb : limb + 1], aim, gains.swivel_half_life, dt)
        if st.mode[0] < 1.5:
            st.extra[limb], st.extra_rates[limb] = aim[0], 0.0
        elif held.flags[8 + limb] < 0.5:
            way = 0.0
            for k in range(3):
                way += (st.points[1 + limb, k] - positions_ws[upper, k] - before[1 + limb, k] + st.roots[limb, k]) ** 2
            most = SWIVEL_PER_WAY * sqrt(way) + SWIVEL_RATE * dt
            st.extra[limb] = now + min(most, max(-most, st.extra[limb] - now))
        st.swivels[limb] = under.swivels[limb] + st.extra[limb]


@kernel
def advance_packed(
    rig_ints: Index, rig_floats: Array, gains: Array, state: Array, held: Array, under: Array,
    contact_ints: Index, contact_floats: Array, mass_share: float, dt: float, hull: Array, center: Array,
    rotations_ls: Array, positions_ws: Array, rotations_ws: Array,
) -> int:  # fmt: skip
    """`advance` with every record packed into one or two arrays: handing over a hundred arrays takes longer
    than the step itself."""
    return advance(
        unpack_rig(rig_ints, rig_floats), unpack_gains(gains), unpack_state(state), unpack_held(held),
        unpack_under(under, rotations_ls.shape[0]),
        unpack_contacts(contact_ints, contact_floats, rotations_ls.shape[0]), mass_share, dt, hull, center,
        rotations_ls, positions_ws, rotations_ws,
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
    swivels_before, plain, aims_before = np.empty(4), np.empty(4), np.empty((5, 3))
    moved = np.empty(4)
    fresh = st.mode[0] < 0.5
    if fresh:
        start_standing(rig, st, under, positions_ws)
        find_goals(rig, st, under, goals, goal_turns)
        for _ in range(2):
            reconstruct_into(
                rig, under.base, st.points, st.turns, st.swivels, st.feet, st.feet_level, rotations_ls,
                positions_ws, rotations_ws,
            )  # fmt: skip
            shoulders_of(rig, positions_ws, st.roots)
            for limb in range(2):
                for k in range(3):
                    st.points[1 + limb, k] = st.roots[limb, k] + goals[1 + limb, k]
            turn_hinges(rig, gains, st, held, under, positions_ws, rotations_ws, before, plain, dt)
        for limb in range(4):
            for k in range(3):
                st.wishes[limb, k] = st.points[1 + limb, k]
        st.mode[0] = 2.0
    for n in range(5):
        for k in range(3):
            before[n, k] = st.points[n, k]
    for limb in range(4):
        swivels_before[limb] = st.swivels[limb]
    let_go = False
    for n in range(7):
        let_go = let_go or (st.held[n] > 0.5 and held.flags[n] < 0.5)
    if let_go:
        # What a held part drew along goes on as it moved.
        for k in range(3):
            st.velocities[0, k] = st.drifts[0, k]
            st.spins[0, k] = st.drifts[1, k]
    update_heading(gains, st, held, under, dt)
    find_goals(rig, st, under, goals, goal_turns)
    if st.mode[1] != under.active[0]:
        st.mode[1] = under.active[0]
        for limb in range(4):
            st.extra[limb] = st.swivels[limb] - under.swivels[limb]
        for k in range(3):
            st.pelvis_rest[k] = 0.0
        st.step[PHASE] = IDLE
        for n in range(5):
            for k in range(3):
                st.goals[n, k] = goals[n, k]
        for n in range(2):
            for k in range(4):
                st.goal_turns[n, k] = goal_turns[n, k]
    yaws = np.array([twist_of(st.feet[0]), twist_of(st.feet[1])])
    seek_step(rig, gains, st, held, over, goals)

    # Trunk and head.
    for n in range(2):
        carry_turn(st.turns[n], st.goal_turns[n], goal_turns[n])
        for k in range(4):
            trunk_before[n, k] = st.turns[n, k]
        if held.flags[5 + n] > 0.5:
            follow_turn(
                held.turns[n], st.target_turns[n], st.held[5 + n] < 0.5, st.turns[n], st.spins[n],
                st.turn_offsets[n], st.turn_offset_rates[n], 20.0, gains.half_life, dt,
            )  # fmt: skip
        else:
            relax_turn(
                st.turns[n], st.spins[n], goal_turns[n], gains.relax_trunk, gains.relax_time, gains.ease_time, dt
            )
        st.held[5 + n] = held.flags[5 + n]
    # Pelvis.
    stepping = st.step[PHASE] != IDLE
    flags[0] = 1.0 if held.flags[0] > 0.5 and not stepping else 0.0
    if over:
        for k in range(3):
            st.points[0, k] += goals[0, k] - st.goals[0, k]
    for k in range(3):
        carried[0, k] = st.points[0, k]
    if flags[0] > 0.5:
        follow_point(
            held.points[0], st.targets[0], st.held[0] < 0.5, st.points[0], st.aims[0], st.velocities[0],
            st.offsets[0], st.offset_rates[0], gains.input_speed, gains.half_life, dt,
        )  # fmt: skip
        for k in range(3):
            st.points[0, k] = st.aims[0, k]
    else:
        if st.held[0] > 0.5 and not stepping and not over:
            for k in range(3):
                st.pelvis_rest[k] += st.points[0, k] - goals[0, k]
                goals[0, k] = st.points[0, k]
        if gains.relax_pelvis > 0.0:
            nowhere, at_once = np.zeros(3), np.zeros(3)
            relax_point(st.pelvis_rest, at_once, nowhere, gains.relax_pelvis, gains.relax_time, 1e-6, dt)
        wanted, calm = np.empty(3), 1.0
        wanted_velocity(st.points[0], goals[0], gains.relax_reach, gains.relax_time, wanted)
        for side in range(2):
            if st.planted[side] > 0.5 and not over:
                pace = knee_pace(rig, 2 + side, positions_ws[rig.limbs[2 + side, 0]], st.points[3 + side], wanted)
                calm = min(calm, max(0.05, pace))
        relax_point(
            st.points[0], st.velocities[0], goals[0], calm * gains.relax_reach, gains.relax_time / calm,
            gains.ease_time, dt,
        )  # fmt: skip
    st.held[0] = flags[0]
    # Hands and feet; what a motion carries along does not count as moved.
    for n in range(5):
        for k in range(3):
            aims_before[n, k] = st.aims[n, k] if st.held[n] > 0.5 else st.points[n, k]
            if over:
                aims_before[n, k] += goals[0, k] - st.goals[0, k]
    move_ends(rig, gains, st, held, goals, over, positions_ws, carried, arms, flags, dt)
    if stepping:
        advance_step(
            st.step, st.points[0], st.points, yaws, st.planted, rig.ankle_heights, gains.step_lift,
            gains.step_time, gains.step_pace, dt,
        )  # fmt: skip
        for k in range(3):
            st.pelvis_rest[k] = 0.0 if k != 1 else st.pelvis_rest[k]
    turn_feet(rig, gains, st, under, yaws, dt)
    lean_room(rig, positions_ws, st.planted, st.heading[0], room)
    keep_lean(st.turns[0], st.heading[0], under.turns[0], room)
    sway_trunk(rig, gains, st, held, flags, aims_before, positions_ws)
    keep_lean(st.turns[0], st.heading[0], under.turns[0], room)
    for k in range(4):
        relaxed_trunk[k] = st.turns[0, k]
    for k in range(3):
        relaxed_pelvis[k] = st.points[0, k]
    keep_head(st, under)
    untouched = over and nothing_driven(st, flags, held, goals, arms)
    size = agree(
        rig, gains, st, held, under, contacts, untouched, arms, flags, mass_share, hull, center, rotations_ls,
        positions_ws, rotations_ws,
    )  # fmt: skip
    by_itself = flags[0] < 0.5 and held.flags[5] < 0.5 and not stepping and not over
    if by_itself and hold_back(
        rig, gains, st, under, flags, aims_before, relaxed_pelvis, relaxed_trunk, positions_ws, dt
    ):  # fmt: skip
        reconstruct_into(
            rig, under.base, st.points, st.turns, st.swivels, st.feet, st.feet_level, rotations_ls, positions_ws,
            rotations_ws,
        )  # fmt: skip
    if not over:
        sway_hands(rig, gains, st, flags, trunk_before[0], carried[0], arms, positions_ws)
        for limb in range(2):
            for k in range(3):
                if flags[1 + limb] < 0.5:
                    st.points[1 + limb, k] = positions_ws[rig.limbs[limb, 0], k] + arms[limb, k]
    turn_hinges(rig, gains, st, held, under, positions_ws, rotations_ws, before, plain, dt)
    reconstruct_into(
        rig, under.base, st.points, st.turns, st.swivels, st.feet, st.feet_level, rotations_ls, positions_ws,
        rotations_ws,
    )  # fmt: skip
    for limb in range(2):
        for k in range(3):
            if flags[1 + limb] < 0.5:
                st.points[1 + limb, k] = positions_ws[rig.limbs[limb, 0], k] + arms[limb, k]
    for limb in range(4):
        way = 0.0
        for k in range(3):
            if flags[1 + limb] > 0.5:
                way += (st.aims[1 + limb, k] - aims_before[1 + limb, k]) ** 2
            else:
                root = positions_ws[rig.limbs[limb, 0], k] - st.roots[limb, k]
                way += (st.points[1 + limb, k] - before[1 + limb, k] - root) ** 2
        # What is free moves only as fast as it relaxes.
        moved[limb] = sqrt(way) if flags[1 + limb] > 0.5 else min(sqrt(way), 0.3 * gains.relax_ends * dt)
    avoid(
        rig, gains, st, under, contacts, untouched, flags, swivels_before, plain, moved, rotations_ls, positions_ws,
        rotations_ws, dt,
    )  # fmt: skip

    # What the next step needs to know of this one.
    span = max(dt, 1.0 / 120.0)
    q, v = np.empty(4), np.empty(3)
    mul_inv(st.turns[0], trunk_before[0], q)
    log(q, v)
    for k in range(3):
        st.drifts[0, k] = (st.points[0, k] - carried[0, k]) / span
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
    for n in range(5):
        for k in range(3):
            st.goals[n, k] = goals[n, k]
    for n in range(2):
        for k in range(4):
            st.goal_turns[n, k] = goal_turns[n, k]
    center_of_mass_into(rig.masses, rig.mass_centers, positions_ws, rotations_ws, center)
    return size


@kernel
def take_away(velocity: Array, moved: Array, span: float) -> None:
    """Take from a relaxing velocity (3) what the other modules' movement (3) worked against, in place."""
    against, size = 0.0, 0.0
    for k in range(3):
        against += velocity[k] * moved[k] / span
        size += (moved[k] / span) ** 2
    if against < 0.0 and size > 1e-12:
        share = min(1.0, -against / size)
        for k in range(3):
            velocity[k] += share * moved[k] / span


@kernel
def keep_head(st: State, under: Under) -> None:
    """Keep the head within what the neck can do."""
    q, v = np.empty(4), np.empty(3)
    mul_inv(st.turns[1], st.turns[0], q)
    log(q, v)
    off = sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
    if off > 1.0 and under.active[0] < 0.5:
        for k in range(3):
            v[k] *= 1.0 / off
        exp(v, q)
        w = np.empty(4)
        for k in range(4):
            w[k] = st.turns[0, k]
        x1, y1, z1, w1 = q[0], q[1], q[2], q[3]
        x2, y2, z2, w2 = w[0], w[1], w[2], w[3]
        st.turns[1, 0] = w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2
        st.turns[1, 1] = w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2
        st.turns[1, 2] = w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2
        st.turns[1, 3] = w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2


@kernel
def seek_step(rig: Rig, gains: Gains, st: State, held: Held, over: bool, goals: Array) -> None:
    """Begin the step that was asked for, or one that lets the feet follow a turn."""
    if over or st.step[PHASE] != IDLE or st.planted[0] < 0.5 or st.planted[1] < 0.5:
        return
    if held.flags[3] > 0.5 or held.flags[4] > 0.5:
        return
    feet, home = foot_yaw(st), np.empty(3)
    pelvis_home(rig, st.points, st.support, feet, home)
    goal = np.empty(3)
    heading = feet
    if st.step[25] > 0.5:
        st.step[25] = 0.0
        way = sqrt((st.step[26] - home[0]) ** 2 + (st.step[28] - home[2]) ** 2)
        short = min(1.0, 0.9 / max(way, 1e-6))
        goal[0] = home[0] + short * (st.step[26] - home[0])
        goal[2] = home[2] + short * (st.step[28] - home[2])
        if st.step[30] > 0.5:
            heading = feet + min(YAW_MOST, max(-YAW_MOST, wrap(st.step[29] - feet)))
    else:
        if held.flags[7] < 0.5:
            return
        off = wrap(held.yaw[0] - feet)
        still = abs(st.heading[1]) < 0.05
        if abs(off) < YAW_REST or (abs(off) < YAW_STEP and not still):
            return
        goal[0], goal[2] = home[0], home[2]
        heading = feet + min(YAW_MOST, max(-YAW_MOST, off))
    goal[1] = 0.0
    begin_step(
        st.step, goal, feet, heading, st.points[0], home, st.points[3], st.points[4], gains.step_time,
        gains.step_pace,
    )  # fmt: skip
    st.held[0] = 0.0


@kernel
def sway_trunk(
    rig: Rig, gains: Gains, st: State, held: Held, flags: Array, aims_before: Array, positions_ws: Array
) -> None:
    """Interaction's vote on the trunk against relaxing's and balance's, which both vote for it as it is now."""
    moved = np.zeros(3)
    driven = False
    for limb in range(4):
        if flags[1 + limb] > 0.5 and held.flags[1 + limb] > 0.5:
            driven = True
            for k in range(3):
                moved[k] += st.aims[1 + limb, k] - aims_before[1 + limb, k]
    if not driven or held.flags[5] > 0.5:
        return
    n = sqrt(moved[0] ** 2 + moved[1] ** 2 + moved[2] ** 2)
    if n > 0.25:
        for k in range(3):
            moved[k] *= 0.25 / n
    votes, weights, turn = np.empty((3, 4)), np.empty(3), np.empty(4)
    for k in range(4):
        turn[k] = st.turns[0, k]
        votes[1, k], votes[2, k] = turn[k], turn[k]
    trunk_from_ends(
        moved, positions_ws[rig.neck[0]], positions_ws[rig.back[0]], gains.ee_to_trunk, turn, votes[0]
    )  # fmt: skip
    supported = st.support[0] > 0.0 or st.support[1] > 0.0
    weights[0], weights[1] = gains.w_interaction, gains.w_relaxing
    weights[2] = gains.w_balance if supported else 0.0
    blend_turn(votes, weights, turn, st.turns[0])


@kernel
def sway_hands(
    rig: Rig, gains: Gains, st: State, flags: Array, trunk_before: Array, pelvis_before: Array, arms: Array,
    positions_ws: Array,
) -> None:  # fmt: skip
    """Interaction's vote on free hands against relaxing's: the shoulders take them along, the trunk some more."""
    votes, weights, hand, shift, out = np.empty((2, 3)), np.empty(2), np.empty(3), np.empty(3), np.empty(3)
    weights[0], weights[1] = gains.w_interaction, gains.w_relaxing
    for k in range(3):
        shift[k] = st.points[0, k] - pelvis_before[k]
    for limb in range(2):
        if flags[1 + limb] > 0.5:
            continue
        root = positions_ws[rig.limbs[limb, 0]]
        for k in range(3):
            hand[k] = root[k] + arms[limb, k]
            votes[1, k] = hand[k]
        end_from_trunk(
            hand, positions_ws[rig.back[0]], trunk_before, st.turns[0], shift, gains.trunk_to_ee, votes[0]
        )  # fmt: skip
        blend_point(votes, weights, hand, out)
        for k in range(3):
            arms[limb, k] = out[k] - root[k]
