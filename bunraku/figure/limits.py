"""Joint limits: a swing ellipse, a twist range, or a hinge range, soft at the ends.

Ranges of motion are those of healthy adults (American Academy of Orthopaedic Surgeons 1965, as tabulated in
Norkin and White, Measurement of Joint Motion, 5th ed. 2016, appendix B), in degrees: shoulder flexion 180,
extension 60, abduction 180, rotation 70 in and 90 out; elbow 0..150; hip flexion 120, extension 30, abduction
45, adduction 30, rotation 45 and 45; knee 0..145; ankle plantar flexion 50; neck flexion 45, extension 45,
side 45, rotation 60; wrist 80, 70, 20, 30; back flexion 80, extension 25, side 35, rotation 45, over all its
joints. An ankle that bears weight bends farther than the 20 of the table: 45 (Bennell et al. 1998, weight-
bearing lunge). The shoulder's and shoulder girdle's range together is a cone about the direction ahead and
outward.
"""

from functools import lru_cache
from math import exp as e_to
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel
from bunraku.figure.quat import between, log, mul, mul_inv
from bunraku.figure.quat import exp as quat_exp
from bunraku.figure.rig import ARM_FLEXION, LEG_FLEXION, rig_of
from bunraku.figure.skeleton import Skeleton

Array = NDArray[np.float64]
Index = NDArray[np.int64]

FREE, BALL, HINGE = 0, 1, 2
SOFT = 0.94
"""Share of a range from which a soft clamp begins to hold back."""
SHOULDER_CONE = 128.0
SHOULDER_CENTER = (0.55, -0.30, 0.78)
"""Middle of the left shoulder's range (direction of the upper arm in the shoulder's frame)."""


class Limits(NamedTuple):
    """Limits of J joints, for the kernels; angles in rad."""

    kinds: Index  # (J,) FREE, BALL or HINGE
    centers: Array  # (J, 4) local rotation in the middle of the range
    axes: Array  # (J, 3, 3) rows: twist axis (along the bone at the centre) and two swing axes; a hinge's first
    ranges: Array  # (J, 3, 2) least and most of the twist and of both swings; a hinge's first


@kernel
def _split(limits: Limits, joint: int, turn: Array, swing: Array, twist: Array) -> None:
    """``turn centre⁻¹ = swing twist`` about the joint's twist axis."""
    off = np.empty(4)
    mul_inv(turn, limits.centers[joint], off)
    ax, ay, az = limits.axes[joint, 0, 0], limits.axes[joint, 0, 1], limits.axes[joint, 0, 2]
    along = off[0] * ax + off[1] * ay + off[2] * az
    n = sqrt(along * along + off[3] * off[3])
    if n < 1e-9:
        twist[0], twist[1], twist[2], twist[3] = 0.0, 0.0, 0.0, 1.0
    else:
        s = along / n
        twist[0], twist[1], twist[2], twist[3] = ax * s, ay * s, az * s, off[3] / n
    mul_inv(off, twist, swing)


@kernel
def joint_excess(limits: Limits, joint: int, turn: Array) -> float:
    """By how much (rad) a joint's local rotation (4) is outside its range; 0 inside."""
    if limits.kinds[joint] == FREE:
        return 0.0
    swing, twist, v, w = np.empty(4), np.empty(4), np.empty(3), np.empty(3)
    _split(limits, joint, turn, swing, twist)
    log(twist, v)
    angle = v[0] * limits.axes[joint, 0, 0] + v[1] * limits.axes[joint, 0, 1] + v[2] * limits.axes[joint, 0, 2]
    excess = max(limits.ranges[joint, 0, 0] - angle, angle - limits.ranges[joint, 0, 1])
    if limits.kinds[joint] == HINGE:
        return float(max(excess, 0.0))
    log(swing, w)
    k2, size = 0.0, 0.0
    for n in range(1, 3):
        s = w[0] * limits.axes[joint, n, 0] + w[1] * limits.axes[joint, n, 1] + w[2] * limits.axes[joint, n, 2]
        bound = limits.ranges[joint, n, 1] if s >= 0.0 else -limits.ranges[joint, n, 0]
        k2 += (s / max(bound, 1e-6)) ** 2
        size += s * s
    if k2 > 1.0:
        excess = max(excess, sqrt(size) * (1.0 - 1.0 / sqrt(k2)))
    return float(max(excess, 0.0))


