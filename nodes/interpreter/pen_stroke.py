"""A pen's samples as points of four kinds, and the strokes that they make (Oshita 2005, section 5.1)."""

from dataclasses import dataclass, field
from math import atan2, cos, exp, inf, pi, sin
from typing import Literal

from bunraku.nodes.interpreter.pen_ground import Point, distance
from bunraku.nodes.interpreter.pen_rules import PenRules

Kind = Literal["moving", "stop", "landing", "reset"]


@dataclass(frozen=True)
class Sample:
    """One sample on the ground: before any stroke's offset."""

    time: float  # s
    place: Point
    contact: bool
    pressure: float = 0.0
    lean: Point = (0.0, 0.0)  # rad on the ground


@dataclass(frozen=True)
class StrokePoint:
    """A point of a stroke, in stroke space (continued from reset to reset)."""

    place: Point
    arc: float  # m from the stroke's beginning
    speed: float  # m/s of the pen
    lean: Point
    pressure: float
    time: float = 0.0  # s, when it was drawn


@dataclass(frozen=True)
class Event:
    """What a sample, or time, brought about.

    ``landing`` has the way from the lift (x, z) and the pressure before it; ``stop`` ends the present stroke; ``reset``
    has for how long (s) nothing was drawn before it.
    """

    kind: Kind
    way: Point = (0.0, 0.0)
    pressure: float = 0.0
    away: float = inf


@dataclass
class Stroke:
    """What was drawn since the last stop."""

    points: list[StrokePoint] = field(default_factory=list)
    began: float = 0.0  # s
    fast_since: float | None = None
    quick: float = 0.0
    """m/s now."""
    peak: float = 0.0
    """m/s at most so far."""

    @property
    def length(self) -> float:
        """m along the stroke."""
        return self.points[-1].arc if self.points else 0.0

    def unambiguous(self, now: float, rules: PenRules, heading: float | None = None) -> bool:
        """Whether it can become locomotion only, or leads where locomotion would.

        It goes far and fast and does not slow down, or it goes straight on for a figure that faces ``heading`` (rad
        from +Z): a step ahead and a short walk end at the same place with the same front.
        """
        if heading is not None and self.reach >= rules.early_least and self.aside(heading) <= rules.early_ahead:
            return True
        fast = self.fast_since is not None and now - self.fast_since >= rules.early_time
        return fast and self.reach >= rules.early_step and self.quick >= rules.early_share * self.peak

    def aside(self, heading: float) -> float:
        """rad between ``heading`` (from +Z) and the way from its beginning to its end, 0..pi."""
        if not self.points:
            return 0.0
        (x0, z0), (x1, z1) = self.points[0].place, self.points[-1].place
        return abs((atan2(x1 - x0, z1 - z0) - heading + pi) % (2.0 * pi) - pi)

    @property
    def reach(self) -> float:
        """m from its beginning to its end, straight."""
        return distance(self.points[0].place, self.points[-1].place) if self.points else 0.0


def jump_range(way: Point, heading: float, rules: PenRules) -> float:
    """How far (m) a figure that faces ``heading`` (rad from +Z) jumps in the direction of ``way`` (x, z)."""
    length = distance((0.0, 0.0), way)
    ahead = (way[0] * sin(heading) + way[1] * cos(heading)) / length if length > 1e-9 else 1.0
    return rules.jump_back + (rules.jump_range - rules.jump_back) * max(ahead, 0.0) ** 3


