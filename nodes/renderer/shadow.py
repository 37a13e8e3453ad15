"""The figures' soft shadow on the ground, from their round cones, on a small grid.

Each cone is laid on the ground along the light; its edge is as soft as it stands high, and what is small and
high fades away. Straight below, what is near the ground keeps the sky's light out.
"""

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.capsules import Capsules

Array = NDArray[np.float64]
Single = NDArray[np.float32]

SOFTNESS = 0.075
"""Half width of the penumbra for each metre of height."""
EDGE = 0.014  # m, its half width on the ground
CONTACT = 0.10  # m, height below which a part darkens the ground straight under it
MARGIN = 1.6  # m around the figures that the grid covers


def chosen(capsules: Capsules) -> NDArray[np.int64]:
    """The cones that cast: not the small balls and the finger tips that lie in a neighbour's shadow."""
    point = np.abs(capsules.starts - capsules.ends).max(axis=1) < 1e-9
    return np.flatnonzero(np.where(point, capsules.radii[:, 0] > 0.05, capsules.radii[:, 0] > 0.018))


class Shadow:
    """Fills a grid of ``cells`` by ``cells`` over the ground."""

    def __init__(self, key: tuple[float, float, float], cells: int = 112) -> None:
        self.cells = cells
        self.slope = np.array([key[0] / key[1], key[2] / key[1]])
        self._index = ((np.arange(cells, dtype=np.float32) + 0.5) / cells - 0.5).astype(np.float32)
        self._light = np.empty((cells, cells), np.float32)

    def window(self, positions: Array) -> tuple[float, float, float]:
        """Centre x, z and width (m) of the grid that holds the figures' joints (N, 3), steady as they move."""
        low, high = positions[:, [0, 2]].min(axis=0), positions[:, [0, 2]].max(axis=0)
        width = max(3.6, 2.0 * MARGIN * np.ceil((float((high - low).max()) + 1.2) / (2.0 * MARGIN)) + 0.4)
        cell = width / self.cells
        middle = np.round(((low + high) / 2.0 - self.slope * 0.45) / cell) * cell
        return float(middle[0]), float(middle[1]), float(width)

    def cast(
        self, starts: Array, ends: Array, radii: Array, center: tuple[float, float], width: float, level: float = 0.0
    ) -> Single:
        """(cells, cells) darkness 0..1, rows along +Z, columns along +X.

        Args:
            starts, ends: (C, 3) m, world. radii: (C, 2) m.
            center, width: m, the grid's place. level: m, height of the ground.
        """
        light = self._light
        light.fill(1.0)
        heights = np.maximum(np.stack([starts[:, 1], ends[:, 1]], axis=1) - level, 0.0)
        for k in range(len(starts)):
            a, b = starts[k, [0, 2]] - center, ends[k, [0, 2]] - center
            ra, rb = radii[k]
            ha, hb = heights[k]
            self._one(light, width, a - self.slope * ha, b - self.slope * hb, ra, rb, ha, hb, EDGE, SOFTNESS, 0.9)
            gap = min(ha - ra, hb - rb)
            if gap < CONTACT:
                self._one(
                    light,
                    width,
                    a,
                    b,
                    ra * 1.25,
                    rb * 1.25,
                    0.35,
                    0.35,
                    0.03,
                    0.0,
                    0.55 * (1.0 - max(gap, 0.0) / CONTACT),
                )
        return np.subtract(1.0, light, out=light)

    def _one(
        self, light: Single, width: float, a: Array, b: Array, ra: float, rb: float, ha: float, hb: float,
        edge: float, softness: float, strength: float,
    ) -> None:  # fmt: skip
        reach = max(ra, rb) + edge + softness * max(ha, hb)
        low = (np.minimum(a, b) - reach) / width + 0.5
        high = (np.maximum(a, b) + reach) / width + 0.5
        i0, j0 = max(int(low[0] * self.cells), 0), max(int(low[1] * self.cells), 0)
        i1, j1 = min(int(high[0] * self.cells) + 2, self.cells), min(int(high[1] * self.cells) + 2, self.cells)
        if i1 <= i0 or j1 <= j0:
            return
        x = self._index[i0:i1] * np.float32(width) - np.float32(a[0])
        z = (self._index[j0:j1] * np.float32(width) - np.float32(a[1]))[:, None]
        dx, dz = np.float32(b[0] - a[0]), np.float32(b[1] - a[1])
        square = dx * dx + dz * dz
        if square > 1e-8:
            t = x * (dx / square) + z * (dz / square)
            np.clip(t, 0.0, 1.0, out=t)
            gap: Single = np.hypot(x - t * dx, z - t * dz)
            soft: Single | np.float32 = np.float32(edge + softness * ha) + t * np.float32(softness * (hb - ha))
            radius: Single | np.float32 = np.float32(ra) + t * np.float32(rb - ra)
        else:
            gap = np.hypot(x, z)
            soft = np.float32(edge + softness * max(ha, hb))
            radius = np.float32(max(ra, rb))
        cover = (radius - gap) / (soft + soft) + np.float32(0.5)
        np.clip(cover, 0.0, 1.0, out=cover)
        cover *= cover * (np.float32(3.0) - cover - cover)
        light[j0:j1, i0:i1] *= 1.0 - cover * np.minimum(radius / soft * np.float32(strength), np.float32(strength))
