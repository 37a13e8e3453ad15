"""The tcp side of a bridge: bodies with their topics between one listener and its peers.

A connector greets once a second. The listener welcomes a peer that it does not know and sends it what is
latched; so does the connector when it is welcomed: both sides may start, end and come back in any order.
Frames: topic, ``L`` for latched or nothing, body; an empty topic marks a greeting (hello, welcome, alive).
"""

import contextlib
import ipaddress
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple, cast

import zmq
from zmq.utils import z85

from bunraku.msgs.base import MAX_BODY
from bunraku.nodes.bridge import keys as key_files

HELLO, WELCOME, ALIVE = b"hello", b"welcome", b"alive"
FORGET = 5.0
"""s after which a silent peer is gone."""
HIGH_WATER = 2_000
"""Messages kept for a slow link."""
PEERS = 64
ZAP = "inproc://zeromq.zap.01"


class LinkProblem(ValueError):
    """A link that cannot be made; one line with the remedy."""


class Carried(NamedTuple):
    """A body on its way."""

    topic: str
    latched: bool
    body: bytes


def address_of(text: str) -> tuple[str, bool]:
    """The ZeroMQ endpoint that an address means, and whether it stays on this machine.

    ``host:port``, ``tcp://host:port`` or a port alone (on 127.0.0.1); the host ``*`` is every one of this machine's.
    """
    match = re.fullmatch(r"(?:tcp://)?(?:(\*|\[[0-9a-fA-F:.]+\]|[A-Za-z0-9_.-]+):)?(\d{1,5})", text.strip())
    if match is None or int(match[2]) > 65535:
        raise LinkProblem(f"address {text!r}: write host:port, as 127.0.0.1:7447")
    host, port = match[1] or "127.0.0.1", int(match[2])
    local = host == "localhost"
    with contextlib.suppress(ValueError):
        local = ipaddress.ip_address(host.strip("[]")).is_loopback
    return f"tcp://{host}:{port or '*'}", local


