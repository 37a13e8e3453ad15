"""Hearing a topic from the command line: bodies as they come, their rate, size and delay."""

import itertools
import sys
import time
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgpack
import zmq

from bunraku.cli import Problem
from bunraku.runtime import graph
from bunraku.runtime.names import check_topic, make_run_folder
from bunraku.runtime.topics import TopicReader

NS = 1_000_000_000


def bodies(
    folder: Path, topic: str, *, period: float | None = None, timeout: float | None = None
) -> Iterator[tuple[int, bytes | None]]:
    """Every body of a topic with the time it came (ns); with ``period``, None at each of its ends as well.

    Says on stderr that it waits when nobody says the topic; raises `Problem` when nothing came in ``timeout`` s.
    """
    check_topic(topic)
    make_run_folder(folder)
    if not any(one.name == topic for one in graph.topics(folder)):
        print(f"waiting for {topic!r}: nobody says it yet (bunraku topic list shows what is said)", file=sys.stderr)
    context: zmq.Context[Any] = zmq.Context()
    reader = TopicReader(context, folder, topic)
    begun = time.monotonic()
    due = begun + (period or 0.0)
    heard = False
    try:
        while True:
            now = time.monotonic()
            if timeout is not None and not heard and now - begun > timeout:
                raise Problem(f"{topic}: nothing came in {timeout:g} s; see bunraku topic info {topic}")
            if period is not None and now >= due:
                due += period * (1 + (now - due) // period)
                yield time.time_ns(), None
            limits = [1.0]
            if period is not None:
                limits.append(due - now)
            if timeout is not None and not heard:
                limits.append(begun + timeout - now)
            if reader.socket.poll(max(1, round(min(limits) * 1000))):
                # take what waits, but let no flood keep a report from coming
                while (body := reader.receive()) is not None:
                    heard = True
                    yield time.time_ns(), body
                    if period is not None and time.monotonic() >= due:
                        break
    finally:
        reader.close()
        context.term()


def header(body: bytes) -> tuple[int | None, int | None, int | None]:
    """The `stamp`, `origin` and `seq` of a body; None for what is not there."""
    try:
        value = msgpack.unpackb(body)
    except (ValueError, msgpack.UnpackException):
        return None, None, None
    if not isinstance(value, dict):
        return None, None, None
    found = [value.get(key) for key in ("stamp", "origin", "seq")]
    stamp, origin, seq = (one if isinstance(one, int) else None for one in found)
    return stamp, origin, seq


@dataclass
class Window:
    """What came in the last seconds, and the gaps of the sequence since the beginning."""

    seconds: float = 5.0
    times: deque[int] = field(default_factory=deque)
    sizes: deque[int] = field(default_factory=deque)
    delays: deque[tuple[int | None, int | None]] = field(default_factory=deque)
    """(stamp - origin, arrival - stamp) ns."""
    count: int = 0
    lost: int = 0
    restarts: int = 0
    last_seq: int | None = None

    def add(self, now: int, body: bytes) -> None:
        """Count a body that came at ``now`` (ns)."""
        stamp, origin, seq = header(body)
        self.count += 1
        self.times.append(now)
        self.sizes.append(len(body))
        through = None if stamp is None or origin is None else stamp - origin
        self.delays.append((through, None if stamp is None else now - stamp))
        if seq is not None:
            if self.last_seq is not None:
                if seq > self.last_seq + 1:
                    self.lost += seq - self.last_seq - 1
                elif seq <= self.last_seq:
                    self.restarts += 1
            self.last_seq = seq
        self.trim(now)

    def trim(self, now: int) -> None:
        """Forget what is older than the window."""
        while self.times and now - self.times[0] > self.seconds * NS:
            self.times.popleft()
            self.sizes.popleft()
            self.delays.popleft()

    def hz(self) -> dict[str, Any]:
        """Rate and intervals over the window."""
        times = list(self.times)
        steps = [(b - a) / 1e6 for a, b in itertools.pairwise(times)]
        span = (times[-1] - times[0]) / NS if steps else 0.0
        return {
            "hz": len(steps) / span if span > 0 else None,
            "min_ms": min(steps, default=None),
            "max_ms": max(steps, default=None),
            "messages": len(times),
            "total": self.count,
            "lost": self.lost,
            "restarts": self.restarts,
        }

    def bandwidth(self, now: int, begun: int) -> dict[str, Any]:
        """Bytes a second and sizes over the window."""
        span = min(self.seconds, (now - begun) / NS)
        sizes = list(self.sizes)
        return {
            "bytes_per_s": sum(sizes) / span if span > 0 else 0.0,
            "mean_bytes": sum(sizes) / len(sizes) if sizes else None,
            "min_bytes": min(sizes, default=None),
            "max_bytes": max(sizes, default=None),
            "messages": len(sizes),
            "total": self.count,
        }

    def delay(self) -> dict[str, Any]:
        """Device sample to sending, and sending to arrival here, over the window (ms)."""
        through = [one for one, _ in self.delays if one is not None]
        travel = [two for _, two in self.delays if two is not None]
        return {
            "p50_ms": share(through, 0.5),
            "p99_ms": share(through, 0.99),
            "max_ms": share(through, 1.0),
            "with_origin": len(through),
            "messages": len(self.delays),
            "travel_p50_ms": share(travel, 0.5),
            "travel_p99_ms": share(travel, 0.99),
        }


def share(values: Sequence[int], part: float) -> float | None:
    """The value (ns, given in ms) below which this part of the values lies; None of none."""
    if not values:
        return None
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(part * len(ordered)))] / 1e6
