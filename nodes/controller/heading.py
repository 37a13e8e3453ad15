"""Which way the figure faces, how its feet stand, and when they step to follow."""

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel, kernel_inline
from bunraku.figure.pointpose import level_weight
from bunraku.figure.quat import slerp
from bunraku.figure.rig import Rig
from bunraku.figure.spring import lag
from bunraku.nodes.controller.legs import pelvis_home
from bunraku.nodes.controller.relaxing import move_with, twist_of, yaw_turn
from bunraku.nodes.controller.state import Gains, Held, State, Under
from bunraku.nodes.controller.step import HEADING, IDLE, PHASE, begin_step, wrap

Array = NDArray[np.float64]

YAW_STEP, YAW_REST, YAW_MOST = 0.40, 0.10, 0.75
"""rad: twist against the feet that makes them step while turning, when turned; most per step."""
HIP_TWIST = 0.60
"""rad that the hips turn over planted feet."""


@kernel
def foot_yaw(st: State) -> float:
    """The heading (rad) half-way between both feet."""
    left = twist_of(st.feet[0])
    return left + 0.5 * wrap(twist_of(st.feet[1]) - left)


@kernel_inline
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


@kernel_inline
def turn_feet(
    rig: Rig, gains: Gains, st: State, under: Under, yaws: Array, before: Array, aims_before: Array, dt: float
) -> None:
    """How each foot stands and how much of that the ground decides; how much it supports.

    ``before`` (5, 3) m are the points of the last step, ``aims_before`` (5, 3) m where they were wanted.
    """
    over = under.active[0] > 0.5
    facing = np.empty(4)
    for side in range(2):
        height = st.points[3 + side, 1] - rig.ankle_heights[side]
        if st.held[3 + side] > 0.5:
            # Of a foot that does not get to where it is held, its own height counts.
            height += before[3 + side, 1] - aims_before[3 + side, 1]
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
