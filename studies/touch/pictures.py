"""The study's pictures: the target poses as users see them, and how the farthest joint came nearer."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from bunraku.figure.camera import Orbit
from bunraku.figure.default import default_figure
from bunraku.figure.fk import fk
from bunraku.msgs import Primitive
from bunraku.nodes.controller.node import Controller
from bunraku.nodes.renderer.engine import open_engine
from bunraku.nodes.renderer.scene import paint
from bunraku.nodes.renderer.view import Figure, Layer, View
from bunraku.runtime.memory import MemoryStage

from .editor import VIEWS
from .poses import Ghost

if TYPE_CHECKING:
    from .study import Run

WIDTH, HEIGHT = 400, 400
INK, FAINT = (70, 78, 92), (205, 209, 216)
COLORS = {"touch": (204, 66, 56), "handles": (62, 96, 160)}


def draw_poses(ghosts: Sequence[Ghost], path: Path) -> None:
    """Every target pose from the front and the side, the standing figure's bones laid over it."""
    figure = default_figure()
    stage = MemoryStage()
    start = stage.add(Controller).core.positions_ws.copy()
    parents = tuple(int(parent) for parent in figure.parents)
    bones = Primitive(kind="figure", points=[tuple(map(float, point)) for point in start], size=0.012)
    engine = open_engine()
    sheet = Image.new("RGB", (WIDTH * len(ghosts), HEIGHT * 2), "white")
    for column, one in enumerate(ghosts):
        positions, turns = fk(figure, one.root, one.rotations)
        for line, name in enumerate(VIEWS):
            azimuth, elevation = VIEWS[name]
            orbit = Orbit(azimuth=azimuth + (one.goal.yaw or 0.0), elevation=elevation, distance=4.0, aspect=1.0)
            view = View(orbit.camera(), (Figure(figure, positions, turns),), (Layer((bones,), parents),))
            pixels = paint(engine, view, WIDTH, HEIGHT)
            sheet.paste(Image.fromarray(np.ascontiguousarray(pixels[..., :3])), (WIDTH * column, HEIGHT * line))
        draw = ImageDraw.Draw(sheet)
        draw.text(
            (WIDTH * column + 10, 8), f"{one.goal.name}: {one.goal.says}", fill=INK, font=ImageFont.load_default(18)
        )
    engine.close()
    sheet.save(path)


def draw_reached(ghosts: Sequence[Ghost], runs: Sequence["Run"], path: Path) -> None:
    """The pose that the first simulated user of each tool ended in, the target's bones laid over it."""
    figure = default_figure()
    parents = tuple(int(parent) for parent in figure.parents)
    engine = open_engine()
    tools = list(dict.fromkeys(run.tool for run in runs))
    sheet = Image.new("RGB", (WIDTH * len(ghosts), HEIGHT * len(tools)), "white")
    draw = ImageDraw.Draw(sheet)
    for column, ghost in enumerate(ghosts):
        bones = Primitive(kind="figure", points=[tuple(map(float, point)) for point in ghost.positions], size=0.012)
        azimuth, elevation = (0.5, 0.15)
        orbit = Orbit(azimuth=azimuth + (ghost.goal.yaw or 0.0), elevation=elevation, distance=4.0, aspect=1.0)
        for line, tool in enumerate(tools):
            run = next(run for run in runs if run.tool == tool and run.pose == ghost.goal.name)
            positions, turns = fk(figure, run.pose_root, run.pose_rotations)
            view = View(orbit.camera(), (Figure(figure, positions, turns),), (Layer((bones,), parents),))
            pixels = paint(engine, view, WIDTH, HEIGHT)
            sheet.paste(Image.fromarray(np.ascontiguousarray(pixels[..., :3])), (WIDTH * column, HEIGHT * line))
            score = run.score
            says = f"{ghost.goal.name} {tool}: {score.seconds:.1f} s, {100 * score.error:.1f} cm off"
            draw.text((WIDTH * column + 10, HEIGHT * line + 8), says, fill=INK, font=ImageFont.load_default(18))
    engine.close()
    sheet.save(path)


def draw_times(runs: Sequence["Run"], path: Path) -> None:
    """The farthest joint's distance over time, every user of both tools."""
    poses = list(dict.fromkeys(run.pose for run in runs))
    wide, tall, left, low = 300, 260, 46, 36
    sheet = Image.new("RGB", (wide * len(poses) + 20, tall + 60), "white")
    draw = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(14)
    for column, pose in enumerate(poses):
        some = [run for run in runs if run.pose == pose]
        most = max(run.score.seconds for run in some)
        x0, y0 = wide * column + left, tall

        def at(seconds: float, metres: float, x0: int = x0, y0: int = y0, most: float = most) -> tuple[float, float]:
            return x0 + seconds / most * (wide - left - 16), y0 - min(metres, 1.0) * (tall - low)

        draw.line([at(0, 0.1), at(most, 0.1)], fill=FAINT, width=1)
        for run in some:
            track = [at(t, e) for t, e in [*run.score.track, (run.score.seconds, run.score.error)]]
            if len(track) > 1:
                pale = tuple(round(0.55 * 255 + 0.45 * c) for c in COLORS[run.tool])
                draw.line(track, fill=pale, width=1)
        for run in some:
            x, y = at(run.score.seconds, run.score.error)
            draw.ellipse([x - 3, y - 3, x + 3, y + 3], fill=COLORS[run.tool])
        draw.line([at(0, 1.0), at(0, 0), at(most, 0)], fill=INK, width=1)
        draw.text((x0, 8), f"pose {pose}", fill=INK, font=font)
        draw.text((x0 - 4, y0 + 4), "0", fill=INK, font=font)
        draw.text((at(most, 0)[0] - 36, y0 + 4), f"{most:.0f} s", fill=INK, font=font)
        draw.text((x0 - 42, at(0, 1.0)[1] - 6), "1 m", fill=INK, font=font)
        draw.text((x0 - 42, at(0, 0.1)[1] - 8), "10 cm", fill=INK, font=font)
    x = left
    for tool, color in COLORS.items():
        draw.rectangle([x, tall + 36, x + 14, tall + 46], fill=color)
        draw.text((x + 20, tall + 32), f"{tool} (simulated users)", fill=INK, font=font)
        x += 240
    sheet.save(path)
