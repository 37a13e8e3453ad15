"""Film strips of the touch performances in examples/, played in memory, for docs/touch.md.

    python docs/strips.py                     every examples/*.touch, as docs/touch-NAME.webp
    python docs/strips.py kick wave -o /tmp   some of them, elsewhere

Interpreter and controller are the real nodes on a stage in memory with a told clock, so that the same pictures come
out on any machine. Above what the player sees, below the same moments from another side. The moments are those that
the motion turns at: the joints' way on the picture is simplified to as many points (Ramer 1972, Douglas and Peucker
1973) as the strip has pictures.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.spatial.transform import Rotation

from bunraku.figure.camera import Orbit, axes, project
from bunraku.nodes.controller.node import Controller
from bunraku.nodes.input_touch.node import InputTouch
from bunraku.nodes.input_touch.performance import PerformanceError, load
from bunraku.nodes.interpreter.node import Interpreter
from bunraku.nodes.renderer.engine import open_engine
from bunraku.nodes.renderer.scene import Scene, paint
from bunraku.nodes.renderer.view import Engine, Layer, View
from bunraku.runtime.memory import MemoryStage

Array = NDArray[np.float64]
HERE = Path(__file__).resolve().parent
EXAMPLES = HERE.parent / "examples"
RATE = 30
"""Moments a second that a strip chooses from."""
LEAD, TAIL = 0.3, 0.5  # s shown before the first touch and after the last
WIDTH, HEIGHT = 960, 540
"""Pixels of the whole picture that the strip's pictures are cut from."""
TALL, LEAST, MOST = 200, 90, 205
"""Pixels of a strip's picture: its height, its width at least and at most."""
OTHER = (1.35, 0.15)
"""rad, azimuths of the other side: the first one that is not the player's own."""
LEAST_PICTURES, MOST_PICTURES = 7, 10
STILL = 0.02
"""m: a figure whose joints move less is shown from one side only."""
GAP = 4
PAPER, INK = (246, 247, 249), (70, 78, 92)
TOPICS = ("skeleton", "pose", "camera", "overlay/controller", "overlay/interpreter")


def play(path: Path) -> list[tuple[float, View]]:
    """The pictures of a performance, `RATE` a second: s since the first touch, and what is seen."""
    first = min(one.start for one in load(path).strokes)
    stage = MemoryStage()
    stage.add(Interpreter)
    stage.add(Controller)
    stage.advance(1.0)
    stage.add(InputTouch, script=str(path), delay=LEAD)
    began = stage.clock.now()
    scene = Scene()
    seen: list[tuple[float, View]] = []
    length = load(path).length + LEAD + TAIL
    for frame in range(round(length * RATE)):
        for topic in TOPICS:
            message = stage.last(topic)
            if message is not None:
                scene.hear(topic, message)
        stage.clear()
        since = (stage.clock.now() - began) / 1e9 - LEAD - first
        if since > -LEAD:
            seen.append((since, scene.view(stage.clock.now())))
        stage.advance((frame + 1) / RATE - (stage.clock.now() - began) / 1e9)
    return seen


def outline(view: View) -> Array:
    """(n, 2) where the figure's joints and the fingers appear, picture heights."""
    figure = view.figures[0]
    head = figure.skeleton.role("head")
    crown = figure.positions_ws[head] + Rotation.from_quat(figure.rotations_ws[head]).apply([0.0, 0.24, 0.0])
    places = project(view.camera, np.concatenate([figure.positions_ws, crown[None]]))
    return np.nan_to_num(places * [view.camera.aspect, 1.0], nan=0.5)


def moments(views: Sequence[View], count: int) -> list[int]:
    """Which pictures tell the motion: each next one is where the joints are farthest from the straight way between
    those that were chosen before."""
    way = np.stack([outline(view) for view in views])
    chosen = [0, len(views) - 1]
    while len(chosen) < min(count, len(views)):
        worst, where = -1.0, 0
        for a, b in pairwise(chosen):
            if b - a < 2:
                continue
            share = (np.arange(a + 1, b) - a)[:, None, None] / (b - a)
            off = np.linalg.norm(way[a + 1 : b] - (way[a] + (way[b] - way[a]) * share), axis=2).max(axis=1)
            # Of equally telling moments the middle one of a long pause.
            off = off + 1e-4 * (1.0 - np.abs(2.0 * share[:, 0, 0] - 1.0)) * (b - a)
            if float(off.max()) > worst:
                worst, where = float(off.max()), a + 1 + int(off.argmax())
        if worst < 0.0:
            break
        chosen = sorted([*chosen, where])
    return chosen


