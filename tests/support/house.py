"""A page server with its doors open, and what a page says to it."""

import asyncio
import json
import struct
import threading
import urllib.error
import urllib.request
from collections.abc import Awaitable, Callable
from typing import Any

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed

from bunraku.figure.default import default_figure
from bunraku.msgs import Pose
from bunraku.nodes.web.access import Gate, host_names
from bunraku.nodes.web.audience import Hooks
from bunraku.nodes.web.files import load_page
from bunraku.nodes.web.protocol import Call, Input
from bunraku.nodes.web.server import PageServer


class House:
    """A server and what it told."""

    def __init__(self, token: str = "", figures: tuple[str, ...] = ("",)) -> None:
        self.inputs: list[tuple[str, str, Input, int]] = []
        self.gone: list[tuple[str, str]] = []
        self.making = 0
        self.came = threading.Condition()
        self.server = PageServer(
            Hooks(self._input, self._gone, self._call), load_page(), Gate(frozenset(), "http", token), figures
        )
        self.server.start("127.0.0.1", 0)
        self.port = self.server.port
        self.server.gate = Gate(host_names(["127.0.0.1", "localhost"], self.port, "http"), "http", token)

    def _input(self, page: str, figure: str, sample: Input, received: int) -> None:
        with self.came:
            self.inputs.append((page, figure, sample, received))
            self.came.notify_all()

    def _gone(self, page: str, figure: str) -> None:
        with self.came:
            self.gone.append((page, figure))
            self.came.notify_all()

    async def _call(self, page: str, call: Call) -> dict[str, Any]:
        if call.verb == "echo":
            return dict(call.args)
        if call.verb == "take.file":
            self.making += 1
            try:
                for share in range(10):
                    self.server.tell_progress(page, call.id, "filming", share / 10)
                    await asyncio.sleep(0.005)
                await asyncio.sleep(60.0)
            finally:
                with self.came:
                    self.making -= 1
                    self.came.notify_all()
        raise ValueError(f"no such call: {call.verb}")

    def wait(self, condition: Callable[[], bool]) -> None:
        with self.came:
            assert self.came.wait_for(condition, 10.0)

    @property
    def origin(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def connect(self, **options: Any) -> Any:
        options.setdefault("origin", self.origin)
        return connect(f"ws://127.0.0.1:{self.port}/socket", max_size=None, **options)


def run(work: Awaitable[None]) -> None:
    async def limited() -> None:
        await asyncio.wait_for(work, 30.0)

    asyncio.run(limited())


async def hello(socket: ClientConnection, page: str = "aaaa1111", **fields: Any) -> dict[str, Any]:
    await socket.send(json.dumps({"t": "hello", "page": page, **fields}))
    return await told(socket, "welcome")


async def told(socket: ClientConnection, kind: str) -> dict[str, Any]:
    """The next text of a kind."""
    async for data in socket:
        if isinstance(data, str):
            message: dict[str, Any] = json.loads(data)
            if message["t"] == kind:
                return message
    raise AssertionError(f"closed before {kind} came")


async def closed(socket: ClientConnection) -> int:
    """Read until the end; the code that it was closed with, 1006 where the connection broke."""
    try:
        while True:
            await socket.recv()
    except ConnectionClosed as error:
        return error.rcvd.code if error.rcvd is not None else 1006


async def bundle(socket: ClientConnection) -> tuple[int, bytes]:
    """The next bundle: its number and the payload of its first part."""
    async for data in socket:
        if isinstance(data, bytes):
            number, _, _, _, length = struct.unpack_from("<IBBHI", data)
            return number, data[12 : 12 + length]
    raise AssertionError("closed before a bundle came")


def touch(**contact: Any) -> str:
    one = {"id": 1, "phase": "down", "x": 0.5, "y": 0.25, **contact}
    return json.dumps({"t": "input", "kind": "touch", "time": 12.5, "size_m": [0.3, 0.2], "contacts": [one]})


def pose(seq: int = 0) -> Pose:
    figure = default_figure()
    root, rotations = figure.rest_pose()
    return Pose(skeleton=figure.hash, root=root, rotations=rotations, seq=seq)


def get(house: House, path: str, **headers: str) -> Any:
    request = urllib.request.Request(f"{house.origin}{path}", headers=headers)
    return urllib.request.urlopen(request, timeout=10)
