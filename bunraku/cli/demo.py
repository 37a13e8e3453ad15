"""Play the demonstration through the real processes, without device or display, and film it.

bunraku demo
bunraku demo --out show --script examples/kick.touch
"""

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from bunraku.cli import USAGE, Problem
from bunraku.cli.bag_film import fps_of, size_of

PATIENCE = 600.0
"""s that the stack may take until the first touch: the kernels may have to be compiled first."""


def add(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("--out", default="demo", metavar="DIR", help="where the files go (default demo)")
    parser.add_argument("--script", metavar="FILE", help="another performance (.touch) to play")
    parser.add_argument("--size", default="1280x720", metavar="WxH", help="of the film (default 1280x720)")
    parser.add_argument("--fps", type=int, default=30, help="frames a second of the film (default 30)")
    parser.add_argument("--engine", choices=["auto", "gl", "pillow"], default="auto", help="what draws the pictures")


def run(args: argparse.Namespace) -> int:
    """Perform, film, export, and say where everything is."""
    out = Path(args.out)
    width, height = size_of(args.size)
    fps_of(args.fps)
    length = _length(Path(args.script) if args.script else _own_script())
    out.mkdir(parents=True, exist_ok=True)
    bag = out / "bunraku.mcap"
    _perform([f"script:={args.script}"] if args.script else [], bag, length)
    film, sheet, bvh = out / "bunraku.mp4", out / "bunraku.png", out / "bunraku.bvh"
    _film(bag, film, sheet, (width, height), args.fps, args.engine)
    _export(bag, bvh)
    for path, what in ((bag, "everything that flowed"), (film, "film"), (sheet, "its frames"), (bvh, "motion")):
        print(f"{path}  {path.stat().st_size / 1024:.0f} KiB  {what}")
    print(f"play it again: bunraku bag play {bag}    check it bit for bit: bunraku bag check {bag}")
    return 0


def _own_script() -> Path:
    import bunraku.launch

    return Path(bunraku.launch.__file__).with_name("demo.touch")


def _length(script: Path) -> float:
    from bunraku.nodes.input_touch.performance import PerformanceError, load

    try:
        return load(script).length
    except PerformanceError as error:
        raise Problem(str(error), USAGE) from None


def _perform(words: list[str], bag: Path, length: float) -> None:
    """Run the launch file on a stage of its own; the bar follows the touches that flow."""
    import zmq

    from bunraku.cli.progress import Progress
    from bunraku.runtime.names import make_run_folder, run_folder
    from bunraku.runtime.topics import TopicReader

    stage = f"demo-{os.getpid()}"
    words = ["launch", "demo", *words, f"record:={bag}"]
    log = bag.with_suffix(".log")
    reader = None
    context: zmq.Context[Any] = zmq.Context()
    try:
        reader = TopicReader(context, make_run_folder(run_folder(stage)), "touch", newest=True)
        environment = {**os.environ, "BUNRAKU_STAGE": stage, "NO_COLOR": "1"}
        with log.open("w") as lines:
            process = subprocess.Popen(
                [sys.executable, "-m", "bunraku.cli", *words], env=environment, stdout=lines, stderr=lines
            )
        with Progress("performing") as bar:
            began, started = 0.0, time.monotonic()
            try:
                while process.poll() is None:
                    if reader.socket.poll(100):
                        reader.receive()
                        began = began or time.monotonic()
                    if began:
                        bar(time.monotonic() - began, length)
                    else:
                        bar.line("getting ready (the first time, kernels are compiled: a minute or so)")
                    if not began and time.monotonic() - started > PATIENCE:
                        raise Problem(f"nothing was performed within {PATIENCE:.0f} s; see {log}")
            finally:
                if process.poll() is None:
                    process.terminate()
                    process.wait()
    finally:
        if reader is not None:
            reader.close()
        context.term()
    if process.returncode:
        last = log.read_text().strip().rpartition("\n")[2]
        raise Problem(f"the performance failed: {last}; all of it is in {log}")
    log.unlink()


def _film(bag: Path, film: Path, sheet: Path, size: tuple[int, int], fps: int, engine: str) -> None:
    from bunraku.cli import bag_film
    from bunraku.cli.progress import Progress
    from bunraku.nodes.renderer.film import Shots

    with Progress("filming") as bar:
        bag_film.film(bag, Shots(output=film, sheet=sheet, width=size[0], height=size[1], fps=fps), engine, bar)


def _export(bag: Path, bvh: Path) -> None:
    from bunraku.cli import main

    if status := main(["bag", "export", str(bag), "--bvh", str(bvh), "--overwrite"]):
        raise Problem(f"writing {bvh} failed", status)
