"""The `evdev` driver: a gamepad of the Linux kernel, by the optional package `evdev`."""

from pathlib import Path
from typing import Any

from bunraku.runtime.driver import Driver, DriverProblem

SECOND = 1_000_000_000
RETRY = 2 * SECOND
EV_SYN, EV_KEY, EV_ABS = 0, 1, 3
SYN_REPORT, SYN_DROPPED = 0, 3
AXES = (0x00, 0x01, 0x03, 0x04)
"""ABS_X, ABS_Y, ABS_RX, ABS_RY, in the order of the standard gamepad."""
BUTTONS = (
    0x130, 0x131, 0x133, 0x134, 0x136, 0x137, 0x138, 0x139, 0x13A, 0x13B, 0x13D, 0x13E, 0x220, 0x221, 0x222, 0x223,
)  # fmt: skip
"""BTN_SOUTH, EAST, NORTH, WEST, TL, TR, TL2, TR2, SELECT, START, THUMBL, THUMBR, dpad up, down, left, right."""
GAMEPAD = 0x130


class PadState:
    """Events in, axes and buttons out; knows nothing of files."""

    def __init__(self, ranges: dict[int, tuple[int, int]]) -> None:
        """``ranges``: lowest and highest value of each axis."""
        self.ranges = ranges
        self.axes = [0.0] * len(AXES)
        self.buttons = [False] * len(BUTTONS)
        self.deaf = False

    def event(self, kind: int, code: int, value: int) -> bool:
        """One event; True where it completes a frame."""
        if kind == EV_SYN:
            if code == SYN_DROPPED:
                self.deaf = True
            elif code == SYN_REPORT and self.deaf:
                self.deaf = False
                return False
            return code == SYN_REPORT
        if self.deaf:
            return False
        if kind == EV_ABS and code in AXES:
            low, high = self.ranges.get(code, (0, 0))
            if high > low:
                self.axes[AXES.index(code)] = min(max(2.0 * (value - low) / (high - low) - 1.0, -1.0), 1.0)
        elif kind == EV_KEY and code in BUTTONS:
            self.buttons[BUTTONS.index(code)] = value != 0
        return False


class EvdevDriver(Driver):
    """Reads one gamepad; waits for it where it is not there, and again when it is unplugged."""

    name = "evdev"

    def open(self) -> None:
        try:
            import evdev
        except ImportError:
            raise DriverProblem("evdev: the package is missing; pip install 'bunraku[evdev]'") from None
        self.evdev: Any = evdev
        self.pad: Any = None
        self.device = "evdev"
        self.next_try = 0
        self.complaint = ""
        self._connect()

    def keep(self, now: int) -> None:
        if self.pad is None and now >= self.next_try:
            self.next_try = now + RETRY
            self._connect()

    def close(self) -> None:
        self._disconnect("")

    def _complain(self, text: str) -> None:
        if text != self.complaint:
            self.complaint = text
            self.host.log.warning("evdev: %s; tried again every %d s", text, RETRY // SECOND)

    def _connect(self) -> None:
        wanted = str(self.host.option("evdev"))
        for path in [wanted] if wanted else sorted(map(str, Path("/dev/input").glob("event*"))):
            try:
                device = self.evdev.InputDevice(path)
            except OSError as error:
                if wanted:
                    self._complain(f"{path}: {error.strerror}; give parameter evdev the path of a gamepad")
                    return
                continue
            if GAMEPAD in device.capabilities().get(EV_KEY, []):
                self._take(device)
                return
            device.close()
        self._complain(f"{wanted} is no gamepad" if wanted else "no gamepad found; plug one in, or join group input")

    def _take(self, device: Any) -> None:
        ranges = {code: (info.min, info.max) for code, info in device.capabilities().get(EV_ABS, [])}
        self.pad, self.complaint = device, ""
        self.state = PadState(ranges)
        self.device = f"evdev-{Path(device.path).name}"
        self._look()
        self.host.connected(self.device, driver="evdev", fields=["axes", "buttons"], note=device.name)
        self.host.add_reader(device.fd, self._read)

    def _look(self) -> None:
        """Take axes and buttons as they are now."""
        for code in self.state.ranges:
            self.state.event(EV_ABS, code, self.pad.absinfo(code).value)
        held = set(self.pad.active_keys())
        self.state.buttons = [code in held for code in BUTTONS]

    def _disconnect(self, note: str) -> None:
        if self.pad is None:
            return
        self.host.remove_reader(self.pad.fd)
        self.pad.close()
        self.pad = None
        if note:
            self.host.say(self.device, [0.0] * len(AXES), [False] * len(BUTTONS), self.host.clock())
            self.host.gone(self.device, note)

    def _read(self) -> None:
        try:
            for one in self.pad.read():
                deaf = self.state.deaf
                if self.state.event(one.type, one.code, one.value):
                    self.host.say(self.device, list(self.state.axes), list(self.state.buttons), self.host.clock())
                elif deaf and not self.state.deaf:
                    self._look()  # what was lost: the kernel's own state replaces it
        except BlockingIOError:
            return
        except OSError as error:
            self._disconnect(f"unplugged: {error.strerror}")
