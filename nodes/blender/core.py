"""What the blender does with commands: in their order, each once, begun when the running cycle has ended."""

from collections.abc import Callable
from dataclasses import dataclass
from math import atan2, cos, hypot, pi, sin
from typing import Any, TypeGuard

import msgspec
import numpy as np
from numpy.typing import NDArray

from bunraku.figure.skeleton import Skeleton
from bunraku.motion.constraint import Ground, Path, path_of, wrapped
from bunraku.motion.footlock import LOCKED
from bunraku.motion.motionset import MotionSet
from bunraku.motion.player import Pace, Player, Transition
from bunraku.msgs import (
    Command,
    CommandBase,
    Jump,
    Locomotion,
    Overlay,
    Primitive,
    Stand,
    Step,
    Turn,
    WalkGesture,
)
from bunraku.nodes.blender.relief import relief

Array = NDArray[np.float64]

REMEMBERED = 48
"""Ids of finished commands that are kept, so that hearing one again does nothing."""
MOST_WAITING = 16
"""Commands that may wait; of more the oldest is dropped."""
NEAR = 0.03
"""m: a goal that the figure has reached."""
FACED = 0.03
"""rad: a heading that it has."""
ASIDE = 0.87
"""rad: a standing figure turns toward a path that begins farther off its heading than this."""
JOIN = 0.6
"""m: a new path that begins within this of the old one's end is walked after it, else instead of it."""
DRIVEN = -1
"""Instead of a command's id: the figure is driven."""
PRINTS = 10
"""Footprints drawn."""
PATH_COLOR = (0.95, 0.65, 0.10, 0.9)
LEFT_COLOR = (0.11, 0.54, 0.58, 0.55)
RIGHT_COLOR = (0.90, 0.42, 0.30, 0.55)

_ARM = ("Shoulder", "UpperArm", "LowerArm", "Hand")
_LEG = ("UpperLeg", "LowerLeg", "Foot", "Toes")
_BACK = ("spine", "chest", "upperChest")
_PARTS: dict[str, tuple[str, ...]] = {
    "left_arm": tuple("left" + part for part in _ARM),
    "right_arm": tuple("right" + part for part in _ARM),
    "left_leg": tuple("left" + part for part in _LEG),
    "right_leg": tuple("right" + part for part in _LEG),
    "trunk": _BACK,
    "head": ("neck", "head"),
}
_PARTS["lower"] = ("hips", *_PARTS["left_leg"], *_PARTS["right_leg"])
_PARTS["upper"] = (*_PARTS["left_arm"], *_PARTS["right_arm"], *_BACK, *_PARTS["head"])
_WALKS = {"whole", "lower", "left_leg", "right_leg"}
"""A command that takes the figure somewhere moves at least one of these."""


def joints_of(skeleton: Skeleton, body: list[str]) -> list[int] | None:
    """The joints that a command's ``body`` names; None for all."""
    if "whole" in body:
        return None
    return [skeleton.roles[role] for part in body for role in _PARTS[part] if role in skeleton.roles]


@dataclass
class _Walk:
    """The path under way, as the commands say it."""

    id: int
    gait: str
    end: float  # m, arc length
    heading: float | None


