"""A voice being played: parameters and weights of the moment, generic time, and the passage from the one before."""

from math import exp, inf
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.quat import slerp
from bunraku.figure.spring import LN2, spring_to_into
from bunraku.motion.blend import pose_into
from bunraku.motion.constraint import smoothstep
from bunraku.motion.parameters import embed
from bunraku.motion.timewarp import advance, seconds_between
from bunraku.motion.transition import apply_offset, decay, inertialise, toward
from bunraku.motion.voice import Voice
from bunraku.motion.weights import weights_into

Array = NDArray[np.float64]
Pose = tuple[Array, Array]
"""(3) m, the root in the path frame, and (J, 4) local rotations; the root's against the path frame."""

Transition = Literal["inertialise", "example"]

FRAME = 1.0 / 60.0
"""s over which the velocity of a beginning motion is taken."""
MASKED = 0.1
"""s, half-life in which joints are given to a motion and taken from it."""


def _empty(joints: int) -> Pose:
    return np.zeros(3), np.zeros((joints, 4))


class Playing:
    """What is blended; `pose` makes the next local pose."""

    def __init__(self, voice: Voice, asked: Array, joints: int, transition: Transition = "inertialise") -> None:
        self.transition = transition
        self.place, self.rotations = _empty(joints)
        self.signal = np.zeros(2)
        """(2) > 0 where the blended motion has the foot down."""
        self._before, self._trial, self._after = _empty(joints), _empty(joints), _empty(joints)
        self._offset, self._offset_speed = np.zeros(3 + 3 * joints), np.zeros(3 + 3 * joints)
        self._spare = np.zeros(2)
        self.start(voice, asked)

    def start(self, voice: Voice, asked: Array) -> None:
        """Begin with a voice as if it had been played before."""
        self.voice = voice
        self.asked, self._asked_speed = np.array(asked, dtype=np.float64), np.zeros(len(asked))
        self.weights = voice.weights(self.asked)
        self.u = 0.0
        self.since = inf
        """s since the last switch"""
        self.fading = 0.0
        """s that the passage by the (n+1)-th example takes; 0 when none is under way"""
        self.mask, self.mask_goal = np.ones(len(self.rotations)), np.ones(len(self.rotations))
        self._offset[:], self._offset_speed[:] = 0.0, 0.0
        pose_into(voice.table, self.weights, self.u, self.place, self.rotations, self.signal)
        self.remember()

    def remember(self) -> None:
        """Keep the pose as the one before the next."""
        self._before[0][:], self._before[1][:] = self.place, self.rotations

    def ask(self, goal: Array, half_life: float, dt: float) -> None:
        """Let the parameters approach ``goal`` and weigh the examples for them."""
        spring_to_into(self.asked, self._asked_speed, goal, half_life, dt)
        self._weigh()

    def set(self, name: str, value: float) -> None:
        """Let one parameter have a value at once."""
        at = self.voice.weights.parameters.index(name)
        self.asked[at], self._asked_speed[at] = value, 0.0
        self._weigh()

    def _weigh(self) -> None:
        names = self.voice.weights.parameters
        place = embed(names, self.asked) if "angle" in names else self.asked
        weights_into(self.voice.weights.table, place, self.weights)

    def later(self, dt: float) -> float:
        """Generic time ``dt`` s from now; > 1 when the motion ends on the way."""
        table = self.voice.table
        return advance(table.generic, table.spans, self.weights, self.u, dt)

    def seconds(self, end: float) -> float:
        """s until generic time ``end``."""
        table = self.voice.table
        return seconds_between(table.generic, table.spans, self.weights, self.u, end)

    def switch(self, voice: Voice, asked: Array, u: float, weights: Array | None = None) -> None:
        """Pass to another voice at its generic time ``u``."""
        self.voice, self.u = voice, u
        self.asked, self._asked_speed = np.array(asked, dtype=np.float64), np.zeros(len(asked))
        self.weights = voice.weights(asked) if weights is None else weights
        if not self.fading:
            self._pass()
        self.fading = 0.0
        self.since = 0.0

    def _pass(self) -> None:
        """Keep what the pose (and, inertialised, its velocity) differs by from the voice's."""
        voice = self.voice
        pose_into(voice.table, self.weights, self.u, *self._trial, self._spare)
        now, before, begin, after = (self.place, self.rotations), self._before, self._trial, self._after
        if self.transition == "inertialise":
            later = self.later(FRAME)
            pose_into(
                voice.table, self.weights, later % 1.0 if voice.table.cycle else min(later, 1.0), *after, self._spare
            )
        else:
            before, after = now, begin
        inertialise(*now, *before, *begin, *after, FRAME, self._offset, self._offset_speed)

    @property
    def partial(self) -> bool:
        """Whether standing is needed besides: it fades in, or has joints that the motion is not to move."""
        return bool(self.fading) or float(self.mask_goal.min()) < 1.0 or float(self.mask.min()) < 0.999

    def pose(self, dt: float, half_life: float, rest: tuple[Voice, Array] | None, moving: bool) -> None:
        """Make `place`, `rotations` and `signal`, ``dt`` s after the last.

        Args:
            half_life: s, of a transition.
            rest: a voice and its parameters that fade in, or move the joints that are masked; None when neither is.
            moving: the mask counts.
        """
        self.since += dt
        pose_into(self.voice.table, self.weights, self.u, self.place, self.rotations, self.signal)
        self.mask += (1.0 - exp(-LN2 * dt / MASKED)) * (self.mask_goal - self.mask)
        masked = moving and float(self.mask.min()) < 0.999
        if rest is not None and (self.fading or masked):
            voice, asked = rest
            pose_into(voice.table, voice.weights(asked), 0.0, *self._trial, self._spare)
            if self.fading:
                share = smoothstep(1.0 - self.seconds(1.0) / self.fading)
                toward(share, *self._trial, self.place, self.rotations)
            if masked:
                for joint in np.nonzero(self.mask < 0.999)[0]:
                    slerp(self._trial[1][joint], self.rotations[joint], float(self.mask[joint]), self.rotations[joint])
        decay(self._offset, self._offset_speed, half_life, dt)
        apply_offset(self._offset, self.place, self.rotations)

    def snapshot(self) -> dict[str, Any]:
        """What the next pose depends on but the voice, as plain values."""
        return {
            "asked": self.asked.tolist(), "weights": self.weights.tolist(), "u": float(self.u),
            "mask": self.mask.tolist(), "mask_goal": self.mask_goal.tolist(),
            "offset": self._offset.astype("<f4").tobytes(), "speeds": self._offset_speed.astype("<f4").tobytes(),
        }  # fmt: skip

    def restore(self, voice: Voice, saved: dict[str, Any]) -> None:
        """Take up from a snapshot; raises ValueError for one that is not of this voice."""
        weights = np.array(saved["weights"], dtype=np.float64)
        asked = np.array(saved["asked"], dtype=np.float64)
        if weights.shape != (len(voice.table.logs),) or asked.shape != (len(voice.parameters),):
            raise ValueError("saved by another motion set")
        self.start(voice, asked)
        self.weights, self.u, self.since = weights, float(saved["u"]), 0.0
        self.mask[:], self.mask_goal[:] = saved["mask"], saved["mask_goal"]
        self._offset[:] = np.frombuffer(saved["offset"], "<f4")
        self._offset_speed[:] = np.frombuffer(saved["speeds"], "<f4")
        pose_into(voice.table, self.weights, self.u, self.place, self.rotations, self.signal)
        apply_offset(self._offset, self.place, self.rotations)
        self.remember()
