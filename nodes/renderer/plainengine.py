"""Pictures without OpenGL: round cones found pixel by pixel in numpy, over the same ground and in the same light.

Slower and plainer than OpenGL, and needs nothing of the system: for machines without it.
"""

from math import tan

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from bunraku.figure.camera import Orbit, axes, to_camera
from bunraku.figure.capsules import Capsules, capsules
from bunraku.msgs import Camera
from bunraku.nodes.renderer.shadow import Shadow, chosen
from bunraku.nodes.renderer.view import LOOK, Look, Pixels, View, projection_matrix

Array = NDArray[np.float64]
Single = NDArray[np.float32]


class PillowEngine:
    """Draws figures on their ground with numpy and Pillow."""

    name = "pillow"

    def __init__(self, look: Look = LOOK, cells: int = 112) -> None:
        self._look = look
        self._shadow = Shadow(look.key, cells)
        self._cones: dict[str, tuple[Capsules, NDArray[np.int64]]] = {}
        self._ground: tuple[tuple[object, ...], Single] | None = None
        self._rays: tuple[tuple[object, ...], Single, Single] | None = None

    def draw(self, view: View, width: int, height: int) -> Pixels:
        """See `Engine.draw`."""
        camera = view.camera
        cones = [self._of(figure.skeleton.hash, view, k) for k, figure in enumerate(view.figures)]
        placed = [c.placed(f.positions_ws, f.rotations_ws) for (c, _), f in zip(cones, view.figures, strict=True)]
        center, span = view.center, 3.6
        if view.figures:
            x, z, span = self._shadow.window(np.concatenate([f.positions_ws for f in view.figures]))
            center = (x, z)
        colour = self._floor(camera, width, height, center).copy()
        if view.figures:
            keep = [k for _, k in cones]
            dark = self._shadow.cast(
                np.concatenate([a[k] for (a, _), k in zip(placed, keep, strict=True)]),
                np.concatenate([b[k] for (_, b), k in zip(placed, keep, strict=True)]),
                np.concatenate([c.radii[k] for c, k in cones]), center, span,
            )  # fmt: skip
            self._darken(colour, dark, camera, center, span)
        cover = np.zeros((height, width), np.float32)
        depth = np.full((height, width), np.float32(np.inf))
        parts = [
            (a[k], b[k], c.radii[k], c.colors[k])
            for (c, _), (a, b) in zip(cones, placed, strict=True)
            for k in range(len(c.joints))
        ]
        parts.sort(key=lambda part: float(min(to_camera(camera, np.stack(part[:2]))[:, 2])))
        for a, b, radii, tint in parts:
            self._cone(colour, cover, depth, camera, a, b, radii, tint)
        out = np.empty((height, width, 4), np.uint8)
        out[..., :3] = np.clip(colour * np.float32(255.0) + np.float32(0.5), 0.0, 255.0)
        out[..., 3] = cover * np.float32(255.0)
        return out

    def close(self) -> None:
        """Nothing is held."""

    def _of(self, key: str, view: View, k: int) -> tuple[Capsules, NDArray[np.int64]]:
        if key not in self._cones:
            cones = capsules(view.figures[k].skeleton)
            self._cones[key] = (cones, chosen(cones))
        return self._cones[key]

    def _looks(self, camera: Camera, width: int, height: int) -> tuple[Single, Single]:
        """Origins (h, w, 3) or (3) and directions (h, w, 3) or (3), unit, of the rays through the pixels."""
        key = (camera.position, camera.rotation, camera.yfov, camera.ortho_height, camera.aspect, width, height)
        if self._rays is not None and self._rays[0] == key:
            return self._rays[1], self._rays[2]
        right, up, back = (axis.astype(np.float32) for axis in axes(camera))
        half = 0.5 * camera.ortho_height if camera.ortho_height is not None else tan(0.5 * (camera.yfov or Orbit.yfov))
        u = ((np.arange(width, dtype=np.float32) + 0.5) / width * 2.0 - 1.0) * np.float32(half * camera.aspect)
        v = (1.0 - (np.arange(height, dtype=np.float32) + 0.5) / height * 2.0) * np.float32(half)
        plane = u[None, :, None] * right + v[:, None, None] * up
        eye = np.array(camera.position, np.float32)
        if camera.ortho_height is not None:
            origin, direction = (eye + plane).astype(np.float32), -back
        else:
            toward = plane - back
            origin = eye
            direction = (toward / np.linalg.norm(toward, axis=-1, keepdims=True)).astype(np.float32)
        self._rays = (key, origin, direction)
        return origin, direction

    def _floor(self, camera: Camera, width: int, height: int, center: tuple[float, float]) -> Single:
        """(h, w, 3) background and ground with its grid, 0..1; kept while the camera rests."""
        place = (round(center[0], 1), round(center[1], 1))
        key = (
            camera.position,
            camera.rotation,
            camera.yfov,
            camera.ortho_height,
            camera.aspect,
            width,
            height,
            place,
        )
        if self._ground is not None and self._ground[0] == key:
            return self._ground[1]
        origin, direction = self._looks(camera, width, height)
        back = np.array(self._look.background, np.float32)
        out = np.empty((height, width, 3), np.float32)
        out[:] = back
        fall = np.broadcast_to(direction[..., 1], (height, width))
        rise = np.broadcast_to(origin[..., 1], (height, width))
        hit = np.where(np.abs(fall) > 1e-4, -rise / np.where(np.abs(fall) > 1e-4, fall, 1.0), -1.0)
        seen = (hit > 0.0) & (hit < 60.0)
        spot: Single = (origin + hit[..., None] * direction)[..., [0, 2]].astype(np.float32)
        wide = np.zeros_like(spot)
        wide[:-1] += np.abs(np.diff(spot, axis=0))
        wide[:, :-1] += np.abs(np.diff(spot, axis=1))
        wide = np.maximum(wide * 1.25, 1e-6).astype(np.float32)
        far = np.hypot(spot[..., 0] - place[0], spot[..., 1] - place[1])
        fade = np.clip(1.0 - (far - 1.8) * 0.13, 0.0, 1.0)
        fade *= fade * (3.0 - 2.0 * fade)
        fine = np.clip((0.11 - wide.max(axis=-1)) / 0.09, 0.0, 1.0)
        fine *= fine * (3.0 - 2.0 * fine)
        grid = _lines(spot, wide) * 0.15 + _lines(spot * 4.0, wide * 4.0) * 0.05 * fine
        sun = back + (np.array(self._look.ground, np.float32) - back) * fade[..., None]
        sun += np.array((0.022, 0.020, 0.016), np.float32) * np.exp(-0.22 * far * far)[..., None]
        out[seen] = (sun * (1.0 - grid * fade)[..., None])[seen]
        self._ground = (key, out)
        return out

    def _darken(self, colour: Single, dark: Single, camera: Camera, center: tuple[float, float], span: float) -> None:
        """Lay the shadow's grid over the picture's ground: a plane seen in perspective is a homography."""
        height, width = colour.shape[:2]
        right, up, back = axes(camera)
        clip = projection_matrix(camera)
        eye = np.array(camera.position)
        # ground (x, z, 1) -> picture (pixels, homogeneous)
        rows = np.stack([right * clip[0, 0], up * clip[1, 1], back])
        ground = np.column_stack([rows[:, 0], rows[:, 2], -rows @ eye])
        w = -ground[2] if camera.ortho_height is None else np.array([0.0, 0.0, 1.0])
        to_picture = np.stack([0.5 * width * (ground[0] + w), 0.5 * height * (w - ground[1]), w])
        cells = dark.shape[0]
        scale = cells / span
        to_grid = np.array(
            [[scale, 0, cells / 2 - scale * center[0]], [0, scale, cells / 2 - scale * center[1]], [0, 0, 1]]
        )
        try:
            back_way = to_grid @ np.linalg.inv(to_picture)
        except np.linalg.LinAlgError:  # the ground is seen edge-on
            return
        if abs(back_way[2, 2]) < 1e-12:
            return
        # the homography's sign tells what lies before the camera
        sign = float(np.sign((back_way @ (to_picture @ np.array([center[0], center[1], 1.0])))[2]))
        grid = Image.fromarray(np.ascontiguousarray(np.pad(dark, 1)[1:-1]))
        shade = np.asarray(grid.transform(
            (width, height), Image.Transform.PERSPECTIVE, (back_way / back_way[2, 2]).ravel()[:8].tolist(),
            Image.Resampling.BILINEAR))  # fmt: skip
        x, y = np.arange(width) + 0.5, (np.arange(height) + 0.5)[:, None]
        ahead = (back_way[2, 0] * x + back_way[2, 1] * y + back_way[2, 2]) * sign > 0.0
        shade = np.where(ahead, shade, 0.0)[..., None] * np.float32(self._look.shadow)
        colour *= (1.0 - shade) * (1.0 - shade * np.array((0.20, 0.16, 0.07), np.float32))

    def _cone(
        self, colour: Single, cover: Single, depth: Single, camera: Camera, a: Array, b: Array, radii: Array,
        tint: Array,
    ) -> None:  # fmt: skip
        """Draw one round cone: each ray meets the ball at the place of the axis that it passes nearest."""
        height, width = depth.shape
        box = _box(camera, a, b, radii, width, height)
        if box is None:
            return
        x0, y0, x1, y1, pixel = box
        origin, direction = self._looks(camera, width, height)
        d = direction[y0:y1, x0:x1] if direction.ndim == 3 else direction
        o = origin[y0:y1, x0:x1] if origin.ndim == 3 else origin
        axis = (b - a).astype(np.float32)
        length = float(axis @ axis)
        away = o - a.astype(np.float32)
        if length > 1e-10:
            # nearest point of the axis to the ray
            da, wa = d @ axis, away @ axis
            dw = np.einsum("...i,...i->...", d, away)
            t = np.clip((wa - da * dw) / np.maximum(length - da * da, 1e-9 * length), 0.0, 1.0)
        else:
            t = np.zeros((y1 - y0, x1 - x0), np.float32)
        middle = t[..., None] * axis
        radius = np.float32(radii[0]) + t * np.float32(radii[1] - radii[0])
        rel = middle - away
        along = np.einsum("...i,...i->...", np.broadcast_to(d, rel.shape), rel)
        gap2 = np.einsum("...i,...i->...", rel, rel) - along * along
        gap = np.sqrt(np.maximum(gap2, 0.0))
        size = pixel * (along if camera.ortho_height is None else 1.0)
        edge = np.clip((radius - gap) / size + 0.5, 0.0, 1.0)
        reach = along - np.sqrt(np.maximum(radius * radius - gap2, 0.0))
        old = depth[y0:y1, x0:x1]
        mine = (edge > 0.0) & (reach > 0.02) & (reach < old)
        if not mine.any():
            return
        normal = reach[..., None] * d - rel
        normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-9)
        level = np.broadcast_to(o, rel.shape)[..., 1] + reach * np.broadcast_to(d, rel.shape)[..., 1]
        lit = self._shade(normal, np.broadcast_to(-d, rel.shape), level, tint)
        weight = np.where(mine, edge, 0.0)[..., None]
        patch = colour[y0:y1, x0:x1]
        patch += (lit - patch) * weight
        cover[y0:y1, x0:x1] = np.maximum(cover[y0:y1, x0:x1], weight[..., 0])
        old[...] = np.where(mine & (edge > 0.5), reach, old)

    def _shade(self, normal: Single, view: Single, level: Single, tint: Array) -> Single:
        """The same light as the OpenGL shader's: hemisphere, wrapped key, gloss, rim, contact."""
        key = np.array(self._look.key, np.float32)
        up = normal[..., 1:2] * 0.5 + 0.5
        lit = np.maximum(normal @ key * 0.78 + 0.22, 0.0)[..., None]
        lit = lit * (lit * 0.45 + 0.55)
        low, high = np.array((0.27, 0.245, 0.235), np.float32), np.array((0.42, 0.46, 0.54), np.float32)
        side = np.array((-key[2], 0.25, key[0]), np.float32)
        fill = np.maximum(normal @ (side / np.linalg.norm(side)), 0.0)[..., None]
        contact = np.clip(level * 2.2 + 0.48, 0.0, 1.0)[..., None]
        between = key + view
        between = between / np.linalg.norm(between, axis=-1, keepdims=True)
        shine = np.maximum(np.einsum("...i,...i->...", normal, between), 0.0)[..., None]
        edge = 1.0 - np.maximum(np.einsum("...i,...i->...", normal, view), 0.0)[..., None]
        albedo = np.array(tint, np.float32) ** 2
        light = albedo * (
            (low + (high - low) * up) * contact + np.array((0.10, 0.11, 0.13), np.float32) * fill
            + np.array((1.12, 1.04, 0.93), np.float32) * lit
        )  # fmt: skip
        light += (shine**48 * 0.17 + shine**10 * 0.05) * lit
        light += np.array((0.20, 0.23, 0.28), np.float32) * edge**3 * up
        out: Single = np.sqrt(light * (1.0 + 0.06 * light) / (1.0 + 0.20 * light))
        return out


