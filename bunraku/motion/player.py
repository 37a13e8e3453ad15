"""Plays the modules of a motion set: what a figure does, pose by pose, led over the ground.

The player *stands*, *goes* along a path, or makes one *move* (a step, a turn, a jump). It blends the module's
examples for the parameters of the moment, carries the path frame along under the root constraints, passes
from motion to motion without a step, and holds the feet. It knows nothing of messages.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, inf, isnan, sqrt
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bunraku.figure.quat import slerp
from bunraku.figure.spring import LN2, spring_to_into
from bunraku.motion.blend import pose_into, speeds_into, way_into
from bunraku.motion.constraint import AHEAD, Ground, Path, path_of, smoothstep, wrapped
from bunraku.motion.footlock import FeetState
from bunraku.motion.footprint import Feet
from bunraku.motion.ground import GroundHeight
from bunraku.motion.motionset import MotionSet
from bunraku.motion.parameters import embed
from bunraku.motion.stance import Stance
from bunraku.motion.timewarp import advance, seconds_between
from bunraku.motion.transition import apply_offset, decay, inertialise, toward
from bunraku.motion.voice import Voice, reach_of, voices
from bunraku.motion.weights import Weights, weights_into

Array = NDArray[np.float64]

Transition = Literal["inertialise", "example"]


@dataclass(frozen=True)
class Pace:
    """How the player leads a figure; lengths and speeds for a leg of 0.83 m."""

    usual: float = 1.3  # m/s, where a path asks for none
    most: float = 4.0  # m/s
    brake: float = 1.7  # m/s², toward a path's end
    start: float = 1.7  # m/s², from a stand; more when it runs
    hurry: float = 0.14  # s, half-life of a change of speed
    bearing: float = 0.20  # s, half-life of finding back to a path
    posture: float = 0.12  # s, half-life of a change of posture
    turning: float = 3.0  # rad/s at most along a path
    slow_in: float = 2.4  # m/s², toward its bends
    aside: float = 0.9  # rad: a standing figure that has to start farther off its heading than this turns first
    switch: float = 0.11  # s, half-life of a transition
    fade: float = 0.25  # s, of a transition by the (n+1)-th example


PACE = Pace()


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
        self.pace, self.transition = pace, transition
        self.stance = Stance(self.skeleton, ground, lock)
        self.scale = float(self.stance.feet.lengths.sum(axis=1).mean()) / 0.83
        joints = len(self.skeleton)
        self._local, self._local_place = np.zeros((joints, 4)), np.zeros(3)
        self._before, self._before_place = np.zeros((joints, 4)), np.zeros(3)
        self._trial, self._trial_place = np.zeros((joints, 4)), np.zeros(3)
        self._after, self._after_place = np.zeros((joints, 4)), np.zeros(3)
        self._offset, self._offset_speed = np.zeros(3 + 3 * joints), np.zeros(3 + 3 * joints)
        self._signal = np.zeros(2)
        self._spare, self._rate = np.zeros(2), np.zeros(2)
        self._way = np.zeros(3)
        self.reset()

    def reset(self, x: float = 0.0, z: float = 0.0, heading: float = 0.0) -> None:
        """Stand upright at a place on the ground (m) with a heading (rad)."""
        self.place = Ground(x, z, heading)
        self.posture = np.zeros(3)
        self._mask = np.ones(len(self.skeleton))
        self._mask_goal = np.ones(len(self.skeleton))
        self.activity: Literal["stand", "go", "move"] = "stand"
        self.path: Path | None = None
        self._pack: tuple[Path, float, list[Any]] | None = None
        self._limits: tuple[Path, Array] | None = None
        self.s = 0.0
        self.speed = 0.0
        self.gait = ""
        self.ending = False
        self._slip = np.zeros(3)  # m, m, rad: off the path, dying away
        self._slip_speed = np.zeros(3)
        self._move: _Move | None = None
        self._voice = self.voices["stand"]
        self._asked = self._voice.weights.neutral(np.zeros(3))
        self._asked_speed = np.zeros_like(self._asked)
        self._weights = self._voice.weights(self._asked)
        self.u = 0.0
        self._since = inf  # s since the last switch
        self._fading: Array | None = None
        self._offset[:] = 0.0
        self._offset_speed[:] = 0.0
        self.stance.reset(x, z)
        self._blend(self._voice, self._weights, self.u, self._local_place, self._local, self._signal)
        self._before[:], self._before_place[:] = self._local, self._local_place
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
            self._mask_goal[:] = 1.0
            return
        self._mask_goal[:] = 0.0
        self._mask_goal[list(joints)] = 1.0
        self._mask_goal[0] = 1.0
        for leg in self.feet.joints:
            self._mask_goal[[int(j) for j in leg if j >= 0]] = 1.0

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
        self.path, self.s, self.gait, self.ending = path, s, gait, complete
        px, pz, ph = path.at(s)
        self._slip[:] = x - px, z - pz, wrapped(heading - ph)
        if not going:
            self._slip_speed[:] = 0.0
            self.speed = 0.0
            self.activity, self._move = "go", None
            first = 0.5 if wrapped(ph - heading) > 0.0 else 0.0  # the inner foot goes first
            self._switch(self._going(), self._asked_on_path(0.0), first)
        elif self._voice is not self._going():
            self._switch(self._going(), self._asked_on_path(self.speed), self.u)

    def _near(self, path: Path, s: float) -> bool:
        x, z, _ = path.at(s)
        return abs(x - self.place.x) + abs(z - self.place.z) < 0.3 + float(np.abs(self._slip[:2]).sum())

    def stop(self) -> None:
        """Leave the path as soon as the figure can come to a stand."""
        if self.activity == "go" and self.path is not None:
            room = self.speed**2 / (2.0 * self.pace.brake * self.scale)
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
        self._switch(voice, np.asarray(values, dtype=np.float64), 0.0, weights)

    @property
    def reach(self) -> dict[str, tuple[float, float]]:
        """Smallest and largest measured value of each module's distance or height, m."""
        return reach_of(self.voices)

    @property
    def free(self) -> bool:
        """Whether another activity may begin now: nothing runs but standing."""
        return self.activity == "stand"

    @property
    def weights(self) -> Array:
        """(n,) weights of the examples that are blended now."""
        return self._weights

    @property
    def over(self) -> bool:
        """Whether a step or turn has both feet down again, so that walking may follow at once."""
        if self.activity != "move" or not self._voice.name.startswith(("step_", "turn_")):
            return False
        return self.u >= float(self._voice.table.generic[-2])

    @property
    def waiting(self) -> bool:
        """Whether the figure has caught up with a path that is still growing."""
        return self.path is not None and not self.ending and self.activity == "stand"

    # The next pose

    def update(self, dt: float) -> None:
        """Go on by ``dt`` seconds (0 < dt <= 0.1): sets `root`, `rotations` and `contacts`."""
        dt = min(max(dt, 1e-4), 0.1)
        self._before[:], self._before_place[:] = self._local, self._local_place
        if self.activity == "go":
            self._go(dt)
        elif self.activity == "move":
            self._make_move(dt)
        else:
            self._idle(dt)
        self._since += dt
        self._blend(self._voice, self._weights, self.u, self._local_place, self._local, self._signal)
        if self._fading is not None:
            self._fade()
        self._mask += (1.0 - exp(-LN2 * dt / 0.1)) * (self._mask_goal - self._mask)
        if self.activity != "stand" and float(self._mask.min()) < 0.999:
            self._rest_of_body()
        decay(self._offset, self._offset_speed, self.pace.switch, dt)
        apply_offset(self._offset, self._local_place, self._local)
        self._compose(dt)

    def _idle(self, dt: float) -> None:
        voice = self.voices["stand"]
        self._ask(self._stand_goal(), self.pace.posture, dt)
        self.u = advance(voice.table.generic, voice.table.spans, self._weights, self.u, dt) % 1.0
        if self.path is not None and not self.ending and self.path.end - self.s > 0.12 * self.scale:
            self.follow(self.path, gait=self.gait, complete=False)

    def _stand_goal(self) -> Array:
        return self._posed(self.voices["stand"].weights, np.zeros(3), self.posture)

    @staticmethod
    def _posed(weights: Weights, at: Array, posture: Array) -> Array:
        """Parameters whose tilt, bend and duck are what is usual there and the wanted posture on top."""
        goal = weights.neutral(at)
        for k, name in enumerate(weights.parameters):
            if name == "tilt":
                goal[k] += posture[0]
            elif name == "bend":
                goal[k] += posture[1]
            elif name == "duck":
                goal[k] += posture[2] * max(1.0 - goal[k], 0.0)
        return goal

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
        return self._posed(weights, at, posture)

    def _go(self, dt: float) -> None:
        path, pace, voice = self.path, self.pace, self._voice
        assert path is not None
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
        wanted = min(wanted, float(self._limits[1][path.point(self.s + 0.15 * self.speed)]))
        change = (1.0 - exp(-LN2 * dt / pace.hurry)) * (wanted - self.speed)
        # The first steps begin under the body: a figure that starts faster would leave its feet behind.
        self.speed += min(change, pace.start * (1.0 + 0.6 * max(self.speed - 1.0, 0.0)) * dt)
        brake = sqrt(2.0 * pace.brake * self.scale * room)
        self.speed = min(self.speed, max(brake, 0.04))
        rate = 1.0
        if self.gait:
            rate = max(self.speed / natural, 0.35)
            self._asked[:] = voice.weights.table.center
            if natural > 2.0 * self.speed and room < 0.5 * self.scale:
                self.gait = ""  # the last steps are made by the module that can slow down
                self._switch(self._going(), self._asked_on_path(self.speed), self.u)
                voice, rate = self._voice, 1.0
        if not self.gait:
            self.posture[:] = posture
            self._ask(self._asked_on_path(self.speed), pace.posture, dt)
            at = voice.weights.parameters.index("speed")
            self._asked[at], self._asked_speed[at] = self.speed, 0.0
            weights_into(voice.weights.table, self._asked, self._weights)
        speeds_into(voice.table, self._weights, self._rate)
        pace_now = min(self.speed, max(float(self._rate[0]) * rate, 0.0)) if self.speed > 0.3 else self.speed
        step = min(pace_now * dt, room)
        self.s += step
        arrived = path.end - self.s < 1e-3
        # The last footfall comes when the end does.
        before = self.u
        half = 0.5 if before < 0.5 else 1.0
        if room < 0.5 * self.scale and not self.gait:
            left = seconds_between(voice.table.generic, voice.table.spans, self._weights, before, half)
            eta = sqrt(2.0 * room / (pace.brake * self.scale))
            rate = min(max(left / max(eta, 1e-3), 0.8), 1.35)
        self.u = advance(voice.table.generic, voice.table.spans, self._weights, before, dt * rate)
        x, z, heading = path.at(self.s)
        self._settle_slip(dt)
        slip = [float(v) for v in self._slip]
        self.place = Ground(x + slip[0], z + slip[1], heading + slip[2])
        crossed = self.u >= half
        self.u %= 1.0
        if arrived and crossed and self.speed <= 0.08:
            self._arrive()

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
        self._switch(self.voices["stand"], self._stand_goal(), 0.0)

    def _make_move(self, dt: float) -> None:
        voice, move = self._voice, self._move
        assert move is not None
        self.u = min(advance(voice.table.generic, voice.table.spans, self._weights, self.u, dt), 1.0)
        way_into(voice.table, self._weights, self.u, self._way)
        share = smoothstep((self.u - move.window[0]) / max(move.window[1] - move.window[0], 1e-6))
        left, ahead, turned = (float(w) + share * p for w, p in zip(self._way, move.pull, strict=True))
        self.place = move.begin.after(left, ahead, turned)
        if self.transition == "example" and self._fading is None and self.u < 1.0:
            rest = seconds_between(voice.table.generic, voice.table.spans, self._weights, self.u, 1.0)
            if rest < self.pace.fade:
                self._fading = np.array([rest])
        if self.u >= 1.0:
            self.activity, self._move = "stand", None
            self._switch(self.voices["stand"], self._stand_goal(), 0.0)

    def _fade(self) -> None:
        """The next motion's first posture as the (n+1)-th example, with growing weight."""
        assert self._fading is not None
        stand = self.voices["stand"]
        rest = seconds_between(self._voice.table.generic, self._voice.table.spans, self._weights, self.u, 1.0)
        share = smoothstep(1.0 - rest / max(float(self._fading[0]), 1e-6))
        self._blend(stand, stand.weights(self._stand_goal()), 0.0, self._trial_place, self._trial, self._spare)
        toward(share, self._trial_place, self._trial, self._local_place, self._local)

    def _rest_of_body(self) -> None:
        """Joints that the motion is not to move stand."""
        stand = self.voices["stand"]
        self._blend(stand, stand.weights(self._stand_goal()), 0.0, self._trial_place, self._trial, self._spare)
        for joint in np.nonzero(self._mask < 0.999)[0]:
            slerp(self._trial[joint], self._local[joint], float(self._mask[joint]), self._local[joint])

    def _ask(self, goal: Array, half_life: float, dt: float) -> None:
        spring_to_into(self._asked, self._asked_speed, goal, half_life, dt)
        weights_into(self._voice.weights.table, self._embedded(self._asked), self._weights)

    def _embedded(self, values: Array) -> Array:
        names = self._voice.weights.parameters
        return embed(names, values) if "angle" in names else values

    def _switch(self, voice: Voice, asked: Array, u: float, weights: Array | None = None) -> None:
        """Pass to another voice at generic time ``u``."""
        self._voice, self.u = voice, u
        self._asked, self._asked_speed = np.array(asked, dtype=np.float64), np.zeros(len(asked))
        self._weights = voice.weights(asked) if weights is None else weights
        table = voice.table
        dt = 1.0 / 60.0
        self._blend(voice, self._weights, u, self._trial_place, self._trial, self._spare)
        later = advance(table.generic, table.spans, self._weights, u, dt)
        later = later % 1.0 if table.cycle else min(later, 1.0)
        self._blend(voice, self._weights, later, self._after_place, self._after, self._spare)
        if self._fading is None and self.transition == "inertialise":
            inertialise(
                self._local_place, self._local, self._before_place, self._before,
                self._trial_place, self._trial, self._after_place, self._after, dt, self._offset, self._offset_speed,
            )  # fmt: skip
        elif self.transition == "example" and self._fading is None:
            inertialise(
                self._local_place, self._local, self._local_place, self._local,
                self._trial_place, self._trial, self._trial_place, self._trial, dt, self._offset, self._offset_speed,
            )  # fmt: skip
        self._fading = None
        self._since = 0.0

    def _blend(
        self, voice: Voice, weights: Array, u: float, place: Array, rotations: Array, signal: Array
    ) -> None:  # fmt: skip
        pose_into(voice.table, weights, u, place, rotations, signal)

    def _compose(self, dt: float) -> None:
        """The local pose into the world, on the ground, with its feet held."""
        still = self.activity == "stand" and self._since > 0.12
        self.stance.place(self.place, self._local_place, self._local, self._signal, still, dt)

    # Save and restore

    def snapshot(self) -> dict[str, Any]:
        """All that the next pose depends on, as plain values (`restore` takes it)."""
        path = self.path
        return {
            "place": [self.place.x, self.place.z, self.place.heading],
            "posture": self.posture.tolist(),
            "activity": self.activity, "s": float(self.s), "speed": float(self.speed), "gait": self.gait,
            "ending": self.ending, "voice": self._voice_key(), "asked": self._asked.tolist(),
            "weights": self._weights.tolist(), "u": float(self.u),
            "slip": self._slip.tolist(),
            "move": None if self._move is None else [
                [self._move.begin.x, self._move.begin.z, self._move.begin.heading], list(self._move.pull),
                list(self._move.window)],
            "path": None if path is None else self._packed_path(path),
            "mask": self._mask.tolist(), "mask_goal": self._mask_goal.tolist(),
            "stance": self.stance.snapshot(),
            "offset": self._offset.astype("<f4").tobytes(), "speeds": self._offset_speed.astype("<f4").tobytes(),
        }  # fmt: skip

    def _packed_path(self, path: Path) -> list[Any]:
        """The path as saved, packed anew only when it changed or most of what was packed lies behind."""
        if self._pack is None or self._pack[0] is not path or self.s > self._pack[1] + 0.5 * AHEAD:
            self._pack = (path, self.s, path.packed(self.s))
        return self._pack[2]

    def _voice_key(self) -> str:
        return next(key for key, voice in self.voices.items() if voice is self._voice)

    def restore(self, saved: dict[str, Any]) -> None:
        """Take up from a snapshot of the same motion set; raises ValueError for one that does not fit."""
        try:
            voice = self.voices[saved["voice"]]
            weights = np.array(saved["weights"], dtype=np.float64)
            asked = np.array(saved["asked"], dtype=np.float64)
            if weights.shape != (len(voice.table.logs),) or asked.shape != (len(voice.parameters),):
                raise ValueError("saved by another motion set")
            self.reset(*saved["place"])
            self.posture[:] = saved["posture"]
            self.activity, self.s, self.speed = saved["activity"], float(saved["s"]), float(saved["speed"])
            self.gait, self.ending = saved["gait"], bool(saved["ending"])
            self._voice, self._asked, self._weights, self.u = voice, asked, weights, float(saved["u"])
            self._asked_speed = np.zeros(len(asked))
            self._slip[:] = saved["slip"]
            move = saved["move"]
            self._move = None if move is None else _Move(Ground(*move[0]), tuple(move[1]), tuple(move[2]))
            self.path = None if saved["path"] is None else Path.unpacked(saved["path"])
            self.stance.restore(saved["stance"])
            self._mask[:], self._mask_goal[:] = saved["mask"], saved["mask_goal"]
            self._offset[:] = np.frombuffer(saved["offset"], "<f4")
            self._offset_speed[:] = np.frombuffer(saved["speeds"], "<f4")
            self._since = 0.0
            if (self.activity == "go" and self.path is None) or (self.activity == "move" and self._move is None):
                raise ValueError("saved without what it was doing")
            self._blend(self._voice, self._weights, self.u, self._local_place, self._local, self._signal)
            apply_offset(self._offset, self._local_place, self._local)
            self._before[:], self._before_place[:] = self._local, self._local_place
            self._compose(1e-4)
        except (KeyError, TypeError, IndexError, AttributeError) as error:
            raise ValueError(f"not a saved player: {error}") from None


__all__ = ["PACE", "Pace", "Path", "Player", "Voice", "path_of", "voices"]
