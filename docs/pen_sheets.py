"""Sheets of pictures of the pen's performances in examples/, played in memory, for docs/pen.md.

    python docs/pen_sheets.py                        all of them, as docs/pen-NAME.webp
    python docs/pen_sheets.py walk lean -o /tmp --pictures 24

Device node, interpreter and blender are the real nodes on a stage in memory with a told clock, so that the same
pictures come out on any machine.
"""

import argparse
from collections.abc import Sequence
from math import ceil
from pathlib import Path
from typing import Any

from PIL import Image, ImageDraw

from bunraku.msgs import Pose
from bunraku.nodes.blender.node import Blender
from bunraku.nodes.input_pad.node import InputPad
from bunraku.nodes.input_pen.node import InputPen
from bunraku.nodes.interpreter.node import Interpreter
from bunraku.nodes.renderer.engine import open_engine
from bunraku.nodes.renderer.scene import Scene, paint
from bunraku.nodes.renderer.view import Engine, View
from bunraku.runtime.memory import MemoryStage

HERE = Path(__file__).resolve().parent
EXAMPLES = HERE.parent / "examples"
SHEETS: dict[str, tuple[str, dict[str, Any], dict[str, Any]]] = {
    **{name: (f"{name}.pen", {}, {}) for name in ("walk", "run", "steps", "turn", "jump", "reset", "duck", "lean")},
    "corner": ("corner.pen", {"pen_natural": True}, {}),
    "obstacles": ("obstacles.pen", {"obstacles": str(EXAMPLES / "obstacles.toml")}, {}),
    "hills": ("walk.pen", {}, {"ground": str(EXAMPLES / "hills.npz")}),
    "pad": ("walk.pad", {}, {}),
}
"""Sheet -> performance, the interpreter's parameters and the blender's."""
VIEW = {"azimuth": 0.0, "elevation": 0.42, "distance": 6.5}
TOPICS = ("skeleton", "pose", "camera", "overlay/blender", "overlay/interpreter")
RATE = 60
COLUMNS, WIDTH, HEIGHT, GAP = 4, 360, 203, 3
PAPER, INK = (246, 247, 249), (70, 78, 92)


def play(name: str, count: int) -> list[tuple[float, View]]:
    """``count`` moments of a performance, evenly spread: s since its beginning, and what is seen."""
    file, interpreter, blender = SHEETS[name]
    stage = MemoryStage()
    stage.add(Interpreter, **VIEW, **interpreter)
    stage.add(Blender, skeleton=True, remap={"motion": "pose"}, **blender)
    stage.advance(0.5)
    device = InputPad if file.endswith(".pad") else InputPen
    node = stage.add(device, drivers=["script"], script=str(EXAMPLES / file))
    length = node.running[0].length()
    scene = Scene()
    seen: list[tuple[float, View]] = []
    for frame in range(round(length * RATE)):
        for topic in TOPICS:
            message = stage.last(topic)
            if message is not None:
                # The blender's motion is the pose here: the same fields in another type.
                scene.hear(topic, Pose.decode(message.encode()) if topic == "pose" else message)
        stage.clear()
        if frame >= len(seen) * length * RATE / count + 0.5 * length * RATE / count:
            seen.append((frame / RATE, scene.view(stage.clock.now())))
        stage.advance(1.0 / RATE)
    return seen


def sheet(engine: Engine, seen: Sequence[tuple[float, View]]) -> Image.Image:
    """The moments in rows, each with its time."""
    rows = ceil(len(seen) / COLUMNS)
    out = Image.new("RGB", (COLUMNS * (WIDTH + GAP) - GAP, rows * (HEIGHT + GAP) - GAP), PAPER)
    for k, (time, view) in enumerate(seen):
        pixels = paint(engine, view, 2 * WIDTH, 2 * HEIGHT)
        picture = Image.fromarray(pixels[..., :3]).resize((WIDTH, HEIGHT), Image.Resampling.LANCZOS)
        ImageDraw.Draw(picture).text((6, 4), f"{time:.1f} s", fill=INK)
        out.paste(picture, (k % COLUMNS * (WIDTH + GAP), k // COLUMNS * (HEIGHT + GAP)))
    return out


def main() -> None:
    """Write the sheets."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help=f"of {', '.join(SHEETS)} (default all)")
    parser.add_argument("-o", "--output", type=Path, default=HERE, help="folder (default docs)")
    parser.add_argument("--pictures", type=int, default=12, help="moments on a sheet (default 12)")
    args = parser.parse_args()
    unknown = [name for name in args.names if name not in SHEETS]
    if unknown:
        parser.error(f"{unknown[0]}: none of {', '.join(SHEETS)}")
    engine = open_engine("auto")
    for name in args.names or SHEETS:
        path = args.output / f"pen-{name}.webp"
        sheet(engine, play(name, args.pictures)).save(path, quality=72, method=6)
        print(path, flush=True)


if __name__ == "__main__":
    main()
