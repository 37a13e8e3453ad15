"""Feet on the ground: where a sole touches, how it rolls, and ground that is not level."""

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, sin

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel
from bunraku.figure.skeleton import Skeleton

Array = NDArray[np.float64]

GroundHeight = Callable[[float, float], float]
"""(x, z) m -> height m."""


@dataclass(frozen=True)
class Sole:
    """One foot's sole in the frame of the flat foot: the ankle stands ``height`` above the origin.

    All in metres along the foot's own forward axis (+Z at rest).
    """

    side: str
    ankle: int  # joint
    toes: int  # joint, -1 where the skeleton has none
    height: float
    heel: float  # negative: behind the ankle
    ball: float  # under the toe joint
    tip: float


def sole_of(skeleton: Skeleton, side: str) -> Sole:
    """The sole of the ``left`` or ``right`` foot, from the foot's boxes where there are any.

    Without boxes the floor lies 3 cm under the toe joint (or 8 cm under the ankle) of a leg of 0.83 m.
    """
    ankle = skeleton.role(side + "Foot")
    toes = skeleton.roles.get(side + "Toes", -1)
    knee, hip = skeleton.role(side + "LowerLeg"), skeleton.role(side + "UpperLeg")
    rest = skeleton.rest_positions
    size = float(np.linalg.norm(rest[knee] - rest[hip]) + np.linalg.norm(rest[ankle] - rest[knee])) / 0.83
    center, half = skeleton.box_centers[ankle], skeleton.box_sizes[ankle]
    ball = float(skeleton.offsets[toes, 2]) if toes >= 0 else 0.0
    if half.any():
        height = -float(center[1] - half[1])
        heel, front = float(center[2] - half[2]), float(center[2] + half[2])
    else:
        height = (0.03 * size - float(skeleton.offsets[toes, 1])) if toes >= 0 else 0.08 * size
        heel, front = -0.055 * size, max(0.145 * size, ball)
    if toes < 0:
        ball, tip = 0.65 * front, front
    else:
        tip_center, tip_half = skeleton.box_centers[toes], skeleton.box_sizes[toes]
        tip = ball + (float(tip_center[2] + tip_half[2]) if tip_half.any() else 0.075 * size)
    return Sole(side, ankle, toes, height, heel, ball, max(tip, front))


@kernel
def roll(height: float, heel: float, ball: float, pitch: float, out: Array) -> None:
    """The ankle of a foot that rolls over its footprint: ``out`` = (height, forward) m from the flat sole.

    ``pitch`` (rad) > 0 lifts the toes about the heel, < 0 lifts the heel about the ball of the foot; the
    contact point does not move.
    """
    pivot = heel if pitch >= 0.0 else ball
    c, s = cos(pitch), sin(pitch)
    out[0] = height * c - pivot * s
    out[1] = pivot - height * s - pivot * c


def rolled(sole: Sole, pitch: Array) -> Array:
    """(..., 2) `roll` of many pitches: ankle's height and forward offset from the flat sole, m."""
    pivot = np.where(pitch >= 0.0, sole.heel, sole.ball)
    c, s = np.cos(pitch), np.sin(pitch)
    return np.stack([sole.height * c - pivot * s, pivot - sole.height * s - pivot * c], axis=-1)


def lowest(sole: Sole, ankle_height: Array, pitch: Array, toe_bend: Array) -> Array:
    """(...) height m of the lowest of heel, ball and toe tip, for an ankle at ``ankle_height`` (m).

    ``pitch`` rad, toes up positive; ``toe_bend`` rad, toes bent up against the foot positive.
    """
    c, s = np.cos(pitch), np.sin(pitch)
    heel = ankle_height - sole.height * c + sole.heel * s
    ball = ankle_height - sole.height * c + sole.ball * s
    tip = ball + (sole.tip - sole.ball) * np.sin(pitch + toe_bend)
    return np.asarray(np.minimum(np.minimum(heel, ball), tip), dtype=np.float64)


class Heightfield:
    """Ground given as heights on a regular grid; bilinear between, held at the border.

    Args:
        heights: (n, m) m; rows run along +Z, columns along +X.
        cell: m between neighbours. x, z: m, where the first entry lies.
    """

    def __init__(self, heights: object, cell: float, x: float = 0.0, z: float = 0.0) -> None:
        self.heights: Array = np.array(heights, dtype=np.float64)
        if self.heights.ndim != 2 or min(self.heights.shape) < 2 or not np.isfinite(self.heights).all():
            raise ValueError("a height field needs two or more rows and columns of finite heights")
        if not cell > 0.0:
            raise ValueError(f"a height field's cell must be a positive length, got {cell}")
        self.cell, self.x, self.z = float(cell), float(x), float(z)

    def __call__(self, x: float, z: float) -> float:
        rows, columns = self.heights.shape
        u = min(max((x - self.x) / self.cell, 0.0), columns - 1.0)
        v = min(max((z - self.z) / self.cell, 0.0), rows - 1.0)
        i, j = min(int(v), rows - 2), min(int(u), columns - 2)
        fu, fv = u - j, v - i
        h = self.heights
        near = h[i, j] * (1.0 - fu) + h[i, j + 1] * fu
        far = h[i + 1, j] * (1.0 - fu) + h[i + 1, j + 1] * fu
        return float(near * (1.0 - fv) + far * fv)


def flat(x: float, z: float) -> float:
    """Level ground at height 0."""
    return 0.0
