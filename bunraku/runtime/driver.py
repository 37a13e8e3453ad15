"""Device drivers inside an input node: how they are found, what they may use, and what every host does for them.

A driver is a small class of its own file. The built-in ones of a node are in its table, those of other packages are
entry points of the group ``bunraku.drivers`` named ``<kind>.<name>``, like ``pen.mytablet``.
"""

import contextlib
import importlib
import re
from collections.abc import Mapping, Sequence
from importlib.metadata import entry_points
from typing import Any, ClassVar, Literal

from bunraku.msgs import Device
from bunraku.runtime.node import BoundPublisher, Node, ParamProblem, param, timer

GROUP = "bunraku.drivers"
SECOND = 1_000_000_000
MOST_DEVICES = 16
"""At once."""
MOST_KNOWN = 256
"""Since the node began; each has a topic of its own."""
HELD_UP = SECOND // 2
"""ns between two looks, from which on this process was held up."""


class DriverProblem(Exception):
    """A driver that cannot work at all; one line with the remedy."""


class Driver:
    """Base of all drivers; override what is needed."""

    name: ClassVar[str] = "driver"
    sampled: ClassVar[bool] = False
    """Whether `sample` is called at the node's rate."""
    topics: ClassVar[tuple[str, ...]] = ()
    """What it listens to in `open`."""

    def __init__(self, host: Any) -> None:
        self.host = host

    def open(self) -> None:
        """Begin; raises `DriverProblem` where it can never work."""

    def sample(self, now: int) -> None:
        """Called at the node's rate where `sampled`."""

    def keep(self, now: int) -> None:
        """Called ten times a second: retries, time-outs."""

    def close(self) -> None:
        """End."""


class Silence:
    """When each device was heard last, and which have been silent for too long.

    Time in which this process was held up itself does not count: what came meanwhile is not read yet.
    """

    def __init__(self) -> None:
        self.heard: dict[str, int] = {}
        self._looked = 0

    def late(self, now: int, limit: float) -> list[str]:
        """Devices not heard for ``limit`` s at ``now`` ns; asked ten times a second."""
        if self._looked and now - self._looked > HELD_UP:
            self.heard = dict.fromkeys(self.heard, now)
        self._looked = now
        return [device for device, at in self.heard.items() if now - at > limit * SECOND]


class PerformanceDriver(Driver):
    """Plays something written down, once the listeners are there; override `load`, `length` and `say`."""

    sampled = True

    def open(self) -> None:
        self.load()
        self.started: int | None = None
        self.done = False

    def load(self) -> None:
        """Read what is played; raises `DriverProblem`."""

    def length(self) -> float:
        """s of the performance."""
        raise NotImplementedError

    def say(self, t: float, now: int) -> None:
        """Hand over the sample at ``t`` s; called once beyond the length, to let go."""
        raise NotImplementedError

    def sample(self, now: int) -> None:
        if self.done:
            return
        if self.started is None:
            if self.host.listeners() < listeners_wanted(self.host.option("wait_for")):
                return
            self.started = now + round(self.host.option("delay") * SECOND)
        t = (now - self.started) / SECOND
        if t < 0.0:
            return
        self.say(t, now)
        if t >= self.length():
            if self.host.option("at_end") == "loop":
                self.started = now + round(self.host.option("pause") * SECOND)
                return
            self.done = True
            self.host.finished()


