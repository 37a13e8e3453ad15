"""The node: hosts touch drivers, and keeps the rules of the `touch` topic for all of them."""

import contextlib
import re
from collections.abc import Sequence
from typing import Any

from bunraku.msgs import Device, Touch
from bunraku.nodes.input_touch.driver import Driver, DriverProblem, Frame, Ledger, find
from bunraku.runtime.node import BoundPublisher, Node, ParamProblem, Publisher, param, timer

SECOND = 1_000_000_000
MOST_DEVICES = 16
MOST_CONTACTS = 64  # of the touch message


class InputTouch(Node):
    """What fingers do on touch surfaces, from TUIO, Linux, the page or a written performance."""

    name = "input_touch"
    touch: Publisher[Touch] = Publisher("touch", Touch)
    drivers: list[str] = param(["script"], doc="which drivers run: script, tuio, evdev, web, or a package's own")
    rate: float = param(120.0, low=1.0, high=1000.0, doc="Hz at which a performance is sampled")
    script: str = param("", doc="path of the performance (.touch) that driver script plays")
    wait_for: str = param("1", doc="listeners that driver script waits for: a number, or their names with commas")
    delay: float = param(0.0, low=0.0, high=3600.0, doc="s that driver script waits after its listeners came")
    at_end: str = param(
        "stop", choices=["stop", "stay", "loop"], doc="after the performance: end the node, idle, again"
    )
    pause: float = param(1.0, low=0.0, high=3600.0, doc="s between two rounds of a looped performance")
    host: str = param("127.0.0.1", doc="address that driver tuio listens on; 0.0.0.0 lets other machines send")
    port: int = param(3333, low=0, high=65535, doc="UDP port of driver tuio; 0 takes a free one")
    merge: float = param(0.002, low=0.0, high=0.02, doc="s that driver tuio waits for the rest of a split frame")
    lost: float = param(2.0, low=0.1, high=3600.0, doc="s of silence after which a TUIO source is gone")
    silent: float = param(1.5, low=0.3, high=60.0, doc="s of silence after which a page's fingers are taken away")
    size_m: list[float] = param([], doc="width and height of the TUIO surface in m, where its ellipses shall be known")
    evdev: str = param("", doc="path of the touch device for driver evdev; empty takes the first touch screen")

    @classmethod
    def further(cls, params: dict[str, Any]) -> tuple[Sequence[str], Sequence[str]]:
        """What the drivers of these parameters listen to."""
        heard: list[str] = []
        for name in params["drivers"]:
            with contextlib.suppress(DriverProblem):  # told when the node starts
                heard += find(name).topics
        return (), heard

    def setup(self) -> None:
        self.device = True  # what is read is not in the journal
        self.ledgers: dict[str, Ledger] = {}
        self.surfaces: dict[str, Device] = {}
        self.latches: dict[str, BoundPublisher[Device]] = {}
        self.dropped = 0
        self.why = ""
        self.told_at = 0
        self.running: list[Driver] = []
        names = list(dict.fromkeys(self.drivers))
        if not names:
            raise ParamProblem("drivers: none given; name at least one, like drivers:=tuio")
        for name in names:
            try:
                driver = find(name)(self)
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
        return getattr(self, name)

    def clock(self) -> int:
        return self.stage.clock.now()

    def listeners(self) -> int:
        return self.touch.subscribers() if self.stage.stack_is_up() else 0

    def frame(self, frame: Frame) -> None:
        if frame.device not in self.ledgers:
            self.connected(frame.device)
            if frame.device not in self.ledgers:
                return
        surface = self.surfaces[frame.device]
        if not surface.connected:
            surface.connected = True
            self._latch(frame.device, surface)
        live = frame.live
        if len(live) > MOST_CONTACTS // 2:
            self.garbage(f"{len(live)} contacts on {frame.device}, at most {MOST_CONTACTS // 2}")
            live = dict(list(live.items())[: MOST_CONTACTS // 2])
        contacts = self.ledgers[frame.device].frame(live, frame.ended)
        self.touch.publish(
            Touch(device=frame.device, size_m=surface.size_m, contacts=contacts, origin=frame.origin or self.clock())
        )

    def connected(
        self,
        device: str,
        *,
        size_m: tuple[float, float] | None = None,
        fields: list[str] | None = None,
        rate: float | None = None,
        note: str = "",
    ) -> None:
        if device not in self.ledgers:
            if len(self.ledgers) >= MOST_DEVICES:
                self.garbage(f"{device}: a device more than {MOST_DEVICES}; end some of the senders")
                return
            self.ledgers[device] = Ledger()
            self.log.info("%s: connected%s", device, f" ({note})" if note else "")
        driver = self.driver_of(device)
        self.surfaces[device] = Device(
            device=device,
            kind="touch",
            driver=driver,
            size_m=size_m,
            fields=fields or [],
            rate=rate,
            note=note[:1024],
        )
        self._latch(device, self.surfaces[device])

    def gone(self, device: str, note: str = "") -> None:
        surface = self.surfaces.get(device)
        if surface is None or not surface.connected:
            return
        contacts = self.ledgers[device].cancel()
        if contacts:
            self.touch.publish(Touch(device=device, size_m=surface.size_m, contacts=contacts, origin=self.clock()))
        surface.connected, surface.note = False, note[:1024]
        self._latch(device, surface)
        self.log.warning("%s: gone%s", device, f" ({note})" if note else "")

    def garbage(self, reason: str) -> None:
        self.dropped += 1
        self.why = reason[:200]

    def finished(self) -> None:
        if self.at_end == "stop" and len(self.running) == 1:
            self.stop()

    def driver_of(self, device: str) -> str:
        """The name of the driver that a device belongs to: the first part of its name."""
        head = device.partition("-")[0]
        return head if head in self.drivers else self.drivers[0]

    def _latch(self, device: str, message: Device) -> None:
        topic = "device/" + (re.sub(r"[^a-z0-9_]+", "_", device.lower()).strip("_") or "touch")
        if topic not in self.latches:
            self.latches[topic] = self.advertise(topic, Device)
        self.latches[topic].publish(message)
