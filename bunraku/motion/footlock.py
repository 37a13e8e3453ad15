"""Feet that stay where they stand: a contact state machine over blended motion, inverse kinematics, soft release.

A foot is *free* and follows the blended motion, or *locked* on a footprint: there it rolls over heel and ball
with the blended pitch while the point on the ground does not move. Where a locked foot stands wrong for a figure that
stands still, it makes a small *settling* step. What changes of state differ by decays (inertialised), so
nothing jumps. The pelvis sinks as far as a planted leg needs to reach its print.
"""

from dataclasses import dataclass
from math import asin, atan2, cos, exp, pi, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.fk import fk_into
from bunraku.figure.jit import kernel
from bunraku.figure.limb import soft_reach
from bunraku.figure.quat import exp as quat_exp
from bunraku.figure.quat import from_axis_angle, log, mul, mul_inv, rotate, slerp
from bunraku.figure.skeleton import Index, Skeleton
from bunraku.figure.spring import LN2, spring_decay_into
from bunraku.motion.ground import roll, sole_of
from bunraku.motion.leg import move_leg

Array = NDArray[np.float64]

FREE_REACH, SOFT_FROM = 0.9985, 0.975
"""Shares of a leg: how straight a free one may be, and from where on it gets there softly."""

FREE, LOCKED, SETTLING, BARRED = 0, 1, 2, 3
"""Modes of a foot; a barred one was torn from its print and stays free until its contact ends."""


@dataclass(frozen=True)
class LockLimits:
    """Constants of the foot lock; lengths for a leg of 0.83 m."""

    release: float = 0.10  # s, half-life of what a released foot is behind
    touch: float = 0.05  # s, half-life of what a locked foot is above its print
    tear: float = 0.28  # m: a print farther than this from the blended foot is left
    settle: float = 0.045  # m: a standing foot farther than this from its place steps there
    settle_turn: float = 0.22  # rad, likewise
    settle_time: float = 0.30  # s, of a settling step, and 0.4 s a metre
    settle_lift: float = 0.035  # m
    reach: float = 0.995  # of the leg, locked
    rise: float = 0.15  # s, half-life of the pelvis's way back up
    ground: float = 0.05  # s, half-life of a swinging foot's following of the ground's height


LIMITS = LockLimits()


class Feet(NamedTuple):
    """A skeleton's legs and soles for the kernel; rows are left, right."""

    joints: Index  # (2, 4) thigh, shin, foot, toes (-1 for none)
    lengths: Array  # (2, 2) m
    soles: Array  # (2, 3) m: ankle height, heel, ball
    limits: Array  # (10,) LockLimits, lengths scaled


class FeetState(NamedTuple):
    """What the feet remember; arrays are changed in place. Rows are left, right."""

    mode: Index  # (2,)
    clock: Array  # (2, 2) s into a settling step; its duration
    prints: Array  # (2, 5) x, y, z m of the flat ankle on the ground; yaw; slope (rad, toes up)
    offset: Array  # (2, 6) m and rad, between where the foot is and where its mode wants it
    velocity: Array  # (2, 6) of that
    blended: Array  # (2, 3) m, the blended ankle of the frame before
    turned: Array  # (2, 4) its orientation
    goal: Array  # (2, 7) where the foot was wanted in the frame before, without its offset
    start: Array  # (2, 7) where a settling step began
    grip: Array  # (2,) 0..1, how much the toes are flat on the ground
    ground: Array  # (2, 2) m, ground height under the free feet and its speed
    drop: Array  # (2,) m, how far the pelvis is lowered; whether the state holds a frame yet


