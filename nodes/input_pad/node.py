"""The node: hosts gamepad drivers and says each of their samples."""

from collections.abc import Mapping
from typing import ClassVar, Literal

from bunraku.msgs import Pad
from bunraku.runtime.driver import DriverHost
from bunraku.runtime.node import Publisher, param


class InputPad(DriverHost):
    """What a gamepad does, from the page, from Linux or from a written performance."""

    name = "input_pad"
    kind: ClassVar[Literal["touch", "pen", "hand", "pad"]] = "pad"
    says = "pad"
    built_in: ClassVar[Mapping[str, str]] = {
        "evdev": "bunraku.nodes.input_pad.evdev:EvdevDriver",
        "script": "bunraku.nodes.input_pad.script:ScriptDriver",
        "web": "bunraku.nodes.input_pad.web:WebDriver",
    }
    pad: Publisher[Pad] = Publisher("pad", Pad)
    lost: float = param(1.5, low=0.3, high=60.0, doc="s of silence after which a page's gamepad is taken away")
    evdev: str = param("", doc="path of the gamepad for driver evdev; empty takes the first one")

    def say(self, device: str, axes: list[float], buttons: list[bool], origin: int) -> None:
        """Hand over one sample, in the order of the standard gamepad of browsers: axes right and down."""
        self.pad.publish(Pad(device=device, axes=axes, buttons=buttons, origin=origin))
