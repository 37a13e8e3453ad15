"""Rotations of whole clips: quaternions (xyzw) and vectors as numpy arrays of any leading shape.

The kernels of `bunraku.figure.quat` turn one quaternion at a time at rate; these functions turn a file's
worth in one call and need no compiler.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

UP: Array = np.array([0.0, 1.0, 0.0])
UP.setflags(write=False)


def mul(b: ArrayLike, a: ArrayLike) -> Array:
    """(..., 4) ``b a``: the rotation ``a`` followed by ``b``."""
    q, p = np.asarray(b, dtype=np.float64), np.asarray(a, dtype=np.float64)
    bx, by, bz, bw = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    ax, ay, az, aw = p[..., 0], p[..., 1], p[..., 2], p[..., 3]
    return np.stack(
        [
            bw * ax + bx * aw + by * az - bz * ay,
            bw * ay - bx * az + by * aw + bz * ax,
            bw * az + bx * ay - by * ax + bz * aw,
            bw * aw - bx * ax - by * ay - bz * az,
        ],
        axis=-1,
    )


def inverse(q: ArrayLike) -> Array:
    """(..., 4) the inverse of unit quaternions."""
    r: Array = np.asarray(q, dtype=np.float64) * np.array([-1.0, -1.0, -1.0, 1.0])
    return r


def rotate(q: ArrayLike, v: ArrayLike) -> Array:
    """(..., 3) the vectors ``v`` turned by the unit quaternions ``q``; leading shapes broadcast."""
    r, u = np.asarray(q, dtype=np.float64), np.asarray(v, dtype=np.float64)
    x, y, z, w = r[..., 0], r[..., 1], r[..., 2], r[..., 3]
    vx, vy, vz = u[..., 0], u[..., 1], u[..., 2]
    tx, ty, tz = 2.0 * (y * vz - z * vy), 2.0 * (z * vx - x * vz), 2.0 * (x * vy - y * vx)
    return np.stack(
        [vx + w * tx + y * tz - z * ty, vy + w * ty + z * tx - x * tz, vz + w * tz + x * ty - y * tx], axis=-1
    )


def normalized(q: ArrayLike) -> Array:
    """(..., 4) unit length; quaternions without a direction become the identity."""
    r = np.array(q, dtype=np.float64)
    length = np.linalg.norm(r, axis=-1, keepdims=True)
    short = length[..., 0] < 1e-12
    r /= np.where(length < 1e-12, 1.0, length)
    r[short] = (0.0, 0.0, 0.0, 1.0)
    return r


def continuous(q: Array) -> Array:
    """(F, ..., 4) the same rotations with signs such that successive frames are on the same half of the sphere."""
    if len(q) < 2:
        return np.array(q)
    flips = np.sum(q[1:] * q[:-1], axis=-1) < 0.0
    signs = np.where(np.cumsum(flips, axis=0) % 2 == 1, -1.0, 1.0)
    out = np.array(q)
    out[1:] *= signs[..., None]
    return out


def axis_angle(axis: ArrayLike, angle: ArrayLike) -> Array:
    """(..., 4) rotations by ``angle`` (rad) about the unit ``axis`` (..., 3)."""
    half = 0.5 * np.asarray(angle, dtype=np.float64)[..., None]
    u = np.asarray(axis, dtype=np.float64)
    return np.concatenate(
        [u * np.sin(half), np.broadcast_to(np.cos(half), (*np.broadcast(u[..., :1], half).shape,))], -1
    )


def yaw(angle: ArrayLike) -> Array:
    """(..., 4) rotations by ``angle`` (rad) about +Y; positive turns +Z toward +X (the figure's left)."""
    return axis_angle(UP, angle)


def exp(v: ArrayLike) -> Array:
    """(..., 4) rotation vectors (..., 3; rad) as quaternions."""
    u = np.asarray(v, dtype=np.float64)
    angle = np.linalg.norm(u, axis=-1, keepdims=True)
    scale = np.where(angle < 1e-8, 0.5, np.sin(0.5 * angle) / np.where(angle < 1e-8, 1.0, angle))
    return np.concatenate([u * scale, np.cos(0.5 * angle)], axis=-1)


def log(q: ArrayLike) -> Array:
    """(..., 3) quaternions as rotation vectors (rad), the short way round."""
    r = np.asarray(q, dtype=np.float64)
    r = np.where(r[..., 3:] < 0.0, -r, r)
    n = np.linalg.norm(r[..., :3], axis=-1, keepdims=True)
    scale = np.where(n < 1e-8, 2.0, 2.0 * np.arctan2(n, r[..., 3:]) / np.where(n < 1e-8, 1.0, n))
    return np.asarray(r[..., :3] * scale, dtype=np.float64)


def slerp(a: ArrayLike, b: ArrayLike, t: ArrayLike) -> Array:
    """(..., 4) from ``a`` (t = 0) to ``b`` (t = 1), the short way at constant speed."""
    p, q = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    u = np.asarray(t, dtype=np.float64)[..., None]
    dot = np.sum(p * q, axis=-1, keepdims=True)
    q = np.where(dot < 0.0, -q, q)
    dot = np.clip(np.abs(dot), 0.0, 1.0)
    theta = np.arccos(dot)
    sine = np.sin(theta)
    near = sine < 1e-6
    safe = np.where(near, 1.0, sine)
    wa = np.where(near, 1.0 - u, np.sin((1.0 - u) * theta) / safe)
    wb = np.where(near, u, np.sin(u * theta) / safe)
    return normalized(wa * p + wb * q)


def between(a: ArrayLike, b: ArrayLike) -> Array:
    """(..., 4) the shortest arc from the direction of ``a`` (..., 3) to that of ``b``; identity for zero vectors."""
    u, v = np.broadcast_arrays(np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64))
    k = np.linalg.norm(u, axis=-1) * np.linalg.norm(v, axis=-1)
    w = k + np.sum(u * v, axis=-1)
    q = np.concatenate([np.cross(u, v), w[..., None]], axis=-1)
    half_turn = w < 1e-9 * k
    if np.any(half_turn):
        # Half a turn: any axis square to u will do; take the one away from u's largest part.
        other = np.where(np.abs(u[..., :1]) < 0.6 * np.linalg.norm(u, axis=-1, keepdims=True), [1.0, 0, 0], [0, 1.0, 0])
        square = np.concatenate([np.cross(u, other), np.zeros_like(w)[..., None]], axis=-1)
        q = np.where(half_turn[..., None], square, q)
    q[k < 1e-12] = (0.0, 0.0, 0.0, 1.0)
    return normalized(q)