def feet_of(skeleton: Skeleton, limits: LockLimits = LIMITS) -> Feet:
    """Legs and soles of a humanoid skeleton."""
    joints, lengths, soles = np.empty((2, 4), dtype=np.int64), np.empty((2, 2)), np.empty((2, 3))
    rest = skeleton.rest_positions
    for side, name in enumerate(("left", "right")):
        hip, knee, foot = (skeleton.role(name + part) for part in ("UpperLeg", "LowerLeg", "Foot"))
        sole = sole_of(skeleton, name)
        joints[side] = hip, knee, foot, sole.toes
        lengths[side] = np.linalg.norm(rest[knee] - rest[hip]), np.linalg.norm(rest[foot] - rest[knee])
        soles[side] = sole.height, sole.heel, sole.ball
    size = float(lengths.sum(axis=1).mean()) / 0.83
    row = [limits.release, limits.touch, limits.tear * size, limits.settle * size, limits.settle_turn,
           limits.settle_time, limits.settle_lift * size, limits.reach, limits.rise, limits.ground]  # fmt: skip
    return Feet(joints, lengths, soles, np.array(row))


def feet_state() -> FeetState:
    """Nothing remembered."""
    still = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (2, 1))
    return FeetState(
        mode=np.zeros(2, dtype=np.int64), clock=np.zeros((2, 2)), prints=np.zeros((2, 5)), offset=np.zeros((2, 6)),
        velocity=np.zeros((2, 6)), blended=np.zeros((2, 3)), turned=still[:, 3:].copy(), goal=still.copy(),
        start=still.copy(), grip=np.zeros(2), ground=np.zeros((2, 2)), drop=np.zeros(2),
    )  # fmt: skip


@kernel
def yaw_pitch(q: Array, out: Array) -> None:
    """Heading and pitch (rad, toes up) of a foot's forward axis."""
    v = np.empty(3)
    v[0], v[1], v[2] = 0.0, 0.0, 1.0
    rotate(q, v, v)
    out[0] = atan2(v[0], v[2])
    out[1] = asin(min(1.0, max(-1.0, v[1])))


@kernel
def planted(feet: Feet, side: int, mark: Array, pitch: float, position: Array, turn: Array) -> None:
    """Ankle position (3) and foot orientation (4) of a foot rolled by ``pitch`` (rad) over its print ``mark`` (5)."""
    out, a, b = np.empty(2), np.empty(4), np.empty(4)
    roll(feet.soles[side, 0], feet.soles[side, 1], feet.soles[side, 2], pitch, out)
    slope = mark[4]
    up = out[0] * cos(slope) + out[1] * sin(slope)
    ahead = out[1] * cos(slope) - out[0] * sin(slope)
    position[0] = mark[0] + ahead * sin(mark[3])
    position[1] = mark[1] + up
    position[2] = mark[2] + ahead * cos(mark[3])
    from_axis_angle(0.0, 1.0, 0.0, mark[3], a)
    from_axis_angle(1.0, 0.0, 0.0, -(pitch + slope), b)
    mul(a, b, turn)


@kernel
def pivot_shift(feet: Feet, side: int, pitch: float, turn: Array, offset: Array, out: Array) -> None:
    """How far (3, m) the ankle goes along when a planted foot turns by ``offset[3:6]`` about what it stands on."""
    q = np.empty(4)
    a, b = np.empty(3), np.empty(3)
    a[0], a[1] = 0.0, -feet.soles[side, 0]
    a[2] = feet.soles[side, 1] if pitch >= 0.0 else feet.soles[side, 2]
    rotate(turn, a, a)
    quat_exp(offset[3:6], q)
    rotate(q, a, b)
    for k in range(3):
        out[k] = a[k] - b[k]


@kernel
def wrap(angle: float) -> float:
    return angle - 2.0 * pi * np.floor((angle + pi) / (2.0 * pi))  # type: ignore[no-any-return]


