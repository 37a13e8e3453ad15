"""The node: hosts hand drivers and says their samples."""

from collections.abc import Mapping
from typing import ClassVar, Literal

from bunraku.msgs import Hand, Hands
from bunraku.runtime.driver import DriverHost
from bunraku.runtime.node import Publisher, param


class InputHand(DriverHost):
    """What the hands do, from the page's sliders or a written performance."""

    name = "input_hand"
    kind: ClassVar[Literal["touch", "pen", "hand", "pad"]] = "hand"
    says = "hands"
    built_in: ClassVar[Mapping[str, str]] = {
        "script": "bunraku.nodes.input_hand.script:ScriptDriver",
        "web": "bunraku.nodes.input_hand.web:WebDriver",
    }
    hands: Publisher[Hands] = Publisher("hands", Hands)
    lost: float = param(1.5, low=0.3, high=60.0, doc="s of silence after which a device's hands are not seen")

    def say(self, device: str, left: Hand | None, right: Hand | None, origin: int) -> None:
        """Hand over one sample of both hands."""
        self.hands.publish(Hands(device=device, left=left, right=right, origin=origin))
