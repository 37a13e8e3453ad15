"""Launches for tests, in a run folder of their own, ended in any case."""

import signal
import subprocess
from collections.abc import Callable, Iterator

import pytest
from launched import Stack

from bunraku.runtime.names import run_folder


@pytest.fixture
def launch(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Stack]]:
    """Start launches: ``launch("touch", "source:=tuio", "--without", "input_touch")``."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path_factory.mktemp("r")))
    monkeypatch.setenv("BUNRAKU_STAGE", "t")
    begun: list[Stack] = []

    def begin(*words: str) -> Stack:
        stack = Stack(run_folder(), list(words))
        begun.append(stack)
        return stack

    yield begin
    for stack in begun:
        if stack.process.poll() is None:
            stack.process.send_signal(signal.SIGINT)
            try:
                stack.process.wait(30)
            except subprocess.TimeoutExpired:
                stack.process.kill()
                stack.process.wait()
        stack.context.destroy(linger=0)
