"""How quality is measured: one function each, on frames of world positions and local rotations.

F frames, J joints; ``positions`` (F, J, 3) m and ``orientations`` (F, J, 4) in the world, ``rotations``
(F, J, 4) local, ``dt`` s between frames.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.boxes import collision_pairs, deepest_overlap_batch_into
from bunraku.figure.limits import limits_of, worst_excess
from bunraku.figure.mass import center_of_mass_into
from bunraku.figure.rig import rig_of
from bunraku.figure.skeleton import Skeleton
from bunraku.figure.support import convex_hull_into, margin_in_hull

Array = NDArray[np.float64]


def reach_error(positions: Array, targets: Array) -> Array:
    """Distance (...) m of held points (..., 3) from where they are held (..., 3)."""
    return np.asarray(np.linalg.norm(np.asarray(positions) - np.asarray(targets), axis=-1))


def foot_skate(feet: Array, planted: NDArray[np.bool_], dt: float) -> float:
    """Mean horizontal speed (m/s) of feet (F, n, 3) between frames in which they are planted (F, n)."""
    both = planted[1:] & planted[:-1]
    if not both.any():
        return 0.0
    speed = np.linalg.norm(np.diff(feet[..., [0, 2]], axis=0), axis=-1) / dt
    return float(speed[both].mean())


def foot_drift(feet: Array, planted: NDArray[np.bool_]) -> float:
    """The farthest (m) that any foot (F, n, 3) gets from where it was planted, while it is planted (F, n)."""
    worst = 0.0
    for foot in range(feet.shape[1]):
        start: Array | None = None
        for frame in range(len(feet)):
            if not planted[frame, foot]:
                start = None
            elif start is None:
                start = feet[frame, foot]
            else:
                worst = max(worst, float(np.linalg.norm(feet[frame, foot] - start)))
    return worst


def floor_penetration(skeleton: Skeleton, positions: Array, orientations: Array) -> Array:
    """The deepest (F) m that any box corner is under the floor; 0 for none."""
    depth = np.zeros(len(positions))
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
    for joint in range(len(skeleton)):
        if not skeleton.box_sizes[joint].any():
            continue
        corners = skeleton.box_centers[joint] + signs * skeleton.box_sizes[joint]
        x, y, z, w = np.moveaxis(orientations[:, joint], -1, 0)
        # The y row of the rotation matrix.
        row = np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=-1)
        heights = positions[:, joint, 1:2] + row @ corners.T
        depth = np.maximum(depth, -heights.min(axis=1))
    return np.maximum(depth, 0.0)


def self_penetration(
    skeleton: Skeleton, positions: Array, orientations: Array, joints: Sequence[int] | None = None
) -> Array:
    """The deepest (F) m that two boxes overlap that should not (`collision_pairs`); of some joints with anything."""
    depths, pairs = np.zeros(len(positions)), collision_pairs(skeleton)
    if joints is not None:
        pairs = np.ascontiguousarray(pairs[np.isin(pairs, joints).any(axis=1)])
    deepest_overlap_batch_into(
        pairs, skeleton.box_centers, skeleton.box_sizes,
        np.ascontiguousarray(positions, dtype=np.float64), np.ascontiguousarray(orientations, dtype=np.float64),
        depths,
    )  # fmt: skip
    return depths


def balance_margin(skeleton: Skeleton, positions: Array, orientations: Array, planted: NDArray[np.bool_]) -> Array:
    """How far (F) m the centre of mass is inside the soles' hull on the ground; negative outside, NaN in the air."""
    rig = rig_of(skeleton)
    out = np.full(len(positions), np.nan)
    center, hull = np.empty(3), np.empty((18, 2))
    for frame in range(len(positions)):
        corners = []
        for side in range(2):
            if planted[frame, side]:
                foot = rig.limbs[2 + side, 2]
                x, y, z, w = orientations[frame, foot]
                for corner in rig.soles[side]:
                    t = 2 * np.cross([x, y, z], corner)
                    point = positions[frame, foot] + corner + w * t + np.cross([x, y, z], t)
                    corners.append(point[[0, 2]])
        if corners:
            center_of_mass_into(rig.masses, rig.mass_centers, positions[frame], orientations[frame], center)
            size = convex_hull_into(np.array(corners), len(corners), hull)
            out[frame] = margin_in_hull(hull, size, float(center[0]), float(center[2]))
    return out


