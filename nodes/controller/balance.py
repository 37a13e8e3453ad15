"""Balance: the centre of mass stays over the soles (Oshita 2013 section 6.2, eqs 16-18)."""

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel
from bunraku.figure.quat import between, mul, rotate
from bunraku.figure.rig import Rig
from bunraku.figure.support import closest_in_hull, convex_hull_into

Array = NDArray[np.float64]


@kernel
def sole_polygon(rig: Rig, points: Array, feet: Array, support: Array, hull: Array) -> int:
    """The support polygon (corners (x, z) in ``hull``) of both soles; returns its size, 0 for no support.

    A foot with a support between 0 and 1 is on its way in or out: its sole's corners lie that share of the
    way from the other sole, so that the polygon never changes by a jump.
    """
    corners, v = np.empty((8, 2)), np.empty(3)
    middle = np.zeros((2, 2))
    for side in range(2):
        for n in range(4):
            rotate(feet[side], rig.soles[side, n], v)
            corners[4 * side + n, 0] = points[3 + side, 0] + v[0]
            corners[4 * side + n, 1] = points[3 + side, 2] + v[2]
            middle[side, 0] += 0.25 * corners[4 * side + n, 0]
            middle[side, 1] += 0.25 * corners[4 * side + n, 1]
    most = max(support[0], support[1])
    if most < 1e-3:
        return 0
    for side in range(2):
        share = support[side] / most
        for n in range(4):
            for k in range(2):
                at = corners[4 * side + n, k]
                corners[4 * side + n, k] = middle[1 - side, k] + share * (at - middle[1 - side, k])
    return convex_hull_into(corners, 8, hull)


@kernel
def balance_shift(hull: Array, size: int, center: Array, margin: float, out: Array) -> None:
    """The horizontal way (3, m) of the centre of mass back over the support (eq. 16); zero inside."""
    at = np.empty(2)
    closest_in_hull(hull, size, center[0], center[2], margin, at)
    out[0], out[1], out[2] = at[0] - center[0], 0.0, at[1] - center[2]


@kernel
def pelvis_correction(shift: Array, share: float, mass_share: float, out: Array) -> None:
    """The pelvis's movement (3, m) for its share of the correction (eq. 17)."""
    for k in range(3):
        out[k] = share * shift[k] / mass_share


@kernel
def trunk_correction(
    shift: Array, share: float, mass_share: float, chest: Array, back: Array, turn: Array, out: Array
) -> None:
    """The trunk's orientation (4) for its share of the correction (eq. 18)."""
    lever, to, q = np.empty(3), np.empty(3), np.empty(4)
    for k in range(3):
        lever[k] = chest[k] - back[k]
        to[k] = lever[k] + share * shift[k] / mass_share
    between(lever, to, q)
    mul(q, turn, out)
