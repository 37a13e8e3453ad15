"""Writing, reading and mending bags."""

import json
import os
import random
from pathlib import Path

import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from bunraku.msgs import Camera, Target, schema
from bunraku.runtime.bag import Bag, BagError, BagWriter, Channel, Entry, TopicStats, header, shifted
from bunraku.runtime.bag.info import describe, table
from bunraku.runtime.bag.recover import recover

T0 = 1_700_000_000_000_000_000
MS = 1_000_000

TOPICS = st.from_regex(r"[a-z0-9_]{1,8}(/[a-z0-9_]{1,8}){0,2}", fullmatch=True)
BODIES = st.binary(max_size=300) | st.builds(
    lambda stamp, seq: msgpack.packb({"stamp": stamp, "seq": seq}),
    st.integers(0, 2**64 - 1),
    st.integers(-5, 2**63),
)
ENTRIES = st.lists(st.tuples(TOPICS, BODIES), max_size=60)


def body(seq: int, size: int = 0) -> bytes:
    return msgpack.packb({"stamp": T0 + seq, "origin": T0, "seq": seq, "fill": random.Random(seq).randbytes(size)})


def written(path: Path, entries: list[Entry], *, close: bool = True, flush_every: int = 0) -> BagWriter:
    writer = BagWriter(path)
    for number, entry in enumerate(entries, 1):
        writer.write(*entry)
        if flush_every and number % flush_every == 0:
            writer.flush()
    if close:
        writer.close()
    return writer


@given(ENTRIES)
@settings(max_examples=60, deadline=None)
def test_any_bodies_on_any_topics_come_back_as_they_were(tmp_path_factory: pytest.TempPathFactory, sent) -> None:
    path = tmp_path_factory.mktemp("bag") / "a.mcap"
    entries = [Entry(topic, T0 + number * MS, data) for number, (topic, data) in enumerate(sent)]
    written(path, entries)
    with Bag(path) as bag:
        assert bag.complete
        assert list(bag.messages()) == entries
        assert set(bag.channels) == {entry.topic for entry in entries}
        counted = bag.statistics()
        assert {topic: stats.count for topic, stats in counted.items()} == {
            topic: sum(entry.topic == topic for entry in entries) for topic in bag.channels
        }
        assert sum(stats.bytes for stats in counted.values()) == sum(len(data) for _, data in sent)
    with path.open("rb") as file:
        plain = [
            (channel.topic, message.log_time, message.data) for _, channel, message in make_reader(file).iter_messages()
        ]
    assert plain == [tuple(entry) for entry in entries]


