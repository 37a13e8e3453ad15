"""The `web` driver: gamepads at the page, from the browsers' raw events."""

from bunraku.msgs import Event
from bunraku.runtime.driver import Driver, Silence


class WebDriver(Driver):
    """Reads topic ``web/events``; each page is a gamepad of its own."""

    name = "web"
    topics = ("web/events",)

    def open(self) -> None:
        self.seen: dict[str, tuple[int, int]] = {}
        """Page -> how many axes and buttons it has."""
        self.silence = Silence()
        self.host.listen("web/events", Event, self.on_event)

    def on_event(self, event: Event) -> None:
        """A sample, or the end of a page."""
        now = event.origin or self.host.clock()
        if event.kind == "gone":
            self.leave(event.device, now, "the page was closed")
        elif event.kind == "pad" and self.host.connected(
            event.device, driver="web", fields=["axes", "buttons"], rate=60.0
        ):
            self.seen[event.device] = (len(event.axes), len(event.buttons))
            self.silence.heard[event.device] = self.host.clock()
            self.host.say(event.device, event.axes, event.buttons, now)

    def leave(self, device: str, now: int, note: str) -> None:
        """A gamepad is there no more: its sticks and buttons are at rest, said once."""
        held = self.seen.pop(device, None)
        self.silence.heard.pop(device, None)
        if held is not None:
            self.host.say(device, [0.0] * held[0], [False] * held[1], now)
            self.host.gone(device, note)

    def keep(self, now: int) -> None:
        """A page tells its gamepad four times a second: silence means that nobody holds it."""
        for device in self.silence.late(now, self.host.option("lost")):
            self.leave(device, now, "the page is silent")
