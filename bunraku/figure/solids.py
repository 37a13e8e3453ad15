"""Closed surfaces for the mannequin: lofts along a bone, ellipsoids, and a shell on a loft's front.

Every solid is one closed orientable surface with outward faces and smooth normals.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Vector = Sequence[float] | Array


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed triangle surface; ``shade`` darkens where neighbouring parts keep the light out."""

    positions: Array  # (V, 3) m
    faces: Index  # (F, 3)
    shade: Array  # (V,) 0..1, 1 where nothing is near

    def normals(self) -> Array:
        """(V, 3) unit, the faces' normals weighted by their area."""
        a, b, c = (self.positions[self.faces[:, k]] for k in range(3))
        flat = np.cross(b - a, c - a)
        out = np.zeros_like(self.positions)
        for k in range(3):
            np.add.at(out, self.faces[:, k], flat)
        length = np.linalg.norm(out, axis=1, keepdims=True)
        unit: Array = out / np.maximum(length, 1e-30)
        return unit

    def volume(self) -> float:
        """m³; positive when the faces look outward."""
        a, b, c = (self.positions[self.faces[:, k]] for k in range(3))
        return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


@dataclass(frozen=True)
class Rows:
    """A loft's profile: position along the bone 0..1, half widths and offsets across and to the front."""

    t: Array
    values: Array  # (n, 4): half width across, half width front, offset across, offset front

    @classmethod
    def of(cls, *rows: tuple[float, ...], girth: float = 1.0) -> "Rows":
        """From (t, across, front[, offset across, offset front]) in metres times ``girth``."""
        full = np.array([tuple(row) + (0.0,) * (5 - len(row)) for row in rows])
        return cls(full[:, 0], full[:, 1:] * girth)

    def at(self, t: Array) -> Array:
        """(m, 4) interpolated without overshoot."""
        return monotone(self.t, self.values, t)


def monotone(x: Array, y: Array, at: Array) -> Array:
    """Monotone cubic interpolation of the columns of ``y`` (n, k) over ``x`` (n,), as Fritsch and Butland 1984."""
    h = np.diff(x)[:, None]
    d = np.diff(y, axis=0) / h
    slope = np.zeros_like(y)
    slope[0], slope[-1] = d[0], d[-1]
    if len(x) > 2:
        w1, w2 = 2.0 * h[1:] + h[:-1], h[1:] + 2.0 * h[:-1]
        same = d[1:] * d[:-1] > 0.0
        safe = [np.where(same, part, 1.0) for part in (d[:-1], d[1:])]
        slope[1:-1] = np.where(same, (w1 + w2) / (w1 / safe[0] + w2 / safe[1]), 0.0)
    k = np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(x) - 2)
    step = h[k]
    s = ((at - x[k])[:, None]) / step
    out: Array = (
        (1.0 + 2.0 * s) * (1.0 - s) ** 2 * y[k]
        + s * (1.0 - s) ** 2 * step * slope[k]
        + s * s * (3.0 - 2.0 * s) * y[k + 1]
        + s * s * (s - 1.0) * step * slope[k + 1]
    )
    return out


def frame(axis: Array, across: Vector, front: Vector) -> tuple[Array, Array, Array]:
    """Unit (across, front, axis), square to each other, nearest to what was asked for."""
    w = axis / np.linalg.norm(axis)
    v = np.asarray(front, dtype=float)
    v = v - w * (v @ w)
    if np.linalg.norm(v) < 1e-3:  # a bone along the front: any direction square to it does
        v = np.cross(w, np.asarray(across, dtype=float))
    v = v / np.linalg.norm(v)
    u = np.cross(v, w)
    if u @ np.asarray(across, dtype=float) < 0.0:
        u = -u
    return u, v, w


def rings(count: int, power: float) -> tuple[Array, Array]:
    """A superellipse in ``count`` steps: (cos, sin) raised so that 2 is an ellipse and more is boxier."""
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    c, s = np.cos(angle), np.sin(angle)
    return np.sign(c) * np.abs(c) ** (2.0 / power), np.sign(s) * np.abs(s) ** (2.0 / power)


def loft(
    a: Array,
    b: Array,
    rows: Rows,
    *,
    around: int,
    along: int,
    across: Vector = (1.0, 0.0, 0.0),
    front: Vector = (0.0, 0.0, 1.0),
    power: float = 2.0,
    ends: tuple[float, float] = (0.01, 0.01),
    blunt: tuple[float, float] = (2.6, 2.6),
    dark: tuple[float, float] = (0.0, 0.0),
) -> Solid:
    """A body from ``a`` to ``b`` with the given cross-sections.

    Args:
        around: vertices of a ring. along: rings for each pair of rows.
        ends: m by which the rounded ends stick out beyond the first and the last row.
        blunt: their roundness: 2 is a dome, more is flatter with a rounded rim.
        dark: how much each end is darkened (0..1), fading over 3 cm.
    """
    axis = b - a
    length = float(np.linalg.norm(axis))
    u, v, w = frame(axis, across, front)
    t = np.concatenate([np.linspace(p, q, along, endpoint=False) for p, q in zip(rows.t, rows.t[1:], strict=False)])
    t = np.append(t, rows.t[-1])
    section = rows.at(t)
    caps = max(2, along + 1)
    turn = (np.arange(caps) + 0.5) / caps * (np.pi / 2.0)
    parts: list[tuple[Array, Array]] = []
    rim, out = np.sin(turn) ** (2.0 / blunt[0]), np.cos(turn) ** (2.0 / blunt[0])
    parts.append((t[0] * length - ends[0] * out, section[0] * np.stack([rim, rim, rim**0, rim**0], axis=1)))
    parts.append((t * length, section))
    rim, out = np.sin(turn)[::-1] ** (2.0 / blunt[1]), np.cos(turn)[::-1] ** (2.0 / blunt[1])
    parts.append((t[-1] * length + ends[1] * out, section[-1] * np.stack([rim, rim, rim**0, rim**0], axis=1)))
    height = np.concatenate([part[0] for part in parts])
    size = np.concatenate([part[1] for part in parts])
    c, s = rings(around, power)
    x = size[:, :1] * c + size[:, 2:3]
    y = size[:, 1:2] * s + size[:, 3:4]
    points = a + height[:, None, None] * w + x[..., None] * u + y[..., None] * v
    first = a + (t[0] * length - ends[0]) * w + section[0, 2] * u + section[0, 3] * v
    last = a + (t[-1] * length + ends[1]) * w + section[-1, 2] * u + section[-1, 3] * v
    positions = np.concatenate([points.reshape(-1, 3), first[None], last[None]])
    low, high = t[0] * length - ends[0], t[-1] * length + ends[1]
    level = np.concatenate([np.repeat(height, around), [low, high]])
    shade = 1.0 - dark[0] * np.exp(-(((level - low) / 0.03) ** 2)) - dark[1] * np.exp(-(((high - level) / 0.03) ** 2))
    return outward(positions, tube_faces(len(height), around), shade)


