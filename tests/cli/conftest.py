"""A stage of its own for each test, and commands whose lines one can wait for."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

NODES = Path(__file__).parent.parent / "runtime"


class Command:
    """A running `bunraku` whose lines one can wait for."""

    def __init__(self, *words: str, **env: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "bunraku.cli", *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            text=True,
            env={**os.environ, **env},
            start_new_session=True,
        )
        self.lines: list[str] = []
        self.news = threading.Condition()
        self.reader = threading.Thread(target=self._read, daemon=True)
        self.reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            with self.news:
                self.lines.append(line.rstrip("\n"))
                self.news.notify_all()

    @property
    def text(self) -> str:
        return "\n".join(self.lines)

    def wait_for(self, pattern: str, seconds: float = 60.0) -> re.Match[str]:
        with self.news:
            assert self.news.wait_for(lambda: re.search(pattern, self.text), seconds), self.text
        found = re.search(pattern, self.text)
        assert found is not None
        return found

    def end(self, seconds: float = 60.0) -> int:
        status = self.process.wait(seconds)
        self.reader.join(seconds)
        return status

    def interrupt(self) -> None:
        self.process.send_signal(signal.SIGINT)


@pytest.fixture
def stage(tmp_path_factory: pytest.TempPathFactory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The run folder of an empty stage; the small nodes of the tests are importable, the working folder is empty."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path_factory.mktemp("r")))
    monkeypatch.setenv("BUNRAKU_STAGE", "t")
    monkeypatch.setenv("PYTHONPATH", str(NODES))
    monkeypatch.chdir(tmp_path)
    return Path(os.environ["XDG_RUNTIME_DIR"]) / "bunraku" / "t"


@pytest.fixture
def start() -> Iterator[Callable[..., Command]]:
    """Start a command; what still runs at the end is killed."""
    running: list[Command] = []

    def begin(*words: str, **env: str) -> Command:
        running.append(Command(*words, **env))
        return running[-1]

    yield begin
    for one in running:
        if one.process.poll() is None:
            one.process.kill()
        one.end()
        assert one.process.stdout is not None
        one.process.stdout.close()


@pytest.fixture
def bunraku() -> Callable[..., "subprocess.CompletedProcess[str]"]:
    """Run a command to its end."""

    def run(*words: str, stdin: str | None = None) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            [sys.executable, "-m", "bunraku.cli", *words],
            capture_output=True,
            text=True,
            input=stdin or "",
            timeout=60,
        )

    return run


@pytest.fixture
def until() -> Callable[..., Any]:
    """Ask until the answer is true, and give it."""

    def until(condition: Callable[[], Any], seconds: float = 60.0) -> Any:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if found := condition():
                return found
            time.sleep(0.02)
        raise AssertionError("it did not come")

    return until
