"""The player against a clock that is told."""

from pathlib import Path

import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bunraku.runtime.bag import Bag, BagWriter
from bunraku.runtime.bag.player import Player

T0 = 1_700_000_000_000_000_000
MS = 1_000_000
NOW = 1_900_000_000_000_000_000


def make(path: Path, times: list[int], topics: str = "a") -> Bag:
    """A bag of messages received at these ms; sent 2 ms before that, from samples 5 ms before that."""
    with BagWriter(path, overwrite=True) as writer:
        for seq, at in enumerate(times):
            received = T0 + at * MS
            body = msgpack.packb({"stamp": received - 2 * MS, "origin": received - 5 * MS, "seq": seq, "x": at})
            writer.write(topics[seq % len(topics)], received, body)
    return Bag(path)


class Ear:
    """Plays to the end on a clock that wakes ``late`` ns after each deadline; keeps what came when."""

    def __init__(self, late: int = 0) -> None:
        self.now, self.late = NOW, late
        self.heard: list[tuple[int, str, dict]] = []

    def send(self, topic: str, body: bytes) -> None:
        self.heard.append((self.now, topic, msgpack.unpackb(body)))

    def run(self, player: Player, until: int | None = None) -> None:
        while (due := player.due()) is not None and (until is None or due <= until):
            self.now = max(self.now, due + self.late)
            player.play(self.now)
        if until is not None:
            self.now = max(self.now, until)

    @property
    def ms(self) -> list[float]:
        return [(at - NOW) / MS for at, _, _ in self.heard]


def test_messages_come_at_their_moments_with_times_moved_and_seq_kept(tmp_path: Path) -> None:
    ear = Ear()
    player = Player(make(tmp_path / "a", [0, 10, 35, 36]), ear.send)
    player.start(NOW)
    ear.run(player)
    assert player.done
    assert ear.ms == [0, 10, 35, 36]
    for seq, (at, topic, body) in enumerate(ear.heard):
        assert topic == "a"
        assert body["seq"] == seq
        assert body["stamp"] == at - 2 * MS
        assert body["origin"] == at - 5 * MS


@given(st.integers(0, 3 * MS), st.sampled_from([0.25, 0.5, 1.0, 2.0, 7.0]))
@settings(max_examples=20, deadline=None)
def test_a_late_clock_never_adds_up(tmp_path_factory, late: int, rate: float) -> None:
    ear = Ear(late)
    player = Player(make(tmp_path_factory.mktemp("bag") / "a", list(range(0, 5000, 16))), ear.send, rate=rate)
    player.start(NOW)
    ear.run(player)
    last = ear.heard[-1]
    assert abs(last[0] - NOW - 4992 * MS / rate) <= late + 1
    assert abs(last[2]["stamp"] - (NOW + 4992 * MS / rate - 2 * MS)) <= 1, "stamps follow the deadline, not the delay"


@pytest.mark.parametrize(("rate", "expected"), [(2.0, [0, 50, 100]), (0.5, [0, 200, 400])])
def test_rate(tmp_path: Path, rate: float, expected: list[float]) -> None:
    ear = Ear()
    player = Player(make(tmp_path / "a", [0, 100, 200]), ear.send, rate=rate)
    player.start(NOW)
    ear.run(player)
    assert ear.ms == expected
    assert {body["stamp"] - body["origin"] for _, _, body in ear.heard} == {3 * MS}, "latencies stay what they were"


def test_start_and_topics(tmp_path: Path) -> None:
    ear = Ear()
    player = Player(make(tmp_path / "a", [0, 10, 20, 30, 40, 50], "ab"), ear.send, start=0.015, topics={"b"})
    player.start(NOW)
    ear.run(player)
    assert [(topic, body["x"]) for _, topic, body in ear.heard] == [("b", 30), ("b", 50)]
    assert ear.ms == [15, 35]


def test_latched_messages_from_before_the_start_come_first(tmp_path: Path) -> None:
    ear = Ear()
    bag = make(tmp_path / "a", [0, 10, 20, 30, 40], "ab")
    player = Player(bag, ear.send, start=0.025, latched=["a"])
    player.start(NOW)
    ear.run(player)
    assert [(topic, body["x"]) for _, topic, body in ear.heard] == [("a", 20), ("b", 30), ("a", 40)]
    assert ear.ms == [0, 5, 15]