def tube_faces(count: int, around: int) -> Index:
    """Faces of ``count`` rings of ``around`` vertices with a pole at either end (the last two vertices)."""
    i = np.arange(around)
    j = (i + 1) % around
    faces = []
    for ring in range(count - 1):
        p, q, r, s = ring * around + i, ring * around + j, (ring + 1) * around + i, (ring + 1) * around + j
        faces += [np.stack([p, q, s], axis=1), np.stack([p, s, r], axis=1)]
    first, last = count * around, count * around + 1
    top = (count - 1) * around
    faces.append(np.stack([np.full(around, first), j, i], axis=1))
    faces.append(np.stack([np.full(around, last), top + i, top + j], axis=1))
    return np.concatenate(faces)


def ellipsoid(center: Array, radii: Vector | float, *, around: int, along: int) -> Solid:
    """A ball, or an ellipsoid along the world's axes; ``along`` rings between the poles."""
    polar = np.linspace(0.0, np.pi, along + 2)[1:-1]
    angle = np.linspace(0.0, 2.0 * np.pi, around, endpoint=False)
    unit = np.stack(
        [np.outer(np.sin(polar), np.cos(angle)), np.outer(np.cos(polar), np.ones(around)),
         np.outer(np.sin(polar), np.sin(angle))], axis=-1,
    ).reshape(-1, 3)  # fmt: skip
    unit = np.concatenate([unit, [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]])
    positions = center + unit * np.asarray(radii, dtype=float)
    return outward(positions, tube_faces(along, around), np.ones(len(positions)))


def visor(
    a: Array,
    b: Array,
    rows: Rows,
    *,
    span: tuple[float, float],
    reach: float,
    lift: float,
    across_n: int,
    along_n: int,
) -> Solid:
    """A cushion on the front of an upright loft: ``span`` of t, ``reach`` rad to either side, ``lift`` m thick.

    Its rim lies inside the loft, so that its outline is where the two surfaces cut.
    """
    u, v, w = frame(b - a, (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    length = float(np.linalg.norm(b - a))
    side, rise = np.meshgrid(np.linspace(-1.0, 1.0, across_n), np.linspace(-1.0, 1.0, along_n))
    narrow = 1.0 - 0.35 * side**2  # lower towards the temples
    middle, half = (span[0] + span[1]) / 2.0, (span[1] - span[0]) / 2.0
    t = middle + half * rise * narrow
    section = rows.at(t.ravel()).reshape(*t.shape, 4)
    angle = side * reach
    bulge = (1.0 - side**6) * (1.0 - rise**4)

    def surface(raised: Array) -> Array:
        x = (section[..., 0] + raised) * np.sin(angle) + section[..., 2]
        z = (section[..., 1] + raised) * np.cos(angle) + section[..., 3]
        out: Array = a + (t * length)[..., None] * w + x[..., None] * u + z[..., None] * v
        return out

    outer, inner = surface(lift * (1.6 * bulge - 0.6)), surface(np.full_like(t, -2.0 * lift))
    grid = np.arange(t.size).reshape(t.shape)
    p, q, r, s = (g.ravel() for g in (grid[:-1, :-1], grid[:-1, 1:], grid[1:, :-1], grid[1:, 1:]))
    sheet = np.concatenate([np.stack([p, q, s], axis=1), np.stack([p, s, r], axis=1)])
    rim = np.concatenate([grid[0, :-1], grid[:-1, -1], grid[-1, :0:-1], grid[:0:-1, 0]])
    nxt = np.roll(rim, -1)
    wall = np.concatenate([np.stack([rim, rim + t.size, nxt], axis=1),
                           np.stack([nxt, rim + t.size, nxt + t.size], axis=1)])  # fmt: skip
    faces = np.concatenate([sheet, sheet[:, ::-1] + t.size, wall])
    positions = np.concatenate([outer.reshape(-1, 3), inner.reshape(-1, 3)])
    return outward(positions, faces, np.ones(len(positions)))


def outward(positions: Array, faces: Index, shade: Array) -> Solid:
    """A solid whose faces look outward, whichever way they were wound."""
    solid = Solid(positions, faces, shade)
    return solid if solid.volume() > 0.0 else Solid(positions, faces[:, ::-1], shade)
