"""What touch drivers hand to the node, and what it makes of it: fingers, frames and their phases.

The node keeps the rules of the `touch` topic for all drivers: phases, ended contacts listed once, one message per
device and frame.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from bunraku.msgs import Contact

Ending = Literal["up", "cancel"]


@dataclass(frozen=True)
class Sample:
    """Where one finger is; lengths in m, angle in rad clockwise from +x, None for what is not known."""

    x: float
    y: float
    major: float | None = None
    minor: float | None = None
    angle: float | None = None
    pressure: float | None = None


@dataclass(frozen=True)
class Frame:
    """All fingers that are on one device now."""

    device: str
    live: Mapping[int, Sample]
    origin: int | None
    """ns since the epoch of the device's sample."""
    ended: Mapping[int, Ending] = field(default_factory=dict)
    """How a finger left, where the device says; one that is merely absent went up."""


class Ledger:
    """The fingers of one device from frame to frame: gives each its phase and lists an ended one once."""

    def __init__(self) -> None:
        self.live: dict[int, Sample] = {}

    def frame(self, live: Mapping[int, Sample], ended: Mapping[int, Ending] | None = None) -> list[Contact]:
        """The contacts of a frame: all live ones, then those that have just left, where they were last."""
        contacts = [_contact(key, "move" if key in self.live else "down", one) for key, one in live.items()]
        for key, last in self.live.items():
            if key not in live:
                contacts.append(_contact(key, (ended or {}).get(key, "up"), last))
        self.live = dict(live)
        return contacts

    def cancel(self) -> list[Contact]:
        """Everything that was there leaves."""
        return self.frame({}, dict.fromkeys(self.live, "cancel"))


def _contact(key: int, phase: Literal["down", "move", "up", "cancel"], one: Sample) -> Contact:
    return Contact(
        id=key, phase=phase, x=one.x, y=one.y, major=one.major, minor=one.minor, angle=one.angle,
        pressure=one.pressure,
    )  # fmt: skip
