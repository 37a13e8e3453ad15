"""A launched stack for tests: a run folder of its own, processes that are always ended."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgpack
import zmq

from bunraku.runtime.names import endpoint, file_of, make_run_folder
from bunraku.runtime.topics import cards

PATIENCE = 300.0
"""s: the kernels may have to be compiled first, on a slow machine."""


def until(condition: Callable[[], Any], what: str, seconds: float = PATIENCE) -> Any:
    """Wait for something to become true."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        value = condition()
        if value:
            return value
        time.sleep(0.01)
    raise AssertionError(f"did not happen within {seconds:g} s: {what}")


class Stack:
    """A launch in its own process, and plain pyzmq ends to its topics."""

    def __init__(self, folder: Path, words: list[str]) -> None:
        self.folder = folder
        self.log = folder.parent.parent / "launch.log"
        self.context: zmq.Context[Any] = zmq.Context()
        with self.log.open("w") as lines:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "bunraku.cli", "launch", *words],
                stdout=lines,
                stderr=lines,
                env={**os.environ, "NO_COLOR": "1"},
            )
        until(lambda: self.process.poll() is not None or " up in " in self.log.read_text(), "all nodes up")
        assert self.process.poll() is None, self.log.read_text()

    def pid(self, node: str) -> int:
        """Process of a node, by the card of its parameters; 0 while there is none."""
        return int(cards(self.folder).get(f"params/{node}", {}).get("pid", 0))

    def reader(self, topic: str, *, newest: bool = True) -> "zmq.Socket[bytes]":
        """A subscriber."""
        socket: zmq.Socket[bytes] = self.context.socket(zmq.SUB)
        if newest:
            socket.setsockopt(zmq.CONFLATE, 1)
        else:
            socket.setsockopt(zmq.RCVHWM, 0)
        socket.setsockopt(zmq.RECONNECT_IVL, 20)
        socket.subscribe(b"")
        socket.connect(endpoint(file_of(self.folder, topic)))
        return socket

    def writer(self, topic: str) -> "zmq.Socket[bytes]":
        """A publisher in the place of a node that does not run."""
        socket: zmq.Socket[bytes] = self.context.socket(zmq.XPUB)
        socket.setsockopt(zmq.SNDHWM, 0)
        socket.bind(endpoint(file_of(make_run_folder(self.folder), topic)))
        return socket

    def end(self, number: int = signal.SIGINT) -> int:
        """End the launch; gives its exit status."""
        self.process.send_signal(number)
        return self.process.wait(60)


def read(socket: "zmq.Socket[bytes]", milliseconds: int = 30_000) -> dict[str, Any]:
    """The next message of a reader."""
    assert socket.poll(milliseconds), "nothing was said"
    body: dict[str, Any] = msgpack.unpackb(socket.recv())
    return body
