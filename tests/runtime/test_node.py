"""Nodes on the in-memory stage: topics, steps, timers, parameters, requests, journal and exact replay."""

import msgspec
import pytest

from bunraku.msgs import Camera, Journal, Log, Message, Overlay, Params, Target, decode
from bunraku.runtime.journal import Replay
from bunraku.runtime.memory import MemoryStage
from bunraku.runtime.node import Node, Publisher, param, request, subscribe, timer
from bunraku.runtime.params import ParamProblem


class Follower(Node):
    """Follows the pelvis by halves; forgets on request."""

    name = "follower"
    out = Publisher("result", Target)
    gain: float = param(0.5, low=0.0, high=1.0, doc="share a message")
    mode: str = param("soft", choices=["soft", "hard"])

    def setup(self) -> None:
        self.x = 0.0
        self.yaw = 0.0
        self.ticks: list[int] = []

    @subscribe("target", Target)
    def on_target(self, msg: Target) -> None:
        goal = msg.pelvis[0] if msg.pelvis else 0.0
        self.x += (goal - self.x) * (1.0 if self.mode == "hard" else self.gain)
        self.say()

    @subscribe("camera", Camera, trigger=False)
    def on_camera(self, msg: Camera) -> None:
        self.yaw = msg.aspect

    @timer(hz=10, idle=True)
    def tick(self) -> None:
        self.ticks.append(self.now)
        self.x *= 0.9
        self.say()

    @request("reset")
    def reset(self, x: float = 0.0) -> dict[str, float]:
        if x < 0:
            raise ValueError("x must not be negative")
        self.x = x
        return {"x": self.x}

    def say(self) -> None:
        self.out.publish(Target(pelvis=(self.x, 0.0, 0.0), yaw=self.yaw))

    def save(self) -> bytes:
        return msgspec.msgpack.encode(self.x)

    def restore(self, state: bytes) -> None:
        self.x = msgspec.msgpack.decode(state)


def camera(aspect: float) -> Camera:
    return Camera(position=(0, 1, 3), rotation=(0, 0, 0, 1), yfov=0.6, aspect=aspect)


def test_a_message_is_answered_at_once_with_its_origin() -> None:
    stage = MemoryStage()
    stage.add(Follower)
    stage.publish("target", Target(pelvis=(2.0, 0.0, 0.0)), origin=12345)
    (answer,) = stage.received("result")
    assert answer.pelvis == (1.0, 0.0, 0.0)
    assert answer.origin == 12345
    assert answer.seq == 0
    assert answer.stamp == stage.clock.now()


def test_state_is_handed_over_with_the_next_step_and_never_triggers() -> None:
    stage = MemoryStage()
    stage.add(Follower)
    stage.publish("camera", camera(1.5))
    stage.publish("camera", camera(2.0))
    assert stage.received("result") == []
    stage.publish("target", Target())
    assert stage.last("result").yaw == 2.0


def test_idle_timer_keeps_quiet_while_messages_come() -> None:
    stage = MemoryStage()
    node = stage.add(Follower)
    for _ in range(20):
        stage.advance(0.1)
        stage.publish("target", Target(pelvis=(1.0, 0.0, 0.0)))
    assert len(node.ticks) == 1  # the one before the first message
    stage.advance(1.0)
    assert len(node.ticks) == 1 + 9


def test_timer_does_not_drift_and_leaves_missed_ticks_out() -> None:
    stage = MemoryStage()
    node = stage.add(Follower)
    start = stage.clock.now()
    stage.clock.tell(start + 350_000_000)
    node.step(stage.clock.now(), [])
    assert node.next_due() == start + 400_000_000


def test_parameters_are_checked_and_told() -> None:
    stage = MemoryStage()
    node = stage.add(Follower, gain="0.25")
    assert node.gain == 0.25
    reply = stage.ask(node, "param.set", name="gain", value=2.0)
    assert reply["ok"] is False
    assert "above its most" in reply["error"]
    assert stage.ask(node, "param.set", name="mode", value="loud")["ok"] is False
    assert stage.ask(node, "param.set", name="gain", value=1)["ok"] is True
    told = stage.last("params/follower")
    assert isinstance(told, Params)
    assert told.params["gain"].value == 1.0
    assert told.params["gain"].high == 1.0
    with pytest.raises(ParamProblem, match="no parameter 'gian'"):
        stage.add(Follower, name="other", gian=1.0)


