"""TUIO 1.1: datagrams of the profiles 2Dcur and 2Dblb to frames of fingers (Kaltenbrunner et al. 2005).

Each datagram is an OSC bundle for one profile of one frame: who says it (`source`), all session ids that are alive
(`alive`), the ones that changed (`set`), and the frame's number (`fseq`). A frame may come in several bundles of one
number, and in a datagram for each profile; datagrams get lost and overtake each other.
"""

import math
from dataclasses import dataclass, field
from typing import Any

from pythonosc.osc_bundle import OscBundle
from pythonosc.osc_message import OscMessage

from bunraku.nodes.input_touch.frame import Frame, Sample

PROFILES = ("/tuio/2Dcur", "/tuio/2Dblb")
OLD = 100
"""A frame number lower by more than this is a sender that began anew, not a late datagram."""
TOGETHER = 0.5
"""s within which a profile was heard for its part of a frame to be waited for."""
SAME = 0.05
"""Shares of the surface up to which a cursor and a blob of one session id are one finger."""
TOUCHING = 0.004
"""Shares up to which a cursor and a blob of different ids are one finger: two fingers are never that near."""
MOST = 64
SECOND = 1_000_000_000
_Place = tuple[float, ...]


class BadDatagram(ValueError):
    """A datagram that is no TUIO; says why."""


@dataclass
class _Message:
    """One datagram: a profile's part of a frame."""

    profile: str
    source: str = ""
    alive: list[int] = field(default_factory=list)
    sets: dict[int, tuple[float, ...]] = field(default_factory=dict)
    fseq: int = -1


def read(body: bytes) -> list[_Message]:
    """A datagram's parts, one a profile; raises `BadDatagram`."""
    try:
        messages = list(_flat(OscBundle(body), 0)) if OscBundle.dgram_is_bundle(body) else [OscMessage(body)]
    except BadDatagram:
        raise
    except Exception as error:  # the parser raises whatever the bytes lead it to
        raise BadDatagram(f"no OSC: {type(error).__name__}") from None
    parts: dict[str, _Message] = {}
    for one in messages:
        if one.address not in PROFILES:
            continue
        part = parts.setdefault(one.address, _Message(one.address))
        _take(part, list(one.params))
    if not parts and not any(str(one.address).startswith("/tuio") for one in messages):
        raise BadDatagram("an OSC message that is no TUIO")
    return list(parts.values())


def _flat(bundle: OscBundle, depth: int) -> Any:
    if depth > 4:
        raise BadDatagram("bundles in bundles")
    for one in bundle:
        if isinstance(one, OscBundle):
            yield from _flat(one, depth + 1)
        else:
            yield one


def _take(part: _Message, words: list[Any]) -> None:
    if not words or not isinstance(words[0], str):
        raise BadDatagram("a message without its command")
    command, rest = words[0], words[1:]
    if command == "source":
        part.source = str(rest[0])[:64] if rest else ""
    elif command == "alive":
        if not all(type(one) is int for one in rest):
            raise BadDatagram("alive: session ids must be integers")
        part.alive = rest
    elif command == "fseq":
        if len(rest) != 1 or type(rest[0]) is not int:
            raise BadDatagram("fseq: one integer expected")
        part.fseq = rest[0]
    elif command == "set":
        count = 5 if part.profile == PROFILES[0] else 11
        numbers = rest[1:]
        if not rest or type(rest[0]) is not int or len(numbers) < count:
            raise BadDatagram(f"set: a session id and {count} numbers expected")
        if not all(isinstance(one, (int, float)) and math.isfinite(one) for one in numbers):
            raise BadDatagram("set: values that are not finite numbers")
        part.sets[rest[0]] = tuple(float(one) for one in numbers)


@dataclass
class _Profile:
    """What is alive in one profile of one source."""

    fseq: int | None = None
    heard: int = 0
    alive: list[int] = field(default_factory=list)
    places: dict[int, tuple[float, ...]] = field(default_factory=dict)
    covered: set[int] = field(default_factory=set)
    """Ids that the frame in hand has told."""


@dataclass
class _Source:
    """One sender with its profiles and the fingers that they make."""

    device: str
    profiles: dict[str, _Profile] = field(default_factory=dict)
    heard: int = 0
    fingers: dict[tuple[str, int], int] = field(default_factory=dict)
    """(profile, session id) -> contact id; a cursor and a blob of one finger share it."""
    pending: int | None = None
    """When the first part of the frame in hand came, ns; None when it was said."""
    fseq: int | None = None
    next_id: int = 1 << 24