class Link:
    """One end of a bridge. Not thread-safe; wake up when `fileno` can be read and call `receive`."""

    def __init__(self, *, listen: str = "", connect: str = "", keys: str = "") -> None:
        """Bind or connect; raises `LinkProblem` or `key_files.KeyProblem`."""
        if bool(listen) == bool(connect):
            raise LinkProblem("give one of listen and connect: listen:=host:port here, connect:=host:port there")
        self.listening = bool(listen)
        self.given = listen or connect
        address, local = address_of(self.given)
        if not keys and not local:
            raise LinkProblem(
                f"{'listen' if listen else 'connect'}: {self.given} without keys: anybody on the network could read "
                "and move the figure; write keys with `bunraku keys DIR` and give keys:=DIR, or use 127.0.0.1"
            )
        self.latched: dict[str, Carried] = {}
        self.peers: dict[bytes, float] = {}
        """Who is there and when it was heard last; the connector's one peer is b''."""
        self.denied = 0
        self._allowed: frozenset[bytes] = frozenset()
        self._greet_at = -1.0
        self._now = 0.0
        self._context: zmq.Context[Any] = zmq.Context()
        self._zap: zmq.Socket[bytes] | None = None
        self._socket: zmq.Socket[bytes] = self._context.socket(zmq.ROUTER if self.listening else zmq.DEALER)
        try:
            self._options(local)
            if keys:
                self._secure(Path(keys).expanduser())
            if self.listening:
                self._socket.bind(address)
            else:
                self._socket.connect(address)
        except zmq.ZMQError as error:
            self.close()
            raise LinkProblem(f"{self.given}: {error.strerror or error}; choose another address or port") from None
        except ValueError:
            self.close()
            raise

    def _options(self, local: bool) -> None:
        for option, value in (
            (zmq.LINGER, 200),
            (zmq.SNDHWM, HIGH_WATER),
            (zmq.RCVHWM, HIGH_WATER),
            (zmq.MAXMSGSIZE, MAX_BODY),
            (zmq.RECONNECT_IVL, 100),
            (zmq.RECONNECT_IVL_MAX, 2000),
            (zmq.HEARTBEAT_IVL, 1000),
            (zmq.HEARTBEAT_TIMEOUT, 4000),
            (zmq.IPV6, int("[" in self.given)),
        ):
            self._socket.setsockopt(option, value)

    def _secure(self, folder: Path) -> None:
        if not zmq.has("curve"):
            raise LinkProblem("this pyzmq was built without CURVE: pip install --force-reinstall pyzmq")
        if self.listening:
            pair, self._allowed = key_files.listener(folder)
            self._zap = self._context.socket(zmq.ROUTER)
            self._zap.setsockopt(zmq.LINGER, 0)
            self._zap.bind(ZAP)
            self._socket.setsockopt(zmq.CURVE_SERVER, 1)
            self._socket.setsockopt(zmq.ZAP_DOMAIN, b"bunraku")
        else:
            pair, server = key_files.connector(folder)
            self._socket.setsockopt(zmq.CURVE_SERVERKEY, server)
        self._socket.setsockopt(zmq.CURVE_PUBLICKEY, pair.public)
        self._socket.setsockopt(zmq.CURVE_SECRETKEY, pair.secret)

    @property
    def endpoint(self) -> str:
        """Where it listens, with the port that the system chose; what it connects to."""
        return cast(bytes, self._socket.getsockopt(zmq.LAST_ENDPOINT)).rstrip(b"\0").decode()

    @property
    def filenos(self) -> list[int]:
        """Descriptors that become readable (edge-triggered) when `receive` may have something to do."""
        sockets = [self._socket, *([self._zap] if self._zap else [])]
        return [cast(int, one.getsockopt(zmq.FD)) for one in sockets]

    def send(self, topic: str, body: bytes, *, latched: bool = False) -> None:
        """Hand a body to every peer; a latched one also to those that come later."""
        carried = Carried(topic, latched, body)
        if latched:
            self.latched[topic] = carried
        for peer in self.peers:
            self._put(peer, carried)

    def receive(self) -> Iterator[Carried]:
        """All that has come; answers greetings on the way."""
        while True:
            self._judge()
            if not _waits(self._socket):
                return
            frames = self._socket.recv_multipart()
            peer = frames.pop(0) if self.listening else b""
            if len(frames) != 3:
                continue
            name, mark, body = frames
            if not name:
                self._greeted(peer, body)
            elif peer in self.peers:
                with contextlib.suppress(UnicodeDecodeError):
                    yield Carried(name.decode(), mark == b"L", body)

    def keep(self, now: float) -> None:
        """Call a few times a second with a steady clock (s): greets, and forgets who is gone."""
        self._now = now
        if not self.listening and now - self._greet_at >= 1.0:
            self._greet_at = now
            self._send([b"", b"", HELLO])
        for peer in [one for one, heard in self.peers.items() if now - heard > FORGET]:
            del self.peers[peer]

    def close(self) -> None:
        """Let go of the port."""
        self._socket.close()
        if self._zap is not None:
            self._zap.close()
        self._context.term()

    def _greeted(self, peer: bytes, word: bytes) -> None:
        known = peer in self.peers
        if self.listening:
            if word != HELLO or (not known and len(self.peers) >= PEERS):
                return
            self._send([peer, b"", b"", ALIVE if known else WELCOME])
        elif word not in (WELCOME, ALIVE):
            return
        self.peers[peer] = self._now
        if not known or word == WELCOME:
            for carried in self.latched.values():
                self._put(peer, carried)

    def _put(self, peer: bytes, carried: Carried) -> None:
        frames = [carried.topic.encode(), b"L" if carried.latched else b"", carried.body]
        self._send([peer, *frames] if self.listening else frames)

    def _send(self, frames: list[bytes]) -> None:
        with contextlib.suppress(zmq.Again):  # a link that cannot keep up loses messages; `seq` tells readers
            self._socket.send_multipart(frames, zmq.DONTWAIT)

    def _judge(self) -> None:
        """Let in whose public key is known (ZeroMQ authentication protocol, RFC 27)."""
        while self._zap is not None and _waits(self._zap):
            *envelope, version, request, _, _, _, mechanism, credential = self._zap.recv_multipart()
            known = mechanism == b"CURVE" and z85.encode(credential) in self._allowed
            self.denied += not known
            answer = [b"200", b"OK"] if known else [b"400", b"unknown key"]
            self._zap.send_multipart([*envelope, version, request, *answer, b"", b""])


def _waits(socket: "zmq.Socket[bytes]") -> bool:
    return bool(cast(int, socket.getsockopt(zmq.EVENTS)) & zmq.POLLIN)
