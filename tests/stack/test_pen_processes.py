"""The pen's stack as its users run it: two pens with two figures, and the walk under touches, in real processes."""

import math
import struct
import time
from collections.abc import Callable
from typing import Any

import msgpack
import pytest
from launched import Stack, read, until

from bunraku.figure.camera import Orbit

pytestmark = [pytest.mark.stack, pytest.mark.timeout(600)]
Launch = Callable[..., Stack]
SIZE = (0.40, 0.40)
SCALE = 16.0


class Pen:
    """A tablet of 40 x 40 cm: says samples as a device would. The camera looks along -Z: pen up is -Z, right +X."""

    def __init__(self, stack: Stack, topic: str) -> None:
        self.socket = stack.writer(topic)
        assert self.socket.poll(60_000), f"nobody hears {topic}"
        self.seq = 0
        self.at = (0.0, 0.0)

    def send(self, *, contact: bool = True, **more: Any) -> None:
        """One sample where the pen is; metres of the ground from the tablet's middle."""
        x, y = 0.5 + self.at[0] / (SIZE[0] * SCALE), 0.5 - self.at[1] / (SIZE[1] * SCALE)
        now = time.time_ns()
        body = {
            "device": "test", "size_m": SIZE, "in_range": True, "contact": contact, "x": x, "y": y,
            "pressure": 0.3 if contact else 0.0, "seq": self.seq, "stamp": now, "origin": now, **more,
        }  # fmt: skip
        self.seq += 1
        self.socket.send(msgpack.packb(body))

    def line(self, way: tuple[float, float], seconds: float, clock: "Clock") -> None:
        """Draw ``way`` (right, up; m) and lift."""
        count, begin = round(seconds * 60), self.at
        for k in range(count + 1):
            self.at = (begin[0] + way[0] * k / count, begin[1] + way[1] * k / count)
            self.send()
            clock.wait()
        self.send(contact=False)


class Clock:
    """A device's own rate: one pose heard is about 1/60 s."""

    def __init__(self, stack: Stack, topic: str) -> None:
        self.socket = stack.reader(topic)

    def wait(self) -> dict[str, Any]:
        return read(self.socket)


def place(pose: dict[str, Any]) -> tuple[float, float]:
    """Where the hips are over the ground: right, up of the tablet."""
    x, _, z = struct.unpack("<3f", pose["root"])
    return x, -z


def test_two_figures_follow_a_pen_each(launch: Launch) -> None:
    words = ("duet", "source:=hid", "alice:=/none/a", "bob:=/none/b", "window:=off")
    stack = launch(*words, "--without", "alice/input_pen", "--without", "bob/input_pen")
    poses = {name: Clock(stack, f"{name}/pose") for name in ("alice", "bob")}
    begun = {name: place(one.wait()) for name, one in poses.items()}
    assert math.dist(begun["alice"], begun["bob"]) == pytest.approx(2.0, abs=0.05)
    pens = {name: Pen(stack, f"{name}/pen") for name in poses}
    pens["alice"].line((0.0, -1.6), 1.3, poses["alice"])

    def gone(name: str) -> tuple[float, float]:
        now = place(poses[name].wait())
        return now[0] - begun[name][0], now[1] - begun[name][1]

    until(lambda: math.dist(gone("alice"), (0.0, -1.6)) < 0.08, "alice is at her path's end")
    assert math.hypot(*gone("bob")) < 0.05, "bob's pen did nothing"
    pens["bob"].line((0.45, 0.0), 0.3, poses["bob"])
    until(lambda: math.dist(gone("bob"), (0.45, 0.0)) < 0.08, "bob has made a step")
    assert math.dist(gone("alice"), (0.0, -1.6)) < 0.10, "alice stays"
    assert stack.end() == 0


def test_the_pen_walks_a_figure_that_the_controller_holds(launch: Launch) -> None:
    fingers = ("touch:=none", "--without", "input_touch")  # this test is the pen
    stack = launch("mixed", "source:=script", "pen:=none", "window:=off", "--without", "input_pen", *fingers)
    pose, motion = Clock(stack, "pose"), Clock(stack, "motion")
    begun = place(pose.wait())
    pen = Pen(stack, "pen")
    pen.line((0.0, -1.8), 1.5, pose)
    # Down on the tablet is toward the viewer, who looks from aside.
    way = (1.8 * math.sin(Orbit.azimuth), -1.8 * math.cos(Orbit.azimuth))

    def gone(clock: Clock) -> tuple[float, float]:
        now = place(clock.wait())
        return now[0] - begun[0], now[1] - begun[1]

    until(lambda: math.dist(gone(motion), way) < 0.08, "the blended walk is at its end")
    until(lambda: math.dist(gone(pose), way) < 0.10, "and so is the figure")
    assert stack.end() == 0
