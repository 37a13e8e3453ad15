"""Camera rays and projection: what a place on the picture means in the world, and back.

A camera looks along its own -Z with +Y up (as in glTF). Places on the picture are shares: (0, 0) is its top-left
corner, (1, 1) its bottom-right one. All functions are pure and take the `Camera` message as it is.
"""

from dataclasses import dataclass
from math import asin, atan2, cos, pi, sin, sqrt, tan

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bunraku.msgs import Camera

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Orbit:
    """A camera on a sphere: the place it looks at, its direction from there, its distance and its lens."""

    center: tuple[float, float, float] = (0.0, 0.90, 0.0)  # m
    azimuth: float = 0.5517  # rad about +Y from +Z to the camera
    elevation: float = 0.1188  # rad above the horizon
    distance: float = 4.61  # m
    yfov: float = 0.5760  # rad, 33 degrees: a standing figure with room for its arms
    aspect: float = 16 / 9

    @property
    def eye(self) -> tuple[float, float, float]:
        """World position of the camera, m."""
        x, y, z = self.center
        level = self.distance * cos(self.elevation)
        return (
            x + level * sin(self.azimuth),
            y + self.distance * sin(self.elevation),
            z + level * cos(self.azimuth),
        )

    def camera(self) -> Camera:
        """The message that says this view."""
        return look_at(self.eye, self.center, yfov=self.yfov, aspect=self.aspect)


def orbit_from(eye: ArrayLike, center: ArrayLike, yfov: float, aspect: float) -> Orbit:
    """The orbit whose camera stands at ``eye`` (3) and looks at ``center`` (3)."""
    place, goal = np.asarray(eye, dtype=np.float64), np.asarray(center, dtype=np.float64)
    arm = place - goal
    distance = float(np.linalg.norm(arm))
    if distance < 1e-9:
        raise ValueError("the camera stands in the place it looks at")
    return Orbit(
        (float(goal[0]), float(goal[1]), float(goal[2])),
        atan2(float(arm[0]), float(arm[2])),
        asin(max(-1.0, min(1.0, float(arm[1]) / distance))),
        distance,
        yfov,
        aspect,
    )


def default_camera(aspect: float = 16 / 9) -> Camera:
    """Three-quarter front view of the standing default figure."""
    return Orbit(aspect=aspect).camera()


def look_at(
    eye: ArrayLike,
    center: ArrayLike,
    *,
    yfov: float | None = None,
    ortho_height: float | None = None,
    aspect: float = 16 / 9,
) -> Camera:
    """A level camera at ``eye`` (3) that looks at ``center`` (3), both world m.

    Looking straight up or down, the picture's top is towards -Z.
    """
    place = np.asarray(eye, dtype=np.float64)
    back = place - np.asarray(center, dtype=np.float64)
    length = float(np.linalg.norm(back))
    if length < 1e-9:
        raise ValueError("the camera stands in the place it looks at")
    back /= length
    side = np.array([back[2], 0.0, -back[0]])  # up cross back
    level = float(np.linalg.norm(side))
    side = np.array([1.0, 0.0, 0.0]) if level < 1e-9 else side / level
    q = quat_from_axes(side, np.cross(back, side), back)
    if yfov is None and ortho_height is None:
        yfov = Orbit.yfov
    return Camera(
        position=(float(place[0]), float(place[1]), float(place[2])),
        rotation=q,
        yfov=yfov,
        ortho_height=ortho_height,
        aspect=aspect,
    )


def quat_from_axes(x: ArrayLike, y: ArrayLike, z: ArrayLike) -> tuple[float, float, float, float]:
    """The quaternion (xyzw) of the frame with these world axes (orthonormal, right-handed)."""
    m = np.stack([np.asarray(x), np.asarray(y), np.asarray(z)], axis=1).astype(np.float64)
    # Shepperd's method: the largest of the four squares keeps the division well conditioned.
    squares = (m[0, 0], m[1, 1], m[2, 2], m[0, 0] + m[1, 1] + m[2, 2])
    k = int(np.argmax(squares))
    q = np.empty(4)
    if k == 3:
        q[:] = (m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], 1.0 + squares[3])
    else:
        i, j = (k + 1) % 3, (k + 2) % 3
        q[k] = 1.0 + m[k, k] - m[i, i] - m[j, j]
        q[i] = m[i, k] + m[k, i]
        q[j] = m[j, k] + m[k, j]
        q[3] = m[j, i] - m[i, j]
    q /= sqrt(float(q @ q))
    return (float(q[0]), float(q[1]), float(q[2]), float(q[3]))


