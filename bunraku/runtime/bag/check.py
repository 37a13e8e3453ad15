"""Exact replay of a bag: today's code is stepped by the recorded journal and what it says is compared."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import msgpack
import numpy as np

from bunraku.msgs import InvalidMessage, Journal, Motion, TopicKind, decode
from bunraku.runtime.bag.format import NS, header, kind_for, machine
from bunraku.runtime.bag.reader import Bag, Progress
from bunraku.runtime.journal import Replay, ReplayProblem, load_class
from bunraku.runtime.node import Node

NEAR = NS // 4
"""ns: so close to a step a message is taken for one of it, whatever its sender's clock said."""
ELSEWHERE = 1e-6
"""Largest difference (m, rad and units of quaternions) that another processor or build may make."""


@dataclass(frozen=True)
class Difference:
    """One message that is not what was recorded."""

    time: float
    """s from the beginning of the bag."""
    topic: str
    seq: int
    field: str
    """The field that differs; empty where the whole message is missing or was not recorded."""
    text: str
    size: float | None = None
    """Largest difference of the numbers; None where the two cannot be subtracted."""


@dataclass
class NodeCheck:
    """What came out for one node."""

    node: str
    steps: int = 0
    starts: int = 0
    compared: int = 0
    """Messages compared."""
    different: int = 0
    """Messages that are not the same to the last bit."""
    beyond: int = 0
    """Messages that differ by more than the tolerance."""
    unrecorded: int = 0
    """Messages that were said again but are missing in the bag."""
    largest: float = 0.0
    """Largest difference of a number in any message."""
    first: Difference | None = None
    problem: str = ""
    """Why the journal could not be followed (to its end)."""
    skipped: str = ""
    """Why the node was not stepped at all; no failure."""

    @property
    def passed(self) -> bool:
        """Whether everything that was recorded came out again within the tolerance."""
        return not self.problem and not self.beyond


@dataclass
class _Run:
    """A node's life from one start to the next."""

    entries: list[tuple[int, Journal]] = field(default_factory=list)
    """Receive time and entry."""


Recorded = list[tuple[int, int, bytes]]
"""(receive time, seq, body)"""


class Journals:
    """The journals of a bag, read once: who was recorded, and where each began."""

    def __init__(self, bag: Bag, progress: Progress | None = None) -> None:
        self.bag = bag
        self.topics = {_node_of(topic): topic for topic in bag.channels if _node_of(topic)}
        self.runs: dict[str, list[_Run]] = {node: [] for node in self.topics}
        self.broken: dict[str, int] = dict.fromkeys(self.topics, 0)
        for entry in bag.messages(set(self.topics.values()), progress=progress):
            node = _node_of(entry.topic)
            try:
                step: Journal = decode(Journal, entry.body)
            except InvalidMessage:
                self.broken[node] += 1
                continue
            runs = self.runs[node]
            if step.start is not None or not runs:
                runs.append(_Run())
            runs[-1].entries.append((entry.received, step))

    def classes(self, node: str) -> list[str]:
        """The classes ('module:Class') that a node's starts name."""
        found = {str(step.start.get("class")) for run in self.runs[node] for _, step in run.entries if step.start}
        return sorted(found)

    def compiled(self, node: str) -> bool:
        """Whether the node's process computes with compiled kernels; False where its class cannot be loaded."""
        try:
            return any(load_class(name).jit for name in self.classes(node))
        except ReplayProblem:
            return False


def tolerance(bag: Bag) -> float:
    """0 where the bag was recorded with this processor and these libraries, else `ELSEWHERE`."""
    here = machine()
    return 0.0 if all(bag.session.get(key) == value for key, value in here.items()) else ELSEWHERE


