"""How long after the hand the figure moves: pen and gamepad, through the real processes.

    python studies/pen_latency.py [--times 8]

Launches the pen's stack without its device node, plays that device at 120 Hz itself, and hears every pose. A motion
has begun when the hips are 1 cm from where they were. Prints the table of docs/pen.md; the times are those of this
machine under its load.
"""

import argparse
import math
import os
import signal
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import zmq

from bunraku.runtime.names import endpoint, file_of, make_run_folder, run_folder

RATE = 120.0
SIZE, SCALE = (0.40, 0.40), 16.0
MOVED = 0.01  # m
STILL = 0.002  # m in `CALM` s
CALM = 0.6


class Played:
    """A running stack whose device this is."""

    def __init__(self, device: str, early: bool) -> None:
        self.device = device
        words = ["pen", f"device:={device}", "source:=evdev", f"early:={str(early).lower()}", "window:=off"]
        log = Path(os.environ["XDG_RUNTIME_DIR"]) / "launch.log"
        with log.open("w") as lines:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "bunraku.cli", "launch", *words, "--without", f"input_{device}"],
                stdout=lines,
                stderr=lines,
            )
        end = time.monotonic() + 300.0
        while " up in " not in log.read_text():
            if self.process.poll() is not None or time.monotonic() > end:
                sys.exit(f"the stack did not come up:\n{log.read_text()}")
            time.sleep(0.1)
        self.context: zmq.Context[Any] = zmq.Context()
        folder = make_run_folder(run_folder())
        self.samples = self.context.socket(zmq.XPUB)
        self.samples.bind(endpoint(file_of(folder, device)))
        self.poses = self.context.socket(zmq.SUB)
        self.poses.setsockopt(zmq.RCVHWM, 0)
        self.poses.subscribe(b"")
        self.poses.connect(endpoint(file_of(folder, "pose")))
        if not self.samples.poll(30_000) or not self.poses.poll(30_000):
            self.end()
            sys.exit(f"nobody hears {device}, or nothing is seen:\n{log.read_text()}")
        self.seq = 0
        self.track: list[tuple[float, tuple[float, float, float]]] = []

    def end(self) -> None:
        """End the launch."""
        self.process.send_signal(signal.SIGINT)
        self.process.wait(60)
        self.context.destroy(linger=0)

    def say(self, body: dict[str, Any]) -> float:
        """One sample; gives when."""
        now = time.time_ns()
        self.seq += 1
        self.samples.send(msgpack.packb({"device": "study", "seq": self.seq, "stamp": now, "origin": now, **body}))
        return now * 1e-9

    def pen(self, right: float, up: float, *, contact: bool = True) -> float:
        """A pen's sample at a place, m of the ground from the tablet's middle."""
        x, y = 0.5 + right / (SIZE[0] * SCALE), 0.5 - up / (SIZE[1] * SCALE)
        pressure = 0.3 if contact else 0.0
        return self.say({"size_m": SIZE, "in_range": True, "contact": contact, "x": x, "y": y, "pressure": pressure})

    def pad(self, *, left: float = 0.0, right: float = 0.0, button: int | None = None) -> float:
        """A gamepad's sample: both sticks' forward tilt, and a button."""
        return self.say({"axes": [0.0, -left, 0.0, -right], "buttons": [k == button for k in range(6)]})

    def wait(self, until: float) -> None:
        """Hear poses until a moment."""
        while (left := until - time.time()) > 0.0:
            if self.poses.poll(max(1, math.floor(left * 1e3))):
                self._hear()

    def _hear(self) -> None:
        pose = msgpack.unpackb(self.poses.recv())
        self.track.append((time.time(), struct.unpack("<3f", pose["root"])))

    def rest(self) -> None:
        """Wait until the figure stands still, then forget what was heard."""
        end = time.time() + 20.0
        while time.time() < end:
            self.track.clear()
            self.wait(time.time() + CALM)
            places = np.array([place for _, place in self.track])
            if len(places) > 5 and np.ptp(places, axis=0).max() < STILL:
                break
        self.track = self.track[-1:]

    def began(self, limit: float = 4.0) -> float:
        """When the hips left where they were at rest."""
        start = np.array(self.track[0][1])
        end, seen = time.time() + limit, 0
        while time.time() < end:
            for at, place in self.track[seen:]:
                if np.linalg.norm(np.array(place) - start) > MOVED:
                    return at
            seen = len(self.track)
            if self.poses.poll(50):
                self._hear()
        return math.nan


def stroke(stack: Played, length: float, seconds: float) -> tuple[float, float]:
    """Draw straight toward the user at `RATE`; gives when the first and the last sample that moved were said."""
    count = round(seconds * RATE)
    begin = time.time()
    first = last = 0.0
    for k in range(count + 1):
        stack.wait(begin + k / RATE)
        last = stack.pen(0.0, -length * k / count)
        first = first or last
    stack.wait(time.time() + 1.0 / RATE)
    stack.pen(0.0, -length, contact=False)
    return first, last


def once(stack: Played, kind: str) -> tuple[float, float]:
    """s from the first and from the deciding sample to the motion."""
    stack.rest()
    if stack.device == "pad":
        button = {"jump": 0, "step": 1}.get(kind)
        tilt = 0.6 if kind == "walk" else 0.0
        said = stack.pad(left=tilt, right=0.8 if kind == "step" else 0.0, button=button)
        stack.wait(said + 0.1)
        stack.pad(left=tilt)
        began = stack.began()
        stack.pad()
        return began - said, began - said
    if kind == "jump":
        stack.pen(0.0, 0.0)
        stack.wait(time.time() + 0.2)
        first = stack.pen(0.0, 0.0, contact=False)
        stack.wait(first + 0.15)
        decided = stack.pen(0.0, -0.7)
        began = stack.began()
        stack.pen(0.0, -0.7, contact=False)
        return began - first, began - decided
    first, decided = stroke(stack, *((0.45, 0.3) if kind == "step" else (1.8, 1.3)))
    began = stack.began()
    return began - first, began - (decided if kind == "step" else first)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--times", type=int, default=8, help="each motion (default 8)")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_RUNTIME_DIR"], os.environ["BUNRAKU_STAGE"] = folder, "study"
        Path(folder).chmod(0o700)
        print("| motion | first sample to motion ms, median (90 %) | deciding sample to motion ms, median (90 %) |")
        print("|---|---|---|")
        for device, early in (("pen", False), ("pen", True), ("pad", False)):
            stack = Played(device, early)
            try:
                for kind in ("walk",) if early else ("step", "walk", "jump"):
                    rows = 1e3 * np.array([once(stack, kind) for _ in range(args.times)])
                    rows = rows[np.isfinite(rows).all(axis=1)]
                    a, b = np.median(rows, axis=0), np.quantile(rows, 0.9, axis=0)
                    name = f"{kind}, {'gamepad' if device == 'pad' else 'early start' if early else 'pen'}"
                    print(f"| {name} | {a[0]:.0f} ({b[0]:.0f}) | {a[1]:.0f} ({b[1]:.0f}) |", flush=True)
            finally:
                stack.end()


if __name__ == "__main__":
    main()
