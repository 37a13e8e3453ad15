"""A leg whose ankle is put somewhere: two-bone inverse kinematics over the pose that it is in."""

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel
from bunraku.figure.limb import frame_quat, two_bone
from bunraku.figure.quat import between, inv_mul, mul, mul_inv, rotate

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@kernel
def unit_square(axis: Array, v: Array) -> float:
    """Make ``v`` square to the unit ``axis`` and of unit length, in place; returns its length before."""
    d = axis[0] * v[0] + axis[1] * v[1] + axis[2] * v[2]
    n = 0.0
    for k in range(3):
        v[k] -= d * axis[k]
        n += v[k] * v[k]
    n = sqrt(n)
    if n > 1e-9:
        for k in range(3):
            v[k] /= n
    return n


@kernel
def bend_leg(
    hip: Array, ankle: Array, pole: Array, upper: float, lower: float, most: float, thigh: Array, shin: Array
) -> float:
    """Frames (xyzw; +X along the bone, +Y along the knee's hinge) of thigh and shin for an ankle's place.

    ``pole`` (3) says where the knee points. The ankle is kept within ``most`` (m) of the hip; returns how far
    beyond that it was wanted (m).
    """
    axis, front = np.empty(3), np.empty(3)
    upper_dir, lower_dir, hinge = np.empty(3), np.empty(3), np.empty(3)
    d = 0.0
    for k in range(3):
        axis[k] = ankle[k] - hip[k]
        front[k] = pole[k]
        d += axis[k] * axis[k]
    d = sqrt(d)
    if d < 1e-9:
        axis[0], axis[1], axis[2] = 0.0, -1.0, 0.0
    else:
        for k in range(3):
            axis[k] /= d
    if unit_square(axis, front) < 1e-6:
        front[0], front[1], front[2] = 0.0, 0.0, 1.0
        if unit_square(axis, front) < 1e-6:
            front[0], front[1], front[2] = 0.0, 1.0, 0.0
            unit_square(axis, front)
    least = abs(upper - lower) + 0.15 * min(upper, lower)
    two_bone(axis, front, min(max(d, least), most), upper, lower, upper_dir, lower_dir)
    hinge[0] = front[1] * axis[2] - front[2] * axis[1]
    hinge[1] = front[2] * axis[0] - front[0] * axis[2]
    hinge[2] = front[0] * axis[1] - front[1] * axis[0]
    frame_quat(upper_dir, hinge, thigh)
    frame_quat(lower_dir, hinge, shin)
    return max(d - most, 0.0)


@kernel
def move_leg(
    parents: Index, joints: Index, positions_ws: Array, rotations_ws: Array, rotations_ls: Array, ankle: Array,
    foot: Array, upper: float, lower: float, most: float,
) -> float:  # fmt: skip
    """Put a leg's ankle at ``ankle`` (3) and its foot at the world orientation ``foot`` (4), in place.

    The knee keeps pointing where it points: with the ankle where it is, the pose stays as it is. World arrays
    of hip, knee and ankle are brought up to date, those of the toes are not.

    Args:
        joints: (3,) thigh, shin, foot. most: m, farthest that the ankle may be from the hip.

    Returns:
        How far beyond ``most`` the ankle was wanted, m.
    """
    hip, knee, end = joints[0], joints[1], joints[2]
    axis, new_axis, pole, front = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    d, new_d = 0.0, 0.0
    for k in range(3):
        axis[k] = positions_ws[end, k] - positions_ws[hip, k]
        new_axis[k] = ankle[k] - positions_ws[hip, k]
        pole[k] = positions_ws[knee, k] - positions_ws[hip, k]
        d += axis[k] * axis[k]
        new_d += new_axis[k] * new_axis[k]
    d, new_d = max(sqrt(d), 1e-9), max(sqrt(new_d), 1e-9)
    for k in range(3):
        axis[k] /= d
        new_axis[k] /= new_d
    # Where the knee stands out; of a nearly straight leg, more and more the front of the thigh.
    front[0], front[1], front[2] = 0.0, 0.0, 1.0
    rotate(rotations_ws[hip], front, front)
    unit_square(axis, front)
    out = axis[0] * pole[0] + axis[1] * pole[1] + axis[2] * pole[2]
    for k in range(3):
        pole[k] -= out * axis[k]
    n = sqrt(pole[0] * pole[0] + pole[1] * pole[1] + pole[2] * pole[2])
    trust = min(1.0, n / (0.06 * (upper + lower)))
    for k in range(3):
        pole[k] = pole[k] / max(n, 1e-9) * trust + front[k] * (1.0 - trust)
    unit_square(axis, pole)
    thigh, shin, thigh_before, shin_before, turn = np.empty(4), np.empty(4), np.empty(4), np.empty(4), np.empty(4)
    start, now = np.empty(3), np.empty(3)
    for k in range(3):
        start[k] = positions_ws[hip, k]
        now[k] = positions_ws[end, k]
    bend_leg(start, now, pole, upper, lower, upper + lower, thigh_before, shin_before)
    between(axis, new_axis, turn)
    rotate(turn, pole, pole)
    beyond = bend_leg(start, ankle, pole, upper, lower, most, thigh, shin)
    mul_inv(thigh, thigh_before, turn)
    mul(turn, rotations_ws[hip], rotations_ws[hip])
    mul_inv(shin, shin_before, turn)
    mul(turn, rotations_ws[knee], rotations_ws[knee])
    offset = np.empty(3)
    offset[0], offset[1], offset[2] = upper, 0.0, 0.0
    rotate(thigh, offset, offset)
    for k in range(3):
        positions_ws[knee, k] = start[k] + offset[k]
    offset[0], offset[1], offset[2] = lower, 0.0, 0.0
    rotate(shin, offset, offset)
    for k in range(3):
        positions_ws[end, k] = positions_ws[knee, k] + offset[k]
        rotations_ws[end, k] = foot[k]
    rotations_ws[end, 3] = foot[3]
    inv_mul(rotations_ws[parents[hip]], rotations_ws[hip], rotations_ls[hip])
    inv_mul(rotations_ws[hip], rotations_ws[knee], rotations_ls[knee])
    inv_mul(rotations_ws[knee], rotations_ws[end], rotations_ls[end])
    return beyond
