"""Feet that stay where they stand: a contact state machine over blended motion, inverse kinematics, soft release.

A foot is *free* and follows the blended motion, or *locked* on a footprint: there it rolls over heel and ball
with the blended pitch while the point on the ground does not move. Where a locked foot stands wrong for a figure that
stands still, it makes a small *settling* step. Nothing jumps: what a leg that is let go differs by from the blended
one dies away as the direction from hip to ankle, the knee's bend and the foot's turn, because a nearly
straight knee would make a jerk of what is smooth as a place of the ankle. The pelvis sinks, softly, as far as a planted
leg needs to reach its print.
"""

from dataclasses import dataclass
from math import exp, log1p, pi, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.fk import fk_into
from bunraku.figure.jit import kernel
from bunraku.figure.limb import flexed_distance, flexion_of, soft_reach
from bunraku.figure.limits import limits_of
from bunraku.figure.quat import between, log, mul, mul_inv, rotate, slerp
from bunraku.figure.quat import exp as quat_exp
from bunraku.figure.skeleton import Index, Skeleton
from bunraku.figure.spring import LN2, spring_decay_into
from bunraku.motion.ankle import lay_toes, lift_out, pitch_ankle, roll_ankle
from bunraku.motion.footprint import Feet, planted, print_under, roll_of, soft_part, wrap, yaw_pitch
from bunraku.motion.ground import sole_of
from bunraku.motion.leg import move_leg

Array = NDArray[np.float64]

FREE_REACH, SOFT_FROM = 0.9985, 0.975
"""Shares of a leg: how straight any leg may be, and from where on a free one gets there softly."""
STRAIGHT = 0.07
"""rad: what a knee's bend is told from; less than any leg's within `FREE_REACH`."""
ROLLS = 4
"""Rounds in which a foot is rolled until its ankle is within its range."""
EASE = 0.15
"""s after a foot came down in which its leg comes under the reach of a locked one."""

FREE, LOCKED, SETTLING, BARRED = 0, 1, 2, 3
"""Modes of a foot; a barred one was torn from its print and stays free until its contact ends."""

GOES, STANDS, STILL = 0, 1, 2
"""What the whole figure does: only one that has stood for a while lets its feet step to their places."""


@dataclass(frozen=True)
class LockLimits:
    """Constants of the foot lock; lengths for a leg of 0.83 m."""

    release: float = 0.10  # s, half-life of what a released leg is behind
    touch: float = 0.05  # s, half-life of what a locked foot is above its print
    tear: float = 0.28  # m: a print farther than this from the blended foot is left
    settle: float = 0.045  # m: a standing foot farther than this from its place steps there
    settle_turn: float = 0.22  # rad, likewise
    settle_time: float = 0.30  # s, of a settling step, and 0.4 s a metre
    settle_lift: float = 0.035  # m
    reach: float = 0.995  # of the leg, locked
    rise: float = 0.15  # s, half-life of the pelvis's way back up
    ground: float = 0.05  # s, half-life of a swinging foot's following of the ground's height
    sink: float = 0.03  # m: the pelvis begins to sink when a planted leg is this near to its reach
    graze: float = 0.004  # m: feet deeper in the ground than this are lifted to half of it


LIMITS = LockLimits()


class FeetState(NamedTuple):
    """What the feet remember; arrays are changed in place. Rows are left, right."""

    mode: Index  # (2,)
    clock: Array  # (2, 2) s since the foot was locked or began to settle; duration of the settling step
    prints: Array  # (2, 5) x, y, z m of the flat ankle on the ground; yaw; slope (rad, toes up)
    offset: Array  # (2, 3) m above, rad pitched and leaned: a locked foot against what rolls over its print
    velocity: Array  # (2, 3) of that
    swing: Array  # (2, 7) rad, leg against the blended one: direction from hip to ankle, bend of the knee, foot
    swing_speed: Array  # (2, 7) of that
    ankle: Array  # (2, 7) m, the ankle and the foot's orientation as they came out
    pitch: Array  # (2,) rad, of the blended foot
    start: Array  # (2, 7) where a settling step began
    straight: Array  # (2,) share of its reach that a leg had when its foot came down
    tips: Array  # (2, 2) rad and rad/s, by which the toes are bent up more to be out of the ground
    grip: Array  # (2,) 0..1, how much the toes are flat on the ground
    ground: Array  # (2, 2) m, ground height under the free feet and its speed
    drop: Array  # (3,) m, how far the pelvis is lowered; m/s; whether the state holds a frame yet


