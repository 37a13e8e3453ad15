"""Weights of a module's examples for parameters asked for (Oshita 2005 eqs 1-2, after Park 2002 and Rose 1998).

``w(p) = A [p, 1] + B R(p)``: the linear part by least squares, the rest by cubic B-splines about the examples.
Parameters are z-scored first. With the constant term the weights sum to one everywhere and reproduce the parameters
themselves, so whatever is linear in them comes out exactly. Weights may be negative. What is asked beyond the
examples is drawn back to their hull, widened by a tenth of its size: first the posture gives way, toward what
is usual at that speed, then the turn, and the speed last.
"""

from collections.abc import Sequence
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bunraku.figure.jit import kernel
from bunraku.motion.parameters import embed

Array = NDArray[np.float64]

BEYOND = 0.10
"""How far outside of the examples' hull a parameter may lie, as a share of the hull's size that way."""


class WeightTable(NamedTuple):
    """What the kernel needs: n examples in m dimensions, h faces of their hull."""

    center: Array  # (m,)
    scale: Array  # (m,) 1/σ
    points: Array  # (n, m) scaled
    radii: Array  # (n,) 1/α
    linear: Array  # (n, m + 1)
    radial: Array  # (n, n)
    faces: Array  # (h, m + 1) outward normals and offsets, scaled space, 10 % out
    middle: Array  # (m,) of the hull, scaled
    stages: Array  # (s, m, m + 1) affine maps of a place to ever more moderate ones, scaled


@kernel
def bspline(x: float) -> float:
    """The cubic B-spline about 0, support -2..2."""
    x = abs(x)
    if x < 1.0:
        return 2.0 / 3.0 - x * x + 0.5 * x * x * x
    if x < 2.0:
        return (2.0 - x) * (2.0 - x) * (2.0 - x) / 6.0
    return 0.0


@kernel
def excess(faces: Array, p: Array) -> float:
    """How far a place (m) lies outside of the faces (h, m + 1); <= 0 inside."""
    m = p.shape[0]
    worst = -1e300
    for f in range(faces.shape[0]):
        d = faces[f, m]
        for k in range(m):
            d += faces[f, k] * p[k]
        worst = max(worst, d)
    return worst


@kernel
def weights_into(table: WeightTable, place: Array, out: Array) -> float:
    """Weights (n) of the examples at a place (m) of the blending space; returns how far it was drawn back (0..1)."""
    n, m = table.points.shape
    p = np.empty(m)
    for k in range(m):
        p[k] = (place[k] - table.center[k]) * table.scale[k]
    # Drawn back in stages until inside all (widened) faces.
    back = 0.0
    q = np.empty(m)
    for stage in range(table.stages.shape[0] + 1):
        if excess(table.faces, p) <= 0.0:
            break
        last = stage == table.stages.shape[0]
        for k in range(m):
            if last:
                q[k] = table.middle[k]
            else:
                q[k] = table.stages[stage, k, m]
                for j in range(m):
                    q[k] += table.stages[stage, k, j] * p[j]
        keep = 0.0
        if excess(table.faces, q) <= 0.0:
            keep = 1.0
            for f in range(table.faces.shape[0]):
                inside, here = table.faces[f, m], table.faces[f, m]
                for k in range(m):
                    inside += table.faces[f, k] * q[k]
                    here += table.faces[f, k] * p[k]
                if here > 0.0:
                    keep = min(keep, -inside / max(here - inside, 1e-12))
        back = max(back, 1.0 - keep)
        for k in range(m):
            p[k] = q[k] + keep * (p[k] - q[k])
        if keep > 0.0:
            break
    near = np.empty(n)
    for i in range(n):
        d = 0.0
        for k in range(m):
            d += (p[k] - table.points[i, k]) * (p[k] - table.points[i, k])
        near[i] = bspline(sqrt(d) * table.radii[i])
    for i in range(n):
        w = table.linear[i, m]
        for k in range(m):
            w += table.linear[i, k] * p[k]
        for j in range(n):
            w += table.radial[i, j] * near[j]
        out[i] = w
    return back


def weight_table(parameters: Sequence[str], values: ArrayLike, *, beyond: float = BEYOND) -> WeightTable:
    """The table of examples with measured values (n, m); any number of examples from one up, any layout.

    Examples that lie in a line or plane (or are fewer than the parameters) are handled: what they do not span is
    not asked of them.
    """
    place = embed(parameters, np.atleast_2d(np.asarray(values, dtype=np.float64)))
    n = len(place)
    center = place.mean(axis=0)
    spread = place.std(axis=0)
    scale = np.where(spread > 1e-6, 1.0 / np.where(spread > 1e-6, spread, 1.0), 0.0)
    points = (place - center) * scale
    design = np.column_stack([points, np.ones(n)])
    linear = np.linalg.pinv(design, rcond=1e-8).T
    alpha = np.ones(n)
    if n > 1:
        gaps = np.linalg.norm(points[:, None] - points[None], axis=-1)
        np.fill_diagonal(gaps, np.inf)
        # Wide enough to reach the neighbours (Rose 1998: twice the distance to the nearest other example).
        alpha = np.maximum(gaps.min(axis=1), 1e-6)
    gaps = np.linalg.norm(points[:, None] - points[None], axis=-1)
    basis = np.vectorize(bspline, otypes=[float])(gaps / alpha[None, :])
    rest = np.eye(n) - linear @ design.T
    # rest = radial @ basis^T, with basis[i, j] the j-th function at example i
    radial = np.linalg.lstsq(basis, rest.T, rcond=1e-10)[0].T if n > 1 else np.zeros((1, 1))
    faces = _faces(points, beyond)
    neutral = neutral_fit(parameters, place)
    stages = _stages(parameters, neutral, center, scale)
    return WeightTable(center, scale, points, 1.0 / alpha, np.ascontiguousarray(linear),
                       np.ascontiguousarray(radial), faces, points.mean(axis=0), stages)  # fmt: skip


