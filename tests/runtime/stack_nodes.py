"""Small nodes that the process tests run."""

import msgspec

from bunraku.msgs import Target
from bunraku.runtime.node import Node, Publisher, subscribe, subscribe_raw, timer


class Relay(Node):
    """Says `result` for each `target`, remembers how many."""

    name = "relay"
    out = Publisher("result", Target)

    def setup(self) -> None:
        self.count = 0

    @subscribe("target", Target)
    def on_target(self, msg: Target) -> None:
        self.count += 1
        self.out.publish(Target(yaw=float(self.count), pelvis=msg.pelvis))

    def save(self) -> bytes:
        return msgspec.msgpack.encode(self.count)

    def restore(self, state: bytes) -> None:
        self.count = msgspec.msgpack.decode(state)


class Ticker(Node):
    """Says `tick` 100 times a second and fails loudly now and then."""

    name = "ticker"
    out = Publisher("tick", Target)

    def setup(self) -> None:
        self.count = 0

    @timer(hz=100)
    def tick(self) -> None:
        self.count += 1
        self.out.publish(Target(yaw=float(self.count)))
        if self.count == 5:
            raise RuntimeError("the fifth tick fails")


class Ear(Node):
    """Hears everything raw."""

    name = "ear"
    journal = False
    out = Publisher("heard", Target)

    def setup(self) -> None:
        self.count = 0

    @subscribe_raw("*result")
    def on_raw(self, topic: str, body: bytes) -> None:
        self.count += 1
        self.out.publish(Target(yaw=float(self.count)))
