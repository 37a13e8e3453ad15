"""Exact replay of bags that nodes on an in-memory stage were recorded to."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from bunraku.msgs import Motion, Pose, Target
from bunraku.nodes.recorder.node import Recorder
from bunraku.runtime.bag import Bag, BagWriter
from bunraku.runtime.bag.check import ELSEWHERE, Journals, NodeCheck, check, compare, tolerance
from bunraku.runtime.bag.format import kind_for, machine
from bunraku.runtime.memory import MemoryStage
from bunraku.runtime.node import Node, Publisher, param, request, subscribe, timer


class Puppet(Node):
    """Follows the target's hand with a lag; the motion's root lifts it."""

    name = "puppet"
    pose = Publisher("pose", Pose)
    gain: float = param(0.1, low=0.0, high=1.0)
    where: np.ndarray
    lift = 0.0
    wrong = 0.0

    def setup(self) -> None:
        self.where = np.zeros(3)

    @subscribe("target", Target)
    def on_target(self, msg: Target) -> None:
        if msg.left_hand is not None:
            self.where = self.where + self.gain * (np.array(msg.left_hand) - self.where)
        if msg.yaw == 3.0:
            raise RuntimeError("a fault that does not end a node")
        self.say()

    @subscribe("motion", Motion, trigger=False)
    def on_motion(self, msg: Motion) -> None:
        self.lift = float(msg.root[1])

    @timer(hz=50, idle=True)
    def tick(self) -> None:
        self.where = self.where * 0.9
        self.say()

    @request("reset")
    def reset(self) -> None:
        self.where = np.zeros(3)

    def say(self) -> None:
        root = (self.where + np.array([0, self.lift, self.wrong])).astype("f4")
        self.pose.publish(Pose(skeleton="s", root=root, rotations=np.array([[0, 0, 0, 1]], "f4")))

    def save(self) -> bytes:
        return msgspec.msgpack.encode([*map(float, self.where), self.lift])

    def restore(self, state: bytes) -> None:
        *where, self.lift = msgspec.msgpack.decode(state)
        self.where = np.array(where)


class Drifting(Puppet):
    """Today's code, not quite yesterday's: wrong by a little from the first second on."""

    def say(self) -> None:
        self.wrong = 1e-7 if self.now >= MemoryStage().clock.now() + 10**9 else 0.0
        super().say()


class Broken(Puppet):
    """Says another thing."""

    def say(self) -> None:
        self.where = self.where + np.array([0.5, 0, 0])
        super().say()


class Mute(Puppet):
    """Forgets to say every third pose."""

    count = 0

    def say(self) -> None:
        self.count += 1
        if self.count % 3:
            super().say()


class Eye(Node):
    """Reads a device."""

    name = "eye"

    def setup(self) -> None:
        self.device = True


def play(stage: MemoryStage, rounds: int, seed: int = 1) -> None:
    random = np.random.default_rng(seed)
    for number in range(rounds):
        if number % 3 == 0:
            root = random.normal(size=3)
            stage.publish("motion", Motion(skeleton="s", root=root, rotations=np.array([[0, 0, 0, 1.0]])))
        hand = tuple(map(float, random.normal(size=3)))
        stage.publish("target", Target(left_hand=hand))
        stage.advance(0.01 if number % 7 else 0.1)


def recorded(path: Path, *, restart: bool = False) -> Path:
    stage = MemoryStage()
    recorder = stage.add(Recorder, output=str(path))
    puppet = stage.add(Puppet, gain=0.25)
    play(stage, 30)
    stage.ask(puppet, "reset")
    play(stage, 30, 2)
    stage.ask(puppet, "param.set", name="gain", value=0.5)
    play(stage, 30, 3)
    if restart:
        stage.remove(puppet)
        stage.advance(0.3)
        stage.add(Puppet, gain=0.25, state=puppet.save())
        play(stage, 40, 4)
    stage.remove(recorder)
    return path


def outcome(path: Path, allowed: float = 0.0, **options) -> NodeCheck:
    with Bag(path) as bag:
        (found,) = check(Journals(bag), ["puppet"], allowed, **options)
    return found


def test_the_same_code_says_the_same_to_the_last_bit(tmp_path: Path) -> None:
    path = recorded(tmp_path / "a.mcap")
    for _ in range(2):
        found = outcome(path)
        assert found.passed
        assert (found.different, found.first, found.problem, found.unrecorded) == (0, None, "", 0)
        assert found.starts == 1
        with Bag(path) as bag:
            counts = bag.statistics()
        assert found.compared == counts["pose"].count > 90
        assert found.steps == counts["journal/puppet"].count


def test_a_restart_inside_the_bag_is_followed(tmp_path: Path) -> None:
    found = outcome(recorded(tmp_path / "a.mcap", restart=True))
    assert found.passed
    assert (found.starts, found.different) == (2, 0)
    with Bag(tmp_path / "a.mcap") as bag:
        assert bag.statistics()["pose"].restarts == 1
        assert found.compared == bag.statistics()["pose"].count


def test_changed_code_is_found_with_time_and_field(tmp_path: Path) -> None:
    path = recorded(tmp_path / "a.mcap")
    found = outcome(path, node_class=Broken)
    assert not found.passed
    assert found.first is not None
    assert (found.first.topic, found.first.seq, found.first.field) == ("pose", 0, "root")
    assert found.largest > 0.5
    assert found.different == found.compared


def test_a_small_difference_counts_here_and_is_allowed_elsewhere(tmp_path: Path) -> None:
    path = recorded(tmp_path / "a.mcap")
    exact = outcome(path, node_class=Drifting)
    assert not exact.passed
    assert exact.first is not None
    assert exact.first.time >= 1.0
    assert 0 < exact.different < exact.compared
    allowed = outcome(path, ELSEWHERE, node_class=Drifting)
    assert allowed.passed
    assert allowed.different == exact.different
    assert 0 < allowed.largest < ELSEWHERE


def test_poses_that_are_not_said_any_more_are_found(tmp_path: Path) -> None:
    found = outcome(recorded(tmp_path / "a.mcap"), node_class=Mute)
    assert not found.passed
    assert found.first is not None


def test_a_fault_in_a_handler_happens_again_and_is_no_difference(tmp_path: Path) -> None:
    stage = MemoryStage()
    recorder = stage.add(Recorder, output=str(tmp_path / "a.mcap"))
    stage.add(Puppet)
    play(stage, 5)
    with pytest.raises(RuntimeError, match="a fault"):
        stage.publish("target", Target(left_hand=(1, 2, 3), yaw=3.0))
    stage.advance(0.1)
    play(stage, 5)
    stage.remove(recorder)
    found = outcome(tmp_path / "a.mcap")
    assert found.passed
    assert found.compared > 10


def edited(source: Path, output: Path, keep) -> Path:
    with Bag(source) as bag, BagWriter(output) as writer:
        for channel in bag.channels.values():
            writer.add_channel(channel)
        for number, entry in enumerate(bag.messages()):
            if keep(number, entry):
                writer.write(*entry)
    return output


def test_what_the_bag_lacks_is_said(tmp_path: Path) -> None:
    path = recorded(tmp_path / "a.mcap")
    targets = 0

    def lacks_one_target(number: int, entry) -> bool:
        nonlocal targets
        targets += entry.topic == "target"
        return not (entry.topic == "target" and targets == 20)

    found = outcome(edited(path, tmp_path / "b.mcap", lacks_one_target))
    assert not found.passed
    assert "message 19 of 'target'" in found.problem
    assert found.compared > 15, "what came before is compared"

    found = outcome(edited(path, tmp_path / "c.mcap", lambda number, entry: number > 40))
    assert not found.passed
    assert "beginning was not recorded" in found.problem

    journal = 0

    def lacks_a_step(number: int, entry) -> bool:
        nonlocal journal
        journal += entry.topic == "journal/puppet"
        return not (entry.topic == "journal/puppet" and journal == 20)

    found = outcome(edited(path, tmp_path / "d.mcap", lacks_a_step))
    assert "1 entries of its journal are missing" in found.problem

    found = outcome(edited(path, tmp_path / "e.mcap", lambda number, entry: entry.topic != "pose" or number % 2))
    assert found.passed
    assert found.unrecorded > 10


def test_a_publisher_that_began_again_is_told_apart(tmp_path: Path) -> None:
    def twice(path: Path, lost: int | None) -> NodeCheck:
        stage = MemoryStage()
        recorder = stage.add(Recorder, output=str(tmp_path / "whole.mcap"), overwrite=True)
        stage.add(Puppet)
        random = np.random.default_rng(1)
        for _ in range(2):
            for seq in range(20):
                hand = tuple(map(float, random.normal(size=3)))
                stage.publish_body("target", Target(stamp=stage.clock.now(), seq=seq, left_hand=hand).encode())
                stage.advance(0.1)
        stage.remove(recorder)
        targets = 0

        def keep(number: int, entry) -> bool:
            nonlocal targets
            targets += entry.topic == "target"
            return not (entry.topic == "target" and targets - 1 == lost)

        return outcome(edited(tmp_path / "whole.mcap", path, keep))

    assert twice(tmp_path / "a.mcap", None).passed
    lacking = twice(tmp_path / "b.mcap", 3)
    assert "message 3 of 'target'" in lacking.problem, "the other publisher's message 3 came much later"


def test_a_cut_bag_is_checked_to_its_end(tmp_path: Path) -> None:
    path = recorded(tmp_path / "a.mcap")
    whole = outcome(path).compared
    for keep in (150, 151, 152, 153):
        cut = edited(path, tmp_path / f"{keep}.mcap", lambda number, entry, keep=keep: number < keep)
        found = outcome(cut)
        assert found.passed, found
        assert 20 < found.compared < whole


def test_nodes_with_devices_are_left_out(tmp_path: Path) -> None:
    stage = MemoryStage()
    recorder = stage.add(Recorder, output=str(tmp_path / "a.mcap"))
    stage.add(Eye, namespace="alice")
    stage.add(Puppet, namespace="alice")
    stage.remove(recorder)
    with Bag(tmp_path / "a.mcap") as bag:
        journals = Journals(bag)
        assert set(journals.topics) == {"alice/eye", "alice/puppet"}
        eye, puppet = check(journals, ["alice/eye", "alice/puppet"], 0.0)
        assert "device" in eye.skipped
        assert eye.passed
        assert not puppet.skipped
        assert journals.classes("alice/puppet") == [f"{Puppet.__module__}:Puppet"]
        assert not journals.compiled("alice/puppet")


def test_bits_are_asked_for_only_where_the_bag_was_made_here(tmp_path: Path) -> None:
    for name, session, expected in (
        ("a", None, 0.0),
        ("b", {**machine(), "recovered_from": "x"}, 0.0),
        ("c", {**machine(), "processor": "another"}, ELSEWHERE),
        ("d", {}, ELSEWHERE),
    ):
        BagWriter(tmp_path / name, session=session).close()
        with Bag(tmp_path / name) as bag:
            assert tolerance(bag) == expected


def test_bodies_are_compared_field_by_field() -> None:
    def target(**fields) -> bytes:
        return Target(**fields).encode()

    from bunraku.runtime.bag import Channel

    kind = kind_for(Channel("target"))
    assert compare(kind, target(stamp=1, yaw=0.5), target(stamp=2, yaw=0.5)) is None
    assert compare(kind, target(yaw=0.5), target(yaw=0.25)) == ("yaw", "0.5 before, 0.25 now", 0.25)
    found = compare(kind, target(pelvis=(1.0, 2.0, 3.0)), target(pelvis=(1.0, 2.5, 3.25)))
    assert found == ("pelvis", "2 before, 2.5 now", 0.5)
    found = compare(kind, target(pelvis=(1, 2, 3)), target())
    assert found is not None
    assert found[0] == "pelvis"
    assert found[2] is None
    assert compare(kind, target(origin=1), target(origin=2)) == ("origin", "1 before, 2 now", None)
    assert compare(None, b"\xc1", b"\xc1") is None
    assert compare(None, b"\xc1", b"\xc0") == ("", "is no message", None)
