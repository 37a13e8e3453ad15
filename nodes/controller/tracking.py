"""Tracking: held parts are where they are held; what is out of reach pulls trunk, then pelvis.

Oshita 2013 section 6.1, eqs 14-15. What a grab, a release or a jump of the target leaves between target and
part is an offset that evens out as a critically damped spring, so that a held part is exactly under the
finger otherwise, at any speed.
"""

from math import cos, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel
from bunraku.figure.quat import between, log, mul, mul_inv, rotate, swing_twist_y
from bunraku.figure.quat import exp as quat_exp
from bunraku.figure.spring import spring_decay_into
from bunraku.nodes.controller.relaxing import twist_of, yaw_turn
from bunraku.nodes.controller.state import TRUNK_LEAN, TRUNK_TWIST

Array = NDArray[np.float64]

FORWARD, BACKWARD, SIDEWARD = float(TRUNK_LEAN[0]), float(TRUNK_LEAN[1]), float(TRUNK_LEAN[2])
MOST_TWIST = float(TRUNK_TWIST)
STOOP = 0.12
"""How far ahead of itself a shoulder goes for every metre that it has to go down."""
SHORTEST = 1.0 / 120.0
"""s: targets that come closer together are not taken for fast."""


@kernel
def jump_share(moved: float, most: float) -> float:
    """The share (0..1) of a target's movement that counts as a jump: none up to ``most``, all from twice that."""
    return min(1.0, max(0.0, moved / max(most, 1e-9) - 1.0))


@kernel
def follow_point(
    target: Array, before: Array, grabbed: bool, x: Array, aim: Array, velocity: Array, offset: Array,
    rate: Array, fastest: float, half_life: float, dt: float,
) -> None:  # fmt: skip
    """Where a held point (3) is wanted: under its target, with what is left of the offset between them.

    Args:
        before: (3) the target of the last step; it is brought up to date.
        x: (3) m, where the point is; it counts when it is grabbed.
        aim: (3) m, where it was wanted; it is brought up to date.
        velocity: (3) m/s that it had; it is brought up to date.
        fastest: m/s; of a target that moves faster, ever more has jumped and goes into the offset (`jump_share`).
    """
    moved = 0.0
    for k in range(3):
        if grabbed:
            aim[k] = x[k]
            offset[k] = x[k] - target[k]
            rate[k] = velocity[k]
            before[k] = target[k]
        moved += (target[k] - before[k]) ** 2
    jumped = jump_share(sqrt(moved), fastest * max(dt, SHORTEST))
    for k in range(3):
        offset[k] -= jumped * (target[k] - before[k])
    spring_decay_into(offset, rate, half_life, dt)
    for k in range(3):
        new = target[k] + offset[k]
        if dt > 0.0:
            velocity[k] = (new - aim[k]) / dt
        aim[k] = new
        before[k] = target[k]


@kernel
def follow_turn(
    target: Array, before: Array, grabbed: bool, turn: Array, spin: Array, offset: Array, rate: Array,
    fastest: float, half_life: float, dt: float,
) -> None:  # fmt: skip
    """`follow_point` for an orientation (4); offset and rates are rotation vectors (3) in the world."""
    q, v = np.empty(4), np.empty(3)
    if grabbed:
        mul_inv(turn, target, q)
        log(q, offset)
        for k in range(3):
            rate[k] = spin[k]
        for k in range(4):
            before[k] = target[k]
    mul_inv(target, before, q)
    log(q, v)
    jumped = jump_share(sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]), fastest * max(dt, SHORTEST))
    for k in range(3):
        offset[k] -= jumped * v[k]
    spring_decay_into(offset, rate, half_life, dt)
    new = np.empty(4)
    quat_exp(offset, q)
    mul(q, target, new)
    mul_inv(new, turn, q)
    log(q, v)
    for k in range(4):
        turn[k] = new[k]
        before[k] = target[k]
    if dt > 0.0:
        for k in range(3):
            spin[k] = v[k] / dt