class TuioDecoder:
    """Datagrams in, frames out; knows nothing of sockets."""

    def __init__(self, size_m: tuple[float, float] | None = None) -> None:
        """``size_m``: width and height of the surface, without which ellipses have no lengths."""
        self.size_m = size_m
        self.sources: dict[str, _Source] = {}
        self.by_address: dict[str, str] = {}
        self.late = 0
        """Datagrams that came after a later one and were dropped."""

    def datagram(self, body: bytes, address: str, now: int) -> list[Frame]:
        """Take a datagram from ``address`` at ``now`` ns; gives the frames that it closes, none as long as its own
        frame may go on (see `waiting` and `flush`). Raises `BadDatagram`."""
        frames: list[Frame] = []
        for part in read(body):
            key = part.source or self.by_address.get(address, address)
            if part.source:
                self.by_address[address] = part.source
            source = self.sources.get(key)
            if source is None:
                if not part.alive:
                    continue  # an opening bundle: nothing is there yet
                source = self.sources[key] = _Source(f"tuio-{key}"[:100])
            frames += self._part(source, part, now)
        return frames

    def _part(self, source: _Source, part: _Message, now: int) -> list[Frame]:
        profile = source.profiles.setdefault(part.profile, _Profile())
        source.heard = profile.heard = now
        last = profile.fseq
        if part.fseq >= 0 and last is not None and part.fseq < last and last - part.fseq <= OLD:
            self.late += 1
            return []
        frames = []
        if source.pending is not None and (part.fseq != source.fseq or part.fseq < 0):
            frames.append(self._close(source))
        if source.pending is None:
            source.pending = now
            for one in source.profiles.values():
                one.covered = set()
        source.fseq = part.fseq
        if part.fseq >= 0:
            profile.fseq = part.fseq
        profile.alive = part.alive[:MOST]
        alive = set(profile.alive)
        for session, values in part.sets.items():
            if session in alive:
                profile.places[session] = values
                profile.covered.add(session)
        profile.places = {session: values for session, values in profile.places.items() if session in alive}
        if self._complete(source, now):
            frames.append(self._close(source))
        return frames

    def waiting(self) -> bool:
        """Whether a frame may still go on."""
        return any(source.pending is not None for source in self.sources.values())

    def flush(self, before: int) -> list[Frame]:
        """Close the frames whose first part came at or before ``before`` ns."""
        due = [one for one in self.sources.values() if one.pending is not None and one.pending <= before]
        return [self._close(one) for one in due]

    def silent(self, since: int) -> list[str]:
        """Forget the sources that were last heard before ``since`` ns; their devices."""
        gone = [key for key, source in self.sources.items() if source.heard < since]
        devices = [self.sources.pop(key).device for key in gone]
        self.by_address = {address: key for address, key in self.by_address.items() if key in self.sources}
        return devices

    def _complete(self, source: _Source, now: int) -> bool:
        """Whether nothing more of the frame can come: every profile told it, and every finger's place."""
        if source.fseq is None or source.fseq < 0:
            return len(source.profiles) == 1 and self._told(source)
        lately = [one for one in source.profiles.values() if now - one.heard < TOGETHER * SECOND]
        return all(one.fseq == source.fseq for one in lately) and self._told(source)

    def _told(self, source: _Source) -> bool:
        return all(one.covered >= set(one.alive) for one in source.profiles.values())

    def _close(self, source: _Source) -> Frame:
        origin, source.pending = source.pending, None
        cursors = source.profiles.get(PROFILES[0], _Profile()).places
        blobs = source.profiles.get(PROFILES[1], _Profile()).places
        present = [(PROFILES[0], key) for key in cursors] + [(PROFILES[1], key) for key in blobs]
        source.fingers = {key: finger for key, finger in source.fingers.items() if key in set(present)}
        for key in cursors:
            if (PROFILES[0], key) not in source.fingers:
                source.fingers[PROFILES[0], key] = self._join(source, key, cursors[key], PROFILES[1], blobs)
        for key in blobs:
            if (PROFILES[1], key) not in source.fingers:
                source.fingers[PROFILES[1], key] = self._join(source, key, blobs[key], PROFILES[0], cursors)
        live: dict[int, Sample] = {}
        for key, values in blobs.items():
            live[source.fingers[PROFILES[1], key]] = self._blob(values)
        for key, values in cursors.items():
            finger = source.fingers[PROFILES[0], key]
            shape = live.get(finger)
            x, y = _share(values[0]), _share(values[1])
            live[finger] = Sample(x, y) if shape is None else Sample(x, y, shape.major, shape.minor, shape.angle)
        return Frame(source.device, dict(sorted(live.items())), origin)

    def _join(
        self,
        source: _Source,
        session: int,
        place: tuple[float, ...],
        other: str,
        others: dict[int, tuple[float, ...]],
    ) -> int:
        """The contact id of a new session: that of the other profile's same finger, or one of its own."""
        best: tuple[float, int] | None = None
        for key, values in others.items():
            finger = source.fingers.get((other, key))
            away = math.hypot(values[0] - place[0], values[1] - place[1])
            limit = SAME if key == session else TOUCHING
            free = finger is not None and sum(one == finger for one in source.fingers.values()) == 1
            if free and finger is not None and away <= limit and (best is None or away < best[0]):
                best = (away, finger)
        if best is not None:
            return best[1]
        if session >= 0 and session not in source.fingers.values():
            return session
        source.next_id += 1
        return source.next_id

    def _blob(self, values: tuple[float, ...]) -> Sample:
        x, y, angle, w, h = values[:5]
        major = minor = turn = None
        if self.size_m is not None:
            wide, high = abs(w) * self.size_m[0], abs(h) * self.size_m[1]
            if high > wide:
                angle += math.pi / 2.0
            major, minor = min(max(wide, high), 1e3), min(wide, high, 1e3)
            turn = (angle + math.pi / 2.0) % math.pi - math.pi / 2.0
        return Sample(_share(x), _share(y), major, minor, turn)


def _share(value: float) -> float:
    """Within what a touch message carries."""
    return min(2.0, max(-1.0, value))
