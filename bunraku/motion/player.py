"""Plays the modules of a motion set: what a figure does, pose by pose, led over the ground.

The player *stands*, *goes* along a path, or makes one *move* (a step, a turn, a jump). It blends the module's
examples for the parameters of the moment, carries the path frame along under the root constraints, passes
from motion to motion without a step, and holds the feet. It knows nothing of messages.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, isnan, sqrt
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bunraku.figure.spring import LN2
from bunraku.motion.blend import speeds_into, way_into
from bunraku.motion.constraint import AHEAD, Ground, Path, path_of, smoothstep, wrapped
from bunraku.motion.ending import (
    COUNTED,
    HELD,
    HURRY,
    RATES,
    Cadence,
    braked,
    cadence_of,
    last_steps,
    room_of,
)
from bunraku.motion.footlock import GOES, STANDS, STILL, FeetState
from bunraku.motion.footprint import Feet
from bunraku.motion.ground import GroundHeight
from bunraku.motion.motionset import MotionSet
from bunraku.motion.pace import PACE, Pace
from bunraku.motion.playing import Playing, Transition
from bunraku.motion.stance import Stance
from bunraku.motion.voice import Voice, posed, reach_of, voices

Array = NDArray[np.float64]

LAST = 0.5
"""m before a path's end where the last steps begin."""


@dataclass
class _Move:
    """One step, turn or jump under way."""

    begin: Ground
    pull: tuple[float, float, float]  # left m, ahead m, turn rad: what the blended way lacks at the end
    window: tuple[float, float]  # generic times between which it is made up for


