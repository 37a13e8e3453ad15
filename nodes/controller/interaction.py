"""Inter-body interaction: parts that are moved take their neighbours along a little (section 6.3, eqs 19-22).

The time step cancels: what counts is how far a part has moved since the last step.
"""

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel
from bunraku.figure.quat import between, mul, mul_inv, rotate

Array = NDArray[np.float64]


@kernel
def trunk_from_ends(moved: Array, chest: Array, back: Array, influence: float, turn: Array, out: Array) -> None:
    """The trunk (4) when driven ends have moved by ``moved`` (3, m, summed): eqs 19-20."""
    lever, to, q = np.empty(3), np.empty(3), np.empty(4)
    for k in range(3):
        lever[k] = chest[k] - back[k]
        to[k] = lever[k] + influence * moved[k]
    between(lever, to, q)
    mul(q, turn, out)


@kernel
def end_from_trunk(
    end: Array, back: Array, turn_before: Array, turn: Array, pelvis_moved: Array, influence: float, out: Array
) -> None:
    """A free end (3) when the trunk has turned about the back joint and the pelvis moved: eqs 21-22."""
    q, arm, v = np.empty(4), np.empty(3), np.empty(3)
    mul_inv(turn, turn_before, q)
    for k in range(3):
        arm[k] = end[k] - back[k]
    rotate(q, arm, v)
    for k in range(3):
        out[k] = end[k] + influence * (v[k] - arm[k] + pelvis_moved[k])
