"""The gamepad as the pen's baseline: sticks are velocities, not places (Oshita 2005, section 7.1).

Left stick: direction and speed of walking, seen from the camera. Right stick: lean and bend; with the jump or the
step button pressed, direction and distance of a jump or a step. The longer the duck button is held, the lower.
"""

from collections import deque
from dataclasses import dataclass
from math import atan2, cos, hypot, pi, sin
from typing import Any

from bunraku.msgs import CommandBase, Jump, Locomotion, Pad, PathPoint, Stand, Step
from bunraku.nodes.interpreter.core import Meaning, Scene
from bunraku.nodes.interpreter.pen_ground import Point, heading_axes, in_heading


@dataclass(frozen=True)
class PadRules:
    """What sticks and buttons mean; numbers of axes and buttons are those of the standard gamepad of browsers."""

    dead: float = 0.15  # of a stick, radial
    walk: tuple[int, int] = (0, 1)  # axes, right and down
    body: tuple[int, int] = (2, 3)
    jump: int = 0  # buttons
    step: int = 1
    duck: int = 5
    slowest: float = 0.6  # m/s at the least tilt
    fastest: float = 3.6  # m/s at the full tilt
    turning: float = 3.0  # rad/s of a walk's direction
    ahead: float = 0.8  # s of path laid out before the figure
    lead: float = 0.10  # s of path that is not changed any more
    brake: float = 5.0  # m/s² when the stick is let go; people stop from a run by 4 to 6
    stop: float = 0.35  # m that a figure goes on at least then
    notice: float = 0.15  # s over which its speed is seen
    spacing: float = 0.05  # m
    longest_step: float = 0.60  # m at the full tilt: one step in every direction
    longest_jump: float = 1.2  # m
    jump_high: float = 0.35  # m
    lean: float = 0.70  # rad at the full tilt
    duck_time: float = 0.8  # s of pressing for the full duck

    def coast(self, speed: float) -> float:
        """How far (m) a figure of this speed (m/s) goes on when the stick is let go."""
        return max(self.stop, speed * speed / (2.0 * self.brake))


@dataclass
class Way:
    """The path that the stick lays out: points (x, z) m with their arc lengths (m)."""

    id: int
    points: list[tuple[float, float, float]]
    place: float = 0.0
    """m of arc length where the figure is."""


def stick(axes: list[float], pair: tuple[int, int], dead: float) -> tuple[float, float]:
    """A stick beyond its radial dead zone: (right, up), at most 1 long."""
    x, y = (axes[k] if k < len(axes) else 0.0 for k in pair)
    length = hypot(x, y)
    if length <= dead:
        return 0.0, 0.0
    share = min((length - dead) / (1.0 - dead), 1.0) / length
    return x * share, -y * share


