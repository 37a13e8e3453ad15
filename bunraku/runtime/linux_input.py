"""Linux input devices (``/dev/input/event*``), read without any package: ioctls and structures of ``linux/input.h``."""

import array
import errno
import fcntl
import os
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

EV_SYN, EV_KEY, EV_ABS = 0x00, 0x01, 0x03
SYN_REPORT, SYN_DROPPED = 0, 3
EVENT = struct.Struct("llHHi")  # seconds, microseconds, type, code, value
SECOND = 1_000_000_000


@dataclass(frozen=True)
class Range:
    """What an axis can say."""

    low: int = 0
    high: int = 0
    resolution: int = 0
    """Units per mm (of a tilt: per rad); 0 where the device does not know."""


def _ioctl_read(number: int, size: int) -> int:
    return 2 << 30 | size << 16 | ord("E") << 8 | number


def axis_now(descriptor: int, code: int) -> tuple[int, Range] | None:
    """EVIOCGABS: an axis' value and range; None where the device has none."""
    body = bytearray(24)
    try:
        fcntl.ioctl(descriptor, _ioctl_read(0x40 + code, 24), body)
    except OSError:
        return None
    value, low, high, _, _, resolution = struct.unpack("6i", body)
    return value, Range(low, high, resolution)


def axis(descriptor: int, code: int) -> Range | None:
    """An axis' range; None where the device has none."""
    now = axis_now(descriptor, code)
    return None if now is None else now[1]


def bits(descriptor: int, number: int, size: int) -> int:
    """A bit field of the device (EVIOCGBIT, EVIOCGPROP, EVIOCGKEY) as one number; 0 where it cannot be read."""
    body = bytearray(size)
    try:
        fcntl.ioctl(descriptor, _ioctl_read(number, size), body)
    except OSError:
        return 0
    return int.from_bytes(body, "little")


def keys(descriptor: int) -> int:
    """EVIOCGBIT of EV_KEY: the keys that a device has, one bit each."""
    return bits(descriptor, 0x20 + EV_KEY, 96)


def keys_down(descriptor: int) -> int:
    """EVIOCGKEY: the keys that are down now, one bit each."""
    return bits(descriptor, 0x18, 96)


def device_name(descriptor: int, otherwise: str = "input device") -> str:
    """EVIOCGNAME."""
    body = bytearray(128)
    try:
        fcntl.ioctl(descriptor, _ioctl_read(0x06, 128), body)
    except OSError:
        return otherwise
    return bytes(body).split(b"\0")[0].decode("utf-8", "replace") or otherwise


def slots(descriptor: int, count: int, codes: tuple[int, ...]) -> dict[int, dict[int, int]]:
    """EVIOCGMTSLOTS: each multi-touch slot's values of these axes."""
    found: dict[int, dict[int, int]] = {slot: {} for slot in range(count)}
    for code in codes:
        body = array.array("i", [code] + [0] * count)
        try:
            fcntl.ioctl(descriptor, _ioctl_read(0x0A, 4 * (count + 1)), body, True)
        except OSError:
            continue
        for slot in range(count):
            found[slot][code] = body[slot + 1]
    return found


class EventFile:
    """An open device: whole events, however their bytes come."""

    def __init__(self, path: str) -> None:
        """Opens it; raises OSError."""
        self.path = path
        self.descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        self._rest = b""

    def close(self) -> None:
        """End."""
        os.close(self.descriptor)

    def events(self) -> Iterator[tuple[int, int, int, int]]:
        """What waits to be read: (ns since the epoch, type, code, value); raises OSError where the device is gone."""
        while True:
            try:
                body = os.read(self.descriptor, EVENT.size * 256)
            except BlockingIOError:
                return
            if not body:
                raise OSError(errno.ENODEV, "no such device")
            body = self._rest + body
            whole = len(body) - len(body) % EVENT.size
            self._rest = body[whole:]
            for seconds, micros, kind, code, value in EVENT.iter_unpack(body[:whole]):
                yield seconds * SECOND + micros * 1000, kind, code, value


def find(wanted: str, fits: Callable[[int], bool], what: str) -> EventFile | str:
    """The device ``wanted``, or the first one that ``fits`` where that is empty; else the line that says why not.

    ``what`` names the kind of device; ``fits`` is asked with the open descriptor.
    """
    paths = [wanted] if wanted else sorted(map(str, Path("/dev/input").glob("event*")))
    denied = 0
    for path in paths:
        try:
            file = EventFile(path)
        except OSError as error:
            if error.errno == errno.EACCES:
                denied += 1
            elif wanted:
                return f"{path}: {error.strerror}; give parameter evdev the path of a {what}"
            continue
        if fits(file.descriptor):
            return file
        file.close()
        if wanted:
            return f"{path} is no {what}; give parameter evdev another path"
    if denied:
        return f"no permission for {wanted or paths[0]}; sudo usermod -aG input $USER, then log in again"
    return f"no {what} found; plug one in or give parameter evdev its path"
