"""The page server: files and sockets on one port, in a thread of its own that shares nothing but calls.

Streams (poses, camera, overlays) are kept newest-only by key and sent in bundles; a page acknowledges each bundle,
and no more than `WINDOW` are on their way to it, so a slow page or network gets the newest and never a queue.
"""

import asyncio
import contextlib
import logging
import os
import ssl
import threading
import time
from collections import deque
from collections.abc import Awaitable, Callable, Coroutine
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from bunraku.msgs.base import InvalidMessage
from bunraku.nodes.web.access import AccessError, Gate, TokenBucket, peer_user
from bunraku.nodes.web.answers import answer, refusal
from bunraku.nodes.web.files import Asset, Tickets
from bunraku.nodes.web.protocol import (
    MAX_TEXT,
    POSE,
    VERSION,
    Call,
    Hello,
    Input,
    Ping,
    decode_text,
    encode_text,
    pack_bundle,
    with_echo,
)

SOCKET = "/socket"
WINDOW = 3
"""Bundles on their way to one page."""
MAX_PAGES = 16
MAX_CONNECTIONS = 48
MAX_REPLIES = 64
LAST_WORDS = 0.3
"""s for the pages' goodbyes when the stage ends."""
HELLO_SECONDS = 5.0
MESSAGES = (600.0, 400.0)
"""A page's messages: a second, and at once."""
BYTES = (1.0e6, 1.0e6)
MAX_BROKEN = 50
KEPT_ORIGINS = 512
PATIENT = ("take.file",)
"""Calls that a page may cancel, and that end with it."""

CLOSE_REFUSED = 4003
CLOSE_REPLACED = 4001
CLOSE_VERSION = 4002
CLOSE_FULL = 4004
CLOSE_RATE = 1008


@dataclass(frozen=True)
class Hooks:
    """What the server tells its owner; called in the server's thread."""

    on_input: Callable[[str, str, Input, int], None]
    """Page, figure, what the hands did, and when it arrived (ns)."""
    on_gone: Callable[[str, str], None]
    """Page and figure: a page that played is not there any more."""
    on_call: Callable[[str, Call], Awaitable[dict[str, Any]]]
    """Carries a call out; raises `ValueError` with the reason for a refusal."""


@dataclass(eq=False)
class Page:
    """One connected page."""

    id: str
    socket: ServerConnection
    role: str
    figure: str
    streams: dict[str, tuple[int, int, bytes, int | None]] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)
    replies: deque[str] = field(default_factory=deque)
    wake: asyncio.Event = field(default_factory=asyncio.Event)
    sent: int = 0
    acked: int = 0
    dropped: int = 0
    making: dict[int, asyncio.Task[None]] = field(default_factory=dict)
    """Calls that go on for as long as the page waits for them."""

    @property
    def room(self) -> bool:
        return self.sent - self.acked < WINDOW


