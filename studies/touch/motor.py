"""The motor model that all simulated users share: how long a movement takes and where it ends.

A movement over distance D to a target of width W takes a + b log2(D / W + 1) (Fitts 1954 in the form of MacKenzie
1992); every decision takes a mental act M (Card, Moran and Newell 1983). Distances are picture heights.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Motor:
    """Constants of one kind of user; the study's sensitivity changes them."""

    think: float = 1.2  # s, a decision (M, Card et al. 1.2-1.35 s)
    glance: float = 0.25  # s to see what is left after a movement
    reach_a: float = 0.10  # s
    reach_b: float = 0.15  # s/bit, finger or pointer to a part
    drag_a: float = 0.15  # s
    drag_b: float = 0.20  # s/bit, while something is held: slower (MacKenzie, Sellen, Buxton 1991)
    switch: float = 0.40  # s between two devices or modes (H): a key, a tool
    noise: float = 0.05  # standard deviation of an end point, share of the way
    tremor: float = 0.004  # and at least this, picture heights
    width: float = 0.03  # picture heights: how near the user tries to come
    hidden: float = 0.012  # picture heights: a touching finger hides its end point; 0 for a pointer

    def reach(self, distance: float, width: float) -> float:
        """s to come from ``distance`` to a thing of ``width`` (picture heights)."""
        return self.reach_a + self.reach_b * float(np.log2(distance / max(width, 1e-3) + 1.0))

    def drag(self, distance: float) -> float:
        """s to drag over ``distance`` (picture heights)."""
        return self.drag_a + self.drag_b * float(np.log2(distance / self.width + 1.0))

    def land(self, rng: np.random.Generator, way: Array) -> Array:
        """Where a movement by ``way`` (2, picture heights) ends, from its start."""
        length = float(np.linalg.norm(way))
        spread = self.noise * length + self.tremor + self.hidden * 0.25
        landed: Array = way + rng.normal(0.0, spread, 2)
        return landed

    def decide(self, rng: np.random.Generator) -> float:
        """s of one decision, with the spread of people (log-normal, 25 %)."""
        return self.think * float(np.exp(rng.normal(0.0, 0.25)))


def minimum_jerk(share: float) -> float:
    """The share of the way at a share of the time of a smooth movement (Flash and Hogan 1985)."""
    s = min(1.0, max(0.0, share))
    return s * s * s * (10.0 + s * (6.0 * s - 15.0))


FINGER = Motor()
POINTER = Motor(hidden=0.0)