def from_euler(order: str, angles: Array) -> Array:
    """(..., 4) of angles (..., n; rad) about the axes named in ``order``: R = R1 R2 R3, as BVH lists channels."""
    q = np.zeros((*angles.shape[:-1], 4))
    q[..., 3] = 1.0
    for k, axis in enumerate(order):
        turn = np.zeros_like(q)
        turn[..., "xyz".index(axis)] = np.sin(0.5 * angles[..., k])
        turn[..., 3] = np.cos(0.5 * angles[..., k])
        q = turn if k == 0 else mul(q, turn)
    return q


def to_zxy(q: ArrayLike) -> Array:
    """(..., 3) angles (z, x, y; rad) with R = Rz Rx Ry; |x| <= pi/2."""
    r = np.asarray(q, dtype=np.float64)
    x, y, z, w = r[..., 0], r[..., 1], r[..., 2], r[..., 3]
    sine = np.clip(2.0 * (y * z + w * x), -1.0, 1.0)
    about_x = np.arcsin(sine)
    locked = np.abs(sine) > 1.0 - 1e-12
    about_z = np.where(
        locked,
        np.arctan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z)),
        np.arctan2(2.0 * (w * z - x * y), 1.0 - 2.0 * (x * x + z * z)),
    )
    about_y = np.where(locked, 0.0, np.arctan2(2.0 * (w * y - x * z), 1.0 - 2.0 * (x * x + y * y)))
    return np.stack([about_z, about_x, about_y], axis=-1)


def unwrapped_zxy(q: Array) -> Array:
    """(F, J, 3) like `to_zxy`, of the two triples a rotation has always the one nearest to the frame before."""
    angles = to_zxy(q)
    other = np.stack([angles[..., 0] + np.pi, np.pi - angles[..., 1], angles[..., 2] + np.pi], axis=-1)
    turn = 2.0 * np.pi
    for frame in range(1, len(angles)):
        before = angles[frame - 1]
        first = before + (angles[frame] - before + np.pi) % turn - np.pi
        second = before + (other[frame] - before + np.pi) % turn - np.pi
        nearer = np.sum((second - before) ** 2, -1) < np.sum((first - before) ** 2, -1)
        angles[frame] = np.where(nearer[..., None], second, first)
    return angles


def heading(q: ArrayLike) -> Array:
    """(...) rad: the twist about +Y of rotations: 0 faces +Z, positive to the left (toward +X)."""
    r = np.asarray(q, dtype=np.float64)
    angle = 2.0 * np.arctan2(r[..., 1], r[..., 3])
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi, dtype=np.float64)
