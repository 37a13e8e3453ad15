"""Linux multi-touch (protocol B): events to fingers, and the driver on a named pipe's worth of trouble."""

from math import pi
from pathlib import Path

import pytest

from bunraku.nodes.input_touch.evdev import (
    ABS_MT_ORIENTATION,
    ABS_MT_POSITION_X,
    ABS_MT_POSITION_Y,
    ABS_MT_PRESSURE,
    ABS_MT_SLOT,
    ABS_MT_TOUCH_MAJOR,
    ABS_MT_TOUCH_MINOR,
    ABS_MT_TRACKING_ID,
    EV_ABS,
    EV_SYN,
    SYN_DROPPED,
    SYN_REPORT,
    Range,
    SlotDecoder,
)
from bunraku.nodes.input_touch.node import InputTouch
from bunraku.runtime.memory import MemoryStage

RANGES = {
    ABS_MT_POSITION_X: Range(0, 4000, 20),
    ABS_MT_POSITION_Y: Range(0, 2000, 20),
    ABS_MT_TOUCH_MAJOR: Range(0, 255, 0),
    ABS_MT_TOUCH_MINOR: Range(0, 255, 0),
    ABS_MT_ORIENTATION: Range(-90, 90, 0),
    ABS_MT_PRESSURE: Range(0, 255, 0),
}


class Kernel:
    """What the kernel would say: events with only what changes, and the state when asked."""

    def __init__(self) -> None:
        self.state: dict[int, dict[int, int]] = {}
        self.asked = 0
        self.decoder = SlotDecoder(RANGES, self.slots)

    def slots(self) -> dict[int, dict[int, int]]:
        self.asked += 1
        return self.state

    def say(self, *events: tuple[int, int]) -> dict[int, tuple[float, float]]:
        for code, value in events:
            assert self.decoder.event(EV_ABS, code, value) is None
        live = self.decoder.event(EV_SYN, SYN_REPORT, 0)
        assert live is not None
        return {key: (one.x, one.y) for key, one in live.items()}


def test_slots_hold_what_is_not_said_again() -> None:
    kernel = Kernel()
    first = [(ABS_MT_SLOT, 0), (ABS_MT_TRACKING_ID, 45), (ABS_MT_POSITION_X, 1000), (ABS_MT_POSITION_Y, 500)]
    assert kernel.say(*first) == {45: (0.25, 0.25)}
    second = [(ABS_MT_SLOT, 1), (ABS_MT_TRACKING_ID, 46), (ABS_MT_POSITION_X, 2000), (ABS_MT_POSITION_Y, 0)]
    assert kernel.say(*second) == {45: (0.25, 0.25), 46: (0.5, 0.0)}
    # The slot stays chosen; only x of the second finger moves.
    assert kernel.say((ABS_MT_POSITION_X, 4000))[46] == (1.0, 0.0)
    assert kernel.say((ABS_MT_SLOT, 0), (ABS_MT_TRACKING_ID, -1)) == {46: (1.0, 0.0)}
    # The slot is used again by another finger that begins where the last one was.
    assert kernel.say((ABS_MT_TRACKING_ID, 47)) == {47: (0.25, 0.25), 46: (1.0, 0.0)}


def test_an_ellipse_in_metres_and_radians() -> None:
    kernel = Kernel()
    kernel.say((ABS_MT_TRACKING_ID, 1), (ABS_MT_POSITION_X, 0), (ABS_MT_POSITION_Y, 0))
    for code, value in (
        (ABS_MT_TOUCH_MAJOR, 200), (ABS_MT_TOUCH_MINOR, 100), (ABS_MT_ORIENTATION, 45), (ABS_MT_PRESSURE, 51),
    ):  # fmt: skip
        kernel.decoder.event(EV_ABS, code, value)
    live = kernel.decoder.event(EV_SYN, SYN_REPORT, 0)
    assert live is not None
    one = live[1]
    # 200 units at 20 a mm; half a quarter turn from the y axis.
    assert (one.major, one.minor, one.pressure) == pytest.approx((0.010, 0.005, 0.2))
    assert one.angle == pytest.approx(pi / 4)
    assert kernel.decoder.size_m == pytest.approx((0.2, 0.1))
    assert kernel.decoder.fields == ["major", "minor", "angle", "pressure"]


def test_after_a_loss_the_kernel_is_asked() -> None:
    kernel = Kernel()
    kernel.say((ABS_MT_TRACKING_ID, 1), (ABS_MT_POSITION_X, 0), (ABS_MT_POSITION_Y, 0))
    kernel.decoder.event(EV_SYN, SYN_DROPPED, 0)
    kernel.decoder.event(EV_ABS, ABS_MT_TRACKING_ID, 99)  # of a frame whose beginning is lost
    kernel.state = {
        0: {ABS_MT_TRACKING_ID: -1},
        2: {ABS_MT_TRACKING_ID: 7, ABS_MT_POSITION_X: 4000, ABS_MT_POSITION_Y: 2000},
    }
    live = kernel.decoder.event(EV_SYN, SYN_REPORT, 0)
    assert live is not None
    assert {key: (one.x, one.y) for key, one in live.items()} == {7: (1.0, 1.0)}
    assert kernel.asked == 2


def test_values_out_of_range_stay_on_the_surface() -> None:
    kernel = Kernel()
    live = kernel.say((ABS_MT_TRACKING_ID, 1), (ABS_MT_POSITION_X, -50), (ABS_MT_POSITION_Y, 9000))
    assert live == {1: (0.0, 1.0)}


def test_a_device_that_is_not_there_is_told_once_and_waited_for(tmp_path: Path) -> None:
    stage = MemoryStage()
    stage.add(InputTouch, drivers=["evdev"], evdev=str(tmp_path / "event9"))
    stage.advance(7.0)
    warnings = [one.text for one in stage.received("log/input_touch") if one.level == "warning"]
    assert len(warnings) == 1
    assert "event9" in warnings[0]
    assert "parameter evdev" in warnings[0]
    # A file that is no device is told of, once, as such.
    (tmp_path / "event9").write_bytes(b"")
    stage.advance(7.0)
    warnings = [one.text for one in stage.received("log/input_touch") if one.level == "warning"]
    assert len(warnings) == 2
    assert "no multi-touch device" in warnings[1]
