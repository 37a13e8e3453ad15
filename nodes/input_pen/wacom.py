"""Wacom tablets whose descriptors do not say what is in their reports; layouts and sizes as Linux knows them."""

from dataclasses import dataclass
from math import radians
from typing import Literal

from bunraku.nodes.input_pen.tablet import BARREL, SECOND_BARREL, Stylus, spherical

WACOM = 0x056A
START = bytes([2, 2])
"""The feature report that makes them send whole pen reports."""


@dataclass(frozen=True)
class Model:
    """A tablet's ranges."""

    family: Literal["intuos", "bamboo"]
    width: int  # lines
    height: int
    pressure: int  # largest
    per_mm: int  # lines
    tilt: bool = True
    half: bool = False
    """Intuos 2 counts half as finely as its reports have room for."""


def _models() -> dict[int, Model]:
    found = {}
    for product, width, height in (
        (0x41, 12700, 10600), (0x42, 20320, 16240), (0x43, 30480, 24060), (0x44, 30480, 31680), (0x45, 45720, 31680),
    ):  # fmt: skip
        found[product] = Model("intuos", width, height, 1023, 100, half=True)
    for product, width, height in (
        (0xB0, 25400, 20320), (0xB1, 40640, 30480), (0xB2, 60960, 45720), (0xB3, 60960, 60960), (0xB4, 97536, 60960),
        (0xB5, 54204, 31750), (0xB7, 31496, 19685),
    ):  # fmt: skip
        found[product] = Model("intuos", width, height, 1023, 200)
    for products, width, height in (
        ((0xB8, 0x26, 0x29, 0x314), 31496, 19685), ((0xB9, 0x27, 0x2A, 0x315), 44704, 27940),
        ((0xBA, 0x28, 0x317), 65024, 40640), ((0xBB,), 97536, 60960),
    ):  # fmt: skip
        found.update({product: Model("intuos", width, height, 2047, 200) for product in products})
    found[0x33C] = Model("intuos", 15200, 9500, 2047, 100, tilt=False)
    for product, width, height in (
        (0xD7, 14720, 9200), (0xD8, 21648, 13700), (0xDA, 14720, 9200), (0xDB, 21648, 13700), (0xDD, 14720, 9200),
        (0xDE, 14720, 9200), (0xDF, 21648, 13700), (0x300, 14720, 9225), (0x301, 21648, 13530), (0x302, 15200, 9500),
    ):  # fmt: skip
        found[product] = Model("bamboo", width, height, 1023, 100, tilt=False)
    return found


MODELS = _models()


class _Wacom:
    def __init__(self, model: Model) -> None:
        self.model = model
        self.size_m: tuple[float, float] | None = (
            model.width / model.per_mm / 1000.0,
            model.height / model.per_mm / 1000.0,
        )
        self.fields = ["pressure", "altitude", "azimuth"] if model.tilt else ["pressure"]
        self.stylus = Stylus()

    def _place(self, x: int, y: int, pressure: int) -> None:
        model = self.model
        self.stylus.x = min(x / model.width, 1.0)
        self.stylus.y = min(y / model.height, 1.0)
        self.stylus.pressure = min(pressure / model.pressure, 1.0)


class IntuosPen(_Wacom):
    """Intuos 2 to 5, Intuos Pro of the first generation: reports 2 and 16, of 10 bytes."""

    def report(self, data: bytes) -> Stylus | None:
        if len(data) < 10 or data[0] not in (0x02, 0x10):
            return None
        one, pen = data[1], self.stylus
        if one & 0xFC == 0xC0:  # a tool comes near, and says which it is
            tool = data[2] << 4 | data[3] >> 4 | (data[7] & 0x0F) << 16 | (data[8] & 0xF0) << 8
            pen.eraser = tool & 0xF == 0xA
            pen.near = True
            return None  # where it is comes next
        if one & 0xFE == 0x20:
            return None  # near, but not to be seen yet
        if one & 0xFE == 0x80:
            pen.near = pen.contact = False
            pen.twist = None
            return pen
        kind = one >> 1 & 0xF
        if kind == 5:  # an art pen's turn: a whole one is 1800 units
            turn = data[6] << 3 | data[7] >> 5 & 7
            if data[7] & 0x20:
                turn = (turn - 1) // 2 - 1350 if turn > 900 else (turn - 1) // 2 + 450
            else:
                turn = 450 - turn // 2
            pen.twist = radians(0.2 * (turn + 900))
            return pen
        if kind > 3:
            return None  # a mouse or an airbrush's wheel
        x, y = (data[2] << 8 | data[3]) << 1 | data[9] >> 1 & 1, (data[4] << 8 | data[5]) << 1 | data[9] & 1
        if self.model.half:
            x, y = x >> 1, y >> 1
        pressure = data[6] << 3 | (data[7] & 0xC0) >> 5 | one & 1
        touches = pressure > 10
        self._place(x, y, pressure >> 1 if self.model.pressure < 2047 else pressure)
        pen.near, pen.contact = True, touches
        if self.model.tilt:
            tilt_x, tilt_y = (data[7] << 1 & 0x7E | data[8] >> 7) - 64, (data[8] & 0x7F) - 64
            pen.altitude, pen.azimuth = spherical(radians(tilt_x), radians(tilt_y))
        pen.buttons = (BARREL if one & 2 else 0) | (SECOND_BARREL if one & 4 else 0)
        return pen


class BambooPen(_Wacom):
    """Bamboo, One and the first Intuos PT: report 2."""

    def report(self, data: bytes) -> Stylus | None:
        if len(data) not in (9, 10) or data[0] != 0x02:  # longer ones are fingers
            return None
        one, pen = data[1], self.stylus
        pen.near = bool(one & 0x80)
        ready, seen = bool(one & 0x20), bool(one & 0x40)
        if seen:
            self._place(data[2] | data[3] << 8, data[4] | data[5] << 8, data[6] | data[7] << 8)
            pen.eraser = bool(one & 0x08)
        pen.contact = ready and bool(one & 1)
        pen.buttons = ((BARREL if one & 2 else 0) | (SECOND_BARREL if one & 4 else 0)) if ready else 0
        return pen


def wacom_decoder(product: int) -> IntuosPen | BambooPen | None:
    """The layout of a model; None for one that is not known."""
    model = MODELS.get(product)
    if model is None:
        return None
    return IntuosPen(model) if model.family == "intuos" else BambooPen(model)
