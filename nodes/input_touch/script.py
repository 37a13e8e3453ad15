"""The `script` driver: a performance file played at a steady rate, once the listeners are there."""

from pathlib import Path

from bunraku.nodes.input_touch.driver import Driver, DriverProblem, Frame, Sample
from bunraku.nodes.input_touch.performance import Performance, PerformanceError, load

SECOND = 1_000_000_000


class Player:
    """A performance sampled at rising times; says each frame that has something to say."""

    def __init__(self, performance: Performance) -> None:
        self.performance = performance
        self.before: dict[int, Sample] = {}

    def frame(self, t: float) -> dict[int, Sample] | None:
        """The live fingers at ``t`` s; None when none is live and none has just left."""
        live = self.performance.live(t)
        said = live if live or self.before else None
        self.before = live
        return said

    def over(self, t: float) -> bool:
        """Whether everything was said."""
        return t >= self.performance.length and not self.before


class ScriptDriver(Driver):
    """Plays the file of parameter `script`; waits for `wait_for` listeners, then `delay` s."""

    name = "script"
    sampled = True

    def open(self) -> None:
        file = self.host.option("script")
        if not file:
            raise DriverProblem("script: no performance; give parameter script the path of a .touch file")
        try:
            self.performance = load(file)
        except PerformanceError as error:
            raise DriverProblem(str(error)) from None
        self.device = f"script-{Path(file).stem}"
        self.started: int | None = None
        self.done = False
        self.player = Player(self.performance)
        fields = []
        if any(one.pressure for one in self.performance.strokes):
            fields.append("pressure")
        if any(one.ellipse for one in self.performance.strokes):
            fields += ["major", "minor", "angle"]
        self.host.connected(
            self.device, rate=float(self.host.option("rate")), fields=fields, note=self.performance.title
        )

    def sample(self, now: int) -> None:
        if self.done:
            return
        if self.started is None:
            wanted = listeners_wanted(self.host.option("wait_for"))
            if self.host.listeners() < wanted:
                return
            self.started = now + round(self.host.option("delay") * SECOND)
            self.host.log.info("plays %s, %.1f s", self.performance.title, self.performance.length)
        t = (now - self.started) / SECOND
        if t < 0.0:
            return
        live = self.player.frame(t)
        if live is not None:
            self.host.frame(Frame(self.device, live, now, self.performance.ended()))
        if self.player.over(t):
            if self.host.option("at_end") == "loop":
                self.started = now + round(self.host.option("pause") * SECOND)
                return
            self.done = True
            self.host.finished()


def listeners_wanted(text: str) -> int:
    """How many listeners a `wait_for` means: a number, or names with commas between them."""
    text = text.strip()
    if text.isdigit():
        return int(text)
    return len([name for name in text.split(",") if name.strip()])
