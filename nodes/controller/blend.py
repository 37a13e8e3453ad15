"""How the modules' poses become one: the weighted mean of every parameter over the modules that set it.

Oshita 2013 eq. 13. Orientations average in log space about the pose they all start from.
"""

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel
from bunraku.figure.quat import exp, log, mul, mul_inv

Array = NDArray[np.float64]


@kernel
def blend_point(votes: Array, weights: Array, start: Array, out: Array) -> None:
    """The mean of ``votes`` (M, 3) with ``weights`` (M; 0 abstains); ``start`` (3) where all abstain."""
    total = 0.0
    x, y, z = 0.0, 0.0, 0.0
    for m in range(weights.shape[0]):
        w = weights[m]
        total += w
        x += w * votes[m, 0]
        y += w * votes[m, 1]
        z += w * votes[m, 2]
    if total <= 0.0:
        out[0], out[1], out[2] = start[0], start[1], start[2]
    else:
        out[0], out[1], out[2] = x / total, y / total, z / total


@kernel
def blend_turn(votes: Array, weights: Array, start: Array, out: Array) -> None:
    """The mean of orientations ``votes`` (M, 4), averaged as rotation vectors from ``start`` (4)."""
    q, v, mean = np.empty(4), np.empty(3), np.zeros(3)
    total = 0.0
    for m in range(weights.shape[0]):
        w = weights[m]
        if w > 0.0:
            mul_inv(votes[m], start, q)
            log(q, v)
            total += w
            for k in range(3):
                mean[k] += w * v[k]
    if total > 0.0:
        for k in range(3):
            mean[k] /= total
    exp(mean, q)
    mul(q, start, out)
