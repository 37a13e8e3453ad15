"""The node: what is said here goes to the other side, what is said there is said here too."""

from fnmatch import fnmatchcase
from typing import Any

from bunraku.msgs import TopicKind, kind_of
from bunraku.msgs.system import Raw
from bunraku.nodes.bridge.link import Link
from bunraku.runtime.names import NameProblem, check_topic
from bunraku.runtime.node import Node, param, request, subscribe_raw, timer
from bunraku.runtime.topics import TopicTaken

PATIENCE = 5_000_000_000
"""ns without a peer after which that is said."""
MOST_TOPICS = 512


class Bridge(Node):
    """Carries topics between two machines over one tcp port; one side listens, the other connects."""

    name = "bridge"
    journal = False  # what comes from the other machine is in no bag's journal

    # hides Node.listen, which a node that hears by pattern does not need
    listen: str = param(  # type: ignore[assignment]
        "", doc="address to listen on, as 0.0.0.0:7447; a port alone stays on this machine"
    )
    connect: str = param("", doc="address of the bridge that listens, as stage.local:7447")
    keys: str = param("", doc="folder of the keys (bunraku keys DIR); needed for all but 127.0.0.1")
    send: list[str] = param(["*"], doc="names or patterns of the topics that go to the other side")

    link: Link | None = None

    def setup(self) -> None:
        self.said: set[str] = set()
        self.refused: set[str] = set()
        self.carried = {"sent": 0, "received": 0}
        self.lonely_since = self.now
        self.greeted = False
        self.told_denied = 0
        self.link = link = Link(listen=self.listen, connect=self.connect, keys=self.keys)
        for number in link.filenos:
            self.add_reader(number, self.take)
        doing = "listening on" if link.listening else "connecting to"
        self.log.info("%s %s%s", doing, link.endpoint, "" if self.keys else " without keys")
        self.keep()

    def teardown(self) -> None:
        if self.link is not None:
            self.link.close()

    @classmethod
    def would_hear(cls, params: dict[str, Any], namespace: str, topic: str) -> bool:
        """Whether a bridge with these parameters carries a topic."""
        return any(fnmatchcase(topic, wanted.removeprefix("/")) for wanted in params["send"])

    def wants(self, topic: str) -> bool:
        """Whether a topic goes to the other side: chosen, and not said by this node."""
        own = {self.log_publisher.topic, self.params_publisher.topic} | self.said
        return topic not in own and self.would_hear(self.param_values, self.namespace, topic)

    def on_param(self, name: str) -> None:
        if name != "send":
            self.log.warning("%s: takes effect when the bridge is started again", name)

    @subscribe_raw("/*")
    def on_body(self, topic: str, body: bytes) -> None:
        """Hand a body to the other side."""
        if self.link is None or not self.wants(topic):
            return
        kind = kind_of(topic)
        self.link.send(topic, body, latched=bool(kind and kind.latched))
        self.carried["sent"] += 1
        self.take()

    def take(self) -> None:
        """Say here what came from the other side."""
        if self.link is None:
            return
        for topic, latched, body in self.link.receive():
            if topic in self.said or self._adopt(topic, latched):
                self.stage.send(topic, body)
                self.carried["received"] += 1

    @timer(hz=10)
    def keep(self) -> None:
        """Greet, and tell who came and went."""
        assert self.link is not None
        self.link.keep(self.now / 1e9)
        self.take()
        if bool(self.link.peers) != self.greeted:
            self.greeted = bool(self.link.peers)
            self.lonely_since = self.now
            self.log.info("the other side is %s", "there" if self.greeted else "gone")
        if not self.greeted and self.now - self.lonely_since > PATIENCE and not self.link.listening:
            self.lonely_since = self.now
            self.log.warning(
                "no answer from %s: is the other bridge there, on that port, with the keys that belong to these?",
                self.link.given,
            )
        if self.link.denied > self.told_denied:
            self.told_denied = self.link.denied
            self.log.warning("refused a peer with an unknown key (%d in all)", self.told_denied)

    @request("status")
    def status(self) -> dict[str, Any]:
        """Where it listens or connects, who is there, and how much was carried."""
        assert self.link is not None
        return {
            "endpoint": self.link.endpoint,
            "peers": len(self.link.peers),
            "denied": self.link.denied,
            "topics": sorted(self.said),
            **self.carried,
        }

    def _adopt(self, topic: str, latched: bool) -> bool:
        """Become the publisher of a topic of the other side, if nobody here is."""
        if topic in self.refused:
            return False
        try:
            check_topic(topic)
            if len(self.said) >= MOST_TOPICS:
                raise NameProblem(f"more than {MOST_TOPICS} topics from the other side")
            kind = kind_of(topic) or TopicKind(Raw, latched=latched)
            self.stage.advertise(self, topic, kind)
        except (TopicTaken, ValueError) as error:
            if len(self.refused) < MOST_TOPICS:
                self.refused.add(topic)
                self.log.warning("%s from the other side is dropped: %s", topic[:100], error)
            return False
        self.said.add(topic)
        return True