class PageServer:
    """Serves the page and its sockets until `stop`."""

    def __init__(
        self,
        hooks: Hooks,
        files: dict[str, Asset],
        gate: Gate,
        figures: tuple[str, ...] = ("",),
        log: logging.Logger | None = None,
        info: dict[str, Any] | None = None,
    ) -> None:
        self.hooks = hooks
        self.files = dict(files)
        self.gate = gate
        self.figures = figures
        self.log = log or logging.getLogger("web")
        self.info = info or {}
        self.tickets = Tickets()
        self.port = 0
        self.counts = {"broken": 0, "refused": 0, "flooded": 0}
        self._pages: dict[str, Page] = {}
        self._latched: dict[str, str] = {}
        self._streams: dict[str, tuple[int, int, bytes, int | None]] = {}
        self._origins: dict[int, tuple[str, float]] = {}
        self._connections = 0
        self._tasks: set[asyncio.Task[None]] = set()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name="web server", daemon=True)
        self._stopped: asyncio.Event | None = None

    # -- called by the owner, from any thread ------------------------------------------------------------------

    def start(self, host: str, port: int, tls: ssl.SSLContext | None = None) -> None:
        """Listen; raises `AccessError` where the port cannot be had. Port 0 takes any free one: see `port`."""
        if not self._thread.is_alive():
            self._thread.start()
        try:
            asyncio.run_coroutine_threadsafe(self._listen(host, port, tls), self._loop).result(30.0)
        except OSError as error:
            raise AccessError(f"cannot listen on {host}:{port} ({error.strerror}): choose another port") from None

    def stop(self) -> None:
        """Say goodbye to every page and end the thread."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._end)
            self._thread.join(5.0)

    def offer(self, key: str, kind: int, figure: int, payload: bytes, origin: int | None = None) -> None:
        """The newest of a stream for every page; later pages get it too."""
        self._soon(self._offer, key, (kind, figure, payload, origin))

    def tell(self, key: str, text: str) -> None:
        """A text that every page must have, the newest of its key; later pages get it too."""
        self._soon(self._tell, key, text)

    def tell_take(self, name: str) -> None:
        """Tell every page which take is being recorded; empty for none."""
        self.tell("take", encode_text("take", name=name))

    def tell_progress(self, page: str, call: int, what: str, share: float) -> None:
        """Tell a page how far its call is, 0..1; called in the server's thread."""
        one = self._pages.get(page)
        if one is not None and call in one.making:
            one.texts[f"progress {call}"] = encode_text("progress", id=call, what=what, share=share)
            one.wake.set()

    def put_file(self, path: str, file: Asset) -> None:
        """Serve one more file."""
        self._soon(self.files.__setitem__, path, file)

    # -- the thread ----------------------------------------------------------------------------------------------

    def _soon(self, function: Callable[..., Any], *args: Any) -> None:
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(function, *args)

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_forever()
        finally:
            self._loop.run_until_complete(self._loop.shutdown_asyncgens())
            self._loop.close()

    async def _listen(self, host: str, port: int, tls: ssl.SSLContext | None) -> None:
        quiet = logging.getLogger("bunraku.web.sockets")
        quiet.setLevel(logging.CRITICAL)
        server: Server = await serve(
            self._converse, host, port, ssl=tls, process_request=self._request, server_header=None, compression=None,
            max_size=MAX_TEXT, max_queue=32, write_limit=16 << 10, open_timeout=5, close_timeout=2,
            ping_interval=5, ping_timeout=10, logger=quiet,
        )  # fmt: skip
        self.port = next(iter(server.sockets)).getsockname()[1]
        self._stopped = asyncio.Event()
        self._tasks.add(asyncio.ensure_future(self._serve_until_stopped(server)))

    async def _serve_until_stopped(self, server: Server) -> None:
        assert self._stopped is not None
        await self._stopped.wait()
        server.close(code=1001, reason="the stage is closing")
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(server.wait_closed(), LAST_WORDS)
        left = asyncio.all_tasks() - {asyncio.current_task()}
        for task in left:
            task.cancel()
        if left:
            await asyncio.wait(left, timeout=LAST_WORDS)
        self._loop.stop()

    def _end(self) -> None:
        if self._stopped is None:
            self._loop.stop()
        else:
            self._stopped.set()

    # -- http ------------------------------------------------------------------------------------------------------

    def _request(self, connection: ServerConnection, request: Request) -> Response | None:
        host = request.headers.get("Host")
        path = request.path.partition("?")[0]
        if not self.gate.host_ok(host):
            return self._refuse(HTTPStatus.FORBIDDEN, "open the page under the address that the stage printed\n")
        if path == SOCKET:
            if not self.gate.origin_ok(request.headers.get("Origin"), host):
                return self._refuse(HTTPStatus.FORBIDDEN, "only this server's own page may connect\n")
            if self._connections >= MAX_CONNECTIONS:
                return self._refuse(HTTPStatus.SERVICE_UNAVAILABLE, "too many connections\n")
            if not self.gate.token and self._is_other_user(connection):
                return self._refuse(HTTPStatus.FORBIDDEN, "this stage belongs to another user of this machine\n")
            return None
        ticket = path.startswith("/ticket/")
        file = self.tickets.take(self._loop.time(), path) if ticket else self.files.get(path)
        if file is None:
            return answer(HTTPStatus.NOT_FOUND, Asset(b"no such file\n", "text/plain"), request, self.gate.scheme)
        if file.etag and request.headers.get("If-None-Match") == file.etag:
            return answer(HTTPStatus.NOT_MODIFIED, Asset(b"", file.type, etag=file.etag), request, self.gate.scheme)
        return answer(HTTPStatus.OK, file, request, self.gate.scheme)

    def _refuse(self, status: HTTPStatus, text: str) -> Response:
        self.counts["refused"] += 1
        return refusal(status, text)

    def _is_other_user(self, connection: ServerConnection) -> bool:
        peer = connection.remote_address
        if not isinstance(peer, tuple) or ":" in str(peer[0]) or not hasattr(os, "getuid"):
            return False
        user = peer_user((peer[0], peer[1]), self.port)
        return user is not None and user not in (os.getuid(), 0)

    # -- sockets ----------------------------------------------------------------------------------------------------

    async def _converse(self, socket: ServerConnection) -> None:
        self._connections += 1
        page: Page | None = None
        try:
            page = await self._welcome(socket)
            if page is not None:
                sender = asyncio.ensure_future(self._send_all(page))
                try:
                    await self._hear_all(page)
                finally:
                    sender.cancel()
        except (ConnectionClosed, TimeoutError, asyncio.CancelledError):
            pass
        finally:
            self._connections -= 1
            for task in page.making.values() if page is not None else ():
                task.cancel()
            if page is not None and self._pages.get(page.id) is page:
                del self._pages[page.id]
                self._release(page)
                self._tell_stage()

    async def _welcome(self, socket: ServerConnection) -> Page | None:
        text = await asyncio.wait_for(socket.recv(), HELLO_SECONDS)
        try:
            hello = decode_text(text)
        except InvalidMessage:
            hello = None
        if not isinstance(hello, Hello) or not self.gate.token_ok(hello.token):
            self.counts["refused"] += 1
            await socket.close(CLOSE_REFUSED, "open the page by the link that the stage printed")
            return None
        if hello.version != VERSION:
            await socket.close(CLOSE_VERSION, "this page is of another version: load it again")
            return None
        old = self._pages.get(hello.page)
        if old is None and len(self._pages) >= MAX_PAGES:
            await socket.close(CLOSE_FULL, f"{MAX_PAGES} pages are here already")
            return None
        if old is not None:
            self._release(old)
            self._spawn(old.socket.close(CLOSE_REPLACED, "the same page has come again"))
        page = Page(hello.page, socket, "watch", hello.figure if hello.figure in self.figures else self.figures[0])
        self._pages[page.id] = page
        self._cast(page, hello.role)
        page.replies.append(encode_text("welcome", page=page.id, version=VERSION, figures=self.figures, info=self.info))
        page.texts.update(self._latched)
        page.streams.update(self._streams)
        self._tell_stage()
        page.wake.set()
        return page

    def _cast(self, page: Page, role: str) -> None:
        """Give a page its part: with ``auto`` the first page of a figure plays and the others watch."""
        taken = any(p is not page and p.role == "play" and p.figure == page.figure for p in self._pages.values())
        page.role = ("watch" if taken else "play") if role == "auto" else role

    def _release(self, page: Page) -> None:
        if page.role == "play":
            page.role = "gone"
            self.hooks.on_gone(page.id, page.figure)

    def _tell_stage(self) -> None:
        """Tell every page who is here; each also hears what it is itself."""
        pages = [{"page": p.id, "role": p.role, "figure": p.figure} for p in self._pages.values()]
        for page in self._pages.values():
            page.texts["stage"] = encode_text("stage", pages=pages, role=page.role, figure=page.figure)
            page.wake.set()

    async def _hear_all(self, page: Page) -> None:
        messages, volume = TokenBucket(*MESSAGES), TokenBucket(*BYTES)
        broken = 0
        async for data in page.socket:
            now = time.monotonic()
            if not messages.take(now) or not volume.take(now, len(data)):
                self.counts["flooded"] += 1
                self.log.warning("page %s sends too much: disconnected", page.id)
                await page.socket.close(CLOSE_RATE, "too many messages")
                return
            if isinstance(data, bytes):
                if len(data) == 4:
                    number = int.from_bytes(data, "little")
                    if page.acked < number <= page.sent:
                        page.acked = number
                        page.wake.set()
                continue
            try:
                message = decode_text(data)
            except InvalidMessage as error:
                broken += 1
                self.counts["broken"] += 1
                if broken == 1:
                    self.log.warning("page %s sent what is no message (dropped): %s", page.id, error)
                if broken > MAX_BROKEN:
                    await page.socket.close(1007, "too many broken messages")
                    return
                continue
            self._take(page, message)

    def _take(self, page: Page, message: Hello | Input | Call | Ping) -> None:
        match message:
            case Input() if page.role == "play":
                received = time.time_ns()
                self._origins[received] = (page.id, message.time)
                while len(self._origins) > KEPT_ORIGINS:
                    del self._origins[next(iter(self._origins))]
                self.hooks.on_input(page.id, page.figure, message, received)
            case Ping():
                self._reply(page, encode_text("pong", time=message.time, server=time.time_ns() / 1e6))
            case Call(verb="role"):
                self._change_part(page, message)
            case Call(verb="cancel"):
                task = page.making.get(message.args.get("id", -1))
                if task is not None:
                    task.cancel()
                self._reply(page, encode_text("reply", id=message.id, ok=True, data={"cancelled": task is not None}))
            case Call():
                task = self._spawn(self._carry_out(page, message))
                if message.verb in PATIENT:
                    page.making[message.id] = task
            case _:
                pass

    def _change_part(self, page: Page, call: Call) -> None:
        role, figure = call.args.get("role", page.role), call.args.get("figure", page.figure)
        if role not in ("auto", "play", "watch") or figure not in self.figures:
            self._reply(page, encode_text("reply", id=call.id, ok=False, error="no such part"))
            return
        self._release(page)
        page.figure = figure
        self._cast(page, role)
        self._reply(page, encode_text("reply", id=call.id, ok=True, data={"role": page.role, "figure": figure}))
        self._tell_stage()

    async def _carry_out(self, page: Page, call: Call) -> None:
        try:
            data = await self.hooks.on_call(page.id, call)
            reply = encode_text("reply", id=call.id, ok=True, data=data)
        except (ValueError, TypeError, OSError, TimeoutError) as error:
            reply = encode_text("reply", id=call.id, ok=False, error=str(error) or type(error).__name__)
        except asyncio.CancelledError:
            reply = encode_text("reply", id=call.id, ok=False, error="cancelled")
        page.making.pop(call.id, None)
        page.texts.pop(f"progress {call.id}", None)
        self._reply(page, reply)

    def _reply(self, page: Page, text: str) -> None:
        if len(page.replies) < MAX_REPLIES:
            page.replies.append(text)
            page.wake.set()

    def _spawn(self, work: Coroutine[Any, Any, None]) -> "asyncio.Task[None]":
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    def _offer(self, key: str, item: tuple[int, int, bytes, int | None]) -> None:
        self._streams[key] = item
        for page in self._pages.values():
            if key in page.streams:
                page.dropped += 1
            page.streams[key] = item
            page.wake.set()

    def _tell(self, key: str, text: str) -> None:
        if self._latched.get(key) == text:
            return
        self._latched[key] = text
        for page in self._pages.values():
            page.texts[key] = text
            page.wake.set()

    async def _send_all(self, page: Page) -> None:
        try:
            while True:
                await page.wake.wait()
                page.wake.clear()
                while page.replies:
                    await page.socket.send(page.replies.popleft())
                while page.texts:
                    key = next(iter(page.texts))
                    await page.socket.send(page.texts.pop(key))
                if page.streams and page.room:
                    streams, page.streams = page.streams, {}
                    page.sent += 1
                    await page.socket.send(pack_bundle(page.sent, [self._part(page, s) for s in streams.values()]))
        except ConnectionClosed:
            pass

    def _part(self, page: Page, stream: tuple[int, int, bytes, int | None]) -> tuple[int, int, bytes]:
        kind, figure, payload, origin = stream
        if kind == POSE and origin is not None:
            source = self._origins.get(origin)
            if source is not None and source[0] == page.id:
                payload = with_echo(payload, source[1])
        return kind, figure, payload
