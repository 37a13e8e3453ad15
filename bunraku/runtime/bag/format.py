"""What a bag holds: channels, entries, the header that every body carries, and the counting of gaps."""

import importlib.metadata
import json
import platform
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple, Self

import msgspec

from bunraku.msgs.system import Raw
from bunraku.msgs.topics import TOPICS, TopicKind, kind_of
from bunraku.runtime.topics import type_name

PROFILE = "bunraku"
ENCODING = "msgpack"
SCHEMA_ENCODING = "jsonschema"
SESSION = "bunraku.session"
"""Name of the metadata record at the beginning: the machine and the libraries."""
STATISTICS = "bunraku.statistics"
"""Name of the metadata record at the end: one JSON object a topic."""
NS = 1_000_000_000


class BagError(Exception):
    """A file that cannot be read or written; one line with the remedy."""


class Header(msgspec.Struct):
    """The part of a body that every message has."""

    stamp: int | None = None
    origin: int | None = None
    seq: int | None = None


class Entry(NamedTuple):
    """One recorded message."""

    topic: str
    received: int
    """ns since the Unix epoch, when the recorder took it."""
    body: bytes


@dataclass(frozen=True)
class Channel:
    """One topic of a bag."""

    topic: str
    type: str = ""
    """Name of the message type; empty where none is known."""
    schema: bytes = b""
    """JSON Schema; empty where no type is known."""
    latched: bool = False
    node: str = ""
    """The node that said it; empty where the recorder did not learn it."""


def channel_for(topic: str, node: str = "") -> Channel:
    """The channel of a topic by the table of topics."""
    kind = kind_of(topic)
    if kind is None or kind.type is Raw:
        return Channel(topic, node=node)
    from bunraku.msgs.base import schema

    return Channel(topic, type_name(kind), json.dumps(schema(kind.type)).encode(), kind.latched, node)


def kind_for(channel: Channel) -> TopicKind:
    """How a channel's messages are typed and kept: by its name, else (a remapped topic) by its type."""
    kind = kind_of(channel.topic)
    if kind is None:
        named = (one for one in TOPICS.values() if channel.type and type_name(one) == channel.type)
        kind = next(named, TopicKind(Raw))
    return replace(kind, latched=channel.latched)


_headers = msgspec.msgpack.Decoder(Header)
_maps = msgspec.msgpack.Decoder(dict[str, msgspec.Raw])
_encode = msgspec.msgpack.Encoder().encode
NO_HEADER = Header()
LARGEST = 2**63 - 1


def header(body: bytes) -> Header:
    """The header of a body; all None where the body is no message."""
    try:
        return _headers.decode(body)
    except (msgspec.MsgspecError, ValueError, RecursionError):
        return NO_HEADER


def shifted(body: bytes, offset: int) -> bytes:
    """The body with `stamp` and `origin` moved by `offset` ns, everything else as it is, also what is no message."""
    try:
        fields = _maps.decode(body)
    except (msgspec.MsgspecError, ValueError, RecursionError):
        return body
    changed = False
    for key in ("stamp", "origin"):
        raw = fields.get(key)
        if raw is None:
            continue
        value = msgspec.msgpack.decode(raw)
        if isinstance(value, int) and not isinstance(value, bool):
            fields[key] = msgspec.Raw(_encode(min(max(value + offset, 0), LARGEST)))
            changed = True
    return _encode(fields) if changed else body


@dataclass
class TopicStats:
    """What was heard of one topic."""

    count: int = 0
    bytes: int = 0
    first: int | None = None
    """ns, receive time of the first message."""
    last: int | None = None
    gaps: int = 0
    """Messages that a hole in `seq` says are missing."""
    restarts: int = 0
    """How often `seq` fell: the publisher began again."""
    repeats: int = 0
    """Messages with the `seq` of the one before: latched ones, sent again."""
    invalid: int = 0
    """Bodies without a readable header."""
    seq: int | None = field(default=None, repr=False)

    def add(self, received: int, size: int, seq: int | None) -> None:
        """Count one message."""
        self.count += 1
        self.bytes += size
        if self.first is None or received < self.first:
            self.first = received
        if self.last is None or received > self.last:
            self.last = received
        if seq is None:
            self.invalid += 1
            return
        if self.seq is not None:
            if seq < self.seq:
                self.restarts += 1
            elif seq == self.seq:
                self.repeats += 1
            else:
                self.gaps += seq - self.seq - 1
        self.seq = seq

    @property
    def rate(self) -> float | None:
        """Messages a second between the first and the last; None for less than two moments."""
        if self.count < 2 or self.first is None or self.last is None or self.last <= self.first:
            return None
        return (self.count - 1) * NS / (self.last - self.first)

    def as_dict(self) -> dict[str, Any]:
        """The counts as plain data."""
        data = asdict(self)
        del data["seq"]
        return data

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Self:
        """The counts from plain data."""
        return cls(**{key: data[key] for key in cls().as_dict() if key in data})


def machine() -> dict[str, str]:
    """What decides whether the same sums come out to the last bit: processor, interpreter, numeric libraries."""
    found = {"machine": platform.machine(), "processor": _processor(), "python": platform.python_version()}
    for package in ("bunraku", "numpy", "numba", "scipy"):
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            found[package] = ""
    return found


def _processor() -> str:
    """Name, family and model of the first processor, where the system says them."""
    told: dict[str, str] = {}
    try:
        for line in Path("/proc/cpuinfo").read_text(errors="replace").splitlines():
            key, _, value = line.partition(":")
            told.setdefault(key.strip(), value.strip())
    except OSError:
        return platform.processor()
    keys = ("model name", "cpu family", "model", "Model", "CPU part")
    return " ".join(told[key] for key in keys if told.get(key)) or platform.processor()
