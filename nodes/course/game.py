"""The rules: a run from the start to the goal, its time, course-outs and collisions.

As in Oshita 2005, section 7.2, a record is the goal time, how often the figure left the course and how often an
obstacle hit it. One number of all three (`Score.points`) is this project's own.
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bunraku.nodes.course.stages import Place, Stage

Array = NDArray[np.float64]
Phase = Literal["ready", "running", "finished"]


@dataclass(frozen=True)
class Rules:
    """What counts, and how much."""

    begun: float = 0.10  # m that the hips have gone when the clock starts
    back: float = 0.30  # s with all standing feet on tiles after which a course-out is over
    clear: float = 0.50  # s without touch after which the same obstacle may hit again
    out_costs: float = 2.0  # s that a course-out adds to the points
    hit_costs: float = 3.0  # s that a collision adds


RULES = Rules()


@dataclass
class Score:
    """The record of a run."""

    seconds: float = 0.0
    outs: int = 0
    hits: int = 0

    def points(self, rules: Rules = RULES) -> float:
        """The time with all penalties, s: the less the better."""
        return self.seconds + rules.out_costs * self.outs + rules.hit_costs * self.hits


@dataclass
class Seen:
    """What the rules look at: the figure at a moment, in the course's own ground."""

    hips: Place
    feet: Array
    """(2, 2) m: the middle of each foot (x, z), left and right."""
    standing: tuple[bool, bool]
    starts: Array
    """(C, 3) m: the figure's round cones."""
    ends: Array
    radii: Array
    """(C, 2) m."""


@dataclass
class Game:
    """One run over a stage; times are s on any clock that goes on."""

    stage: Stage
    obstacles: bool = True
    rules: Rules = RULES
    phase: Phase = "ready"
    score: Score = field(default_factory=Score)
    off: bool = False
    """Whether the figure is off the course now."""
    touched: tuple[bool, ...] = ()
    """Whether each obstacle touches the figure now, or did until just before."""
    laid: float | None = None
    """When the course was laid: obstacles go from then on."""
    began: float = 0.0
    _stood: Place | None = None
    _on_since: float | None = None
    _touch: dict[int, float] = field(default_factory=dict)

    def since(self, now: float) -> float:
        """s since the course was laid."""
        if self.laid is None:
            self.laid = now
        return now - self.laid

    def update(self, now: float, seen: Seen) -> None:
        """Judge a pose."""
        t = self.since(now)
        if self.phase == "finished":
            return
        if self._stood is None:
            self._stood = seen.hips
        if self.phase == "ready":
            gone = np.hypot(seen.hips[0] - self._stood[0], seen.hips[1] - self._stood[1])
            if gone < self.rules.begun:
                return
            self.phase, self.began = "running", now
        self.score.seconds = now - self.began
        self._feet(now, seen)
        if self.obstacles:
            self._hits(now, t, seen)
        if self.stage.at_goal(seen.hips) and not self.off and any(seen.standing):
            self.phase = "finished"

    def _feet(self, now: float, seen: Seen) -> None:
        """A foot that stands beside the course is a course-out, counted once until all feet are back for a while."""
        standing = np.array(seen.standing)
        if not standing.any():
            return
        if not self.stage.on(seen.feet[standing]).all():
            self.score.outs += not self.off
            self.off, self._on_since = True, None
        elif self.off:
            if self._on_since is None:
                self._on_since = now
            elif now - self._on_since >= self.rules.back:
                self.off = False

    def _hits(self, now: float, t: float, seen: Seen) -> None:
        for number, obstacle in enumerate(self.stage.obstacles):
            a, b = obstacle.ends(t)
            if gap(seen.starts, seen.ends, seen.radii, a, b, obstacle.radius) < 0.0:
                self.score.hits += number not in self._touch
                self._touch[number] = now
            elif now - self._touch.get(number, now) >= self.rules.clear:
                del self._touch[number]
        self.touched = tuple(number in self._touch for number in range(len(self.stage.obstacles)))


def gap(starts: Array, ends: Array, radii: Array, a: Array, b: Array, radius: float) -> float:
    """The least distance (m) from round cones (C, 3), (C, 3), (C, 2) to a round bar from ``a`` to ``b`` (3).

    Negative where they meet. The cone's radius is taken at the point of its axis that is nearest to the bar's.
    """
    s, t = _nearest(starts, ends, a, b)
    on_cone = starts + s[:, None] * (ends - starts)
    on_bar = a + t[:, None] * (b - a)
    thick = radii[:, 0] + s * (radii[:, 1] - radii[:, 0])
    return float((np.linalg.norm(on_cone - on_bar, axis=1) - thick).min()) - radius


def _nearest(starts: Array, ends: Array, a: Array, b: Array) -> tuple[Array, Array]:
    """Shares (C) along segments and along one segment ``a`` to ``b`` where they are nearest to each other."""
    d1, d2, r = ends - starts, b - a, starts - a
    e1, e2 = np.einsum("ni,ni->n", d1, d1), float(d2 @ d2)
    c, f, k = np.einsum("ni,ni->n", d1, r), r @ d2, d1 @ d2
    size1, size2 = np.maximum(e1, 1e-12), max(e2, 1e-12)
    slope = e1 * e2 - k * k
    s = np.where(slope > 1e-9, np.clip((k * f - c * e2) / np.maximum(slope, 1e-9), 0.0, 1.0), 0.0)
    t = np.clip((k * s + f) / size2, 0.0, 1.0)
    s = np.clip((k * t - c) / size1, 0.0, 1.0)
    s = np.where(e1 > 1e-12, s, 0.0)
    t = np.clip((k * s + f) / size2, 0.0, 1.0)
    return s, t
