"""Hands and feet: held ones go to their targets, free ones toward rest."""

from math import cos, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel
from bunraku.figure.rig import Rig
from bunraku.figure.spring import spring_to_into
from bunraku.nodes.controller.over import ease_point
from bunraku.nodes.controller.relaxing import carry_hand, relax_hand
from bunraku.nodes.controller.state import Gains, Held, State
from bunraku.nodes.controller.step import IDLE, PHASE
from bunraku.nodes.controller.tracking import follow_point

Array = NDArray[np.float64]

UNPLANT = 0.01
"""m that a held foot is pulled before it leaves its place."""
KNEE_LIFT = 0.10
"""m that a held knee is pulled before it lifts its foot."""
NEAR_ROOT = 0.5
"""Share of the upper bone from its root within which the place of a held elbow or knee counts less."""
STUCK, DETOUR = 0.3, 3.0
"""s after which an arm that something stops goes round it, and how far out."""
TREAD = 1.5e-3
"""m below the ground to where a foot comes down, so that it gets there before long."""


@kernel
def held_hinge(rig: Rig, st: State, limb: int, held: Held, positions_ws: Array, out: Array) -> None:
    """Where a limb's end goes (3, m) when its elbow or knee is held: the bone beyond keeps its direction.

    That is, as the figure sees it: the direction turns with the heading.
    """
    upper, lower, end = rig.limbs[limb, 0], rig.limbs[limb, 1], rig.limbs[limb, 2]
    c, s = cos(st.heading[0]), sin(st.heading[0])
    if st.held[8 + limb] < 0.5:
        for k in range(3):
            out[k] = positions_ws[end, k] - positions_ws[lower, k]
        st.beyond[limb, 0], st.beyond[limb, 1] = c * out[0] - s * out[2], out[1]
        st.beyond[limb, 2] = s * out[0] + c * out[2]
        st.held[8 + limb] = 1.0
    d = 0.0
    for k in range(3):
        out[k] = held.hinges[limb, k] - positions_ws[upper, k]
        d += out[k] * out[k]
    # Near the shoulder or hip itself a place says little about the direction: the bone stays about as it is.
    near = max(0.0, 1.0 - sqrt(d) / (NEAR_ROOT * rig.lengths[limb, 0]))
    d = 0.0
    for k in range(3):
        out[k] += near * (positions_ws[lower, k] - positions_ws[upper, k])
        d += out[k] * out[k]
    d = max(sqrt(d), 1e-6)
    for k in range(3):
        out[k] = positions_ws[upper, k] + out[k] * rig.lengths[limb, 0] / d
    out[0] += c * st.beyond[limb, 0] + s * st.beyond[limb, 2]
    out[1] += st.beyond[limb, 1]
    out[2] += c * st.beyond[limb, 2] - s * st.beyond[limb, 0]


@kernel
def move_ends(
    rig: Rig, gains: Gains, st: State, held: Held, goals: Array, over: bool, ways: Array, positions_ws: Array,
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
        elif over and limb < 2:
            # (What a touch has left of it evens out joint by joint: `even_limbs`.)
            arms[limb] = goals[row]
            st.velocities[row] = 0.0
        elif over:
            ease_point(ways[row], st.velocities[row], goals[row], gains.motion_half_life, dt, st.points[row])
        elif limb < 2:
            for k in range(3):
                arms[limb, k] = st.points[row, k] - st.roots[limb, k]
                if st.held[row] > 0.5:
                    st.wishes[limb, k] = st.points[row, k]
            carry_hand(arms[limb], st.goals[row], goals[row])
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
        elif st.planted[limb - 2] < 0.5 and st.step[PHASE] == IDLE:
            side = limb - 2
            for k in range(3):
                aim[k] = goals[row, k]
                if st.held[row] > 0.5:
                    st.wishes[limb, k] = st.points[row, k]
            aim[1] -= TREAD
            spring_to_into(st.points[row], st.velocities[row], aim, gains.landing_half_life, dt)
            # Not where limits hold the leg off: it goes on in to where it can stand.
            st.points[row, 1] = max(st.points[row, 1], rig.ankle_heights[side])
            if st.points[row, 1] <= rig.ankle_heights[side] and (st.landed[side] > 0.5 or over):
                st.planted[side] = 1.0
                for k in range(3):
                    st.velocities[row, k] = 0.0
        st.held[row] = flags[row]