def test_the_format_is_the_documented_one(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    target = Target(stamp=T0, seq=2**40 + 7).encode()
    written(path, [Entry("alice/target", T0 + MS, target), Entry("own", T0 + 2 * MS, b"\xc0")])
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "bunraku"
        (kind, channel, message), (no_kind, other, loose) = reader.iter_messages()
    assert kind is not None
    assert (channel.topic, channel.message_encoding) == ("alice/target", "msgpack")
    assert (kind.name, kind.encoding, json.loads(kind.data)) == ("Target", "jsonschema", schema(Target))
    assert (message.log_time, message.publish_time, message.data) == (T0 + MS, T0, target)
    assert message.sequence == 7, "32 bits of seq"
    assert (no_kind, other.topic, loose.publish_time) == (None, "own", T0 + 2 * MS)


def test_messages_are_chosen_by_topic_and_time(tmp_path: Path) -> None:
    entries = [Entry("ab"[number % 2], T0 + number * MS, body(number, 2000)) for number in range(400)]
    written(tmp_path / "a.mcap", entries)
    with Bag(tmp_path / "a.mcap") as bag:
        assert bag.chunks > 4
        assert (bag.start, bag.end) == (T0, T0 + 399 * MS)
        chosen = list(bag.messages({"b"}, T0 + 100 * MS, T0 + 301 * MS))
        assert chosen == [entry for entry in entries[100:301] if entry.topic == "b"]
        assert list(bag.messages({"none"})) == []
        seen: list[tuple[int, int]] = []
        assert len(list(bag.messages(progress=lambda done, whole: seen.append((done, whole))))) == 400
        assert seen == sorted(seen)
        assert seen[-1] == (bag.size, bag.size)


def test_a_file_out_of_order_is_read_in_the_order_of_time(tmp_path: Path) -> None:
    entries = [Entry("a", T0 + number * MS, body(number)) for number in range(200)]
    shuffled = entries.copy()
    random.Random(1).shuffle(shuffled)
    written(tmp_path / "a.mcap", shuffled, flush_every=7)
    with Bag(tmp_path / "a.mcap") as bag:
        assert list(bag.messages()) == entries


def test_equal_times_keep_the_order_of_the_file(tmp_path: Path) -> None:
    entries = [Entry("a", T0 + number // 10, body(number)) for number in range(100)]
    written(tmp_path / "a.mcap", entries, flush_every=3)
    with Bag(tmp_path / "a.mcap") as bag:
        assert list(bag.messages()) == entries


def test_what_was_flushed_is_there_when_the_writer_never_ends(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    entries = [Entry("a", T0 + number * 10 * MS, body(number)) for number in range(200)]
    writer = BagWriter(path)
    for number, entry in enumerate(entries):
        writer.write(*entry)
        if number % 20 == 0:
            with Bag(path) as bag:
                kept = list(bag.messages())
                assert not bag.complete
            assert kept == entries[: len(kept)]
            assert not kept or entry.received - kept[-1].received <= 260 * MS
    assert not writer.flush_due(entries[-1].received)
    assert writer.flush_due(entries[-1].received + 500 * MS), "a quiet topic is flushed by the timer"
    with Bag(path) as bag:
        assert list(bag.messages()) == entries
    writer.close()


def test_cut_at_every_byte_all_whole_chunks_are_kept(tmp_path: Path) -> None:
    path, cut = tmp_path / "a.mcap", tmp_path / "cut.mcap"
    entries = [Entry(f"t{number % 3}", T0 + number * MS, body(number)) for number in range(30)]
    written(path, entries, flush_every=5)
    data = path.read_bytes()
    ends = []
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    for index in summary.chunk_indexes:
        ends.append(index.chunk_start_offset + index.chunk_length)
    assert len(ends) == 6
    for length in range(len(data) - 1, -1, -1):
        cut.write_bytes(data[:length])
        whole = 5 * sum(end <= length for end in ends)
        try:
            with Bag(cut) as bag:
                kept = list(bag.messages())
                assert not bag.complete
        except BagError as error:
            assert length < 60, "only a file without a header is no bag"
            assert "\n" not in str(error)
            continue
        assert kept == entries[:whole]
        if length % 37 == 0:
            found = recover(cut, tmp_path / "mended.mcap", overwrite=True)
            assert found.messages == whole
            with Bag(tmp_path / "mended.mcap") as bag:
                assert bag.complete
                assert list(bag.messages()) == kept


@given(st.binary(max_size=400), st.sampled_from([0, 8, 30, 60]))
@settings(max_examples=200, deadline=None)
def test_garbage_is_refused_in_one_line_or_read_as_little(tmp_path_factory, garbage: bytes, keep: int) -> None:
    folder = tmp_path_factory.mktemp("bag")
    written(folder / "a.mcap", [Entry("a", T0, b"x")])
    path = folder / "b.mcap"
    path.write_bytes((folder / "a.mcap").read_bytes()[:keep] + garbage)
    try:
        with Bag(path) as bag:
            describe(bag)
            assert not bag.complete
    except BagError as error:
        assert "\n" not in str(error)
        assert str(path) in str(error)


@given(st.data())
@settings(max_examples=150, deadline=None)
def test_flipped_bytes_cost_their_chunk_and_no_more(tmp_path_factory, data: st.DataObject) -> None:
    folder = tmp_path_factory.mktemp("bag")
    path = folder / "a.mcap"
    entries = [Entry("a", T0 + number * MS, body(number)) for number in range(12)]
    written(path, entries, flush_every=3)
    bytes_ = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        bytes_[data.draw(st.integers(80, len(bytes_) - 1))] ^= data.draw(st.integers(1, 255))
    path.write_bytes(bytes_)
    try:
        with Bag(path) as bag:
            kept = list(bag.messages())
            table(describe(bag))
    except BagError as error:
        assert "\n" not in str(error)
    else:
        assert all(any(entry.body == other.body for other in entries) for entry in kept)


def test_a_damaged_chunk_is_left_out_and_said(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    entries = [Entry("a", T0 + number * MS, body(number, 100)) for number in range(30)]
    written(path, entries, flush_every=10)
    data = bytearray(path.read_bytes())
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    middle = summary.chunk_indexes[1]
    data[middle.chunk_start_offset + middle.chunk_length // 2] ^= 0xFF
    path.write_bytes(data)
    with Bag(path) as bag:
        assert list(bag.messages()) == entries[:10] + entries[20:]
        assert bag.damaged == 1
        assert any("damaged" in line for line in table(describe(bag)))
    assert recover(path, tmp_path / "b.mcap").damaged == 1


def test_recover_keeps_what_channels_and_session_say(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    writer = BagWriter(path, session={"machine": "m1"})
    channel = Channel("odd/name", "Strange", b'{"type": "object"}', latched=True, node="wizard")
    writer.add_channel(channel)
    writer.write("odd/name", T0, body(1))
    writer.flush()
    recover(path, tmp_path / "b.mcap")
    with Bag(tmp_path / "b.mcap") as bag:
        assert bag.channels == {"odd/name": channel}
        assert bag.session == {"machine": "m1", "recovered_from": "a.mcap"}
    with pytest.raises(BagError, match="is the bag itself"):
        recover(path, path, overwrite=True)
    with pytest.raises(BagError, match="exists already"):
        recover(path, tmp_path / "b.mcap")
    writer.close()


def test_the_writer_refuses_what_it_cannot_write(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_text("precious")
    with pytest.raises(BagError, match="exists already"):
        BagWriter(path)
    assert path.read_text() == "precious"
    BagWriter(path, overwrite=True).close()
    with pytest.raises(BagError, match="cannot be written: No such file"):
        BagWriter(tmp_path / "none" / "a.mcap")
    with pytest.raises(BagError, match="cannot be written: Is a directory"):
        BagWriter(tmp_path, overwrite=True)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="the system has no /dev/full")
def test_a_full_disk_is_one_line() -> None:
    with pytest.raises(BagError, match="/dev/full: No space left"):
        BagWriter("/dev/full", overwrite=True)


def test_no_bag_is_one_line(tmp_path: Path) -> None:
    for name, content, why in (("a", b"", "is empty"), ("b", b"hello " * 99, "is not a bag")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(BagError, match=why):
            Bag(tmp_path / name)
    with pytest.raises(BagError, match="does not exist"):
        Bag(tmp_path / "none")
    with pytest.raises(BagError, match="cannot be read: Is a directory"):
        Bag(tmp_path)


def test_gaps_restarts_and_repeats_are_counted() -> None:
    stats = TopicStats()
    for second, seq in enumerate([5, 6, 9, 9, 10, 0, 1, None, 2]):
        stats.add(T0 + second * 1000 * MS, 10, seq)
    assert (stats.count, stats.bytes, stats.gaps, stats.restarts, stats.repeats, stats.invalid) == (9, 90, 2, 1, 1, 1)
    assert stats.rate == pytest.approx(1.0)
    assert TopicStats.from_dict(stats.as_dict()).as_dict() == stats.as_dict()
    assert TopicStats().rate is None


def test_info_says_the_same_of_a_complete_and_a_killed_recording(tmp_path: Path) -> None:
    entries = [
        Entry("camera", T0, Camera(stamp=T0, position=(0, 1, 3), rotation=(0, 0, 0, 1), yfov=0.9, aspect=1.5).encode())
    ]
    entries += [Entry("pose", T0 + number * 100 * MS, body(number)) for number in range(1, 51) if number % 10]
    writer = written(tmp_path / "a.mcap", entries, close=False)
    writer.flush()
    with Bag(tmp_path / "a.mcap") as bag:
        killed = describe(bag)
    writer.close()
    with Bag(tmp_path / "a.mcap") as bag:
        clean = describe(bag)
    assert killed["topics"] == clean["topics"]
    assert (killed["complete"], clean["complete"]) == (False, True)
    assert (clean["messages"], clean["gaps"], clean["duration"]) == (46, 4, 4.9)
    camera, pose = clean["topics"]
    assert (camera["topic"], camera["type"], camera["latched"], camera["rate"]) == ("camera", "Camera", True, None)
    assert pose["rate"] == pytest.approx(44 / 4.8)
    assert "killed" in "\n".join(table(killed))
    assert "complete" in "\n".join(table(clean))


@given(
    st.dictionaries(
        st.text(max_size=8) | st.sampled_from(["stamp", "origin", "seq"]),
        st.integers(0, 2**62)
        | st.binary(max_size=40)
        | st.none()
        | st.floats(allow_nan=False)
        | st.lists(st.booleans()),
    ),
    st.integers(-(2**62), 2**62),
)
def test_shifting_moves_two_times_and_leaves_the_rest(fields: dict, offset: int) -> None:
    moved = msgpack.unpackb(shifted(msgpack.packb(fields), offset))
    for key, value in fields.items():
        if key in ("stamp", "origin") and isinstance(value, int):
            assert moved[key] == min(max(value + offset, 0), 2**63 - 1)
        else:
            assert moved[key] == value
    assert list(moved) == list(fields)


@given(st.binary(max_size=60))
def test_what_is_no_message_is_not_shifted_and_has_no_header(data: bytes) -> None:
    try:
        is_map = isinstance(msgpack.unpackb(data), dict)
    except ValueError:
        is_map = False
    if not is_map:
        assert shifted(data, 5) == data
        assert header(data).stamp is None


def test_single_precision_numbers_are_not_widened_by_a_shift() -> None:
    narrow = msgpack.packb({"stamp": 1, "x": 0.1}, use_single_float=True)
    assert len(shifted(narrow, 1)) == len(narrow)
