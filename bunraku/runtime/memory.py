"""A stage without processes: an in-memory bus and a clock that is told. The fake publisher of unit tests."""

import select
from collections import deque
from collections.abc import Callable
from fnmatch import fnmatchcase
from typing import Any, TypeVar

from bunraku.msgs import Message, TopicKind, decode, kind_of
from bunraku.runtime.clock import ToldClock
from bunraku.runtime.names import resolve
from bunraku.runtime.node import Input, Node, Subscription

N = TypeVar("N", bound=Node)
MOST_HOPS = 100_000


class MemoryStage:
    """Carries bodies between nodes of one thread; every message is really encoded and decoded."""

    def __init__(self, now: int = 1_700_000_000_000_000_000) -> None:
        self.clock = ToldClock(now)
        self.nodes: list[Node] = []
        self.bodies: dict[str, list[tuple[int, bytes]]] = {}
        """Topic -> (time, body) of all that was said."""
        self.kinds: dict[str, TopicKind] = {}
        self.status: int | None = None
        """What a node that ended itself gave."""
        self._owners: dict[str, Node] = {}
        self._ears: list[tuple[Node, Subscription, str]] = []
        self._states: dict[int, dict[str, tuple[Subscription, bytes]]] = {}
        self._queue: deque[tuple[str, bytes]] = deque()
        self._posts: deque[tuple[Node | None, Callable[[], None]]] = deque()
        self._readers: dict[int, tuple[Node, Callable[[], None]]] = {}
        self._seq: dict[str, int] = {}
        self._adding: Node | None = None
        self._pumping = False

    # For the test

    def add(
        self,
        node: type[N],
        *,
        name: str | None = None,
        namespace: str = "",
        remap: dict[str, str] | None = None,
        state: bytes | None = None,
        **params: Any,
    ) -> N:
        """Start a node with parameters as keywords."""
        one = node(self, name=name, namespace=namespace, remap=remap, params=params)
        self.nodes.append(one)
        self._states[id(one)] = {}
        one.start(state)
        self._pump()
        return one

    def remove(self, node: Node) -> None:
        """End a node: it hears and says nothing any more."""
        node.finish()
        self.nodes.remove(node)
        self._ears = [ear for ear in self._ears if ear[0] is not node]
        self._owners = {topic: owner for topic, owner in self._owners.items() if owner is not node}

    def publish(self, topic: str, message: Message, *, origin: int | None = None) -> None:
        """Say something as a publisher outside; all that follows from it happens before this returns."""
        message.seq = self._seq.get(topic, 0)
        self._seq[topic] = message.seq + 1
        message.stamp = self.clock.now()
        if origin is not None or message.origin is None:
            message.origin = self.clock.now() if origin is None else origin
        self.publish_body(topic, message.encode())

    def publish_body(self, topic: str, body: bytes) -> None:
        """Say raw bytes."""
        self.send(topic, body)
        self._pump()

    def advance(self, seconds: float) -> None:
        """Let time pass; timers run at their own moments."""
        end = self.clock.now() + round(seconds * 1e9)
        while True:
            due = [(at, index) for index, node in enumerate(self.nodes) if (at := node.next_due()) is not None]
            at, index = min(due, default=(end + 1, -1))
            if at > end:
                break
            self.clock.tell(at)
            node = self.nodes[index]
            node.step(self.clock.now(), self._side(node))
            self._pump()
        self.clock.tell(end)

    def poll(self, seconds: float = 0.0) -> None:
        """Serve watched descriptors and posted callbacks, waiting at most so long for the first."""
        ready = select.select(list(self._readers), [], [], seconds)[0] if self._readers else []
        for fileno in ready:
            if fileno in self._readers:
                node, callback = self._readers[fileno]
                node.step(self.clock.now(), self._side(node), callback)
        self._pump()

    def ask(self, node: Node, operation: str, **arguments: Any) -> dict[str, Any]:
        """Send a control request to a node."""
        reply = node.carry_out(self.clock.now(), {"op": operation, **arguments})
        self._pump()
        return reply

    def received(self, topic: str) -> list[Any]:
        """All messages said on a topic, decoded."""
        kind = self.kinds.get(topic) or kind_of(topic)
        return [decode(kind.type if kind else Message, body) for _, body in self.bodies.get(topic, [])]

    def last(self, topic: str) -> Any:
        """The message said last on a topic, or None."""
        kind = self.kinds.get(topic) or kind_of(topic)
        bodies = self.bodies.get(topic)
        return decode(kind.type if kind else Message, bodies[-1][1]) if bodies else None

    def clear(self) -> None:
        """Forget what was said so far (latched messages stay latched)."""
        self.bodies = {topic: said[-1:] for topic, said in self.bodies.items() if self._latched(topic)}

    # For the nodes

    def advertise(self, node: Node, topic: str, kind: TopicKind) -> None:
        if topic in self._owners:
            raise ValueError(f"topic {topic!r} is said by {self._owners[topic].full_name} already")
        self._owners[topic] = node
        self.kinds[topic] = kind

    def listen(self, node: Node, subscription: Subscription) -> None:
        topic = resolve(subscription.topic, node.namespace, node.remap)
        self._ears.append((node, subscription, topic))
        for said, bodies in list(self.bodies.items()):
            if bodies and self._latched(said) and fnmatchcase(said, topic):
                self._hand(node, subscription, said, bodies[-1][1])

    def send(self, topic: str, body: bytes) -> None:
        self._queue.append((topic, body))

    def subscribers(self, topic: str) -> int:
        return sum(fnmatchcase(topic, wanted) for _, _, wanted in self._ears)

    def stack_is_up(self) -> bool:
        return True

    def add_reader(self, fileno: int, callback: Callable[[], None]) -> None:
        self._readers[fileno] = (self.nodes[-1], callback)

    def remove_reader(self, fileno: int) -> None:
        self._readers.pop(fileno, None)

    def post(self, callback: Callable[[], None]) -> None:
        self._posts.append((None, callback))

    def stop(self, status: int) -> None:
        self.status = status

    # Inside

    def _latched(self, topic: str) -> bool:
        kind = self.kinds.get(topic) or kind_of(topic)
        return bool(kind and kind.latched)

    def _side(self, node: Node) -> list[Input]:
        waiting, self._states[id(node)] = self._states[id(node)], {}
        read = (node.receive(one, topic, body) for topic, (one, body) in waiting.items())
        return [one for one in read if one is not None]

    def _hand(self, node: Node, subscription: Subscription, topic: str, body: bytes) -> None:
        if subscription.raw:
            node.take_raw(subscription, topic, body)
        elif not subscription.trigger:
            self._states[id(node)][topic] = (subscription, body)
        else:
            trigger = node.receive(subscription, topic, body)
            if trigger is not None:
                node.step(self.clock.now(), [*self._side(node), trigger])

    def _pump(self) -> None:
        if self._pumping:
            return
        self._pumping = True
        try:
            for _ in range(MOST_HOPS):
                if self._queue:
                    topic, body = self._queue.popleft()
                    self.bodies.setdefault(topic, []).append((self.clock.now(), body))
                    for node, subscription, wanted in list(self._ears):
                        if wanted == topic or (
                            subscription.pattern and fnmatchcase(topic, wanted) and node.wants(topic)
                        ):
                            self._hand(node, subscription, topic, body)
                elif self._posts:
                    _, callback = self._posts.popleft()
                    owner = getattr(callback, "__self__", None)
                    node = owner if isinstance(owner, Node) else self.nodes[-1]
                    node.step(self.clock.now(), self._side(node), callback)
                else:
                    return
            raise RuntimeError(f"more than {MOST_HOPS} messages from one: a message chases its own tail")
        finally:
            self._pumping = False
