"""Relaxing: free parts go back to rest (Oshita 2013 section 6.4, eqs 23-26).

The speeds are the paper's constant ones, taken up and given up smoothly: a part's velocity follows the
wanted one with a short time constant, so that it goes on with what it had when it was let go. The same
solution for every step length.
"""

from math import acos, atan2, cos, exp, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel, kernel_inline
from bunraku.figure.limb import flexion_of
from bunraku.figure.quat import between, inv_mul, log, mul, mul_inv, rotate
from bunraku.figure.quat import exp as quat_exp
from bunraku.nodes.controller.state import State, Under

Array = NDArray[np.float64]

HEAD_AHEAD, HEAD_BACK, HEAD_ASIDE, HEAD_ROUND = 0.76, 0.95, 0.90, 1.0
"""rad: how far the head nods ahead (until the chin is at the chest) and back, leans aside and turns round."""


@kernel
def move_with(x: Array, velocity: Array, wanted: Array, ease: float, dt: float) -> None:
    """Let ``velocity`` (n) near ``wanted`` (n) and ``x`` (n) move with it, exactly, in place."""
    e = exp(-dt / max(ease, 1e-6))
    for k in range(x.shape[0]):
        change = velocity[k] - wanted[k]
        x[k] += wanted[k] * dt + change * ease * (1.0 - e)
        velocity[k] = wanted[k] + change * e


@kernel
def wanted_velocity(x: Array, goal: Array, speed: float, time: float, out: Array) -> None:
    """Straight to ``goal`` at ``speed``, slower within ``speed * time`` of it."""
    d2 = 0.0
    for k in range(x.shape[0]):
        d2 += (goal[k] - x[k]) ** 2
    d = sqrt(d2)
    rate = 0.0 if d < 1e-12 else min(speed, d / time) / d
    for k in range(x.shape[0]):
        out[k] = (goal[k] - x[k]) * rate


@kernel
def relax_point(x: Array, velocity: Array, goal: Array, speed: float, time: float, ease: float, dt: float) -> None:
    """One step of a free point (3, m) toward its place of rest (eq. 26 for a foot sinking to the floor)."""
    wanted = np.empty(3)
    wanted_velocity(x, goal, speed, time, wanted)
    move_with(x, velocity, wanted, ease, dt)


@kernel
def relax_hand(
    arm: Array, velocity: Array, rest: Array, aside: Array, upper: float, lower: float, speed: float, time: float,
    ease: float, dt: float,
) -> None:  # fmt: skip
    """One step of a free hand: it sinks on an arc about its shoulder (eq. 26 along the arm's own way).

    The hand goes round the shoulder at ``speed``; the elbow opens or closes at the same angular speed.

    Args:
        arm: (3) m from the shoulder to the hand, changed in place.
        rest: (3) m, the same with the arm at rest.
        aside: (3) unit, outward and ahead: the way round for an arm that is raised past the horizontal, so
            that it does not come down through the face.
    """
    r, r0 = 0.0, 0.0
    for k in range(3):
        r += arm[k] * arm[k]
        r0 += rest[k] * rest[k]
    r, r0 = max(sqrt(r), 1e-6), max(sqrt(r0), 1e-6)
    u, to = np.empty(3), np.empty(3)
    c = 0.0
    for k in range(3):
        u[k] = arm[k] / r
        to[k] = rest[k] / r0
        c += u[k] * to[k]
    if c < 0.0:
        n = 0.0
        for k in range(3):
            to[k] += min(1.0, -2.0 * c) * aside[k]
            n += to[k] * to[k]
        c = 0.0
        for k in range(3):
            to[k] /= sqrt(n)
            c += u[k] * to[k]
    angle = acos(min(1.0, max(-1.0, c)))
    tangent = np.empty(3)
    n = 0.0
    for k in range(3):
        tangent[k] = to[k] - c * u[k]
        n += tangent[k] * tangent[k]
    n = sqrt(n)
    rate = min(speed / r0, angle / time)
    bend = flexion_of(upper, lower, r)
    unbend = min(speed / r0, max(-speed / r0, (flexion_of(upper, lower, r0) - bend) / time))
    radial = -unbend * upper * lower * sin(bend) / r
    if bend < 0.02 or bend > 3.1:
        radial = min(speed, max(-speed, (r0 - r) / time))
    wanted = np.empty(3)
    for k in range(3):
        wanted[k] = radial * u[k] + (rate * r * tangent[k] / n if n > 1e-9 else 0.0)
    move_with(arm, velocity, wanted, ease, dt)


