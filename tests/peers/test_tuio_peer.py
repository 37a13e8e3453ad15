"""A real TUIO sender in another process drives the touch node over UDP: 60 Hz, ten fingers, loss and disorder."""

import subprocess
import sys
import time

import pytest

from bunraku.nodes.input_touch.node import InputTouch
from bunraku.runtime.memory import MemoryStage

pytestmark = pytest.mark.peer

SENDER = r"""
import math, random, socket, sys, time
from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
from pythonosc.osc_message_builder import OscMessageBuilder

port, frames, lose = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3] == "lose"
rng = random.Random(4)
out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

def body(profile, fseq, alive, sets):
    b = OscBundleBuilder(IMMEDIATELY)
    def say(*words):
        m = OscMessageBuilder(address="/tuio/" + profile)
        for word in words:
            m.add_arg(word)
        b.add_content(m.build())
    say("source", "peer@127.0.0.1")
    say("alive", *alive)
    for key, values in sets:
        say("set", key, *values)
    say("fseq", fseq)
    return b.build().dgram

def place(finger, frame):
    turn = 0.05 * frame + finger
    return 0.5 + 0.04 * finger * math.cos(turn), 0.5 + 0.04 * finger * math.sin(turn)

held = []
start = time.perf_counter()
for frame in range(1, frames + 1):
    alive = list(range(10)) if frame < frames else []
    cur = [(k, (*place(k, frame), 0.0, 0.0, 0.0)) for k in alive]
    blb = [(k, (*place(k, frame), 0.2, 0.02, 0.01, 0.0002, 0.0, 0.0, 0.0, 0.0, 0.0)) for k in alive]
    parts = [body("2Dcur", frame, alive, cur[:5]), body("2Dcur", frame, alive, cur[5:])]
    parts.append(body("2Dblb", frame, alive, blb))
    for part in parts:
        if lose and frame < frames - 3:
            if rng.random() < 0.1:
                continue
            if rng.random() < 0.1:
                held.append(part)
                continue
        out.sendto(part, ("127.0.0.1", port))
    if held and rng.random() < 0.5:
        out.sendto(held.pop(0), ("127.0.0.1", port))
    time.sleep(max(0.0, start + frame / 60.0 - time.perf_counter()))
"""


def drive(frames: int, mode: str) -> tuple[MemoryStage, InputTouch]:
    """Let the sender play; the node's clock follows the wall's."""
    stage = MemoryStage()
    node = stage.add(InputTouch, drivers=["tuio"], port=0, size_m=[0.6, 0.4], merge=0.004)
    port = node.running[0].port  # type: ignore[attr-defined]
    sender = subprocess.Popen([sys.executable, "-c", SENDER, str(port), str(frames), mode])
    last = time.monotonic()
    ended: float | None = None
    while ended is None or time.monotonic() < ended:
        stage.poll(0.05)
        now = time.monotonic()
        stage.advance(now - last)
        last = now
        if ended is None and sender.poll() is not None:
            ended = now + 0.3
    assert sender.returncode == 0
    stage.remove(node)
    return stage, node


def test_ten_fingers_at_60_hz_are_one_message_a_frame() -> None:
    frames = 180
    stage, _ = drive(frames, "whole")
    said = stage.received("touch")
    # A machine that is busy may part a frame's datagrams by more than the wait: few messages more, none fewer.
    assert frames <= len(said) <= frames * 1.2
    assert {one.id for one in said[0].contacts} == set(range(10))
    assert {one.phase for one in said[0].contacts} == {"down"}
    for message in said[1:-1]:
        assert {one.phase for one in message.contacts} == {"move"}
        assert len(message.contacts) == 10
        assert all(one.major == pytest.approx(0.012, abs=1e-5) for one in message.contacts)
    assert {one.phase for one in said[-1].contacts} == {"up"}
    assert stage.last("device/tuio_peer_127_0_0_1").driver == "tuio"


def test_lost_and_late_datagrams_change_no_finger_s_identity() -> None:
    stage, node = drive(240, "lose")
    said = stage.received("touch")
    assert node.running[0].decoder.late > 0  # type: ignore[attr-defined]
    phases: dict[int, list[str]] = {}
    for message in said:
        for one in message.contacts:
            phases.setdefault(one.id, []).append(one.phase)
    assert set(phases) == set(range(10))
    for listed in phases.values():
        assert listed[0] == "down"
        assert listed[-1] == "up"
        assert set(listed[1:-1]) == {"move"}
    assert len(said) > 200
