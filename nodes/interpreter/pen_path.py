"""The path that a figure is told to walk, made of the strokes that were drawn.

Posture and speed at a place are averages of the samples recorded near it (Oshita 2005, section 5.3). Beyond the
paper: a figure that lags hurries; the path can be made one that people walk, and goes round what stands in the way.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import atan2, ceil, floor, sqrt

import numpy as np
from numpy.typing import NDArray

from bunraku.msgs import PathPoint
from bunraku.nodes.interpreter.obstacles import NOTICE, Obstacle, detour
from bunraku.nodes.interpreter.pen_ground import Point, distance, duck_of, in_heading
from bunraku.nodes.interpreter.pen_rules import PenRules
from bunraku.nodes.interpreter.pen_stroke import StrokePoint

Array = NDArray[np.float64]
MOST_POINTS = 4000


def _arc(point: StrokePoint) -> float:
    return point.arc


@dataclass
class Walk:
    """A path being walked: whole, from the first stroke that began it."""

    id: int
    points: list[StrokePoint] = field(default_factory=list)
    complete: bool = False
    taken: int = 0
    """How many points of the present stroke it has."""
    base: float = 0.0
    """m of drawn arc length before the present stroke."""
    place: float = 0.0
    """m of drawn arc length where the figure is."""
    laid: Array = field(default_factory=lambda: np.zeros((0, 4)))
    """What was said last: drawn arc length, x, z and its own arc length (m) of each point."""
    sides: dict[str, int] = field(default_factory=dict)
    """Which side of an obstacle it passes."""
    rules: PenRules = field(default_factory=PenRules)

    @property
    def length(self) -> float:
        """m of path."""
        return self.points[-1].arc if self.points else 0.0

    @property
    def left(self) -> float:
        """m of path before the figure."""
        return self.length - self.place

    @property
    def heading(self) -> float | None:
        """Where a figure faces at its end, rad from +Z; None where it has no length."""
        if len(self.points) < 2:
            return None
        x, z = self.points[-1].place
        before = (one.place for one in reversed(self.points) if distance(one.place, (x, z)) > self.rules.end_way)
        back = next(before, self.points[0].place)
        return atan2(x - back[0], z - back[1])

    def locate(self, place: Point) -> None:
        """Find the figure on it, at most `PenRules.look_on` m beyond where it was."""
        if len(self.laid):
            spots = [(float(s), (float(x), float(z))) for s, x, z, _ in self.laid]
        else:
            spots = [(one.arc, one.place) for one in self.points]
        # Where a path comes back over itself the figure is on the part that comes first.
        near = [
            (distance(spot, place) + self.rules.look_near * (s - self.place), s)
            for s, spot in spots
            if self.place - 1e-9 <= s <= self.place + self.rules.look_on
        ]
        if near:
            self.place = max(self.place, min(near)[1])

    def lag(self, now: float, rules: PenRules) -> float:
        """s that the figure is behind the pen, beyond what walking after a hand takes anyway; at least 0."""
        if len(self.points) < 2:
            return 0.0
        near = self.between(self.place - rules.lag_about, self.place + rules.lag_about)
        drawn = float(np.interp(self.place, [one.arc for one in near], [one.time for one in near]))
        return max(now - drawn - rules.usual_lag, 0.0)

    def between(self, begin: float, end: float) -> list[StrokePoint]:
        """The points that were drawn from one arc length (m) to another, and one more on each side."""
        first = bisect_left(self.points, begin, key=_arc)
        last = bisect_right(self.points, end, key=_arc)
        return self.points[max(first - 1, 0) : last + 1]


def hurried(speeds: Array, gaps: Array, lag: float, rules: PenRules) -> Array:
    """Speeds (n, m/s) that make up for a lag (s) along a path whose points are ``gaps`` (n, m) apart.

    The pen's own speed, more by `PenRules.hurry` for each second of lag, within the running limit; the lag that is
    left goes down along the path.
    """
    out = np.empty_like(speeds)
    for k, speed in enumerate(speeds):
        out[k] = min(speed * min(1.0 + rules.hurry * lag, rules.most_hurry), rules.fastest)
        lag = max(lag - gaps[k] / speed + gaps[k] / out[k], 0.0)
    return out


def minimum_jerk(places: Array, width: float, spacing: float, most: float) -> Array:
    """Places (n, 2; m) as people walk: smoothed with the least jerk for their deviation, both ends kept.

    The kernel is that of the smoothing spline which minimises the squared third derivative, 1 / (1 + (width k)^6) for
    a wave number k; a corner of the angle a is cut by 2/3 width sin(a/2). No place moves farther than ``most`` m.
    """
    count = len(places)
    radius = min(ceil(12.0 * width / spacing), 8 * count)
    if count < 3 or radius < 1:
        return places
    s = np.abs(np.arange(-radius, radius + 1)) * spacing / width
    kernel = np.exp(-s) + 2.0 * np.exp(-0.5 * s) * np.cos(0.5 * sqrt(3.0) * s - np.pi / 3.0)
    kernel /= kernel.sum()
    # Beyond an end the path goes on as its mirror image through that end, which therefore stays where it is.
    out = np.empty_like(places)
    for k in range(2):
        line = places[:, k]
        period = np.concatenate([line, 2.0 * line[-1] - line[-2::-1]])
        rise = 2.0 * (line[-1] - line[0])
        index = np.arange(-radius, count + radius)
        turn, rest = np.divmod(index, 2 * (count - 1))
        padded = period[rest] + turn * rise
        out[:, k] = np.convolve(padded, kernel, "valid")
    off = out - places
    return np.asarray(places + off / np.sqrt(1.0 + (np.linalg.norm(off, axis=1) / most) ** 2)[:, None])


def slowed(speeds: Array, places: Array, gaps: Array, rules: PenRules) -> Array:
    """Speeds (n, m/s) bounded where a path (n, 2) bends, as people's are: sideways they accelerate only so much."""
    if len(places) < 5:
        return speeds
    step = np.gradient(places, axis=0)
    heading = np.unwrap(np.arctan2(step[:, 0], step[:, 1]))
    bend = np.abs(np.gradient(heading)) / np.maximum(gaps, 1e-6)
    half = round(rules.bend_about / rules.spacing)
    bend = np.convolve(np.pad(bend, half, "edge"), np.full(2 * half + 1, 1.0 / (2 * half + 1)), "valid")
    bound = np.sqrt(rules.sideways / np.maximum(bend, 1e-6))
    return np.minimum(speeds, np.maximum(bound, rules.slowest))


