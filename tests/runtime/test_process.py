"""Nodes as real processes over real sockets: the contract of the run folder."""

import json
import os
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgpack
import pytest
import zmq

from bunraku.runtime.control import NoAnswer, ask
from bunraku.runtime.names import NameProblem, endpoint, file_of, make_run_folder, run_folder

pytestmark = pytest.mark.stack
HERE = Path(__file__).parent
RUN = """
import sys; sys.path.insert(0, {here!r})
import stack_nodes
from bunraku.runtime.loop import run_node
sys.exit(run_node(stack_nodes.{node}, **{options!r}))
"""


@pytest.fixture
def folder(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path_factory.mktemp("r")))
    monkeypatch.setenv("BUNRAKU_STAGE", "t")
    return run_folder()


@pytest.fixture
def start() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    running: list[subprocess.Popen[str]] = []

    def begin(node: str, **options: Any) -> subprocess.Popen[str]:
        code = RUN.format(here=str(HERE), node=node, options=options)
        process = subprocess.Popen(
            [sys.executable, "-c", code], stderr=subprocess.PIPE, text=True, env={**os.environ, "BUNRAKU_JIT": "0"}
        )
        running.append(process)
        return process

    yield begin
    for process in running:
        process.kill()
        process.wait()
        if process.stderr:
            process.stderr.close()


def until(condition: Callable[[], Any], seconds: float = 20.0) -> Any:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        value = condition()
        if value:
            return value
        time.sleep(0.005)
    raise AssertionError("did not happen in time")


class Peer:
    """A plain pyzmq peer: publisher of one topic, reader of another."""

    def __init__(self, folder: Path, says: str | None, hears: str) -> None:
        self.context: zmq.Context[Any] = zmq.Context()
        self.hear: zmq.Socket[bytes] = self.context.socket(zmq.SUB)
        self.hear.setsockopt(zmq.RECONNECT_IVL, 20)
        self.hear.connect(endpoint(file_of(folder, hears)))
        self.hear.subscribe(b"")
        if says:
            make_run_folder(folder)
            self.say: zmq.Socket[bytes] = self.context.socket(zmq.XPUB)
            self.say.bind(endpoint(file_of(folder, says)))

    def heard(self, milliseconds: int = 20_000) -> dict[str, Any]:
        assert self.hear.poll(milliseconds), "nothing heard"
        body: dict[str, Any] = msgpack.unpackb(self.hear.recv())
        return body

    def close(self) -> None:
        self.context.destroy(linger=0)


def test_wire_card_and_clean_end(folder: Path, start: Callable[..., subprocess.Popen[str]]) -> None:
    peer = Peer(folder, "target", "result")
    process = start("Relay")
    assert peer.say.poll(20_000)
    assert peer.say.recv() == b"\x01"
    until(lambda: file_of(folder, "result", ".json").exists())
    card = json.loads(file_of(folder, "result", ".json").read_text())
    assert card.keys() >= {"node", "pid", "type", "schema", "latched", "rate"}
    assert (card["node"], card["pid"], card["type"], card["latched"]) == ("relay", process.pid, "Target", False)
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    until(lambda: peer.say.send(msgpack.packb({"pelvis": [1, 2, 3], "origin": 77})) or peer.hear.poll(50))
    answer = peer.heard()
    assert answer["pelvis"] == [1.0, 2.0, 3.0]
    assert answer["origin"] == 77
    assert abs(answer["stamp"] - time.time_ns()) < 60e9
    process.send_signal(signal.SIGTERM)
    assert process.wait(20) == 0
    peer.close()
    file_of(folder, "target").unlink(missing_ok=True)
    assert not folder.exists() or os.listdir(folder) == []


def test_latched_topics_reach_who_comes_late(folder: Path, start: Callable[..., subprocess.Popen[str]]) -> None:
    start("Relay")
    until(lambda: file_of(folder, "params.relay").exists())
    for _ in range(3):
        late = Peer(folder, None, "params/relay")
        assert late.heard()["node"] == "relay"
        late.close()


def test_killed_and_started_again_it_takes_up(folder: Path, start: Callable[..., subprocess.Popen[str]]) -> None:
    peer = Peer(folder, "target", "result")
    first = start("Relay")
    until(lambda: peer.say.send(msgpack.packb({})) or peer.hear.poll(20))
    count = peer.heard()["yaw"]
    first.send_signal(signal.SIGKILL)
    first.wait(20)
    start("Relay")
    latest = until(lambda: peer.say.send(msgpack.packb({})) or (peer.hear.poll(20) and peer.heard()["yaw"]))
    assert latest > count
    peer.close()


