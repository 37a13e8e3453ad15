"""From the tablet or the picture to the ground."""

from math import cos, hypot, pi, sin

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.camera import forward, on_plane, ray
from bunraku.msgs import Camera, Pen
from bunraku.nodes.interpreter.pen_rules import PenRules

Array = NDArray[np.float64]
Point = tuple[float, float]
"""(x, z) m on the ground."""


def heading_axes(camera: Camera) -> tuple[Point, Point]:
    """The camera's right and forward on the ground, unit length; the pen's right and up.

    A camera that looks straight down takes its own up for forward.
    """
    way = forward(camera)
    flat = np.array([way[0], way[2]])
    if np.linalg.norm(flat) < 1e-3:
        x, y, z, w = camera.rotation
        flat = np.array([2.0 * (x * y - w * z), 2.0 * (y * z + w * x)])  # the rotated +Y
    flat = flat / np.linalg.norm(flat)
    return (-float(flat[1]), float(flat[0])), (float(flat[0]), float(flat[1]))


def on_tablet(pen: Pen, camera: Camera, rules: PenRules) -> Point:
    """A tablet's point by a fixed scale in the camera's heading; the tablet's top left is the origin."""
    width, height = pen.size_m or (rules.tablet_width, rules.tablet_width * 0.625)
    right, up = heading_axes(camera)
    a, b = pen.x * width * rules.scale, -pen.y * height * rules.scale
    return right[0] * a + up[0] * b, right[1] * a + up[1] * b


def on_picture(pen: Pen, camera: Camera, height: float = 0.0, far: float = 30.0) -> Point | None:
    """Where the pen's ray through the picture meets the ground; None above the horizon."""
    origin, direction = ray(camera, pen.x, pen.y)
    t = on_plane(origin, direction, np.array([0.0, height, 0.0]), np.array([0.0, 1.0, 0.0]))
    if t is None or t <= 0.0 or t > far:
        return None
    return float(origin[0] + t * direction[0]), float(origin[2] + t * direction[2])


def cap_direction(pen: Pen, camera: Camera) -> tuple[float, float, float]:
    """How far the pen leans off upright (rad) and where its cap points on the ground (x, z, unit length)."""
    right, up = heading_axes(camera)
    a, b = cos(pen.azimuth), -sin(pen.azimuth)
    return pi / 2 - pen.altitude, right[0] * a + up[0] * b, right[1] * a + up[1] * b


def lean_of(pen: Pen, camera: Camera, rules: PenRules) -> tuple[float, float]:
    """The lean (x, z) that the pen's tilt asks for: where the body's top goes, rad."""
    off, x, z = cap_direction(pen, camera)
    amount = min(max((off - rules.tilt_dead) / (rules.tilt_full - rules.tilt_dead), 0.0), 1.0) * rules.lean
    return x * amount, z * amount


def in_heading(lean: Point, heading: float) -> tuple[float, float]:
    """A lean on the ground as (tilt to the left, bend forward) of a figure that faces ``heading`` (rad from +Z)."""
    x, z = lean
    return x * cos(heading) - z * sin(heading), x * sin(heading) + z * cos(heading)


def duck_of(pressure: float, rules: PenRules) -> float:
    """How far the figure ducks, 0..1."""
    return min(max((pressure - rules.press_light) / (rules.press_full - rules.press_light), 0.0), 1.0)


def distance(a: Point, b: Point) -> float:
    """m between two points."""
    return hypot(a[0] - b[0], a[1] - b[1])
