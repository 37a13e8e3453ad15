"""The figure: its skeleton, its motion and its pose."""

from typing import Annotated, ClassVar

import msgspec
import numpy as np
from msgspec import Meta

from bunraku.msgs.base import Message, Name


class Contacts(msgspec.Struct, kw_only=True):
    """Which feet are planted."""

    left_foot: bool = False
    right_foot: bool = False


class Motion(Message, kw_only=True):
    """A whole pose of one skeleton."""

    shapes: ClassVar[dict[str, tuple[int, ...]]] = {"root": (3,), "rotations": (-1, 4)}

    skeleton: Name
    """Hash of the latched `skeleton` message."""
    root: np.ndarray
    """(3) m, world position of the root joint; its rest offset is not added."""
    rotations: np.ndarray
    """(J, 4) xyzw, local, unit length."""
    contacts: Contacts = msgspec.field(default_factory=Contacts)

    def __post_init__(self) -> None:
        super().__post_init__()
        norms = np.linalg.norm(self.rotations, axis=1)
        if self.rotations.size and np.abs(norms - 1.0).max() > 1e-3:
            raise ValueError("quaternions must have unit length - at `$.rotations`")


class Pose(Motion, kw_only=True):
    """A pose as it is shown."""


class SkeletonMessage(Message, kw_only=True):
    """A skeleton; latched. One row a joint; `parents` come first, the root has -1."""

    shapes: ClassVar[dict[str, tuple[int, ...]]] = {
        "offsets": (-1, 3), "masses": (-1,), "mass_centers": (-1, 3), "box_centers": (-1, 3), "box_sizes": (-1, 3),
    }  # fmt: skip

    figure: Name = "default"
    names: Annotated[list[Name], Meta(min_length=1, max_length=1024)]
    parents: Annotated[list[int], Meta(min_length=1, max_length=1024)]
    roles: dict[Name, int]
    """VRM bone name to joint."""
    offsets: np.ndarray
    """(J, 3) m from the parent in the rest pose (a T-pose in which every joint is turned as the world)."""
    masses: np.ndarray
    """(J) kg of the part that the joint moves."""
    mass_centers: np.ndarray
    """(J, 3) m, its centre of mass in the joint's frame."""
    box_centers: np.ndarray
    """(J, 3) m, centre of its box in the joint's frame."""
    box_sizes: np.ndarray
    """(J, 3) m, half extents of its box along the joint's axes; zero for none."""

    def __post_init__(self) -> None:
        super().__post_init__()
        count = len(self.names)
        if len(self.parents) != count or len(self.offsets) != count:
            raise ValueError(f"{count} names, {len(self.parents)} parents, {len(self.offsets)} offsets")
        if self.parents[0] != -1 or any(not 0 <= p < j for j, p in enumerate(self.parents[1:], 1)):
            raise ValueError("the root comes first and parents before their children - at `$.parents`")
        if any(not 0 <= joint < count for joint in self.roles.values()):
            raise ValueError("a role names a joint that is not there - at `$.roles`")
