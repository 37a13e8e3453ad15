"""Oriented boxes and how near or deep they are to each other, by the separating-axis test.

Gottschalk, Lin, Manocha 1996. The depth of an overlap is the smallest over the fifteen axes and equals
the true one; a gap is a lower bound of the distance (never more, seldom less than 0.7 of it).
"""

from functools import lru_cache
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel
from bunraku.figure.quat import rotate
from bunraku.figure.skeleton import Skeleton

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@kernel
def box_axes(turn: Array, axes: Array) -> None:
    """The three axes (3, 3; one a row) of a box turned by ``turn`` (4)."""
    x, y, z, w = turn[0], turn[1], turn[2], turn[3]
    axes[0, 0], axes[0, 1], axes[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)
    axes[1, 0], axes[1, 1], axes[1, 2] = 2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)
    axes[2, 0], axes[2, 1], axes[2, 2] = 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)


@kernel
def box_gap(
    a_center: Array, a_axes: Array, a_half: Array, b_center: Array, b_axes: Array, b_half: Array, axis: Array,
    enough: float = 1e9,
) -> float:  # fmt: skip
    """Signed gap of two boxes (m): positive apart (a lower bound), negative the depth of the overlap.

    ``axis`` (3, unit) is written: the direction that moves ``a`` out of ``b`` by the shortest way. A gap
    that is known to be ``enough`` (m) or more is not looked into any further.
    """
    dx = a_center[0] - b_center[0]
    dy = a_center[1] - b_center[1]
    dz = a_center[2] - b_center[2]
    best = -1e18
    for n in range(15):
        if n < 3:
            x, y, z = a_axes[n, 0], a_axes[n, 1], a_axes[n, 2]
        elif n < 6:
            x, y, z = b_axes[n - 3, 0], b_axes[n - 3, 1], b_axes[n - 3, 2]
        else:
            i, j = (n - 6) // 3, (n - 6) % 3
            x = a_axes[i, 1] * b_axes[j, 2] - a_axes[i, 2] * b_axes[j, 1]
            y = a_axes[i, 2] * b_axes[j, 0] - a_axes[i, 0] * b_axes[j, 2]
            z = a_axes[i, 0] * b_axes[j, 1] - a_axes[i, 1] * b_axes[j, 0]
            length = x * x + y * y + z * z
            if length < 1e-8:
                continue
            length = sqrt(length)
            x, y, z = x / length, y / length, z / length
        d = dx * x + dy * y + dz * z
        reach = 0.0
        for k in range(3):
            reach += a_half[k] * abs(a_axes[k, 0] * x + a_axes[k, 1] * y + a_axes[k, 2] * z)
            reach += b_half[k] * abs(b_axes[k, 0] * x + b_axes[k, 1] * y + b_axes[k, 2] * z)
        gap = abs(d) - reach
        if gap > best + (1e-9 if n < 6 else 1e-6):
            best = gap
            sign = 1.0 if d >= 0.0 else -1.0
            axis[0], axis[1], axis[2] = sign * x, sign * y, sign * z
            if best >= enough:
                return float(best)
    return best


@kernel
def place_boxes_into(box_centers: Array, positions_ws: Array, rotations_ws: Array, centers: Array, axes: Array) -> None:
    """World centres (J, 3) and axes (J, 3, 3) of every joint's box."""
    for joint in range(box_centers.shape[0]):
        rotate(rotations_ws[joint], box_centers[joint], centers[joint])
        for k in range(3):
            centers[joint, k] += positions_ws[joint, k]
        box_axes(rotations_ws[joint], axes[joint])


@kernel
def pair_gap(centers: Array, axes: Array, sizes: Array, a: int, b: int, axis: Array, enough: float = 1e9) -> float:
    """`box_gap` of two joints' boxes; pairs whose spheres are apart are not looked at closely."""
    d2, ra, rb = 0.0, 0.0, 0.0
    for k in range(3):
        d2 += (centers[a, k] - centers[b, k]) ** 2
        ra += sizes[a, k] * sizes[a, k]
        rb += sizes[b, k] * sizes[b, k]
    far = sqrt(ra) + sqrt(rb)
    if d2 > far * far:
        d = sqrt(d2)
        for k in range(3):
            axis[k] = (centers[a, k] - centers[b, k]) / d
        return d - far
    return box_gap(centers[a], axes[a], sizes[a], centers[b], axes[b], sizes[b], axis, enough)


@kernel
def deepest_overlap(pairs: Index, centers: Array, axes: Array, sizes: Array) -> float:
    """The largest depth (m, 0 for none) over pairs (P, 2) of joints."""
    worst = 0.0
    axis = np.empty(3)
    radii = np.empty(sizes.shape[0])
    for joint in range(sizes.shape[0]):
        radii[joint] = sqrt(sizes[joint, 0] ** 2 + sizes[joint, 1] ** 2 + sizes[joint, 2] ** 2)
    for n in range(pairs.shape[0]):
        a, b = pairs[n, 0], pairs[n, 1]
        dx, dy, dz = centers[a, 0] - centers[b, 0], centers[a, 1] - centers[b, 1], centers[a, 2] - centers[b, 2]
        far = radii[a] + radii[b] - worst  # spheres that overlap less than the worst cannot be worse
        if far > 0.0 and dx * dx + dy * dy + dz * dz < far * far:
            gap = box_gap(centers[a], axes[a], sizes[a], centers[b], axes[b], sizes[b], axis, -worst)
            worst = max(worst, -gap)
    return worst


@kernel
def deepest_overlap_batch_into(
    pairs: Index, box_centers: Array, sizes: Array, positions_ws: Array, rotations_ws: Array, depths: Array
) -> None:
    """The largest depth of each of N figures: positions (N, J, 3), orientations (N, J, 4), depths (N)."""
    joints = box_centers.shape[0]
    centers, axes = np.empty((joints, 3)), np.empty((joints, 3, 3))
    for n in range(positions_ws.shape[0]):
        place_boxes_into(box_centers, positions_ws[n], rotations_ws[n], centers, axes)
        depths[n] = deepest_overlap(pairs, centers, axes, sizes)


@lru_cache(maxsize=32)
def collision_pairs(skeleton: Skeleton) -> Index:
    """Pairs (P, 2) of joints whose boxes must not overlap.

    Left out: parts that hang from each other (joints without a box are passed over) and parts whose boxes
    overlap in the rest pose.
    """
    joints = [j for j in range(len(skeleton)) if skeleton.box_sizes[j].all()]
    above: dict[int, int] = {}
    for joint in joints:
        parent = int(skeleton.parents[joint])
        while parent >= 0 and parent not in joints:
            parent = int(skeleton.parents[parent])
        above[joint] = parent
    unturned = np.zeros((len(skeleton), 4))
    unturned[:, 3] = 1.0
    centers, axes = np.empty((len(skeleton), 3)), np.empty((len(skeleton), 3, 3))
    place_boxes_into(skeleton.box_centers, skeleton.rest_positions, unturned, centers, axes)
    axis = np.empty(3)
    pairs = [
        (a, b)
        for n, a in enumerate(joints)
        for b in joints[n + 1 :]
        if above[b] != a and above[a] != b and pair_gap(centers, axes, skeleton.box_sizes, a, b, axis) > 0.0
    ]
    found: Index = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    found.setflags(write=False)
    return found
