"""The `web` driver: the page's sliders and selection plane, in normalised units -1..1."""

from bunraku.msgs import Event
from bunraku.runtime.driver import Driver, Silence


class WebDriver(Driver):
    """Reads topic ``web/events``; each page is a pair of hands of its own."""

    name = "web"
    topics = ("web/events",)

    def open(self) -> None:
        self.seen = Silence()
        """Of pages whose hands are seen."""
        self.host.listen("web/events", Event, self.on_event)

    def on_event(self, event: Event) -> None:
        """A sample of both hands, or the end of a page."""
        now = event.origin or self.host.clock()
        if event.kind == "gone":
            self.leave(event.device, now, "the page was closed")
        elif event.kind == "hands" and self.host.connected(
            event.device, driver="web", fields=["position", "bend"], rate=60.0, bend_unit="normalised"
        ):
            self.seen.heard[event.device] = self.host.clock()
            self.host.say(event.device, event.left, event.right, now)

    def leave(self, device: str, now: int, note: str) -> None:
        """The hands are not seen any more: said once."""
        if self.seen.heard.pop(device, None) is not None:
            self.host.say(device, None, None, now)
            self.host.gone(device, note)

    def keep(self, now: int) -> None:
        """While hands are played the page tells them four times a second."""
        for device in self.seen.late(now, self.host.option("lost")):
            self.leave(device, now, "the page is silent")