def test_requests_are_answered_or_refused() -> None:
    stage = MemoryStage()
    node = stage.add(Follower)
    assert stage.ask(node, "reset", x=3.0) == {"ok": True, "x": 3.0}
    assert stage.ask(node, "reset", x=-1.0) == {"ok": False, "error": "x must not be negative"}
    assert "no request 'dance'" in stage.ask(node, "dance")["error"]


def test_namespace_and_remap() -> None:
    stage = MemoryStage()
    stage.add(Follower, namespace="alice", remap={"result": "target_two"})
    stage.publish("target", Target())
    assert stage.received("alice/target_two") == []
    stage.publish("alice/target", Target())
    assert len(stage.received("alice/target_two")) == 1
    assert len(stage.received("alice/journal/follower")) == 2


def test_garbage_is_counted_reported_once_a_second_and_dropped() -> None:
    stage = MemoryStage()
    node = stage.add(Follower)
    for body in (b"", b"\xc1", b"\x81", Target(yaw=float("nan")).encode(), msgspec.msgpack.encode({"pelvis": "x"})):
        for _ in range(20):
            stage.publish_body("target", body)
    assert node.invalid == {"target": 100}
    assert stage.received("result") == []
    assert len(stage.received("log/follower")) == 1
    stage.clock.tell(stage.clock.now() + 1_100_000_000)
    stage.publish_body("target", b"\x00")
    lines = [log.text for log in stage.received("log/follower") if isinstance(log, Log)]
    assert len(lines) == 2
    assert "dropped 100 invalid messages" in lines[1]


def test_gaps_are_counted_and_a_restart_is_none() -> None:
    stage = MemoryStage()
    node = stage.add(Follower)
    for seq in (0, 1, 5, 6, 0, 1):
        stage.publish_body("target", Target(seq=seq).encode())
    assert node.gaps == {"target": 3}


def test_pattern_subscription_tells_the_topic() -> None:
    class Watcher(Node):
        name = "watcher"

        def setup(self) -> None:
            self.seen: list[str] = []

        @subscribe("overlay/*", Overlay)
        def on_overlay(self, msg: Overlay, topic: str) -> None:
            self.seen.append(topic)

    stage = MemoryStage()
    node = stage.add(Watcher)
    stage.publish("overlay/controller", Overlay())
    stage.publish("bob/overlay/controller", Overlay())
    assert node.seen == ["overlay/controller"]


def drive(stage: MemoryStage, node: Follower) -> None:
    stage.publish("camera", camera(1.25))
    for index in range(7):
        stage.publish("target", Target(pelvis=(index * 0.1, 0.0, 0.0)))
        stage.advance(0.013 * index)
    stage.ask(node, "reset", x=0.7)
    stage.ask(node, "param.set", name="gain", value=0.9)
    stage.publish("target", Target(pelvis=(5.0, 0.0, 0.0)))
    stage.advance(0.5)


def bodies_by_seq(stage: MemoryStage) -> dict[tuple[str, int], bytes]:
    return {(topic, decode(Message, body).seq): body for topic, said in stage.bodies.items() for _, body in said}


def test_the_journal_replays_bit_for_bit() -> None:
    stage = MemoryStage()
    node = stage.add(Follower, gain=0.3)
    drive(stage, node)
    recorded = bodies_by_seq(stage)
    replay = Replay(lambda topic, seq: recorded[topic, seq], Follower)
    said = [one.body for entry in stage.received("journal/follower") for one in replay.follow(entry)]
    assert said == [body for _, body in stage.bodies["result"]]
    assert len(said) == 7 + 1 + 4  # the messages and the ticks of the last half second


def test_a_changed_node_replays_differently() -> None:
    class Other(Follower):
        def say(self) -> None:
            self.out.publish(Target(pelvis=(self.x + 1e-9, 0.0, 0.0), yaw=self.yaw))

    stage = MemoryStage()
    drive(stage, stage.add(Follower))
    recorded = bodies_by_seq(stage)
    replay = Replay(lambda topic, seq: recorded[topic, seq], Other)
    said = [one.body for entry in stage.received("journal/follower") for one in replay.follow(entry)]
    assert said != [body for _, body in stage.bodies["result"]]


def test_a_restart_takes_up_its_state_and_its_journal_says_so() -> None:
    stage = MemoryStage()
    node = stage.add(Follower)
    stage.publish("target", Target(pelvis=(1.0, 0.0, 0.0)))
    state = node.save()
    stage.remove(node)
    again = stage.add(Follower, state=state)
    assert again.x == 0.5
    starts = [one.start for one in stage.received("journal/follower") if isinstance(one, Journal) and one.start]
    assert [one["state"] for one in starts] == [None, state]