def _lines(place: Single, width: Single) -> Single:
    near = np.abs((place - 0.5) % 1.0 - 0.5) / width
    out: Single = 1.0 - np.minimum(near.min(axis=-1), 1.0)
    return out


def _box(
    camera: Camera, a: Array, b: Array, radii: Array, width: int, height: int
) -> tuple[int, int, int, int, np.float32] | None:
    """Pixels that a round cone can touch, and the width of a pixel (m at 1 m); None when it is not in the picture."""
    local = to_camera(camera, np.stack([a, b]))
    half = 0.5 * camera.ortho_height if camera.ortho_height is not None else tan(0.5 * (camera.yfov or Orbit.yfov))
    pixel = np.float32(2.0 * half / height)
    depth = -local[:, 2]
    if camera.ortho_height is not None:
        if (depth + radii < 0.0).all():
            return None
        scale = np.full(2, height / (2.0 * half))
    else:
        if (depth - radii < 0.05).any():
            if (depth + radii < 0.05).all():
                return None
            return 0, 0, width, height, pixel
        scale = height / (2.0 * half * (depth - radii))
    x = 0.5 * width + local[:, 0] * scale
    y = 0.5 * height - local[:, 1] * scale
    far = 0.5 * width + local[:, 0] * height / (2.0 * half * (depth + radii)) if camera.ortho_height is None else x
    low = 0.5 * height - local[:, 1] * height / (2.0 * half * (depth + radii)) if camera.ortho_height is None else y
    r = radii * scale * 1.1 + 2.0
    x0, x1 = int(np.minimum(x, far).min() - r.max()), int(np.maximum(x, far).max() + r.max()) + 1
    y0, y1 = int(np.minimum(y, low).min() - r.max()), int(np.maximum(y, low).max() + r.max()) + 1
    x0, y0, x1, y1 = max(x0, 0), max(y0, 0), min(x1, width), min(y1, height)
    return (x0, y0, x1, y1, pixel) if x1 > x0 and y1 > y0 else None
