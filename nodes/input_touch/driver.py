"""What a touch driver is: a small class that hands live contacts to its host.

A driver is found by name: the built-in ones in `BUILT_IN`, those of other packages as entry points of the group
``bunraku.drivers`` named ``touch.<name>``. The host (the node, or a test) keeps the rules of the `touch` topic:
phases, ended contacts listed once, one message per device and frame.
"""

import importlib
import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from typing import Any, Literal, Protocol

from bunraku.msgs import Contact

GROUP = "bunraku.drivers"
BUILT_IN = {
    "script": "bunraku.nodes.input_touch.script:ScriptDriver",
    "tuio": "bunraku.nodes.input_touch.tuio_driver:TuioDriver",
    "evdev": "bunraku.nodes.input_touch.evdev:EvdevDriver",
    "web": "bunraku.nodes.input_touch.web:WebDriver",
}
Ending = Literal["up", "cancel"]


class DriverProblem(Exception):
    """A driver that cannot work at all; one line with the remedy."""


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


class Host(Protocol):
    """What a driver may use."""

    log: logging.Logger

    def option(self, name: str) -> Any:
        """A parameter of the node."""
        ...

    def clock(self) -> int:
        """Now, ns since the epoch."""
        ...

    def listeners(self) -> int:
        """How many hear the touches; none before all nodes that were launched together are up."""
        ...

    def frame(self, frame: Frame) -> None:
        """Hand over a frame."""
        ...

    def connected(self, device: str, *, size_m: tuple[float, float] | None = None, fields: list[str] | None = None,
                  rate: float | None = None, note: str = "") -> None:  # fmt: skip
        """A device is there."""
        ...

    def gone(self, device: str, note: str = "") -> None:
        """A device went; its contacts are cancelled."""
        ...

    def garbage(self, reason: str) -> None:
        """Something unreadable came and was dropped; the host reports it, once a second at most."""
        ...

    def finished(self) -> None:
        """Nothing more will come from this driver."""
        ...

    def add_reader(self, fileno: int, callback: Callable[[], None]) -> None:
        """Call back when a descriptor can be read."""
        ...

    def remove_reader(self, fileno: int) -> None:
        """Stop that."""
        ...

    def listen(self, topic: str, type_: Any, handler: Callable[[Any], None]) -> None:
        """Hear a topic (in `open`)."""
        ...


class Driver:
    """Base of all drivers; override what is needed."""

    name = "driver"
    sampled = False
    """Whether `sample` is called at the node's rate."""
    topics: tuple[str, ...] = ()
    """What it listens to in `open`."""

    def __init__(self, host: Host) -> None:
        self.host = host

    def open(self) -> None:
        """Begin; raises `DriverProblem` where it can never work."""

    def sample(self, now: int) -> None:
        """Called at the node's rate where `sampled`."""

    def keep(self, now: int) -> None:
        """Called ten times a second: retries, time-outs."""

    def close(self) -> None:
        """End."""


def find(name: str) -> type[Driver]:
    """The driver class of a name; raises `DriverProblem`."""
    if name in BUILT_IN:
        module, _, attribute = BUILT_IN[name].partition(":")
        found: type[Driver] = getattr(importlib.import_module(module), attribute)
        return found
    others = {one.name.removeprefix("touch."): one for one in entry_points(group=GROUP, name=f"touch.{name}")}
    if name not in others:
        raise DriverProblem(f"no touch driver {name!r} (has: {', '.join(known())}); install the package that brings it")
    try:
        loaded: type[Driver] = others[name].load()
    except Exception as error:
        raise DriverProblem(f"touch driver {name!r} does not load: {error}; reinstall {others[name].value}") from error
    return loaded


def known() -> list[str]:
    """Names of all drivers."""
    others = [one.name.removeprefix("touch.") for one in entry_points(group=GROUP) if one.name.startswith("touch.")]
    return sorted({*BUILT_IN, *others})


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
