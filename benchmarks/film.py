"""Frames a second of film: drawing, overlays and encoding, at 1280x720, on this machine.

    python benchmarks/film.py [--frames 240] [--size 1280x720] [--engine gl pillow] [--samples 0 4]

Each row is one whole film of a walking, waving figure with a touch circle and a support polygon; `draw` is
the median time of the picture alone, `cpu` the processor time of all that is done for a frame, on all cores: it tells
machines that are busy with other things from slow ones. The design asks for 30 frames/s at 1280x720 on two cores
without a graphics card.
"""

import argparse
import json
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from bunraku.figure.camera import default_camera
from bunraku.figure.default import default_figure
from bunraku.figure.quat import from_axis_angle
from bunraku.figure.wire import to_message
from bunraku.msgs import Message, Overlay, Pose, Primitive
from bunraku.nodes.renderer.engine import open_engine
from bunraku.nodes.renderer.film import Film, Shots
from bunraku.nodes.renderer.opengl import NoOpenGL

SECOND = 1_000_000_000


def performance(seconds: float) -> Iterator[tuple[int, str, Message]]:
    """A figure that walks on the spot and waves, 60 poses a second, touched all the while."""
    figure = default_figure()
    yield 0, "skeleton", to_message(figure)
    yield 0, "camera", default_camera()
    for k in range(round(seconds * 60)):
        now, phase = k * SECOND // 60, k / 60 * 2.0 * np.pi
        root, rotations = figure.rest_pose()
        for side, sign in (("left", 1.0), ("right", -1.0)):
            swing = sign * np.sin(phase)
            for role, axis, angle in (
                ("UpperLeg", (1.0, 0.0, 0.0), -0.45 * swing), ("LowerLeg", (1.0, 0.0, 0.0), 0.4 + 0.4 * swing),
                ("UpperArm", (0.0, 0.0, 1.0), -sign * 1.1 + 0.3 * swing), ("LowerArm", (0.0, 1.0, 0.0), -sign * 0.5),
            ):  # fmt: skip
                from_axis_angle(axis[0], axis[1], axis[2], float(angle), rotations[figure.role(side + role)])
        yield now, "pose", Pose(skeleton=figure.hash, root=root, rotations=rotations)
        finger = (0.6 + 0.05 * np.sin(phase), 0.5)
        trail: list[tuple[float, ...]] = [(0.55 + 0.005 * i, 0.5) for i in range(12)]
        yield now, "overlay/interpreter", Overlay(primitives=[
            Primitive(kind="circle", space="screen", points=[finger], size=0.022, label="1"),
            Primitive(kind="line", space="screen", points=trail, size=0.006),
        ])  # fmt: skip
        support: list[tuple[float, ...]] = [(-0.2, 0.004, -0.1), (0.2, 0.004, -0.1), (0.2, 0.004, 0.2)]
        yield now, "overlay/controller", Overlay(primitives=[
            Primitive(kind="polygon", points=support, size=0.006),
            Primitive(kind="circle", points=[(0.0, 0.008, 0.05)], size=0.02),
        ])  # fmt: skip


def measure(engine: str, samples: int, width: int, height: int, frames: int) -> dict[str, Any]:
    """One film; a row of the table."""
    opened = open_engine(engine, samples)
    times: list[float] = []
    draw = opened.draw

    def timed(*args: Any) -> Any:
        begin = time.perf_counter()
        out = draw(*args)
        times.append(time.perf_counter() - begin)
        return out

    opened.draw = timed  # type: ignore[assignment, method-assign]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "film.mp4"
        film = Film(Shots(output=path, width=width, height=height), opened)
        begin, used, first, last = 0.0, 0.0, 0, 0
        for last, topic, message in performance(frames / 60 + 0.2):
            film.feed(last, topic, message)
            if film.frames >= 12 and not begin:  # compiled and warm
                begin, first, used = time.perf_counter(), film.frames, time.process_time()
            if film.frames >= frames:
                break
        film.close()
        seconds, used = time.perf_counter() - begin, time.process_time() - used
        size = path.stat().st_size
    opened.close()
    return {
        "engine": opened.name, "samples": samples if opened.name == "gl" else None, "size": f"{width}x{height}",
        "frames": film.frames, "frames_per_s": round((film.frames - first) / seconds, 1),
        "cpu_ms": round(1e3 * used / (film.frames - first), 1), "draw_ms": round(1e3 * float(np.median(times)), 1),
        "kib_per_s": round(size / 1024 / (film.frames / 60)),
    }  # fmt: skip


def main() -> None:
    """Print the table, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=240)
    parser.add_argument("--size", nargs="+", default=["1280x720", "640x360"])
    parser.add_argument("--engine", nargs="+", default=["gl", "pillow"])
    parser.add_argument("--samples", nargs="+", type=int, default=[4, 0])
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    rows = []
    for size in args.size:
        width, height = map(int, size.split("x"))
        for engine in args.engine:
            for samples in args.samples if engine == "gl" else [0]:
                try:
                    rows.append(measure(engine, samples, width, height, args.frames))
                except NoOpenGL as error:
                    print(f"{engine}: {error}")
                    continue
                if not args.json:
                    row = rows[-1]
                    print(
                        f"{row['engine']:7} samples {row['samples']!s:5} {row['size']:9} "
                        f"{row['frames_per_s']:6} frames/s   draw {row['draw_ms']:5} ms   "
                        f"cpu {row['cpu_ms']:5} ms a frame   {row['kib_per_s']} KiB/s",
                        flush=True,
                    )
    if args.json:
        print(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
