"""What is drawn over the figure: circles, paths, panels."""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from bunraku.msgs.base import Message, Metres, Name, Number, Unit

Color = tuple[Unit, Unit, Unit, Unit]


class Primitive(msgspec.Struct, kw_only=True):
    """One thing to draw.

    Points are (x, y) shares of the picture from its top-left in ``screen`` and ``panel`` space (a panel is
    drawn where there is room for it), (x, y, z) metres in ``world`` space.
    """

    kind: Literal["circle", "line", "polygon", "points", "figure", "bar", "text"]
    space: Literal["screen", "world", "panel"] = "world"
    points: Annotated[list[tuple[Number, ...]], Meta(max_length=4096)] = []
    color: Color = (0.90, 0.22, 0.20, 1.0)
    size: Annotated[float, Meta(ge=0.0, le=1e3)] = 0.01
    """Circle: radius; line and points: width; text: height; a share of the picture's height on the screen,
    metres in the world. Bar: the value, 0..1, of a bar from its first point to its second."""
    label: Annotated[str, Meta(max_length=256)] = ""


class Overlay(Message, kw_only=True):
    """All that one node wants to be drawn now; an empty list clears it."""

    primitives: Annotated[list[Primitive], Meta(max_length=512)] = []


__all__ = ["Color", "Metres", "Name", "Overlay", "Primitive"]