def check(
    journals: Journals,
    nodes: Sequence[str],
    allowed: float,
    *,
    node_class: type[Node] | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> list[NodeCheck]:
    """Step the nodes by their journals and compare what they say with what was recorded.

    ``progress`` is called with the node, steps made and steps in all.
    """
    wanted: set[str] = set()
    for node in nodes:
        for run in journals.runs[node]:
            for _, step in run.entries:
                wanted.update(step.inputs)
    recorded: dict[str, Recorded] = defaultdict(list)
    by_seq: dict[str, dict[int, list[tuple[int, bytes]]]] = defaultdict(lambda: defaultdict(list))
    own = set(journals.topics.values())
    for entry in journals.bag.messages():
        if entry.topic in own:
            continue
        seq = header(entry.body).seq
        if seq is None:
            continue
        if entry.topic in wanted:
            by_seq[entry.topic][seq].append((entry.received, entry.body))
        recorded[entry.topic].append((entry.received, seq, entry.body))
    found = []
    for node in nodes:
        one = _Checker(journals, node, allowed, by_seq, recorded, node_class)
        found.append(one.run(progress))
    return found


class _Checker:
    """Follows one node through all its lives."""

    def __init__(
        self,
        journals: Journals,
        node: str,
        allowed: float,
        inputs: dict[str, dict[int, list[tuple[int, bytes]]]],
        recorded: dict[str, Recorded],
        node_class: type[Node] | None,
    ) -> None:
        self.begin = journals.bag.start or 0
        self.channels = journals.bag.channels
        self.runs = journals.runs[node]
        self.allowed = allowed
        self.inputs, self.recorded = inputs, recorded
        self.node_class = node_class
        self.result = NodeCheck(node)
        self.now = 0
        if journals.broken[node]:
            self.result.problem = f"{journals.broken[node]} entries of its journal cannot be read"

    def run(self, progress: Callable[[str, int, int], None] | None) -> NodeCheck:
        """Step through; what stops it is told in the result."""
        result = self.result
        if any(step.device for run in self.runs for _, step in run.entries):
            result.skipped = "reads a device, which the bag does not hold"
            return result
        if not any(run.entries for run in self.runs):
            result.problem = result.problem or "its journal is empty"
            return result
        total = sum(len(run.entries) for run in self.runs)
        for number, run in enumerate(self.runs):
            following = self.runs[number + 1].entries[0][1].now if number + 1 < len(self.runs) else None
            try:
                self._follow(run, following, total, progress)
            except ReplayProblem as problem:
                if not result.problem:
                    result.problem = f"at {self._seconds(self.now):.3f} s: {problem}"
        return result

    def _follow(
        self, run: _Run, following: int | None, total: int, progress: Callable[[str, int, int], None] | None
    ) -> None:
        result = self.result
        replay = Replay(self._lookup, self.node_class)
        said: dict[str, dict[int, bytes]] = defaultdict(dict)
        expected_seq: int | None = None
        try:
            for _, step in run.entries:
                self.now = step.now
                if expected_seq is not None and step.seq > expected_seq:
                    raise ReplayProblem(f"{step.seq - expected_seq} entries of its journal are missing")
                expected_seq = step.seq + 1
                try:
                    spoken = replay.follow(step)
                except ReplayProblem:
                    raise
                except Exception as error:  # a handler that failed on stage fails here too, and the node went on
                    if step.start is not None:
                        raise ReplayProblem(f"{type(error).__name__} in its start: {error}") from None
                    spoken = []
                for one in spoken:
                    seq = header(one.body).seq
                    if seq is not None:
                        said[one.topic][seq] = one.body
                result.steps += 1
                result.starts += step.start is not None
                if progress is not None and (result.steps % 100 == 0 or result.steps == total):
                    progress(result.node, result.steps, total)
        finally:
            self._compare(run.entries[0][1].now, self.now, following, said)

    def _compare(self, begin: int, last: int, following: int | None, said: dict[str, dict[int, bytes]]) -> None:
        """Compare what was said in one life: recorded messages belong to it by their `stamp`."""
        result = self.result
        own = {
            channel.topic
            for channel in self.channels.values()
            if channel.node == result.node and not _of_itself(channel.topic)
        }
        for topic in sorted(said.keys() | own):
            mine = said.get(topic, {})
            kind = kind_for(self.channels[topic]) if topic in self.channels else None
            seen: set[int] = set()
            for received, seq, body in self.recorded.get(topic, []):
                stamp = header(body).stamp
                if stamp is None or stamp < begin or (following is not None and stamp >= following) or seq in seen:
                    continue
                seen.add(seq)
                again = mine.get(seq)
                if again is None:
                    if stamp < last:
                        text = "was recorded and is not said by today's code"
                        self._differs(Difference(self._seconds(received), topic, seq, "", text))
                    continue
                result.compared += 1
                if (found := compare(kind, body, again)) is not None:
                    field_, text, size = found
                    self._differs(Difference(self._seconds(received), topic, seq, field_, text, size))
            result.unrecorded += len(mine.keys() - seen)

    def _differs(self, found: Difference) -> None:
        result = self.result
        result.different += 1
        if found.size is not None:
            result.largest = max(result.largest, found.size)
        if found.size is None or found.size > self.allowed:
            if not result.beyond:
                result.first = found
            result.beyond += 1
        elif result.first is None:
            result.first = found

    def _lookup(self, topic: str, seq: int) -> bytes:
        """The recorded body of an input: of several with one `seq` the newest that was sent before this step."""
        taken = None
        for received, body in self.inputs.get(topic, {}).get(seq, []):
            stamp = header(body).stamp
            sent = received if stamp is None else min(stamp, received)
            # clocks of two machines differ; a recorder hears a message a little later than the node
            if sent <= self.now or abs(received - self.now) < NEAR:
                taken = body
        if taken is None:
            raise ReplayProblem(f"message {seq} of {topic!r}, which it took, is not in the bag")
        return taken

    def _seconds(self, moment: int) -> float:
        return (moment - self.begin) / NS


def compare(kind: TopicKind | None, before: bytes, again: bytes) -> tuple[str, str, float | None] | None:
    """The first difference of two bodies beside of `stamp`: field, words, largest difference of its numbers.

    Poses and motions are compared by what moves the figure, `root` and `rotations`; all else field by field.
    """
    one, two = _fields(before), _fields(again)
    if one is None or two is None:
        return None if before == again else ("", "is no message", None)
    arrays: dict[str, tuple[int, ...]] = getattr(kind.type, "shapes", {}) if kind else {}
    moves = kind is not None and isinstance(kind.type, type) and issubclass(kind.type, Motion)
    worst: tuple[str, str, float | None] | None = None
    for key in sorted(arrays) if moves else sorted(one.keys() | two.keys()):
        if key == "stamp":
            continue
        a, b = one.get(key), two.get(key)
        if isinstance(a, bytes) and isinstance(b, bytes) and key in arrays:
            found = _compare_arrays(a, b)
        else:
            found = _compare_values(a, b)
        if found is None:
            continue
        text, size = found
        if size is None:
            return key, text, None
        if worst is None or size > (worst[2] or 0.0):
            worst = key, text, size
    return worst


def _fields(body: bytes) -> dict[str, Any] | None:
    try:
        value = msgpack.unpackb(body, strict_map_key=False)
    except (ValueError, msgpack.UnpackException):
        return None
    return value if isinstance(value, dict) else None


def _compare_arrays(a: bytes, b: bytes) -> tuple[str, float | None] | None:
    if a == b:
        return None
    if len(a) != len(b) or len(a) % 4:
        return f"{len(a)} bytes before, {len(b)} now", None
    one, two = np.frombuffer(a, "<f4").astype(float), np.frombuffer(b, "<f4").astype(float)
    size = np.abs(one - two)
    if not np.isfinite(size).all():
        return "not finite", None
    place = int(size.argmax())
    return f"number {place}: {one[place]:.9g} before, {two[place]:.9g} now", float(size[place])


def _compare_values(a: Any, b: Any) -> tuple[str, float | None] | None:
    """The first difference of two plain values; the largest one where only numbers differ."""
    if isinstance(a, float) and isinstance(b, (int, float)) and not isinstance(b, bool):
        if a == b:
            return None
        return f"{a:.9g} before, {b:.9g} now", abs(a - b) if abs(a - b) < float("inf") else None
    if isinstance(a, dict) and isinstance(b, dict) and a.keys() == b.keys():
        return _worst([(a[key], b[key]) for key in a])
    if isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        return _worst(list(zip(a, b, strict=True)))
    if type(a) is type(b) and a == b:
        return None
    return f"{_short(a)} before, {_short(b)} now", None


def _worst(pairs: list[tuple[Any, Any]]) -> tuple[str, float | None] | None:
    worst: tuple[str, float | None] | None = None
    for x, y in pairs:
        found = _compare_values(x, y)
        if found is None:
            continue
        if found[1] is None:
            return found
        if worst is None or found[1] > (worst[1] or 0.0):
            worst = found
    return worst


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else text[:39] + "…"


def _of_itself(topic: str) -> bool:
    """Whether a topic is one in which a node speaks of itself."""
    return topic.split("/")[-2:-1] in (["log"], ["params"], ["journal"])


def _node_of(topic: str) -> str:
    """The full name of the node whose journal a topic is; empty for other topics."""
    parts = topic.split("/")
    return "/".join([*parts[:-2], parts[-1]]) if len(parts) >= 2 and parts[-2] == "journal" else ""
