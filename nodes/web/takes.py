"""Takes: recordings made from the page, their poses for the page's timeline, and other formats of them."""

import asyncio
import contextlib
import os
import re
import shutil
import struct
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bunraku.msgs import InvalidMessage, Pose, decode
from bunraku.nodes.web.files import Asset, asset
from bunraku.runtime.bag import Bag, BagError

NAME = re.compile(r"take-\d{8}-\d{6}(-\d+)?")
FORMATS = ("mcap", "bvh", "glb", "mp4")
MOST_LISTED = 50
MOST_FRAMES = 60 * 60 * 60
"""Of a timeline: an hour at 60 Hz."""
STILL_SECONDS = 60.0
"""An export that tells nothing for so long is given up."""
CLIP_FPS, FILM_FPS = 60, 30
PROGRESS = re.compile(r"(\w+) (\d{1,3})%")


@dataclass(frozen=True)
class Takes:
    """The folder in which takes are kept."""

    folder: Path

    def new(self) -> Path:
        """The path of a new take, named by the time of day."""
        self.folder.mkdir(parents=True, exist_ok=True)
        stem = time.strftime("take-%Y%m%d-%H%M%S")
        path, count = self.folder / f"{stem}.mcap", 1
        while path.exists():
            count += 1
            path = self.folder / f"{stem}-{count}.mcap"
        return path

    def find(self, name: Any) -> Path:
        """The bag of a take; raises ValueError for a name that is none, or a take that is not there."""
        if not isinstance(name, str) or not NAME.fullmatch(name):
            raise ValueError("no such take")
        path = self.folder / f"{name}.mcap"
        if not path.is_file():
            raise ValueError(f"{name} is not there any more")
        return path

    def listed(self) -> list[dict[str, Any]]:
        """The newest takes, newest first."""
        found = sorted((p for p in self.folder.glob("take-*.mcap") if NAME.fullmatch(p.stem)), reverse=True)
        return [{"name": p.stem, "bytes": p.stat().st_size} for p in found[:MOST_LISTED]]


def read_track(path: Path, topic: str) -> Asset:
    """The poses of a take as the page's timeline reads them; raises ValueError where there are none.

    Little-endian: ``BKT1``, u32 frames, u32 joints; f64[frames] ms since the first; f32[frames, 3] roots;
    i16[frames, joints, 4] local rotations, unit 1/32767.
    """
    stamps: list[float] = []
    roots: list[Any] = []
    rotations: list[Any] = []
    try:
        with Bag(path) as bag:
            for entry in bag.messages({topic}):
                try:
                    pose = decode(Pose, entry.body)
                except InvalidMessage:
                    continue
                if rotations and len(pose.rotations) != len(rotations[0]):
                    continue
                stamps.append(pose.stamp / 1e6)
                roots.append(pose.root)
                rotations.append(pose.rotations)
                if len(stamps) >= MOST_FRAMES:
                    break
    except BagError as error:
        raise ValueError(str(error)) from None
    if not stamps:
        raise ValueError("this take holds no pose")
    order = np.argsort(stamps, kind="stable")
    times = np.array(stamps)[order]
    turned = np.rint(np.clip(np.array(rotations)[order], -1.0, 1.0) * 32767.0)
    return asset(
        struct.pack("<4sII", b"BKT1", len(times), turned.shape[1])
        + (times - times[0]).astype("<f8").tobytes()
        + np.array(roots)[order].astype("<f4").tobytes()
        + turned.astype("<i2").tobytes(),
        ".bin",
    )


async def export(
    path: Path, kind: str, topics: Sequence[str], folder: Path, progress: Callable[[str, float], object]
) -> Path:
    """A take in another format, made by ``bunraku bag export`` in a new folder inside ``folder``.

    Args:
        topics: of the poses; a film shows them all, the others hold the first.
        progress: told what is being done and the share of it that is done, 0..1.

    Raises:
        ValueError: with the reason. When it is cancelled nothing is left.
    """
    if kind not in FORMATS:
        raise ValueError(f"a take can be had as {', '.join(FORMATS)}")
    if kind == "mcap":
        return path
    out = Path(tempfile.mkdtemp(dir=folder)) / f"{path.stem}.{kind}"
    film = kind == "mp4"
    words = [word for topic in (topics if film else topics[:1]) for word in ("--topic", topic)]
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "bunraku.cli", "bag", "export", str(path), f"--{kind}", str(out), *words,
        "--fps", str(FILM_FPS if film else CLIP_FPS), env={**os.environ, "BUNRAKU_PROGRESS": "lines"},
        stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.PIPE,
    )  # fmt: skip
    with contextlib.suppress(AttributeError, OSError):
        os.setpriority(os.PRIO_PROCESS, process.pid, 10)  # behind what is live
    made = False
    try:
        made = await _made(process, progress, kind) and out.is_file()
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
        if not made:
            shutil.rmtree(out.parent, ignore_errors=True)
    return out


async def _made(process: asyncio.subprocess.Process, progress: Callable[[str, float], object], kind: str) -> bool:
    """Follow an export to its end; raises ValueError with its last words where it failed or stands still."""
    assert process.stderr is not None
    last = f"bunraku bag export --{kind} failed"
    while True:
        try:
            line = (await asyncio.wait_for(process.stderr.readline(), STILL_SECONDS)).decode(errors="replace").strip()
        except TimeoutError:
            raise ValueError(f"making {kind} stands still: given up") from None
        if not line and process.stderr.at_eof():
            break
        told = PROGRESS.fullmatch(line)
        if told:
            progress(told[1], int(told[2]) / 100)
        elif line:
            last = line.removeprefix("bunraku bag: ")[:300]
    if await process.wait():
        raise ValueError(last)
    return True