def limit_violation(skeleton: Skeleton, rotations: Array) -> Array:
    """The largest excess (F) rad over a joint's range of motion."""
    limits = limits_of(skeleton)
    return np.array([worst_excess(limits, pose) for pose in np.ascontiguousarray(rotations, dtype=np.float64)])


def joint_speeds(rotations: Array, dt: float) -> Array:
    """Angular speed (F-1, J) rad/s of every joint against its parent."""
    dots = np.abs((rotations[1:] * rotations[:-1]).sum(axis=-1))
    cross = rotations[1:] - np.sign((rotations[1:] * rotations[:-1]).sum(axis=-1))[..., None] * rotations[:-1]
    # From the chord, which keeps its digits where the angle is small.
    chord = np.linalg.norm(cross, axis=-1)
    return np.where(dots > 1.0, 0.0, 4.0 * np.arcsin(np.clip(0.5 * chord, 0.0, 1.0)) / dt)


def joint_velocities(rotations: Array, dt: float) -> Array:
    """Angular velocity (F-1, J, 3) rad/s of every joint in its own frame."""
    a, b = rotations[:-1], rotations[1:]
    av, aw, bv, bw = -a[..., :3], a[..., 3:], b[..., :3], b[..., 3:]
    v = aw * bv + bw * av + np.cross(av, bv)
    w = aw * bw - (av * bv).sum(axis=-1, keepdims=True)
    v = np.where(w < 0, -v, v)
    n = np.linalg.norm(v, axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(n, np.abs(w))
    return np.asarray(np.where(n > 1e-12, v / np.maximum(n, 1e-12), 0.0) * angle / dt)


def largest_velocity_step(rotations: Array, dt: float) -> float:
    """The largest change (rad/s) of a joint's angular velocity from one frame to the next."""
    if len(rotations) < 3:
        return 0.0
    return float(np.linalg.norm(np.diff(joint_velocities(rotations, dt), axis=0), axis=-1).max())


def unexplained_ways(positions: Array, motion: Array, led: Array) -> Array:
    """How far (F-1, J) m joints go in a frame beyond what the motion under them and the hand on them explain.

    Seen from the motion's root: what is farther than the joint ever goes in a frame of ``motion`` (F, J, 3) and, on
    top, than the finger did (``led`` (F-1) m). Negative where less.
    """
    ways = np.linalg.norm(np.diff(positions - motion[:, :1], axis=0), axis=-1)
    own = np.linalg.norm(np.diff(motion - motion[:, :1], axis=0), axis=-1).max(axis=0)
    return np.asarray(ways - own - np.asarray(led)[:, None])


def mean_jerk(positions: Array, dt: float) -> float:
    """Mean third derivative (m/s³) of joints' positions (F, J, 3)."""
    if len(positions) < 4:
        return 0.0
    return float(np.linalg.norm(np.diff(positions, n=3, axis=0), axis=-1).mean() / dt**3)


def path_error(points: Array, path: Array) -> Array:
    """Distance (F) m of ground points (F, 2) from a polyline (n, 2)."""
    a, b = path[:-1], path[1:]
    edge = b - a
    length = np.maximum((edge * edge).sum(axis=-1), 1e-18)
    along = np.clip(((points[:, None] - a) * edge).sum(axis=-1) / length, 0.0, 1.0)
    nearest = a + along[..., None] * edge
    return np.asarray(np.linalg.norm(points[:, None] - nearest, axis=-1).min(axis=1))