POSTURE = ("tilt", "bend", "duck")
_NEAR = {"tilt": 0.2, "bend": 0.26, "duck": 0.36}


def neutral_fit(parameters: Sequence[str], place: Array) -> Array:
    """(m, m + 1) an affine map of a place to the one with the posture that is usual there.

    Usual is what the examples without a marked posture show, fitted linearly in the other parameters.
    """
    m = place.shape[1]
    out = np.eye(m, m + 1)
    posture = [k for k, name in enumerate(parameters) if name in POSTURE]
    others = [k for k, name in enumerate(parameters) if name not in POSTURE]
    if not posture:
        return out
    limits = np.array([_NEAR[parameters[k]] for k in posture])
    marked = np.max(np.abs(place[:, posture]) / limits, axis=1)
    plain = marked <= 1.0
    if not plain.any():
        plain = marked <= marked.min()
    design = np.column_stack([place[plain][:, others], np.ones(int(plain.sum()))])
    fit = np.linalg.pinv(design, rcond=1e-3) @ place[plain][:, posture]
    for column, k in enumerate(posture):
        out[k] = 0.0
        out[k, others] = fit[:-1, column]
        out[k, m] = fit[-1, column]
        if parameters[k] == "tilt":  # leaning into curves aside, upright
            out[k, m] = 0.0
            out[k, [j for j in others if parameters[j] != "turn"]] = 0.0
    return out


def _stages(parameters: Sequence[str], neutral: Array, center: Array, scale: Array) -> Array:
    """`WeightTable.stages`: the usual posture; then also without turning."""
    m = len(center)
    maps = []
    if any(name in POSTURE for name in parameters):
        maps.append(neutral)
    if "turn" in parameters:
        straight = neutral.copy()
        turn = list(parameters).index("turn")
        straight[:, turn] = 0.0
        maps.append(straight)
    out = np.zeros((len(maps), m, m + 1))
    width = np.where(scale > 0.0, 1.0 / np.where(scale > 0.0, scale, 1.0), 0.0)
    for row, plain in zip(out, maps, strict=True):
        row[:, :m] = scale[:, None] * plain[:, :m] * width[None, :]
        row[:, m] = scale * (plain[:, :m] @ center + plain[:, m] - center)
    return out


def _faces(points: Array, beyond: float) -> Array:
    """(h, m + 1) half-spaces n·p + d <= 0 about the points, moved out by ``beyond`` of the size that way."""
    m = points.shape[1]
    middle = points.mean(axis=0)
    directions = [sign * row for row in np.eye(m) for sign in (1.0, -1.0)]
    _, sizes, axes = np.linalg.svd(points - middle, full_matrices=True)
    rank = int(np.sum(sizes > 1e-6 * max(float(sizes.max(initial=0.0)), 1e-12)))
    span, across = axes[:rank], axes[rank:]
    if rank >= 2 and len(points) > rank + 1:
        from scipy.spatial import ConvexHull, QhullError

        try:
            hull = ConvexHull((points - middle) @ span.T)
            # (The axes stay: where slanting faces meet, moved out they would reach farther along an axis than a tenth.)
            directions += [normal @ span for normal in np.unique(hull.equations[:, :-1].round(9), axis=0)]
        except QhullError:
            pass
    elif rank >= 1:
        directions = [sign * row for row in span for sign in (1.0, -1.0)]
    directions += [sign * row for row in across for sign in (1.0, -1.0)]
    rows = []
    for direction in directions:
        along = points @ direction
        size = float(along.max() - along.min())
        rows.append([*direction, -(float(along.max()) + beyond * size + 1e-9)])
    return np.array(rows)


class Weights:
    """Weights of one module's examples, as its parameters are asked for."""

    def __init__(self, parameters: Sequence[str], values: ArrayLike, *, beyond: float = BEYOND) -> None:
        self.parameters = tuple(parameters)
        self.table = weight_table(parameters, values, beyond=beyond)
        self._neutral = neutral_fit(self.parameters, embed(self.parameters, np.atleast_2d(np.asarray(values, float))))
        self._out = np.empty(len(self.table.points))

    def __call__(self, asked: ArrayLike) -> Array:
        """(n,) weights for parameter values (m,); they sum to one."""
        weights_into(self.table, embed(self.parameters, asked), self._out)
        return self._out.copy()

    def neutral(self, asked: ArrayLike) -> Array:
        """(m,) the parameters with the usual posture in place of tilt, bend and duck."""
        place = np.asarray(asked, dtype=np.float64)
        return np.asarray(self._neutral[:, :-1] @ place + self._neutral[:, -1], dtype=np.float64)

    def within(self, asked: ArrayLike) -> bool:
        """Whether the values (m,) lie within the hull of the examples and its margin."""
        return float(weights_into(self.table, embed(self.parameters, asked), self._out)) == 0.0
