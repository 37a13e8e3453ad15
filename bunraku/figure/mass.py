"""Masses and the centre of mass."""

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.fk import fk
from bunraku.figure.jit import kernel
from bunraku.figure.quat import rotate
from bunraku.figure.skeleton import Skeleton

Array = NDArray[np.float64]


@kernel
def center_of_mass_into(
    masses: Array, mass_centers: Array, positions_ws: Array, rotations_ws: Array, out: Array
) -> None:
    """The body's centre of mass (3, m, world) of one pose in world positions and orientations."""
    v = np.empty(3)
    total = 0.0
    for k in range(3):
        out[k] = 0.0
    for joint in range(masses.shape[0]):
        m = masses[joint]
        if m > 0.0:
            rotate(rotations_ws[joint], mass_centers[joint], v)
            for k in range(3):
                out[k] += m * (positions_ws[joint, k] + v[k])
            total += m
    if total <= 0.0:
        # Without masses the root stands for the whole.
        for k in range(3):
            out[k] = positions_ws[0, k]
        return
    for k in range(3):
        out[k] /= total


def center_of_mass(skeleton: Skeleton, root: Array, rotations_ls: Array) -> Array:
    """The centre of mass (..., 3) m of one pose or of many with leading axes (as `fk`)."""
    positions, rotations = fk(skeleton, root, rotations_ls)
    joints = len(skeleton)
    out = np.empty((*positions.shape[:-2], 3))
    flat = out.reshape(-1, 3)
    for n, (p, q) in enumerate(zip(positions.reshape(-1, joints, 3), rotations.reshape(-1, joints, 4), strict=True)):
        center_of_mass_into(skeleton.masses, skeleton.mass_centers, p, q, flat[n])
    return out


def upper_body_share(skeleton: Skeleton) -> float:
    """The share of the body's mass that hangs from the pelvis upward, pelvis included (0.5 without masses).

    Oshita 2013 eqs 17-18 divide by ``M``, which only fits as this share.
    """
    legs = np.zeros(len(skeleton), dtype=bool)
    for role in ("leftUpperLeg", "rightUpperLeg"):
        legs[skeleton.role(role)] = True
    for joint in range(1, len(skeleton)):
        legs[joint] |= legs[skeleton.parents[joint]]
    total = float(skeleton.masses.sum())
    return float(skeleton.masses[~legs].sum()) / total if total > 0.0 else 0.5
