"""The skeleton of any humanoid: a tree of joints whose parts are found by VRM bone names."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

REQUIRED_ROLES = (
    "hips", "spine", "head",
    "leftUpperArm", "leftLowerArm", "leftHand", "rightUpperArm", "rightLowerArm", "rightHand",
    "leftUpperLeg", "leftLowerLeg", "leftFoot", "rightUpperLeg", "rightLowerLeg", "rightFoot",
)  # fmt: skip
"""The 15 bones that VRM 1.0 demands of a humanoid."""


class SkeletonError(ValueError):
    """A skeleton that cannot be used; the message names the joint and the remedy."""


def frozen(values: object) -> Array:
    """A read-only float64 copy as a contiguous array."""
    array: Array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A rest pose in numbers. Arrays are read-only; joint 0 is the root and parents come first.

    The rest pose is a T-pose: every joint's rest orientation is the world's, so that the identity
    everywhere is the rest pose and ``offsets`` are world vectors there.
    """

    names: tuple[str, ...]
    parents: Index  # (J,) -1 for the root
    offsets: Array  # (J, 3) m from the parent; the root's own is its height at rest
    roles: Mapping[str, int]  # VRM bone name -> joint
    masses: Array  # (J,) kg, of the part that the joint moves
    mass_centers: Array  # (J, 3) m in the joint's frame
    box_centers: Array  # (J, 3) m in the joint's frame
    box_sizes: Array  # (J, 3) m half extents along the joint's axes; zero for no box
    hash: str = field(init=False)

    def __post_init__(self) -> None:
        count = len(self.names)
        parents: Index = np.array(self.parents, dtype=np.int64)
        parents.setflags(write=False)
        object.__setattr__(self, "parents", parents)
        for key in ("offsets", "mass_centers", "box_centers", "box_sizes"):
            array = frozen(getattr(self, key))
            if array.shape != (count, 3):
                raise SkeletonError(f"{key} has shape {array.shape}, expected ({count}, 3)")
            if not np.isfinite(array).all():
                raise SkeletonError(f"{key} holds values that are not finite")
            object.__setattr__(self, key, array)
        object.__setattr__(self, "masses", frozen(self.masses))
        object.__setattr__(self, "roles", MappingProxyType(dict(self.roles)))
        if self.parents.shape != (count,) or self.masses.shape != (count,):
            raise SkeletonError(f"parents and masses must have one entry for each of the {count} joints")
        if count == 0 or self.parents[0] != -1:
            raise SkeletonError("the first joint must be the root (parent -1)")
        for joint in range(1, count):
            if not 0 <= self.parents[joint] < joint:
                raise SkeletonError(f"joint {self.names[joint]!r} must come after its parent")
        for role, joint in self.roles.items():
            if not 0 <= joint < count:
                raise SkeletonError(f"role {role!r} names joint {joint} of {count}")
        digest = hashlib.sha256("\n".join(self.names).encode())
        digest.update(self.parents.astype("<i8").tobytes())
        digest.update((self.offsets + 0.0).astype("<f4").tobytes())  # as they travel; + 0.0 drops negative zeros
        object.__setattr__(self, "hash", digest.hexdigest()[:16])

    def __len__(self) -> int:
        return len(self.names)

    def role(self, name: str) -> int:
        """The joint that plays a VRM role; raises `SkeletonError` when no joint does."""
        try:
            return self.roles[name]
        except KeyError:
            raise SkeletonError(
                f"no joint plays {name!r}; name one in the skeleton's roles (has: {', '.join(sorted(self.roles))})"
            ) from None

    def check_humanoid(self) -> None:
        """Raise `SkeletonError` unless all 15 required VRM roles are played."""
        missing = [role for role in REQUIRED_ROLES if role not in self.roles]
        if missing:
            raise SkeletonError(f"not a humanoid: no joint plays {', '.join(missing)}")

    @cached_property
    def back(self) -> Index:
        """(n,) the back joints from spine to chest, in order."""
        return np.array([self.roles[r] for r in ("spine", "chest", "upperChest") if r in self.roles], dtype=np.int64)

    @cached_property
    def rest_positions(self) -> Array:
        """(J, 3) world positions of the joints at rest, the root at its rest offset."""
        positions = np.array(self.offsets)
        for joint in range(1, len(self)):
            positions[joint] += positions[self.parents[joint]]
        positions.setflags(write=False)
        return positions

    def rest_pose(self) -> tuple[Array, Array]:
        """The rest pose as (root position (3), local rotations (J, 4))."""
        rotations = np.zeros((len(self), 4))
        rotations[:, 3] = 1.0
        return np.array(self.offsets[0]), rotations