@kernel
def foot_target(
    feet: Feet, state: FeetState, side: int, contact: float, still: bool, position: Array, turn: Array, dt: float,
    goal: Array, goal_turn: Array,
) -> None:  # fmt: skip
    """One foot's step of the state machine: where the ankle is to be (3) and how the foot is turned (4).

    Args:
        contact: > 0 where the blended motion has the foot on the ground.
        still: the figure stands: locked feet that stand wrong may settle.
        position, turn: the blended ankle, raised by the ground's height, and foot.
    """
    limits = feet.limits
    angles, v, spin, rolling, shift = np.empty(2), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    q = np.empty(4)
    yaw_pitch(turn, angles)
    mul_inv(turn, state.turned[side], q)
    log(q, spin)
    for k in range(3):
        v[k] = (position[k] - state.blended[side, k]) / max(dt, 1e-9)
        spin[k] = spin[k] / max(dt, 1e-9)
    mode = state.mode[side]
    # Where the foot is wanted before any change of mode, with what it is off by.
    if mode == LOCKED:
        planted(feet, side, state.prints[side], angles[1], goal, goal_turn)
    elif mode == SETTLING:
        state.clock[side, 0] += dt
        t = min(1.0, state.clock[side, 0] / state.clock[side, 1])
        s = t * t * t * (10.0 - 15.0 * t + 6.0 * t * t)
        for k in range(3):
            goal[k] = state.start[side, k] + s * (position[k] - state.start[side, k])
        goal[1] += limits[6] * sin(pi * t) * sin(pi * t)
        slerp(state.start[side, 3:7], turn, s, goal_turn)
        if t >= 1.0:
            state.mode[side] = FREE
    else:
        for k in range(3):
            goal[k] = position[k]
        for k in range(4):
            goal_turn[k] = turn[k]
    mode = state.mode[side]
    if mode == LOCKED:
        away = sqrt((goal[0] - position[0]) ** 2 + (goal[2] - position[2]) ** 2)
        twist = abs(wrap(state.prints[side, 3] - angles[0]))
        leave = FREE if contact <= 0.0 else -1
        if away > limits[2] or twist > 1.25:
            leave = BARRED if contact > 0.0 and not still else leave
        other = state.mode[1 - side]
        if still and leave < 0 and other == LOCKED and (away > limits[3] or twist > limits[4]):
            # The one that stands worse goes first.
            state.mode[side] = SETTLING
            state.clock[side, 0] = 0.0
            state.clock[side, 1] = limits[5] + 0.4 * away
            pivot_shift(feet, side, angles[1], goal_turn, state.offset[side], shift)
            for k in range(3):
                state.start[side, k] = goal[k] + shift[k]
            for k in range(4):
                state.start[side, 3 + k] = goal_turn[k]
        elif leave >= 0:
            state.mode[side] = leave
            pivot_shift(feet, side, angles[1], goal_turn, state.offset[side], shift)
            for k in range(3):
                state.offset[side, k] += goal[k] + shift[k] - position[k]
                state.velocity[side, k] += (goal[k] - state.goal[side, k]) / max(dt, 1e-9) - v[k]
            mul_inv(goal_turn, state.goal[side, 3:7], q)
            log(q, rolling)
            for k in range(3):
                state.velocity[side, 3 + k] += rolling[k] / max(dt, 1e-9) - spin[k]
            mul_inv(goal_turn, turn, q)
            quat_exp(state.offset[side, 3:6], goal_turn)
            mul(goal_turn, q, q)
            log(q, state.offset[side, 3:6])
            for k in range(3):
                goal[k] = position[k]
            for k in range(4):
                goal_turn[k] = turn[k]
    elif mode == BARRED:
        if contact <= 0.0:
            state.mode[side] = FREE
    elif mode == FREE and contact > 0.0:
        # Lock: the print lies under where the foot really is, so that nothing moves along the ground.
        real, here, sole = np.empty(4), np.empty(3), np.empty(3)
        quat_exp(state.offset[side, 3:6], q)
        mul(q, goal_turn, real)
        for k in range(3):
            here[k] = goal[k] + state.offset[side, k]
        # The roll goes on as the blended foot's pitch does.
        yaw_pitch(state.turned[side], angles)
        before = angles[1]
        yaw_pitch(turn, angles)
        pitch = angles[1]
        pivot = feet.soles[side, 1] if pitch >= 0.0 else feet.soles[side, 2]
        sole[0], sole[1], sole[2] = 0.0, -feet.soles[side, 0], pivot
        rotate(real, sole, sole)
        yaw_pitch(real, angles)
        state.prints[side, 3] = angles[0]
        state.prints[side, 0] = here[0] + sole[0] - pivot * sin(angles[0])
        state.prints[side, 1] = state.ground[side, 0]
        state.prints[side, 2] = here[2] + sole[2] - pivot * cos(angles[0])
        state.prints[side, 4] = 0.0
        planted(feet, side, state.prints[side], before, goal, goal_turn)
        rising = state.velocity[side, 1] + v[1] + goal[1] / max(dt, 1e-9)
        planted(feet, side, state.prints[side], pitch, goal, goal_turn)
        rising -= goal[1] / max(dt, 1e-9)
        mul_inv(real, goal_turn, q)
        log(q, state.offset[side, 3:6])
        pivot_shift(feet, side, pitch, goal_turn, state.offset[side], shift)
        for k in range(3):
            state.offset[side, k] = 0.0
            state.velocity[side, k] = 0.0
            state.velocity[side, 3 + k] = 0.0
        state.offset[side, 1] = here[1] - goal[1] - shift[1]
        state.velocity[side, 1] = max(min(rising, 0.0), -1.0)
        state.mode[side] = LOCKED
    for k in range(3):
        state.blended[side, k] = position[k]
    for k in range(4):
        state.turned[side, k] = turn[k]
    for k in range(3):
        state.goal[side, k] = goal[k]
    for k in range(4):
        state.goal[side, 3 + k] = goal_turn[k]
    half_life = limits[1] if state.mode[side] == LOCKED else limits[0]
    spring_decay_into(state.offset[side], state.velocity[side], half_life, dt)
    if state.mode[side] == LOCKED and state.offset[side, 1] < 0.0:
        state.offset[side, 1] = 0.0  # never into the ground
        state.velocity[side, 1] = max(state.velocity[side, 1], 0.0)
    if state.mode[side] == LOCKED:
        yaw_pitch(turn, angles)
        pivot_shift(feet, side, angles[1], goal_turn, state.offset[side], shift)
    else:
        shift[0], shift[1], shift[2] = 0.0, 0.0, 0.0
    for k in range(3):
        goal[k] += state.offset[side, k] + shift[k]
    quat_exp(state.offset[side, 3:6], q)
    mul(q, goal_turn, goal_turn)