def test_second_of_a_name_and_taken_topic_are_refused(
    folder: Path, start: Callable[..., subprocess.Popen[str]]
) -> None:
    start("Relay")
    until(lambda: file_of(folder, "result", ".json").exists())
    again = start("Relay")
    assert again.wait(20) == 2
    assert "a node 'relay' runs on this stage already" in again.communicate()[1]
    other = start("Relay", name="other")
    assert other.wait(20) == 2
    assert "topic 'result' is said by relay already" in other.communicate()[1]


def test_requests_over_the_control_socket(folder: Path, start: Callable[..., subprocess.Popen[str]]) -> None:
    start("Relay")
    until(lambda: file_of(folder, "relay", ".ctl").exists())
    info = ask(folder, "relay", "info")["info"]
    assert info["hears"] == ["target"]
    assert "result" in info["says"]
    with pytest.raises(ValueError, match="no request 'sing'"):
        ask(folder, "relay", "sing")
    with pytest.raises(NoAnswer, match="no node 'nobody'"):
        ask(folder, "nobody", "info")


def test_a_failing_handler_is_told_and_the_node_lives(
    folder: Path, start: Callable[..., subprocess.Popen[str]]
) -> None:
    peer = Peer(folder, None, "tick")
    process = start("Ticker")
    until(lambda: peer.heard()["yaw"] > 8)
    process.send_signal(signal.SIGINT)
    assert process.wait(20) == 0
    assert "RuntimeError: the fifth tick fails" in process.communicate()[1]
    peer.close()


def test_the_launchers_end_is_the_nodes_end(
    folder: Path, start: Callable[..., subprocess.Popen[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    read, write = os.pipe()
    monkeypatch.setenv("BUNRAKU_LAUNCHER_FD", str(read))
    code = RUN.format(here=str(HERE), node="Relay", options={})
    process = subprocess.Popen([sys.executable, "-c", code], pass_fds=[read])
    os.close(read)
    until(lambda: file_of(folder, "relay", ".ctl").exists())
    os.close(write)
    assert process.wait(20) == 0
    assert not folder.exists()


def test_raw_ears_find_topics_that_appear_later(folder: Path, start: Callable[..., subprocess.Popen[str]]) -> None:
    peer = Peer(folder, "target", "heard")
    start("Ear")
    start("Relay", namespace="alice", remap={"target": "/target"})
    until(lambda: peer.say.send(msgpack.packb({})) or peer.hear.poll(20))
    assert peer.heard()["yaw"] >= 1
    peer.close()


def test_several_frames_and_giants_are_dropped(folder: Path, start: Callable[..., subprocess.Popen[str]]) -> None:
    peer = Peer(folder, "target", "result")
    start("Relay")
    until(lambda: peer.say.send(msgpack.packb({})) or peer.hear.poll(20))
    peer.say.send_multipart([b"a", msgpack.packb({})])
    peer.say.send(b"\xc6\x00\xff\xff\xff" + bytes(0xFFFFFF))  # 16 MiB
    before = peer.heard()["yaw"]
    until(lambda: peer.say.send(msgpack.packb({})) or (peer.hear.poll(20) and peer.heard()["yaw"] > before))
    peer.close()


def test_names_and_places_have_limits(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with pytest.raises(NameProblem, match="longer than 107 bytes"):
        endpoint(tmp_path / ("x" * 120))
    with pytest.raises(NameProblem, match="stage name"):
        run_folder("../elsewhere")
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    assert run_folder("a").parent.name == f"bunraku-{os.getuid()}"


def test_a_told_clock_moves_the_timers(folder: Path, start: Callable[..., subprocess.Popen[str]]) -> None:
    peer = Peer(folder, "clock", "tick")
    start("Ticker", bag_clock=True)
    assert peer.say.poll(20_000)
    until(lambda: file_of(folder, "tick", ".json").exists())
    assert not peer.hear.poll(300), "it ticks by itself"
    now = 1_600_000_000_000_000_000

    def tell() -> bool:
        nonlocal now
        now += 10_000_000
        peer.say.send(msgpack.packb({"now": now}))
        return bool(peer.hear.poll(50))

    until(tell)
    assert abs(peer.heard()["stamp"] - now) < 1_000_000_000
    peer.close()
