"""Takes: recordings made from the page, their poses for the page's timeline, and other formats of them."""

import asyncio
import re
import struct
import sys
import tempfile
import time
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
EXPORT_SECONDS = 600.0


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


async def export(path: Path, kind: str, topic: str) -> Path:
    """A take in another format, made by ``bunraku bag export`` in a folder of its own; raises ValueError."""
    if kind == "mcap":
        return path
    if kind not in FORMATS:
        raise ValueError(f"a take can be had as {', '.join(FORMATS)}")
    out = Path(tempfile.mkdtemp(prefix="bunraku-take-")) / f"{path.stem}.{kind}"
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "bunraku.cli", "bag", "export", str(path), f"--{kind}", str(out), "--topic", topic,
        stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.PIPE,
    )  # fmt: skip
    try:
        _, errors = await asyncio.wait_for(process.communicate(), EXPORT_SECONDS)
    except TimeoutError:
        process.kill()
        raise ValueError(f"making {kind} took too long") from None
    if process.returncode or not out.is_file():
        lines = [line for line in errors.decode(errors="replace").splitlines() if line.strip()]
        raise ValueError(lines[-1][:300] if lines else f"bunraku bag export --{kind} failed")
    return out