class PenTrack:
    """Tells moving, stop, landing and reset apart; a still pen sends nothing, so `wait` watches the clock."""

    def __init__(self, rules: PenRules) -> None:
        self.rules = rules
        self.reset((0.0, 0.0))

    def reset(self, place: Point) -> None:
        """Forget all; the next stroke begins at ``place`` (stroke space)."""
        self.stroke = Stroke()
        self.end = place
        """Where the last stroke ended: where the next one begins."""
        self.heading = 0.0
        """rad from +Z: where the figure will face when the stroke is done."""
        self.contact = False
        self.moved_at = 0.0
        self.stopped = True
        self._offset: Point = (0.0, 0.0)
        self._last: Sample | None = None
        self._lift: Sample | None = None
        self._anchor: Point = (0.0, 0.0)
        self._pressures: list[tuple[float, float]] = []
        self._speed = 0.0
        self._added_at = 0.0
        self._left_at = 0.0

    @property
    def cursor(self) -> Point | None:
        """Where a hovering pen would land, in stroke space, while a jump is still possible."""
        if self.contact or self._lift is None or self._last is None:
            return None
        return self._shift(self._last.place)

    def jumping(self, now: float) -> bool:
        """Whether a landing would be a jump."""
        return not self.contact and self._lift is not None and now - self._lift.time <= self.rules.jump_time

    def hear(self, sample: Sample) -> list[Event]:
        """Take a sample; gives what it brought about, in order."""
        rules = self.rules
        if self._last is not None and sample.time < self._last.time:
            sample = Sample(self._last.time, sample.place, sample.contact, sample.pressure, sample.lean)
        events: list[Event] = []
        if sample.contact and not self.contact:
            events += self._touch_down(sample)
        elif sample.contact:
            events += self._draw(sample)
        elif self.contact:
            self._lift = self._last if self._last is not None else sample
            self._lift = Sample(sample.time, self._lift.place, False, self._strongest(sample.time), self._lift.lean)
            self.contact = False
        self._last = sample
        if sample.contact:
            self._pressures = [one for one in self._pressures if sample.time - one[0] <= rules.press_window]
            self._pressures.append((sample.time, sample.pressure))
        return events

    def wait(self, now: float) -> list[Event]:
        """Let time pass: a stroke ends when its pen is still, or was lifted, for long enough."""
        if self.stopped:
            return []
        since = self.moved_at
        if not self.contact and self._lift is not None:
            since = min(since, self._lift.time) if self.stroke.length < self.rules.least_step else self._lift.time
        if now - since < self.rules.stop_time:
            return []
        return [self._stop()]

    def _stop(self) -> Event:
        self.stopped = True
        if self.stroke.points:
            self.end = self.stroke.points[-1].place
        return Event("stop")

    def _strongest(self, now: float) -> float:
        window = self.rules.press_window
        return max((pressure for time, pressure in self._pressures if now - time <= window), default=0.0)

    def _touch_down(self, sample: Sample) -> list[Event]:
        rules, lift = self.rules, self._lift
        self.contact = True
        if lift is not None:
            gap, away = sample.time - lift.time, distance(sample.place, lift.place)
            flung = gap <= rules.fling_time and away >= rules.fling_speed * gap
            if gap <= rules.bounce_time or (flung and not self.stopped):
                return self._draw(sample)
            way = (sample.place[0] - lift.place[0], sample.place[1] - lift.place[1])
            if gap <= rules.jump_time and away <= jump_range(way, self.heading, rules):
                events = [] if self.stopped else [self._stop()]
                self.end = (self.end[0] + way[0], self.end[1] + way[1])
                self._begin(sample)
                return [*events, Event("landing", way, lift.pressure)]
        events = [] if self.stopped else [self._stop()]
        away = sample.time - self.moved_at
        self._begin(sample)
        return [*events, Event("reset", away=away)]

    def _begin(self, sample: Sample) -> None:
        """A stroke begins where the last one ended, wherever the pen is."""
        self._offset = (self.end[0] - sample.place[0], self.end[1] - sample.place[1])
        self.stroke = Stroke(began=sample.time)
        self._anchor = sample.place
        self._left_at = sample.time
        self._speed = 0.0
        self.stopped = True
        self.moved_at = sample.time

    def _draw(self, sample: Sample) -> list[Event]:
        rules = self.rules
        if self.stopped:
            away = distance(sample.place, self._anchor)
            if away < rules.still:
                if away < rules.tremble:
                    self._left_at = sample.time
                return []
            before = self._left_at
            self.stroke = Stroke(began=before)
            self._add(Sample(before, self._anchor, True, sample.pressure, sample.lean), 0.0)
            self.stopped = False
        elif distance(sample.place, self._anchor) < rules.least_move:
            return []
        self._anchor = sample.place
        self._left_at = self.moved_at = sample.time
        dt = max(sample.time - self._added_at, 1e-3)
        here = self._shift(sample.place)
        step = distance(here, self.stroke.points[-1].place)
        share = 1.0 - exp(-dt / rules.speed_lag)
        self._speed += (step / dt - self._speed) * share if self.stroke.length > 0.0 else step / dt
        stroke = self.stroke
        stroke.quick += (step / dt - stroke.quick) * (1.0 - exp(-dt / rules.early_lag))
        stroke.peak = max(stroke.peak, stroke.quick)
        if self._speed < rules.early_speed:
            self.stroke.fast_since = None
        elif self.stroke.fast_since is None:
            self.stroke.fast_since = sample.time
        self._add(sample, step)
        return [Event("moving")]

    def _add(self, sample: Sample, step: float) -> None:
        arc = self.stroke.length + step
        here = self._shift(sample.place)
        point = StrokePoint(here, arc, self._speed, sample.lean, sample.pressure, sample.time)
        self.stroke.points.append(point)
        self._added_at = sample.time

    def _shift(self, place: Point) -> Point:
        return place[0] + self._offset[0], place[1] + self._offset[1]
