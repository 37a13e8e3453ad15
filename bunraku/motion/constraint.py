"""Root constraints (Oshita 2005 5.3, 6.3): a path that the figure follows, and ends that motions are pulled to."""

from dataclasses import dataclass
from math import cos, sin
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

SPACING = 0.02  # m between the points of a path
PLACE_WIDTH = 0.14  # m, standard deviation of the smoothing of a path's places; arcs keep their radius
FLOW_WIDTH = 0.10  # m, of its tangent
HEADING_WIDTH = 0.24  # m, of the tangent's angle: how early and long a body turns at a corner
STYLE_WIDTH = 0.20  # m, of speed and posture along it
LONGEST = 2000.0  # m
AHEAD = 40.0  # m of a path that are kept when a figure's state is saved


@dataclass(frozen=True, eq=False)
class Path:
    """A way over the ground, resampled evenly; arc lengths count from the stroke's beginning."""

    start: float  # m, arc length of the first point
    places: Array  # (n, 2) m, x and z, a little smoothed
    headings: Array  # (n,) rad, continuous
    bends: Array  # (n,) rad/m, to the left
    speeds: Array  # (n,) m/s, nan where nothing was asked
    postures: Array  # (n, 3) tilt, bend (rad), duck

    end: float  # m, arc length of the last point

    def _at(self, s: float) -> tuple[int, float]:
        last = len(self.places) - 1
        if last < 1:
            return 0, 0.0
        along = min(max(s, self.start), self.end) - self.start
        first = min(int(along / SPACING), last - 1)
        width = SPACING if first < last - 1 else max(self.end - self.start - SPACING * first, 1e-9)
        return first, min((along - SPACING * first) / width, 1.0)

    def at(self, s: float) -> tuple[float, float, float]:
        """Place (x, z; m) and heading (rad) at arc length ``s``, held at the ends."""
        k, t = self._at(s)
        n = min(k + 1, len(self.places) - 1)
        a, b = self.places[k], self.places[n]
        return (
            float(a[0] + t * (b[0] - a[0])),
            float(a[1] + t * (b[1] - a[1])),
            float(self.headings[k] + t * (self.headings[n] - self.headings[k])),
        )

    def style(self, s: float) -> tuple[float, float, Array]:
        """Bend of the path (rad/m), speed asked for (nan: none) and posture at arc length ``s``."""
        k, t = self._at(s)
        k = k + 1 if t > 0.5 and k + 1 < len(self.places) else k
        return float(self.bends[k]), float(self.speeds[k]), self.postures[k]

    def limits(self, turning: float, brake: float) -> Array:
        """(n,) m/s: how fast it may be gone at each point, turning by ``turning`` (rad/s) at most in its bends and
        slowing down by ``brake`` (m/s²) toward them."""
        squares = (turning / np.maximum(np.abs(self.bends), 1e-6)) ** 2
        room = 2.0 * brake * SPACING * np.arange(len(squares))
        capped = np.minimum.accumulate((squares + room)[::-1])[::-1] - room
        return np.asarray(np.sqrt(capped), dtype=np.float64)

    def point(self, s: float) -> int:
        """Index of the point at or just before arc length ``s``."""
        return self._at(s)[0]

    def nearest(self, x: float, z: float) -> float:
        """Arc length of the place nearest to (x, z)."""
        d = self.places - np.array([x, z])
        return self.start + SPACING * int(np.argmin(np.einsum("ij,ij->i", d, d)))

    def trimmed(self, end: float) -> "Path":
        """Cut off at arc length ``end``."""
        if end >= self.end:
            return self
        count = max(1, int((end - self.start) / SPACING) + 1)
        return Path(self.start, self.places[:count], self.headings[:count], self.bends[:count], self.speeds[:count],
                    self.postures[:count], self.start + SPACING * (count - 1))  # fmt: skip

    def packed(self, s: float) -> list[Any]:
        """The next `AHEAD` metres from just behind ``s``, as plain values."""
        first = max(0, int((s - self.start) / SPACING) - 25)
        last = first + int(AHEAD / SPACING)
        rows = np.column_stack([self.places, self.headings, self.bends, self.speeds, self.postures])[first:last]
        whole = first + len(rows) >= len(self.places)
        end = self.end if whole else self.start + SPACING * (first + len(rows) - 1)
        return [self.start + first * SPACING, end, len(rows), rows.astype("<f4").tobytes()]

    @staticmethod
    def unpacked(saved: list[Any]) -> "Path":
        """The path that `packed` kept."""
        rows = np.frombuffer(saved[3], "<f4").reshape(int(saved[2]), 8).astype(np.float64)
        return Path(float(saved[0]), rows[:, 0:2], rows[:, 2], rows[:, 3], rows[:, 4], rows[:, 5:8], float(saved[1]))


