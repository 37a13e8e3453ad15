"""The skeleton on the wire: `Skeleton` to `SkeletonMessage` and back, with the same hash on both sides."""

import numpy as np

from bunraku.figure.skeleton import Skeleton, SkeletonError
from bunraku.msgs import SkeletonMessage


def to_message(skeleton: Skeleton, figure: str = "default") -> SkeletonMessage:
    """The latched message that describes a skeleton; ``figure`` is the figure's name on stage."""
    return SkeletonMessage(
        figure=figure,
        names=list(skeleton.names),
        parents=[int(parent) for parent in skeleton.parents],
        roles={role: int(joint) for role, joint in skeleton.roles.items()},
        offsets=np.array(skeleton.offsets, dtype=np.float32),
        masses=np.array(skeleton.masses, dtype=np.float32),
        mass_centers=np.array(skeleton.mass_centers, dtype=np.float32),
        box_centers=np.array(skeleton.box_centers, dtype=np.float32),
        box_sizes=np.array(skeleton.box_sizes, dtype=np.float32),
    )


def from_message(message: SkeletonMessage) -> Skeleton:
    """The skeleton that a message describes; numbers are the message's float32 ones.

    Raises:
        SkeletonError: the fields do not fit each other (one row a joint in every array).
    """
    count = len(message.names)
    for key in ("masses", "mass_centers", "box_centers", "box_sizes"):
        if len(getattr(message, key)) != count:
            raise SkeletonError(f"{key} has {len(getattr(message, key))} rows for {count} joints; send one a joint")
    return Skeleton(
        tuple(message.names), np.array(message.parents), message.offsets, message.roles, message.masses,
        message.mass_centers, message.box_centers, message.box_sizes,
    )  # fmt: skip
