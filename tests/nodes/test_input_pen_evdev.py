"""A pen tablet of the Linux kernel: events to samples, and the driver on devices that are not there."""

import os
from math import degrees, pi
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bunraku.msgs import Pen
from bunraku.nodes.input_pen import evdev as driver_module
from bunraku.nodes.input_pen.evdev import (
    ABS_PRESSURE,
    ABS_TILT_X,
    ABS_TILT_Y,
    ABS_X,
    ABS_Y,
    ABS_Z,
    BTN_TOOL_PEN,
    BTN_TOOL_RUBBER,
    BTN_TOUCH,
    PenDecoder,
)
from bunraku.nodes.input_pen.node import InputPen
from bunraku.runtime import linux_input
from bunraku.runtime.linux_input import EV_ABS, EV_KEY, EV_SYN, EVENT, SYN_DROPPED, SYN_REPORT, EventFile, Range
from bunraku.runtime.memory import MemoryStage

RANGES = {
    ABS_X: Range(0, 44704, 200),
    ABS_Y: Range(0, 27940, 200),
    ABS_Z: Range(-900, 899, 287),
    ABS_PRESSURE: Range(0, 2047),
    ABS_TILT_X: Range(-64, 63, 57),
    ABS_TILT_Y: Range(-64, 63, 57),
}
KEYS = 1 << BTN_TOOL_PEN | 1 << BTN_TOOL_RUBBER | 1 << BTN_TOUCH
STYLUS_1, STYLUS_2 = 0x14B, 0x14C


class Kernel:
    """Says events to a decoder; answers what it asks."""

    def __init__(self, ranges: dict[int, Range] | None = None, keys: int = KEYS) -> None:
        self.now: tuple[dict[int, int], int] = ({}, 0)
        self.asked = 0
        self.decoder = PenDecoder(RANGES if ranges is None else ranges, keys, self.resync)

    def resync(self) -> tuple[dict[int, int], int]:
        self.asked += 1
        return self.now

    def keys(self, *pairs: tuple[int, int]) -> None:
        for code, value in pairs:
            assert not self.decoder.event(EV_KEY, code, value)

    def axes(self, *pairs: tuple[int, int]) -> None:
        for code, value in pairs:
            assert not self.decoder.event(EV_ABS, code, value)

    def report(self) -> Pen:
        assert self.decoder.event(EV_SYN, SYN_REPORT, 0)
        sample = self.decoder.stylus().sample("pen", self.decoder.size_m, 0)
        return Pen.decode(sample.encode())


def test_a_pen_comes_near_touches_presses_leans_and_leaves() -> None:
    kernel = Kernel()
    assert kernel.decoder.size_m == pytest.approx((0.22352, 0.1397))
    assert kernel.decoder.fields == ["pressure", "altitude", "azimuth", "twist"]
    kernel.keys((BTN_TOOL_PEN, 1))
    kernel.axes((ABS_X, 11176), (ABS_Y, 13970))
    one = kernel.report()
    assert (one.in_range, one.contact, one.pressure, one.x, one.y, one.buttons) == (True, False, 0.0, 0.25, 0.5, 0)
    assert (one.altitude, one.azimuth) == (pytest.approx(pi / 2), 0.0)
    kernel.keys((BTN_TOUCH, 1), (STYLUS_2, 1))
    kernel.axes((ABS_PRESSURE, 1024), (ABS_TILT_X, 0), (ABS_TILT_Y, 30))
    one = kernel.report()
    assert (one.contact, one.pressure, one.buttons) == (True, pytest.approx(0.5, abs=1e-3), 1 | 4)
    assert (degrees(one.altitude), degrees(one.azimuth)) == (pytest.approx(60.0, abs=0.5), pytest.approx(90.0))
    kernel.axes((ABS_X, 22352))  # only what changes is told
    one = kernel.report()
    assert (one.x, one.y, one.contact) == (0.5, 0.5, True)
    kernel.keys((BTN_TOUCH, 0), (STYLUS_2, 0), (BTN_TOOL_PEN, 0))
    one = kernel.report()
    assert (one.in_range, one.contact, one.pressure, one.buttons) == (False, False, 0.0, 0)


def test_the_other_end_is_a_rubber_and_the_turn_is_a_twist() -> None:
    kernel = Kernel()
    kernel.keys((BTN_TOOL_RUBBER, 1))
    kernel.axes((ABS_Z, -450))
    one = kernel.report()
    assert (one.in_range, one.eraser) == (True, True)
    assert degrees(one.twist or 0.0) == pytest.approx(90.0)


def test_a_plain_pen_without_touch_key_or_tilt() -> None:
    kernel = Kernel({code: RANGES[code] for code in (ABS_X, ABS_Y, ABS_PRESSURE)}, 1 << BTN_TOOL_PEN)
    assert kernel.decoder.fields == ["pressure"]
    kernel.keys((BTN_TOOL_PEN, 1))
    assert not kernel.report().contact
    kernel.axes((ABS_PRESSURE, 3))
    one = kernel.report()
    assert (one.contact, one.twist, one.altitude) == (True, None, pytest.approx(pi / 2))


