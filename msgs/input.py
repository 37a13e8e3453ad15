"""What the hands did: samples of the devices, before anything is made of them."""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from bunraku.msgs.base import Message, Metres, Name, Number, Quat, Radians, Share, Signed, Size, Unit, Vec3

Surface = tuple[Size, Size]
Pi2 = Annotated[float, Meta(ge=0.0, le=1.5707964)]
TwoPi = Annotated[float, Meta(ge=0.0, le=6.2831854)]


class Contact(msgspec.Struct, kw_only=True):
    """One finger on a surface; an ellipse where the device knows its shape."""

    id: Annotated[int, Meta(ge=-(2**31), le=2**53)]
    phase: Literal["down", "move", "up", "cancel"]
    x: Share
    y: Share
    major: Size | None = None
    """Full length of the long axis, m."""
    minor: Size | None = None
    angle: Radians | None = None
    """Of the long axis, clockwise from +x as seen."""
    pressure: Unit | None = None


class Touch(Message, kw_only=True):
    """All live contacts of one device, every frame; an ended one is listed once more as up or cancel."""

    device: Name
    size_m: Surface | None = None
    contacts: Annotated[list[Contact], Meta(max_length=64)]


class Pen(Message, kw_only=True):
    """One sample of one pen."""

    device: Name
    size_m: Surface | None = None
    in_range: bool
    contact: bool
    x: Share
    y: Share
    pressure: Unit = 0.0
    altitude: Pi2 = 1.5707963267948966
    """rad above the surface; pi/2 is upright."""
    azimuth: TwoPi = 0.0
    """rad of the cap's direction, clockwise from +x as seen."""
    twist: TwoPi | None = None
    buttons: Annotated[int, Meta(ge=0, le=2**32)] = 0
    eraser: bool = False


class Hand(msgspec.Struct, kw_only=True):
    """One hand in the air."""

    confidence: Unit = 1.0
    position: Vec3 | None = None
    rotation: Quat | None = None
    bend: tuple[Number, Number, Number, Number, Number]
    """Thumb to little finger, in the device message's unit."""


class Hands(Message, kw_only=True):
    """Both hands of one device; None where a hand is not seen."""

    device: Name
    left: Hand | None = None
    right: Hand | None = None


class Pad(Message, kw_only=True):
    """One sample of one gamepad."""

    device: Name
    axes: Annotated[list[Signed], Meta(max_length=32)]
    buttons: Annotated[list[bool], Meta(max_length=64)]


class Device(Message, kw_only=True):
    """What a device is and can do; latched."""

    device: Name
    kind: Literal["touch", "pen", "hand", "pad"]
    driver: Name
    connected: bool = True
    rate: Annotated[float, Meta(ge=0.0, le=1e5)] | None = None
    size_m: Surface | None = None
    fields: list[Name] = []
    """Optional fields that this device fills."""
    bend_unit: Literal["rad", "raw", "normalised"] | None = None
    note: Annotated[str, Meta(max_length=1024)] = ""


class PenSample(msgspec.Struct, kw_only=True):
    """One (coalesced) pointer sample of a pen or mouse on the page."""

    time: Number = 0.0
    in_range: bool = True
    contact: bool = False
    x: Share
    y: Share
    pressure: Unit = 0.0
    altitude: Pi2 = 1.5707963267948966
    azimuth: TwoPi = 0.0
    twist: TwoPi | None = None
    buttons: Annotated[int, Meta(ge=0, le=2**32)] = 0
    eraser: bool = False


class Event(Message, kw_only=True):
    """A browser's raw event, for the device nodes' `web` drivers."""

    device: Name
    """``web-<page id>``"""
    kind: Literal["touch", "pen", "hands", "pad", "gone"]
    size_m: Surface | None = None
    time: Number = 0.0
    """ms on the page's own clock"""
    contacts: Annotated[list[Contact], Meta(max_length=64)] = []
    pen: Annotated[list[PenSample], Meta(max_length=256)] = []
    left: Hand | None = None
    right: Hand | None = None
    axes: Annotated[list[Signed], Meta(max_length=32)] = []
    buttons: Annotated[list[bool], Meta(max_length=64)] = []


__all__ = [
    "Contact", "Device", "Event", "Hand", "Hands", "Metres", "Pad", "Pen", "PenSample", "Surface", "Touch",
]  # fmt: skip