def feet_of(skeleton: Skeleton, limits: LockLimits = LIMITS) -> Feet:
    """Legs and soles of a humanoid skeleton."""
    joints, lengths, soles = np.empty((2, 4), dtype=np.int64), np.empty((2, 2)), np.empty((2, 3))
    tips = np.empty((2, 2))
    rest = skeleton.rest_positions
    for side, name in enumerate(("left", "right")):
        hip, knee, foot = (skeleton.role(name + part) for part in ("UpperLeg", "LowerLeg", "Foot"))
        sole = sole_of(skeleton, name)
        joints[side] = hip, knee, foot, sole.toes
        lengths[side] = np.linalg.norm(rest[knee] - rest[hip]), np.linalg.norm(rest[foot] - rest[knee])
        soles[side] = sole.height, sole.heel, sole.ball
        down = float(skeleton.offsets[sole.toes, 1]) if sole.toes >= 0 else 0.0
        tips[side] = sole.height + down, sole.tip - sole.ball
    size = float(lengths.sum(axis=1).mean()) / 0.83
    row = [limits.release, limits.touch, limits.tear * size, limits.settle * size, limits.settle_turn,
           limits.settle_time, limits.settle_lift * size, limits.reach, limits.rise, limits.ground,
           limits.sink * size, limits.graze * size]  # fmt: skip
    bends = limits_of(skeleton).ranges[joints[0, 2], 1:]
    ankle = np.array([bends[0, 0], bends[0, 1], min(-bends[1, 0], bends[1, 1])])
    return Feet(joints, lengths, soles, np.array(row), tips, ankle)


def feet_state() -> FeetState:
    """Nothing remembered."""
    still = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (2, 1))
    return FeetState(
        mode=np.zeros(2, dtype=np.int64), clock=np.zeros((2, 2)), prints=np.zeros((2, 5)), offset=np.zeros((2, 3)),
        velocity=np.zeros((2, 3)), swing=np.zeros((2, 7)), swing_speed=np.zeros((2, 7)), ankle=still.copy(),
        pitch=np.zeros(2), start=still.copy(), straight=np.zeros(2), tips=np.zeros((2, 2)), grip=np.zeros(2),
        ground=np.zeros((2, 2)), drop=np.zeros(3),
    )  # fmt: skip


