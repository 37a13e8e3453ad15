"""The recorder on an in-memory stage."""

from pathlib import Path

import pytest

from bunraku.msgs import Camera, Target
from bunraku.nodes.recorder.node import Recorder
from bunraku.runtime.bag import Bag, BagWriter
from bunraku.runtime.memory import MemoryStage


def camera() -> Camera:
    return Camera(position=(0, 1, 3), rotation=(0, 0, 0, 1), yfov=0.9, aspect=1.5)


def bodies(path: Path) -> list[tuple[str, bytes]]:
    with Bag(path) as bag:
        assert bag.complete
        return [(entry.topic, entry.body) for entry in bag.messages() if not entry.topic.endswith("recorder")]


def test_every_message_of_every_topic_is_recorded_as_it_came(tmp_path: Path) -> None:
    stage = MemoryStage()
    node = stage.add(Recorder, output=str(tmp_path / "a.mcap"))
    begin = stage.clock.now()
    for _ in range(5):
        stage.advance(0.1)
        stage.publish("alice/target", Target(yaw=0.5))
    stage.publish_body("target", b"no message at all")
    stage.publish_body("something/own", b"\x80")
    sent = [(topic, body) for topic in ("alice/target", "target", "something/own") for _, body in stage.bodies[topic]]
    stage.remove(node)
    assert bodies(tmp_path / "a.mcap") == sent
    with Bag(tmp_path / "a.mcap") as bag:
        times = [entry.received - begin for entry in bag.messages({"alice/target"})]
        assert times == [100_000_000 * k for k in range(1, 6)]
        assert bag.channels["alice/target"].type == "Target"
        assert bag.channels["something/own"].type == ""
        assert {"log/recorder", "params/recorder"} <= bag.channels.keys()


def test_topics_are_chosen_by_name_and_pattern(tmp_path: Path) -> None:
    stage = MemoryStage()
    node = stage.add(Recorder, output=str(tmp_path / "a.mcap"), topics=["target", "bob/*"])
    for topic in ("target", "alice/target", "bob/target", "pose"):
        stage.publish(topic, Target())
    stage.remove(node)
    assert [topic for topic, _ in bodies(tmp_path / "a.mcap")] == ["target", "bob/target"]


def test_in_a_namespace_it_records_that_one(tmp_path: Path) -> None:
    stage = MemoryStage()
    node = stage.add(Recorder, namespace="alice", output=str(tmp_path / "a.mcap"))
    stage.publish("alice/target", Target())
    stage.publish("bob/target", Target())
    stage.remove(node)
    assert [topic for topic, _ in bodies(tmp_path / "a.mcap")] == ["alice/target"]


def test_it_starts_and_stops_when_asked(tmp_path: Path) -> None:
    stage = MemoryStage()
    node = stage.add(Recorder)
    stage.publish("camera", camera())
    assert stage.ask(node, "status") == {"ok": True, "recording": False}
    assert "start" in stage.ask(node, "stop")["error"]
    assert "give the file" in stage.ask(node, "start")["error"]
    first, second = tmp_path / "a.mcap", tmp_path / "b.mcap"
    assert stage.ask(node, "start", output=str(first))["ok"]
    assert "is being written" in stage.ask(node, "start", output=str(second))["error"]
    for seq in (0, 1, 4):
        stage.publish_body("target", Target(seq=seq).encode())
    assert stage.ask(node, "status")["gaps"] == 2
    told = stage.ask(node, "stop")
    assert (told["recording"], told["file"], told["gaps"]) == (False, str(first), 2)
    stage.publish("target", Target())
    assert stage.ask(node, "start", output=str(second))["ok"]
    stage.publish("pose", Target())
    stage.ask(node, "stop")
    assert [topic for topic, _ in bodies(first)].count("target") == 3
    assert "recorded" in stage.last("log/recorder").text


def test_a_latched_message_heard_before_is_in_each_bag(tmp_path: Path) -> None:
    stage = MemoryStage()
    node = stage.add(Recorder, output=str(tmp_path / "a.mcap"))
    stage.publish("camera", camera())
    stage.ask(node, "stop")
    stage.ask(node, "start", output=str(tmp_path / "b.mcap"))
    stage.ask(node, "stop")
    with Bag(tmp_path / "b.mcap") as bag:
        assert [entry.body for entry in bag.messages({"camera"})] == [stage.bodies["camera"][0][1]]
        assert bag.channels["camera"].latched


def test_a_new_output_parameter_begins_another_bag(tmp_path: Path) -> None:
    stage = MemoryStage()
    node = stage.add(Recorder, output=str(tmp_path / "a.mcap"))
    stage.publish("target", Target())
    assert stage.ask(node, "param.set", name="output", value=str(tmp_path / "b.mcap"))["ok"]
    stage.publish("target", Target())
    stage.publish("target", Target())
    assert stage.ask(node, "param.set", name="output", value="")["ok"]
    stage.publish("target", Target())
    assert [len(bodies(tmp_path / name)) for name in ("a.mcap", "b.mcap")] == [1, 2]


def test_an_existing_bag_is_replaced_only_when_allowed(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with BagWriter(path) as writer:
        writer.write("old", 1, b"")
    stage = MemoryStage()
    with pytest.raises(ValueError, match="exists already"):
        stage.add(Recorder, output=str(path))
    stage = MemoryStage()
    node = stage.add(Recorder)
    assert "exists already" in stage.ask(node, "start", output=str(path))["error"]
    with Bag(path) as bag:
        assert list(bag.channels) == ["old"]
    assert stage.ask(node, "start", output=str(path), overwrite=True)["ok"]
    stage.remove(node)
    assert bodies(path) == []


def test_what_is_a_second_old_can_be_read_while_it_records(tmp_path: Path) -> None:
    stage = MemoryStage()
    stage.add(Recorder, output=str(tmp_path / "a.mcap"))
    stage.publish("target", Target())
    stage.advance(1.0)
    with Bag(tmp_path / "a.mcap") as bag:
        assert not bag.complete
        assert len(list(bag.messages({"target"}))) == 1


def test_a_full_disk_ends_the_node_with_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stage = MemoryStage()
    node = stage.add(Recorder, output=str(tmp_path / "a.mcap"))
    stage.publish("target", Target())

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    assert node.writer is not None
    monkeypatch.setattr(node.writer._writer, "flush", full)
    stage.advance(1.0)
    assert stage.status == 1
    assert "No space left" in stage.last("log/recorder").text
    stage.remove(node)