class Player:
    """The state of one figure in motion; `update` makes the next pose.

    Args:
        motion_set: must have the modules ``stand`` and ``locomotion``.
        ground: height (m) of the ground at (x, z); None for level ground at 0.
        transition: see `bunraku.motion.transition`.
        lock: hold planted feet (else the pose is as blended).
    """

    def __init__(
        self, motion_set: MotionSet, *, ground: GroundHeight | None = None, pace: Pace = PACE,
        transition: Transition = "inertialise", lock: bool = True,
    ) -> None:  # fmt: skip
        self.skeleton = motion_set.skeleton
        self.voices = voices(motion_set)
        for needed in ("stand", "locomotion"):
            motion_set.module(needed)
        self.pace = pace
        self.stance = Stance(self.skeleton, ground, lock)
        self.scale = float(self.stance.feet.lengths.sum(axis=1).mean()) / 0.83
        self._rate, self._way = np.zeros(2), np.zeros(3)
        self._cadence: Cadence | None = None
        stand = self.voices["stand"]
        self.playing = Playing(stand, stand.weights.neutral(np.zeros(3)), len(self.skeleton), transition)
        self.reset()

    def reset(self, x: float = 0.0, z: float = 0.0, heading: float = 0.0) -> None:
        """Stand upright at a place on the ground (m) with a heading (rad)."""
        self.place = Ground(x, z, heading)
        self.posture = np.zeros(3)
        self.activity: Literal["stand", "go", "move"] = "stand"
        self.path: Path | None = None
        self._pack: tuple[Path, float, list[Any]] | None = None
        self._limits: tuple[Path, Array] | None = None
        self.s = 0.0
        self.speed = 0.0
        self.gait = ""
        self.ending = False
        self._hurry = 1.0  # times the cadence, in the last steps
        self._slip = np.zeros(3)  # m, m, rad: off the path, dying away
        self._slip_speed = np.zeros(3)
        self._move: _Move | None = None
        self.stance.reset(x, z)
        self.playing.start(self.voices["stand"], self._stand_goal())
        self._compose(0.0)

    # What it is like

    @property
    def root(self) -> Array:
        """(3) m, the root's place in the world."""
        return self.stance.root

    @property
    def rotations(self) -> Array:
        """(J, 4) local rotations; the root's in the world."""
        return self.stance.rotations

    @property
    def contacts(self) -> Array:
        """(2) 1 where the left and right foot is held, else 0."""
        return self.stance.contacts

    @property
    def feet(self) -> Feet:
        """Legs and soles."""
        return self.stance.feet

    @property
    def state(self) -> FeetState:
        """What the feet remember."""
        return self.stance.state

    @property
    def beyond(self) -> float:
        """How far a locked foot was beyond its leg's reach, m."""
        return self.stance.beyond

    @property
    def ground(self) -> GroundHeight | None:
        """Height (m) of the ground at (x, z); None for level ground at 0."""
        return self.stance.ground

    # What it is to do

    def stand(self, tilt: float = 0.0, bend: float = 0.0, duck: float = 0.0) -> None:
        """The posture to take wherever nothing else says one: tilt left and bend forward (rad), duck 0..1."""
        self.posture[:] = tilt, bend, duck

    def engage(self, joints: Sequence[int] | None = None) -> None:
        """Let motions move these joints only (all when None) and hips and legs; the others go on standing."""
        if joints is None:
            self.playing.mask_goal[:] = 1.0
            return
        self.playing.mask_goal[:] = 0.0
        self.playing.mask_goal[list(joints)] = 1.0
        self.playing.mask_goal[0] = 1.0
        for leg in self.feet.joints:
            self.playing.mask_goal[[int(j) for j in leg if j >= 0]] = 1.0

    def follow(self, path: Path, *, gait: str = "", complete: bool = True) -> None:
        """Go along a path from where the figure is nearest to it; a path under way may grow or change.

        ``gait`` names a canonical cycle; without it speed and posture follow the path. A path that is not
        ``complete`` makes the figure slow down, but not end, where it stops so far.
        """
        if gait and f"canonical/{gait}" not in self.voices:
            raise ValueError(f"the motion set has no canonical clip {gait!r}")
        going = self.activity == "go" and self.path is not None
        if going:
            x, z, heading = self.place.x, self.place.z, self.place.heading
            s = self.s if path.start <= self.s + 0.5 and self._near(path, self.s) else path.nearest(x, z)
        else:
            x, z, heading = self.place.x, self.place.z, self.place.heading
            s = path.nearest(x, z)
        if going and not self.gait and path.end - s < LAST * self.scale:
            gait = ""  # its last steps are under way, heard again or not
        self.path, self.s, self.gait, self.ending = path, s, gait, complete
        px, pz, ph = path.at(s)
        self._slip[:] = x - px, z - pz, wrapped(heading - ph)
        if not going:
            self._slip_speed[:] = 0.0
            self.speed, self._hurry = 0.0, 1.0
            self.activity, self._move = "go", None
            first = 0.5 if wrapped(ph - heading) > 0.0 else 0.0  # the inner foot goes first
            self.playing.switch(self._going(), self._asked_on_path(0.0), first)
        elif self.playing.voice is not self._going():
            self.playing.switch(self._going(), self._asked_on_path(self.speed), self.playing.u)

    def _near(self, path: Path, s: float) -> bool:
        x, z, _ = path.at(s)
        return abs(x - self.place.x) + abs(z - self.place.z) < 0.3 + float(np.abs(self._slip[:2]).sum())

    def stop(self) -> None:
        """Leave the path as soon as the figure can come to a stand."""
        if self.activity == "go" and self.path is not None:
            room = room_of(self.speed, self.pace.brake * self.scale)
            self.path, self.ending = self.path.trimmed(self.s + room), True

    def move(self, module: str, values: ArrayLike, end: Ground | None = None) -> None:
        """Begin a step, turn or jump for parameter values; its end is pulled to ``end`` where that is given."""
        voice = self.voices[module]
        begin = self.place
        weights = voice.weights(values)
        way_into(voice.table, weights, 1.0, self._way)
        pull = (0.0, 0.0, 0.0)
        if end is not None:
            left, ahead = begin.seen(end.x, end.z)
            dl, da, dt = (float(v) for v in self._way)
            pull = (left - dl, ahead - da, wrapped(end.heading - begin.heading - dt))
        keys = voice.table.generic
        window = (float(keys[1]), float(keys[-2]))
        if module.startswith("jump") or "jump" in module:
            window = (float(keys[2]), float(keys[4]))
        self._move = _Move(begin, pull, window)
        self.activity, self.path = "move", None
        self.playing.switch(voice, np.asarray(values, dtype=np.float64), 0.0, weights)

    @property
    def reach(self) -> dict[str, tuple[float, float]]:
        """Smallest and largest measured value of each module's distance or height, m."""
        return reach_of(self.voices)

    @property
    def free(self) -> bool:
        """Whether another activity may begin now: nothing runs but standing."""
        return self.activity == "stand"

    @property
    def transition(self) -> Transition:
        """How it passes from motion to motion."""
        return self.playing.transition

    @transition.setter
    def transition(self, kind: Transition) -> None:
        self.playing.transition = kind

    @property
    def u(self) -> float:
        """Generic time of the motion that is played."""
        return self.playing.u

    @property
    def weights(self) -> Array:
        """(n,) weights of the examples that are blended now."""
        return self.playing.weights

    @property
    def over(self) -> bool:
        """Whether a step or turn has both feet down again, so that walking may follow at once."""
        if self.activity != "move" or not self.playing.voice.name.startswith(("step_", "turn_")):
            return False
        return self.playing.u >= float(self.playing.voice.table.generic[-2])

    @property
    def waiting(self) -> bool:
        """Whether the figure has caught up with a path that is still growing."""
        return self.path is not None and not self.ending and self.activity == "stand"

    @property
    def resumes(self) -> float:
        """m that such a path must have grown before the figure goes on."""
        return 0.12 * self.scale

    # The next pose

    def update(self, dt: float) -> None:
        """Go on by ``dt`` seconds (0 < dt <= 0.1): sets `root`, `rotations` and `contacts`."""
        dt = min(max(dt, 1e-4), 0.1)
        self.playing.remember()
        if self.activity == "go":
            self._go(dt)
        elif self.activity == "move":
            self._make_move(dt)
        else:
            self._idle(dt)
        rest = (self.voices["stand"], self._stand_goal()) if self.playing.partial else None
        self.playing.pose(dt, self.pace.switch, rest, self.activity != "stand")
        self._compose(dt)

    def _idle(self, dt: float) -> None:
        playing = self.playing
        playing.ask(self._stand_goal(), self.pace.posture, dt)
        playing.u = playing.later(dt) % 1.0
        if self.path is not None and not self.ending and self.path.end - self.s > self.resumes:
            self.follow(self.path, gait=self.gait, complete=False)

    def _stand_goal(self) -> Array:
        return posed(self.voices["stand"].weights, np.zeros(3), self.posture)

    def _going(self) -> Voice:
        return self.voices[f"canonical/{self.gait}" if self.gait else "locomotion"]

    def _asked_on_path(self, speed: float) -> Array:
        """Parameters of the locomotion module at the figure's place on its path."""
        assert self.path is not None
        weights = self._going().weights
        bend, _, posture = self.path.style(self.s + 0.12 * self.scale)
        at = np.zeros(len(weights.parameters))
        names = weights.parameters
        at[names.index("speed")] = speed
        if "turn" in names:
            at[names.index("turn")] = bend * speed
        return posed(weights, at, posture)

    def _go(self, dt: float) -> None:
        path, pace, playing = self.path, self.pace, self.playing
        assert path is not None
        voice = playing.voice
        room = max(path.end - self.s, 0.0)
        _, asked, posture = path.style(self.s)
        natural = float(voice.table.speeds[0, 0])
        wanted = (natural if self.gait else pace.usual * sqrt(self.scale)) if isnan(asked) else asked
        if self.gait:
            wanted = min(wanted, 1.15 * natural)
        wanted = min(wanted, pace.most * sqrt(self.scale))
        if self._limits is None or self._limits[0] is not path:
            self._limits = (path, path.limits(pace.turning / sqrt(self.scale), pace.slow_in))
        # Speed follows with a lag, so it is asked for a little ahead.
        most = float(self._limits[1][path.point(self.s + 0.15 * self.speed)])
        wanted = min(wanted, most)
        share, hurry, left = self._last_steps(room, wanted)
        wanted = min(wanted * share, most)
        change = (1.0 - exp(-LN2 * dt / pace.hurry)) * (wanted - self.speed)
        # The first steps begin under the body: a figure that starts faster would leave its feet behind.
        start = pace.start * (1.0 + 0.6 * max(self.speed - 1.0, 0.0))
        change = max(min(change, start * dt), -pace.slow * self.scale * dt)
        # Toward the end: by the usual brake, harder only as far as the room that is left asks for.
        self.speed = braked(self.speed, change, room, pace.brake * self.scale, dt)
        rate = 1.0
        if self.gait:
            rate = max(self.speed / natural, 0.35)
            if natural > 2.0 * self.speed and room < LAST * self.scale:
                self.gait = ""  # the last steps are made by the module that can slow down
                playing.switch(self._going(), self._asked_on_path(self.speed), playing.u)
                voice, rate = playing.voice, 1.0
        if not self.gait:
            self.posture[:] = posture
            playing.ask(self._asked_on_path(self.speed), pace.posture, dt)
            playing.set("speed", self.speed)
        speeds_into(voice.table, playing.weights, self._rate)
        pace_now = min(self.speed, max(float(self._rate[0]) * rate, 0.0)) if self.speed > 0.3 else self.speed
        step = min(pace_now * dt, room)
        self.s += step
        arrived = path.end - self.s < 1e-3
        # The last footfall comes when the end does.
        half = 0.5 if playing.u < 0.5 else 1.0
        if not self.gait:
            self._hurry += (1.0 - exp(-LN2 * dt / HURRY)) * (hurry - self._hurry)
            rate = self._hurry
        playing.u = playing.later(dt * rate)
        if left and self.ending and playing.u >= half and not arrived and room < HELD * self.scale:
            playing.u = half - 1e-6
        x, z, heading = path.at(self.s)
        self._settle_slip(dt)
        slip = [float(v) for v in self._slip]
        self.place = Ground(x + slip[0], z + slip[1], heading + slip[2])
        crossed = playing.u >= half
        playing.u %= 1.0
        if arrived and crossed and self.speed <= 0.08:
            self._arrive()

    def _last_steps(self, room: float, wanted: float) -> tuple[float, float, bool]:
        """What speed and cadence are multiplied by ``room`` m before the end, and whether the step is the last."""
        brake = self.pace.brake * self.scale
        counted = COUNTED * self.scale + room_of(self.speed, brake) if self.ending else LAST * self.scale
        if self.gait or room > counted:
            return 1.0, 1.0, False
        if self._cadence is None or self._cadence.brake != brake:
            self._cadence = cadence_of(self.voices["locomotion"], self.pace.most * sqrt(self.scale), brake)
        half = 0.5 if self.playing.u < 0.5 else 1.0
        step = min(self.playing.seconds(half) * self._cadence.rate(self.speed), 1.0)
        share, rate, more = last_steps(self._cadence, room, self.speed, wanted, self.pace.start, step)
        return share if self.ending else 1.0, min(max(rate, RATES[0]), RATES[1]), more == 0

    def _settle_slip(self, dt: float) -> None:
        decay_half = self.pace.bearing
        y = 2.0 * LN2 / decay_half
        e = exp(-y * dt)
        for k in range(3):
            j = self._slip_speed[k] + self._slip[k] * y
            self._slip[k], self._slip_speed[k] = e * (self._slip[k] + j * dt), e * (self._slip_speed[k] - j * y * dt)

    def _arrive(self) -> None:
        self.activity = "stand"
        if self.ending:
            self.path = None
        self.speed = 0.0
        self.gait = "" if self.ending else self.gait
        self.playing.switch(self.voices["stand"], self._stand_goal(), 0.0)

    def _make_move(self, dt: float) -> None:
        playing, move = self.playing, self._move
        assert move is not None
        playing.u = min(playing.later(dt), 1.0)
        way_into(playing.voice.table, playing.weights, playing.u, self._way)
        share = smoothstep((playing.u - move.window[0]) / max(move.window[1] - move.window[0], 1e-6))
        left, ahead, turned = (float(w) + share * p for w, p in zip(self._way, move.pull, strict=True))
        self.place = move.begin.after(left, ahead, turned)
        if playing.transition == "example" and not playing.fading and playing.u < 1.0:
            rest = playing.seconds(1.0)
            playing.fading = rest if rest < self.pace.fade else 0.0
        if playing.u >= 1.0:
            self.activity, self._move = "stand", None
            playing.switch(self.voices["stand"], self._stand_goal(), 0.0)

    def _compose(self, dt: float) -> None:
        """The local pose into the world, on the ground, with its feet held."""
        playing = self.playing
        still = GOES if self.activity != "stand" else (STILL if playing.since > 0.12 else STANDS)
        self.stance.place(self.place, playing.place, playing.rotations, playing.signal, still, dt)

    # Save and restore

    def snapshot(self) -> dict[str, Any]:
        """All that the next pose depends on, as plain values (`restore` takes it)."""
        path = self.path
        return {
            "place": [self.place.x, self.place.z, self.place.heading],
            "posture": self.posture.tolist(),
            "activity": self.activity, "s": float(self.s), "speed": float(self.speed), "gait": self.gait,
            "ending": self.ending, "hurry": float(self._hurry), "voice": self._voice_key(),
            "playing": self.playing.snapshot(), "slip": self._slip.tolist(),
            "move": None if self._move is None else [
                [self._move.begin.x, self._move.begin.z, self._move.begin.heading], list(self._move.pull),
                list(self._move.window)],
            "path": None if path is None else self._packed_path(path),
            "stance": self.stance.snapshot(),
        }  # fmt: skip

    def _packed_path(self, path: Path) -> list[Any]:
        """The path as saved, packed anew only when it changed or most of what was packed lies behind."""
        if self._pack is None or self._pack[0] is not path or self.s > self._pack[1] + 0.5 * AHEAD:
            self._pack = (path, self.s, path.packed(self.s))
        return self._pack[2]

    def _voice_key(self) -> str:
        return next(key for key, voice in self.voices.items() if voice is self.playing.voice)

    def restore(self, saved: dict[str, Any]) -> None:
        """Take up from a snapshot of the same motion set; raises ValueError for one that does not fit."""
        try:
            voice = self.voices[saved["voice"]]
            self.reset(*saved["place"])
            self.playing.restore(voice, saved["playing"])
            self.posture[:] = saved["posture"]
            self.activity, self.s, self.speed = saved["activity"], float(saved["s"]), float(saved["speed"])
            self.gait, self.ending = saved["gait"], bool(saved["ending"])
            self._hurry = float(saved["hurry"])
            self._slip[:] = saved["slip"]
            move = saved["move"]
            self._move = None if move is None else _Move(Ground(*move[0]), tuple(move[1]), tuple(move[2]))
            self.path = None if saved["path"] is None else Path.unpacked(saved["path"])
            self.stance.restore(saved["stance"])
            if (self.activity == "go" and self.path is None) or (self.activity == "move" and self._move is None):
                raise ValueError("saved without what it was doing")
            self._compose(1e-4)
        except (KeyError, TypeError, IndexError, AttributeError) as error:
            raise ValueError(f"not a saved player: {error}") from None


__all__ = ["PACE", "Pace", "Path", "Player", "Transition", "Voice", "path_of", "voices"]