@kernel
def ramp(t: float) -> float:
    """0 to 1 with rest at both ends."""
    t = min(max(t, 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


@kernel
def stand_or_leave(
    feet: Feet, state: FeetState, side: int, contact: float, still: int, position: Array, turn: Array, dt: float,
    goal: Array, goal_turn: Array,
) -> None:  # fmt: skip
    """One step of a locked or settling foot, which may let go: where the ankle is to be (3), the foot's turn (4).

    Args:
        contact: > 0 where the blended motion has the foot on the ground.
        still: `STANDS` and more: no print is left; `STILL`: locked feet that stand wrong may settle.
        position, turn: the blended ankle, raised by the ground's height, and foot.
    """
    limits = feet.limits
    angles = np.empty(2)
    yaw_pitch(turn, angles)
    state.clock[side, 0] += dt
    if state.mode[side] == SETTLING:
        t = min(1.0, state.clock[side, 0] / state.clock[side, 1])
        s = t * t * t * (10.0 - 15.0 * t + 6.0 * t * t)
        for k in range(3):
            goal[k] = state.start[side, k] + s * (position[k] - state.start[side, k])
        goal[1] += limits[6] * sin(pi * t) * sin(pi * t)
        slerp(state.start[side, 3:7], turn, s, goal_turn)
        lift_out(feet, side, goal_turn, state.ground[side, 0], goal)
        if t >= 1.0:
            state.mode[side] = FREE
        return
    mark = state.prints[side]
    planted(feet, side, mark, angles[1], 0.0, goal, goal_turn)
    away = sqrt((goal[0] - position[0]) ** 2 + (goal[2] - position[2]) ** 2)
    twist = abs(wrap(mark[3] - angles[0]))
    if still >= STILL and contact > 0.0 and state.mode[1 - side] == LOCKED and (away > limits[3] or twist > limits[4]):
        state.mode[side] = SETTLING
        state.clock[side, 0] = 0.0
        state.clock[side, 1] = limits[5] + 0.4 * away
        for k in range(7):
            state.start[side, k] = state.ankle[side, k]
        for k in range(3):
            goal[k] = state.ankle[side, k]
        for k in range(4):
            goal_turn[k] = state.ankle[side, 3 + k]
        return
    if contact <= 0.0:
        state.mode[side] = FREE
        return
    far = limits[2] if state.mode[1 - side] == LOCKED else 1.5 * limits[2]  # the only foot that bears is kept longer
    if (away > far or twist > 1.25) and still < STANDS:
        state.mode[side] = BARRED
        return
    spring_decay_into(state.offset[side], state.velocity[side], limits[1], dt)
    if state.offset[side, 0] < 0.0:
        state.offset[side, 0] = 0.0  # never into the ground
        state.velocity[side, 0] = max(state.velocity[side, 0], 0.0)
    planted(feet, side, mark, angles[1] + state.offset[side, 1], state.offset[side, 2], goal, goal_turn)
    goal[1] += state.offset[side, 0]


@kernel
def come_down(feet: Feet, state: FeetState, side: int, hip: Array, turn: Array, ankle: Array, dt: float) -> None:
    """Lock a foot on a print under where it really is (``ankle``, 7), so that nothing moves along the ground."""
    goal, goal_turn, real, blended = np.empty(3), np.empty(4), np.empty(2), np.empty(2)
    mark, offset, velocity = state.prints[side], state.offset[side], state.velocity[side]
    print_under(feet, side, ankle[0:3], ankle[3:7], state.ground[side, 0], 0.0, mark)
    # The roll goes on as the blended foot's does; what the foot is above, pitched or leaned against it dies away.
    yaw_pitch(state.ankle[side, 3:7], real)
    before, lean_before = real[1] - state.pitch[side], roll_of(state.ankle[side, 3:7])
    planted(feet, side, mark, real[1], lean_before, goal, goal_turn)
    above_before = state.ankle[side, 1] - goal[1]
    yaw_pitch(ankle[3:7], real)
    yaw_pitch(turn, blended)
    offset[1], offset[2] = real[1] - blended[1], roll_of(ankle[3:7])
    planted(feet, side, mark, real[1], offset[2], goal, goal_turn)
    offset[0] = ankle[1] - goal[1]
    velocity[0] = max(min((offset[0] - above_before) / max(dt, 1e-9), 0.0), -1.0)
    velocity[1] = max(min((offset[1] - before) / max(dt, 1e-9), 8.0), -8.0)
    velocity[2] = max(min((offset[2] - lean_before) / max(dt, 1e-9), 8.0), -8.0)
    far = 0.0
    for k in range(3):
        far += (ankle[k] - hip[k]) ** 2
    state.straight[side] = min(sqrt(far) / (feet.lengths[side, 0] + feet.lengths[side, 1]), FREE_REACH)
    state.clock[side, 0] = 0.0
    state.mode[side] = LOCKED


@kernel
def swing_out(
    feet: Feet, state: FeetState, parents: Index, root_frame: Array, side: int, positions_ws: Array,
    rotations_ws: Array, rotations_ls: Array, turn: Array, dt: float,
) -> None:  # fmt: skip
    """Lay what a free leg is behind over the blended one (in the world arrays), dying away."""
    upper, lower = feet.lengths[side, 0], feet.lengths[side, 1]
    hip, foot = feet.joints[side, 0], feet.joints[side, 2]
    spring_decay_into(state.swing[side], state.swing_speed[side], feet.limits[0], dt)
    axis, goal, goal_turn, q = np.empty(3), np.empty(3), np.empty(4), np.empty(4)
    d = 0.0
    for k in range(3):
        axis[k] = positions_ws[foot, k] - positions_ws[hip, k]
        d += axis[k] * axis[k]
    d = max(sqrt(d), 1e-9)
    bend = flexion_of(upper, lower, d)
    room = max(bend - STRAIGHT, 1e-3)
    lack = state.swing[side, 3]
    bend += lack if lack >= 0.0 else -room * (1.0 - exp(lack / room))
    far = min(flexed_distance(upper, lower, min(bend, 2.7)), FREE_REACH * (upper + lower))
    rotate(root_frame, state.swing[side, 0:3], goal)
    quat_exp(goal, q)
    rotate(q, axis, axis)
    for k in range(3):
        goal[k] = positions_ws[hip, k] + axis[k] * far / d
    quat_exp(state.swing[side, 4:7], q)
    mul(q, turn, goal_turn)
    # Not into the ground, nor beyond the range of the ankle.
    level = goal[1]
    for _ in range(ROLLS):
        goal[1] = level
        lift_out(feet, side, goal_turn, state.ground[side, 0], goal)
        move_leg(parents, feet.joints[side], positions_ws, rotations_ws, rotations_ls, goal, goal_turn, upper, lower,
                 FREE_REACH * (upper + lower))  # fmt: skip
        if not pitch_ankle(feet, rotations_ls[foot], goal_turn):
            break


@kernel
def note_swing(
    feet: Feet, state: FeetState, root_frame: Array, side: int, hip: Array, blended: Array, turn: Array, ankle: Array,
    turned: Array, dt: float, fresh: bool,
) -> None:  # fmt: skip
    """Keep what a planted leg differs by from the blended one, and how fast: it is let go with that."""
    upper, lower = feet.lengths[side, 0], feet.lengths[side, 1]
    a, b, now, q, back = np.empty(3), np.empty(3), np.empty(7), np.empty(4), np.empty(4)
    da, db = 0.0, 0.0
    for k in range(3):
        a[k], b[k] = blended[k] - hip[k], ankle[k] - hip[k]
        da += a[k] * a[k]
        db += b[k] * b[k]
    da, db = max(sqrt(da), 1e-9), max(sqrt(db), 1e-9)
    for k in range(3):
        a[k] /= da
        b[k] /= db
    between(a, b, q)
    log(q, a)
    for k in range(3):
        back[k] = -root_frame[k]
    back[3] = root_frame[3]
    rotate(back, a, now[0:3])
    bend = flexion_of(upper, lower, da)
    room = max(bend - STRAIGHT, 1e-3)
    lack = flexion_of(upper, lower, db) - bend
    now[3] = lack if lack >= 0.0 else room * log1p(-min(-lack / room, 0.97))
    mul_inv(turned, turn, q)
    log(q, now[4:7])
    for k in range(7):
        state.swing_speed[side, k] = 0.0 if fresh else (now[k] - state.swing[side, k]) / max(dt, 1e-9)
        state.swing[side, k] = now[k]


@kernel
def sink(feet: Feet, state: FeetState, positions_ws: Array, goals: Array, most: Array, dt: float) -> None:
    """How far the pelvis is lowered (``state.drop``) so that planted legs reach; sets ``most`` (2), m, their reach."""
    limits = feet.limits
    need = 0.0
    for side in range(2):
        length = feet.lengths[side, 0] + feet.lengths[side, 1]
        most[side] = FREE_REACH * length
        if state.mode[side] != LOCKED and state.mode[side] != SETTLING:
            continue
        eased = ramp(state.clock[side, 0] / EASE) if state.mode[side] == LOCKED else 1.0
        reach = limits[7] + max(state.straight[side] - limits[7], 0.0) * (1.0 - eased)
        most[side] = reach * length
        hip = feet.joints[side, 0]
        away = (goals[side, 0] - positions_ws[hip, 0]) ** 2 + (goals[side, 2] - positions_ws[hip, 2]) ** 2
        below = sqrt(max(most[side] * most[side] - away, 0.0))
        lack = positions_ws[hip, 1] - goals[side, 1] - below
        need = max(need, soft_part(lack, max(eased * limits[10], 1e-6)))
    y = 2.0 * LN2 / limits[8]
    e = exp(-y * dt)
    before = state.drop[0]
    j = state.drop[1] + before * y
    state.drop[0] = max(e * (before + j * dt), 0.0)
    state.drop[1] = e * (state.drop[1] - j * y * dt)
    if need > state.drop[0]:
        state.drop[1] = min((need - before) / max(dt, 1e-9), 0.5) if state.drop[2] > 0.0 else 0.0
        state.drop[0] = need


@kernel
def plant_into(
    feet: Feet, state: FeetState, parents: Index, offsets: Array, root: Array, rotations_ls: Array,
    positions_ws: Array, rotations_ws: Array, contact: Array, heights: Array, still: int, active: bool, dt: float,
) -> float:  # fmt: skip
    """Hold a blended pose's planted feet, in place: ``root`` may sink, the legs are solved anew.

    Args:
        root: (3) m; its height is over level ground plus the ground's under the figure.
        contact: (2) in: > 0 where the blended motion has the foot down; out: 1 where it is locked, else 0.
        heights: (3) m, the ground under the left and right blended foot and what ``root`` was raised by.
        still: whether the figure goes, `STANDS` (perhaps not quite yet) or stands `STILL`.
        active: hold feet at all.

    Returns:
        How far beyond its reach a locked foot was wanted after the pelvis sank, m (0 unless the ground is too steep).
    """
    fk_into(parents, offsets, root, rotations_ls, positions_ws, rotations_ws)
    goals, turns, wanted, most = np.empty((2, 3)), np.empty((2, 4)), np.empty((2, 3)), np.empty(2)
    turn = np.empty((2, 4))
    fresh = state.drop[2] == 0.0
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
            wanted[side, k] = positions_ws[foot, k]
        wanted[side, 1] += state.ground[side, 0] - heights[2]
        for k in range(4):
            turn[side, k] = rotations_ws[foot, k]
        if state.mode[side] == LOCKED or state.mode[side] == SETTLING:
            touching = contact[side] if active else -1.0
            stand_or_leave(feet, state, side, touching, still, wanted[side], turn[side], dt, goals[side], turns[side])
    sink(feet, state, positions_ws, goals, most, dt)
    if state.drop[0] > 0.0:
        root[1] -= state.drop[0]
        for joint in range(parents.shape[0]):
            positions_ws[joint, 1] -= state.drop[0]
    beyond = 0.0
    angles, ankle = np.empty(2), np.empty(7)
    for side in range(2):
        upper, lower = feet.lengths[side, 0], feet.lengths[side, 1]
        full = upper + lower
        hip, foot = feet.joints[side, 0], feet.joints[side, 2]
        # The blended leg, its ankle where it was before the pelvis sank.
        own, far = 0.0, 0.0
        for k in range(3):
            own += (positions_ws[foot, k] - positions_ws[hip, k]) ** 2
            far += (wanted[side, k] - positions_ws[hip, k]) ** 2
        own, far = min(sqrt(own), FREE_REACH * full - 1e-3), max(sqrt(far), 1e-9)
        near = soft_reach(far, FREE_REACH * full, 0.0, max(own / (FREE_REACH * full), SOFT_FROM))
        for k in range(3):
            ankle[k] = positions_ws[hip, k] + (wanted[side, k] - positions_ws[hip, k]) * near / far
        move_leg(parents, feet.joints[side], positions_ws, rotations_ws, rotations_ls, ankle[0:3], turn[side], upper,
                 lower, FREE_REACH * full)  # fmt: skip
        if state.mode[side] == LOCKED or state.mode[side] == SETTLING:
            over = 0.0
            for _ in range(ROLLS):
                over = move_leg(parents, feet.joints[side], positions_ws, rotations_ws, rotations_ls, goals[side],
                                turns[side], upper, lower, most[side])  # fmt: skip
                if state.mode[side] != LOCKED or not roll_ankle(
                    feet, side, state.prints[side], state.offset[side], rotations_ls[foot], goals[side], turns[side]
                ):
                    break
            if state.mode[side] == LOCKED:
                beyond = max(beyond, over)
            note_swing(feet, state, rotations_ws[0], side, positions_ws[hip], ankle[0:3], turn[side],
                       positions_ws[foot], turns[side], dt, fresh)  # fmt: skip
        else:
            swing_out(feet, state, parents, rotations_ws[0], side, positions_ws, rotations_ws, rotations_ls,
                      turn[side], dt)  # fmt: skip
            for k in range(3):
                ankle[k] = positions_ws[foot, k]
            for k in range(4):
                ankle[3 + k] = rotations_ws[foot, k]
            if fresh:
                yaw_pitch(turn[side], angles)
                state.pitch[side] = angles[1]
                for k in range(7):
                    state.ankle[side, k] = ankle[k]
            touching = contact[side] if active else -1.0
            if state.mode[side] == BARRED:
                if touching <= 0.0 or still >= STILL:
                    state.mode[side] = FREE
            elif touching > 0.0:
                come_down(feet, state, side, positions_ws[hip], turn[side], ankle, dt)
        yaw_pitch(turn[side], angles)
        state.pitch[side] = angles[1]
        for k in range(3):
            state.ankle[side, k] = positions_ws[foot, k]
        for k in range(4):
            state.ankle[side, 3 + k] = rotations_ws[foot, k]
        locked = state.mode[side] == LOCKED
        state.grip[side] += (1.0 - exp(-LN2 * dt / 0.04)) * ((1.0 if locked else 0.0) - state.grip[side])
        toes = feet.joints[side, 3]
        if toes >= 0:
            lay_toes(feet, side, state.prints[side, 4], state.grip[side], state.ground[side, 0], active and not locked,
                     offsets[toes], state.tips[side], positions_ws, rotations_ws, rotations_ls, dt)  # fmt: skip
        contact[side] = 1.0 if locked else 0.0
    state.drop[2] = 1.0
    return beyond
