"""People at the stage page: Chromium, headless, driven as hands would, on a stage of real processes."""

import contextlib
import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
import zmq
from PIL import Image

from bunraku.runtime.names import endpoint, file_of

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = [
    "--no-sandbox", "--disable-gpu-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--use-gl=angle", "--use-angle=gl-egl", "--ignore-gpu-blocklist",
]  # fmt: skip
SHOTS = os.environ.get("BUNRAKU_SHOTS")
"""A folder for the pictures, to be looked at."""
UP = re.compile(r"nodes? up in")
LINK = re.compile(r"the stage page is at (http://\S+)")


def needs_browser(seconds: float) -> list[pytest.MarkDecorator]:
    """The marks of a module whose tests drive Chromium on a stage of real processes, ``seconds`` at most each."""
    return [
        pytest.mark.peer,
        pytest.mark.stack,
        pytest.mark.timeout(seconds),
        pytest.mark.skipif(find_spec("playwright") is None, reason="needs playwright: pip install -e '.[test]'"),
        pytest.mark.skipif(BROWSER is None, reason="needs Chromium: apt-get install chromium"),
    ]


class Ear:
    """Hears one topic from the beginning of a test."""

    def __init__(self, folder: Path, topic: str) -> None:
        self.context: zmq.Context[Any] = zmq.Context()
        self.socket: zmq.Socket[bytes] = self.context.socket(zmq.SUB)
        self.socket.setsockopt(zmq.RCVHWM, 0)
        self.socket.subscribe(b"")
        self.socket.connect(endpoint(file_of(folder, topic)))
        self.heard: list[dict[str, Any]] = []

    def listen(self) -> list[dict[str, Any]]:
        """All that came so far."""
        while self.socket.poll(0):
            self.heard.append(msgpack.unpackb(self.socket.recv()))
        return self.heard

    def close(self) -> None:
        self.socket.close(0)
        self.context.term()


class Hall:
    """A running stage and where to find it."""

    def __init__(self, folder: Path, words: Sequence[str]) -> None:
        self.takes = folder / "takes"
        run = folder / "r"
        run.mkdir(mode=0o700)
        self.folder = run / "bunraku" / "page"
        self.environment = {"XDG_RUNTIME_DIR": str(run), "BUNRAKU_STAGE": "page"}
        self.log = (folder / "log").open("w+")
        self.process = subprocess.Popen(
            [sys.executable, "-m", "bunraku.cli", "launch", *words], env={**os.environ, **self.environment},
            stdout=self.log, stderr=subprocess.STDOUT, cwd=folder, start_new_session=True,
        )  # fmt: skip
        try:
            self.until(lambda: UP.search(self.said()) is not None, 200.0)  # kernels may be compiled first
            self.until(lambda: LINK.search(self.said()) is not None)
        except AssertionError:
            self.close()
            raise

    @property
    def link(self) -> str:
        """Where the page is, as the log tells it."""
        found = LINK.search(Path(self.log.name).read_text())
        assert found is not None
        return found[1]

    def until(self, condition: Callable[[], bool], seconds: float = 30.0) -> None:
        end = time.monotonic() + seconds
        while not condition():
            assert self.process.poll() is None, self.said()
            assert time.monotonic() < end, self.said()
            time.sleep(0.05)

    def said(self) -> str:
        self.log.flush()
        return Path(self.log.name).read_text()[-4000:]

    def pid(self, topic: str) -> int:
        """The process that says a topic."""
        return int(json.loads(file_of(self.folder, topic, ".json").read_text())["pid"])

    def close(self) -> None:
        self.process.send_signal(signal.SIGINT)
        try:
            self.process.wait(20.0)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self.process.pid, signal.SIGKILL)
            self.log.close()


class Person:
    """Someone at a page."""

    def __init__(self, browser: Any, hall: Hall, **options: Any) -> None:
        options = {"viewport": {"width": 960, "height": 640}, "has_touch": True, **options}
        self.hall = hall
        self.context = browser.new_context(**options)
        self.page = self.context.new_page()
        self.faults: list[str] = []
        self.page.on("pageerror", lambda error: self.faults.append(str(error)))
        self.page.on("console", lambda line: self.faults.append(line.text) if line.type == "error" else None)
        self.requests: list[str] = []
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.cdp = self.context.new_cdp_session(self.page)
        self.open()

    def open(self) -> None:
        self.page.goto(self.hall.link)
        self.until("bunraku.stage.figures.size && bunraku.stage.shown.seq >= 0 && bunraku.here.role")

    def ask(self, expression: str, value: Any = None) -> Any:
        return self.page.evaluate(expression, value) if value is not None else self.page.evaluate(expression)

    def until(self, condition: str, seconds: float = 30.0) -> None:
        """Wait for something on the page (its policy forbids the waiting that the driver would do there)."""
        end = time.monotonic() + seconds
        while not self.ask(f"!!(window.bunraku && ({condition}))"):
            assert time.monotonic() < end, f"{condition} did not come; {self.faults}; {self.hall.said()}"
            self.page.wait_for_timeout(40)

    def where(self, role: str) -> tuple[float, float]:
        """Pixels of the page where a joint is seen."""
        return self.seen(self.ask("role => [...bunraku.stage.figures.get(0).place(role)]", role))

    def seen(self, place: Sequence[float]) -> tuple[float, float]:
        """Pixels of the page where a place of the world (m) is seen."""
        x, y = self.ask(
            """async place => {
              const {stage} = bunraku, view = await import('/view.js'), r = stage.picture();
              const q = view.project(view.viewOf(stage.camera), place);
              return [r.left + q.x * r.width, r.top + q.y * r.height];
            }""",
            place,
        )
        return float(x), float(y)

    def fingers(self, kind: str, *places: tuple[float, float], force: float = 0.4) -> None:
        points = [
            {"x": x, "y": y, "id": i, "radiusX": 9, "radiusY": 6, "rotationAngle": 20, "force": force}
            for i, (x, y) in enumerate(places)
        ]
        self.cdp.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    def pen(self, kind: str, x: float, y: float, **more: Any) -> None:
        event = {"type": kind, "x": x, "y": y, "pointerType": "pen", **more}
        self.cdp.send("Input.dispatchMouseEvent", event)

    def shot(self, name: str) -> np.ndarray:
        """The page as it is seen, (h, w, 3)."""
        data = self.page.screenshot()
        if SHOTS:
            Path(SHOTS).mkdir(parents=True, exist_ok=True)
            (Path(SHOTS) / f"{name}.png").write_bytes(data)
        return np.asarray(Image.open(io.BytesIO(data)).convert("RGB")).astype(int)

    def reset(self) -> None:
        self.page.get_by_role("button", name="Reset").click()

    def close(self) -> None:
        self.context.close()


def teal(picture: np.ndarray, at: tuple[float, float], reach: int = 45) -> int:
    """Pixels of the left hand's colour around a place."""
    x, y = round(at[0]), round(at[1])
    r, g, b = (picture[max(0, y - reach) : y + reach, max(0, x - reach) : x + reach, k] for k in range(3))
    return int(((g - r > 40) & (b - r > 40)).sum())


def differs(one: np.ndarray, other: np.ndarray, at: tuple[float, float], reach: int) -> float:
    """The share of pixels around a place that two pictures show differently."""
    x, y = round(at[0]), round(at[1])
    box = (slice(max(0, y - reach), y + reach), slice(max(0, x - reach), x + reach))
    return float((np.abs(one[box] - other[box]).max(axis=-1) > 30).mean())
