"""The page server: files and sockets on one port, in a thread of its own that shares nothing but calls."""

import asyncio
import contextlib
import logging
import os
import ssl
import threading
from collections.abc import Callable
from http import HTTPStatus
from typing import Any

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.http11 import Request, Response

from bunraku.nodes.web.access import AccessError, Gate, peer_user
from bunraku.nodes.web.answers import answer, refusal
from bunraku.nodes.web.audience import Audience, Hooks
from bunraku.nodes.web.files import Asset, Tickets
from bunraku.nodes.web.protocol import MAX_TEXT, encode_text

SOCKET = "/socket"
MAX_CONNECTIONS = 48
LAST_WORDS = 0.3
"""s for the pages' goodbyes when the stage ends."""


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
        self.files = dict(files)
        self.gate = gate
        self.figures = figures
        self.audience = Audience(hooks, figures, log or logging.getLogger("web"), info or {})
        self.tickets = Tickets()
        self.port = 0
        self._connections = 0
        self._serving: asyncio.Task[None] | None = None
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
        self._soon(self.audience.offer, key, (kind, figure, payload, origin))

    def tell(self, key: str, text: str) -> None:
        """A text that every page must have, the newest of its key; later pages get it too."""
        self._soon(self.audience.tell, key, text)

    def tell_take(self, name: str) -> None:
        """Tell every page which take is being recorded; empty for none."""
        self.tell("take", encode_text("take", name=name))

    def tell_progress(self, page: str, call: int, what: str, share: float) -> None:
        """Tell a page how far its call is, 0..1; called in the server's thread."""
        self.audience.tell_progress(page, call, what, share)

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
        self._serving = asyncio.ensure_future(self._serve_until_stopped(server))

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
            return refusal(HTTPStatus.FORBIDDEN, "open the page under the address that the stage printed\n")
        if path == SOCKET:
            if not self.gate.origin_ok(request.headers.get("Origin"), host):
                return refusal(HTTPStatus.FORBIDDEN, "only this server's own page may connect\n")
            if self._connections >= MAX_CONNECTIONS:
                return refusal(HTTPStatus.SERVICE_UNAVAILABLE, "too many connections\n")
            if not self.gate.token and self._is_other_user(connection):
                return refusal(HTTPStatus.FORBIDDEN, "this stage belongs to another user of this machine\n")
            return None
        ticket = path.startswith("/ticket/")
        file = self.tickets.take(self._loop.time(), path) if ticket else self.files.get(path)
        if file is None:
            return answer(HTTPStatus.NOT_FOUND, Asset(b"no such file\n", "text/plain"), request, self.gate.scheme)
        if file.etag and request.headers.get("If-None-Match") == file.etag:
            return answer(HTTPStatus.NOT_MODIFIED, Asset(b"", file.type, etag=file.etag), request, self.gate.scheme)
        return answer(HTTPStatus.OK, file, request, self.gate.scheme)

    def _is_other_user(self, connection: ServerConnection) -> bool:
        peer = connection.remote_address
        if not isinstance(peer, tuple) or ":" in str(peer[0]) or not hasattr(os, "getuid"):
            return False
        user = peer_user((peer[0], peer[1]), self.port)
        return user is not None and user not in (os.getuid(), 0)

    async def _converse(self, socket: ServerConnection) -> None:
        self._connections += 1
        try:
            await self.audience.converse(socket, self.gate.token_ok)
        finally:
            self._connections -= 1
