"""What the drivers of tablets share: a pen's state, its tilt as altitude and azimuth, and waiting for the device."""

from dataclasses import dataclass
from math import atan, atan2, cos, pi, sin, tan
from typing import ClassVar

from bunraku.msgs import Pen
from bunraku.runtime.driver import Driver

SECOND = 1_000_000_000
RETRY = 2 * SECOND
TIP, BARREL, SECOND_BARREL, THIRD_BARREL = 1, 2, 4, 8
"""Bits of a sample's buttons."""


def spherical(tilt_x: float, tilt_y: float) -> tuple[float, float]:
    """Altitude and azimuth (rad) of a pen that leans ``tilt_x`` to the right and ``tilt_y`` toward its user (rad).

    As W3C Pointer Events convert them: azimuth 0 points to the right and counts clockwise as seen from above.
    """
    a, b = (min(max(one, -0.5 * pi), 0.5 * pi) for one in (tilt_x, tilt_y))
    if abs(a) < 1e-9 and abs(b) < 1e-9:
        return 0.5 * pi, 0.0
    if 0.5 * pi - max(abs(a), abs(b)) < 1e-6:
        return 0.0, 0.0
    s, c = tan(b), tan(a)
    return atan(1.0 / (s * s + c * c) ** 0.5), atan2(s, c) % (2.0 * pi)


def tilts(altitude: float, azimuth: float) -> tuple[float, float]:
    """The other way: how far a pen leans to the right and toward its user, rad."""
    if altitude < 1e-9:
        return 0.5 * pi * round(cos(azimuth)), 0.5 * pi * round(sin(azimuth))
    return atan(cos(azimuth) / tan(altitude)), atan(sin(azimuth) / tan(altitude))


def share(value: float, low: float, high: float) -> float:
    """Where a raw value lies between two, 0..1."""
    return min(max((value - low) / (high - low), 0.0), 1.0) if high > low else 0.0


@dataclass
class Stylus:
    """A pen over its tablet, as far as the device tells."""

    near: bool = False
    contact: bool = False
    x: float = 0.0  # 0..1 of the width
    y: float = 0.0
    pressure: float = 0.0  # 0..1
    altitude: float = 0.5 * pi  # rad
    azimuth: float = 0.0
    twist: float | None = None
    buttons: int = 0
    eraser: bool = False

    def sample(self, device: str, size_m: tuple[float, float] | None, origin: int) -> Pen:
        """As a message; a pen that is away has neither contact nor buttons."""
        here = self.near and self.contact
        return Pen(
            device=device, size_m=size_m, in_range=self.near, contact=here, x=self.x, y=self.y,
            pressure=self.pressure if here else 0.0, altitude=self.altitude, azimuth=self.azimuth % (2.0 * pi),
            twist=None if self.twist is None else self.twist % (2.0 * pi),
            buttons=(self.buttons & ~TIP | (TIP if here else 0)) if self.near else 0, eraser=self.eraser, origin=origin,
        )  # fmt: skip


class TabletDriver(Driver):
    """Waits for one tablet where there is none, and again when it is unplugged; override `connect` and `disconnect`."""

    name: ClassVar[str] = "tablet"

    def open(self) -> None:
        self.device = self.name
        self.size_m: tuple[float, float] | None = None
        self.stylus = Stylus()
        self.said_near = False
        self.held = False
        self.next_try = 0
        self.complaint = ""
        self.keep(self.host.clock())

    def connect(self) -> str:
        """Look for the device; the line that says why there is none, or nothing."""
        raise NotImplementedError

    def disconnect(self) -> None:
        """Close the device."""

    def keep(self, now: int) -> None:
        if self.held or now < self.next_try:
            return
        self.next_try = now + RETRY
        why = self.connect()
        if why and why != self.complaint:
            self.host.log.warning("%s: %s; tried again every %d s", self.name, why, RETRY // SECOND)
        self.complaint = why

    def close(self) -> None:
        if self.held:
            self.held = False
            self.disconnect()

    def found(self, device: str, size_m: tuple[float, float] | None, fields: list[str], note: str) -> None:
        """The device is there and open."""
        self.device, self.size_m, self.held = device, size_m, True
        self.stylus, self.said_near = Stylus(), False
        self.host.connected(device, driver=self.name, size_m=size_m, fields=fields, note=note)

    def lost(self, why: str) -> None:
        """It went: its pen is out of range."""
        if not self.held:
            return
        self.held = False
        self.disconnect()
        self.stylus.near = False
        self.say(self.host.clock())
        self.host.gone(self.device, f"unplugged: {why}" if why else "unplugged")
        self.next_try = self.host.clock() + RETRY

    def say(self, origin: int) -> None:
        """The pen as it is now; of one that stays away nothing is said."""
        if not self.stylus.near and not self.said_near:
            return
        self.said_near = self.stylus.near
        self.host.say(self.stylus.sample(self.device, self.size_m, origin))
