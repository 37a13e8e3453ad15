"""The course as a user takes it in: the middle of the way, its gaps, and where moving things cross it."""

from dataclasses import dataclass
from math import atan2, degrees, hypot

import numpy as np
from numpy.typing import NDArray

from .sight import Thing

Array = NDArray[np.float64]
STEP = 0.05  # m between samples of the way
LEAST_GAP = 0.15  # m between tiles that nobody walks over
FOOT = 0.27  # m that a foot reaches before the hips when it pushes off
LANDING = 0.35  # m beyond a far edge at which one lands


@dataclass(frozen=True)
class Gap:
    """Where one has to jump: arc lengths (m) of the take-off and the landing."""

    number: int
    off: float
    on: float


@dataclass(frozen=True, eq=False)
class Route:
    """The way along the tiles' middles, sampled evenly."""

    places: Array  # (n, 2) m
    arcs: Array  # (n) m
    widths: Array  # (n) m
    gaps: tuple[Gap, ...]

    @property
    def end(self) -> float:
        """m to the goal's middle."""
        return float(self.arcs[-1])

    def at(self, arc: float) -> Array:
        """The place (2) at an arc length, clamped."""
        x = np.interp(arc, self.arcs, self.places[:, 0])
        return np.array([x, np.interp(arc, self.arcs, self.places[:, 1])])

    def width(self, arc: float) -> float:
        """m across the way."""
        return float(np.interp(arc, self.arcs, self.widths))

    def way(self, arc: float, over: float = 0.2) -> Array:
        """Unit direction (2)."""
        step = self.at(arc + over) - self.at(arc - 0.02)
        return np.asarray(step / max(float(np.hypot(*step)), 1e-9))

    def turn(self, arc: float, over: float) -> float:
        """Degrees between the direction here and the one farthest off it within ``over`` m."""
        here = self.way(arc)
        most = 0.0
        for k in range(1, 7):
            there = self.way(arc + over * k / 6.0)
            most = max(most, abs(degrees(atan2(here[0] * there[1] - here[1] * there[0], float(here @ there)))))
        return most

    def nearest(self, place: Array, before: float | None = None, window: float = 1.5) -> float:
        """Arc length of the way's nearest point, within ``window`` m of ``before`` where that is known."""
        away = np.hypot(*(self.places - place).T)
        if before is not None:
            away = np.where(np.abs(self.arcs - before) <= window, away, np.inf)
        return float(self.arcs[int(np.argmin(away))])

    def crossing(self, thing: Thing) -> tuple[float, float]:
        """Arc lengths between which a thing may be on the way; both the same for one that goes across."""
        a, b = thing.track
        arcs = []
        for share in np.linspace(0.0, 1.0, 9):
            away = np.hypot(*(self.places - (a + share * (b - a))).T)
            k = int(np.argmin(away))
            arcs.append((float(away[k]), float(self.arcs[k])))
        nearest = min(arcs)[1]
        along = [arc for away, arc in arcs if away < 0.5 * self.width(arc)]
        if abs(float((b - a) @ self.way(nearest))) < 0.5 * hypot(*(b - a)):
            return nearest, nearest
        return (min(along), max(along)) if along else (nearest, nearest)


def border(tile: Array, way: Array) -> float:
    """m from the middle of a convex tile (4, 2) to its rim in a direction (2)."""
    middle = tile.mean(axis=0)
    best = np.inf
    for a, b in zip(tile, np.roll(tile, -1, axis=0), strict=True):
        edge = b - a
        across = way[0] * edge[1] - way[1] * edge[0]
        if abs(across) < 1e-9:
            continue
        off = a - middle
        t = (off[0] * edge[1] - off[1] * edge[0]) / across
        s = (off[0] * way[1] - off[1] * way[0]) / across
        if t > 0.0 and -1e-6 <= s <= 1.0 + 1e-6:
            best = min(best, float(t))
    return best if np.isfinite(best) else 0.0


def route_of(tiles: Array) -> Route:
    """The way along tiles (T, 4, 2) in their order; T >= 2."""
    middles = tiles.mean(axis=1)
    ways = np.diff(middles, axis=0)
    lengths = np.hypot(*ways.T)
    marks = np.concatenate([[0.0], np.cumsum(lengths)])
    gaps = []
    for k in range(len(tiles) - 1):
        way = ways[k] / max(lengths[k], 1e-9)
        out, into = border(tiles[k], way), border(tiles[k + 1], -way)
        if lengths[k] - out - into > LEAST_GAP:
            off = marks[k] + max(out - FOOT, 0.0)
            on = marks[k + 1] - max(into - LANDING, 0.0)
            gaps.append(Gap(k, float(off), float(on)))
    arcs = np.append(np.arange(0.0, marks[-1], STEP), marks[-1])
    places = np.stack([np.interp(arcs, marks, middles[:, i]) for i in range(2)], axis=1)
    normals = np.vstack([ways, ways[-1:]])[:, ::-1] * [1.0, -1.0]
    normals = normals / np.maximum(np.hypot(*normals.T)[:, None], 1e-9)
    across = np.array([2.0 * min(border(t, n), border(t, -n)) for t, n in zip(tiles, normals, strict=True)])
    return Route(places, arcs, np.interp(arcs, marks, across), tuple(gaps))
