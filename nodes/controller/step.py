"""Step motion: shift the weight, one foot, the other foot (Oshita 2013 section 6.6; Wu, Medina, Zordan 2008).

The trajectories are straight lines with the speed of a reaching movement (minimum jerk), the feet lifted on
the way; durations grow with the length. Both feet keep their place relative to the pelvis (eq. 29); the
foot nearer to the goal goes first. Turning on the spot is the same with feet that go round the middle.
"""

from math import cos, pi, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel

Array = NDArray[np.float64]

# Rows of State.step
PHASE, TIME, DURATION, FIRST = 0, 1, 2, 3
GOAL, LEFT, RIGHT, HEADING = 4, 7, 10, 13  # pelvis (x, z used), left foot, right foot (3 each), rad
FROM, TO, FOOT, FOOT_YAW, LIFT = 14, 17, 20, 23, 24  # pelvis of this phase (3 each), foot's start (3), its yaw
IDLE, PREPARE, SWING_FIRST, SWING_SECOND = 0.0, 1.0, 2.0, 3.0
OVER_SUPPORT = 0.6
"""How far the preparation brings the pelvis over the first supporting foot."""


@kernel
def minimum_jerk(s: float) -> float:
    """Progress 0..1 of a reaching movement at time share ``s`` 0..1."""
    s = min(1.0, max(0.0, s))
    return s * s * s * (10.0 + s * (6.0 * s - 15.0))


@kernel
def wrap(angle: float) -> float:
    """The angle in -pi..pi."""
    return angle - 2.0 * pi * np.floor((angle + pi) / (2.0 * pi))  # type: ignore[no-any-return]


@kernel
def foot_goal(pelvis_goal: Array, foot: Array, pelvis: Array, turn: float, out: Array) -> None:
    """Where a foot goes (eq. 29), its place against the pelvis turned by ``turn`` (rad)."""
    c, s = cos(turn), sin(turn)
    dx, dz = foot[0] - pelvis[0], foot[2] - pelvis[2]
    out[0] = pelvis_goal[0] + c * dx + s * dz
    out[1] = foot[1]
    out[2] = pelvis_goal[2] - s * dx + c * dz


@kernel
def first_foot(goal: Array, left: Array, right: Array) -> int:
    """The foot nearer to the goal goes first: 0 left, 1 right."""
    dl = (goal[0] - left[0]) ** 2 + (goal[2] - left[2]) ** 2
    dr = (goal[0] - right[0]) ** 2 + (goal[2] - right[2]) ** 2
    return 0 if dl <= dr else 1


@kernel
def _phase(
    step: Array, phase: float, pelvis: Array, to_x: float, to_z: float, way: float, least: float, pace: float
) -> None:
    step[PHASE], step[TIME] = phase, 0.0
    step[FROM], step[FROM + 1], step[FROM + 2] = pelvis[0], pelvis[1], pelvis[2]
    step[TO], step[TO + 2] = to_x, to_z
    step[DURATION] = least + pace * way


@kernel
def begin_step(
    step: Array, goal: Array, heading_now: float, heading: float, pelvis: Array, home: Array, left: Array,
    right: Array, least: float, pace: float,
) -> None:  # fmt: skip
    """Plan a step of the pelvis (3, m; its height is not used) to ``goal`` with the heading there.

    Args:
        pelvis: (3) where it is; ``home`` (3) where it stands over its feet, from which they are measured.
        left, right: (3) m, the ankles.
    """
    turn = wrap(heading - heading_now)
    step[GOAL], step[GOAL + 2] = goal[0], goal[2]
    foot_goal(goal, left, home, turn, step[LEFT : LEFT + 3])
    foot_goal(goal, right, home, turn, step[RIGHT : RIGHT + 3])
    side = first_foot(goal, left, right)
    if (goal[0] - home[0]) ** 2 + (goal[2] - home[2]) ** 2 < 0.0025:
        side = 0 if turn > 0.0 else 1  # on the spot: the foot on the side of the turn opens
    step[FIRST], step[HEADING] = float(side), heading
    over = right if side == 0 else left
    x = pelvis[0] + OVER_SUPPORT * (over[0] - pelvis[0])
    z = pelvis[2] + OVER_SUPPORT * (over[2] - pelvis[2])
    way = sqrt((x - pelvis[0]) ** 2 + (z - pelvis[2]) ** 2)
    _phase(step, PREPARE, pelvis, x, z, way, 0.6 * least, pace)


@kernel
def advance_step(
    step: Array, pelvis: Array, points: Array, yaws: Array, planted: Array, ankle_heights: Array, lift: float,
    least: float, pace: float, dt: float,
) -> None:  # fmt: skip
    """One step in time: moves the pelvis's x and z, the swinging foot (3) and its yaw, and plants it.

    Args:
        points: (5, 3) m, changed in the rows of the feet.
        yaws: (2) rad, changed likewise; planted: (2).
    """
    left_over = dt
    for _ in range(4):
        if step[PHASE] == IDLE:
            return
        used = min(left_over, step[DURATION] - step[TIME])
        step[TIME] += used
        left_over -= used
        s = minimum_jerk(step[TIME] / step[DURATION])
        pelvis[0] = step[FROM] + s * (step[TO] - step[FROM])
        pelvis[2] = step[FROM + 2] + s * (step[TO + 2] - step[FROM + 2])
        first = int(step[FIRST])
        side = first if step[PHASE] == SWING_FIRST else 1 - first
        goal = LEFT if side == 0 else RIGHT
        if step[PHASE] != PREPARE:
            for k in range(0, 3, 2):
                points[3 + side, k] = step[FOOT + k] + s * (step[goal + k] - step[FOOT + k])
            rise = sin(pi * s)
            start = step[FOOT + 1] - ankle_heights[side]
            points[3 + side, 1] = ankle_heights[side] + start * (1.0 - s) + step[LIFT] * rise * rise
            yaws[side] = step[FOOT_YAW] + s * wrap(step[HEADING] - step[FOOT_YAW])
        if step[TIME] < step[DURATION] - 1e-9:
            return
        if step[PHASE] != PREPARE:
            planted[side] = 1.0
            points[3 + side, 1] = ankle_heights[side]
        if step[PHASE] == SWING_SECOND:
            step[PHASE] = IDLE
            return
        following = first if step[PHASE] == PREPARE else 1 - first
        planted[following] = 0.0
        goal = LEFT if following == 0 else RIGHT
        way = 0.0
        for k in range(3):
            step[FOOT + k] = points[3 + following, k]
            if k != 1:
                way += (step[goal + k] - points[3 + following, k]) ** 2
        step[FOOT_YAW] = yaws[following]
        step[LIFT] = lift
        if step[PHASE] == PREPARE:
            x, z = 0.5 * (pelvis[0] + step[GOAL]), 0.5 * (pelvis[2] + step[GOAL + 2])
            _phase(step, SWING_FIRST, pelvis, x, z, sqrt(way), least, pace)
        else:
            _phase(step, SWING_SECOND, pelvis, step[GOAL], step[GOAL + 2], sqrt(way), least, pace)
