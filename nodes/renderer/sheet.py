"""Still pictures of a motion: single ones, contact sheets and strips."""

from math import ceil
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from bunraku.figure.camera import look_at
from bunraku.figure.fk import fk
from bunraku.figure.skeleton import Skeleton
from bunraku.nodes.renderer.view import Engine, Figure, Pixels, View

Array = NDArray[np.float64]
GAP = 6  # pixels between a sheet's pictures
SECOND = 1_000_000_000


def save_picture(pixels: Pixels, path: str | Path) -> None:
    """Write a picture (h, w, 4) as PNG or whatever the name's ending says."""
    target = Path(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.ascontiguousarray(pixels[..., :3])).save(target)


class Sheet:
    """Keeps small copies of a film's frames, evenly spread over however long it gets, in bounded memory."""

    def __init__(self, count: int = 24, columns: int = 6, width: int = 320) -> None:
        self.count, self.columns, self.width = count, columns, width
        self.kept: list[tuple[float, Image.Image]] = []
        self._every, self._seen = 1, 0

    @property
    def wants(self) -> bool:
        """Whether the next frame would be kept."""
        return self._seen % self._every == 0

    def add(self, seconds: float, pixels: Pixels) -> None:
        """See one frame, taken ``seconds`` after the beginning."""
        if self.wants:
            height = max(1, round(self.width * pixels.shape[0] / pixels.shape[1]))
            small = Image.fromarray(np.ascontiguousarray(pixels[..., :3]))
            self.kept.append((seconds, small.resize((self.width, height), Image.Resampling.BOX)))
            if len(self.kept) >= 4 * self.count:
                self.kept = self.kept[::2]
                self._every *= 2
        self._seen += 1

    def skip(self) -> None:
        """A frame that is not kept went by."""
        self._seen += 1

    def picture(self) -> Image.Image | None:
        """The sheet; None when nothing was seen."""
        if not self.kept:
            return None
        count = min(self.count, len(self.kept))
        chosen = [self.kept[round(k)] for k in np.linspace(0, len(self.kept) - 1, count)]
        columns = min(self.columns, count)
        width, height = chosen[0][1].size
        sheet = Image.new(
            "RGB", (columns * (width + GAP) + GAP, ceil(count / columns) * (height + GAP) + GAP), (246, 247, 249)
        )
        draw = ImageDraw.Draw(sheet)
        font = ImageFont.load_default(max(10, height // 13))
        for k, (seconds, small) in enumerate(chosen):
            x, y = GAP + (k % columns) * (width + GAP), GAP + (k // columns) * (height + GAP)
            sheet.paste(small, (x, y))
            draw.text((x + 6, y + 4), f"{seconds:.1f} s", fill=(70, 78, 92), font=font)
        return sheet

    def save(self, path: str | Path) -> bool:
        """Write the sheet; False when there was nothing to write."""
        sheet = self.picture()
        if sheet is None:
            return False
        target = Path(path)
        target.parent.mkdir(parents=True, exist_ok=True)
        sheet.save(target)
        return True


def strip(
    engine: Engine,
    skeleton: Skeleton,
    roots: Array,
    rotations: Array,
    *,
    width: int = 1600,
    height: int = 520,
    spacing: float | None = None,
    azimuth: float = 0.12,
) -> Pixels:
    """Several moments of one motion in one picture, from left to right.

    Args:
        roots: (n, 3) m. rotations: (n, J, 4) xyzw, local.
        spacing: m between the figures; None leaves each where it stands and looks along the path's side.
        azimuth: rad, how far the camera stands to the path's side from square to it.

    Returns:
        (height, width, 4); valid until the engine draws again.
    """
    places = np.array(roots, dtype=np.float64)
    if len(places) == 0:
        raise ValueError("a strip needs a pose")
    if spacing is not None:
        side = (np.arange(len(places)) - (len(places) - 1) / 2.0) * spacing
        places[:, 0], places[:, 2] = side, 0.0
    way = (places[-1] - places[0]) * [1.0, 0.0, 1.0]
    length = float(np.linalg.norm(way))
    way = way / length if length > 1e-3 else np.array([1.0, 0.0, 0.0])
    figures = tuple(
        Figure(skeleton, *fk(skeleton, place, turn)) for place, turn in zip(places, np.asarray(rotations), strict=True)
    )
    points = np.concatenate([figure.positions_ws for figure in figures])
    reach = float(np.ptp(points @ way)) + 0.9
    tall = float(points[:, 1].max()) + 0.35
    middle = (float((points @ way).max() + (points @ way).min()) / 2.0) * way
    off = np.array([-way[2], 0.0, way[0]])
    middle = middle + off * float(np.median(points @ off)) + np.array([0.0, 0.5 * tall, 0.0])
    aspect, yfov = width / height, 0.30
    distance = 1.04 * max(reach / aspect, tall) / (2.0 * np.tan(yfov / 2.0)) + 0.9
    toward = off * np.cos(azimuth) + way * np.sin(azimuth) + np.array([0.0, 0.10, 0.0])
    camera = look_at(middle + toward / np.linalg.norm(toward) * distance, middle, yfov=yfov, aspect=aspect)
    view = View(camera, figures, (), (float(middle[0]), float(middle[2])))
    return engine.draw(view, width, height)