def averaged(points: list[StrokePoint], at: Array, rules: PenRules) -> tuple[Array, Array]:
    """The drawn path at arc lengths ``at``: places (n, 2) and, from the samples recorded within
    `PenRules.average` m, the pen's speed, lean (x, z) and duck (n, 4)."""
    arcs = np.array([one.arc for one in points])
    table = np.array([[*one.place, one.speed, *one.lean, duck_of(one.pressure, rules)] for one in points])
    places = np.stack([np.interp(at, arcs, table[:, k]) for k in range(2)], axis=1)
    sums = np.vstack([np.zeros(4), np.cumsum(table[:, 2:], axis=0)])
    low = np.searchsorted(arcs, at - rules.average)
    high = np.minimum(np.maximum(np.searchsorted(arcs, at + rules.average), low + 1), len(points))
    low = np.minimum(low, high - 1)
    return places, (sums[high] - sums[low]) / (high - low)[:, None]


def grid(begin: float, end: float, spacing: float) -> Array:
    """Arc lengths from about ``begin`` to ``end`` (m): multiples of ``spacing``, so that points keep their places
    while a path grows, and the end."""
    first, last = floor(begin / spacing + 1e-6), ceil(end / spacing - 1e-6)
    last = min(max(last, first + 1), first + MOST_POINTS - 1)
    at = np.arange(first, last + 1) * spacing
    at[-1] = end
    if at[0] >= end:
        at[0] = end - 1e-3
    return np.asarray(at)


