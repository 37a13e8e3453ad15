"""The `web` driver: fingers on the page, from the browsers' raw events."""

from bunraku.msgs import Event
from bunraku.nodes.input_touch.driver import Driver, Ending, Frame, Sample


class WebDriver(Driver):
    """Reads topic ``web/events``; each page is a device of its own."""

    name = "web"

    def open(self) -> None:
        self.pages: set[str] = set()
        self.host.listen("web/events", Event, self.on_event)

    def on_event(self, event: Event) -> None:
        """A frame of touches, or the end of a page."""
        if event.kind == "gone":
            if event.device in self.pages:
                self.host.gone(event.device, "the page was closed")
            return
        if event.kind != "touch":
            return
        if event.device not in self.pages:
            self.pages.add(event.device)
            self.host.connected(
                event.device, size_m=event.size_m, fields=["major", "minor", "angle", "pressure"], rate=60.0
            )
        live: dict[int, Sample] = {}
        ended: dict[int, Ending] = {}
        for one in event.contacts:
            if one.phase == "up" or one.phase == "cancel":
                ended[one.id] = one.phase
            else:
                live[one.id] = Sample(one.x, one.y, one.major, one.minor, one.angle, one.pressure)
        self.host.frame(Frame(event.device, live, event.origin or self.host.clock(), ended))
