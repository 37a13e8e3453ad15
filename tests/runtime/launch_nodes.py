"""Small nodes that the launch tests wire."""

from typing import Any

from bunraku.msgs import Target
from bunraku.runtime.node import Node, Publisher, param, subscribe, timer


class Source(Node):
    """Says `count` targets as soon as `wait_for` listen, then ends."""

    name = "source"
    journal = False
    out = Publisher("target", Target)
    wait_for: str = param("1", doc="listeners to wait for")
    count: int = param(50, low=1, high=100_000, doc="messages")
    stay: bool = param(False, doc="do not end after the last")

    def setup(self) -> None:
        self.left = self.count

    @timer(hz=200)
    def tick(self) -> None:
        if self.left and self.out.subscribers() >= int(self.wait_for):
            self.left -= 1
            self.out.publish(Target(yaw=float(self.count - self.left), origin=self.now))
            if not self.left and not self.stay:
                self.stop()


class Counter(Node):
    """Says how many targets it heard."""

    name = "counter"
    journal = False
    out = Publisher("heard", Target)
    gain: float = param(1.0, low=0.0, high=10.0, doc="factor")
    mode: str = param("plain", choices=["plain", "fancy"], doc="how")

    def setup(self) -> None:
        self.count = 0

    @subscribe("target", Target)
    def on_target(self, msg: Target) -> None:
        self.count += 1
        self.out.publish(Target(yaw=self.gain * self.count))
        if self.count == 1:
            self.log.info("first is %g", msg.yaw or 0.0)

    def save(self) -> bytes:
        return str(self.count).encode()

    def restore(self, state: bytes) -> None:
        self.count = int(state)


class Chooser(Node):
    """Hears what its parameter names."""

    name = "chooser"
    topics: list[str] = param(["heard"], doc="topics")

    @subscribe("/*", Target)
    def on_any(self, msg: Target, topic: str) -> None:
        pass

    @classmethod
    def would_hear(cls, params: dict[str, Any], namespace: str, topic: str) -> bool:
        return topic in params["topics"]


class Broken(Node):
    """Fails in its set-up."""

    name = "broken"
    journal = False

    def setup(self) -> None:
        raise ValueError("port 3333 is taken: choose another with port:=N")
