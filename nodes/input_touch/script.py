"""The `script` driver: a performance file played at a steady rate, once the listeners are there."""

from pathlib import Path

from bunraku.nodes.input_touch.frame import Frame, Sample
from bunraku.nodes.input_touch.performance import Performance, PerformanceError, load
from bunraku.runtime.driver import DriverProblem, PerformanceDriver


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


class ScriptDriver(PerformanceDriver):
    """Plays the file of parameter `script`."""

    name = "script"

    def load(self) -> None:
        file = self.host.option("script")
        if not file:
            raise DriverProblem("script: no performance; give parameter script the path of a .touch file")
        try:
            self.performance = load(file)
        except PerformanceError as error:
            raise DriverProblem(str(error)) from None
        self.device = f"script-{Path(file).stem}"
        self.player = Player(self.performance)
        fields = []
        if any(one.pressure for one in self.performance.strokes):
            fields.append("pressure")
        if any(one.ellipse for one in self.performance.strokes):
            fields += ["major", "minor", "angle"]
        self.host.connected(
            self.device, driver="script", rate=float(self.host.option("rate")), fields=fields,
            note=self.performance.title,
        )  # fmt: skip

    def length(self) -> float:
        return self.performance.length

    def say(self, t: float, now: int) -> None:
        live = self.player.frame(t)
        if live is not None:
            self.host.frame(Frame(self.device, live, now, self.performance.ended()))
