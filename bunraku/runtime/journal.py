"""Exact replay: step today's code by a recorded journal and see what it says."""

import contextlib
import importlib
from collections.abc import Callable
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

from bunraku.msgs import Journal, TopicKind
from bunraku.runtime.clock import ToldClock
from bunraku.runtime.names import resolve
from bunraku.runtime.node import Input, Node, Subscription

_OWN = ("/log/", "/params/", "/journal/")
"""Topics in which a node speaks of itself."""


class ReplayProblem(RuntimeError):
    """The journal cannot be followed; one line."""


def load_class(path: str) -> type[Node]:
    """The node class named 'module:Class'; raises `ReplayProblem`."""
    module, _, name = path.partition(":")
    try:
        found = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError) as error:
        raise ReplayProblem(f"node class {path} cannot be loaded: {error}") from None
    if not (isinstance(found, type) and issubclass(found, Node)):
        raise ReplayProblem(f"{path} is no node class")
    return found


@dataclass
class Said:
    """A body that the replayed node said."""

    topic: str
    body: bytes


class ReplayStage:
    """A stage of one node that keeps what the node says and gives it only what the journal names."""

    def __init__(self) -> None:
        self.clock = ToldClock(0)
        self.said: list[Said] = []
        self.subscriptions: dict[str, Subscription] = {}
        self.patterns: list[tuple[str, Subscription]] = []

    def advertise(self, node: Node, topic: str, kind: TopicKind) -> None:
        pass

    def listen(self, node: Node, subscription: Subscription) -> None:
        topic = resolve(subscription.topic, node.namespace, node.remap)
        if subscription.pattern:
            self.patterns.append((topic, subscription))
        else:
            self.subscriptions[topic] = subscription

    def send(self, topic: str, body: bytes) -> None:
        self.said.append(Said(topic, body))

    def subscribers(self, topic: str) -> int:
        return 0

    def stack_is_up(self) -> bool:
        return True

    def add_reader(self, fileno: int, callback: Callable[[], None]) -> None:
        raise ReplayProblem("the node reads a device, which a bag does not hold")

    def remove_reader(self, fileno: int) -> None:
        pass

    def post(self, callback: Callable[[], None]) -> None:
        raise ReplayProblem("the node works on other threads, which a bag does not hold")

    def stop(self, status: int) -> None:
        pass

    def subscription(self, topic: str) -> Subscription:
        """Who hears a topic; raises `ReplayProblem`."""
        if topic in self.subscriptions:
            return self.subscriptions[topic]
        for pattern, one in self.patterns:
            if fnmatchcase(topic, pattern):
                return one
        raise ReplayProblem(f"the journal names topic {topic!r}, which today's code does not hear")


class Replay:
    """Follows one node's journal. ``lookup(topic, seq)`` gives the recorded body of an input."""

    def __init__(self, lookup: Callable[[str, int], bytes], node_class: type[Node] | None = None) -> None:
        self.lookup = lookup
        self.node_class = node_class
        self.stage = ReplayStage()
        self.node: Node | None = None
        self.steps = 0

    def follow(self, entry: Journal) -> list[Said]:
        """Make one recorded step; gives what the node said in it, its journal and logs left out."""
        if entry.start is not None:
            self._begin(entry, entry.start)
        elif self.node is None:
            raise ReplayProblem("the journal's beginning was not recorded: record from the start of the stack")
        else:
            self._step(self.node, entry)
        self.steps += 1
        said, self.stage.said = self.stage.said, []
        return [one for one in said if not any(part in f"/{one.topic}" for part in _OWN)]

    def _begin(self, entry: Journal, start: dict[str, Any]) -> None:
        node_class = self.node_class or load_class(str(start.get("class")))
        self.stage = ReplayStage()
        self.stage.clock.tell(entry.now)
        self.node = node_class(
            self.stage,
            name=start.get("name"),
            namespace=start.get("namespace", ""),
            remap=start.get("remap", {}),
            params=dict(start.get("params", {})),
        )
        self.node.start(start.get("state"))

    def _step(self, node: Node, entry: Journal) -> None:
        self.stage.clock.tell(entry.now)
        if entry.request is not None:
            node.carry_out(entry.now, entry.request)
            return
        inputs: list[Input] = []
        for topic, seq in entry.inputs.items():
            one = node.receive(self.stage.subscription(topic), topic, self.lookup(topic, seq))
            if one is not None:
                inputs.append(one)
        with contextlib.suppress(Exception):  # as it did when it was recorded: the node lived on
            node.step(entry.now, inputs)
