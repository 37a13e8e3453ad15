"""The node: hosts pen drivers and says each of their samples."""

from collections.abc import Mapping
from typing import ClassVar, Literal

from bunraku.msgs import Pen
from bunraku.runtime.driver import DriverHost
from bunraku.runtime.node import Publisher, param


class InputPen(DriverHost):
    """What a pen does, from the page, a tablet or a written performance."""

    name = "input_pen"
    kind: ClassVar[Literal["touch", "pen", "hand", "pad"]] = "pen"
    says = "pen"
    built_in: ClassVar[Mapping[str, str]] = {
        "evdev": "bunraku.nodes.input_pen.evdev:EvdevDriver",
        "hid": "bunraku.nodes.input_pen.hid:HidDriver",
        "script": "bunraku.nodes.input_pen.script:ScriptDriver",
        "web": "bunraku.nodes.input_pen.web:WebDriver",
    }
    pen: Publisher[Pen] = Publisher("pen", Pen)
    evdev: str = param("", doc="path of the tablet for driver evdev (/dev/input/event5); empty takes the first one")
    hid: str = param("", doc="the tablet for driver hid: a path or VENDOR:PRODUCT in hex; empty takes the first one")
    lost: float = param(1.5, low=0.3, high=60.0, doc="s of silence after which a pen that touches is taken away")

    def say(self, sample: Pen) -> None:
        """Hand over one sample."""
        self.pen.publish(sample)