def test_looping_goes_on_without_a_gap_or_drift(tmp_path: Path) -> None:
    ear = Ear(late=MS)
    player = Player(make(tmp_path / "a", [0, 30, 100]), ear.send, loop=True, rate=2.0)
    player.start(NOW)
    ear.run(player, until=NOW + 500 * MS)
    assert [at - 1 for at in ear.ms] == [k * 50 + at for k in range(10) for at in (0, 15, 50)] + [500]
    assert [body["seq"] for _, _, body in ear.heard] == [0, 1, 2] * 10 + [0]
    stamps = [body["stamp"] for _, _, body in ear.heard]
    assert stamps == sorted(stamps)
    assert player.rounds == 10


def test_a_bag_of_one_moment_loops_without_hanging(tmp_path: Path) -> None:
    ear = Ear()
    player = Player(make(tmp_path / "a", [0]), ear.send, loop=True)
    player.start(NOW)
    assert player.play(NOW) == 1
    due = player.due()
    assert due is not None
    assert due > NOW


def test_a_pause_is_no_jump(tmp_path: Path) -> None:
    ear = Ear()
    player = Player(make(tmp_path / "a", [0, 100, 200, 300]), ear.send)
    player.start(NOW)
    ear.run(player, until=NOW + 130 * MS)
    player.pause(ear.now)
    player.pause(ear.now + 5)
    assert player.due() is None
    assert player.play(NOW + 9000 * MS) == 0
    assert player.position(NOW + 9000 * MS) == T0 + 130 * MS
    player.resume(NOW + 10_000 * MS)
    ear.run(player)
    assert ear.ms == [0, 100, 10_070, 10_170]
    assert [(body["stamp"] - at) for at, _, body in ear.heard] == [-2 * MS] * 4


def test_steps_send_one_message_each_and_playing_goes_on_from_there(tmp_path: Path) -> None:
    ear = Ear()
    player = Player(make(tmp_path / "a", [0, 100, 250, 300]), ear.send)
    player.start(NOW)
    ear.run(player, until=NOW + 10 * MS)
    player.pause(ear.now)
    for at in (1000, 2000):
        ear.now = NOW + at * MS
        entry = player.step(ear.now)
        assert entry is not None
    assert player.due() is None
    player.resume(NOW + 5000 * MS)
    ear.run(player)
    assert ear.ms == [0, 1000, 2000, 5050]
    assert player.step(ear.now) is None


def test_a_changed_rate_holds_from_that_moment(tmp_path: Path) -> None:
    ear = Ear()
    player = Player(make(tmp_path / "a", [0, 100, 200, 300]), ear.send)
    player.start(NOW)
    ear.run(player, until=NOW + 150 * MS)
    player.set_rate(0.5, ear.now)
    ear.run(player)
    assert ear.ms == [0, 100, 250, 450]
    assert player.position(NOW + 250 * MS) == T0 + 200 * MS
    player.set_rate(1e9, ear.now)
    assert player.rate == 100


@given(st.lists(st.integers(0, 50), min_size=2, max_size=30), st.lists(st.integers(0, 80), max_size=8), st.booleans())
@settings(max_examples=60, deadline=None)
def test_all_messages_come_once_and_in_order_whatever_is_pressed(tmp_path_factory, gaps, presses, slow) -> None:
    times = [sum(gaps[:k]) for k in range(len(gaps))]
    ear = Ear()
    player = Player(make(tmp_path_factory.mktemp("bag") / "a", times), ear.send)
    player.start(NOW)
    for number, press in enumerate(presses):
        ear.run(player, until=ear.now + press * MS)
        if number % 3 == 0:
            player.pause(ear.now)
        elif number % 3 == 1:
            player.resume(ear.now)
        else:
            player.set_rate(0.3 if slow else 3.0, ear.now)
    player.resume(ear.now)
    ear.run(player)
    assert [body["seq"] for _, _, body in ear.heard] == list(range(len(times)))
    assert ear.ms == sorted(ear.ms)


def test_what_cannot_be_played_is_refused(tmp_path: Path) -> None:
    bag = make(tmp_path / "a", [0, 1000])
    for options, why in (({"rate": 0.0}, "rate 0"), ({"start": 1.5}, "lasts 1.00 s"), ({"start": -1.0}, "start -1")):
        with pytest.raises(ValueError, match=why):
            Player(bag, lambda *_: None, **options)
    with pytest.raises(ValueError, match="holds no messages"):
        Player(make(tmp_path / "b", []), lambda *_: None)