@kernel
def soft_share(k: float) -> float:
    """A share of a range, held back smoothly from `SOFT` on and never above 1."""
    if k <= SOFT:
        return k
    return SOFT + (1.0 - SOFT) * (1.0 - e_to(-(k - SOFT) / (1.0 - SOFT)))


@kernel
def clamp_joint(limits: Limits, joint: int, turn: Array) -> float:
    """Bring a ball joint's local rotation (4) into its range, in place, softly; how far it was moved (rad).

    Hinges keep their range by how their limb is solved, or by `clamp_hinge`.
    """
    if limits.kinds[joint] != BALL:
        return 0.0
    swing, twist, v, w = np.empty(4), np.empty(4), np.empty(3), np.empty(3)
    _split(limits, joint, turn, swing, twist)
    log(twist, v)
    log(swing, w)
    angle = v[0] * limits.axes[joint, 0, 0] + v[1] * limits.axes[joint, 0, 1] + v[2] * limits.axes[joint, 0, 2]
    low, high = limits.ranges[joint, 0, 0], limits.ranges[joint, 0, 1]
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    off = (angle - middle) / max(half, 1e-6)
    sign = 1.0 if off >= 0.0 else -1.0
    kept = middle + sign * soft_share(abs(off)) * half
    k2 = 0.0
    for n in range(1, 3):
        s = w[0] * limits.axes[joint, n, 0] + w[1] * limits.axes[joint, n, 1] + w[2] * limits.axes[joint, n, 2]
        bound = limits.ranges[joint, n, 1] if s >= 0.0 else -limits.ranges[joint, n, 0]
        k2 += (s / max(bound, 1e-6)) ** 2
    k = sqrt(k2)
    share = 1.0 if k <= SOFT else soft_share(k) / k
    if share == 1.0 and abs(off) <= SOFT:
        return 0.0
    size = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    for n in range(3):
        w[n] *= share
        v[n] = kept * limits.axes[joint, 0, n]
    quat_exp(w, swing)
    quat_exp(v, twist)
    mul(swing, twist, swing)
    mul(swing, limits.centers[joint], turn)
    return float(size * (1.0 - share) + abs(angle - kept))


@kernel
def clamp_hinge(limits: Limits, joint: int, turn: Array) -> float:
    """Bring a hinge's local rotation (4) into its range, in place; how far it was moved (rad).

    What it is turned otherwise is kept.
    """
    swing, twist, v = np.empty(4), np.empty(4), np.empty(3)
    _split(limits, joint, turn, swing, twist)
    log(twist, v)
    angle = v[0] * limits.axes[joint, 0, 0] + v[1] * limits.axes[joint, 0, 1] + v[2] * limits.axes[joint, 0, 2]
    kept = min(max(angle, limits.ranges[joint, 0, 0]), limits.ranges[joint, 0, 1])
    if kept == angle:
        return 0.0
    for n in range(3):
        v[n] = kept * limits.axes[joint, 0, n]
    quat_exp(v, twist)
    mul(swing, twist, swing)
    mul(swing, limits.centers[joint], turn)
    return float(abs(angle - kept))


@kernel
def worst_excess(limits: Limits, rotations_ls: Array) -> float:
    """The largest excess (rad) over all joints of a pose (J, 4)."""
    worst = 0.0
    for joint in range(rotations_ls.shape[0]):
        worst = max(worst, joint_excess(limits, joint, rotations_ls[joint]))
    return worst


