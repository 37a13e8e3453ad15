"""Forward kinematics: local rotations to world positions and orientations."""

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel
from bunraku.figure.quat import mul, rotate
from bunraku.figure.skeleton import Skeleton

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@kernel
def fk_into(
    parents: Index, offsets: Array, root: Array, rotations_ls: Array, positions_ws: Array, rotations_ws: Array
) -> None:
    """World positions (J, 3) and orientations (J, 4) from the root position (3) and local rotations (J, 4).

    ``root`` is the world position of joint 0; its own offset is not added.
    """
    for k in range(3):
        positions_ws[0, k] = root[k]
    for k in range(4):
        rotations_ws[0, k] = rotations_ls[0, k]
    for joint in range(1, parents.shape[0]):
        parent = parents[joint]
        rotate(rotations_ws[parent], offsets[joint], positions_ws[joint])
        for k in range(3):
            positions_ws[joint, k] += positions_ws[parent, k]
        mul(rotations_ws[parent], rotations_ls[joint], rotations_ws[joint])


@kernel
def fk_batch_into(
    parents: Index,
    offsets: Array,
    roots: Array,
    rotations_ls: Array,
    positions_ws: Array,
    rotations_ws: Array,
) -> None:
    """`fk_into` for N figures: every array has a leading axis N."""
    for n in range(roots.shape[0]):
        fk_into(parents, offsets, roots[n], rotations_ls[n], positions_ws[n], rotations_ws[n])


def fk(skeleton: Skeleton, root: Array, rotations_ls: Array) -> tuple[Array, Array]:
    """World positions and orientations of one pose, or of many with leading axes.

    Args:
        root: (..., 3) m, world position of the root joint.
        rotations_ls: (..., J, 4) xyzw, relative to the parent.

    Returns:
        positions_ws (..., J, 3) and rotations_ws (..., J, 4).
    """
    joints = len(skeleton)
    rotations = np.ascontiguousarray(rotations_ls, dtype=np.float64)
    roots = np.ascontiguousarray(root, dtype=np.float64)
    if rotations.shape[-2:] != (joints, 4) or roots.shape != (*rotations.shape[:-2], 3):
        raise ValueError(
            f"expected root (..., 3) and rotations (..., {joints}, 4), got {roots.shape}, {rotations.shape}"
        )
    positions_ws = np.empty((*rotations.shape[:-1], 3))
    rotations_ws = np.empty_like(rotations)
    fk_batch_into(
        skeleton.parents, skeleton.offsets, roots.reshape(-1, 3), rotations.reshape(-1, joints, 4),
        positions_ws.reshape(-1, joints, 3), rotations_ws.reshape(-1, joints, 4),
    )  # fmt: skip
    return positions_ws, rotations_ws
