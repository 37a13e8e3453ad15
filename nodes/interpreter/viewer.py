"""The camera by touch: one finger orbits, two pinch to zoom; it follows a figure that walks off."""

from dataclasses import dataclass, replace
from math import exp, hypot, pi

import numpy as np

from bunraku.figure.camera import Orbit, project, ray, wrap
from bunraku.msgs import Camera


@dataclass(frozen=True)
class ViewRules:
    """How the camera moves."""

    turn: float = pi  # rad for a swipe of one picture height
    lowest: float = -0.15  # rad below the horizon
    highest: float = 1.45  # rad above it: never past the zenith
    nearest: float = 0.8  # m
    farthest: float = 20.0  # m
    slack: float = 0.5  # m that the figure may walk from the middle before the camera follows
    lag: float = 0.35  # s, time constant of following
    least_pinch: float = 0.02  # share of the picture's height: nearer fingers give no ratio
    margin: float = 0.12  # share of the picture, from its edge, that a path's end keeps free
    scroll: float = 1.5  # m/s at most, where the picture moves under a pen that draws on it


class Viewer:
    """An orbit and what fingers do with it."""

    def __init__(self, home: Orbit | None = None, rules: ViewRules | None = None) -> None:
        self.home = home or Orbit()
        self.rules = rules or ViewRules()
        self.orbit = self.home
        self.said: Orbit | None = None

    def reset(self) -> None:
        """The view as it was at first."""
        self.orbit = replace(self.home, center=self.orbit.center)

    def swipe(self, dx: float, dy: float) -> None:
        """One finger moved by shares of the picture: the figure seems to turn with it."""
        azimuth = wrap(self.orbit.azimuth - dx * self.orbit.aspect * self.rules.turn)
        elevation = self.orbit.elevation + dy * self.rules.turn
        self.orbit = replace(
            self.orbit, azimuth=azimuth, elevation=min(self.rules.highest, max(self.rules.lowest, elevation))
        )

    def pinch(self, before: float, after: float) -> None:
        """Two fingers' distance went from ``before`` to ``after`` (shares of the picture's height)."""
        least = self.rules.least_pinch
        distance = self.orbit.distance * max(before, least) / max(after, least)
        self.orbit = replace(self.orbit, distance=min(self.rules.farthest, max(self.rules.nearest, distance)))

    def follow(self, x: float, z: float, dt: float) -> None:
        """Keep a figure that stands at (x, z) m near the middle of the picture."""
        cx, cy, cz = self.orbit.center
        dx, dz = x - cx, z - cz
        away = (dx * dx + dz * dz) ** 0.5
        if away <= self.rules.slack:
            return
        share = (1.0 - self.rules.slack / away) * (1.0 - exp(-dt / self.rules.lag))
        self.orbit = replace(self.orbit, center=(cx + dx * share, cy, cz + dz * share))

    def keep(self, x: float, z: float, dt: float, *, jump: bool = True) -> None:
        """Move along the ground so that the place (x, z) m stays within the picture's margin; never turn.

        Without ``jump`` at most `ViewRules.scroll`: the place then moves on under a pen that stays where it is.
        """
        view = self.camera()
        at = project(view, np.array([x, 0.0, z]))
        free = self.rules.margin
        inside = np.clip(at, free, 1.0 - free)
        if np.array_equal(at, inside) or not np.isfinite(at).all():
            return
        origin, direction = ray(view, float(inside[0]), float(inside[1]))
        if direction[1] > -1e-3:
            return
        t = -origin[1] / direction[1]
        dx, dz = x - float(origin[0] + t * direction[0]), z - float(origin[2] + t * direction[2])
        if not jump:
            share = min(1.0, self.rules.scroll * dt / max(hypot(dx, dz), 1e-9))
            dx, dz = dx * share, dz * share
        cx, cy, cz = self.orbit.center
        self.orbit = replace(self.orbit, center=(cx + dx, cy, cz + dz))

    def camera(self) -> Camera:
        """The camera message of the view."""
        return self.orbit.camera()

    def news(self) -> Camera | None:
        """The camera, where it is another than at the last call."""
        if self.orbit == self.said:
            return None
        self.said = self.orbit
        return self.camera()
