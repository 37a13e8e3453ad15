"""The node: hosts touch drivers, and keeps the rules of the `touch` topic for all of them."""

from collections.abc import Mapping
from typing import ClassVar

from bunraku.msgs import Touch
from bunraku.nodes.input_touch.frame import Frame, Ledger
from bunraku.runtime.driver import DriverHost
from bunraku.runtime.node import Publisher, param

MOST_CONTACTS = 64  # of the touch message


class InputTouch(DriverHost):
    """What fingers do on touch surfaces, from TUIO, Linux, the page or a written performance."""

    name = "input_touch"
    kind = "touch"
    says = "touch"
    built_in: ClassVar[Mapping[str, str]] = {
        "evdev": "bunraku.nodes.input_touch.evdev:EvdevDriver",
        "script": "bunraku.nodes.input_touch.script:ScriptDriver",
        "tuio": "bunraku.nodes.input_touch.tuio_driver:TuioDriver",
        "web": "bunraku.nodes.input_touch.web:WebDriver",
    }
    touch: Publisher[Touch] = Publisher("touch", Touch)
    drivers: list[str] = param(["script"], doc="which drivers run: script, tuio, evdev, web, or a package's own")
    host: str = param("127.0.0.1", doc="address that driver tuio listens on; 0.0.0.0 lets other machines send")
    port: int = param(3333, low=0, high=65535, doc="UDP port of driver tuio; 0 takes a free one")
    merge: float = param(0.002, low=0.0, high=0.02, doc="s that driver tuio waits for the rest of a split frame")
    lost: float = param(2.0, low=0.1, high=3600.0, doc="s of silence after which a TUIO source is gone")
    silent: float = param(1.5, low=0.3, high=60.0, doc="s of silence after which a page's fingers are taken away")
    size_m: list[float] = param([], doc="width and height of the TUIO surface in m, where its ellipses shall be known")
    evdev: str = param("", doc="path of the touch device for driver evdev; empty takes the first touch screen")

    def setup(self) -> None:
        self.ledgers: dict[str, Ledger] = {}
        super().setup()

    # What drivers use

    def frame(self, frame: Frame) -> None:
        """Hand over all fingers of a device that is connected."""
        surface = self.surfaces.get(frame.device)
        if surface is None:  # one too many
            return
        if not surface.connected:
            surface.connected = True
            self.latch(surface)
        live = frame.live
        if len(live) > MOST_CONTACTS // 2:
            self.garbage(f"{len(live)} contacts on {frame.device}, at most {MOST_CONTACTS // 2}")
            live = dict(list(live.items())[: MOST_CONTACTS // 2])
        contacts = self.ledgers.setdefault(frame.device, Ledger()).frame(live, frame.ended)
        self.touch.publish(
            Touch(device=frame.device, size_m=surface.size_m, contacts=contacts, origin=frame.origin or self.clock())
        )

    def gone(self, device: str, note: str = "") -> None:
        """A device went; its contacts are cancelled."""
        surface = self.surfaces.get(device)
        contacts = self.ledgers[device].cancel() if surface and surface.connected and device in self.ledgers else []
        if surface and contacts:
            self.touch.publish(Touch(device=device, size_m=surface.size_m, contacts=contacts, origin=self.clock()))
        super().gone(device, note)
