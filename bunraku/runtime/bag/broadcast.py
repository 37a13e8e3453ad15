"""Saying a bag's topics on a stage, as their publisher."""

import contextlib
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import zmq

from bunraku.msgs import TopicKind
from bunraku.runtime.graph import stack_is_up
from bunraku.runtime.names import make_run_folder
from bunraku.runtime.topics import TopicWriter

SETTLED = 0.3
"""s without a new subscriber after which no more are awaited where nobody says how many there will be."""


class Broadcast:
    """The publisher of some topics: bodies as they are, latched ones to each new subscriber. A context manager."""

    def __init__(self, folder: Path, topics: Mapping[str, TopicKind], node: str) -> None:
        """Take the topics; raises `TopicTaken` where somebody says one already."""
        make_run_folder(folder)
        self.folder = folder
        self.context: zmq.Context[Any] = zmq.Context()
        self.writers: dict[str, TopicWriter] = {}
        self._poller = zmq.Poller()
        try:
            for topic, kind in topics.items():
                writer = self.writers[topic] = TopicWriter(self.context, folder, topic, kind, node)
                self._poller.register(writer.socket, zmq.POLLIN)
        except BaseException:
            self.close()
            raise

    def send(self, topic: str, body: bytes) -> None:
        """Publish a body."""
        self.writers[topic].send(body)

    def watch(self, descriptor: int) -> None:
        """Let `wait` tell when a descriptor can be read."""
        self._poller.register(descriptor, zmq.POLLIN)

    def unwatch(self, descriptor: int) -> None:
        """Watch a descriptor no longer."""
        self._poller.unregister(descriptor)

    def wait(self, seconds: float) -> set[int]:
        """Serve subscribers until the time is over or a watched descriptor can be read; tells which can be."""
        end = time.monotonic() + seconds
        while True:
            rest = end - time.monotonic()
            if 0 < rest < 0.001:
                time.sleep(rest)  # the poller counts in whole milliseconds
            events = self._poller.poll(max(0, int(rest * 1000)))
            ready = {source for source, _ in events if isinstance(source, int)}
            if events:
                self.attend()
            if ready or time.monotonic() >= end:
                return ready

    def attend(self) -> None:
        """Take notice of subscribers that came or went."""
        for writer in self.writers.values():
            writer.attend()

    def subscribers(self, topic: str) -> int:
        """How many listen to a topic now."""
        return self.writers[topic].subscribers

    def await_subscribers(self, expected: Mapping[str, int], limit: float) -> dict[str, int]:
        """Wait until each topic has as many subscribers as expected, at most ``limit`` s.

        Within a launch also until all of its nodes have set up.
        Where none are expected it waits for the first subscriber of any topic, and then until no more come. Gives the
        topics that lack some, and how many; a topic name '' where nobody came at all.
        """
        end = time.monotonic() + limit
        before, since = 0, time.monotonic()
        while True:
            self.attend()
            lacking = {topic: count - self.subscribers(topic) for topic, count in expected.items()}
            lacking = {topic: count for topic, count in lacking.items() if count > 0}
            now, count = time.monotonic(), sum(writer.subscribers for writer in self.writers.values())
            if count != before:
                before, since = count, now
            if stack_is_up(self.folder):
                if expected and not lacking:
                    return {}
                if not expected and count and now - since >= SETTLED:
                    return {}
            if now >= end:
                return lacking if expected else ({} if count else {"": 1})
            self.wait(min(0.02, end - now))

    def close(self) -> None:
        """Give the topics up; what was sent still leaves."""
        for writer in self.writers.values():
            writer.close()
        self.context.destroy(linger=200)
        with contextlib.suppress(OSError):
            self.folder.rmdir()  # the last one out; not empty otherwise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *failure: object) -> None:
        self.close()
