"""The README's first picture: what `bunraku demo` shows, played in memory, as an animation.

    python docs/demo.py                             docs/demo.webp: its liveliest parts
    python docs/demo.py --part 0 44 -o whole.webp   others, from when to when (s); may be given again

Device nodes, interpreter, blender and controller are the real nodes on a stage in memory with a told clock, so that the
same pictures come out on any machine.
"""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from bunraku.nodes.blender.node import Blender
from bunraku.nodes.controller.node import Controller
from bunraku.nodes.input_pen.node import InputPen
from bunraku.nodes.input_touch.node import InputTouch
from bunraku.nodes.input_touch.performance import load
from bunraku.nodes.interpreter.node import Interpreter
from bunraku.nodes.renderer.engine import open_engine
from bunraku.nodes.renderer.scene import Scene, paint
from bunraku.nodes.renderer.view import View
from bunraku.runtime.memory import MemoryStage

HERE = Path(__file__).resolve().parent
LAUNCH = HERE.parent / "launch"
TOPICS = ("skeleton", "pose", "camera", "overlay/controller", "overlay/blender", "overlay/interpreter")
WIDE, HIGH = 960, 540
"""Pixels that are painted, of which a part is shown."""


PARTS = ((11.7, 14.0), (16.0, 23.7), (26.2, 31.0), (36.3, 44.1))
"""s from when to when: a kick; a walk while one hand waves; round a corner and ducking; a jump with both hands up,
and a bow."""


def play(rate: float, parts: Sequence[tuple[float, float]]) -> Iterator[tuple[float, View]]:
    """Parts of the demonstration, ``rate`` pictures a second: s since it began, and what is seen."""
    stage = MemoryStage()
    stage.add(Interpreter)
    stage.add(Blender)
    stage.add(Controller)
    stage.advance(1.0)
    began = stage.clock.now()
    script = LAUNCH / "demo.touch"
    stage.add(InputPen, drivers=["script"], script=str(LAUNCH / "demo.pen"))
    stage.add(InputTouch, script=str(script))
    scene = Scene()
    last = max(end for _, end in parts)
    for frame in range(round(min(last, load(script).length) * rate)):
        for topic in TOPICS:
            message = stage.last(topic)
            if message is not None:
                scene.hear(topic, message)
        stage.clear()
        since = (stage.clock.now() - began) / 1e9
        if any(begin <= since < end for begin, end in parts):
            yield since, scene.view(stage.clock.now())
        stage.advance((frame + 1) / rate - since)


def main() -> None:
    """Paint it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=HERE / "demo.webp", help="file (default docs/demo.webp)")
    parser.add_argument("--part", type=float, nargs=2, action="append", metavar=("FROM", "TO"), help="s (default four)")
    parser.add_argument("--fps", type=float, default=10.0, help="pictures a second (default 10)")
    parser.add_argument("--crop", type=float, nargs=2, default=(0.18, 0.86), metavar=("LEFT", "RIGHT"),
                        help="what is shown of the width (default 0.18 0.86)")  # fmt: skip
    parser.add_argument("--height", type=int, default=396, help="pixels (default 396)")
    args = parser.parse_args()
    engine = open_engine()
    left, right = (round(WIDE * share) for share in args.crop)
    size = (round((right - left) * args.height / HIGH / 2) * 2, args.height)
    pictures = []
    for _, view in play(args.fps, args.part or PARTS):
        whole = Image.fromarray(np.ascontiguousarray(paint(engine, view, WIDE, HIGH)[..., :3]))
        pictures.append(whole.crop((left, 0, right, HIGH)).resize(size, Image.Resampling.LANCZOS))
    engine.close()
    pictures[0].save(
        args.output, save_all=True, append_images=pictures[1:], duration=round(1000 / args.fps), loop=0, quality=45,
        method=6, minimize_size=False,
    )  # fmt: skip
    print(f"{args.output}  {size[0]}x{size[1]}  {len(pictures)} pictures  {args.output.stat().st_size / 1024:.0f} KiB")


if __name__ == "__main__":
    main()
