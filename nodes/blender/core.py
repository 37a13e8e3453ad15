"""What the blender does with commands: in their order, each once, begun when the running cycle has ended."""

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, hypot, sin
from typing import Any, TypeGuard

import msgspec
import numpy as np
from numpy.typing import NDArray

from bunraku.motion.constraint import Path, path_of, wrapped
from bunraku.motion.footlock import LOCKED
from bunraku.motion.motionset import MotionSet
from bunraku.motion.player import Pace, Player, Transition
from bunraku.msgs import (
    Command,
    CommandBase,
    Jump,
    Locomotion,
    Overlay,
    Stand,
    Step,
    Turn,
    WalkGesture,
)
from bunraku.nodes.blender.moves import FACED, NEAR, Moves
from bunraku.nodes.blender.parts import WALKS, joints_of
from bunraku.nodes.blender.showing import PRINTS, Print, overlay

Array = NDArray[np.float64]

REMEMBERED = 48
"""Ids of finished commands that are kept, so that hearing one again does nothing."""
MOST_WAITING = 16
"""Commands that may wait; of more the oldest is dropped."""
ASIDE = 0.87
"""rad: a standing figure turns toward a path that begins farther off its heading than this."""
JOIN = 0.6
"""m: a new path that begins within this of the old one's end is walked after it, else instead of it."""
GROWN = 0.05
"""m by which a path that is done with must have grown to be walked on."""
DRIVEN = -1
"""Instead of a command's id: the figure is driven."""


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
        self.ends: dict[int, float] = {}  # m, arc length: how far each path was ever said to go
        self.complete: int | None = None  # the path whose end was said last
        self.posed: Stand | None = None  # the posture that holds: no other and no walk began since
        self.current: int | None = None
        self.walk: _Walk | None = None
        self.prints: list[Print] = []
        self._modes = (0, 0)
        self.moves = Moves(self.player, self.say)

    def reset(self, x: float, z: float, heading: float) -> None:
        """Stand upright at a place, with nothing to do."""
        self.player.reset(x, z, heading)
        self.waiting.clear()
        self.done.clear()
        self.prints.clear()
        self.ends.clear()
        self.current, self.walk, self.posed, self.complete = None, None, None, None

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
        if not isinstance(command, Stand) and not WALKS.intersection(body):
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
            self._finish(dropped.id)
            self.say(f"{MOST_WAITING} commands wait already: {type(dropped).__name__.lower()} {dropped.id} is dropped")
        self.waiting.append(command)
        if self.walk is not None and not self.player.ending:
            self.player.ending = True  # what comes next ends the stroke

    def _stand(self, command: Stand) -> None:
        """Take a posture; an old one, or the same once more, is not taken again."""
        before = self.posed
        if command.id in self.done:
            return
        if before is not None and before.id != command.id:
            self._finish(before.id)
            before = None
        if before is not None and _posture(before) == _posture(command):
            return
        self.posed = command
        if self.walk is not None and not self.player.ending:
            self.player.stop()
            self.player.ending = True
            if self.walk.id != DRIVEN:
                self._finish(self.walk.id)
        self.player.stand(command.tilt, command.bend, command.duck)
        if before is not None and before.heading == command.heading:
            return
        if command.heading is not None:
            self._wait(Turn(id=command.id, heading=command.heading, body=command.body))
            return
        self.waiting = [one for one in self.waiting if not (isinstance(one, Turn) and one.id == command.id)]

    def _walk(self, command: Locomotion | WalkGesture) -> None:
        gait = command.gait if isinstance(command, WalkGesture) else ""
        path = self._path(command)
        if path is None or self._old(command, path):
            return
        walk = self.walk
        if walk is not None and walk.id == command.id:
            if command.complete or not (self.player.waiting and path.end - self.player.s <= self.player.resumes):
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

    def _old(self, command: Locomotion | WalkGesture, path: Path) -> bool:
        """Whether a path was walked, stopped or taken over, or its end was said; unless it has grown."""
        id, known = command.id, self.ends.get(command.id)
        if id in self.done:
            if known is None or path.end <= known + GROWN:
                return True
            self.done.remove(id)
        elif id == self.complete and not command.complete and known is not None and path.end <= known:
            return True
        self.ends[id] = max(path.end, self.ends.pop(id, path.end))
        for one in list(self.ends)[: -REMEMBERED - MOST_WAITING]:
            del self.ends[one]
        if command.complete:
            self.complete = id
        elif id == self.complete:
            self.complete = None
        return False

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
            self._finish(command.id)
            return
        if self.walk is None and player.free:
            aside = self._aside(path)
            if abs(aside) > ASIDE and "turn_left" in player.voices and "turn_right" in player.voices:
                self.waiting.insert(0, command)
                self.moves.turn(player.place.heading + aside)
                return
        if self.posed is not None:
            self._finish(self.posed.id)
            self.posed = None
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
            elif self.posed is None or command.id != self.posed.id:
                self._finish(command.id)

    def _move(self, command: CommandBase) -> bool:
        """Begin one move toward what a command asks for; False where that is the last one, or none is needed."""
        self.player.engage(joints_of(self.skeleton, [str(part) for part in command.body]))
        self.current = command.id
        if isinstance(command, Turn):
            return self.moves.turn(command.heading)
        if isinstance(command, Step):
            if command.heading is not None and self.moves.left_of(command) < NEAR:
                return self.moves.turn(command.heading)
            return self.moves.step(command) or command.heading is not None
        if isinstance(command, Jump):
            self.moves.jump(command)
        elif isinstance(command, WalkGesture):
            self.moves.gesture(command)
        return False

    def _note_prints(self) -> None:
        state = self.player.state
        for side in range(2):
            if int(state.mode[side]) == LOCKED and self._modes[side] != LOCKED:
                self.prints.append((side, [float(v) for v in state.prints[side]]))
        del self.prints[:-PRINTS]
        self._modes = (int(state.mode[0]), int(state.mode[1]))

    def overlay(self) -> Overlay:
        """What is drawn of all this."""
        return overlay(self.player, self.prints)

    # Save and restore

    def save(self) -> bytes:
        """All of it, small."""
        walk = self.walk
        return msgspec.msgpack.encode(
            {
                "player": self.player.snapshot(),
                "waiting": [one.encode() for one in self.waiting],
                "done": self.done,
                "ends": list(self.ends.items()),
                "complete": self.complete,
                "posed": None if self.posed is None else self.posed.encode(),
                "current": self.current,
                "walk": None if walk is None else [walk.id, walk.gait, walk.end, walk.heading],
                "prints": self.prints,
                "odd": self.moves.odd,
            },
            enc_hook=float,  # numpy's floats, which uncompiled kernels leave
        )

    def restore(self, state: bytes) -> None:
        """Take up from `save`; raises ValueError for what is not of this motion set."""
        from bunraku.msgs.base import decode

        try:
            saved: dict[str, Any] = msgspec.msgpack.decode(state)
            self.player.restore(saved["player"])
            self.waiting = [decode(Command, body) for body in saved["waiting"]]
            self.done = [int(one) for one in saved["done"]]
            self.ends = {int(id): float(end) for id, end in saved["ends"]}
            self.complete = saved["complete"]
            self.posed = None if saved["posed"] is None else decode(Stand, saved["posed"])
            self.current = saved["current"]
            self.walk = None if saved["walk"] is None else _Walk(*saved["walk"])
            self.prints = [(int(side), [float(v) for v in row]) for side, row in saved["prints"]]
            self.moves.odd = bool(saved["odd"])
            self._modes = (int(self.player.state.mode[0]), int(self.player.state.mode[1]))
        except (msgspec.MsgspecError, KeyError, TypeError, IndexError) as error:
            raise ValueError(f"not a saved blender: {error}") from None


def _walks(command: Command) -> TypeGuard[Locomotion | WalkGesture]:
    """Whether a command leads along a path, cycle by cycle."""
    if isinstance(command, WalkGesture):
        return command.gait in ("walk", "jog", "run", "sneak", "march")
    return isinstance(command, Locomotion)


def _posture(command: Stand) -> tuple[float, float, float, float | None]:
    return command.tilt, command.bend, command.duck, command.heading


__all__ = ["BlenderCore", "joints_of"]
