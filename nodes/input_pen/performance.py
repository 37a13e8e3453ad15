"""A pen's performance: strokes written down in a small TOML file.

    title = "A walk"

    [[stroke]]
    start = 0.5                              # s
    ground = [[0.0, 0.0, 0.3], [2.0, 1.5, 1.0]]   # [s since the start, x, z] m, seen by the default camera
    # path = [[0.0, 0.4, 0.8], [2.0, 0.7, 0.7]]   # or [s since the start, x, y] shares of the picture
    # cm = [[0.0, 0.0, 0.0], [2.0, 6.0, 3.0]]     # or [s since the start, right, up] cm from a tablet's middle
    pressure = [[0.0, 0.2], [1.0, 0.9]]      # or one number
    tilt = [[0.0, 90, 0], [1.0, 60, 180]]    # [s, altitude, azimuth] degrees; or one pair
    hover = 0.15                             # s that the pen hovers before it lands and after it lifts

``size_cm = [25.0, 15.6]`` beside the title tells the tablet's size, ``length = 12`` how long (s) the
performance goes on for the figure's sake. The pen runs smoothly through its points, without
overshoot. A file may hold a hundred strokes; they must not overlap.
"""

import math
import tomllib
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.camera import default_camera, project
from bunraku.figure.solids import monotone

Array = NDArray[np.float64]

LONGEST = 3600.0  # s
MOST_STROKES = 100
MOST_POINTS = 4096
WAYS = ("path", "ground", "cm")
KEYS = {"start", *WAYS, "pressure", "tilt", "hover"}
TABLET = (0.25, 0.15625)
"""m, width and height of a tablet whose size is not written."""


class PerformanceError(ValueError):
    """A performance file that cannot be played; one line naming file, stroke and key."""


@dataclass(frozen=True)
class Moment:
    """The pen at a time."""

    contact: bool
    x: float
    y: float
    pressure: float
    altitude: float
    azimuth: float


@dataclass(frozen=True, eq=False)
class Stroke:
    """One touch of the pen."""

    start: float
    hover: float
    path: Array  # (n, 3): s since the start, x, y
    pressure: Array  # (n, 2)
    tilt: Array  # (n, 3): s, altitude, azimuth (rad)

    @property
    def begin(self) -> float:
        """s, when the pen comes into range."""
        return self.start - self.hover

    @property
    def end(self) -> float:
        """s, when it leaves."""
        return self.start + float(self.path[-1, 0]) + self.hover

    def at(self, t: float) -> Moment:
        """The pen at ``t`` s, of the performance's time."""
        own = min(max(t - self.start, 0.0), float(self.path[-1, 0]))
        x, y = _sample(self.path, own)
        (pressure,) = _sample(self.pressure, own)
        altitude, azimuth = _sample(self.tilt, own)
        contact = self.start <= t <= self.start + float(self.path[-1, 0])
        return Moment(contact, x, y, pressure if contact else 0.0, altitude, azimuth % (2.0 * math.pi))


@dataclass(frozen=True, eq=False)
class Performance:
    """All strokes in order."""

    title: str
    strokes: tuple[Stroke, ...]
    size_m: tuple[float, float] | None = None
    """Width and height of the tablet; None where nothing says that it is one."""
    least: float = 0.0
    """s that it lasts at least: the figure may need longer than the pen."""

    @property
    def length(self) -> float:
        """s until it is over."""
        return max(self.least, self.strokes[-1].end)

    def at(self, t: float) -> Moment | None:
        """The pen at ``t`` s; None where it is out of range."""
        for stroke in self.strokes:
            if stroke.begin <= t <= stroke.end:
                return stroke.at(t)
        return None


def load(path: str | Path) -> Performance:
    """Read a performance; raises `PerformanceError`."""
    try:
        data = tomllib.loads(Path(path).read_text("utf-8"))
    except OSError as error:
        raise PerformanceError(f"{path}: cannot be read ({error.strerror})") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise PerformanceError(f"{path}: is not TOML ({error})") from None
    written = data.get("stroke")
    if not isinstance(written, list) or not 0 < len(written) <= MOST_STROKES:
        raise PerformanceError(f"{path}: write 1 to {MOST_STROKES} [[stroke]] tables")
    size = _size(path, data.get("size_cm"))
    if size is None and any(isinstance(one, dict) and "cm" in one for one in written):
        size = TABLET
    strokes = []
    for number, one in enumerate(written, 1):
        try:
            strokes.append(_stroke(one, size or TABLET))
        except (ValueError, TypeError) as error:
            raise PerformanceError(f"{path}: stroke {number}: {error}") from None
    strokes.sort(key=lambda stroke: stroke.begin)
    for before, after in pairwise(strokes):
        if after.begin < before.end:
            raise PerformanceError(f"{path}: the stroke at {after.start:g} s begins before the one before has ended")
    return Performance(
        str(data.get("title", Path(path).stem)), tuple(strokes), size, _length(path, data.get("length", 0.0))
    )


