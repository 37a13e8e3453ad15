"""Where every part rests: at ease over its feet, or where the motion has it (the goals of relaxing)."""

from math import cos, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel
from bunraku.figure.rig import Rig
from bunraku.nodes.controller.legs import landing_place, pelvis_home, sink_to_land
from bunraku.nodes.controller.relaxing import yaw_turn
from bunraku.nodes.controller.state import State, Under

Array = NDArray[np.float64]

HANG = (0.17, -0.97, 0.10)
"""Direction of the left arm at rest."""
DOWN = 1e-3
"""m above its standing height up to which a free foot is down."""
EASE_WIDTH, DRAW_IN = 0.19, 0.1
"""m between feet at ease, and the share of its way there by which a foot that cannot stand is asked on."""


@kernel
def hanging_arm(rig: Rig, limb: int, heading: float, out: Array) -> None:
    """From shoulder to hand (3, m) with the arm at rest: at the side, a little bent."""
    sign = 1.0 if limb == 0 else -1.0
    x, y, z = sign * HANG[0], HANG[1], HANG[2]
    n = rig.reach[limb, 1] * 0.985 / sqrt(x * x + y * y + z * z)
    c, s = cos(heading), sin(heading)
    out[0], out[1], out[2] = n * (c * x + s * z), n * y, n * (c * z - s * x)


@kernel
def draw_beside(side: int, other: Array, heading: float, out: Array) -> None:
    """Bring a foot's goal (3, m, in place) nearer to beside the ``other`` foot (3, m), a hip's width apart."""
    aside = EASE_WIDTH if side == 0 else -EASE_WIDTH
    out[0] += DRAW_IN * (other[0] + cos(heading) * aside - out[0])
    out[2] += DRAW_IN * (other[2] - sin(heading) * aside - out[2])


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
            down = st.landed[limb] < -0.5 or st.points[3 + limb, 1] <= rig.ankle_heights[limb] + DOWN
            if st.planted[limb] < 0.5 and down:
                # Down as far as it goes, and yet it cannot stand there: on to where legs stand at ease.
                draw_beside(limb, st.points[3 + other], heading, goals[3 + limb])
        else:
            landing_place(rig, limb, st.points[3 + limb], st.points[0], False, heading, goals[3 + limb])
    for limb in range(2):
        if st.planted[limb] < 0.5 and st.planted[1 - limb] > 0.5:
            free = st.held[3 + limb] < 0.5
            goals[0, 1] -= sink_to_land(rig, limb, st.points[3 + limb], goals[3 + limb], goals[0], heading, free)
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
