"""The support polygon on the ground and where the centre of mass stands in it.

Points are (x, z) in metres. Polygons run one way round (positive area in the x-z plane).
"""

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel

Array = NDArray[np.float64]


@kernel
def convex_hull_into(points: Array, count: int, hull: Array) -> int:
    """The convex hull of the first ``count`` of ``points`` (n, 2) by the monotone chain (Andrew 1979).

    ``hull`` (>= 2 count, 2) is written; returns how many corners it has (1 or 2 for degenerate sets).
    """
    order = np.arange(count)
    for i in range(1, count):
        j = i
        while j > 0:
            a, b = order[j - 1], order[j]
            if points[a, 0] > points[b, 0] or (points[a, 0] == points[b, 0] and points[a, 1] > points[b, 1]):
                order[j - 1], order[j] = b, a
                j -= 1
            else:
                break
    size = 0
    for step in range(2):
        start = size
        for n in range(count):
            p = points[order[n if step == 0 else count - 1 - n]]
            while size >= start + 2:
                ax, ay = hull[size - 1, 0] - hull[size - 2, 0], hull[size - 1, 1] - hull[size - 2, 1]
                bx, by = p[0] - hull[size - 2, 0], p[1] - hull[size - 2, 1]
                if ax * by - ay * bx <= 1e-12:
                    size -= 1
                else:
                    break
            hull[size, 0], hull[size, 1] = p[0], p[1]
            size += 1
        size -= 1  # the last point begins the other half
    return max(size, 1) if count > 0 else 0


@kernel
def margin_in_hull(hull: Array, size: int, x: float, z: float) -> float:
    """Signed distance (m) from a point to the polygon's edge: positive inside, negative outside."""
    if size == 0:
        return -1e9
    inside = size >= 3
    nearest = 1e18
    for n in range(size):
        ax, az = hull[n, 0], hull[n, 1]
        m = (n + 1) % size
        ex, ez = hull[m, 0] - ax, hull[m, 1] - az
        px, pz = x - ax, z - az
        if size >= 3 and ex * pz - ez * px < 0.0:
            inside = False
        length = ex * ex + ez * ez
        t = 0.0 if length < 1e-18 else min(1.0, max(0.0, (px * ex + pz * ez) / length))
        dx, dz = px - t * ex, pz - t * ez
        nearest = min(nearest, dx * dx + dz * dz)
    d = sqrt(nearest)
    return d if inside else -d


@kernel
def closest_in_hull(hull: Array, size: int, x: float, z: float, margin: float, out: Array) -> None:
    """The point nearest to (x, z) that lies in the polygon, ``margin`` (m) inside its edges.

    A polygon too small for the margin gives its middle on the way there; an empty one gives (x, z) back.
    """
    out[0], out[1] = x, z
    if size == 0:
        return
    if size >= 3:
        # Alternate projection onto the shrunk edges' half planes: few corners, few rounds.
        for _ in range(16):
            worst = 0.0
            for n in range(size):
                m = (n + 1) % size
                ex, ez = hull[m, 0] - hull[n, 0], hull[m, 1] - hull[n, 1]
                length = max(sqrt(ex * ex + ez * ez), 1e-12)
                nx, nz = -ez / length, ex / length
                depth = (out[0] - hull[n, 0]) * nx + (out[1] - hull[n, 1]) * nz - margin
                if depth < 0.0:
                    out[0] -= depth * nx
                    out[1] -= depth * nz
                    worst = max(worst, -depth)
            if worst < 1e-6:
                return
        if margin > 1e-6 and margin_in_hull(hull, size, out[0], out[1]) < 0.5 * margin:
            closest_in_hull_small(hull, size, x, z, out)
        return
    closest_in_hull_small(hull, size, x, z, out)


@kernel
def closest_in_hull_small(hull: Array, size: int, x: float, z: float, out: Array) -> None:
    """The middle of a polygon that is too small or too thin to have an inside worth the name."""
    out[0], out[1] = 0.0, 0.0
    for n in range(size):
        out[0] += hull[n, 0] / size
        out[1] += hull[n, 1] / size


def support_polygon(points: Array) -> Array:
    """The convex hull (k, 2) of ground points (n, 2)."""
    points = np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 2)
    hull = np.empty((2 * len(points) + 2, 2))
    return hull[: convex_hull_into(points, len(points), hull)].copy()


def closest_point(polygon: Array, point: Array, margin: float = 0.0) -> Array:
    """The point (2) of a convex polygon (k, 2) nearest to ``point`` (2), ``margin`` m inside the edges."""
    out = np.empty(2)
    hull = np.ascontiguousarray(polygon, dtype=np.float64)
    closest_in_hull(hull, len(hull), float(point[0]), float(point[1]), margin, out)
    return out
