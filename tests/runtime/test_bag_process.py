"""Recording and playing between real processes over real sockets."""

import contextlib
import itertools
import json
import os
import pty
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgpack
import pytest
import zmq

from bunraku.msgs import Camera, Target, kind_of
from bunraku.runtime.bag import Bag, BagError, BagWriter
from bunraku.runtime.control import ask
from bunraku.runtime.names import make_run_folder, run_folder
from bunraku.runtime.topics import TopicReader, TopicWriter, cards

pytestmark = pytest.mark.stack
T0 = 1_700_000_000_000_000_000
MS = 1_000_000


@pytest.fixture
def folder(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path_factory.mktemp("r")))
    monkeypatch.setenv("BUNRAKU_STAGE", "t")
    return make_run_folder(run_folder())


@pytest.fixture
def bunraku() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    running: list[subprocess.Popen[str]] = []

    def start(*words: str, **options: Any) -> subprocess.Popen[str]:
        options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "stdin": subprocess.DEVNULL, **options}
        process = subprocess.Popen([sys.executable, "-m", "bunraku.cli", *words], text=True, **options)
        running.append(process)
        return process

    yield start
    for process in running:
        process.kill()
        process.communicate()


@pytest.fixture
def context() -> Iterator["zmq.Context[Any]"]:
    made: zmq.Context[Any] = zmq.Context()
    yield made
    made.destroy(linger=0)


def until(condition: Callable[[], Any], seconds: float = 30.0) -> Any:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        value = condition()
        if value:
            return value
        time.sleep(0.005)
    raise AssertionError("did not happen in time")


def attached(writer: TopicWriter) -> Callable[[], bool]:
    def look() -> bool:
        writer.attend()
        return writer.subscribers > 0

    return look


def seqs(path: Path, topic: str) -> list[int]:
    try:
        with Bag(path) as bag:
            return [msgpack.unpackb(entry.body)["seq"] for entry in bag.messages({topic})]
    except BagError:
        return []


def test_what_two_publishers_say_is_recorded_whole_and_ctrl_c_completes_it(folder, bunraku, context, tmp_path) -> None:
    path = tmp_path / "a.mcap"
    camera = TopicWriter(context, folder, "camera", kind_of("camera"), "someone")
    camera.send(Camera(position=(0, 1, 3), rotation=(0, 0, 0, 1), yfov=0.9, aspect=1.5).encode())
    recorder = bunraku("bag", "record", "-o", str(path), "--json")
    until(attached(camera))
    target = TopicWriter(context, folder, "alice/target", kind_of("target"), "hand")  # appears while it records
    until(attached(target))
    for seq in range(5000):
        target.send(Target(seq=seq, stamp=time.time_ns()).encode())
    until(lambda: ask(folder, "recorder", "status")["messages"] >= 5001)
    recorder.send_signal(signal.SIGINT)
    out, err = recorder.communicate(timeout=30)
    assert recorder.returncode == 0, err
    told = json.loads(out)
    assert (told["file"], told["gaps"]) == (str(path), 0)
    assert "recorded" in err
    with Bag(path) as bag:
        assert bag.complete
        assert bag.channels["alice/target"].node == "hand"
        assert bag.channels["camera"].latched
        assert bag.statistics()["camera"].count == 1
    assert seqs(path, "alice/target") == list(range(5000))
    target.close()
    camera.close()
    assert list(folder.iterdir()) == []


def test_what_was_sent_just_before_the_end_is_in_the_bag(folder, bunraku, context, tmp_path) -> None:
    path = tmp_path / "a.mcap"
    target = TopicWriter(context, folder, "target", kind_of("target"), "hand")
    recorder = bunraku("bag", "record", "-o", str(path), "target")
    until(attached(target))
    for seq in range(3000):
        target.send(Target(seq=seq).encode())
    recorder.send_signal(signal.SIGTERM)
    assert recorder.wait(30) == 0
    target.close()
    found = seqs(path, "target")
    assert found == list(range(len(found)))
    with Bag(path) as bag:
        assert bag.complete
        assert set(bag.channels) == {"target"}


def test_a_killed_recorder_leaves_what_was_flushed(folder, bunraku, context, tmp_path) -> None:
    path = tmp_path / "a.mcap"
    target = TopicWriter(context, folder, "target", kind_of("target"), "hand")
    recorder = bunraku("bag", "record", "-o", str(path))
    until(attached(target))
    for seq in range(500):
        target.send(Target(seq=seq).encode())
    until(lambda: len(seqs(path, "target")) == 500)  # nobody says anything: the timer hands it over
    for seq in range(500, 1500):
        target.send(Target(seq=seq).encode())
    recorder.kill()
    recorder.wait()
    found = seqs(path, "target")
    assert len(found) >= 500
    assert found == list(range(len(found)))
    info = bunraku("bag", "info", str(path), "--json")
    out, err = info.communicate(timeout=30)
    assert info.returncode == 0, err
    assert not json.loads(out)["complete"]
    mend = bunraku("bag", "recover", str(path), "-o", str(tmp_path / "b.mcap"))
    assert mend.wait(30) == 0
    assert seqs(tmp_path / "b.mcap", "target") == found

    target.close()
    reader = TopicReader(context, folder, "target")
    play = bunraku("bag", "play", str(path), "--rate", "50")
    heard: list[int] = []

    def listen() -> bool:
        while (body := reader.receive()) is not None:
            heard.append(msgpack.unpackb(body)["seq"])
        return len(heard) >= len(found)

    until(listen)
    assert play.wait(30) == 0, play.stderr.read()
    assert heard == found


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    path = tmp_path / "play.mcap"
    with BagWriter(path) as writer:
        view = Camera(stamp=T0, position=(0, 1, 3), rotation=(0, 0, 0, 1), yfov=0.9, aspect=1.5)
        writer.write("camera", T0, view.encode())
        for seq in range(60):
            now = T0 + seq * 20 * MS
            writer.write("target", now, Target(stamp=now - MS, origin=now - 3 * MS, seq=seq).encode())
            writer.write("journal/hand", now, msgpack.packb({"now": now, "seq": seq}))
    return path


