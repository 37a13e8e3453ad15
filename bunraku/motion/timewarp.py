"""Generic time: examples of different timing aligned at their key times, and played at the blended rate.

Between two key times an example's own time is a linear function of generic time u (0..1). The rate of u follows
from the weights: du/dt = 1 / Σ w_i dT_i/du (incremental timewarp, Park 2002), so that changing the weights
in mid-motion never makes time jump.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel

Array = NDArray[np.float64]


def generic_keys(keys: Sequence[Array]) -> Array:
    """(k,) generic times of the key events, 0 to 1: where they are on average in the examples."""
    shares = [(row - row[0]) / (row[-1] - row[0]) for row in keys]
    return np.asarray(np.mean(shares, axis=0), dtype=np.float64)


def own_times(generic: Array, keys: Array, u: Array) -> Array:
    """(n,) seconds in an example's clip at generic times ``u`` (n)."""
    return np.asarray(np.interp(u, generic, keys), dtype=np.float64)


@kernel
def segment_of(generic: Array, u: float) -> int:
    """The segment (0..k-2) of generic time that ``u`` lies in; at a key, the one that begins there."""
    last = generic.shape[0] - 2
    for k in range(last):
        if u < generic[k + 1]:
            return k
    return last  # type: ignore[no-any-return]


@kernel
def seconds_per_unit(generic: Array, spans: Array, weights: Array, segment: int) -> float:
    """dT/du: seconds that a unit of generic time takes in a segment.

    ``spans`` (n, k-1) are the examples' seconds between keys. Negative weights cannot drive it out of the
    range of the examples by more than half.
    """
    total, low, high = 0.0, 1e300, 0.0
    for i in range(weights.shape[0]):
        total += weights[i] * spans[i, segment]
        low = min(low, spans[i, segment])
        high = max(high, spans[i, segment])
    total = min(max(total, 0.5 * low), 1.5 * high)
    return total / max(generic[segment + 1] - generic[segment], 1e-9)  # type: ignore[no-any-return]


@kernel
def advance(generic: Array, spans: Array, weights: Array, u: float, dt: float) -> float:
    """Generic time ``dt`` seconds after ``u``; > 1 when the motion ended on the way.

    What lies beyond 1 is counted at the first segment's rate, as the next cycle has it.
    """
    for _ in range(2 * generic.shape[0]):
        whole = 1.0 if u >= 1.0 else 0.0
        segment = segment_of(generic, u - whole)
        rate = seconds_per_unit(generic, spans, weights, segment)
        room = (generic[segment + 1] + whole - u) * rate
        if dt <= room or u >= 2.0:
            return u + dt / rate
        dt -= room
        u = generic[segment + 1] + whole
    return u


@kernel
def seconds_between(generic: Array, spans: Array, weights: Array, start: float, end: float) -> float:
    """Seconds from generic time ``start`` to ``end`` (start <= end <= start + 1) with these weights."""
    total = 0.0
    u = start
    for _ in range(2 * generic.shape[0] + 2):
        if u >= end - 1e-12:
            break
        whole = 1.0 if u >= 1.0 else 0.0
        segment = segment_of(generic, u - whole)
        to = min(generic[segment + 1] + whole, end)
        total += (to - u) * seconds_per_unit(generic, spans, weights, segment)
        u = to
    return total
