"""The `evdev` driver: multi-touch protocol B of the Linux kernel, read without any package.

The kernel tells only what changes, so each slot's state is held; after a lost event (SYN_DROPPED) and at the start
the slots are asked for (EVIOCGMTSLOTS). Constants and structures are those of ``linux/input.h``.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import pi
from pathlib import Path

from bunraku.nodes.input_touch.frame import Frame, Sample
from bunraku.runtime.driver import Driver
from bunraku.runtime.linux_input import (
    EV_ABS,
    EV_SYN,
    SYN_DROPPED,
    SYN_REPORT,
    EventFile,
    Range,
    axis,
    bits,
    device_name,
    find,
    slots,
)

ABS_MT_SLOT, ABS_MT_TOUCH_MAJOR, ABS_MT_TOUCH_MINOR, ABS_MT_ORIENTATION = 0x2F, 0x30, 0x31, 0x34
ABS_MT_POSITION_X, ABS_MT_POSITION_Y, ABS_MT_TRACKING_ID, ABS_MT_PRESSURE = 0x35, 0x36, 0x39, 0x3A
VALUES = (
    ABS_MT_TRACKING_ID, ABS_MT_POSITION_X, ABS_MT_POSITION_Y, ABS_MT_TOUCH_MAJOR, ABS_MT_TOUCH_MINOR,
    ABS_MT_ORIENTATION, ABS_MT_PRESSURE,
)  # fmt: skip
PROP_DIRECT = 1
SECOND = 1_000_000_000
RETRY = 2 * SECOND


@dataclass
class _Slot:
    values: dict[int, int] = field(default_factory=dict)

    @property
    def tracking(self) -> int:
        return self.values.get(ABS_MT_TRACKING_ID, -1)


class SlotDecoder:
    """Events in, the fingers that are down out; knows nothing of files."""

    def __init__(self, ranges: dict[int, Range], resync: Callable[[], dict[int, dict[int, int]]]) -> None:
        """``resync`` asks the device for every slot's values: {slot: {code: value}}."""
        self.ranges = ranges
        self.resync = resync
        self.slots: dict[int, _Slot] = {}
        self.slot = 0
        self.deaf = False
        self.refresh()

    def refresh(self) -> None:
        """Take every slot as the device says it is now."""
        self.slots = {slot: _Slot(dict(values)) for slot, values in self.resync().items()}

    def event(self, kind: int, code: int, value: int) -> dict[int, Sample] | None:
        """One event; the live fingers by tracking id when it completes a frame."""
        if kind == EV_SYN:
            if code == SYN_DROPPED:
                self.deaf = True
                return None
            if code != SYN_REPORT:
                return None
            if self.deaf:
                # What came since the loss is incomplete: the kernel's own state replaces it.
                self.deaf = False
                self.refresh()
            return self.live()
        if kind != EV_ABS or self.deaf:
            return None
        if code == ABS_MT_SLOT:
            self.slot = value
        elif code in VALUES:
            self.slots.setdefault(self.slot, _Slot()).values[code] = value
        return None

    def live(self) -> dict[int, Sample]:
        """The fingers that are down, by tracking id."""
        found: dict[int, Sample] = {}
        for key in sorted(self.slots):
            slot = self.slots[key]
            if slot.tracking >= 0 and ABS_MT_POSITION_X in slot.values and ABS_MT_POSITION_Y in slot.values:
                found[slot.tracking] = self._sample(slot.values)
        return found

    @property
    def size_m(self) -> tuple[float, float] | None:
        """Width and height of the surface, where the device knows its resolution."""
        x, y = self.ranges.get(ABS_MT_POSITION_X), self.ranges.get(ABS_MT_POSITION_Y)
        if x is None or y is None or x.resolution <= 0 or y.resolution <= 0:
            return None
        return ((x.high - x.low) / x.resolution / 1000.0, (y.high - y.low) / y.resolution / 1000.0)

    @property
    def fields(self) -> list[str]:
        """The optional fields that it fills."""
        names = {ABS_MT_TOUCH_MAJOR: "major", ABS_MT_TOUCH_MINOR: "minor", ABS_MT_ORIENTATION: "angle",
                 ABS_MT_PRESSURE: "pressure"}  # fmt: skip
        return [name for code, name in names.items() if code in self.ranges]

    def _sample(self, values: dict[int, int]) -> Sample:
        major = self._length(values.get(ABS_MT_TOUCH_MAJOR), ABS_MT_TOUCH_MAJOR)
        minor = self._length(values.get(ABS_MT_TOUCH_MINOR), ABS_MT_TOUCH_MINOR)
        angle = None
        turn = self.ranges.get(ABS_MT_ORIENTATION)
        if turn is not None and turn.high > 0 and ABS_MT_ORIENTATION in values:
            # The largest value is a quarter turn clockwise from the surface's y axis.
            angle = pi / 2.0 - values[ABS_MT_ORIENTATION] / turn.high * (pi / 2.0)
            angle = (angle + pi / 2.0) % pi - pi / 2.0
        pressure = None
        force = self.ranges.get(ABS_MT_PRESSURE)
        if force is not None and force.high > force.low and ABS_MT_PRESSURE in values:
            pressure = min(1.0, max(0.0, (values[ABS_MT_PRESSURE] - force.low) / (force.high - force.low)))
        return Sample(
            self._share(values[ABS_MT_POSITION_X], ABS_MT_POSITION_X),
            self._share(values[ABS_MT_POSITION_Y], ABS_MT_POSITION_Y),
            major,
            minor if minor is not None else major,
            angle,
            pressure,
        )

    def _share(self, value: int, code: int) -> float:
        axis = self.ranges.get(code, Range())
        if axis.high <= axis.low:
            return 0.0
        return min(1.0, max(0.0, (value - axis.low) / (axis.high - axis.low)))

    def _length(self, value: int | None, code: int) -> float | None:
        own = self.ranges.get(code)
        if value is None or own is None or value < 0:
            return None
        # Without a resolution of its own a length has the unit of the position's.
        per_mm = own.resolution or self.ranges.get(ABS_MT_POSITION_X, Range()).resolution
        return value / per_mm / 1000.0 if per_mm > 0 else None


