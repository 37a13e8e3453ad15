"""What a user sees: places on the picture, and what it takes them for on the ground.

Nothing but the picture comes in: tiles, obstacles with their shadows and tracks, the drawn path and the words as the
overlays show them, and the figure's feet, all as shares of the picture. Because the picture never turns, a user has
learnt how far apart on the ground two places of it are: `Floor`, taken from the first picture only.
"""

from dataclasses import dataclass, field
from math import tan

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.camera import axes, project
from bunraku.figure.fk import fk
from bunraku.figure.skeleton import Skeleton
from bunraku.msgs import Camera, Overlay, Pose, Primitive
from bunraku.nodes.course.drawing import THIN
from bunraku.nodes.interpreter.pen import PATH_COLOR

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Floor:
    """How the ground lies in a picture that may shift but never turns."""

    right: Array  # (3) directions of the picture, world axes as the first picture showed them
    up: Array
    back: Array
    height: float  # m of the eye above the ground
    wide: float  # half the picture's width and height at unit depth
    tall: float

    @classmethod
    def learnt(cls, camera: Camera) -> "Floor":
        """From the picture as it was at first."""
        right, up, back = axes(camera)
        tall = tan(0.5 * (camera.yfov or 0.576))
        return cls(right, up, back, float(camera.position[1]), tall * camera.aspect, tall)

    def at(self, shares: Array) -> Array:
        """(..., 2) m to the right and ahead, from under the eye, of places on the picture (..., 2) taken as ground."""
        u = (2.0 * shares[..., 0:1] - 1.0) * self.wide
        v = (1.0 - 2.0 * shares[..., 1:2]) * self.tall
        way = u * self.right + v * self.up - self.back
        t = self.height / np.maximum(-way[..., 1:2], 1e-3)
        ahead = np.array([-self.back[0], -self.back[2]])
        ahead /= np.linalg.norm(ahead)
        flat = (t * way)[..., [0, 2]]
        return np.stack([flat @ np.array([-ahead[1], ahead[0]]), flat @ ahead], axis=-1)


@dataclass(frozen=True, eq=False)
class Thing:
    """An obstacle as seen: what its word asks for, its track (2, 2) and its shadow (2, 2)."""

    asks: str
    track: Array
    shadow: Array


@dataclass(frozen=True, eq=False)
class Sight:
    """A glance, everything on the ground (m right and ahead of under the eye)."""

    time: float  # s
    tiles: Array  # (T, 4, 2)
    shown: NDArray[np.bool_]  # (T) whether a tile's middle is in the picture
    figure: Array  # (2) between the feet
    path: Array | None  # (2) the drawn path's end
    things: list[Thing] = field(default_factory=list)
    moved: float = 0.0
    """s at which the things were where they are seen: the picture may be older than the glance."""
    there: bool = False
    """The picture says that the goal is reached."""


def ground_of(floor: Floor, camera: Camera, one: Primitive) -> Array:
    """A primitive's points as they appear, taken as ground."""
    return floor.at(project(camera, np.array(one.points, dtype=np.float64)))


def look(
    time: float, floor: Floor, camera: Camera, skeleton: Skeleton, pose: Pose, course: Overlay, drawn: Overlay | None
) -> Sight:
    """Take a glance at the picture that these messages make."""
    polygons = [one for one in course.primitives if one.kind == "polygon"]
    others = [one for one in course.primitives if one.kind in ("line", "circle") and one.space == "world"]
    shares = project(camera, np.array([one.points for one in polygons], dtype=np.float64))
    middles = shares.mean(axis=1)
    shown = np.asarray((np.abs(middles - 0.5) <= 0.5).all(axis=1), dtype=np.bool_)
    things = []
    for track, shadow, body in zip(others, others[1:], others[2:], strict=False):
        # After a thin track on the ground come the thing's shadow and the thing itself.
        if track.size == THIN:
            things.append(Thing(body.label, ground_of(floor, camera, track), ground_of(floor, camera, shadow)))
    positions, _ = fk(skeleton, pose.root.astype(np.float64), pose.rotations.astype(np.float64))
    feet = [skeleton.roles["leftFoot"], skeleton.roles["rightFoot"]]
    soles = positions[feet].mean(axis=0) * [1.0, 0.0, 1.0] + [0.0, max(float(positions[feet, 1].min()) - 0.08, 0.0), 0]
    path = None
    for one in drawn.primitives if drawn is not None else []:
        if one.kind == "line" and one.color == PATH_COLOR:
            path = floor.at(project(camera, np.array(one.points[-1], dtype=np.float64)))
    words = [one.label for one in course.primitives if one.kind == "text"]
    return Sight(time, floor.at(shares), shown, floor.at(project(camera, soles)), path, things,
                 course.stamp * 1e-9, "There!" in words)  # fmt: skip
