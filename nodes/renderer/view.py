"""What one picture shows, and the look that every engine shares."""

from dataclasses import dataclass, field
from math import tan
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.camera import Orbit, axes
from bunraku.figure.skeleton import Skeleton
from bunraku.msgs import Camera, Primitive

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]


@dataclass(frozen=True)
class Look:
    """Colours and light. Colours are sRGB 0..1."""

    background: tuple[float, float, float] = (0.855, 0.880, 0.908)
    ground: tuple[float, float, float] = (0.900, 0.905, 0.912)
    key: tuple[float, float, float] = (-0.4201, 0.7701, 0.4801)
    """Unit, towards the light."""
    shadow: float = 0.60
    """Darkness of a shadow's core, 0..1."""
    near: float = 0.05  # m
    far: float = 120.0  # m


LOOK = Look()


@dataclass(frozen=True, eq=False)
class Figure:
    """A figure as it stands now."""

    skeleton: Skeleton
    positions_ws: Array  # (J, 3) m
    rotations_ws: Array  # (J, 4) xyzw


@dataclass(frozen=True, eq=False)
class Layer:
    """What one node draws over the picture."""

    primitives: tuple[Primitive, ...]
    parents: tuple[int, ...] = ()
    """(J) of its figure's skeleton, for stick figures."""


@dataclass(frozen=True, eq=False)
class View:
    """One picture: the camera, the figures and what is drawn over them."""

    camera: Camera
    figures: tuple[Figure, ...] = ()
    layers: tuple[Layer, ...] = ()
    center: tuple[float, float] = field(default=(0.0, 0.0))
    """World x, z (m) around which the ground is lit."""


class Engine(Protocol):
    """Draws figures on their ground."""

    name: str

    def draw(self, view: View, width: int, height: int) -> Pixels:
        """(height, width, 4): colour, and what share of each pixel is figure; valid until the next call."""
        ...

    def close(self) -> None:
        """Free what it holds."""
        ...


def view_matrix(camera: Camera) -> Array:
    """(4, 4) world to the camera's frame."""
    out = np.eye(4)
    basis = np.stack(axes(camera))
    out[:3, :3] = basis
    out[:3, 3] = -basis @ np.array(camera.position)
    return out


def projection_matrix(camera: Camera, near: float = LOOK.near, far: float = LOOK.far) -> Array:
    """(4, 4) the camera's frame to clip space (OpenGL's, y up)."""
    out = np.zeros((4, 4))
    if camera.ortho_height is not None:
        half = 0.5 * camera.ortho_height
        out[0, 0], out[1, 1] = 1.0 / (half * camera.aspect), 1.0 / half
        out[2, 2], out[2, 3], out[3, 3] = -2.0 / (far - near), -(far + near) / (far - near), 1.0
        return out
    half = tan(0.5 * (camera.yfov or Orbit.yfov))
    out[0, 0], out[1, 1] = 1.0 / (half * camera.aspect), 1.0 / half
    out[2, 2], out[2, 3], out[3, 2] = -(far + near) / (far - near), -2.0 * far * near / (far - near), -1.0
    return out
