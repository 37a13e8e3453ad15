"""What the interpreter's cores share: the scene they see and the meaning that they say.

A core knows no node and no topic. It hears device messages of one kind, sees the `Scene` and answers with a
`Meaning`; the node merges the meanings of all cores and publishes them.
"""

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.fk import fk_into
from bunraku.figure.rig import Rig, rig_of
from bunraku.figure.skeleton import Skeleton
from bunraku.msgs import Camera, CommandBase, Primitive

Array = NDArray[np.float64]
Value = tuple[float, ...] | float

TARGETS = (
    "pelvis", "left_hand", "right_hand", "left_foot", "right_foot", "trunk", "head", "yaw",
    "left_elbow", "right_elbow", "left_knee", "right_knee",
)  # fmt: skip
"""Fields of the target message."""
STANDING = 0.03
"""m above its height at rest up to which an ankle whose contact is not told counts as standing."""


@dataclass(eq=False)
class Scene:
    """What the cores see at a step: the figure's newest pose, the camera and the time."""

    skeleton: Skeleton
    rig: Rig
    camera: Camera
    now: float = 0.0  # s
    planted: tuple[bool, bool] = (True, True)
    """Whether the left and the right foot stand."""
    positions: Array = field(init=False)  # (J, 3) m, world
    turns: Array = field(init=False)  # (J, 4) xyzw, world

    def __post_init__(self) -> None:
        self.positions = np.array(self.skeleton.rest_positions)
        self.turns = np.zeros((len(self.skeleton), 4))
        self.turns[:, 3] = 1.0

    @classmethod
    def of(cls, skeleton: Skeleton, camera: Camera) -> "Scene":
        """The skeleton at rest; raises `SkeletonError` for one that is no humanoid."""
        return cls(skeleton, rig_of(skeleton), camera)

    def take(self, root: Array, rotations: Array, planted: tuple[bool, bool]) -> None:
        """A new pose: root position (3), local rotations (J, 4), and which feet stand."""
        fk_into(
            self.rig.parents, self.rig.offsets, np.asarray(root, dtype=np.float64),
            np.ascontiguousarray(rotations, dtype=np.float64), self.positions, self.turns,
        )  # fmt: skip
        if not any(planted):
            # A pose that tells no contact: a foot at standing height stands.
            planted = (self._low(0), self._low(1))
        self.planted = planted

    def _low(self, side: int) -> bool:
        ankle = self.positions[int(self.rig.limbs[2 + side, 2]), 1]
        return bool(ankle < self.rig.ankle_heights[side] + STANDING)

    def joint(self, role: str) -> int:
        """The joint of a VRM role."""
        return self.skeleton.roles[role]


@dataclass
class Meaning:
    """What a core means now: the held parts, new commands, a moved camera, and what to draw."""

    target: dict[str, Value] = field(default_factory=dict)
    commands: list[CommandBase] = field(default_factory=list)
    camera: Camera | None = None
    overlay: list[Primitive] = field(default_factory=list)


class Core(Protocol):
    """Turns the samples of one kind of device into meaning."""

    @property
    def busy(self) -> bool:
        """Whether time alone changes what it means, or something is held: it wants `update` now and then."""
        ...

    def hear(self, message: Any, scene: Scene) -> None:
        """A device's sample."""
        ...

    def lose(self, device: str, scene: Scene) -> None:
        """A device is gone: let go of all that it held."""
        ...

    def update(self, scene: Scene) -> Meaning:
        """What is meant now; called after every `hear` and on the node's idle clock."""
        ...

    def save(self) -> dict[str, Any]:
        """Small state (plain values) to take up from after a crash."""
        ...

    def restore(self, state: dict[str, Any], scene: Scene) -> None:
        """Take up from `save`."""
        ...
