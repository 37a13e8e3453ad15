"""Quaternions (x, y, z, w) as kernels: scalar-style, allocation-free, safe to call from other kernels.

``out`` arguments are written; they may alias an input. A quaternion and its negative are one rotation.
"""

from math import acos, atan2, cos, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel

Array = NDArray[np.float64]


@kernel
def mul(b: Array, a: Array, out: Array) -> None:
    """``out = b a``: the rotation ``a`` followed by ``b``."""
    bx, by, bz, bw = b[0], b[1], b[2], b[3]
    ax, ay, az, aw = a[0], a[1], a[2], a[3]
    out[0] = bw * ax + bx * aw + by * az - bz * ay
    out[1] = bw * ay - bx * az + by * aw + bz * ax
    out[2] = bw * az + bx * ay - by * ax + bz * aw
    out[3] = bw * aw - bx * ax - by * ay - bz * az


@kernel
def inv_mul(b: Array, a: Array, out: Array) -> None:
    """``out = b⁻¹ a`` for a unit ``b``: ``a`` as seen from ``b``."""
    bx, by, bz, bw = -b[0], -b[1], -b[2], b[3]
    ax, ay, az, aw = a[0], a[1], a[2], a[3]
    out[0] = bw * ax + bx * aw + by * az - bz * ay
    out[1] = bw * ay - bx * az + by * aw + bz * ax
    out[2] = bw * az + bx * ay - by * ax + bz * aw
    out[3] = bw * aw - bx * ax - by * ay - bz * az


@kernel
def mul_inv(b: Array, a: Array, out: Array) -> None:
    """``out = b a⁻¹`` for a unit ``a``: the rotation that carries ``a`` to ``b``."""
    bx, by, bz, bw = b[0], b[1], b[2], b[3]
    ax, ay, az, aw = -a[0], -a[1], -a[2], a[3]
    out[0] = bw * ax + bx * aw + by * az - bz * ay
    out[1] = bw * ay - bx * az + by * aw + bz * ax
    out[2] = bw * az + bx * ay - by * ax + bz * aw
    out[3] = bw * aw - bx * ax - by * ay - bz * az


@kernel
def rotate(q: Array, v: Array, out: Array) -> None:
    """``out = q v q⁻¹``: the vector ``v`` (3) turned by the unit quaternion ``q``."""
    x, y, z, w = q[0], q[1], q[2], q[3]
    vx, vy, vz = v[0], v[1], v[2]
    tx = 2.0 * (y * vz - z * vy)
    ty = 2.0 * (z * vx - x * vz)
    tz = 2.0 * (x * vy - y * vx)
    out[0] = vx + w * tx + y * tz - z * ty
    out[1] = vy + w * ty + z * tx - x * tz
    out[2] = vz + w * tz + x * ty - y * tx


@kernel
def inv_rotate(q: Array, v: Array, out: Array) -> None:
    """``out = q⁻¹ v q``: the world vector ``v`` in the frame of ``q``."""
    x, y, z, w = -q[0], -q[1], -q[2], q[3]
    vx, vy, vz = v[0], v[1], v[2]
    tx = 2.0 * (y * vz - z * vy)
    ty = 2.0 * (z * vx - x * vz)
    tz = 2.0 * (x * vy - y * vx)
    out[0] = vx + w * tx + y * tz - z * ty
    out[1] = vy + w * ty + z * tx - x * tz
    out[2] = vz + w * tz + x * ty - y * tx


@kernel
def normalize(q: Array, out: Array) -> None:
    """Unit length; a quaternion too short to have a direction becomes the identity."""
    n = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    if n < 1e-12:
        out[0], out[1], out[2], out[3] = 0.0, 0.0, 0.0, 1.0
    else:
        out[0], out[1], out[2], out[3] = q[0] / n, q[1] / n, q[2] / n, q[3] / n


@kernel
def from_axis_angle(ax: float, ay: float, az: float, angle: float, out: Array) -> None:
    """Rotation by ``angle`` (rad) about the unit axis (ax, ay, az)."""
    s = sin(0.5 * angle)
    out[0], out[1], out[2], out[3] = ax * s, ay * s, az * s, cos(0.5 * angle)