def _smoothed(values: Array, width: float) -> Array:
    """Gaussian of ``width`` (m) along a path (n, k); both ends stay where they are."""
    radius = min(round(3.0 * width / SPACING), len(values) - 1)
    if radius < 1:
        return values
    x = np.arange(-radius, radius + 1) * SPACING
    kernel = np.exp(-0.5 * (x / width) ** 2)
    kernel /= kernel.sum()
    padded = np.concatenate(
        [2.0 * values[0] - values[radius:0:-1], values, 2.0 * values[-1] - values[-2 : -radius - 2 : -1]]
    )
    return np.stack([np.convolve(padded[:, k], kernel, "valid") for k in range(values.shape[1])], -1)


def path_of(
    points: ArrayLike, start: float = 0.0, speeds: ArrayLike | None = None, postures: ArrayLike | None = None,
    heading: float = 0.0,
) -> Path:  # fmt: skip
    """A path through points (n, 2; x and z in m), n >= 1, drawn by a hand: of any spacing, repeated points too.

    Args:
        start: m, arc length at the first point.
        speeds: (n,) m/s asked for, nan for none. postures: (n, 3) tilt, bend (rad), duck.
        heading: rad, of a path too short to have one.
    """
    drawn = np.asarray(points, dtype=np.float64).reshape(-1, 2)
    if len(drawn) == 0:
        raise ValueError("a path needs at least one point")
    wanted = np.full(len(drawn), np.nan) if speeds is None else np.asarray(speeds, dtype=np.float64)
    style = np.zeros((len(drawn), 3)) if postures is None else np.asarray(postures, dtype=np.float64)
    keep = np.append(True, np.hypot(*np.diff(drawn, axis=0).T) > 1e-6)
    drawn, wanted, style = drawn[keep], wanted[keep], style[keep]
    lengths = np.append(0.0, np.cumsum(np.hypot(*np.diff(drawn, axis=0).T)))
    total = min(float(lengths[-1]), LONGEST)
    if total < 2.5 * SPACING:
        return Path(start, drawn[-1:], np.array([heading]), np.zeros(1), wanted[-1:], style[-1:], start)
    # Points keep their places while the path grows: all lie on the grid but the last one.
    at = np.append(np.arange(int(total / SPACING - 1e-9) + 1) * SPACING, total)
    count = len(at)
    raw = np.stack([np.interp(at, lengths, drawn[:, k]) for k in range(2)], -1)
    once = _smoothed(raw, PLACE_WIDTH)
    places = 2.0 * once - _smoothed(once, PLACE_WIDTH)  # what a Gaussian would draw arcs in by is taken back
    # On the even grid; the last point, however near to the one before it, goes on as that one does.
    even = count - 1
    flow = np.gradient(_smoothed(raw, FLOW_WIDTH)[:even], SPACING, axis=0)
    headings = _smoothed(np.unwrap(np.arctan2(flow[:, 0], flow[:, 1]))[:, None], HEADING_WIDTH)[:, 0]
    bends = np.gradient(headings, SPACING)
    headings = np.append(headings, headings[-1] + bends[-1] * (at[-1] - at[-2]))
    bends = np.append(bends, bends[-1])
    pace = np.interp(at, lengths, np.where(np.isfinite(wanted), wanted, 0.0))
    given = np.interp(at, lengths, np.isfinite(wanted).astype(float))
    sums = _smoothed(np.stack([pace, given], -1), STYLE_WIDTH) if given.any() else np.zeros((count, 2))
    asked = np.where(given > 0.5, sums[:, 0] / np.maximum(sums[:, 1], 1e-6), np.nan)
    posture = np.stack([np.interp(at, lengths, style[:, k]) for k in range(3)], -1)
    return Path(start, places, headings, bends, np.maximum(asked, 0.0), _smoothed(posture, STYLE_WIDTH),
                start + total)  # fmt: skip


def smoothstep(t: float) -> float:
    """0 to 1 with rest at both ends, held outside of 0..1."""
    t = min(max(t, 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


def wrapped(angle: float) -> float:
    """The same angle within -pi..pi."""
    return float((angle + np.pi) % (2.0 * np.pi) - np.pi)


@dataclass(frozen=True)
class Ground:
    """A place on the ground and a heading."""

    x: float = 0.0
    z: float = 0.0
    heading: float = 0.0

    def after(self, left: float, ahead: float, turned: float) -> "Ground":
        """Moved in its own frame: left and ahead (m), then turned (rad)."""
        c, s = cos(self.heading), sin(self.heading)
        return Ground(self.x + left * c + ahead * s, self.z - left * s + ahead * c, self.heading + turned)

    def seen(self, x: float, z: float) -> tuple[float, float]:
        """A place (x, z) from here: left and ahead, m."""
        c, s = cos(self.heading), sin(self.heading)
        dx, dz = x - self.x, z - self.z
        return dx * c - dz * s, dx * s + dz * c
