"""Input reports of pens: by the device's own descriptor where that says what is in them, else by a known layout."""

from math import pi, radians
from typing import Protocol

from bunraku.nodes.input_pen.hid_descriptor import Field, parse
from bunraku.nodes.input_pen.tablet import BARREL, SECOND_BARREL, Stylus, share, spherical
from bunraku.nodes.input_pen.wacom import WACOM, wacom_decoder

X, Y = 0x10030, 0x10031
DIGITIZER, WACOM_PAGE = 0x0D, 0xFF0D
"""The second one mirrors the first one's usages on newer Wacom tablets."""
PRESSURE, IN_RANGE, SENSE, INVERT, X_TILT, Y_TILT, AZIMUTH, ALTITUDE, TWIST, TIP, BARREL_SWITCH, ERASER, BARREL_2 = (
    DIGITIZER << 16 | one for one in (0x30, 0x32, 0x36, 0x3C, 0x3D, 0x3E, 0x3F, 0x40, 0x41, 0x42, 0x44, 0x45, 0x5A)
)
TOOL_TYPE = WACOM_PAGE << 16 | 0x77
APPLICATIONS = {DIGITIZER << 16 | 1, DIGITIZER << 16 | 2, WACOM_PAGE << 16 | 1, WACOM_PAGE << 16 | 2}
"""Digitizer and pen; a touch screen (4) or touch pad (5) is none."""
STYLUS = {DIGITIZER << 16 | 0x20, WACOM_PAGE << 16 | 0x20, DIGITIZER << 16 | 2}


class Decoder(Protocol):
    """Reports in, the pen out."""

    size_m: tuple[float, float] | None
    fields: list[str]
    """The optional fields that it fills."""

    def report(self, data: bytes) -> Stylus | None:
        """One report with its id first where the device has ids; None where it says nothing of a pen."""
        ...


def _plain(usage: int) -> int:
    """The usage without the vendor's mirror."""
    page, one = usage >> 16, usage & 0xFFFF
    if page != WACOM_PAGE or usage == TOOL_TYPE:
        return usage
    return {0x130: X, 0x131: Y}.get(one, DIGITIZER << 16 | one)


class DescribedPen:
    """A pen whose reports its descriptor describes."""

    def __init__(self, fields: list[Field]) -> None:
        """``fields`` of one report or several; each report that has a place is read."""
        self.reports: dict[int, dict[int, Field]] = {}
        for one in fields:
            inside = one.collections and one.collections[0] in APPLICATIONS and STYLUS.intersection(one.collections)
            if inside and not one.relative:
                self.reports.setdefault(one.report, {}).setdefault(_plain(one.usage), one)
        self.reports = {
            number: known
            for number, known in self.reports.items()
            if X in known and Y in known and known[X].high > known[X].low and (TIP in known or PRESSURE in known)
        }
        self.numbered = any(one.report for one in fields)
        first = next(iter(self.reports.values()), {})
        self.size_m = None
        if first:
            width, height = first[X].metres, first[Y].metres
            self.size_m = (width, height) if width and height and max(width, height) < 5.0 else None
        self.fields = ["pressure"] if PRESSURE in first else []
        if X_TILT in first or ALTITUDE in first:
            self.fields += ["altitude", "azimuth"]
        if TWIST in first:
            self.fields.append("twist")

    def report(self, data: bytes) -> Stylus | None:
        number, body = (data[0] if data else 0, data[1:]) if self.numbered else (0, data)
        known = self.reports.get(number)
        if known is None:
            return None
        raw = {usage: value for usage, one in known.items() if (value := one.raw(body)) is not None}
        if X not in raw or Y not in raw:
            return None

        def of(usage: int) -> float:
            one = known[usage]
            return share(raw[usage], one.low, one.high)

        near = bool(raw.get(IN_RANGE, 0) or raw.get(SENSE, 0))
        if IN_RANGE not in known and SENSE not in known:
            near = True
        pressure = of(PRESSURE) if PRESSURE in raw else 0.5
        touches = bool(raw.get(TIP, 0) or raw.get(ERASER, 0)) if TIP in raw else pressure > 0.0
        altitude, azimuth = 0.5 * pi, 0.0
        if X_TILT in raw and Y_TILT in raw:
            altitude, azimuth = spherical(_angle(known[X_TILT], raw[X_TILT]), _angle(known[Y_TILT], raw[Y_TILT]))
        elif ALTITUDE in raw:
            altitude = min(max(_angle(known[ALTITUDE], raw[ALTITUDE]), 0.0), 0.5 * pi)
            # Counted counter-clockwise there.
            azimuth = -_angle(known[AZIMUTH], raw[AZIMUTH]) % (2.0 * pi) if AZIMUTH in raw else 0.0
        buttons = (BARREL if raw.get(BARREL_SWITCH) else 0) | (SECOND_BARREL if raw.get(BARREL_2) else 0)
        turned = bool(raw.get(INVERT) or raw.get(ERASER) or raw.get(TOOL_TYPE, 0) & 0xF == 0xA)
        return Stylus(
            near=near, contact=near and touches, x=of(X), y=of(Y), pressure=pressure, altitude=altitude,
            azimuth=azimuth, twist=_angle(known[TWIST], raw[TWIST]) % (2.0 * pi) if TWIST in raw else None,
            buttons=buttons, eraser=turned,
        )  # fmt: skip


def _angle(field: Field, raw: int) -> float:
    """A field's value in rad: by its unit, else in degrees."""
    span = field.high - field.low
    physical = field.physical_low + (raw - field.low) * (field.physical_high - field.physical_low) / span if span else 0
    value = physical * 10.0**field.exponent if field.unit else float(physical)
    return value if field.unit == 0x12 else radians(value)


def decoder_of(descriptor: bytes, vendor: int, product: int) -> Decoder | None:
    """How a device's reports are read; None where it is no pen that is known. Raises `DescriptorError`."""
    described = DescribedPen(parse(descriptor)) if descriptor else None
    if described is not None and described.reports:
        return described
    return wacom_decoder(product) if vendor == WACOM else None
