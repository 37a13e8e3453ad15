"""A blended pose in the world: carried to its place, raised to the ground, its planted feet held."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.quat import from_axis_angle, mul
from bunraku.figure.skeleton import Skeleton
from bunraku.figure.spring import spring_to_into
from bunraku.motion.constraint import Ground
from bunraku.motion.footlock import LOCKED, FeetState, feet_of, feet_state, plant_into
from bunraku.motion.ground import GroundHeight

Array = NDArray[np.float64]

RISE = 0.12
"""s, half-life in which the body follows the ground's height."""
HIGHER = 0.35
"""How much of the way from the lower to the higher foot's ground the body is raised."""


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
        self._offsets, self._parents = np.array(skeleton.offsets), np.array(skeleton.parents)
        self._positions, self._turns = np.zeros((joints, 3)), np.zeros((joints, 4))
        self._yaw, self._heights = np.zeros(4), np.zeros(3)
        self.reset(0.0, 0.0)

    def reset(self, x: float, z: float) -> None:
        """Nothing remembered, at a place on the ground (m)."""
        self.state: FeetState = feet_state()
        self._lift, self._lift_speed = np.zeros(1), np.zeros(1)
        if self.ground is not None:
            self._lift[0] = self.ground(x, z)

    def place(self, at: Ground, root: Array, rotations: Array, signal: Array, still: bool, dt: float) -> None:
        """Put a pose (``root`` (3) m and ``rotations`` (J, 4) in the path frame) at a place on the ground.

        Args:
            signal: (2) > 0 where the blended motion has the foot down.
            still: the figure stands: feet that stand wrong may step to their places.
        """
        self.root[:] = root
        spot = at.after(float(root[0]), float(root[2]), 0.0)
        self.root[0], self.root[2] = spot.x, spot.z
        self.rotations[:] = rotations
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
            foot = int(self.feet.joints[side, 2])
            if self.state.mode[side] == LOCKED:
                level.append(float(self.state.prints[side, 1]))
            else:
                at = self.state.ankle[side] if self.state.drop[2] else self.root
                level.append(ground(float(at[0]), float(at[2])))
            at = self._positions[foot] if self.state.drop[2] else self.root
            self._heights[side] = ground(float(at[0]), float(at[2]))
        low, high = min(level), max(level)
        goal = np.array([low + HIGHER * (high - low)])
        if dt > 0.0:
            spring_to_into(self._lift, self._lift_speed, goal, RISE, dt)
        else:
            self._lift[:] = goal
        self._heights[2] = self._lift[0]
        self.root[1] += self._lift[0]

    def _print_heights(self, ground: GroundHeight, was: tuple[int, int]) -> None:
        """Put the prints of feet that have just come down on the ground, along its slope."""
        for side in range(2):
            if self.state.mode[side] != LOCKED or was[side] == LOCKED:
                continue
            mark = self.state.prints[side]
            _, heel, ball = (float(v) for v in self.feet.soles[side])
            s, c = float(np.sin(mark[3])), float(np.cos(mark[3]))
            back = ground(float(mark[0] + heel * s), float(mark[2] + heel * c))
            front = ground(float(mark[0] + ball * s), float(mark[2] + ball * c))
            middle = back + (front - back) * (-heel) / (ball - heel)
            self.state.offset[side, 0] -= middle - mark[1]
            mark[1] = middle
            mark[4] = float(np.arctan2(front - back, ball - heel))
            self.state.offset[side, 1] -= mark[4]

    def snapshot(self) -> dict[str, Any]:
        """What the next pose depends on, as plain values."""
        return {"feet": [array.tolist() for array in self.state], "lift": float(self._lift[0])}

    def restore(self, saved: dict[str, Any]) -> None:
        """Take up from a snapshot; raises ValueError for one of another version."""
        kept = [np.array(rows, dtype=array.dtype) for rows, array in zip(saved["feet"], self.state, strict=True)]
        if any(a.shape != b.shape for a, b in zip(kept, self.state, strict=True)):
            raise ValueError("saved by another version")
        self.state = FeetState(*kept)  # type: ignore[arg-type]
        self._lift[0] = float(saved["lift"])
