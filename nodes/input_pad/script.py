"""The `script` driver: a gamepad's performance, played at a steady rate once the listeners are there."""

from pathlib import Path

from bunraku.nodes.input_pad.performance import BUTTONS, PerformanceError, load
from bunraku.runtime.driver import DriverProblem, PerformanceDriver


class ScriptDriver(PerformanceDriver):
    """Plays the file of parameter `script`."""

    name = "script"

    def load(self) -> None:
        file = self.host.option("script")
        if not file:
            raise DriverProblem("script: no performance; give parameter script the path of a .pad file")
        try:
            self.performance = load(file)
        except PerformanceError as error:
            raise DriverProblem(str(error)) from None
        self.device = f"script-{Path(file).stem}"
        self.host.connected(
            self.device, driver="script", fields=["axes", "buttons"], rate=float(self.host.option("rate")),
            note=self.performance.title,
        )  # fmt: skip

    def length(self) -> float:
        return self.performance.length

    def say(self, t: float, now: int) -> None:
        axes, buttons = self.performance.at(t) if t < self.length() else ([0.0] * 4, [False] * BUTTONS)
        self.host.say(self.device, axes, buttons, now)