@kernel
def keep_lean(turn: Array, heading: float, lead: Array, room: Array) -> None:
    """Keep the trunk's orientation (4) within what a back can do, in place.

    ``lead`` (4) is the orientation that needs no allowance (a motion's trunk, or upright): limits count from
    it where it is farther out. ``room`` (2) is how far it bends forward now (rad) and the
    share that is left of leaning aside and twisting (see `lean_room`).
    """
    swing, twist, face, v, w = np.empty(4), np.empty(4), np.empty(4), np.empty(3), np.empty(3)
    swing_twist_y(turn, swing, twist)
    log(swing, v)
    # Forward is a turn about the figure's own left.
    c, s = cos(heading), sin(heading)
    pitch, roll = c * v[0] - s * v[2], s * v[0] + c * v[2]
    swing_twist_y(lead, swing, face)
    log(swing, w)
    lead_pitch, lead_roll = c * w[0] - s * w[2], s * w[0] + c * w[2]
    ahead = max(room[0], lead_pitch) if pitch >= 0.0 else max(BACKWARD, -lead_pitch)
    aside = max(SIDEWARD * room[1], abs(lead_roll))
    out = sqrt((pitch / ahead) ** 2 + (roll / aside) ** 2)
    if out > 1.0:
        pitch, roll = pitch / out, roll / out
        v[0], v[1], v[2] = c * pitch + s * roll, 0.0, -s * pitch + c * roll
    else:
        v[1] = 0.0
    quat_exp(v, swing)
    off = twist_of(twist) - heading
    off -= 6.283185307179586 * np.floor((off + 3.141592653589793) / 6.283185307179586)
    lead_off = twist_of(face) - heading
    lead_off -= 6.283185307179586 * np.floor((lead_off + 3.141592653589793) / 6.283185307179586)
    most = max(MOST_TWIST * room[1], abs(lead_off))
    yaw_turn(heading + min(most, max(-most, off)), twist)
    mul(swing, twist, turn)


@kernel
def reach_with_trunk(
    wanted: Array, arm_root: Array, back: Array, turn: Array, heading: float, lead: Array, room: Array,
    out_turn: Array, rest: Array,
) -> None:  # fmt: skip
    """Turn the trunk so that a shoulder moves by ``wanted`` (3, m) as far as it can (eq. 15).

    Args:
        arm_root: (3) m, the shoulder.
        back: (3) m, the joint about which the trunk turns.
        out_turn: (4) the new orientation of the trunk.
        rest: (3) m, what is left for the pelvis.
    """
    lever, to, moved, q = np.empty(3), np.empty(3), np.empty(3), np.empty(4)
    # The way down is forward: along the upright back itself no turn leads down.
    ahead = STOOP * max(0.0, -wanted[1])
    for k in range(3):
        lever[k] = arm_root[k] - back[k]
        to[k] = lever[k] + wanted[k]
    to[0] += ahead * sin(heading)
    to[2] += ahead * cos(heading)
    between(lever, to, q)
    mul(q, turn, out_turn)
    keep_lean(out_turn, heading, lead, room)
    mul_inv(out_turn, turn, q)
    rotate(q, lever, moved)
    for k in range(3):
        rest[k] = wanted[k] - (moved[k] - lever[k])


@kernel
def root_shift(target: Array, root: Array, reach: float, out: Array) -> float:
    """The least shift (3) of a limb's root that brings ``target`` within ``reach`` (eq. 14); its length."""
    d = 0.0
    for k in range(3):
        out[k] = target[k] - root[k]
        d += out[k] * out[k]
    d = sqrt(d)
    if d <= reach:
        out[0], out[1], out[2] = 0.0, 0.0, 0.0
        return 0.0
    for k in range(3):
        out[k] *= 1.0 - reach / d
    return d - reach
