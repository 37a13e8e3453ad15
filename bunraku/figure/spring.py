"""Critically damped springs by half-life: exact for any time step, so the same at 30, 60 and 120 Hz.

A spring of half-life ``h`` has the decay rate ``y = 2 ln 2 / h``; the solution of the critically damped
oscillator over a step is closed, so two steps of dt/2 give what one step of dt gives.
"""

from math import exp

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel

Array = NDArray[np.float64]

LN2 = 0.6931471805599453


@kernel
def decay_rate(half_life: float) -> float:
    """The rate ``y`` (1/s) of a critically damped spring of the given half-life (s)."""
    return 2.0 * LN2 / max(half_life, 1e-5)


@kernel
def spring_decay_into(offset: Array, velocity: Array, half_life: float, dt: float) -> None:
    """Let an offset (n) and its velocity (n) decay to zero over ``dt``, in place."""
    y = decay_rate(half_life)
    e = exp(-y * dt)
    for k in range(offset.shape[0]):
        j = velocity[k] + offset[k] * y
        offset[k] = e * (offset[k] + j * dt)
        velocity[k] = e * (velocity[k] - j * y * dt)


@kernel
def spring_to_into(x: Array, velocity: Array, goal: Array, half_life: float, dt: float) -> None:
    """Move ``x`` (n) with its velocity toward a goal (n) over ``dt``, in place."""
    y = decay_rate(half_life)
    e = exp(-y * dt)
    for k in range(x.shape[0]):
        d = x[k] - goal[k]
        j = velocity[k] + d * y
        x[k] = goal[k] + e * (d + j * dt)
        velocity[k] = e * (velocity[k] - j * y * dt)


@kernel
def lag(half_life: float, dt: float) -> float:
    """The share of the way that a first-order lag of the given half-life goes in ``dt`` (0..1)."""
    return 1.0 - exp(-LN2 * dt / max(half_life, 1e-5))