def axes(camera: Camera) -> tuple[Array, Array, Array]:
    """The camera's own +X (right), +Y (up) and +Z (towards the viewer) as unit world vectors (3)."""
    x, y, z, w = camera.rotation
    n = x * x + y * y + z * z + w * w
    if n < 1e-12:
        return np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    s = 2.0 / n
    return (
        np.array([1.0 - s * (y * y + z * z), s * (x * y + w * z), s * (x * z - w * y)]),
        np.array([s * (x * y - w * z), 1.0 - s * (x * x + z * z), s * (y * z + w * x)]),
        np.array([s * (x * z + w * y), s * (y * z - w * x), 1.0 - s * (x * x + y * y)]),
    )


def forward(camera: Camera) -> Array:
    """The direction in which the camera looks, unit (3)."""
    return -axes(camera)[2]


def ray(camera: Camera, x: float, y: float) -> tuple[Array, Array]:
    """The touch line of a place on the picture (Oshita 2013 eq. 8): its origin (3) m and unit direction (3).

    A perspective camera's rays start in the camera; an orthographic one's are parallel and start beside it.
    """
    right, up, back = axes(camera)
    u, v = 2.0 * x - 1.0, 1.0 - 2.0 * y
    place = np.array(camera.position, dtype=np.float64)
    if camera.ortho_height is not None:
        half = 0.5 * camera.ortho_height
        return place + right * (u * half * camera.aspect) + up * (v * half), -back
    half = tan(0.5 * (camera.yfov or Orbit.yfov))
    direction = right * (u * half * camera.aspect) + up * (v * half) - back
    return place, direction / np.linalg.norm(direction)


def project(camera: Camera, points: ArrayLike) -> Array:
    """Shares of the picture (..., 2) where world points (..., 3) m appear; NaN for what is not before the camera."""
    local = to_camera(camera, points)
    depth = -local[..., 2]
    if camera.ortho_height is not None:
        half = np.full(depth.shape, 0.5 * camera.ortho_height)
    else:
        half = depth * tan(0.5 * (camera.yfov or Orbit.yfov))
    half = np.where(depth > 1e-6, half, np.nan)
    return np.stack(
        [0.5 + 0.5 * local[..., 0] / (half * camera.aspect), 0.5 - 0.5 * local[..., 1] / half],
        axis=-1,
    )


def to_camera(camera: Camera, points: ArrayLike) -> Array:
    """World points (..., 3) m in the camera's frame (x right, y up, -z is depth)."""
    basis = np.stack(axes(camera), axis=1)
    offsets: Array = np.asarray(points, dtype=np.float64) - np.array(camera.position)
    turned: Array = offsets @ basis
    return turned


def metres_per_height(camera: Camera, point: ArrayLike) -> float:
    """How many metres the picture's height spans at the depth of a world point (3); 0 behind the camera."""
    if camera.ortho_height is not None:
        return camera.ortho_height
    depth = -float(to_camera(camera, point)[2])
    return max(0.0, 2.0 * depth * tan(0.5 * (camera.yfov or Orbit.yfov)))


def on_plane(origin: Array, direction: Array, point: Array, normal: Array) -> float | None:
    """The ray parameter where it crosses a plane (Oshita 2013 eqs. 7-8); None behind its origin or along the plane."""
    slope = float(normal @ direction)
    if abs(slope) < 1e-9:
        return None
    t = float(normal @ (point - origin)) / slope
    return t if t > 0.0 else None


def letterbox(aspect: float, width: float, height: float) -> tuple[float, float, float, float]:
    """The largest rectangle of an aspect, centred in ``width`` by ``height``: (left, top, width, height)."""
    if width <= 0 or height <= 0 or aspect <= 0:
        raise ValueError("width, height and aspect must be positive")
    if width > aspect * height:
        inner = aspect * height
        return (0.5 * (width - inner), 0.0, inner, height)
    inner = width / aspect
    return (0.0, 0.5 * (height - inner), width, inner)


def wrap(angle: float) -> float:
    """An angle brought to -pi..pi."""
    return (angle + pi) % (2.0 * pi) - pi