def test_after_lost_events_the_device_is_asked() -> None:
    kernel = Kernel()
    kernel.keys((BTN_TOOL_PEN, 1))
    kernel.axes((ABS_X, 100))
    kernel.report()
    assert not kernel.decoder.event(EV_SYN, SYN_DROPPED, 0)
    kernel.axes((ABS_X, 40000))  # part of an incomplete frame
    kernel.now = ({ABS_X: 44704, ABS_Y: 0, ABS_PRESSURE: 2047}, 1 << BTN_TOOL_PEN | 1 << BTN_TOUCH)
    one = kernel.report()
    assert (one.x, one.contact, one.pressure) == (1.0, True, 1.0)
    assert kernel.asked == 2


def test_a_tablet_that_does_not_know_its_size() -> None:
    kernel = Kernel({**RANGES, ABS_X: Range(0, 1000), ABS_Y: Range(0, 1000)})
    assert kernel.decoder.size_m is None


@given(st.lists(st.tuples(st.integers(0, 4), st.integers(0, 800), st.integers(-(2**31), 2**31 - 1)), max_size=60))
def test_any_events_leave_a_pen_on_its_tablet(events: list[tuple[int, int, int]]) -> None:
    kernel = Kernel()
    for kind, code, value in events:
        kernel.decoder.event(kind, code, value)
    Pen.decode(kernel.decoder.stylus().sample("pen", kernel.decoder.size_m, 0).encode())


def test_a_tablet_that_is_not_there_is_told_once_and_waited_for(tmp_path: Path) -> None:
    stage = MemoryStage()
    stage.add(InputPen, drivers=["evdev"], evdev=str(tmp_path / "event9"))
    stage.advance(7.0)
    (tmp_path / "event9").write_bytes(b"")
    stage.advance(7.0)
    warnings = [one.text for one in stage.received("log/input_pen") if one.level == "warning"]
    assert len(warnings) == 2
    assert "event9" in warnings[0]
    assert "parameter evdev" in warnings[0]
    assert "no pen tablet" in warnings[1]


def test_events_through_the_driver_and_an_unplugged_tablet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "event5"
    os.mkfifo(path)
    monkeypatch.setattr(driver_module, "is_tablet", lambda descriptor: True)
    monkeypatch.setattr(driver_module, "axis_now", lambda d, code: (0, RANGES[code]) if code in RANGES else None)
    monkeypatch.setattr(driver_module, "keys", lambda d: KEYS)
    monkeypatch.setattr(driver_module, "keys_down", lambda d: 0)
    kernel = os.open(path, os.O_RDWR)  # both ends, so that the driver's open does not find an end
    stage = MemoryStage()
    stage.add(InputPen, drivers=["evdev"], evdev=str(path))
    assert stage.last("device/evdev_event5").connected
    body = b"".join(
        EVENT.pack(1_700_000_000, 5, kind, code, value)
        for kind, code, value in (
            (EV_KEY, BTN_TOOL_PEN, 1), (EV_KEY, BTN_TOUCH, 1), (EV_ABS, ABS_X, 22352), (EV_ABS, ABS_PRESSURE, 2047),
            (EV_SYN, SYN_REPORT, 0), (EV_ABS, ABS_X, 44704), (EV_SYN, SYN_REPORT, 0),
        )
    )  # fmt: skip
    os.write(kernel, body[:70])  # events come in any pieces
    stage.poll(1.0)
    os.write(kernel, body[70:])
    stage.poll(1.0)
    assert [(one.x, one.pressure, one.contact) for one in stage.received("pen")] == [(0.5, 1.0, True), (1.0, 1.0, True)]

    def unplugged(self: EventFile) -> list[tuple[int, int, int, int]]:
        raise OSError(19, "No such device")

    monkeypatch.setattr(linux_input.EventFile, "events", unplugged)
    os.write(kernel, body[:24])
    stage.poll(1.0)
    last = stage.last("pen")
    assert (last.in_range, last.contact) == (False, False)
    assert not stage.last("device/evdev_event5").connected
    monkeypatch.undo()
    os.close(kernel)
    path.unlink()
    stage.advance(5.0)
    warnings = [one.text for one in stage.received("log/input_pen") if one.level == "warning"]
    assert len([one for one in warnings if "unplugged: No such device" in one]) == 1
    assert len([one for one in warnings if "give parameter evdev the path" in one]) == 1


def test_a_pen_tablet_made_by_the_kernel() -> None:
    evdev = pytest.importorskip("evdev", reason="package evdev is missing (pip install 'bunraku[evdev]')")
    if not os.access("/dev/uinput", os.W_OK):
        pytest.skip("no /dev/uinput to make a tablet with")
    info = {
        EV_KEY: [BTN_TOOL_PEN, BTN_TOUCH],
        EV_ABS: [
            (code, evdev.AbsInfo(0, one.low, one.high, 0, 0, one.resolution))
            for code, one in RANGES.items()
            if code != ABS_Z
        ],
    }
    with evdev.UInput(info, name="bunraku test tablet") as tablet:
        stage = MemoryStage()
        stage.add(InputPen, drivers=["evdev"], evdev=tablet.device.path)
        assert stage.last("device/" + "evdev_" + Path(tablet.device.path).name).note == "bunraku test tablet"
        for kind, code, value in (
            (EV_KEY, BTN_TOOL_PEN, 1), (EV_KEY, BTN_TOUCH, 1), (EV_ABS, ABS_X, 22352), (EV_ABS, ABS_PRESSURE, 2047),
        ):  # fmt: skip
            tablet.write(kind, code, value)
        tablet.syn()
        stage.poll(5.0)
        one = stage.last("pen")
        assert (one.x, one.pressure, one.contact) == (0.5, 1.0, True)
    stage.poll(5.0)
    assert not stage.last("pen").in_range