def lay(
    walk: Walk, now: float, rules: PenRules, *, natural: bool = False, obstacles: Sequence[Obstacle] = ()
) -> tuple[list[PathPoint], float]:
    """The path from a little behind the figure on, and its own arc length (m) at the first point.

    What was said of the path under the figure's feet is not changed any more.

    Args:
        natural: walk as people do instead of exactly as was drawn.
        obstacles: what is gone round.
    """
    if not walk.points:
        return [], 0.0
    begin = max(walk.points[0].arc, walk.place - rules.behind)
    at = grid(begin, walk.length, rules.spacing)
    places, style = averaged(walk.between(begin - 1.0, walk.length), at, rules)
    if natural:
        whole = grid(max(walk.points[0].arc, begin - 10.0 * rules.natural_width), walk.length, rules.spacing)
        points = walk.between(float(whole[0]) - 0.1, walk.length)
        arcs, table = np.array([one.arc for one in points]), np.array([one.place for one in points])
        drawn = np.stack([np.interp(whole, arcs, table[:, k]) for k in range(2)], axis=1)
        places = minimum_jerk(drawn, rules.natural_width, rules.spacing, rules.natural_most)[-len(at) :]
    speeds = np.clip(style[:, 0], rules.slowest, rules.fastest)
    before = np.append(0.0, np.diff(at)) * (at > walk.place)
    speeds = hurried(speeds, before, walk.lag(now, rules), rules)
    free: Array | None = None
    if obstacles:
        # A pen that is still drawing is taken to go on straight: nobody walks up to where something comes by.
        more = 0 if walk.complete else round(NOTICE / rules.spacing)
        way = (places[-1] - places[max(len(places) - 4, 0)]) / max(min(3, len(places) - 1), 1)
        further = places[-1] + np.arange(1, more + 1)[:, None] * way
        eta = np.cumsum(np.append(before / speeds, np.full(more, rules.spacing / speeds[-1])))
        ahead = np.append(at, at[-1] + rules.spacing * np.arange(1, more + 1)) - walk.place
        places, free = detour(np.concatenate([places, further]), ahead, eta, obstacles, walk.sides)
        places, free = places[: len(at)], free[: len(at)]
    if natural or obstacles:
        places = _joined(walk, at, places, rules)
    gaps = np.append(0.0, np.hypot(*np.diff(places, axis=0).T))
    if natural:
        speeds = slowed(speeds, places, gaps, rules)
    if free is not None:
        speeds = speeds * free
    start = _own_arc(walk, at)
    walk.laid = np.column_stack([at, places, start + np.cumsum(gaps)])
    ways = np.gradient(places, axis=0)
    path = []
    for (x, z), speed, (_, lean_x, lean_z, duck), way in zip(places, speeds, style, ways, strict=True):
        tilt, bend = in_heading((float(lean_x), float(lean_z)), atan2(way[0], way[1]))
        path.append(
            PathPoint(x=float(x), z=float(z), speed=float(speed), tilt=tilt, bend=bend, duck=min(float(duck), 1.0))
        )
    return path, start


def _own_arc(walk: Walk, at: Array) -> float:
    """The first point's arc length along the path as it was said, which may be shorter or longer than as drawn."""
    said = walk.laid
    if not len(said):
        return float(max(at[0], 0.0))
    return float(max(np.interp(at[0], said[:, 0], said[:, 3]), 0.0))


def _joined(walk: Walk, at: Array, places: Array, rules: PenRules) -> Array:
    """A changed path that begins as the one before where the figure is already, and passes over softly."""
    said = walk.laid[: max(len(walk.laid) - 1, 0)]  # the end moves while the path grows
    if len(said) < 2:
        return places
    front = walk.place + rules.settled
    soft = max(min(rules.join, float(at[-1]) - front), 1e-6)
    share = np.clip((at - front) / soft, 0.0, 1.0)
    share = share * share * (3.0 - 2.0 * share)
    share[at > said[-1, 0] + 1e-9] = 1.0
    before = np.stack([np.interp(at, said[:, 0], said[:, 1 + k]) for k in range(2)], axis=1)
    return np.asarray(before + share[:, None] * (places - before))