def test_play_is_the_publisher_and_moves_times_to_now(folder, bunraku, context, bag) -> None:
    target = TopicReader(context, folder, "alice/target")
    before = time.time_ns()
    play = bunraku("bag", "play", str(bag), "--remap", "target:=alice/target", "--json")
    heard: list[tuple[int, dict]] = []
    views: list[bytes] = []
    shown: dict[str, Any] = {}

    def listen() -> bool:
        while (body := target.receive()) is not None:
            heard.append((time.time_ns(), msgpack.unpackb(body)))
        if heard and not shown:
            shown.update(cards(folder))
            shown["reader"] = TopicReader(context, folder, "camera")  # late: it was sent before
        if shown and (body := shown["reader"].receive()):
            views.append(body)
        return len(heard) == 60

    until(listen)
    out, err = play.communicate(timeout=30)
    assert play.returncode == 0, err
    assert json.loads(out) == {"file": str(bag), "messages": 61, "topics": 2, "rounds": 1}
    assert set(shown) == {"alice/target", "camera", "reader"}, "journals speak of processes that are not there"
    assert (shown["alice/target"]["type"], shown["camera"]["latched"]) == ("Target", True)
    assert len(views) == 1
    assert [body["seq"] for _, body in heard] == list(range(60))
    stamps = [body["stamp"] for _, body in heard]
    assert [b - a for a, b in itertools.pairwise(stamps)] == [20 * MS] * 59
    assert {body["stamp"] - body["origin"] for _, body in heard} == {2 * MS}
    assert before < stamps[0] <= heard[0][0]
    assert all(came >= body["stamp"] for came, body in heard), "none comes before its moment"
    assert not folder.exists() or list(folder.iterdir()) == []


def test_play_refuses_a_topic_that_is_said_and_ends_on_a_signal(folder, bunraku, context, bag) -> None:
    first = bunraku("bag", "play", str(bag), "--loop", "--wait", "0")
    until(lambda: {"camera", "target"} <= cards(folder).keys())
    second = bunraku("bag", "play", str(bag), "--wait", "0")
    _, err = second.communicate(timeout=30)
    assert second.returncode == 1
    assert err.count("\n") == 1
    assert "said by bag_play already" in err
    first.send_signal(signal.SIGTERM)
    _, err = first.communicate(timeout=30)
    assert first.returncode == 0, err
    assert not folder.exists() or list(folder.iterdir()) == []


def test_play_waits_for_the_subscribers_that_are_asked_for(folder, bunraku, context, bag) -> None:
    play = bunraku("bag", "play", str(bag), "--wait-for", "target", "--wait", "0.3")
    _, err = play.communicate(timeout=30)
    assert play.returncode == 1
    assert "nobody listens to target after 0.3 s" in err
    environment = {**os.environ, "BUNRAKU_SUBSCRIBERS": '{"target": 2}'}
    play = bunraku("bag", "play", str(bag), "--wait", "60", env=environment)
    one = TopicReader(context, folder, "target")
    until(lambda: "target" in cards(folder))
    assert not one.socket.poll(500), "the other one is awaited"
    other = TopicReader(context, folder, "target")
    bodies: dict[TopicReader, list[int]] = {one: [], other: []}

    def listen() -> bool:
        for reader, heard in bodies.items():
            while (body := reader.receive()) is not None:
                heard.append(msgpack.unpackb(body)["seq"])
        return all(len(heard) == 60 for heard in bodies.values())

    until(listen)
    assert play.wait(30) == 0


def test_play_ends_with_its_launcher(folder, bunraku, bag) -> None:
    out, into = os.pipe()
    environment = {**os.environ, "BUNRAKU_LAUNCHER_FD": str(out)}
    play = bunraku("bag", "play", str(bag), "--loop", "--wait", "0", env=environment, pass_fds=[out])
    until(lambda: "target" in cards(folder))
    os.close(out)
    os.close(into)
    assert play.wait(30) == 0


def test_keys_pause_step_and_end(folder, bunraku, context, bag) -> None:
    terminal, inside = pty.openpty()
    target = TopicReader(context, folder, "target")
    play = bunraku(
        "bag", "play", str(bag), "--topics", "target", "--paused", stdin=inside, stderr=inside, stdout=inside
    )
    os.close(inside)
    heard: list[int] = []
    screen = bytearray()

    def look() -> None:
        with contextlib.suppress(BlockingIOError, OSError):
            screen.extend(os.read(terminal, 4096))
        while (body := target.receive()) is not None:
            heard.append(msgpack.unpackb(body)["seq"])

    def shows(text: bytes) -> Callable[[], bool]:
        def check() -> bool:
            look()
            return text in screen

        return check

    def count(number: int) -> Callable[[], bool]:
        def check() -> bool:
            look()
            return len(heard) >= number

        return check

    os.set_blocking(terminal, False)
    until(shows(b"paused"))
    for number in (1, 2, 3):
        os.write(terminal, b"s")
        until(count(number))
    assert heard == [0, 1, 2], "paused: only what was asked for"
    os.write(terminal, b"---")
    until(shows(b"x0.59"))
    os.write(terminal, b" ")
    until(shows(b"playing"))
    until(count(5))
    os.write(terminal, b"q")
    assert play.wait(30) == 0
    look()
    assert heard == list(range(len(heard)))
    assert len(heard) < 60
    os.close(terminal)
