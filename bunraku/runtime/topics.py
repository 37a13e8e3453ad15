"""The two ends of a topic over ZeroMQ: one publisher that binds, readers that connect."""

import json
import os
from pathlib import Path
from typing import Any, cast

import zmq

from bunraku.msgs import TopicKind, schema
from bunraku.runtime.lock import Lock, Taken
from bunraku.runtime.names import endpoint, file_of

RECONNECT_MS = 20
SEND_HIGH_WATER = 200_000
"""Messages kept for one slow reader: memory has an end, a hiccup of seconds loses nothing."""
LINGER_MS = 200


def can_receive(socket: "zmq.Socket[bytes]") -> bool:
    """Whether a message waits (asking is far cheaper than a receive that finds nothing)."""
    return bool(cast(int, socket.getsockopt(zmq.EVENTS)) & zmq.POLLIN)


MARK = b"\xc1"
"""Begins the second subscription by which a raw ear tells its name; no MessagePack body begins so."""


class TopicTaken(RuntimeError):
    """Another publisher holds the topic; one line."""


def type_name(kind: TopicKind) -> str:
    """The name of the topic's type as cards tell it."""
    name: str = getattr(kind.type, "__name__", "")
    return name or " | ".join(part.__name__ for part in getattr(kind.type, "__args__", ()))


class TopicWriter:
    """Binds a topic's XPUB under its lock and lays the card beside it."""

    def __init__(self, context: "zmq.Context[Any]", folder: Path, topic: str, kind: TopicKind, node: str) -> None:
        self.topic, self.kind = topic, kind
        path = file_of(folder, topic)
        address = endpoint(path)
        try:
            self._lock = Lock(file_of(folder, topic, ".lock"))
        except Taken:
            holder = read_card(folder, topic).get("node", "another process")
            raise TopicTaken(
                f"topic {topic!r} is said by {holder} already: end that one, or remap or use a namespace"
            ) from None
        self._path, self._card = path, file_of(folder, topic, ".json")
        path.unlink(missing_ok=True)
        self.socket: zmq.Socket[bytes] = context.socket(zmq.XPUB)
        self.socket.setsockopt(zmq.XPUB_VERBOSER, 1)
        self.socket.setsockopt(zmq.SNDHWM, SEND_HIGH_WATER)
        self.socket.setsockopt(zmq.LINGER, LINGER_MS)
        self.socket.bind(address)
        self._last: bytes | None = None
        self.subscribers = 0
        self.ears: set[str] = set()
        """Names of the nodes that hear every body raw (recorders)."""
        card = {
            "topic": topic,
            "node": node,
            "pid": os.getpid(),
            "type": type_name(kind),
            "schema": schema(kind.type),
            "latched": kind.latched,
            "rate": kind.rate,
        }
        draft = self._card.with_suffix(f".json.{os.getpid()}")
        draft.write_text(json.dumps(card))
        draft.replace(self._card)

    def send(self, body: bytes) -> None:
        """Publish a body; a latched one is kept for later subscribers."""
        if self.kind.latched:
            self._last = body
        self.socket.send(body)

    def attend(self) -> None:
        """Take notice of subscribers that came or went; call when the socket can be read."""
        while can_receive(self.socket):
            notice = self.socket.recv()
            if notice[1:2] == MARK:
                name = notice[2:].decode(errors="replace")
                (self.ears.add if notice[:1] == b"\x01" else self.ears.discard)(name)
            elif notice[:1] == b"\x01":
                self.subscribers += 1
                if self._last is not None:
                    self.socket.send(self._last)
            elif notice[:1] == b"\x00":
                self.subscribers = max(0, self.subscribers - 1)

    def close(self) -> None:
        """Unbind and remove the files."""
        self.socket.close()
        self._path.unlink(missing_ok=True)
        self._card.unlink(missing_ok=True)
        self._lock.release()


class TopicReader:
    """Connects to a topic, before or after its publisher is there."""

    def __init__(
        self, context: "zmq.Context[Any]", folder: Path, topic: str, *, newest: bool = False, ear: str = ""
    ) -> None:
        self.topic = topic
        self.socket: zmq.Socket[bytes] = context.socket(zmq.SUB)
        if newest:
            self.socket.setsockopt(zmq.CONFLATE, 1)
        else:
            self.socket.setsockopt(zmq.RCVHWM, 0)
        # No MAXMSGSIZE here: libzmq would hang up on the publisher and never come back.
        self.socket.setsockopt(zmq.RECONNECT_IVL, RECONNECT_MS)
        self.socket.setsockopt(zmq.LINGER, 0)
        self.socket.setsockopt(zmq.SUBSCRIBE, b"")
        if ear:
            self.socket.setsockopt(zmq.SUBSCRIBE, MARK + ear.encode())
        self.socket.connect(endpoint(file_of(folder, topic)))

    def receive(self) -> bytes | None:
        """The next body, or None when nothing waits."""
        if can_receive(self.socket):
            frames = self.socket.recv_multipart()
            return frames[-1] if len(frames) == 1 else b""  # several frames are no message of ours
        return None

    def close(self) -> None:
        """Disconnect."""
        self.socket.close()


def read_card(folder: Path, topic: str) -> dict[str, Any]:
    """The card of a topic, empty where there is none."""
    try:
        card = json.loads(file_of(folder, topic, ".json").read_text())
    except (OSError, ValueError):
        return {}
    return card if isinstance(card, dict) else {}


def cards(folder: Path) -> dict[str, dict[str, Any]]:
    """All cards in the run folder, by topic."""
    found: dict[str, dict[str, Any]] = {}
    try:
        names = sorted(entry.name for entry in os.scandir(folder) if entry.name.endswith(".json"))
    except OSError:
        return {}
    for name in names:
        topic = name[: -len(".json")].replace(".", "/")
        card = read_card(folder, topic)
        if {"node", "pid", "type"} <= card.keys():
            found[topic] = card
    return found
