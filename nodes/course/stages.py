"""The four stages: tiles on the ground and obstacles that go to and fro, in metres of the course's own ground.

A course begins at (0, 0) and leads along +Z at first, where a figure at rest faces; x is to its left. The paper shows
its stages in a figure (15) that the text does not describe: widths, lengths and obstacles are chosen here.
"""

from dataclasses import dataclass
from functools import cache
from math import atan2, cos, hypot, pi, sin

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Place = tuple[float, float]
"""(x, z) m."""
JUMP, DUCK, WAIT = "jump", "duck", ""
"""What an obstacle asks for: a bar to jump over, a beam to duck under, a pillar to let by."""


@dataclass(frozen=True)
class Obstacle:
    """A round bar that goes to and fro between two places at a steady speed.

    Its ends are ``first`` and ``second`` (x, height, z; m) from where its middle is on the ground.
    """

    asks: str
    begin: Place
    end: Place
    speed: float  # m/s
    first: tuple[float, float, float]
    second: tuple[float, float, float]
    radius: float  # m
    phase: float = 0.0
    """Share of a round trip that it is ahead at 0 s."""

    @property
    def way(self) -> float:
        """m from one turning place to the other."""
        return hypot(self.end[0] - self.begin[0], self.end[1] - self.begin[1])

    def at(self, seconds: float) -> Place:
        """Where its middle is after so many seconds."""
        if self.way < 1e-9:
            return self.begin
        trip = (seconds * self.speed / (2.0 * self.way) + self.phase) % 1.0
        share = 2.0 * trip if trip < 0.5 else 2.0 - 2.0 * trip
        (x0, z0), (x1, z1) = self.begin, self.end
        return x0 + share * (x1 - x0), z0 + share * (z1 - z0)

    def ends(self, seconds: float) -> Array:
        """Its two ends (2, 3) m after so many seconds."""
        x, z = self.at(seconds)
        placed: Array = np.array([self.first, self.second]) + np.array([x, 0.0, z])
        return placed


@dataclass(frozen=True, eq=False)
class Stage:
    """Tiles in their order, the first is the start and the last is the goal, and obstacles."""

    name: str
    says: str
    tiles: Array
    """(T, 4, 2) m: corners (x, z) of convex quadrilaterals, all the same way round."""
    obstacles: tuple[Obstacle, ...]

    def on(self, places: ArrayLike) -> NDArray[np.bool_]:
        """Whether places (n, 2) m lie on any tile, its rim included."""
        return np.asarray(inside(self.tiles, places).any(axis=1), dtype=np.bool_)

    def at_goal(self, place: ArrayLike) -> bool:
        """Whether a place (2) m lies on the goal."""
        return bool(inside(self.tiles[-1:], np.asarray(place, dtype=np.float64)[None])[0, 0])


def inside(tiles: Array, places: ArrayLike) -> NDArray[np.bool_]:
    """(n, T) whether each place (n, 2) lies in each convex tile (T, k, 2)."""
    at = np.asarray(places, dtype=np.float64).reshape(-1, 1, 1, 2)
    edges = np.roll(tiles, -1, axis=1) - tiles
    off = at - tiles
    cross = edges[..., 0] * off[..., 1] - edges[..., 1] * off[..., 0]
    return np.asarray((cross >= -1e-9).all(axis=2) | (cross <= 1e-9).all(axis=2))


def ribbon(line: ArrayLike, width: float) -> Array:
    """Quadrilaterals (n - 1, 4, 2) along a line (n, 2), mitred at its corners."""
    points = np.asarray(line, dtype=np.float64)
    ways = np.diff(points, axis=0)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    normals = np.stack([ways[:, 1], -ways[:, 0]], axis=1)
    side = np.vstack([normals[:1], normals[:-1] + normals[1:], normals[-1:]])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    beside = np.vstack([normals[:1], normals])
    side *= 0.5 * width / np.einsum("ni,ni->n", side, beside)[:, None]
    a, b = points + side, points - side
    return np.stack([a[:-1], a[1:], b[1:], b[:-1]], axis=1)


def square(x: float, z: float, width: float, depth: float | None = None) -> Array:
    """One tile (1, 4, 2) about a place."""
    w, d = 0.5 * width, 0.5 * (width if depth is None else depth)
    return np.array([[[x + w, z - d], [x + w, z + d], [x - w, z + d], [x - w, z - d]]])


def pillar(begin: Place, end: Place, speed: float, phase: float = 0.0) -> Obstacle:
    """A post to be let by: 1.1 m high, 0.36 m thick."""
    return Obstacle(WAIT, begin, end, speed, (0.0, 0.18, 0.0), (0.0, 0.92, 0.0), 0.18, phase)


