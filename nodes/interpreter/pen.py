"""The pen as a puppet: strokes become walking, steps and jumps; tilt and pressure become posture.

After Oshita 2005, Pen-to-mime: the queue of points (5.1), the start of a motion (5.2), its parameters (5.3)
and the displays of section 3.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import atan2, exp
from typing import Any

import numpy as np

from bunraku.msgs import Camera, CommandBase, Jump, Locomotion, Pen, Primitive, Stand, Step
from bunraku.nodes.interpreter.core import Meaning, Scene
from bunraku.nodes.interpreter.obstacles import Obstacle
from bunraku.nodes.interpreter.pen_ground import (
    Point,
    distance,
    duck_of,
    in_heading,
    lean_of,
    on_picture,
    on_tablet,
)
from bunraku.nodes.interpreter.pen_path import Walk, lay
from bunraku.nodes.interpreter.pen_rules import PenRules
from bunraku.nodes.interpreter.pen_stroke import Event, PenTrack, Sample, jump_range

PATH_COLOR = (0.95, 0.72, 0.20, 1.0)
RANGE_COLOR = (0.25, 0.55, 0.90, 0.8)
FLOOR = 0.006
"""m above the ground at which paths are drawn."""


class PenCore:
    """One figure under one pen; a second pen is heard when the first is away."""

    def __init__(
        self, rules: PenRules | None = None, *, surface: str = "tablet", early: bool = False, natural: bool = False
    ) -> None:
        self.rules = rules or PenRules()
        self.surface = surface
        self.early, self.natural = early, natural
        self.obstacles: Sequence[Obstacle] = ()
        """What paths go round, now."""
        self.track = PenTrack(self.rules)
        self.walk: Walk | None = None
        self.walked: Walk | None = None
        """The path that the last stroke drew, walked or not yet; None after a step or a jump."""
        self.device = ""
        self.lean: Point = (0.0, 0.0)
        self.pressure = 0.0
        self.count = 0
        self._resumes = False
        self._placed = False
        self._time = 0.0
        self._near = False
        self._said: tuple[float, float, float, float | None] | None = None
        self._stand_id = 0
        self._twist: tuple[float, float] | None = None
        self._heading: float | None = None
        self._queue: list[CommandBase] = []
        self._changed = False
        self._walking_said = 0.0
        self._view: Camera | None = None

    @property
    def drawing(self) -> Point | None:
        """Where the path that is being drawn ends now, (x, z) m."""
        points = self.track.stroke.points
        return points[-1].place if points and self.track.contact and not self.track.stopped else None

    @property
    def holds_picture(self) -> bool:
        """Whether the pen draws on the picture itself, which then should not move under it."""
        return self.surface == "picture" and self.track.contact

    # The core's protocol

    @property
    def busy(self) -> bool:
        """A pen is near, or a stroke or a walk goes on."""
        return self._near or not self.track.stopped or self.walk is not None or self.pressure > 1e-3

    def hear(self, message: Pen, scene: Scene) -> None:
        """A pen's sample."""
        if self.device and message.device != self.device and self._near:
            return
        self.device = message.device
        self._settle(scene)
        self._near = message.in_range
        place = self._place(message, scene)
        time = self._sample_time(message, scene.now)
        share = 1.0 - exp(-max(time - self._time, 0.0) / self.rules.posture_lag) if self._time else 1.0
        self._time = time
        lean = lean_of(message, scene.camera, self.rules) if message.in_range else (0.0, 0.0)
        self.lean = tuple(a + (b - a) * share for a, b in zip(self.lean, lean, strict=True))  # type: ignore[assignment]
        wanted = message.pressure if message.contact else 0.0
        self.pressure += (wanted - self.pressure) * share
        self._turn(message, scene)
        if place is None:
            return
        sample = Sample(time, place, message.contact and message.in_range, message.pressure, self.lean)
        self.track.heading = self._faces(scene)
        for event in self.track.hear(sample):
            self._take(event, scene)

    def lose(self, device: str, scene: Scene) -> None:
        """The pen is gone: its stroke ends where it was."""
        if device != self.device:
            return
        self._near = False
        self._twist = None
        if self.track.contact:
            self.track.contact = False
            self.track.moved_at = min(self.track.moved_at, scene.now)
        self.lean, self.pressure = (0.0, 0.0), 0.0

    def update(self, scene: Scene) -> Meaning:
        """Commands for what was drawn, and what to show."""
        self._settle(scene)
        for event in self.track.wait(scene.now):
            self._take(event, scene)
        if not self._near:  # nobody sends samples any more: the posture eases by itself
            stay = exp(-max(scene.now - self._time, 0.0) / self.rules.posture_lag)
            self.pressure *= stay
            self.lean = (self.lean[0] * stay, self.lean[1] * stay)
            self._time = scene.now
        self._follow(scene)
        commands, self._queue = self._queue, []
        if self.walk is not None:
            since = scene.now - self._walking_said
            again = since >= self.rules.say_again and self._wants_again(self.walk, scene)
            if again or (self._changed and (self.walk.complete or since >= self.rules.say_every)):
                self._walking_said = scene.now
                self._changed = False
                commands.append(self._locomotion(self.walk, scene))
        elif self.walk is None:
            posture = self._posture(scene)
            if posture is not None:
                commands.append(posture)
        if self.walk is None:
            self._changed = False
        return Meaning(commands=commands, overlay=self._draw(scene))

    def save(self) -> dict[str, Any]:
        """Where the next stroke begins, and the counter of commands."""
        return {"count": self.count, "end": list(self.track.end), "placed": self._placed}

    def restore(self, state: dict[str, Any], scene: Scene) -> None:
        """Take up after a crash: a pen in contact goes on from the last stroke's end."""
        self.count = int(state.get("count", 0))
        x, z = state.get("end", (0.0, 0.0))
        self.track.reset((float(x), float(z)))
        self._placed = bool(state.get("placed"))

    # Strokes

    def _take(self, event: Event, scene: Scene) -> None:
        rules, stroke = self.rules, self.track.stroke
        if event.kind == "reset":
            self._resumes = self.walked is not None and (self.walk is not None or event.away <= rules.resume)
        elif event.kind == "moving":
            if self._resumes:
                self._resume(scene)
            if self.walk is None and self._is_locomotion():
                self.walk = Walk(self._next_id(scene), rules=self.rules)
            elif self.walk is not None and self.walk.complete and self.walk.left > rules.rejoin:
                self._lengthens(self.walk)
            if self.walk is not None and not self.walk.complete:
                self._lengthen(self.walk)
        elif event.kind == "stop":
            if self.walk is not None and not self.walk.complete:
                self._lengthen(self.walk)
                self.walk.complete = True
                self.walked, self._changed = self.walk, True
            elif self.walk is None and stroke.reach >= rules.least_step:
                x, z = stroke.points[-1].place
                self._queue.append(Step(id=self._next_id(scene), goal=(x, 0.0, z)))
                self.walked, self._resumes = None, False
            elif self.walk is None and stroke.points and not self._resumes:
                self.track.end = stroke.points[0].place  # a twitch moves nothing
        elif event.kind == "landing":
            self.walked, self._resumes = None, False
            if self.walk is not None:
                self.walk.complete = True
                self._queue.append(self._locomotion(self.walk, scene))
                self.walk, self._said = None, None
            away = distance((0.0, 0.0), event.way)
            height = rules.jump_low + (rules.jump_high - rules.jump_low) * min(max(event.pressure, 0.0), 1.0)
            goal = None if away <= rules.jump_same else (self.track.end[0], 0.0, self.track.end[1])
            if goal is None:
                self.track.end = (self.track.end[0] - event.way[0], self.track.end[1] - event.way[1])
            self._queue.append(Jump(id=self._next_id(scene), goal=goal, height=height))

    def _resume(self, scene: Scene) -> None:
        """A stroke that follows a reset goes on with the path before it, however short it is."""
        rules, stroke = self.rules, self.track.stroke
        if self.walk is None and self.walked is not None:  # the figure has arrived: whoever goes on, goes on ahead
            heading = self.walked.heading
            if stroke.reach < rules.least_step or heading is None:
                return
            if stroke.aside(heading) > rules.resume_aside:
                self._resumes = False
                return
            self.walk = replace(self.walked, id=self._next_id(scene))
        self._resumes = False
        if self.walk is not None:
            self._lengthens(self.walk)

    @staticmethod
    def _lengthens(walk: Walk) -> None:
        """The present stroke goes on where a path ended."""
        walk.complete, walk.base, walk.taken = False, walk.length, 0

    def _is_locomotion(self) -> bool:
        rules, stroke = self.rules, self.track.stroke
        if stroke.length > rules.longest_step:
            return True
        return self.early and stroke.unambiguous(self.track.moved_at, rules, self.track.heading)

    def _lengthen(self, walk: Walk) -> None:
        fresh = self.track.stroke.points[walk.taken :]
        for one in fresh:
            arc = walk.base + one.arc
            if not walk.points or arc > walk.length:
                walk.points.append(replace(one, arc=arc))
        walk.taken = len(self.track.stroke.points)
        self._changed = self._changed or bool(fresh)

    def _locomotion(self, walk: Walk, scene: Scene) -> Locomotion:
        path, start = lay(walk, scene.now, self.rules, natural=self.natural, obstacles=self.obstacles)
        return Locomotion(id=walk.id, path=path, start=start, complete=walk.complete)

    def _wants_again(self, walk: Walk, scene: Scene) -> bool:
        """Whether a path that did not grow is to be said anew: the figure lags, or something is in its way."""
        return bool(walk.points) and (bool(self.obstacles) or walk.lag(scene.now, self.rules) > 0.0)

    def _follow(self, scene: Scene) -> None:
        """Where the figure is on its path; a path that was walked to its end is done with."""
        walk = self.walk
        if walk is None:
            return
        walk.locate(self._figure(scene))
        if walk.complete and walk.left <= self.rules.arrived:
            if self._changed:  # the last word of a path that the figure has caught up with
                self._queue.append(self._locomotion(walk, scene))
            self.walk = None
            self._said = None
        elif walk.place - walk.points[0].arc > 12.0 * self.rules.behind:
            keep = walk.place - 8.0 * self.rules.behind  # more than is said: the natural path looks back
            first = next(k for k, one in enumerate(walk.points) if one.arc >= keep)
            if first > 400:
                del walk.points[:first]

    # Posture

    def _posture(self, scene: Scene) -> Stand | None:
        tilt, bend = in_heading(self.lean, self._yaw(scene))
        duck = duck_of(self.pressure, self.rules)
        now = (tilt, bend, duck, self._heading)
        said = self._said
        if said is None:
            if max(abs(tilt), abs(bend), duck) < self.rules.posture_step and self._heading is None:
                return None
            self._stand_id = self._next_id(scene)
        elif all(abs((a or 0.0) - (b or 0.0)) < self.rules.posture_step for a, b in zip(now, said, strict=True)):
            return None
        self._said = now
        return Stand(id=self._stand_id, tilt=tilt, bend=bend, duck=duck, heading=self._heading)

    def _turn(self, pen: Pen, scene: Scene) -> None:
        """A pen that tells its twist turns the standing body."""
        if pen.twist is None or not pen.in_range or self.walk is not None:
            self._twist = None
            if self.walk is not None:
                self._heading = None
            return
        if self._twist is None:
            self._twist = (pen.twist, self._yaw(scene))
        from_twist, from_yaw = self._twist
        turned = atan2(*_sin_cos(pen.twist - from_twist))
        if self._heading is not None or abs(turned) > self.rules.twist_dead:
            self._heading = from_yaw - turned  # clockwise from above is negative about +Y

    # Places and times

    def _place(self, pen: Pen, scene: Scene) -> Point | None:
        if self.surface == "picture":
            return on_picture(pen, scene.camera)
        if self._view is None or not (self.track.contact or self.track.jumping(scene.now)):
            self._view = scene.camera  # a camera that turns under a stroke does not bend it
        return on_tablet(pen, self._view, self.rules)

    def _sample_time(self, pen: Pen, now: float) -> float:
        """The device's own time where it is sound, so that the way here adds no jitter to speeds."""
        sampled = (pen.origin or 0) * 1e-9
        return sampled if 0.0 <= now - sampled < self.rules.oldest_sample else now

    def _figure(self, scene: Scene) -> Point:
        hips = scene.positions[scene.joint("hips")]
        return float(hips[0]), float(hips[2])

    def _yaw(self, scene: Scene) -> float:
        x, y, z, w = (float(v) for v in scene.turns[scene.joint("hips")])
        return atan2(2.0 * (x * z + w * y), 1.0 - 2.0 * (x * x + y * y))

    def _faces(self, scene: Scene) -> float:
        """Where the figure faces, or will when it has walked its path, rad from +Z."""
        heading = self.walk.heading if self.walk is not None else None
        return self._yaw(scene) if heading is None else heading

    def _settle(self, scene: Scene) -> None:
        """While nothing is drawn, the next stroke begins where the figure stands."""
        here = self._figure(scene)
        if not self._placed:
            self._placed = True
            self.track.end = here
        idle = self.track.stopped and not self.track.contact and self.walk is None and not self._queue
        if idle and all(scene.planted) and scene.now - self.track.moved_at > self.rules.settle_time:
            self.track.end = here

    def _next_id(self, scene: Scene) -> int:
        self.count = max(self.count + 1, int(scene.now * 1e3))
        return self.count

    # Display

    def _draw(self, scene: Scene) -> list[Primitive]:
        shown: list[Primitive] = []
        points = self.walk.points if self.walk is not None else self.track.stroke.points
        if len(points) > 1 and (self.walk is not None or not self.track.stopped):
            keep = points[:: max(1, len(points) // 300)]
            if keep[-1] is not points[-1]:
                keep = [*keep, points[-1]]
            line: list[tuple[float, ...]] = [(one.place[0], FLOOR, one.place[1]) for one in keep]
            shown.append(Primitive(kind="line", points=line, color=PATH_COLOR, size=0.02))
        if self.track.jumping(scene.now):
            stroke = self.track.stroke.points
            x, z = self.track.end if self.track.stopped or not stroke else stroke[-1].place
            shown.append(
                Primitive(
                    kind="circle", points=[(x, FLOOR, z)], color=RANGE_COLOR, size=self.rules.jump_same, label="jump"
                )
            )
            edge: list[tuple[float, ...]] = []
            for k in range(49):
                s, c = _sin_cos(2.0 * np.pi * k / 48)
                reach = jump_range((s, c), self.track.heading, self.rules)
                edge.append((x + reach * s, FLOOR, z + reach * c))
            shown.append(Primitive(kind="line", points=edge, color=RANGE_COLOR, size=0.02))
        cursor = self.track.cursor
        if cursor is not None and self._near:
            shown.append(Primitive(kind="circle", points=[(cursor[0], FLOOR, cursor[1])], color=PATH_COLOR, size=0.06))
        return shown


def _sin_cos(angle: float) -> tuple[float, float]:
    return float(np.sin(angle)), float(np.cos(angle))
