"""What stands or moves in a figure's way: read from a file or heard, drawn, and gone round.

After the reactions that Oshita 2005 looks forward to (section 8).
"""

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, isfinite, pi
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bunraku.msgs import Primitive

Array = NDArray[np.float64]
BODY = 0.38
"""m from a walking figure's middle to what it keeps clear: half its shoulders, the arms' swing and a margin."""
NOTICE = 4.0
"""m of path ahead of the figure in which obstacles are minded."""
FORESEEN = 2.0
"""s ahead for which something that moves is taken to go on as it does."""
KNOWN = 4.0
"""s ahead for which the way of an obstacle of a file, which comes again and again, is known."""
CROSSING = 0.35
"""m/s across the path from which something is given time to pass instead of being gone round."""
PACES = (1.0, 0.85, 1.15, 0.7, 1.35, 0.5, 1.6, 0.3, 0.12, 0.02)
"""Shares of the speed that are tried, so that what crosses the path has passed, or not yet come."""
HOME = 0.6
"""m before a path's end in which a bulge goes back to it."""
CARE = 0.7
"""Share of the speed that is kept beside an obstacle."""
MOST = 64
COLOR = (0.80, 0.32, 0.26, 0.9)


class ObstacleError(ValueError):
    """A file of obstacles that cannot be used; one line."""


@dataclass(frozen=True)
class Obstacle:
    """A round thing on the ground, now."""

    name: str
    x: float
    z: float
    radius: float
    vx: float = 0.0  # m/s
    vz: float = 0.0
    way: "Placed | None" = None
    """Where its motion is known beforehand."""
    time: float = 0.0  # s

    @property
    def foreseen(self) -> float:
        """s ahead that `after` can be relied on."""
        moves = self.vx or self.vz
        return (FORESEEN if self.way is None else KNOWN) if moves else float("inf")

    def after(self, seconds: Array) -> Array:
        """Where it will be (n, 2; m) in some (n) s."""
        if self.way is not None:
            return np.array([(one.x, one.z) for one in (self.way.now(self.time + dt) for dt in seconds.tolist())])
        return np.asarray(np.array([self.x, self.z]) + seconds[:, None] * np.array([self.vx, self.vz]))


@dataclass(frozen=True)
class Placed:
    """An obstacle of a file: it stands, or goes to and fro between two places."""

    name: str
    at: tuple[float, float]
    radius: float
    to: tuple[float, float] | None = None
    seconds: float = 4.0
    """s of one way."""

    def now(self, time: float) -> Obstacle:
        """Where it is at ``time`` s."""
        if self.to is None:
            return Obstacle(self.name, *self.at, self.radius)
        phase = (time / self.seconds) % 2.0
        share, sign = (phase, 1.0) if phase < 1.0 else (2.0 - phase, -1.0)
        dx, dz = self.to[0] - self.at[0], self.to[1] - self.at[1]
        speed = sign / self.seconds
        return Obstacle(
            self.name, self.at[0] + share * dx, self.at[1] + share * dz, self.radius, speed * dx, speed * dz, self, time
        )  # fmt: skip


class Heard:
    """Obstacles that another node draws, as circles in the world; their speed is seen from one drawing to the next."""

    def __init__(self) -> None:
        self.obstacles: tuple[Obstacle, ...] = ()
        self._at = 0.0

    def take(self, primitives: Sequence[Primitive], now: float) -> None:
        """What is drawn at ``now`` s; circles are told apart by label, or by their order."""
        before = {one.name: one for one in self.obstacles}
        dt = now - self._at
        out = []
        for number, one in enumerate(primitives[:MOST]):
            if one.kind != "circle" or one.space != "world" or not one.points or len(one.points[0]) < 3:
                continue
            x, z = float(one.points[0][0]), float(one.points[0][2])
            name = f"heard {one.label or number}"
            last = before.get(name)
            vx, vz = 0.0, 0.0
            if last is not None and 0.0 < dt < 1.0:
                vx, vz = 0.5 * (last.vx + (x - last.x) / dt), 0.5 * (last.vz + (z - last.z) / dt)
            out.append(Obstacle(name, x, z, min(float(one.size), 5.0), vx, vz))
        self.obstacles, self._at = tuple(out), now


def load(path: str) -> tuple[Placed, ...]:
    """Obstacles of a TOML file, lengths in m on the ground; raises `ObstacleError`.

    [[obstacle]]
    at = [0.0, 3.0]        # x, z
    radius = 0.4
    to = [2.0, 3.0]        # optional: goes to and fro
    seconds = 4.0          # for one way
    """
    try:
        data = tomllib.loads(Path(path).read_text("utf-8"))
    except OSError as error:
        raise ObstacleError(f"obstacles: {path}: cannot be read ({error.strerror}); give the path of a .toml") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ObstacleError(f"obstacles: {path}: is not TOML ({error})") from None
    written = data.get("obstacle")
    if not isinstance(written, list) or not 0 < len(written) <= MOST:
        raise ObstacleError(f"obstacles: {path}: write 1 to {MOST} [[obstacle]] tables")
    out = []
    for number, one in enumerate(written, 1):
        try:
            out.append(_placed(f"{number}", one))
        except (TypeError, ValueError) as error:
            raise ObstacleError(f"obstacles: {path}: obstacle {number}: {error}") from None
    return tuple(out)