@kernel
def exp(v: Array, out: Array) -> None:
    """Rotation vector (3, rad) to quaternion."""
    angle = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    s = 0.5 if angle < 1e-8 else sin(0.5 * angle) / angle
    w = cos(0.5 * angle)
    out[0], out[1], out[2], out[3] = v[0] * s, v[1] * s, v[2] * s, w


@kernel
def log(q: Array, out: Array) -> None:
    """Quaternion to rotation vector (3, rad), the short way round: |out| <= pi."""
    x, y, z, w = q[0], q[1], q[2], q[3]
    if w < 0.0:
        x, y, z, w = -x, -y, -z, -w
    n = sqrt(x * x + y * y + z * z)
    s = 2.0 if n < 1e-8 else 2.0 * atan2(n, w) / n
    out[0], out[1], out[2] = x * s, y * s, z * s


@kernel
def angle(q: Array) -> float:
    """The rotation angle of a unit quaternion, 0..pi."""
    n = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
    return 2.0 * atan2(n, abs(q[3]))


@kernel
def scale(w: float, q: Array, out: Array) -> None:
    """``w·q``: the same axis, ``w`` times the angle (the short way round)."""
    x, y, z, c = q[0], q[1], q[2], q[3]
    if c < 0.0:
        x, y, z, c = -x, -y, -z, -c
    n = sqrt(x * x + y * y + z * z)
    if n < 1e-12:
        out[0], out[1], out[2], out[3] = x * w, y * w, z * w, 1.0
        return
    half = w * atan2(n, c)
    s = sin(half) / n
    out[0], out[1], out[2], out[3] = x * s, y * s, z * s, cos(half)


@kernel
def slerp(a: Array, b: Array, t: float, out: Array) -> None:
    """From ``a`` (t=0) to ``b`` (t=1) the short way at constant angular speed."""
    d = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    sign = 1.0
    if d < 0.0:
        d, sign = -d, -1.0
    if d > 0.9999999:
        u, v = 1.0 - t, t
    else:
        theta = acos(d)
        s = sin(theta)
        u, v = sin((1.0 - t) * theta) / s, sin(t * theta) / s
    v *= sign
    x, y = u * a[0] + v * b[0], u * a[1] + v * b[1]
    z, w = u * a[2] + v * b[2], u * a[3] + v * b[3]
    n = sqrt(x * x + y * y + z * z + w * w)
    out[0], out[1], out[2], out[3] = x / n, y / n, z / n, w / n


@kernel
def between(a: Array, b: Array, out: Array) -> None:
    """The shortest arc that carries the direction of ``a`` (3) to that of ``b`` (3).

    Opposite directions turn half round about an axis square to ``a``; a zero vector gives the identity.
    """
    la = sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
    lb = sqrt(b[0] * b[0] + b[1] * b[1] + b[2] * b[2])
    if la < 1e-12 or lb < 1e-12:
        out[0], out[1], out[2], out[3] = 0.0, 0.0, 0.0, 1.0
        return
    k = la * lb
    cx = a[1] * b[2] - a[2] * b[1]
    cy = a[2] * b[0] - a[0] * b[2]
    cz = a[0] * b[1] - a[1] * b[0]
    w = k + a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    if w < 1e-9 * k:
        # Half a turn: any axis square to a will do; take the one away from a's largest part.
        ax, ay, az = a[0] / la, a[1] / la, a[2] / la
        if abs(ax) < 0.6:
            cx, cy, cz = 0.0, -az, ay
        else:
            cx, cy, cz = az, 0.0, -ax
        w = 0.0
    n = sqrt(cx * cx + cy * cy + cz * cz + w * w)
    out[0], out[1], out[2], out[3] = cx / n, cy / n, cz / n, w / n


@kernel
def swing_twist_y(q: Array, swing: Array, twist: Array) -> None:
    """``q = swing twist`` with ``twist`` about +Y and ``swing``'s axis horizontal.

    Where the twist is undefined (q turns +Y upside down) the twist is the identity.
    """
    y, w = q[1], q[3]
    n = sqrt(y * y + w * w)
    if n < 1e-9:
        twist[0], twist[1], twist[2], twist[3] = 0.0, 0.0, 0.0, 1.0
    else:
        twist[0], twist[1], twist[2], twist[3] = 0.0, y / n, 0.0, w / n
    mul_inv(q, twist, swing)