class PadCore:
    """One figure under one gamepad."""

    def __init__(self, rules: PadRules | None = None) -> None:
        self.rules = rules or PadRules()
        self.device = ""
        self.count = 0
        self._axes: list[float] = []
        self._buttons: list[bool] = []
        self._pressed: tuple[bool, bool] = (False, False)
        self._way: Way | None = None
        self._duck = 0.0
        self._time: float | None = None
        self._track: deque[tuple[float, float, float]] = deque()  # s; x, z m of the figure
        self._said: tuple[float, float, float] | None = None
        self._stand_id = 0
        self._queue: list[CommandBase] = []

    @property
    def busy(self) -> bool:
        """A stick is tilted, a button is pressed or a walk goes on."""
        return bool(self._buttons or self._axes) and (
            self._way is not None or any(self._buttons) or self._duck > 0.0
            or any(abs(value) > self.rules.dead for value in self._axes)
        )  # fmt: skip

    def hear(self, message: Pad, scene: Scene) -> None:
        """A gamepad's sample; a second one is heard when the first is gone."""
        if self.device and message.device != self.device:
            return
        self.device = message.device
        self._axes, self._buttons = list(message.axes), list(message.buttons)
        jump, step = self._button(self.rules.jump), self._button(self.rules.step)
        if jump and not self._pressed[0]:
            self._leave(scene)
            goal = self._goal(scene, self.rules.longest_jump)
            self._queue.append(Jump(id=self._next_id(scene), goal=goal, height=self.rules.jump_high))
        elif step and not self._pressed[1]:
            goal = self._goal(scene, self.rules.longest_step)
            if goal is not None:
                self._leave(scene)
                self._queue.append(Step(id=self._next_id(scene), goal=goal))
        self._pressed = (jump, step)

    def lose(self, device: str, scene: Scene) -> None:
        """The gamepad is gone: sticks and buttons at rest."""
        if device == self.device:
            self.device, self._axes, self._buttons, self._pressed = "", [], [], (False, False)
            self._leave(scene)

    def update(self, scene: Scene) -> Meaning:
        """Commands for where the sticks are now."""
        rules = self.rules
        dt = 0.0 if self._time is None else min(max(scene.now - self._time, 0.0), 0.1)
        self._time = scene.now
        self._track.append((scene.now, *self._figure(scene)))
        while self._track[0][0] < scene.now - rules.notice and len(self._track) > 2:
            self._track.popleft()
        change = dt / rules.duck_time
        self._duck = min(self._duck + change, 1.0) if self._button(rules.duck) else max(self._duck - 2.0 * change, 0.0)
        right, up = stick(self._axes, rules.walk, rules.dead)
        tilt = hypot(right, up)
        if tilt > 0.0 and not any(self._pressed):
            self._walk(self._ground(right, up, scene), tilt, scene)
        else:
            self._leave(scene)
        commands, self._queue = self._queue, []
        if self._way is None:
            posture = self._posture(scene)
            if posture is not None:
                commands.append(posture)
        return Meaning(commands=commands)

    def save(self) -> dict[str, Any]:
        """The counter of commands."""
        return {"count": self.count}

    def restore(self, state: dict[str, Any], scene: Scene) -> None:
        """Take up after a crash; the next sample says where the sticks are."""
        self.count = int(state.get("count", 0))

    # Inside

    def _button(self, number: int) -> bool:
        return number < len(self._buttons) and self._buttons[number]

    def _ground(self, right: float, up: float, scene: Scene) -> Point:
        a, b = heading_axes(scene.camera)
        return a[0] * right + b[0] * up, a[1] * right + b[1] * up

    def _goal(self, scene: Scene, longest: float) -> tuple[float, float, float] | None:
        right, up = stick(self._axes, self.rules.body, self.rules.dead)
        if right == up == 0.0:
            return None
        dx, dz = self._ground(right, up, scene)
        x, z = self._figure(scene)
        return x + longest * dx, 0.0, z + longest * dz

    def _walk(self, way: Point, tilt: float, scene: Scene) -> None:
        """Lay the path out anew from just before the figure, bending toward the stick's direction."""
        rules = self.rules
        speed = rules.slowest + (rules.fastest - rules.slowest) * tilt * tilt
        wanted = atan2(way[0], way[1])
        if self._way is None:
            x, z = self._figure(scene)
            self._way = Way(self._next_id(scene), [(x, z, 0.0)])
        laid = self._way
        self._locate(laid, scene)
        keep = [one for one in laid.points if one[2] <= laid.place + rules.lead * speed] or laid.points[:1]
        heading = wanted
        if len(keep) > 1:
            heading = atan2(keep[-1][0] - keep[-2][0], keep[-1][1] - keep[-2][1])
        x, z, arc = keep[-1]
        for _ in range(max(4, round((rules.ahead * speed + 0.3) / rules.spacing))):
            off = (wanted - heading + pi) % (2.0 * pi) - pi
            most = rules.turning * rules.spacing / speed
            heading += min(max(off, -most), most)
            x, z, arc = x + rules.spacing * sin(heading), z + rules.spacing * cos(heading), arc + rules.spacing
            keep.append((x, z, arc))
        laid.points = [one for one in keep if one[2] >= laid.place - 1.0]
        self._queue.append(self._locomotion(laid, speed, scene, complete=False))

    def _leave(self, scene: Scene) -> None:
        """The stick is let go: the path ends where the figure can stop."""
        laid, self._way = self._way, None
        if laid is None:
            return
        self._said = None
        self._locate(laid, scene)
        speed = max(self._speed(), self.rules.slowest)
        end = laid.place + self.rules.coast(speed)
        laid.points = [one for one in laid.points if one[2] <= end] or laid.points[:1]
        self._queue.append(self._locomotion(laid, speed, scene, complete=True))

    def _locomotion(self, laid: Way, speed: float, scene: Scene, *, complete: bool) -> Locomotion:
        points = laid.points
        (x0, z0, _), (x1, z1, _) = points[max(len(points) - 2, 0)], points[-1]
        tilt, bend, duck = self._wanted(scene, atan2(x1 - x0, z1 - z0) if len(points) > 1 else self._yaw(scene))
        path = [PathPoint(x=x, z=z, speed=speed, tilt=tilt, bend=bend, duck=duck) for x, z, _ in points]
        return Locomotion(id=laid.id, path=path, start=points[0][2], complete=complete)

    def _locate(self, laid: Way, scene: Scene) -> None:
        x, z = self._figure(scene)
        near = [one for one in laid.points if laid.place - 0.1 <= one[2] <= laid.place + 1.0]
        if near:
            laid.place = max(laid.place, min(near, key=lambda one: hypot(one[0] - x, one[1] - z))[2])

    def _wanted(self, scene: Scene, heading: float) -> tuple[float, float, float]:
        right, up = stick(self._axes, self.rules.body, self.rules.dead)
        if any(self._pressed):
            right = up = 0.0
        x, z = self._ground(right, up, scene)
        tilt, bend = in_heading((x * self.rules.lean, z * self.rules.lean), heading)
        return tilt, bend, self._duck

    def _posture(self, scene: Scene) -> Stand | None:
        now = self._wanted(scene, self._yaw(scene))
        said = self._said
        if said is None:
            if max(abs(now[0]), abs(now[1]), now[2]) < 0.01:
                return None
            self._stand_id = self._next_id(scene)
        elif all(abs(a - b) < 0.01 for a, b in zip(now, said, strict=True)):
            return None
        self._said = now
        return Stand(id=self._stand_id, tilt=now[0], bend=now[1], duck=now[2])

    def _speed(self) -> float:
        """m/s of the figure over the ground."""
        if len(self._track) < 2:
            return 0.0
        (t0, x0, z0), (t1, x1, z1) = self._track[0], self._track[-1]
        return hypot(x1 - x0, z1 - z0) / max(t1 - t0, 1e-3)

    def _figure(self, scene: Scene) -> Point:
        hips = scene.positions[scene.joint("hips")]
        return float(hips[0]), float(hips[2])

    def _yaw(self, scene: Scene) -> float:
        x, y, z, w = (float(v) for v in scene.turns[scene.joint("hips")])
        return atan2(2.0 * (x * z + w * y), 1.0 - 2.0 * (x * x + y * y))

    def _next_id(self, scene: Scene) -> int:
        self.count = max(self.count + 1, int(scene.now * 1e3))
        return self.count
