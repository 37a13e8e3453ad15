"""The `script` driver: a pen's performance, played at a steady rate once the listeners are there."""

from pathlib import Path

from bunraku.msgs import Pen
from bunraku.nodes.input_pen.performance import PerformanceError, load
from bunraku.runtime.driver import DriverProblem, PerformanceDriver


class ScriptDriver(PerformanceDriver):
    """Plays the file of parameter `script`."""

    name = "script"

    def load(self) -> None:
        file = self.host.option("script")
        if not file:
            raise DriverProblem("script: no performance; give parameter script the path of a .pen file")
        try:
            self.performance = load(file)
        except PerformanceError as error:
            raise DriverProblem(str(error)) from None
        self.device = f"script-{Path(file).stem}"
        self.before: Pen | None = None
        self.host.connected(
            self.device, driver="script", size_m=self.performance.size_m, fields=["pressure", "altitude", "azimuth"],
            rate=float(self.host.option("rate")), note=self.performance.title,
        )  # fmt: skip

    def length(self) -> float:
        return self.performance.length

    def say(self, t: float, now: int) -> None:
        moment = self.performance.at(t) if t < self.length() else None
        if moment is not None:
            self.before = Pen(
                device=self.device, size_m=self.performance.size_m, in_range=True, contact=moment.contact,
                x=moment.x, y=moment.y, pressure=moment.pressure, altitude=moment.altitude, azimuth=moment.azimuth,
                buttons=int(moment.contact), origin=now,
            )  # fmt: skip
            self.host.say(self.before)
        elif self.before is not None:
            last, self.before = self.before, None
            gone = Pen(
                device=self.device, size_m=last.size_m, in_range=False, contact=False, x=last.x, y=last.y,
                altitude=last.altitude, azimuth=last.azimuth, origin=now,
            )  # fmt: skip
            self.host.say(gone)