def _placed(name: str, one: dict[str, Any]) -> Placed:
    unknown = sorted(set(one) - {"at", "to", "radius", "seconds"})
    if unknown:
        raise ValueError(f"unknown key {unknown[0]!r} (has: at, radius, seconds, to)")
    if "at" not in one:
        raise ValueError("at = [x, z] is missing")
    radius, seconds = float(one.get("radius", 0.3)), float(one.get("seconds", 4.0))
    if not 0.02 <= radius <= 5.0 or not 0.1 <= seconds <= 3600.0:
        raise ValueError("radius is 0.02..5 m and seconds 0.1..3600 s")
    to = one.get("to")
    return Placed(name, _spot("at", one["at"]), radius, None if to is None else _spot("to", to), seconds)


def _spot(key: str, given: Any) -> tuple[float, float]:
    if isinstance(given, list) and len(given) == 2 and all(isinstance(v, int | float) for v in given):
        x, z = float(given[0]), float(given[1])
        if isfinite(x) and isfinite(z) and hypot(x, z) < 1e4:
            return x, z
    raise ValueError(f"{key} is [x, z] in m")


def shown(obstacles: Sequence[Obstacle], height: float) -> list[Primitive]:
    """Rings on the ground."""
    return [
        Primitive(kind="circle", space="world", points=[(one.x, height, one.z)], color=COLOR, size=one.radius)
        for one in obstacles
    ]


def detour(
    places: Array, ahead: Array, eta: Array, obstacles: Sequence[Obstacle], sides: dict[str, int]
) -> tuple[Array, Array]:
    """A path round what is in its way, and the share of the speed to keep along it.

    Args:
        places: (n, 2) m, x and z. ahead: (n,) m of path from the figure, negative behind it.
        eta: (n,) s until the figure is there. sides: kept from call to call, so that a side once chosen is passed.

    What moves is given time to pass, by the share of `PACES` nearest to 1 that keeps the figure clear of it. Where a
    point is still nearer to an obstacle than its radius and the body's, when the figure will be there, the path bulges
    sideways by what is missing, except for what crosses it. The bulge is as long as it has to be for the widest place.
    """
    out, free = np.array(places), np.ones(len(places))
    moving = [one for one in obstacles if one.vx or one.vz]
    if moving:
        free *= _pace(places, ahead, eta, moving)
        eta = eta / float(free[0])
    for _ in range(3):
        moved = False
        for one in obstacles:
            off, minded = _beside(out, ahead, eta, one)
            away = np.hypot(off[:, 0], off[:, 1])
            clear = one.radius + BODY
            if not minded.any() or float(away[minded].min()) >= clear - 1e-3:
                if not minded.any() or float(away[minded].min()) > clear + 1.0:
                    sides.pop(one.name, None)
                continue
            k = int(np.argmin(np.where(minded, away, np.inf)))
            left = _left(out, k)
            beside = float(off[k] @ left)
            if _crosses(one, left):
                continue
            side = sides.setdefault(one.name, 1 if beside >= 0.0 else -1)
            lack = clear - side * beside
            half = max(2.2 * clear, 2.5 * lack)
            share = np.abs(ahead - ahead[k]) / half
            bulge = np.where(share < 1.0, 0.5 + 0.5 * np.cos(pi * np.minimum(share, 1.0)), 0.0) * (ahead > 0.0)
            if away[-1] >= clear:  # the end stays where it was drawn
                bulge = bulge * np.clip((ahead[-1] - ahead) / HOME, 0.0, 1.0)
            out += bulge[:, None] * (side * lack) * left
            free = np.minimum(free, 1.0 - (1.0 - CARE) * bulge)
            moved = True
        if not moved:
            break
    return out, free


def _beside(places: Array, ahead: Array, eta: Array, one: Obstacle) -> tuple[Array, NDArray[np.bool_]]:
    """Each place from where an obstacle will be then (n, 2; m), and which places are minded."""
    minded = (ahead > 0.0) & (ahead < NOTICE) & (eta < one.foreseen)
    off = np.full_like(places, np.inf)
    off[minded] = places[minded] - one.after(eta[minded])
    return off, minded


def _left(places: Array, k: int) -> Array:
    """The direction to the left of a path at one of its points."""
    way = places[min(k + 2, len(places) - 1)] - places[max(k - 2, 0)]
    way = way / max(float(np.hypot(*way)), 1e-9)
    return np.array([way[1], -way[0]])


def _crosses(one: Obstacle, left: Array) -> bool:
    return abs(float(np.array([one.vx, one.vz]) @ left)) > CROSSING


def _pace(places: Array, ahead: Array, eta: Array, moving: Sequence[Obstacle]) -> float:
    best, widest = 1.0, -np.inf
    for pace in PACES:
        room = np.inf
        for one in moving:
            off, minded = _beside(places, ahead, eta / pace, one)
            away = np.hypot(off[:, 0], off[:, 1])
            k = int(np.argmin(away))
            if minded.any() and _crosses(one, _left(places, k)):
                room = min(room, float(away[k]) - one.radius - BODY)
        if room >= 0.0:
            return pace
        if room > widest + 0.05:
            best, widest = pace, room
    return best


__all__ = ["BODY", "Heard", "Obstacle", "ObstacleError", "Placed", "detour", "load", "shown"]
