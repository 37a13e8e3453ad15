"""What a page may ask the stage to do: parameters, reset and takes, by the nodes' control sockets."""

import asyncio
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from bunraku.msgs import Params
from bunraku.nodes.web.files import MAX_DOWNLOAD
from bunraku.nodes.web.protocol import Call
from bunraku.nodes.web.server import PageServer
from bunraku.nodes.web.takes import Takes, export, read_track
from bunraku.runtime.control import NoAnswer, ask
from bunraku.runtime.names import file_of, resolve

KEPT_FROM_PAGES = ("web", "recorder", "bridge")
"""Nodes whose parameters name files, addresses and keys: a page sees them and cannot change them."""
WAYS = {"touch": "input_touch", "pen": "input_pen", "hands": "input_hand"}
"""Way of playing -> the node that hears it."""
EXPORTS_AT_ONCE = 2


class Calls:
    """Carries the pages' calls out, in the server's thread."""

    def __init__(self, folder: Path | None, takes: Takes, namespace: str = "") -> None:
        self.folder = folder
        self.takes = takes
        self.namespace = namespace
        self.server: PageServer | None = None
        self.params: dict[str, Params] = {}
        """Node -> its parameters, as the latched topics tell them."""
        self._exports = 0
        self._made: tempfile.TemporaryDirectory[str] | None = None

    def close(self) -> None:
        """Remove what was made for pages."""
        if self._made is not None:
            self._made.cleanup()

    async def __call__(self, page: str, call: Call) -> dict[str, Any]:
        """Answer one call; raises ValueError with the reason for a refusal."""
        verbs: dict[str, Callable[..., Any]] = {
            "nodes": self.nodes,
            "param": self.param,
            "reset": self.reset,
            "take.start": self.start,
            "take.stop": self.stop,
            "take.status": self.status,
            "take.list": self.list_takes,
            "take.track": self.track,
            "take.file": partial(self.file, partial(self._progress, page, call.id)),
        }
        if call.verb not in verbs:
            raise ValueError(f"no such call: {call.verb}")
        answer: dict[str, Any] = await verbs[call.verb](**call.args)
        return answer

    def settable(self, node: str, name: str) -> bool:
        """Whether a page may change a parameter: numbers, switches and choices, not free text or lists."""
        params = self.params.get(node)
        one = params.params.get(name) if params is not None else None
        if one is None or node.rpartition("/")[2] in KEPT_FROM_PAGES:
            return False
        return one.choices is not None or isinstance(one.value, (bool, int, float))

    def ways(self) -> list[str]:
        """The ways of playing that a device node of this stage hears from pages."""
        drivers = {node.rpartition("/")[2]: params.params.get("drivers") for node, params in self.params.items()}
        heard = {node for node, one in drivers.items() if one and isinstance(one.value, list) and "web" in one.value}
        return [way for way, node in WAYS.items() if node in heard]

    async def nodes(self) -> dict[str, Any]:
        """The nodes that run now, each with its parameters."""
        running = {node: params for node, params in sorted(self.params.items()) if self._runs(node)}
        return {
            "nodes": [
                {
                    "node": node,
                    "params": {
                        name: {
                            "value": one.value, "type": one.type, "doc": one.doc, "low": one.low, "high": one.high,
                            "choices": one.choices, "settable": self.settable(node, name),
                        }
                        for name, one in params.params.items()
                    },
                }
                for node, params in running.items()
            ]
        }  # fmt: skip

    async def param(self, node: str, name: str, value: Any) -> dict[str, Any]:
        """Change a parameter of a node."""
        if not isinstance(node, str) or not isinstance(name, str) or not self.settable(node, name):
            raise ValueError(f"{node}: {name} cannot be changed from a page; use `bunraku param set`")
        if not isinstance(value, (bool, int, float, str)):
            raise ValueError("a value is a number, a switch or a choice")
        reply = await self._ask(node, "param.set", name=name, value=value)
        return {"value": reply.get("params", {}).get(name, value)}

    async def reset(self) -> dict[str, Any]:
        """Every node that knows how takes the figure back to its beginning."""
        done = []
        for node in sorted(self.params):
            if not self._runs(node) or node.rpartition("/")[2] in KEPT_FROM_PAGES:
                continue
            info = await self._ask(node, "info")
            if "reset" in info["info"]["requests"]:
                await self._ask(node, "reset")
                done.append(node)
        if not done:
            raise ValueError("no node of this stage can be reset")
        return {"nodes": done}

    async def start(self) -> dict[str, Any]:
        """Begin a take."""
        recorder = self._recorder()
        path = await asyncio.to_thread(self.takes.new)
        await self._ask(recorder, "start", output=str(path.resolve()))
        self._tell_take(path.stem)
        return {"name": path.stem}

    async def stop(self) -> dict[str, Any]:
        """Complete the take."""
        reply = await self._ask(self._recorder(), "stop", seconds=10.0)
        self._tell_take("")
        return {"name": Path(str(reply.get("file", ""))).stem, "messages": reply.get("messages", 0)}

    async def status(self) -> dict[str, Any]:
        """Whether there is a recorder, and what it writes."""
        try:
            recorder = self._recorder()
        except ValueError as error:
            return {"recorder": False, "recording": False, "why": str(error)}
        reply = await self._ask(recorder, "status")
        return {
            "recorder": True,
            "recording": bool(reply.get("recording")),
            "name": Path(str(reply.get("file", ""))).stem,
            "messages": reply.get("messages", 0),
        }

    async def list_takes(self) -> dict[str, Any]:
        """The takes that are there."""
        return {"takes": await asyncio.to_thread(self.takes.listed)}

    async def track(self, name: str, figure: str = "") -> dict[str, Any]:
        """Where a page fetches a take's poses."""
        path = self.takes.find(name)
        made = await asyncio.to_thread(read_track, path, self._pose(figure))
        return {"url": self._ticket(made, f"{name}.bin")}

    async def file(
        self, progress: Callable[[str, float], object], /, name: str, format: str = "mcap", figure: str = ""
    ) -> dict[str, Any]:
        """Where a page fetches a take in a format."""
        path = self.takes.find(name)
        figures = [figure, *(one for one in self.server.figures if one != figure)] if self.server else [figure]
        topics = [self._pose(one) for one in figures]
        if self._exports >= EXPORTS_AT_ONCE:
            raise ValueError("other takes are being made ready: try again in a moment")
        self._exports += 1
        try:
            if self._made is None:
                self._made = tempfile.TemporaryDirectory(prefix="bunraku-takes-", ignore_cleanup_errors=True)
            made = await export(path, format, topics, Path(self._made.name), progress)
        finally:
            self._exports -= 1
        size = made.stat().st_size
        if size > MAX_DOWNLOAD:
            raise ValueError(f"{size >> 20} MiB are too much for a page: copy {made} from the stage's machine")
        return {"url": self._ticket(made, made.name, passing=made != path), "bytes": size}

    def _pose(self, figure: str) -> str:
        if self.server is not None and figure not in self.server.figures:
            raise ValueError("no such figure")
        return resolve(f"{figure}/pose" if figure else "pose", self.namespace)

    def _ticket(self, source: Any, filename: str, *, passing: bool = False) -> str:
        assert self.server is not None
        return self.server.tickets.add(asyncio.get_running_loop().time(), source, filename, passing=passing)

    def _progress(self, page: str, call: int, what: str, share: float) -> None:
        if self.server is not None:
            self.server.tell_progress(page, call, what, share)

    def _tell_take(self, name: str) -> None:
        if self.server is not None:
            self.server.tell_take(name)

    def _runs(self, node: str) -> bool:
        return self.folder is not None and file_of(self.folder, node, ".ctl").exists()

    def _recorder(self) -> str:
        for node in sorted(self.params):
            if node.rpartition("/")[2] == "recorder" and self._runs(node):
                return node
        raise ValueError("no recorder on this stage: launch with record:=true, or start `bunraku run recorder`")

    async def _ask(self, node: str, operation: str, *, seconds: float = 2.0, **arguments: Any) -> dict[str, Any]:
        if self.folder is None:
            raise ValueError("this stage has no control sockets")
        try:
            return await asyncio.to_thread(ask, self.folder, node, operation, seconds=seconds, **arguments)
        except NoAnswer as error:
            raise ValueError(str(error)) from None