class EvdevDriver(Driver):
    """Reads one touch device of the kernel; waits for it where it is not there, and again when it is unplugged."""

    name = "evdev"

    def open(self) -> None:
        self.file: EventFile | None = None
        self.device = "evdev"
        self.next_try = 0
        self.complaint = ""
        self._connect()

    def keep(self, now: int) -> None:
        if self.file is None and now >= self.next_try:
            self.next_try = now + RETRY
            self._connect()

    def close(self) -> None:
        self._disconnect()

    def _connect(self) -> None:
        wanted = str(self.host.option("evdev"))

        def fits(descriptor: int) -> bool:
            direct = bits(descriptor, 0x09, 8) >> PROP_DIRECT & 1
            return axis(descriptor, ABS_MT_SLOT) is not None and bool(wanted or direct)

        found = find(wanted, fits, "multi-touch device")
        if isinstance(found, EventFile):
            self._take(found)
        elif found != self.complaint:
            self.complaint = found
            self.host.log.warning("evdev: %s; tried again every %d s", found, RETRY // SECOND)

    def _take(self, file: EventFile) -> None:
        descriptor = file.descriptor
        count = axis(descriptor, ABS_MT_SLOT)
        assert count is not None
        ranges = {code: one for code in VALUES if (one := axis(descriptor, code)) is not None}
        self.file, self.complaint = file, ""
        self.decoder = SlotDecoder(ranges, lambda: slots(descriptor, count.high + 1, VALUES))
        self.device = f"evdev-{Path(file.path).name}"
        self.host.connected(
            self.device, driver="evdev", size_m=self.decoder.size_m, fields=self.decoder.fields,
            note=device_name(descriptor, "touch device"),
        )  # fmt: skip
        self.host.add_reader(descriptor, self._read)

    def _disconnect(self, note: str = "") -> None:
        file, self.file = self.file, None
        if file is None:
            return
        self.host.remove_reader(file.descriptor)
        file.close()
        if note:
            self.host.gone(self.device, note)

    def _read(self) -> None:
        if self.file is None:
            return
        try:
            for origin, kind, code, value in self.file.events():
                live = self.decoder.event(kind, code, value)
                if live is not None:
                    # A clock that is not the wall's (a test, an odd driver) says nothing about when.
                    near = abs(self.host.clock() - origin) < 60 * SECOND
                    self.host.frame(Frame(self.device, live, origin if near else self.host.clock()))
        except OSError as error:
            self._disconnect(f"unplugged: {error.strerror}")
