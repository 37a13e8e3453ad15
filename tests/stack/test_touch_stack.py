"""The touch stack as its users run it: real processes, real sockets, real ends."""

import os
import random
import signal
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
from launched import Stack, read, until

from bunraku.figure.camera import default_camera, project
from bunraku.runtime.control import ask
from bunraku.runtime.names import file_of

pytestmark = [pytest.mark.stack, pytest.mark.timeout(600)]
Launch = Callable[..., Stack]
TOUCH = ("touch", "source:=tuio", "port:=0", "window:=off")


def frame(contacts: list[dict[str, Any]], seq: int) -> bytes:
    packed: bytes = msgpack.packb({"device": "test", "contacts": contacts, "seq": seq})
    return packed


def drag(stack: Stack, count: int = 60, recorded: bool = False) -> dict[str, Any]:
    """Drag the left hand as a device would, once it is heard (and recorded); gives the last pose."""
    camera, pose = stack.reader("camera"), stack.reader("pose")
    read(camera)
    touch = stack.writer("touch")
    assert touch.poll(30_000), "nobody hears touches"
    while recorded:
        assert touch.poll(30_000), "the recorder does not hear touches"
        recorded = touch.recv() != b"\x01\xc1recorder"
    hand = project(default_camera(), np.array([[0.267, 0.80, 0.051]]))[0]
    last: dict[str, Any] = {}
    for k in range(count):
        x, y = float(hand[0]), float(hand[1]) - 0.15 * k / count
        phase = "down" if k == 0 else "move"
        touch.send(frame([{"id": 1, "phase": phase, "x": x, "y": y}], k))
        last = read(pose)
    touch.send(frame([{"id": 1, "phase": "up", "x": 0.5, "y": 0.5}], count))
    touch.close()
    return last


def root_of(pose: dict[str, Any]) -> np.ndarray:
    return np.array(struct.unpack("<3f", pose["root"]))


def children_of(pid: int) -> list[int]:
    tasks = Path(f"/proc/{pid}/task/{pid}/children")
    return [int(word) for word in tasks.read_text().split()]


