"""Overlays drawn antialiased into a finished picture.

Lengths are metres in the world, shares of the picture's height on the screen, and of the panel's height in a
panel. What lies on the ground (all points lower than 3 cm) goes under the figure, by the picture's own record of
how much of each pixel is figure. A stick ``figure`` has one point a joint, in the skeleton's order.
"""

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from math import ceil, floor

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from bunraku.figure.camera import metres_per_height, to_camera
from bunraku.msgs import Camera, Primitive
from bunraku.nodes.renderer.view import Layer, Pixels, projection_matrix

Array = NDArray[np.float64]

GROUND = 0.03  # m, height below which a thing lies on the ground
LABEL = 0.026  # of the picture's height
RING = 0.0045  # of the picture's height, thickness of a circle's rim
FILL = 0.24
"""Share of its colour's opacity with which a circle is filled."""
BAR = 0.030  # m, or share of the panel's height
PANEL = (0.015, 0.68, 0.30, 0.30)
"""Left, top, width and height of the first panel, in shares of the picture; others follow to its right."""
CARD = (1.0, 1.0, 1.0, 0.62)
SMOOTH = 4
NEAR = 0.05  # m


class Canvas:
    """A picture, the camera that it was taken with, and the shapes drawn into it."""

    def __init__(self, pixels: Pixels, camera: Camera) -> None:
        self.pixels, self.camera = pixels, camera
        self.height, self.width = pixels.shape[:2]
        self.clip = projection_matrix(camera)

    def project(self, points_ws: Array) -> Array:
        """(n, 2) pixels of world points (n, 3), all before the camera."""
        return self._flat(to_camera(self.camera, points_ws))

    def before(self, points_ws: Array, closed: bool) -> list[Array]:
        """Runs of pixels (m, 2) of a path, cut where it passes behind the camera."""
        local = to_camera(self.camera, points_ws)
        if closed:
            kept = _cut_polygon(local)
            return [self._flat(kept)] if len(kept) > 2 else []
        return [self._flat(run) for run in _cut_path(local)]

    def _flat(self, local: Array) -> Array:
        x = local[:, 0] * self.clip[0, 0]
        y = local[:, 1] * self.clip[1, 1]
        if self.camera.ortho_height is None:
            depth = np.maximum(-local[:, 2], 1e-6)
            x, y = x / depth, y / depth
        return np.stack([(0.5 + 0.5 * x) * self.width, (0.5 - 0.5 * y) * self.height], axis=1)

    def scale(self, point_ws: Array) -> float:
        """Pixels a metre at a world point (3); 0 behind the camera."""
        span = metres_per_height(self.camera, point_ws)
        return self.height / span if span > 1e-6 else 0.0

    def shapes(self, shapes: Sequence[tuple[Array, float]], color: Sequence[float], under: bool = False) -> None:
        """Fill polygons (n, 2 pixels), each with its share of the colour's opacity, the later over the earlier."""
        shapes = [(points, share) for points, share in shapes if len(points) > 2 and np.isfinite(points).all()]
        if not shapes:
            return
        every = np.concatenate([points for points, _ in shapes])
        x0, y0 = max(floor(every[:, 0].min()) - 1, 0), max(floor(every[:, 1].min()) - 1, 0)
        x1, y1 = min(ceil(every[:, 0].max()) + 1, self.width), min(ceil(every[:, 1].max()) + 1, self.height)
        if x1 <= x0 or y1 <= y0:
            return
        smooth = SMOOTH if (x1 - x0) * (y1 - y0) < 200_000 else 2
        mask = Image.new("L", ((x1 - x0) * smooth, (y1 - y0) * smooth))
        draw = ImageDraw.Draw(mask)
        for points, share in shapes:
            # far corners would overflow the rasteriser; nobody sees the difference
            corners = np.clip((points - (x0, y0)) * smooth - 0.5, -1e5, 1e5)
            draw.polygon(corners.ravel().tolist(), fill=round(255 * share))
        self.blend(np.asarray(mask.reduce(smooth)), x0, y0, color, under)

    def blend(self, mask: Pixels, x: int, y: int, color: Sequence[float], under: bool = False) -> None:
        """Mix a colour into the picture where a mask (h, w) lies with its corner at (x, y)."""
        left, top = max(x, 0), max(y, 0)
        right, bottom = min(x + mask.shape[1], self.width), min(y + mask.shape[0], self.height)
        if right <= left or bottom <= top:
            return
        patch = self.pixels[top:bottom, left:right]
        share = mask[top - y : bottom - y, left - x : right - x].astype(np.float32) * np.float32(color[3] / 255.0)
        if under:
            share *= (255 - patch[..., 3]).astype(np.float32) / np.float32(255.0)
        ink = np.array(color[:3], np.float32) * np.float32(255.0)
        old = patch[..., :3].astype(np.float32)
        patch[..., :3] = old + (ink - old) * share[..., None] + np.float32(0.5)

    def text(self, text: str, x: float, y: float, height: float, color: Sequence[float], middle: bool = False) -> None:
        """A line whose base line begins at (x, y) pixels (or is centred there), with a light halo."""
        if not (np.isfinite(x) and np.isfinite(y)) or abs(x) > 4 * self.width or abs(y) > 4 * self.height:
            return
        size = round(min(max(height, 6.0), 0.25 * self.height))
        letters, halo, rise = _letters(text[: 2 + 6 * self.width // size], size)
        left = round(x - (letters.shape[1] / 2 if middle else 0.0))
        top = round(y) - rise
        self.blend(halo, left, top, (1.0, 1.0, 1.0, 0.55 * color[3]))
        dark = [0.55 * c for c in color[:3]]
        self.blend(letters, left, top, (*dark, min(1.0, 0.25 + color[3])))


def draw(pixels: Pixels, camera: Camera, layers: Sequence[Layer]) -> None:
    """Draw layers into ``pixels`` (h, w, 4), in place."""
    canvas = Canvas(pixels, camera)
    for space in ("world", "screen"):
        for layer in layers:
            for one in layer.primitives:
                if one.space == space:
                    _primitive(canvas, one, layer.parents, PANEL)
    panels = 0
    for layer in layers:
        box = (PANEL[0] + panels * (PANEL[2] + 0.01), *PANEL[1:])
        inside = [one for one in layer.primitives if one.space == "panel"]
        if inside:
            panels += 1
            canvas.shapes([(_rounded(canvas, box), 1.0)], CARD)
        for one in inside:
            _primitive(canvas, one, layer.parents, box)


def _primitive(canvas: Canvas, one: Primitive, parents: Sequence[int], box: tuple[float, ...]) -> None:
    size = 3 if one.space == "world" else 2
    rows = [point for point in one.points if len(point) == size]
    if not rows:
        return
    points = np.array(rows, dtype=np.float64)
    if one.space == "world":
        _in_world(canvas, one, points, parents)
    else:
        if one.space == "panel":
            points = points * (box[2], box[3]) + (box[0], box[1])
        unit = canvas.height * (box[3] if one.space == "panel" else 1.0)
        _on_screen(canvas, one, points * (canvas.width, canvas.height), unit, parents)


def _on_screen(canvas: Canvas, one: Primitive, points: Array, unit: float, parents: Sequence[int]) -> None:
    color, width = one.color, max(one.size * unit, 1.2)
    rim = max(RING * canvas.height, 1.5)
    if one.kind == "circle":
        radius = one.size * unit
        for point in points:
            glow = [(_circle(point, radius + k * rim), 0.05 * (4 - k)) for k in (3, 2)]
            canvas.shapes(glow, color)
            canvas.shapes([(_circle(point, radius), 1.0), (_circle(point, max(radius - rim, 0.0)), FILL)], color)
    elif one.kind == "points":
        canvas.shapes([(_circle(point, max(width / 2.0, 1.0)), 1.0) for point in points], color)
    elif one.kind == "line":
        canvas.shapes(_ribbon(points, np.full(len(points), width)), color)
    elif one.kind == "polygon":
        canvas.shapes([(points, 1.0)], color)
    elif one.kind == "figure":
        canvas.shapes(_sticks(points, np.full(len(points), width), parents), color)
    elif one.kind == "bar" and len(points) > 1:
        _bar(canvas, points[0], points[1], min(one.size, 1.0), np.full(2, max(BAR * unit, 3.0)), color)
    if one.label:
        height = max((one.size if one.kind == "text" else LABEL) * (unit if one.kind == "text" else canvas.height), 8.0)
        lift = one.size * unit + rim if one.kind == "circle" else 0.0
        canvas.text(one.label, points[0, 0] + lift, points[0, 1] - lift, height, color)


def _in_world(canvas: Canvas, one: Primitive, points: Array, parents: Sequence[int]) -> None:
    color, under = one.color, bool((points[:, 1] < GROUND).all())
    scales = np.array([canvas.scale(point) for point in points])
    seen = scales > 0.0
    if one.kind == "circle":
        for point, scale in zip(points[seen], scales[seen], strict=True):
            rim = max(RING * canvas.height / scale, 0.006)
            outer = canvas.before(_ring(point, one.size), closed=True)
            inner = canvas.before(_ring(point, max(one.size - rim, 0.0)), closed=True) if one.size > rim else []
            canvas.shapes([*((p, 1.0) for p in outer), *((p, FILL) for p in inner)], color, under)
    elif one.kind == "points":
        dots = canvas.project(points[seen])
        sizes = np.maximum(one.size * scales[seen] / 2.0, 1.0)
        canvas.shapes([(_circle(p, r), 1.0) for p, r in zip(dots, sizes, strict=True)], color, under)
    elif one.kind == "line":
        _world_line(canvas, points, one.size, color, under)
    elif one.kind == "polygon":
        for shape in canvas.before(points, closed=True):
            canvas.shapes([(shape, 1.0)], color, under)
        _world_line(canvas, np.vstack([points, points[:1]]), one.size, (*color[:3], min(1.0, 1.6 * color[3])), under)
    elif one.kind == "figure" and seen.all():
        widths = np.maximum(one.size * scales, 1.5)
        canvas.shapes(_sticks(canvas.project(points), widths, parents), color)
    elif one.kind == "bar" and seen.all() and len(points) > 1:
        ends = canvas.project(points[:2])
        _bar(canvas, ends[0], ends[1], min(one.size, 1.0), np.maximum(BAR * scales[:2], 3.0), color)
    if one.label and seen[0]:
        at = canvas.project(points[:1])[0]
        height = one.size * scales[0] if one.kind == "text" else LABEL * canvas.height
        canvas.text(one.label, at[0] + 0.006 * canvas.height, at[1] - 0.006 * canvas.height, max(height, 8.0), color)


def _world_line(canvas: Canvas, points: Array, width: float, color: Sequence[float], under: bool) -> None:
    local = to_camera(canvas.camera, points)
    for run in _cut_path(local):
        flat = canvas._flat(run)
        if canvas.camera.ortho_height is not None:
            widths = np.full(len(run), width * canvas.height / canvas.camera.ortho_height)
        else:
            widths = width * 0.5 * canvas.clip[1, 1] * canvas.height / -run[:, 2]
        canvas.shapes(_ribbon(flat, np.maximum(widths, 1.2)), color, under)


def _bar(canvas: Canvas, a: Array, b: Array, share: float, widths: Array, color: Sequence[float]) -> None:
    canvas.shapes(_ribbon(np.stack([a, b]), widths), (*color[:3], 0.25 * color[3]))
    if share > 0.0:
        canvas.shapes(_ribbon(np.stack([a, a + share * (b - a)]), widths), color)


def _circle(center: Array, radius: float) -> Array:
    count = int(np.clip(radius * 2.0, 12, 72))
    turn = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    return np.stack([center[0] + radius * np.cos(turn), center[1] + radius * np.sin(turn)], axis=1)


def _ring(center: Array, radius: float) -> Array:
    """A level circle in the world."""
    turn = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
    return center + radius * np.stack([np.cos(turn), np.zeros(64), np.sin(turn)], axis=1)


def _ribbon(points: Array, widths: Array) -> list[tuple[Array, float]]:
    """A path of changing width: a quadrilateral a segment and a disc a corner."""
    shapes = [(_circle(p, w / 2.0), 1.0) for p, w in zip(points, widths, strict=True)]
    for (a, wa), (b, wb) in pairwise(zip(points, widths, strict=True)):
        along = b - a
        length = float(np.hypot(*along))
        if length > 1e-6:
            side = np.array([-along[1], along[0]]) / (2.0 * length)
            shapes.append((np.array([a + side * wa, b + side * wb, b - side * wb, a - side * wa]), 1.0))
    return shapes


def _sticks(points: Array, widths: Array, parents: Sequence[int]) -> list[tuple[Array, float]]:
    shapes = [(_circle(p, 0.75 * w), 1.0) for p, w in zip(points, widths, strict=True)]
    for joint, parent in enumerate(parents[: len(points)]):
        if 0 <= parent < len(points):
            shapes += _ribbon(points[[parent, joint]], widths[[parent, joint]])
    return shapes


def _rounded(canvas: Canvas, box: Sequence[float]) -> Array:
    x, y, w, h = box[0] * canvas.width, box[1] * canvas.height, box[2] * canvas.width, box[3] * canvas.height
    r = 0.012 * canvas.height
    turn = np.linspace(0.0, np.pi / 2.0, 7)
    corners = [(x + w - r, y + h - r, 0.0), (x + r, y + h - r, 0.5), (x + r, y + r, 1.0), (x + w - r, y + r, 1.5)]
    arcs = [
        np.stack([cx + r * np.cos(turn + q * np.pi), cy + r * np.sin(turn + q * np.pi)], axis=1)
        for cx, cy, q in corners
    ]
    return np.concatenate(arcs)


def _cut_path(local: Array) -> list[Array]:
    """Pieces of a path (n, 3) in the camera's frame that lie before it."""
    runs: list[list[Array]] = [[]]
    for k, point in enumerate(local):
        if k and (local[k - 1][2] < -NEAR) != (point[2] < -NEAR):
            runs[-1].append(_crossing(local[k - 1], point))
            if point[2] >= -NEAR:
                runs.append([])
        if point[2] < -NEAR:
            runs[-1].append(point)
    return [np.array(run) for run in runs if len(run) > 1]


def _cut_polygon(local: Array) -> Array:
    """What of a polygon (n, 3) in the camera's frame lies before it."""
    kept: list[Array] = []
    for k, point in enumerate(local):
        last = local[k - 1]
        if (last[2] < -NEAR) != (point[2] < -NEAR):
            kept.append(_crossing(last, point))
        if point[2] < -NEAR:
            kept.append(point)
    return np.array(kept).reshape(-1, 3)


def _crossing(a: Array, b: Array) -> Array:
    t = (-NEAR - a[2]) / (b[2] - a[2])
    out: Array = a + t * (b - a)
    out[2] = -NEAR
    return out


@lru_cache(maxsize=64)
def _font(size: int) -> "ImageFont.ImageFont | ImageFont.FreeTypeFont":
    return ImageFont.load_default(size)


@lru_cache(maxsize=96)
def _letters(text: str, size: int) -> tuple[Pixels, Pixels, int]:
    """Masks of a line and of its halo, and the rows above its base line."""
    font = _font(size)
    edge = max(1, size // 9)
    left, _, right, bottom = font.getbbox(text)
    rise = round(0.95 * size)
    shape = (max(1, ceil(right - min(left, 0))) + 2 * edge + 2, max(ceil(bottom), round(1.3 * size)) + 2 * edge)
    masks = []
    for stroke in (0, edge):
        mask = Image.new("L", shape)
        ImageDraw.Draw(mask).text((edge, edge), text, fill=255, font=font, stroke_width=stroke)
        masks.append(np.asarray(mask))
    return masks[0], masks[1], rise + edge