def low_bar(begin: Place, end: Place, across: float, width: float, speed: float, phase: float = 0.0) -> Obstacle:
    """A bar 13 cm above the ground to jump over; it lies in direction ``across`` (rad from +Z)."""
    x, z = 0.5 * width * sin(across), 0.5 * width * cos(across)
    return Obstacle(JUMP, begin, end, speed, (x, 0.09, z), (-x, 0.09, -z), 0.04, phase)


def beam(begin: Place, end: Place, across: float, width: float, speed: float, phase: float = 0.0) -> Obstacle:
    """A beam whose lower side is 1.64 m above the ground: a figure that stands or walks upright hits it."""
    x, z = 0.5 * width * sin(across), 0.5 * width * cos(across)
    return Obstacle(DUCK, begin, end, speed, (x, 1.70, z), (-x, 1.70, -z), 0.06, phase)


def _straight() -> Stage:
    tiles = ribbon([(0.0, -0.5 + k) for k in range(10)], 1.5)
    across = 0.5 * pi
    obstacles = (
        pillar((-1.3, 2.6), (1.3, 2.6), 1.0),
        low_bar((0.0, 4.4), (0.0, 4.9), across, 1.5, 0.30, 0.2),
        pillar((1.3, 6.7), (-1.3, 6.7), 1.0, 0.3),
    )
    return Stage("the straight", "run", tiles, obstacles)


def _corners() -> Stage:
    line = [(0.0, -0.5), (0.0, 0.5), (0.0, 1.5), (0.0, 2.5), (1.0, 2.5), (2.0, 2.5), (3.0, 2.5),
            (3.0, 3.5), (3.0, 4.5), (3.0, 5.5), (2.0, 5.5), (1.0, 5.5), (0.0, 5.5), (-0.9, 5.5)]  # fmt: skip
    obstacles = (
        pillar((1.5, 1.3), (1.5, 3.7), 0.8),
        low_bar((3.0, 3.85), (3.0, 4.25), 0.5 * pi, 0.8, 0.25, 0.1),
        pillar((1.2, 6.7), (1.2, 4.3), 0.8, 0.4),
    )
    return Stage("corners", "turn at the corners", ribbon(line, 0.8), obstacles)


def _winding() -> Stage:
    at = np.linspace(0.0, 12.0, 1201)
    line = np.stack([1.0 * np.sin(2.0 * pi * at / 6.0), at], axis=1)
    arcs = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    marks = np.linspace(0.0, arcs[-1], 29)
    line = np.stack([np.interp(marks, arcs, line[:, 0]), np.interp(marks, arcs, line[:, 1])], axis=1)
    # The start lies behind the first bend and the goal behind the last one, both a little longer.
    first, last = line[1] - line[0], line[-1] - line[-2]
    line = np.vstack([line[0] - first, line, line[-1] + 1.4 * last])
    # Beams hang where the way changes from one bend to the next, square to it.
    lean = atan2(-2.0 * pi / 6.0, 1.0)
    x, z = 0.25 * sin(lean), 0.25 * cos(lean)
    obstacles = (
        beam((-x, 3.0 - z), (x, 3.0 + z), lean + 0.5 * pi, 1.0, 0.25),
        pillar((-2.2, 4.5), (0.2, 4.5), 0.8, 0.2),
        beam((-x, 9.0 - z), (x, 9.0 + z), lean + 0.5 * pi, 1.0, 0.25, 0.5),
    )
    return Stage("the winding way", "a narrow way in bends; duck under beams", ribbon(line, 0.5), obstacles)


def _islands() -> Stage:
    tiles = [square(0.0, 0.1, 0.8, 1.4), square(0.0, 1.7, 0.65), square(0.0, 2.9, 0.65), square(0.8, 3.7, 0.65),
             square(0.8, 4.9, 0.65), square(0.8, 6.5, 0.8, 1.5), square(0.8, 7.65, 0.8, 0.8)]  # fmt: skip
    obstacles = (
        pillar((-1.6, 2.3), (1.6, 2.3), 0.9),
        low_bar((0.8, 6.55), (0.8, 6.85), 0.5 * pi, 0.8, 0.20),
    )
    return Stage("islands", "jump from island to island", np.concatenate(tiles), obstacles)


@cache
def stages() -> tuple[Stage, ...]:
    """All stages; number 1 is the first."""
    return (_straight(), _corners(), _winding(), _islands())
