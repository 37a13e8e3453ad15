"""The `script` driver: a performance of the hands, played at a steady rate once the listeners are there."""

from pathlib import Path

from bunraku.nodes.input_hand.performance import PerformanceError, load
from bunraku.runtime.driver import DriverProblem, PerformanceDriver


class ScriptDriver(PerformanceDriver):
    """Plays the file of parameter `script`."""

    name = "script"

    def load(self) -> None:
        file = self.host.option("script")
        if not file:
            raise DriverProblem("script: no performance; give parameter script the path of a .hands file")
        try:
            self.performance = load(file)
        except PerformanceError as error:
            raise DriverProblem(str(error)) from None
        self.device = f"script-{Path(file).stem}"
        self.host.connected(
            self.device, driver="script", fields=["position", "bend"], rate=float(self.host.option("rate")),
            bend_unit=self.performance.unit, note=self.performance.title,
        )  # fmt: skip

    def length(self) -> float:
        return self.performance.length

    def say(self, t: float, now: int) -> None:
        if t >= self.length():
            self.host.say(self.device, None, None, now)
            return
        self.host.say(self.device, self.performance.hand("left", t), self.performance.hand("right", t), now)