class DriverHost(Node):
    """An input node: hosts drivers, keeps their devices' latched messages and reports what was unreadable."""

    kind: ClassVar[Literal["touch", "pen", "hand", "pad"]] = "touch"
    built_in: ClassVar[Mapping[str, str]] = {}
    """Driver name -> 'module:Class'."""
    says: ClassVar[str] = ""
    """The publisher of the samples."""

    drivers: list[str] = param(["web"], doc="which drivers run, with commas between them")
    rate: float = param(120.0, low=1.0, high=1000.0, doc="Hz at which a performance is sampled")
    script: str = param("", doc="path of the performance that driver script plays")
    wait_for: str = param("1", doc="listeners that driver script waits for: a number, or their names with commas")
    delay: float = param(0.0, low=0.0, high=3600.0, doc="s that driver script waits after its listeners came")
    at_end: str = param(
        "stop", choices=["stop", "stay", "loop"], doc="after the performance: end the node, idle, again"
    )
    pause: float = param(1.0, low=0.0, high=3600.0, doc="s between two rounds of a looped performance")

    @classmethod
    def further(cls, params: dict[str, Any]) -> tuple[Sequence[str], Sequence[str]]:
        """What the drivers of these parameters listen to."""
        heard: list[str] = []
        for name in params["drivers"]:
            with contextlib.suppress(DriverProblem):  # told when the node starts
                heard += find(cls.kind, name, cls.built_in).topics
        return (), heard

    def setup(self) -> None:
        self.device = True  # what is read is not in the journal
        self.surfaces: dict[str, Device] = {}
        self.latches: dict[str, BoundPublisher[Device]] = {}
        self.dropped = 0
        self.why = ""
        self.told_at = 0
        self.running: list[Driver] = []
        names = list(dict.fromkeys(self.drivers))
        if not names:
            has = ", ".join(known(self.kind, self.built_in))
            raise ParamProblem(f"drivers: none given; name at least one of {has}")
        for name in names:
            try:
                driver = find(self.kind, name, self.built_in)(self)
                driver.open()
            except DriverProblem as error:
                raise ParamProblem(str(error)) from None
            self.running.append(driver)
        if any(one.sampled for one in self.running):
            self.every(self.rate, self.sample)

    def teardown(self) -> None:
        for driver in getattr(self, "running", []):
            driver.close()

    def sample(self) -> None:
        """Drivers that follow the node's clock."""
        for driver in self.running:
            if driver.sampled:
                driver.sample(self.now)

    @timer(hz=10)
    def keep(self) -> None:
        """Retries, time-outs and the line about what was dropped."""
        for driver in self.running:
            driver.keep(self.now)
        if self.dropped and self.now - self.told_at >= SECOND:
            self.log.warning("dropped %d unreadable: %s", self.dropped, self.why)
            self.dropped, self.told_at = 0, self.now

    # What drivers use

    def option(self, name: str) -> Any:
        """A parameter of the node."""
        return getattr(self, name)

    def clock(self) -> int:
        """Now, ns since the epoch."""
        return self.stage.clock.now()

    def listeners(self) -> int:
        """How many hear the samples; none before all nodes that were launched together are up."""
        return self.publishers[self.says].subscribers() if self.stage.stack_is_up() else 0

    def connected(
        self,
        device: str,
        *,
        driver: str,
        size_m: tuple[float, float] | None = None,
        fields: list[str] | None = None,
        rate: float | None = None,
        bend_unit: Literal["rad", "raw", "normalised"] | None = None,
        note: str = "",
    ) -> bool:
        """A device is there; False where there are too many."""
        known_one = self.surfaces.get(device)
        if known_one is None:
            if sum(one.connected for one in self.surfaces.values()) >= MOST_DEVICES:
                self.garbage(f"{device}: a device more than {MOST_DEVICES}; end some of the senders")
                return False
            if len(self.surfaces) >= MOST_KNOWN:
                self.garbage(f"{device}: {MOST_KNOWN} devices came and went; start this node again")
                return False
            self.log.info("%s: connected%s", device, f" ({note})" if note else "")
        made = Device(
            device=device, kind=self.kind, driver=driver, size_m=size_m, fields=fields or [], rate=rate,
            bend_unit=bend_unit, note=note[:1024],
        )  # fmt: skip
        if known_one is None or not known_one.connected or known_one.size_m != size_m:
            self.surfaces[device] = made
            self.latch(made)
        return True

    def gone(self, device: str, note: str = "") -> None:
        """A device went; the driver has let go of what it held."""
        surface = self.surfaces.get(device)
        if surface is None or not surface.connected:
            return
        surface.connected, surface.note = False, note[:1024]
        self.latch(surface)
        self.log.warning("%s: gone%s", device, f" ({note})" if note else "")

    def garbage(self, reason: str) -> None:
        """Something unreadable came and was dropped; said once a second at most."""
        self.dropped += 1
        self.why = reason[:200]

    def finished(self) -> None:
        """Nothing more will come from the only driver."""
        if self.at_end == "stop" and len(self.running) == 1:
            self.stop()

    def latch(self, message: Device) -> None:
        """Say what a device is now."""
        topic = "device/" + (re.sub(r"[^a-z0-9_]+", "_", message.device.lower()).strip("_") or self.kind)
        # A page, and a performance of several files, is touch, pen and hands at once.
        topic = f"{topic}_{self.kind}" if message.driver in ("web", "script") else topic
        if topic not in self.latches:
            self.latches[topic] = self.advertise(topic, Device)
        self.latches[topic].publish(message)


def find(kind: str, name: str, built_in: Mapping[str, str]) -> type[Driver]:
    """The driver class of a name; raises `DriverProblem`."""
    if name in built_in:
        module, _, attribute = built_in[name].partition(":")
        found: type[Driver] = getattr(importlib.import_module(module), attribute)
        return found
    others = {one.name.partition(".")[2]: one for one in entry_points(group=GROUP, name=f"{kind}.{name}")}
    if name not in others:
        has = ", ".join(known(kind, built_in))
        raise DriverProblem(f"no {kind} driver {name!r} (has: {has}); install the package that brings it")
    try:
        loaded: type[Driver] = others[name].load()
    except Exception as error:
        raise DriverProblem(f"{kind} driver {name!r} does not load: {error}; reinstall {others[name].value}") from error
    return loaded


def known(kind: str, built_in: Mapping[str, str]) -> list[str]:
    """Names of all drivers of a kind."""
    others = [one.name for one in entry_points(group=GROUP) if one.name.startswith(f"{kind}.")]
    return sorted({*built_in, *(name.partition(".")[2] for name in others)})


def listeners_wanted(text: str) -> int:
    """How many listeners a `wait_for` means: a number, or names with commas between them."""
    text = text.strip()
    if text.isdigit():
        return int(text)
    return len([name for name in text.split(",") if name.strip()])
