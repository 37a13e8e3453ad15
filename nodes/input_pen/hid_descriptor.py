"""HID report descriptors: which bits of which report mean what (USB HID 1.11, section 6.2.2)."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

LONGEST = 16384
MOST_FIELDS = 4096


class DescriptorError(ValueError):
    """A descriptor that cannot be read."""


@dataclass(frozen=True)
class Field:
    """A value in an input report."""

    report: int
    """Report id; 0 where the device has none."""
    offset: int  # bits after the id
    size: int  # bits
    usage: int  # page << 16 | id
    collections: tuple[int, ...]
    """Usages of the collections that it is in, the outermost first."""
    low: int = 0
    high: int = 0
    physical_low: int = 0
    physical_high: int = 0
    unit: int = 0
    exponent: int = 0
    relative: bool = False

    @property
    def signed(self) -> bool:
        """Whether values are in two's complement."""
        return self.low < 0

    def raw(self, body: bytes) -> int | None:
        """The value in a report's body (without the id); None where the body is too short."""
        last = self.offset + self.size
        if last > 8 * len(body):
            return None
        value = int.from_bytes(body[self.offset // 8 : (last + 7) // 8], "little") >> self.offset % 8
        value &= (1 << self.size) - 1
        return value - (1 << self.size) if self.signed and value >> (self.size - 1) else value

    @property
    def metres(self) -> float | None:
        """Length (m) of the whole range, where the unit is one of length."""
        scale = {0x11: 0.01, 0x13: 0.0254}.get(self.unit)  # cm, inch
        extent = self.physical_high - self.physical_low
        if scale is None or extent <= 0:
            return None
        return extent * scale * 10.0**self.exponent


@dataclass(frozen=True)
class _Globals:
    page: int = 0
    low: int = 0
    high: int = 0
    physical_low: int = 0
    physical_high: int = 0
    unit: int = 0
    exponent: int = 0
    size: int = 0
    count: int = 0
    report: int = 0


def _items(body: bytes) -> Iterator[tuple[int, int, int, int]]:
    """(type, tag, unsigned value, bytes of data) of each short item; long items are passed over."""
    at = 0
    while at < len(body):
        head = body[at]
        if head == 0xFE:
            if at + 1 >= len(body):
                raise DescriptorError("ends inside a long item")
            at += 3 + body[at + 1]
            continue
        length = (0, 1, 2, 4)[head & 3]
        if at + 1 + length > len(body):
            raise DescriptorError("ends inside an item")
        yield head >> 2 & 3, head >> 4, int.from_bytes(body[at + 1 : at + 1 + length], "little"), length
        at += 1 + length


def _signed(value: int, length: int) -> int:
    return value - (1 << 8 * length) if length and value >> (8 * length - 1) else value


def parse(body: bytes) -> list[Field]:
    """All fields of all input reports, constants aside; raises `DescriptorError`."""
    if len(body) > LONGEST:
        raise DescriptorError(f"{len(body)} bytes are more than {LONGEST}")
    state, stack = _Globals(), list[_Globals]()
    usages: list[int] = []
    span: list[int] = [0, 0]
    collections: list[int] = []
    filled: dict[int, int] = {}
    fields: list[Field] = []
    for kind, tag, value, length in _items(body):
        if kind == 1:
            state = _global(state, stack, tag, value, length)
        elif kind == 2:
            usage = value if length == 4 else state.page << 16 | value
            if tag == 0:
                usages.append(usage)
            elif tag in (1, 2):
                span[tag - 1] = usage
                if tag == 2:
                    if not 0 <= span[1] - span[0] < MOST_FIELDS:
                        raise DescriptorError("a range of usages is upside down or too long")
                    usages += range(span[0], span[1] + 1)
        elif kind == 0:
            if tag == 0xA:
                collections.append(usages[0] if usages else 0)
            elif tag == 0xC:
                if not collections:
                    raise DescriptorError("ends a collection that was not begun")
                collections.pop()
            elif tag == 8:
                at = filled.get(state.report, 0)
                filled[state.report] = at + state.size * state.count
                if filled[state.report] > 8 * LONGEST:
                    raise DescriptorError("a report is too long")
                if not value & 1 and state.size:  # not constant
                    fields += _fields(state, at, usages, tuple(collections), variable=bool(value & 2),
                                      relative=bool(value & 4))  # fmt: skip
                if len(fields) > MOST_FIELDS:
                    raise DescriptorError(f"more than {MOST_FIELDS} fields")
            usages = []
    return fields


def _global(state: _Globals, stack: list[_Globals], tag: int, value: int, length: int) -> _Globals:
    number = _signed(value, length)
    if tag == 0xA:
        stack.append(state)
        return state
    if tag == 0xB:
        if not stack:
            raise DescriptorError("pops what was not pushed")
        return stack.pop()
    if tag == 2:  # a maximum above a minimum that is not negative has no sign
        return replace(state, high=value if state.low >= 0 and number < 0 else number)
    if tag == 4:
        return replace(state, physical_high=value if state.physical_low >= 0 and number < 0 else number)
    if tag == 5:
        return replace(state, exponent=(value & 0xF) - 16 if value & 8 else value & 7)
    named = {0: "page", 1: "low", 3: "physical_low", 6: "unit", 7: "size", 8: "report", 9: "count"}
    if tag not in named:
        return state
    if tag in (7, 9) and value > 8 * LONGEST:
        raise DescriptorError("a report is too long")
    return replace(state, **{named[tag]: number if tag in (1, 3) else value})


def _fields(
    state: _Globals, at: int, usages: list[int], collections: tuple[int, ...], *, variable: bool, relative: bool
) -> Iterator[Field]:
    # No physical range, or an empty one, means that the physical is the logical one.
    physical = (state.physical_low, state.physical_high)
    if physical == (0, 0):
        physical = (state.low, state.high)
    for k in range(min(state.count, MOST_FIELDS)):
        if not usages:
            return
        usage = usages[min(k, len(usages) - 1)] if variable else usages[0]
        yield Field(
            state.report, at + k * state.size, state.size, usage, collections, state.low, state.high, *physical,
            state.unit, state.exponent, relative,
        )  # fmt: skip
