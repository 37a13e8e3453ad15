"""A foot on its print: how it rolls over heel and ball, and where the print of a foot is that has just come down."""

from math import asin, atan2, cos, pi, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel
from bunraku.figure.quat import from_axis_angle, inv_mul, log, mul, rotate
from bunraku.figure.skeleton import Index

Array = NDArray[np.float64]


class Feet(NamedTuple):
    """A skeleton's legs and soles for the kernel; rows are left, right."""

    joints: Index  # (2, 4) thigh, shin, foot, toes (-1 for none)
    lengths: Array  # (2, 2) m
    soles: Array  # (2, 3) m: ankle height, heel, ball
    limits: Array  # (12,) LockLimits, lengths scaled
    tips: Array  # (2, 2) m from the toe joint: down to the sole, ahead to the tip of the toes
    ankle: Array  # (3,) rad: least (dorsal) and most (plantar) of an ankle's bend, and how far it goes aside


@kernel
def soft_part(x: float, width: float) -> float:
    """The positive part of ``x``, rounded off from -width to width: never less than it, with continuous slope."""
    if x <= -width:
        return 0.0
    if x >= width:
        return x
    return (x + width) * (x + width) / (4.0 * width)


@kernel
def yaw_pitch(q: Array, out: Array) -> None:
    """Heading and pitch (rad, toes up) of a foot's forward axis."""
    v = np.empty(3)
    v[0], v[1], v[2] = 0.0, 0.0, 1.0
    rotate(q, v, v)
    out[0] = atan2(v[0], v[2])
    out[1] = asin(min(1.0, max(-1.0, v[1])))


@kernel
def roll_of(q: Array) -> float:
    """What a foot leans to its side (rad, about its own forward axis) besides its heading and pitch."""
    angles, a, b, v = np.empty(2), np.empty(4), np.empty(4), np.empty(3)
    yaw_pitch(q, angles)
    from_axis_angle(0.0, 1.0, 0.0, angles[0], a)
    from_axis_angle(1.0, 0.0, 0.0, -angles[1], b)
    mul(a, b, a)
    inv_mul(a, q, b)
    log(b, v)
    return v[2]  # type: ignore[no-any-return]


@kernel
def planted(feet: Feet, side: int, mark: Array, pitch: float, lean: float, position: Array, turn: Array) -> None:
    """Ankle position (3) and orientation (4) of a foot rolled by ``pitch`` (rad) over its print ``mark`` (5).

    It rests on its heel (pitch > 0) or ball and leans by ``lean`` (rad) about its own forward axis.
    """
    a, b, arm = np.empty(4), np.empty(4), np.empty(3)
    slope = mark[4]
    pivot = feet.soles[side, 1] if pitch >= 0.0 else feet.soles[side, 2]
    from_axis_angle(0.0, 1.0, 0.0, mark[3], a)
    from_axis_angle(1.0, 0.0, 0.0, -(pitch + slope), b)
    mul(a, b, turn)
    from_axis_angle(0.0, 0.0, 1.0, lean, b)
    mul(turn, b, turn)
    arm[0], arm[1], arm[2] = 0.0, feet.soles[side, 0], -pivot
    rotate(turn, arm, arm)
    ahead = pivot * cos(slope)
    position[0] = mark[0] + ahead * sin(mark[3]) + arm[0]
    position[1] = mark[1] + pivot * sin(slope) + arm[1]
    position[2] = mark[2] + ahead * cos(mark[3]) + arm[2]


@kernel
def wrap(angle: float) -> float:
    return angle - 2.0 * pi * np.floor((angle + pi) / (2.0 * pi))  # type: ignore[no-any-return]


@kernel
def print_under(
    feet: Feet, side: int, ankle: Array, turn: Array, height: float, slope: float, mark: Array
) -> None:  # fmt: skip
    """Set the print ``mark`` (5) under what a foot stands on, for its ankle (3) and orientation (4).

    ``height`` (m) is that of the ground under the heel or ball that it stands on, ``slope`` (rad) how the ground rises
    along the foot.
    """
    angles, arm = np.empty(2), np.empty(3)
    yaw_pitch(turn, angles)
    pivot = feet.soles[side, 1] if angles[1] >= slope else feet.soles[side, 2]
    arm[0], arm[1], arm[2] = 0.0, -feet.soles[side, 0], pivot
    rotate(turn, arm, arm)
    ahead = pivot * cos(slope)
    mark[0] = ankle[0] + arm[0] - ahead * sin(angles[0])
    mark[1] = height - pivot * sin(slope)
    mark[2] = ankle[2] + arm[2] - ahead * cos(angles[0])
    mark[3] = angles[0]
    mark[4] = slope


@kernel
def sole_depth(feet: Feet, side: int, ankle: Array, turn: Array, height: float) -> float:
    """How far (m) heel or ball of a foot are under ground of ``height`` m; negative above it."""
    sole = np.empty(3)
    deepest = -1e300
    for k in range(1, 3):
        sole[0], sole[1], sole[2] = 0.0, -feet.soles[side, 0], feet.soles[side, k]
        rotate(turn, sole, sole)
        deepest = max(deepest, height - ankle[1] - sole[1])
    return deepest
