"""Analytic two-bone inverse kinematics with a swivel angle (Tolani, Goswami, Badler 2000).

The swivel turns the elbow or knee about the line from the limb's root to its end. Its zero is carried
along from a reference direction by the shortest arc, so it is smooth everywhere but at the one direction
opposite to the reference, which is chosen where no limb can go (a zero direction projected onto the plane
would be undefined at two).
"""

from math import acos, cos, exp, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel
from bunraku.figure.quat import between, rotate

Array = NDArray[np.float64]


@kernel
def soft_reach(distance: float, full: float, least: float, soften: float) -> float:
    """The distance that a limb takes for a target at ``distance`` (m).

    Exact from ``least`` to ``soften * full``; beyond, it nears ``full`` without ever getting there, with
    continuous slope (as ozz-animation's soften ratio), so that the elbow never snaps straight.
    """
    start = soften * full
    if distance > start:
        room = max(full - start, 1e-9)
        distance = start + room * (1.0 - exp(-(distance - start) / room))
        distance = min(distance, full - 1e-3 * room)
    return max(distance, least)


@kernel
def flexed_distance(upper: float, lower: float, flexion: float) -> float:
    """Distance from root to end (m) of a limb bent by ``flexion`` (rad, 0 straight)."""
    return sqrt(max(upper * upper + lower * lower + 2.0 * upper * lower * cos(flexion), 0.0))


@kernel
def flexion_of(upper: float, lower: float, distance: float) -> float:
    """The bend (rad, 0 straight) of a limb whose root and end are ``distance`` apart."""
    c = (distance * distance - upper * upper - lower * lower) / (2.0 * upper * lower)
    return acos(min(1.0, max(-1.0, c)))


@kernel
def pole_direction(axis: Array, reference: Array, zero: Array, swivel: float, out: Array) -> None:
    """The direction (3, unit, square to ``axis``) in which the elbow or knee stands out.

    ``axis`` (3, unit) points from root to end; ``zero`` is square to ``reference``; all in one frame.
    """
    turn = np.empty(4)
    between(reference, axis, turn)
    z = np.empty(3)
    rotate(turn, zero, z)
    c, s = cos(swivel), sin(swivel)
    out[0] = c * z[0] + s * (axis[1] * z[2] - axis[2] * z[1])
    out[1] = c * z[1] + s * (axis[2] * z[0] - axis[0] * z[2])
    out[2] = c * z[2] + s * (axis[0] * z[1] - axis[1] * z[0])


@kernel
def swivel_of(axis: Array, pole: Array, reference: Array, zero: Array) -> float:
    """The swivel (rad) at which the elbow stands out toward ``pole``; 0 where ``pole`` is along the axis."""
    turn = np.empty(4)
    between(reference, axis, turn)
    z = np.empty(3)
    rotate(turn, zero, z)
    c = z[0] * pole[0] + z[1] * pole[1] + z[2] * pole[2]
    s = (
        (axis[1] * z[2] - axis[2] * z[1]) * pole[0]
        + (axis[2] * z[0] - axis[0] * z[2]) * pole[1]
        + (axis[0] * z[1] - axis[1] * z[0]) * pole[2]
    )
    if c * c + s * s < 1e-18:
        return 0.0
    return np.arctan2(s, c)  # type: ignore[no-any-return]


@kernel
def two_bone(
    axis: Array, pole: Array, distance: float, upper: float, lower: float, upper_dir: Array, lower_dir: Array
) -> None:
    """Directions of both bones for an end at ``distance * axis`` from the root, bent toward ``pole``.

    ``distance`` must lie within the limb's reach (see `soft_reach`). The hinge is ``pole x axis``: turning
    ``upper_dir`` about it by a positive flexion gives ``lower_dir``, so the joint never bends backwards.
    """
    x = (distance * distance + upper * upper - lower * lower) / (2.0 * max(distance, 1e-9))
    x = min(upper, max(-upper, x))
    y = sqrt(max(upper * upper - x * x, 0.0))
    for k in range(3):
        upper_dir[k] = (x * axis[k] + y * pole[k]) / upper
        lower_dir[k] = ((distance - x) * axis[k] - y * pole[k]) / lower
    n = sqrt(lower_dir[0] * lower_dir[0] + lower_dir[1] * lower_dir[1] + lower_dir[2] * lower_dir[2])
    for k in range(3):
        lower_dir[k] /= max(n, 1e-9)


@kernel
def frame_quat(x: Array, y: Array, out: Array) -> None:
    """The rotation that carries +X to ``x`` and +Y to ``y`` (3, unit, square to each other)."""
    zx = x[1] * y[2] - x[2] * y[1]
    zy = x[2] * y[0] - x[0] * y[2]
    zz = x[0] * y[1] - x[1] * y[0]
    m00, m10, m20 = x[0], x[1], x[2]
    m01, m11, m21 = y[0], y[1], y[2]
    trace = m00 + m11 + zz
    if trace > 0.0:
        s = 2.0 * sqrt(trace + 1.0)
        qx, qy, qz, qw = (m21 - zy) / s, (zx - m20) / s, (m10 - m01) / s, 0.25 * s
    elif m00 > m11 and m00 > zz:
        s = 2.0 * sqrt(max(1.0 + m00 - m11 - zz, 1e-12))
        qx, qy, qz, qw = 0.25 * s, (m01 + m10) / s, (zx + m20) / s, (m21 - zy) / s
    elif m11 > zz:
        s = 2.0 * sqrt(max(1.0 + m11 - m00 - zz, 1e-12))
        qx, qy, qz, qw = (m01 + m10) / s, 0.25 * s, (zy + m21) / s, (zx - m20) / s
    else:
        s = 2.0 * sqrt(max(1.0 + zz - m00 - m11, 1e-12))
        qx, qy, qz, qw = (zx + m20) / s, (zy + m21) / s, 0.25 * s, (m10 - m01) / s
    n = sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
    out[0], out[1], out[2], out[3] = qx / n, qy / n, qz / n, qw / n