@kernel
def plant_into(
    feet: Feet, state: FeetState, parents: Index, offsets: Array, root: Array, rotations_ls: Array,
    positions_ws: Array, rotations_ws: Array, contact: Array, heights: Array, still: bool, active: bool, dt: float,
) -> float:  # fmt: skip
    """Hold a blended pose's planted feet, in place: ``root`` may sink, the legs are solved anew.

    Args:
        root: (3) m; its height is over level ground plus the ground's under the figure.
        contact: (2) in: > 0 where the blended motion has the foot down; out: 1 where it is locked, else 0.
        heights: (3) m, the ground under the left and right blended foot and what ``root`` was raised by.
        active: hold feet at all.

    Returns:
        How far beyond its reach a locked foot was wanted after the pelvis sank, m (0 unless the ground is too steep).
    """
    fk_into(parents, offsets, root, rotations_ls, positions_ws, rotations_ws)
    goals, turns = np.empty((2, 3)), np.empty((2, 4))
    position, turn = np.empty(3), np.empty(4)
    fresh = state.drop[1] == 0.0
    state.drop[1] = 1.0
    for side in range(2):
        foot = feet.joints[side, 2]
        if fresh:
            state.ground[side, 0] = heights[side]
            state.ground[side, 1] = 0.0
        else:
            y = 2.0 * LN2 / feet.limits[9]
            e = exp(-y * dt)
            d = state.ground[side, 0] - heights[side]
            j = state.ground[side, 1] + d * y
            state.ground[side, 0] = heights[side] + e * (d + j * dt)
            state.ground[side, 1] = e * (state.ground[side, 1] - j * y * dt)
        for k in range(3):
            position[k] = positions_ws[foot, k]
        position[1] += state.ground[side, 0] - heights[2]
        for k in range(4):
            turn[k] = rotations_ws[foot, k]
        if fresh:
            for k in range(3):
                state.blended[side, k] = position[k]
                state.goal[side, k] = position[k]
            for k in range(4):
                state.turned[side, k] = turn[k]
                state.goal[side, 3 + k] = turn[k]
        wanted = contact[side] if active else -1.0
        foot_target(feet, state, side, wanted, still, position, turn, dt, goals[side], turns[side])
    # Sink as far as the legs need.
    need = 0.0
    for side in range(2):
        if state.mode[side] != LOCKED and state.mode[side] != SETTLING:
            continue
        hip = feet.joints[side, 0]
        most = feet.limits[7] * (feet.lengths[side, 0] + feet.lengths[side, 1])
        away = (goals[side, 0] - positions_ws[hip, 0]) ** 2 + (goals[side, 2] - positions_ws[hip, 2]) ** 2
        below = sqrt(max(most * most - away, 0.0))
        need = max(need, positions_ws[hip, 1] - goals[side, 1] - below)
    back = state.drop[0] * exp(-LN2 * dt / feet.limits[8])
    state.drop[0] = max(need, back)
    if state.drop[0] > 0.0:
        root[1] -= state.drop[0]
        for joint in range(parents.shape[0]):
            positions_ws[joint, 1] -= state.drop[0]
    beyond = 0.0
    flat, bent, toes_ls = np.empty(4), np.empty(2), np.empty(4)
    for side in range(2):
        upper, lower = feet.lengths[side, 0], feet.lengths[side, 1]
        most = feet.limits[7] * (upper + lower)
        if state.mode[side] != LOCKED:
            # A free leg may be as straight as the blended motion has it; what is farther off it nears softly.
            most = FREE_REACH * (upper + lower)
            hip, foot = feet.joints[side, 0], feet.joints[side, 2]
            own, far = 0.0, 0.0
            for k in range(3):
                own += (positions_ws[foot, k] - positions_ws[hip, k]) ** 2
                far += (goals[side, k] - positions_ws[hip, k]) ** 2
            own, far = min(sqrt(own), most - 1e-3), max(sqrt(far), 1e-9)
            near = soft_reach(far, most, 0.0, max(own / most, SOFT_FROM))
            for k in range(3):
                goals[side, k] = positions_ws[hip, k] + (goals[side, k] - positions_ws[hip, k]) * near / far
        over = move_leg(
            parents, feet.joints[side], positions_ws, rotations_ws, rotations_ls, goals[side], turns[side],
            upper, lower, most,
        )  # fmt: skip
        locked = state.mode[side] == LOCKED
        if locked:
            beyond = max(beyond, over)
        state.grip[side] += (1.0 - exp(-LN2 * dt / 0.04)) * ((1.0 if locked else 0.0) - state.grip[side])
        toes = feet.joints[side, 3]
        if toes >= 0:
            foot = feet.joints[side, 2]
            if state.grip[side] > 1e-3:
                yaw_pitch(turns[side], bent)
                up = min(max(-(bent[1] - state.prints[side, 4]), 0.0), 1.0)
                from_axis_angle(1.0, 0.0, 0.0, -up, flat)
                slerp(rotations_ls[toes], flat, state.grip[side], toes_ls)
                for k in range(4):
                    rotations_ls[toes, k] = toes_ls[k]
            mul(rotations_ws[foot], rotations_ls[toes], rotations_ws[toes])
            rotate(rotations_ws[foot], offsets[toes], position)
            for k in range(3):
                positions_ws[toes, k] = positions_ws[foot, k] + position[k]
        contact[side] = 1.0 if locked else 0.0
    return beyond
