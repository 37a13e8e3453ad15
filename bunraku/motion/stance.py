"""A blended pose in the world: carried to its place, raised to the ground, its planted feet held."""

from math import cos, inf, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.limits import clamp_hinge, limits_of
from bunraku.figure.quat import from_axis_angle, mul, rotate
from bunraku.figure.rig import rig_of
from bunraku.figure.skeleton import Skeleton
from bunraku.figure.spring import spring_to_into
from bunraku.motion.constraint import Ground
from bunraku.motion.footlock import LOCKED, FeetState, feet_of, feet_state, plant_into
from bunraku.motion.footprint import planted, print_under, yaw_pitch
from bunraku.motion.ground import GroundHeight

Array = NDArray[np.float64]

RISE = 0.12
"""s, half-life in which the body follows the ground's height."""
HIGHER = 0.35
"""How much of the way from the lower to the higher foot's ground the body is raised."""
SOON = (0.0, 0.05, 0.10, 0.15)
"""s ahead for which a swinging foot keeps clear of the ground."""
FORWARD = np.array([0.0, 0.0, 1.0])
LAYINGS = 4
"""Rounds in which a print's slope is found."""


class Stance:
    """The figure as it stands in the world; `place` makes the next pose.

    Args:
        ground: height (m) of the ground at (x, z); None for level ground at 0.
        lock: hold planted feet (else the pose is as blended).
    """

    def __init__(self, skeleton: Skeleton, ground: GroundHeight | None = None, lock: bool = True) -> None:
        self.ground, self.lock = ground, lock
        self.feet = feet_of(skeleton)
        joints = len(skeleton)
        self.root, self.rotations, self.contacts = np.zeros(3), np.zeros((joints, 4)), np.zeros(2)
        self.beyond = 0.0
        """How far a locked foot was beyond its leg's reach, m."""
        self._limits, rig = limits_of(skeleton), rig_of(skeleton)
        self._elbows = [int(joint) for joint in rig.limbs[:2, 1]]
        self._offsets, self._parents = np.array(skeleton.offsets), np.array(skeleton.parents)
        self._positions, self._turns = np.zeros((joints, 3)), np.zeros((joints, 4))
        self._yaw, self._heights, self._toward = np.zeros(4), np.zeros(3), np.zeros(3)
        self.reset(0.0, 0.0)

    def reset(self, x: float, z: float) -> None:
        """Nothing remembered, at a place on the ground (m)."""
        self.state: FeetState = feet_state()
        self._lift, self._lift_speed = np.zeros(1), np.zeros(1)
        self._before = np.tile([x, z], (2, 1))
        if self.ground is not None:
            self._lift[0] = self.ground(x, z)

    def place(self, at: Ground, root: Array, rotations: Array, signal: Array, still: int, dt: float) -> None:
        """Put a pose (``root`` (3) m and ``rotations`` (J, 4) in the path frame) at a place on the ground.

        Args:
            signal: (2) > 0 where the blended motion has the foot down.
            still: `footlock.GOES`, `STANDS` or `STILL`: feet of one that stands still may step to their places.
        """
        self.root[:] = root
        spot = at.after(float(root[0]), float(root[2]), 0.0)
        self.root[0], self.root[2] = spot.x, spot.z
        self.rotations[:] = rotations
        for elbow in self._elbows:  # passing from one motion to another may carry them beyond straight
            clamp_hinge(self._limits, elbow, self.rotations[elbow])
        from_axis_angle(0.0, 1.0, 0.0, at.heading, self._yaw)
        mul(self._yaw, self.rotations[0], self.rotations[0])
        if self.ground is not None:
            self._raise(self.ground, dt)
        self.contacts[:] = signal
        was = (int(self.state.mode[0]), int(self.state.mode[1]))
        self.beyond = plant_into(
            self.feet, self.state, self._parents, self._offsets, self.root, self.rotations, self._positions,
            self._turns, self.contacts, self._heights, still, self.lock, max(dt, 1e-4),
        )  # fmt: skip
        if self.ground is not None:
            self._print_heights(self.ground, was)

    def _raise(self, ground: GroundHeight, dt: float) -> None:
        """Lift the body to the ground under its feet: nearer to the lower one, followed softly."""
        level = []
        for side in range(2):
            at = self.state.ankle[side] if self.state.drop[2] else self.root
            here = float(at[0]), float(at[2])
            if self.state.mode[side] == LOCKED:
                _, height, _, _, slope = (float(v) for v in self.state.prints[side])
                level.append(height)
                # Its lower end's, so that it is not raised when it is let go.
                self._heights[side] = height + min(sin(slope) * float(end) for end in self.feet.soles[side, 1:])
            else:
                level.append(ground(*here))
                swings = self.state.drop[2] and dt > 0.0
                self._heights[side] = max(level[side], self._cleared(ground, side, dt)) if swings else level[side]
            self._before[side] = here
        low, high = min(level), max(level)
        goal = np.array([low + HIGHER * (high - low)])
        if dt > 0.0:
            spring_to_into(self._lift, self._lift_speed, goal, RISE, dt)
        else:
            self._lift[:] = goal
        self._heights[2] = self._lift[0]
        self.root[1] += self._lift[0]

    def _cleared(self, ground: GroundHeight, side: int, dt: float) -> float:
        """The highest ground (m) under a swinging foot's heel and ball, now and where it soon will be."""
        ankle, (x, z) = self.state.ankle[side], self._before[side]
        _, heel, ball = (float(v) for v in self.feet.soles[side])
        rotate(ankle[3:7], FORWARD, self._toward)
        high = -inf
        for soon in SOON:
            for k in (heel, ball):
                ahead_x = soon * (float(ankle[0]) - x) / dt + k * float(self._toward[0])
                ahead_z = soon * (float(ankle[2]) - z) / dt + k * float(self._toward[2])
                high = max(high, ground(float(ankle[0]) + ahead_x, float(ankle[2]) + ahead_z))
        return high

    def _print_heights(self, ground: GroundHeight, was: tuple[int, int]) -> None:
        """Put the prints of feet that have just come down on the ground, along its slope.

        The heel or ball on which a foot stands stays where it is; the foot's other end is laid onto the ground.
        """
        state, goal, goal_turn, angles = self.state, np.empty(3), np.empty(4), np.empty(2)
        for side in range(2):
            if state.mode[side] != LOCKED or was[side] == LOCKED:
                continue
            mark, ankle, offset = state.prints[side], state.ankle[side], state.offset[side]
            _, heel, ball = (float(v) for v in self.feet.soles[side])
            yaw_pitch(ankle[3:7], angles)
            pitch = float(angles[1])
            height = slope = 0.0
            for _ in range(LAYINGS):
                print_under(self.feet, side, ankle[0:3], ankle[3:7], height, slope, mark)
                s, c = cos(slope) * sin(float(angles[0])), cos(slope) * cos(float(angles[0]))
                back, front = (ground(float(mark[0] + k * s), float(mark[2] + k * c)) for k in (heel, ball))
                height = back if pitch >= slope else front
                slope = float(np.arcsin(np.clip((front - back) / (ball - heel), -0.9, 0.9)))
            print_under(self.feet, side, ankle[0:3], ankle[3:7], height, slope, mark)
            offset[1] -= slope
            planted(self.feet, side, mark, pitch - slope, float(offset[2]), goal, goal_turn)
            offset[0] = ankle[1] - goal[1]

    def snapshot(self) -> dict[str, Any]:
        """What the next pose depends on, as plain values."""
        feet = [array.tolist() for array in self.state]
        return {
            "feet": feet,
            "lift": [float(self._lift[0]), float(self._lift_speed[0])],
            "before": self._before.tolist(),
        }

    def restore(self, saved: dict[str, Any]) -> None:
        """Take up from a snapshot; raises ValueError for one of another version."""
        kept = [np.array(rows, dtype=array.dtype) for rows, array in zip(saved["feet"], self.state, strict=True)]
        if any(a.shape != b.shape for a, b in zip(kept, self.state, strict=True)):
            raise ValueError("saved by another version")
        self.state = FeetState(*kept)  # type: ignore[arg-type]
        self._lift[0], self._lift_speed[0] = (float(v) for v in saved["lift"])
        self._before[:] = saved["before"]
