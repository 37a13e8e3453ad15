"""The `web` driver: pens on the page, every coalesced sample, from the browsers' raw events."""

from bunraku.msgs import Event, Pen, PenSample
from bunraku.runtime.driver import Driver, Silence

LATE = 1_000_000_000
"""ns: samples of one frame are never taken for older than this."""


class WebDriver(Driver):
    """Reads topic ``web/events``; each page is a pen of its own."""

    name = "web"
    topics = ("web/events",)

    def open(self) -> None:
        self.last: dict[str, Pen] = {}
        """Page -> its last sample, while it is in range."""
        self.touching = Silence()
        """Of pages whose pen touches."""
        self.over: set[str] = set()
        """Pages whose silence took the pen away: it draws nothing until it is lifted and put down again."""
        self.host.listen("web/events", Event, self.on_event)

    def on_event(self, event: Event) -> None:
        """The samples of a frame, or the end of a page."""
        if event.kind == "gone":
            self.over.discard(event.device)
            self.leave(event.device, event.origin or self.host.clock())
            self.host.gone(event.device, "the page was closed")
        elif event.kind == "pen" and event.pen:
            fields = ["pressure", "altitude", "azimuth"]
            if any(one.twist is not None for one in event.pen):
                fields.append("twist")
            if not self.host.connected(event.device, driver="web", size_m=event.size_m, fields=fields, rate=60.0):
                return
            now = event.origin or self.host.clock()
            newest = event.pen[-1].time
            for one in event.pen:
                if one.contact and event.device in self.over:
                    continue
                self.over.discard(event.device)
                age = min(max(0, round((newest - one.time) * 1e6)), LATE)  # both on the page's clock, ms
                self.say(message(event, one, now - age), now)

    def say(self, sample: Pen, now: int) -> None:
        """One sample; what leaves the range is forgotten."""
        self.touching.heard.pop(sample.device, None)
        if sample.contact:
            self.touching.heard[sample.device] = self.host.clock()
        if sample.in_range:
            self.last[sample.device] = sample
        else:
            self.last.pop(sample.device, None)
        self.host.say(sample)

    def leave(self, device: str, now: int) -> None:
        """A pen that was in range is there no more."""
        held = self.last.get(device)
        if held is not None:
            self.say(out_of_range(held, now), now)

    def keep(self, now: int) -> None:
        """A page tells a pen that touches four times a second: silence means that nobody holds it."""
        for device in self.touching.late(now, self.host.option("lost")):
            self.over.add(device)
            self.leave(device, now)
            self.host.gone(device, "the page is silent")


def message(event: Event, one: PenSample, origin: int) -> Pen:
    """A page's sample as a `pen` message."""
    return Pen(
        device=event.device, size_m=event.size_m, in_range=one.in_range, contact=one.contact, x=one.x, y=one.y,
        pressure=one.pressure, altitude=one.altitude, azimuth=one.azimuth, twist=one.twist, buttons=one.buttons,
        eraser=one.eraser, origin=origin,
    )  # fmt: skip


def out_of_range(last: Pen, origin: int) -> Pen:
    """The sample that says that a pen has left."""
    return Pen(
        device=last.device, size_m=last.size_m, in_range=False, contact=False, x=last.x, y=last.y,
        altitude=last.altitude, azimuth=last.azimuth, origin=origin,
    )  # fmt: skip
