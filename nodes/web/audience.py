"""The pages that are connected: who plays, what each of them hears and may say.

Streams (poses, camera, overlays) are kept newest-only by key and sent in bundles; a page acknowledges each bundle,
and no more than `WINDOW` are on their way to it, so a slow page or network gets the newest and never a queue.
"""

import asyncio
import logging
import time
from collections import deque
from collections.abc import Awaitable, Callable, Coroutine
from dataclasses import dataclass, field
from typing import Any

from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from bunraku.msgs.base import InvalidMessage
from bunraku.nodes.web.access import TokenBucket
from bunraku.nodes.web.protocol import (
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

WINDOW = 3
"""Bundles on their way to one page."""
MAX_PAGES = 16
MAX_REPLIES = 64
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

Stream = tuple[int, int, bytes, int | None]
"""Kind, figure, payload and the origin of what it stems from."""


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
    streams: dict[str, Stream] = field(default_factory=dict)
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


class Audience:
    """All of them; everything here runs in the server's thread."""

    def __init__(self, hooks: Hooks, figures: tuple[str, ...], log: logging.Logger, info: dict[str, Any]) -> None:
        self.hooks = hooks
        self.figures = figures
        self.log = log
        self.info = info
        self.counts = {"broken": 0, "flooded": 0}
        self._pages: dict[str, Page] = {}
        self._latched: dict[str, str] = {}
        self._streams: dict[str, Stream] = {}
        self._origins: dict[int, tuple[str, float]] = {}
        self._tasks: set[asyncio.Task[None]] = set()

    def offer(self, key: str, item: Stream) -> None:
        """The newest of a stream for every page; later pages get it too."""
        self._streams[key] = item
        for page in self._pages.values():
            if key in page.streams:
                page.dropped += 1
            page.streams[key] = item
            page.wake.set()

    def tell(self, key: str, text: str) -> None:
        """A text that every page must have, the newest of its key; later pages get it too."""
        if self._latched.get(key) == text:
            return
        self._latched[key] = text
        for page in self._pages.values():
            page.texts[key] = text
            page.wake.set()

    def tell_progress(self, page: str, call: int, what: str, share: float) -> None:
        """Tell a page how far its call is, 0..1."""
        one = self._pages.get(page)
        if one is not None and call in one.making:
            one.texts[f"progress {call}"] = encode_text("progress", id=call, what=what, share=share)
            one.wake.set()

    async def converse(self, socket: ServerConnection, lets_in: Callable[[str], bool]) -> None:
        """One connection from its first word to its end; ``lets_in`` judges the token."""
        page: Page | None = None
        try:
            page = await self._welcome(socket, lets_in)
            if page is not None:
                sender = asyncio.ensure_future(self._send_all(page))
                try:
                    await self._hear_all(page)
                finally:
                    sender.cancel()
        except (ConnectionClosed, TimeoutError, asyncio.CancelledError):
            pass
        finally:
            for task in page.making.values() if page is not None else ():
                task.cancel()
            if page is not None and self._pages.get(page.id) is page:
                del self._pages[page.id]
                self._release(page)
                self._tell_stage()

    async def _welcome(self, socket: ServerConnection, lets_in: Callable[[str], bool]) -> Page | None:
        text = await asyncio.wait_for(socket.recv(), HELLO_SECONDS)
        try:
            hello = decode_text(text)
        except InvalidMessage:
            hello = None
        if not isinstance(hello, Hello) or not lets_in(hello.token):
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

    def _part(self, page: Page, stream: Stream) -> tuple[int, int, bytes]:
        kind, figure, payload, origin = stream
        if kind == POSE and origin is not None:
            source = self._origins.get(origin)
            if source is not None and source[0] == page.id:
                payload = with_echo(payload, source[1])
        return kind, figure, payload