@kernel
def relax_turn(turn: Array, spin: Array, goal: Array, speed: float, time: float, ease: float, dt: float) -> None:
    """One step of an orientation (4) toward its rest at ``speed`` rad/s (eqs 24-25), in place."""
    rest, away, wanted, moved = np.empty(4), np.empty(3), np.empty(3), np.zeros(3)
    mul_inv(turn, goal, rest)
    log(rest, away)
    zero = np.zeros(3)
    wanted_velocity(away, zero, speed, time, wanted)
    move_with(moved, spin, wanted, ease, dt)
    quat_exp(moved, rest)
    mul(rest, turn, turn)


@kernel
def carry_hand(arm: Array, before: Array, now: Array) -> None:
    """Take a hand along when its place of rest, seen from the shoulder, goes from ``before`` to ``now``."""
    turn = np.empty(4)
    between(before, now, turn)
    rotate(turn, arm, arm)
    a, b, r = 0.0, 0.0, 0.0
    for k in range(3):
        a += before[k] * before[k]
        b += now[k] * now[k]
        r += arm[k] * arm[k]
    r = sqrt(r)
    if r > 1e-9:
        grown = max(r + sqrt(b) - sqrt(a), 0.05) / r
        for k in range(3):
            arm[k] *= grown


@kernel
def carry_turn(turn: Array, before: Array, now: Array) -> None:
    """Take an orientation along when its rest goes from ``before`` to ``now``."""
    change = np.empty(4)
    mul_inv(now, before, change)
    mul(change, turn, turn)


@kernel
def yaw_turn(heading: float, out: Array) -> None:
    """The orientation (4) of a figure that faces ``heading`` (rad about +Y from +Z)."""
    out[0], out[1], out[2], out[3] = 0.0, sin(0.5 * heading), 0.0, cos(0.5 * heading)


@kernel
def twist_of(turn: Array) -> float:
    """The heading (rad) in an orientation: its twist about +Y."""
    angle = 2.0 * atan2(turn[1], turn[3])
    return atan2(sin(angle), cos(angle))


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
def share_of_neck(v: Array) -> float:
    """How far a head that is turned by ``v`` (3, rad) against the trunk is on its way to its bounds; 1 on them."""
    ahead = HEAD_AHEAD if v[0] > 0.0 else HEAD_BACK
    return sqrt((v[0] / ahead) ** 2 + (v[1] / HEAD_ROUND) ** 2 + (v[2] / HEAD_ASIDE) ** 2)


@kernel_inline
def keep_head(st: State, under: Under) -> None:
    """Keep the head within what the neck can do and the chin lets it (`HEAD_AHEAD` and the others), by direction.

    Over a motion whose head is farther round, as far as that.
    """
    q, v, most = np.empty(4), np.empty(3), 1.0
    if under.active[0] > 0.5:
        inv_mul(under.turns[0], under.turns[1], q)
        log(q, v)
        most = max(1.0, share_of_neck(v))
    inv_mul(st.turns[0], st.turns[1], q)
    log(q, v)
    off = share_of_neck(v)
    if off > most:
        for k in range(3):
            v[k] *= most / off
        quat_exp(v, q)
        mul(st.turns[0], q, st.turns[1])