def window(views: Sequence[View], *, fingers: bool) -> tuple[int, int, int, int]:
    """Left, top, right and bottom pixel of what all pictures of a row show: the figure and the fingers."""
    places = [outline(view) * HEIGHT for view in views]
    for view in views if fingers else ():
        for layer in view.layers:
            for one in layer.primitives:
                if one.space == "screen" and one.kind == "circle":
                    places.append(np.array([[one.points[0][0] * WIDTH, one.points[0][1] * HEIGHT]]))
    all_places = np.concatenate(places)
    low, high = all_places.min(axis=0), all_places.max(axis=0)
    left, right = max(0.0, low[0] - 26), min(float(WIDTH), high[0] + 26)
    top, bottom = max(0.0, low[1] - 20), min(float(HEIGHT), high[1] + 24)
    more = max(0.0, 0.5 * (LEAST * (bottom - top) / TALL - (right - left)))
    left, right = left - more, right + more
    return round(left), round(top), round(right), round(bottom)


def aside(view: View, azimuth: float) -> View:
    """The figure alone, seen from ``azimuth`` (rad), in the picture's middle."""
    x, _, z = view.figures[0].positions_ws[0]
    camera = Orbit((float(x), 0.9, float(z)), azimuth).camera()
    return replace(view, camera=camera, layers=tuple(on_ground(layer) for layer in view.layers))


def on_ground(layer: Layer) -> Layer:
    """What a layer draws on the ground."""
    kept = [one for one in layer.primitives if one.space == "world" and all(point[1] < 0.03 for point in one.points)]
    return replace(layer, primitives=tuple(kept))


def row(engine: Engine, views: Sequence[View], *, fingers: bool) -> list[Image.Image]:
    """The pictures of some views, cut to what happens in them."""
    box = window(views, fingers=fingers)
    scale = min(TALL / (box[3] - box[1]), MOST / (box[2] - box[0]))
    size = (round((box[2] - box[0]) * scale), round((box[3] - box[1]) * scale))
    pictures = []
    for view in views:
        pixels = paint(engine, view, WIDTH, HEIGHT)
        whole = Image.fromarray(np.ascontiguousarray(pixels[..., :3]))
        pictures.append(whole.crop(box).resize(size, Image.Resampling.LANCZOS))
    return pictures


def strip(path: Path, count: int) -> Image.Image:
    """The strip of a performance; ``count`` 0 takes as many pictures as its length asks for."""
    seen = play(path)
    count = count or min(MOST_PICTURES, max(LEAST_PICTURES, round(seen[-1][0])))
    chosen = [seen[k] for k in moments([view for _, view in seen], count)]
    views = [view for _, view in chosen]
    engine = open_engine()
    rows = [row(engine, views, fingers=True)]
    way = np.stack([view.figures[0].positions_ws for view in views])
    if float(np.abs(way - way[0]).max()) > STILL:
        backs = [axes(view.camera)[2] for view in views]
        own = float(np.median([np.arctan2(back[0], back[2]) for back in backs]))
        other = next(one for one in OTHER if abs(one - own) > 0.5)
        rows.append(row(engine, [aside(view, other) for view in views], fingers=False))
    engine.close()
    wide = max(pictures[0].width for pictures in rows)
    talls = [pictures[0].height for pictures in rows]
    sheet = Image.new("RGB", (len(chosen) * (wide + GAP) - GAP, sum(talls) + GAP * (len(rows) - 1)), PAPER)
    draw = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(13)
    for column, (seconds, _) in enumerate(chosen):
        x, y = column * (wide + GAP), 0
        for pictures in rows:
            sheet.paste(pictures[column], (x + (wide - pictures[column].width) // 2, y))
            y += pictures[column].height + GAP
        draw.text((x + 5, 3), f"{max(seconds, 0.0):.1f} s", fill=INK, font=font)
    return sheet


def main(argv: Sequence[str] | None = None) -> int:
    """Make the strips."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("names", nargs="*", help="performances in examples/, without .touch, or files; default all")
    parser.add_argument("-o", "--output", type=Path, default=HERE, help="folder to write (docs)")
    parser.add_argument("--count", type=int, default=0, help="pictures a strip (by its length, 7 to 10)")
    parser.add_argument("--format", default="webp", choices=["webp", "png"])
    args = parser.parse_args(argv)
    if args.count < 0 or args.count == 1:
        parser.error("--count: a strip has at least 2 pictures")
    paths = [Path(name) if name.endswith(".touch") else EXAMPLES / f"{name}.touch" for name in args.names]
    args.output.mkdir(parents=True, exist_ok=True)
    for path in paths or sorted(EXAMPLES.glob("*.touch")):
        try:
            picture = strip(path, args.count)
        except PerformanceError as error:
            print(f"strips: {error}", file=sys.stderr)
            return 2
        target = args.output / f"touch-{path.stem}.{args.format}"
        picture.save(target, quality=82, method=6)
        print(f"{target}  {picture.width}x{picture.height}  {target.stat().st_size / 1024:.0f} KiB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