def _center(bone: Array, direction: Array) -> Array:
    turn = np.empty(4)
    between(bone, direction / np.linalg.norm(direction), turn)
    return turn


@lru_cache(maxsize=32)
def limits_of(skeleton: Skeleton) -> Limits:
    """The limits of a humanoid skeleton; joints without a role are free."""
    rig = rig_of(skeleton)
    count = len(skeleton)
    kinds = np.zeros(count, dtype=np.int64)
    centers = np.zeros((count, 4))
    centers[:, 3] = 1.0
    axes, ranges = np.zeros((count, 3, 3)), np.zeros((count, 3, 2))
    x, y, z = np.eye(3)

    def ball(joint: int, rows: tuple[Array, Array, Array], degrees: tuple[tuple[float, float], ...]) -> None:
        kinds[joint], axes[joint], ranges[joint] = BALL, rows, np.radians(degrees)

    back = len(rig.back)
    for joint in rig.back:
        # Two joints share unevenly in a person; every one may do two thirds more than an even share.
        part = 1.67 / back if back > 1 else 1.0
        ball(int(joint), (y, x, z), ((-45 * part, 45 * part), (-25 * part, 80 * part), (-35 * part, 35 * part)))
    neck = len(rig.neck)
    for joint in rig.neck:
        ball(int(joint), (y, x, z), ((-60 / neck, 60 / neck), (-90 / neck, 90 / neck), (-60 / neck, 60 / neck)))
    for side, sign in ((0, 1.0), (1, -1.0)):
        upper, lower, hand = (int(j) for j in rig.limbs[side])
        bone = rig.rest_positions[lower] - rig.rest_positions[upper]
        bone = bone / np.linalg.norm(bone)
        direction = np.array(SHOULDER_CENTER) * np.array([sign, 1.0, 1.0])
        direction /= np.linalg.norm(direction)
        centers[upper] = _center(bone, direction)
        first = np.cross(direction, y)
        first /= np.linalg.norm(first)
        twist = (-105.0, 65.0) if sign > 0 else (-65.0, 105.0)
        cone = (-SHOULDER_CONE, SHOULDER_CONE)
        ball(upper, (direction, first, np.cross(direction, first)), (twist, cone, cone))
        kinds[lower], axes[lower, 0] = HINGE, rig.hinges[side]
        ranges[lower, 0] = (0.0, ARM_FLEXION)
        along = rig.rest_positions[hand] - rig.rest_positions[lower]
        along = along / np.linalg.norm(along)
        ball(hand, (along, z, y), ((-90, 90), (-80, 80), (-30, 30)))
        upper, lower, foot = (int(j) for j in rig.limbs[2 + side])
        aside = (-30.0, 45.0) if sign > 0 else (-45.0, 30.0)
        ball(upper, (-y, x, z), ((-45, 45), (-120, 30), aside))
        kinds[lower], axes[lower, 0] = HINGE, rig.hinges[2 + side]
        ranges[lower, 0] = (0.0, LEG_FLEXION)
        ball(foot, (y, x, z), ((-45, 45), (-45, 50), (-35, 35)))
    for array in (kinds, centers, axes, ranges):
        array.setflags(write=False)
    return Limits(kinds, centers, axes, ranges)


def limit_excess(skeleton: Skeleton, rotations_ls: Array) -> Array:
    """By how much (..., J) rad the joints of poses (..., J, 4) are outside their ranges."""
    limits = limits_of(skeleton)
    rotations = np.ascontiguousarray(rotations_ls, dtype=np.float64)
    out = np.empty(rotations.shape[:-1])
    joints = len(skeleton)
    for pose, excess in zip(rotations.reshape(-1, joints, 4), out.reshape(-1, joints), strict=True):
        for joint in range(joints):
            excess[joint] = joint_excess(limits, joint, pose[joint])
    return out
