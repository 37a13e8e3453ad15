"""The `web` driver: fingers on the page, from the browsers' raw events."""

from bunraku.msgs import Event
from bunraku.nodes.input_touch.frame import Ending, Frame, Sample
from bunraku.runtime.driver import Driver, Silence


class WebDriver(Driver):
    """Reads topic ``web/events``; each page is a device of its own."""

    name = "web"
    topics = ("web/events",)

    def open(self) -> None:
        self.held = Silence()
        """Of pages on which fingers are down."""
        self.down: dict[str, set[int]] = {}
        """Page -> its fingers that are down."""
        self.over: dict[str, set[int]] = {}
        """Page -> fingers that its silence took away: they do nothing until they are put down again, for by now
        another part may be under them."""
        self.host.listen("web/events", Event, self.on_event)

    def on_event(self, event: Event) -> None:
        """A frame of touches, or the end of a page."""
        if event.kind == "gone":
            for kept in (self.held.heard, self.down, self.over):
                kept.pop(event.device, None)
            self.host.gone(event.device, "the page was closed")
            return
        if event.kind != "touch":
            return
        fields = ["major", "minor", "angle", "pressure"]
        if not self.host.connected(event.device, driver="web", size_m=event.size_m, fields=fields, rate=60.0):
            return
        live: dict[int, Sample] = {}
        ended: dict[int, Ending] = {}
        over = self.over.pop(event.device, set())
        left = {one.id for one in event.contacts if one.phase == "move"} & over
        if left:
            self.over[event.device] = left
        for one in event.contacts:
            if one.phase == "up" or one.phase == "cancel":
                ended[one.id] = one.phase
            elif one.id not in left:
                live[one.id] = Sample(one.x, one.y, one.major, one.minor, one.angle, one.pressure)
        self.down[event.device] = set(live)
        now = event.origin or self.host.clock()
        self.held.heard.pop(event.device, None)
        if live:
            self.held.heard[event.device] = self.host.clock()
        self.host.frame(Frame(event.device, live, now, ended))

    def keep(self, now: int) -> None:
        """A page tells the fingers that are down four times a second: silence means that nobody holds the figure."""
        for device in self.held.late(now, self.host.option("silent")):
            del self.held.heard[device]
            self.over[device] = self.over.get(device, set()) | self.down.pop(device, set())
            self.host.gone(device, "the page is silent")
