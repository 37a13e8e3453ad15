"""The `evdev` driver: a pen tablet of the Linux kernel, which decodes hundreds of models, read without any package."""

from collections.abc import Callable
from math import radians
from pathlib import Path
from typing import ClassVar

from bunraku.nodes.input_pen.tablet import (
    BARREL,
    SECOND,
    SECOND_BARREL,
    THIRD_BARREL,
    Stylus,
    TabletDriver,
    share,
    spherical,
)
from bunraku.runtime.linux_input import (
    EV_ABS,
    EV_KEY,
    EV_SYN,
    SYN_DROPPED,
    SYN_REPORT,
    EventFile,
    Range,
    axis_now,
    device_name,
    find,
    keys,
    keys_down,
)

ABS_X, ABS_Y, ABS_Z, ABS_PRESSURE, ABS_TILT_X, ABS_TILT_Y = 0x00, 0x01, 0x02, 0x18, 0x1A, 0x1B
AXES = (ABS_X, ABS_Y, ABS_Z, ABS_PRESSURE, ABS_TILT_X, ABS_TILT_Y)
"""ABS_Z is the turn of pens that tell their twist."""
BTN_TOOL_PEN, BTN_TOOL_RUBBER, BTN_TOUCH = 0x140, 0x141, 0x14A
TOOLS = range(BTN_TOOL_PEN, 0x145)
"""Pen, rubber, brush, pencil, airbrush."""
BUTTONS = {0x14B: BARREL, 0x14C: SECOND_BARREL, 0x149: THIRD_BARREL}
"""BTN_STYLUS, BTN_STYLUS2, BTN_STYLUS3."""

Now = tuple[dict[int, int], int]
"""Values of the axes, and the keys that are down, one bit each."""


class PenDecoder:
    """Events in, the pen out; knows nothing of files."""

    def __init__(self, ranges: dict[int, Range], known_keys: int, resync: Callable[[], Now]) -> None:
        """``resync`` asks the device how it is now, at the start and after lost events."""
        self.ranges, self.known_keys, self.resync = ranges, known_keys, resync
        self.values: dict[int, int] = {}
        self.down = 0
        self.deaf = False
        self.refresh()

    def refresh(self) -> None:
        """Take axes and keys as the device says they are."""
        values, self.down = self.resync()
        self.values = dict(values)

    def event(self, kind: int, code: int, value: int) -> bool:
        """One event; True where it completes a frame."""
        if kind == EV_SYN:
            if code == SYN_DROPPED:
                self.deaf = True
            elif code == SYN_REPORT:
                if self.deaf:  # what came since the loss is incomplete
                    self.deaf = False
                    self.refresh()
                return True
            return False
        if self.deaf:
            return False
        if kind == EV_ABS and code in self.ranges:
            self.values[code] = value
        elif kind == EV_KEY and code < 768:
            self.down = self.down | 1 << code if value else self.down & ~(1 << code)
        return False

    def stylus(self) -> Stylus:
        """The pen now."""
        near = any(self.down >> code & 1 for code in TOOLS)
        pressure = self._share(ABS_PRESSURE)
        touches = bool(self.down >> BTN_TOUCH & 1) if self.known_keys >> BTN_TOUCH & 1 else pressure > 0.0
        altitude, azimuth = spherical(self._angle(ABS_TILT_X), self._angle(ABS_TILT_Y))
        buttons = sum(bit for code, bit in BUTTONS.items() if self.down >> code & 1)
        return Stylus(
            near=near, contact=near and touches, x=self._share(ABS_X), y=self._share(ABS_Y),
            pressure=pressure if ABS_PRESSURE in self.ranges else 0.5, altitude=altitude, azimuth=azimuth,
            twist=self._turn(), buttons=buttons, eraser=bool(self.down >> BTN_TOOL_RUBBER & 1),
        )  # fmt: skip

    @property
    def size_m(self) -> tuple[float, float] | None:
        """Width and height of the tablet, where the device knows its resolution."""
        x, y = self.ranges[ABS_X], self.ranges[ABS_Y]
        if x.resolution <= 0 or y.resolution <= 0:
            return None
        return (x.high - x.low) / x.resolution / 1000.0, (y.high - y.low) / y.resolution / 1000.0

    @property
    def fields(self) -> list[str]:
        """The optional fields that it fills."""
        names = ["pressure"] if ABS_PRESSURE in self.ranges else []
        if ABS_TILT_X in self.ranges:
            names += ["altitude", "azimuth"]
        return [*names, "twist"] if self._turn() is not None else names

    def _share(self, code: int) -> float:
        axis = self.ranges.get(code, Range())
        return share(self.values.get(code, axis.low), axis.low, axis.high)

    def _angle(self, code: int) -> float:
        axis = self.ranges.get(code)
        if axis is None:
            return 0.0
        value = self.values.get(code, 0)
        return value / axis.resolution if axis.resolution > 0 else radians(value)

    def _turn(self) -> float | None:
        axis = self.ranges.get(ABS_Z)
        if axis is None or axis.high <= axis.low or ABS_TILT_X not in self.ranges:
            return None
        # The whole range is one turn.
        return radians(360.0 * (self.values.get(ABS_Z, 0) - axis.low) / (axis.high - axis.low + 1))


def is_tablet(descriptor: int) -> bool:
    """Whether an open device has a pen and says where it is."""
    pen = keys(descriptor) >> BTN_TOOL_PEN & 1
    return bool(pen) and axis_now(descriptor, ABS_X) is not None and axis_now(descriptor, ABS_Y) is not None


class EvdevDriver(TabletDriver):
    """Reads one tablet of the kernel."""

    name: ClassVar[str] = "evdev"

    def connect(self) -> str:
        found = find(str(self.host.option("evdev")), is_tablet, "pen tablet")
        if not isinstance(found, EventFile):
            return found
        self.file = found
        descriptor = found.descriptor
        ranges = {code: now[1] for code in AXES if (now := axis_now(descriptor, code)) is not None}

        def resync() -> Now:
            values = {code: now[0] for code in ranges if (now := axis_now(descriptor, code)) is not None}
            return values, keys_down(descriptor)

        self.decoder = PenDecoder(ranges, keys(descriptor), resync)
        self.found(f"evdev-{Path(found.path).name}", self.decoder.size_m, self.decoder.fields,
                   device_name(descriptor, "pen tablet"))  # fmt: skip
        self.host.add_reader(descriptor, self.read)
        self.stylus = self.decoder.stylus()
        self.say(self.host.clock())
        return ""

    def disconnect(self) -> None:
        self.host.remove_reader(self.file.descriptor)
        self.file.close()

    def read(self) -> None:
        """Take what the kernel has."""
        try:
            for origin, kind, code, value in self.file.events():
                if self.decoder.event(kind, code, value):
                    self.stylus = self.decoder.stylus()
                    # A clock that is not the wall's (a test, an odd driver) says nothing about when.
                    near = abs(self.host.clock() - origin) < 60 * SECOND
                    self.say(origin if near else self.host.clock())
        except OSError as error:
            self.lost(error.strerror or "")