class BlenderCore:
    """One figure, its commands and its player."""

    def __init__(
        self, motion_set: MotionSet, *, pace: Pace, transition: Transition = "inertialise", lock: bool = True,
        ground: Callable[[float, float], float] | None = None, say: Callable[[str], None] = lambda text: None,
    ) -> None:  # fmt: skip
        self.player = Player(motion_set, ground=ground, pace=pace, transition=transition, lock=lock)
        self.skeleton = motion_set.skeleton
        self.say = say
        self.waiting: list[Command] = []
        self.done: list[int] = []
        self.current: int | None = None
        self.walk: _Walk | None = None
        self.prints: list[tuple[int, list[float]]] = []
        self._modes = (0, 0)
        self._reach = self.player.reach

    def reset(self, x: float, z: float, heading: float) -> None:
        """Stand upright at a place, with nothing to do."""
        self.player.reset(x, z, heading)
        self.waiting.clear()
        self.done.clear()
        self.prints.clear()
        self.current, self.walk = None, None

    def drive(self, speed: float, turn: float, tilt: float, bend: float, duck: float) -> None:
        """Go by speed (m/s) and turn rate (rad/s) instead of by commands, or stand in a posture; to be repeated.

        While it drives, commands wait; a speed and turn of 0 give way to them.
        """
        player = self.player
        if speed < 0.05:
            if self.walk is not None and self.walk.id == DRIVEN and not player.ending:
                player.stop()
            elif player.free and (tilt or bend or duck):
                player.stand(tilt, bend, duck)
            return
        if not (self.walk is None and player.free) and not (self.walk is not None and self.walk.id == DRIVEN):
            return
        here, s = player.place, player.s if self.walk is not None else 0.0
        # The arc goes back a little too, so that its tangent is smooth where the figure is.
        way = np.arange(-20, round((2.0 + 0.7 * speed * speed) / 0.04)) * 0.04
        bend_of_path = turn / max(speed, 0.3)
        if abs(bend_of_path) < 1e-6:
            left, ahead = np.zeros_like(way), way
        else:
            left = (1.0 - np.cos(bend_of_path * way)) / bend_of_path
            ahead = np.sin(bend_of_path * way) / bend_of_path
        c, sine = cos(here.heading), sin(here.heading)
        points = np.stack([here.x + left * c + ahead * sine, here.z - left * sine + ahead * c], -1)
        s += float(way[0])
        count = len(points)
        path = path_of(points, s, np.full(count, speed), np.tile([tilt, bend, duck], (count, 1)), here.heading)
        self.walk = _Walk(DRIVEN, "", path.end, None)
        player.follow(path, complete=False)

    # Hearing

    def hear(self, command: Command) -> None:
        """Take a command: a growing path at once, all else in its turn."""
        body = [str(part) for part in command.body]
        if not isinstance(command, Locomotion | WalkGesture | Stand | Step | Jump | Turn):
            return  # hand poses and actions are for others
        if not isinstance(command, Stand) and not _WALKS.intersection(body):
            self.say(f"{type(command).__name__.lower()} {command.id} moves no leg (body {', '.join(body)}): ignored")
            return
        if isinstance(command, Stand):
            self._stand(command)
        elif _walks(command):
            self._walk(command)
        elif command.id in self.done or command.id == self.current:
            return
        else:
            self._wait(command)
        self._begin()

    def _wait(self, command: Command) -> None:
        """Put a command into the queue, in the place of one with the same id."""
        for k, one in enumerate(self.waiting):
            if one.id == command.id and type(one) is type(command):
                self.waiting[k] = command
                return
        if len(self.waiting) >= MOST_WAITING:
            dropped = self.waiting.pop(0)
            self.say(f"{MOST_WAITING} commands wait already: {type(dropped).__name__.lower()} {dropped.id} is dropped")
        self.waiting.append(command)
        if self.walk is not None and not self.player.ending:
            self.player.ending = True  # what comes next ends the stroke

    def _stand(self, command: Stand) -> None:
        if self.walk is not None and not self.player.ending:
            self.player.stop()
        self.player.stand(command.tilt, command.bend, command.duck)
        if command.heading is not None:
            self._wait(Turn(id=command.id, heading=command.heading, body=command.body))
            return
        self.waiting = [one for one in self.waiting if not (isinstance(one, Turn) and one.id == command.id)]

    def _walk(self, command: Locomotion | WalkGesture) -> None:
        gait = command.gait if isinstance(command, WalkGesture) else ""
        path = self._path(command)
        if path is None:
            return
        if command.id in self.done and path.end <= self._finished_end(command) + 0.05:
            return
        walk = self.walk
        if walk is not None and walk.id == command.id:
            self._follow(command, path, gait)
        elif walk is not None and self._joins(path):
            self.player.ending = True
            self._wait(command)
        elif walk is not None and not self.waiting:
            self._finish(walk.id)  # a stroke somewhere else takes over at once
            self.walk = None
            self._follow(command, path, gait)
        else:
            self._wait(command)

    def _finished_end(self, command: Locomotion | WalkGesture) -> float:
        """A finished path is walked again only where it has grown beyond the figure's place."""
        path = self._path(command)
        assert path is not None
        return path.nearest(self.player.place.x, self.player.place.z)

    def _joins(self, path: Path) -> bool:
        old = self.player.path
        if old is None:
            return False
        x, z, _ = old.at(old.end)
        return hypot(float(path.places[0, 0]) - x, float(path.places[0, 1]) - z) <= JOIN

    def _path(self, command: Locomotion | WalkGesture) -> Path | None:
        here = self.player.place
        if isinstance(command, WalkGesture):
            if not command.path:
                return None
            return path_of([[x, z] for x, z in command.path], heading=here.heading)
        if not command.path:
            return None
        points = command.path
        return path_of(
            [[p.x, p.z] for p in points],
            command.start,
            [float("nan") if p.speed is None else p.speed for p in points],
            [[p.tilt, p.bend, p.duck] for p in points],
            here.heading,
        )

    def _follow(self, command: Locomotion | WalkGesture, path: Path, gait: str) -> None:
        """Go along a path, after a turn toward it where a standing figure looks elsewhere."""
        player = self.player
        last = path.end - path.nearest(player.place.x, player.place.z) if self.walk is None else 1.0
        if self.walk is None and last < NEAR and self._away(path) < 0.25:
            if command.complete:
                self._finish(command.id)
            return
        if self.walk is None and player.free:
            aside = self._aside(path)
            if abs(aside) > ASIDE and "turn_left" in player.voices and "turn_right" in player.voices:
                self.waiting.insert(0, command)
                self._turn(player.place.heading + aside)
                return
        heading = command.heading if isinstance(command, Locomotion) else None
        self.walk = _Walk(command.id, gait, path.end, heading)
        self.current = command.id
        player.engage(joints_of(self.skeleton, [str(part) for part in command.body]))
        player.follow(path, gait=gait, complete=command.complete or bool(self.waiting))

    def _away(self, path: Path) -> float:
        here = self.player.place
        return float(np.hypot(path.places[:, 0] - here.x, path.places[:, 1] - here.z).min())

    # Doing

    def update(self, dt: float) -> None:
        """Go on by ``dt`` s."""
        self.player.update(dt)
        self._note_prints()
        if self.player.free:
            self._ended()
            self._begin()
        elif self.player.over and self._walk_next():
            self._begin()

    def _walk_next(self) -> bool:
        """Whether a walk waits that need not wait for a step's or turn's last calm, because it leads on ahead."""
        if self.walk is not None or not self.waiting or not _walks(self.waiting[0]):
            return False
        path = self._path(self.waiting[0])
        return path is not None and abs(self._aside(path)) <= ASIDE

    def _aside(self, path: Path) -> float:
        """How far (rad, to the left) a path begins off the figure's heading."""
        here = self.player.place
        _, _, toward = path.at(path.nearest(here.x, here.z) + 0.10)
        return wrapped(toward - here.heading)

    def _ended(self) -> None:
        walk = self.walk
        if walk is not None:
            if self.player.path is not None and not self.player.ending:
                return  # waits for its path to grow
            self.player.path = None
            self.walk, self.current = None, None
            if walk.id != DRIVEN:
                self._finish(walk.id)
            if walk.heading is not None and abs(wrapped(walk.heading - self.player.place.heading)) > FACED:
                self.waiting.insert(0, Turn(id=walk.id, heading=walk.heading))
        self.player.engage(None)

    def _finish(self, id: int) -> None:
        if id in self.done:
            self.done.remove(id)
        self.done.append(id)
        del self.done[:-REMEMBERED]

    def _begin(self) -> None:
        """Begin the next command when nothing runs; commands that are fulfilled already are passed over."""
        for _ in range(2 * MOST_WAITING):
            ready = self.player.free or (self.player.over and self._walk_next())
            if not ready or self.walk is not None or not self.waiting:
                return
            command = self.waiting.pop(0)
            self.current = None
            if _walks(command):
                path = self._path(command)
                if path is not None:
                    self._follow(command, path, command.gait if isinstance(command, WalkGesture) else "")
            elif self._move(command):
                self.waiting.insert(0, command)  # one more is needed when this one is over
            else:
                self._finish(command.id)

    def _move(self, command: CommandBase) -> bool:
        """Begin one move toward what a command asks for; False where that is the last one, or none is needed."""
        self.player.engage(joints_of(self.skeleton, [str(part) for part in command.body]))
        self.current = command.id
        if isinstance(command, Turn):
            return self._turn(command.heading)
        if isinstance(command, Step):
            if command.heading is not None and self._step_left(command) < NEAR:
                return self._turn(command.heading)
            return self._step(command) or command.heading is not None
        if isinstance(command, Jump):
            self._jump(command)
        elif isinstance(command, WalkGesture):
            self._gesture_jump(command)
        return False

    def _turn(self, heading: float) -> bool:
        """Turn toward a heading; True where more than one turn is needed."""
        here = self.player.place
        angle = wrapped(heading - here.heading)
        name = "turn_left" if angle > 0 else "turn_right"
        if abs(angle) < FACED or name not in self.player.voices:
            return False
        most = max(abs(v) for v in self._reach[name])
        # Large turns are made in equal parts.
        parts = max(1, int(np.ceil((abs(angle) - 0.02) / (1.08 * most))))
        part = angle / parts
        self.player.move(name, [part], Ground(here.x, here.z, here.heading + part))
        return parts > 1

    def _step_left(self, command: Step) -> float:
        here = self.player.place
        return hypot(command.goal[0] - here.x, command.goal[2] - here.z)

    def _step(self, command: Step) -> bool:
        """Step toward a goal; True where more than one step is needed."""
        here = self.player.place
        left, ahead = here.seen(command.goal[0], command.goal[2])
        distance, angle = hypot(left, ahead), atan2(left, ahead)
        if distance < NEAR:
            return False
        # Straight ahead or back the foot goes first that went second before.
        side = "left" if (left > 0.12 * distance or (abs(left) <= 0.12 * distance and len(self.done) % 2)) else "right"
        name = f"step_{side}"
        if name not in self.player.voices:
            self.say(f"the motion set has no module {name}: step {command.id} is not made")
            return False
        most = self._farthest(name, angle)
        parts = max(1, int(np.ceil((distance - 0.02) / most)))
        part = distance / parts
        end = here.after(part * sin(angle), part * cos(angle), 0.0)
        self.player.move(name, [angle, part], end)
        return parts > 1

    def _farthest(self, name: str, angle: float) -> float:
        """The longest way that a module covers in a direction, m."""
        weights = self.player.voices[name].weights
        low, high = 0.0, 1.2 * self._reach[name][1]
        if weights.within([angle, high]):
            return high
        for _ in range(12):
            middle = 0.5 * (low + high)
            if weights.within([angle, middle]):
                low = middle
            else:
                high = middle
        return max(low, 0.15)

    def _jump(self, command: Jump) -> None:
        player, here = self.player, self.player.place
        heading = here.heading if command.heading is None else command.heading
        if command.goal is None or hypot(command.goal[0] - here.x, command.goal[2] - here.z) < NEAR:
            self._jump_up(0.35 * player.scale if command.height is None else command.height, heading)
            return
        left, ahead = here.seen(command.goal[0], command.goal[2])
        distance, angle = hypot(left, ahead), atan2(left, ahead)
        quarter = ("jump_forward", "jump_left", "jump_back", "jump_right")[round(angle / (0.5 * pi)) % 4]
        if quarter not in player.voices:
            quarter = "jump_forward" if "jump_forward" in player.voices else ""
        if not quarter:
            self.say(f"the motion set has no directional jump: jump {command.id} is not made")
            return
        far = self._farthest(quarter, angle)
        if distance > 1.5 * far:
            self.say(f"jump {command.id} asks for {distance:.2f} m, {1.5 * far:.2f} m is the most: it falls short")
            distance = 1.5 * far
        end = here.after(distance * sin(angle), distance * cos(angle), wrapped(heading - here.heading))
        player.move(quarter, [angle, min(distance, far)], end)

    def _jump_up(self, height: float, heading: float) -> None:
        player, here = self.player, self.player.place
        if "jump_up" in player.voices:
            player.move("jump_up", [height], Ground(here.x, here.z, heading))

    def _gesture_jump(self, command: WalkGesture) -> None:
        name = f"canonical/{command.gait}"
        here = self.player.place
        voice = self.player.voices.get(name)
        if voice is None:
            self.say(f"the motion set has no canonical clip {command.gait!r}: gesture {command.id} is not made")
            return
        end = here
        if command.gait != "jump_up" and len(command.path) > 1:
            x, z = command.path[-1]
            end = Ground(x, z, atan2(x - here.x, z - here.z) if hypot(x - here.x, z - here.z) > 0.1 else here.heading)
            if abs(wrapped(end.heading - here.heading)) > 0.6:
                end = Ground(x, z, here.heading)
        elif command.gait != "jump_up":
            end = here.after(0.0, float(voice.weights.table.center[0]), 0.0)
        self.player.move(name, voice.weights.table.center, end)

    # Showing

    def _note_prints(self) -> None:
        state = self.player.state
        for side in range(2):
            if int(state.mode[side]) == LOCKED and self._modes[side] != LOCKED:
                self.prints.append((side, [float(v) for v in state.prints[side]]))
        del self.prints[:-PRINTS]
        self._modes = (int(state.mode[0]), int(state.mode[1]))

    def overlay(self) -> Overlay:
        """The rest of the path, the last footprints, and what uneven ground is like."""
        here, ground = self.player.place, self.player.ground
        drawn = [] if ground is None else relief(ground, here.x, here.z)
        for side, (x, y, z, yaw, _slope) in self.prints:
            _, heel, ball = (float(v) for v in self.player.feet.soles[side])
            tip = ball + 0.55 * (ball - heel)
            wide = 0.21 * (ball - heel)
            corners = (
                (-0.7 * wide, heel),
                (0.7 * wide, heel),
                (wide, ball),
                (0.6 * wide, tip),
                (-0.6 * wide, tip),
                (-wide, ball),
            )
            c, s = cos(yaw), sin(yaw)
            points: list[tuple[float, ...]] = [(x + a * c + b * s, y + 0.004, z - a * s + b * c) for a, b in corners]
            drawn.append(Primitive(kind="polygon", points=points, color=LEFT_COLOR if side == 0 else RIGHT_COLOR))
        path = self.player.path
        if path is not None:
            at = np.linspace(self.player.s, path.end, min(max(2, int((path.end - self.player.s) / 0.08)), 240))
            line: list[tuple[float, ...]] = []
            for one in at:
                px, pz, _ = path.at(float(one))
                height = 0.0 if self.player.ground is None else self.player.ground(px, pz)
                line.append((px, height + 0.006, pz))
            drawn.append(Primitive(kind="line", points=line, color=PATH_COLOR, size=0.02))
        return Overlay(primitives=drawn)

    # Save and restore

    def save(self) -> bytes:
        """All of it, small."""
        walk = self.walk
        return msgspec.msgpack.encode(
            {
                "player": self.player.snapshot(),
                "waiting": [one.encode() for one in self.waiting],
                "done": self.done,
                "current": self.current,
                "walk": None if walk is None else [walk.id, walk.gait, walk.end, walk.heading],
                "prints": self.prints,
            }
        )

    def restore(self, state: bytes) -> None:
        """Take up from `save`; raises ValueError for what is not of this motion set."""
        from bunraku.msgs.base import decode

        try:
            saved: dict[str, Any] = msgspec.msgpack.decode(state)
            self.player.restore(saved["player"])
            self.waiting = [decode(Command, body) for body in saved["waiting"]]
            self.done = [int(one) for one in saved["done"]]
            self.current = saved["current"]
            self.walk = None if saved["walk"] is None else _Walk(*saved["walk"])
            self.prints = [(int(side), [float(v) for v in row]) for side, row in saved["prints"]]
            self._modes = (int(self.player.state.mode[0]), int(self.player.state.mode[1]))
        except (msgspec.MsgspecError, KeyError, TypeError, IndexError) as error:
            raise ValueError(f"not a saved blender: {error}") from None


def _walks(command: Command) -> TypeGuard[Locomotion | WalkGesture]:
    """Whether a command leads along a path, cycle by cycle."""
    if isinstance(command, WalkGesture):
        return command.gait in ("walk", "jog", "run", "sneak", "march")
    return isinstance(command, Locomotion)


__all__ = ["BlenderCore", "joints_of"]