def _size(path: str | Path, given: object) -> tuple[float, float] | None:
    if given is None:
        return None
    if isinstance(given, list) and len(given) == 2 and all(isinstance(v, int | float) for v in given):
        width, height = float(given[0]), float(given[1])
        if 1.0 <= width <= 500.0 and 1.0 <= height <= 500.0:
            return 0.01 * width, 0.01 * height
    raise PerformanceError(f"{path}: size_cm: write the tablet's width and height, 1 to 500 cm")


def _length(path: str | Path, given: object) -> float:
    if isinstance(given, int | float) and 0.0 <= given <= LONGEST:
        return float(given)
    raise PerformanceError(f"{path}: length: write 0 to {LONGEST:g} s")


def _stroke(one: dict[str, Any], size: tuple[float, float]) -> Stroke:
    unknown = sorted(set(one) - KEYS)
    if unknown:
        raise ValueError(f"unknown key {unknown[0]!r} (has: {', '.join(sorted(KEYS))})")
    ways = [key for key in WAYS if key in one]
    if len(ways) != 1:
        raise ValueError("give one of path, ground or cm")
    path = _rows(one, ways[0], 3)
    if "cm" in one:
        shares = 0.5 + path[:, 1:] * np.array([0.01, -0.01]) / np.array(size)
        if ((shares < 0.0) | (shares > 1.0)).any():
            raise ValueError(f"cm: a place lies beyond the tablet of {100 * size[0]:g} x {100 * size[1]:g} cm")
        path = np.column_stack([path[:, 0], shares])
    if "ground" in one:
        places = np.column_stack([path[:, 1], np.zeros(len(path)), path[:, 2]])
        shares = project(default_camera(), places)
        if not np.isfinite(shares).all():
            raise ValueError("ground: a place lies behind the camera")
        path = np.column_stack([path[:, 0], shares])
    hover, start = float(one.get("hover", 0.1)), float(one.get("start", 0.0))
    if not 0.0 <= hover <= 60.0 or not 0.0 <= start <= LONGEST:
        raise ValueError(f"start is 0..{LONGEST:g} s and hover 0..60 s")
    pressure = one.get("pressure", 0.5)
    rows = _rows(one, "pressure", 2) if isinstance(pressure, list) else np.array([[0.0, float(pressure)]])
    if not ((rows[:, 1] >= 0.0) & (rows[:, 1] <= 1.0)).all():
        raise ValueError("pressure is 0..1")
    tilt = one.get("tilt", [90.0, 0.0])
    if len(tilt) == 2 and not isinstance(tilt[0], list):
        tilts = np.array([[0.0, float(tilt[0]), float(tilt[1])]])
    else:
        tilts = _rows(one, "tilt", 3)
    if not ((tilts[:, 1] >= 0.0) & (tilts[:, 1] <= 90.0)).all():
        raise ValueError("tilt: an altitude is 0..90 degrees")
    tilts = np.column_stack([tilts[:, 0], np.radians(tilts[:, 1]), np.unwrap(np.radians(tilts[:, 2]))])
    return Stroke(start, hover, path, rows, tilts)


def _rows(one: dict[str, Any], key: str, width: int) -> Array:
    rows = np.array(one[key], dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != width or not 0 < len(rows) <= MOST_POINTS:
        raise ValueError(f"{key}: write rows of {width} numbers, the time first")
    if not np.isfinite(rows).all() or rows[0, 0] < 0.0 or (np.diff(rows[:, 0]) <= 0.0).any() or rows[-1, 0] > LONGEST:
        raise ValueError(f"{key}: times must rise, from 0 to {LONGEST:g} s")
    return rows


def _sample(rows: Array, t: float) -> list[float]:
    if len(rows) == 1:
        return [float(value) for value in rows[0, 1:]]
    inside = np.array([min(max(t, float(rows[0, 0])), float(rows[-1, 0]))])
    return [float(value) for value in monotone(rows[:, 0], rows[:, 1:], inside)[0]]