def resident(pid: int) -> float:
    """MB of memory that a process holds."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def test_a_device_moves_the_figure_and_ctrl_c_leaves_nothing(launch: Launch) -> None:
    stack = launch(*TOUCH, "--without", "input_touch")
    before = read(stack.reader("pose"))
    after = drag(stack)
    turns = [np.frombuffer(one["rotations"], "<f4").reshape(-1, 4) for one in (before, after)]
    assert np.abs(turns[0] - turns[1]).max() > 0.2, "the arm moved"
    file_of(stack.folder, "touch").unlink(missing_ok=True)  # ours
    pids = children_of(stack.process.pid)
    assert len(pids) == 2
    assert stack.end() == 0
    assert not stack.folder.exists()
    assert not [pid for pid in pids if Path(f"/proc/{pid}").exists()]


def test_a_killed_controller_takes_up_and_the_bag_is_whole(launch: Launch, tmp_path: Path) -> None:
    bag = tmp_path / "a.mcap"
    stack = launch(*TOUCH, f"record:={bag}", "--without", "input_touch")
    before = root_of(drag(stack, recorded=True))
    pose = stack.reader("pose")
    read(pose)
    first = stack.pid("controller")
    os.kill(first, signal.SIGKILL)
    until(lambda: stack.pid("controller") not in (0, first), "a new controller")
    fresh = stack.reader("pose")
    after = root_of(read(fresh))
    assert np.linalg.norm(after - before) < 0.05
    stack.end()
    info = subprocess.run(
        [sys.executable, "-m", "bunraku.cli", "bag", "info", str(bag), "--json"], capture_output=True, check=True
    )
    assert b'"complete": true' in info.stdout
    for _ in range(2):
        check = subprocess.run(
            [sys.executable, "-m", "bunraku.cli", "bag", "check", str(bag)], capture_output=True, check=False
        )
        assert check.returncode == 0, check.stdout + check.stderr
        assert b"equal to the last bit" in check.stdout


def test_a_killed_recorder_leaves_a_bag_that_is_read(launch: Launch, tmp_path: Path) -> None:
    bag = tmp_path / "a.mcap"
    stack = launch(*TOUCH, f"record:={bag}", "--without", "input_touch")
    drag(stack)
    until(lambda: ask(stack.folder, "recorder", "status")["messages"] > 200, "200 messages recorded")
    until(lambda: bag.stat().st_size > 10_000, "a chunk on disk")
    remains = tmp_path / "remains.mcap"
    os.kill(stack.pid("recorder"), signal.SIGKILL)
    remains.write_bytes(bag.read_bytes())
    words = [sys.executable, "-m", "bunraku.cli", "bag"]
    info = subprocess.run([*words, "info", str(remains), "--json"], capture_output=True, check=True)
    assert b'"complete": false' in info.stdout
    subprocess.run([*words, "recover", str(remains), "-o", str(tmp_path / "b.mcap")], check=True, capture_output=True)
    info = subprocess.run([*words, "info", str(tmp_path / "b.mcap"), "--json"], capture_output=True, check=True)
    assert b'"complete": true' in info.stdout


def test_a_killed_launcher_takes_all_with_it(launch: Launch) -> None:
    stack = launch(*TOUCH)
    pids = children_of(stack.process.pid)
    assert len(pids) == 3
    stack.process.kill()
    stack.process.wait()
    until(lambda: not [pid for pid in pids if Path(f"/proc/{pid}").exists()], "every process gone", 30)
    left = sorted(one.name for one in stack.folder.iterdir()) if stack.folder.exists() else []
    assert left == []


def garbage(count: int, seed: int) -> list[bytes]:
    """Random bytes, wrong types, NaN, huge arrays, deep nesting."""
    dice = random.Random(seed)
    nan = float("nan")
    made: list[bytes] = []
    for k in range(count):
        match k % 8:
            case 0:
                made.append(dice.randbytes(dice.randrange(0, 300)))
            case 1:
                made.append(msgpack.packb({"device": 7, "contacts": "x", "pelvis": [1], "kind": "fly"}))
            case 2:
                made.append(
                    msgpack.packb({"device": "d", "contacts": [{"id": 1, "phase": "down", "x": nan, "y": 0.1}]})
                )
            case 3:
                made.append(msgpack.packb({"pelvis": [nan, 0.0, 0.0], "trunk": [nan] * 4, "yaw": 1e300}))
            case 4:
                made.append(msgpack.packb([[]] * dice.randrange(0, 50)))
            case 5:
                made.append(b"\x91" * dice.randrange(1, 3000) + b"\xc0")
            case 6:
                made.append(
                    msgpack.packb({"skeleton": "a", "root": b"1234", "rotations": bytes(dice.randrange(0, 5000))})
                )
            case _:
                large = bytes(1 << 20) if k % 400 == 7 else bytes(2000)
                made.append(msgpack.packb({"skeleton": "a", "root": bytes(12), "rotations": large}))
    return made


def test_ten_thousand_garbage_bodies_on_every_input_harm_nothing(launch: Launch) -> None:
    """From a process that takes the publishers' places: touch, pen and command at nodes that run, motion too."""
    stack = launch(*TOUCH, "--without", "input_touch")
    pose = stack.reader("pose")
    log = stack.reader("log/interpreter", newest=False)
    topics = {topic: stack.writer(topic) for topic in ("touch", "pen", "motion")}
    for topic, socket in topics.items():
        assert socket.poll(30_000), f"nobody hears {topic}"
    pids = {node: stack.pid(node) for node in ("interpreter", "controller")}

    def dropped() -> int:
        return int(ask(stack.folder, "interpreter", "info", seconds=60.0)["info"]["invalid"].get("touch", 0))

    def flood(seed: int, count: int) -> None:
        bodies = garbage(count, seed)
        for socket in topics.values():
            for body in bodies:
                socket.send(body)
        wanted = seen + len(bodies) * 0.99
        until(lambda: dropped() >= wanted, "the garbage read")

    seen = 0
    flood(1, 2000)
    seen = dropped()
    level = {node: resident(pid) for node, pid in pids.items()}
    while log.poll(0):
        log.recv()
    flood(2, 10_000)
    assert {node: stack.pid(node) for node in pids} == pids, "nobody died"
    for node, pid in pids.items():
        until(lambda pid=pid, node=node: resident(pid) < level[node] + 5.0, f"{node} within 5 MB of before", 10.0)
    read(pose)
    read(pose)
    first = None
    lines = []
    while log.poll(0):
        one = msgpack.unpackb(log.recv())
        first = first or one["stamp"]
        lines.append((one["stamp"] - first) / 1e9)
        assert "dropped" in one["text"]
    span = lines[-1] if lines else 0.0
    assert len(lines) <= 3 * (span + 2), "about a line a second for each topic"


def test_params_and_reset_over_the_control_socket(launch: Launch) -> None:
    stack = launch(*TOUCH, "--without", "input_touch")
    drag(stack)
    assert ask(stack.folder, "controller", "param.set", name="half_life", value=0.1)["ok"]
    assert ask(stack.folder, "controller", "reset")["ok"]
    with pytest.raises(ValueError, match="half_life"):
        ask(stack.folder, "controller", "param.set", name="half_life", value="soon")
