"""A stage over ZeroMQ: one process, one node, one thread, one poller."""

import contextlib
import ctypes
import json
import os
import stat
import time
from collections import deque
from collections.abc import Callable
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import Any

import zmq

from bunraku.msgs import Clock as ClockMessage
from bunraku.msgs import InvalidMessage, TopicKind, decode
from bunraku.runtime.clock import Clock, RealClock, ToldClock
from bunraku.runtime.names import NAME, STACK, file_of, resolve
from bunraku.runtime.node import Input, Node, Subscription
from bunraku.runtime.topics import TopicReader, TopicWriter

SCAN_EVERY = 0.1
"""s between two looks for new topics that a pattern matches."""
BATCH = 64
"""Messages taken from one topic before the others get their turn."""
MILLISECOND = 1_000_000


class ZmqStage:
    """Carries one node's messages through the run folder's sockets."""

    def __init__(self, folder: Path, *, bag_clock: bool = False) -> None:
        self.folder = folder
        self.context: zmq.Context[Any] = zmq.Context()
        self.clock: Clock = ToldClock(0) if bag_clock else RealClock()
        self.node: Node | None = None
        """The one node that lives here."""
        self.status: int | None = None
        self.on_step: Callable[[], None] = lambda: None
        """Called after every step (the state file hangs here)."""
        self.on_error: Callable[[BaseException], None] = lambda error: None
        self._poller = zmq.Poller()
        self._writers: dict[str, TopicWriter] = {}
        self._triggers: dict[Any, tuple[TopicReader, Subscription]] = {}
        self._states: list[tuple[TopicReader, Subscription]] = []
        self._patterns: list[tuple[str, Subscription]] = []
        self._connected: set[tuple[str, str]] = set()
        self._readers: dict[int, Callable[[], None]] = {}
        self._plain: dict[Any, Callable[[], None]] = {}
        self._posts: deque[Callable[[], None]] = deque()
        self._stack = _launched_together()
        self._wake_out, self._wake_in = os.pipe()
        os.set_blocking(self._wake_out, False)
        os.set_blocking(self._wake_in, False)
        self.watch(self._wake_out, self._drain_wake)
        self._scan_at = 0.0
        self._flooded = False
        if bag_clock:
            reader = TopicReader(self.context, folder, "clock")
            self._closing = [reader]
            self.watch(reader.socket, lambda: self._take_clock(reader))
        else:
            self._closing = []

    # For the node

    def advertise(self, node: Node, topic: str, kind: TopicKind) -> None:
        self.node = node
        writer = TopicWriter(self.context, self.folder, topic, kind, node.full_name)
        self._writers[topic] = writer
        self.watch(writer.socket, writer.attend)

    def listen(self, node: Node, subscription: Subscription) -> None:
        topic = resolve(subscription.topic, node.namespace, node.remap)
        if subscription.pattern:
            self._patterns.append((topic, subscription))
            self._scan(force=True)
        else:
            self._connect(topic, subscription)

    def send(self, topic: str, body: bytes) -> None:
        self._writers[topic].send(body)

    def subscribers(self, topic: str) -> int:
        writer = self._writers[topic]
        writer.attend()
        return writer.subscribers

    def stack_is_up(self) -> bool:
        self._stack = [name for name in self._stack if not file_of(self.folder, name, ".ctl").exists()]
        return not self._stack

    def add_reader(self, fileno: int, callback: Callable[[], None]) -> None:
        self._readers[fileno] = callback
        self._poller.register(fileno, zmq.POLLIN)

    def remove_reader(self, fileno: int) -> None:
        if self._readers.pop(fileno, None) is not None:
            self._poller.unregister(fileno)

    def post(self, callback: Callable[[], None]) -> None:
        self._posts.append(callback)
        self.wake()

    def stop(self, status: int) -> None:
        if self.status is None:
            self.status = status
        self.wake()

    # For the loop

    def wake(self) -> None:
        """End the present wait; safe from threads and signal handlers."""
        with contextlib.suppress(OSError):
            os.write(self._wake_in, b"\0")

    @property
    def wake_descriptor(self) -> int:
        """What `signal.set_wakeup_fd` takes."""
        return self._wake_in

    def watch(self, source: Any, callback: Callable[[], None]) -> None:
        """Call back, outside of any step, when a socket or descriptor can be read."""
        self._plain[source] = callback
        self._poller.register(source, zmq.POLLIN)

    def unwatch(self, source: Any) -> None:
        """Stop watching."""
        if self._plain.pop(source, None) is not None:
            self._poller.unregister(source)

    def await_ears(self, ears: dict[str, list[str]], seconds: float) -> bool:
        """Wait until the named recorders (name -> topics, patterns) hear what is said here; False if they do not."""
        end = time.monotonic() + seconds
        while self.status is None:
            missing = [
                topic
                for topic, writer in self._writers.items()
                for ear, patterns in ears.items()
                if ear not in writer.ears and any(fnmatchcase(topic, one) for one in patterns)
            ]
            rest = end - time.monotonic()
            if not missing or rest <= 0.0:
                return not missing
            for source, _ in self._poller.poll(round(min(rest, 0.5) * 1e3) + 1):
                if source in self._plain:
                    self._plain[source]()
        return False

    def turn(self, node: Node) -> None:
        """Wait for the next event or due timer and serve it."""
        due = node.next_due()
        limit = SCAN_EVERY if self._patterns else 1.0
        wait = limit * 1e9 if due is None else min(max(due - self.clock.now(), 0), limit * 1e9)
        if isinstance(self.clock, ToldClock):
            wait = limit * 1e9
        milliseconds = int(wait // MILLISECOND)
        events = self._poller.poll(milliseconds)
        if not events and due is not None and not isinstance(self.clock, ToldClock):
            # The poller counts in whole milliseconds: sleep what is left.
            rest = due - self.clock.now()
            if 0 < rest < MILLISECOND:
                time.sleep(rest / 1e9)
        for source, _ in events:
            self._serve(node, source)
            if self.status is not None:
                return
        while self._posts:
            self._step(node, self._side(node), self._posts.popleft())
        due = node.next_due()
        if due is not None and due <= self.clock.now():
            self._step(node, self._side(node))
        node.report_dropped(self.clock.now())
        if self._flooded and not events:  # quiet again after messages that were dropped
            self._flooded = False
            _return_memory()
        self._scan()

    def drain(self, node: Node, seconds: float) -> None:
        """Hand a node that ends the bodies that wait unread in its raw subscriptions, for at most so long."""
        end = time.monotonic() + seconds
        for reader, subscription in list(self._triggers.values()):
            while subscription.raw and time.monotonic() < end:
                body = reader.receive()
                if body is None:
                    break
                self._guard(partial(node.take_raw, subscription, reader.topic, body))

    def close(self) -> None:
        """Close all sockets and remove their files."""
        for reader, _ in [*self._triggers.values(), *self._states]:
            reader.close()
        for reader in self._closing:
            reader.close()
        for writer in self._writers.values():
            writer.close()
        self.context.destroy(linger=200)
        os.close(self._wake_out)
        os.close(self._wake_in)

    # Inside

    def _serve(self, node: Node, source: Any) -> None:
        if source in self._triggers:
            reader, subscription = self._triggers[source]
            for _ in range(BATCH):
                body = reader.receive() if self.status is None else None
                if body is None:
                    return
                if subscription.raw:
                    self._guard(partial(node.take_raw, subscription, reader.topic, body))
                    continue
                trigger = node.receive(subscription, reader.topic, body)
                if trigger is None:
                    self._flooded = True
                else:
                    self._step(node, [*self._side(node), trigger])
        elif source in self._readers:
            self._step(node, self._side(node), self._readers[source])
        elif source in self._plain:
            self._plain[source]()

    def _side(self, node: Node) -> list[Input]:
        inputs = []
        for reader, subscription in self._states:
            body = reader.receive()
            if body is not None:
                one = node.receive(subscription, reader.topic, body)
                if one is not None:
                    inputs.append(one)
        return inputs

    def _step(self, node: Node, inputs: list[Input], action: Callable[[], None] | None = None) -> None:
        self._guard(lambda: node.step(self.clock.now(), inputs, action))
        self.on_step()

    def _guard(self, action: Callable[[], Any]) -> None:
        try:
            action()
        except Exception as error:  # a message must not end a node
            self.on_error(error)

    def _connect(self, topic: str, subscription: Subscription) -> None:
        if (topic, subscription.handler) in self._connected:
            return
        self._connected.add((topic, subscription.handler))
        newest = subscription.newest and not subscription.raw
        ear = self.node.full_name if subscription.raw and self.node is not None else ""
        reader = TopicReader(self.context, self.folder, topic, newest=newest, ear=ear)
        if subscription.trigger or subscription.raw:
            self._triggers[reader.socket] = (reader, subscription)
            self._poller.register(reader.socket, zmq.POLLIN)
        else:
            self._states.append((reader, subscription))

    def _scan(self, force: bool = False) -> None:
        if not self._patterns:
            return
        now = time.monotonic()
        if not force and now < self._scan_at:
            return
        self._scan_at = now + SCAN_EVERY
        with os.scandir(self.folder) as entries:
            found = {_topic_of(entry) for entry in entries} - {""}
        for topic in sorted(found):
            for pattern, subscription in self._patterns:
                known = (topic, subscription.handler) in self._connected
                if not known and fnmatchcase(topic, pattern) and self._wanted(topic):
                    self._connect(topic, subscription)

    def _wanted(self, topic: str) -> bool:
        return self.node is None or self.node.wants(topic)

    def _drain_wake(self) -> None:
        with contextlib.suppress(BlockingIOError):
            while os.read(self._wake_out, 4096):
                pass

    def _take_clock(self, reader: TopicReader) -> None:
        while (body := reader.receive()) is not None:
            with contextlib.suppress(InvalidMessage):
                message: ClockMessage = decode(ClockMessage, body)
                if isinstance(self.clock, ToldClock):
                    self.clock.tell(message.now)


def _topic_of(entry: "os.DirEntry[str]") -> str:
    """The topic that a file of the run folder tells of, by its card or its socket; empty for any other file."""
    stem, _, last = entry.name.rpartition(".")
    if last == "json":
        name = stem
    elif last not in ("lock", "ctl", "state") and _is_socket(entry):
        name = entry.name
    else:
        return ""
    topic = name.replace(".", "/")
    return topic if NAME.fullmatch(topic) else ""


def _is_socket(entry: "os.DirEntry[str]") -> bool:
    try:
        return stat.S_ISSOCK(entry.stat(follow_symlinks=False).st_mode)
    except FileNotFoundError:
        return False  # its node ended, or its card got its name, since the folder was read


def _return_memory() -> None:
    """Give free heap back to the system (glibc)."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


def _launched_together() -> list[str]:
    """The nodes of this launch, from the environment; none outside of one."""
    try:
        names = json.loads(os.environ.get(STACK) or "[]")
    except ValueError:
        return []
    return [str(name) for name in names] if isinstance(names, list) else []
