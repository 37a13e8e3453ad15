"""A performance: timed touches written down in a small TOML file.

    title = "Wave"

    [[touch]]
    on = "left_hand"              # a part of the default figure at ease, seen by the default camera
    start = 0.5                   # s
    drag = [[0.6, 0.10, 0.55],    # [s since the start, m to the right, m up] on the picture, from where it began
            [0.9, 0.30, 0.60]]
    hold = 0.4                    # s that the finger stays at the end

    [[touch]]
    at = [0.1, 0.2]               # shares of the picture from its top-left
    start = 2.0
    path = [[0.5, 0.4, 0.2]]      # [s since the start, x, y] shares of the picture
    pressure = [[0.0, 0.2], [0.5, 0.9]]    # or one number
    ellipse = [0.012, 0.009, 0.3] # major m, minor m, angle rad; or rows with a time first
    end = "cancel"

After a performance has swiped to another view, ``view = [azimuth, elevation]`` rad says from where ``on``, ``offset``
and ``drag`` of a touch are worked out; a swipe of one picture height turns the view by pi.

A touch begins at rest where ``on`` or ``at`` says, runs smoothly through its points without overshoot and rests at
the end; ``curve = "linear"`` runs straight. ``offset = [right, up]`` m moves the beginning beside the part.
The same touch again and again: ``repeat = 3`` with ``every = 1.5`` s.
"""

import math
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.camera import Orbit, metres_per_height, project
from bunraku.figure.default import default_figure
from bunraku.msgs import Camera
from bunraku.nodes.input_touch.frame import Ending, Sample

Array = NDArray[np.float64]

LONGEST = 3600.0  # s
MOST_TOUCHES = 256
MOST_POINTS = 4096


class PerformanceError(ValueError):
    """A performance file that cannot be played; one line naming file, touch and key."""


class Curve:
    """Values over time, smooth and without overshoot (monotone cubic, Fritsch and Carlson 1980) or straight."""

    def __init__(self, times: Iterable[float], values: Iterable[Iterable[float]], *, linear: bool = False) -> None:
        self.t: Array = np.array(list(times), dtype=np.float64)
        self.v: Array = np.array([list(row) for row in values], dtype=np.float64)
        self.linear = linear
        self.slopes = np.zeros_like(self.v)
        if len(self.t) > 2:
            h = np.diff(self.t)[:, None]
            d = np.diff(self.v, axis=0) / h
            w0, w1 = 2.0 * h[1:] + h[:-1], h[1:] + 2.0 * h[:-1]
            same = d[1:] * d[:-1] > 0.0
            weighted = np.where(same, w0 * d[1:] + w1 * d[:-1], 1.0)
            # The ends' slopes stay zero: a finger begins and ends at rest.
            self.slopes[1:-1] = np.where(same, (w0 + w1) * d[:-1] * d[1:] / weighted, 0.0)

    def at(self, t: float) -> Array:
        """(k) values at a time, held before the first and after the last."""
        if t <= self.t[0] or len(self.t) == 1:
            first: Array = self.v[0]
            return first
        if t >= self.t[-1]:
            last: Array = self.v[-1]
            return last
        k = int(np.searchsorted(self.t, t, side="right")) - 1
        h = self.t[k + 1] - self.t[k]
        s = (t - self.t[k]) / h
        if self.linear:
            mixed: Array = (1.0 - s) * self.v[k] + s * self.v[k + 1]
            return mixed
        out: Array = (
            (1.0 + 2.0 * s) * (1.0 - s) ** 2 * self.v[k]
            + s * (1.0 - s) ** 2 * h * self.slopes[k]
            + s * s * (3.0 - 2.0 * s) * self.v[k + 1]
            + s * s * (s - 1.0) * h * self.slopes[k + 1]
        )
        return out


@dataclass(frozen=True, eq=False)
class Stroke:
    """One finger from down to up."""

    start: float  # s
    end: float  # s
    path: Curve  # (x, y) shares over s since the start
    pressure: Curve | None = None
    ellipse: Curve | None = None
    ending: Ending = "up"

    def at(self, t: float) -> Sample:
        """Where the finger is at ``t`` (s since the performance's start)."""
        since = t - self.start
        x, y = self.path.at(since)
        pressure = None if self.pressure is None else float(self.pressure.at(since)[0])
        shape = (None, None, None) if self.ellipse is None else tuple(float(n) for n in self.ellipse.at(since))
        return Sample(float(x), float(y), shape[0], shape[1], shape[2], pressure)


@dataclass(frozen=True, eq=False)
class Performance:
    """All touches of a file."""

    title: str
    strokes: tuple[Stroke, ...]
    file: str = ""
    length: float = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "length", max((one.end for one in self.strokes), default=0.0))

    def live(self, t: float) -> dict[int, Sample]:
        """The fingers that are down at ``t`` s, by the number of their touch."""
        return {key: one.at(t) for key, one in enumerate(self.strokes) if one.start <= t < one.end}

    def ended(self) -> dict[int, Ending]:
        """How each touch ends."""
        return {key: one.ending for key, one in enumerate(self.strokes)}


def load(path: str | Path) -> Performance:
    """Read a performance; raises `PerformanceError`."""
    place = Path(path)
    try:
        text = place.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is no UTF-8 text"
        raise PerformanceError(f"{place}: cannot be read ({reason}); give the path of a .touch file") from None
    return parse(text, str(place))


def parse(text: str, name: str = "performance") -> Performance:
    """Read a performance from TOML text; ``name`` is what messages call it. Raises `PerformanceError`."""
    try:
        tree = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise PerformanceError(f"{name}: not TOML: {error}") from None
    reader = _Reader(name)
    reader.only(tree, "", {"title", "touch"})
    touches = tree.get("touch", [])
    if not isinstance(touches, list) or not touches:
        raise PerformanceError(f"{name}: touch: none given; write at least one [[touch]] table")
    strokes: list[Stroke] = []
    for number, one in enumerate(touches, 1):
        strokes += reader.strokes(one, f"touch {number}")
        if len(strokes) > MOST_TOUCHES:
            raise PerformanceError(f"{name}: {len(strokes)} touches, at most {MOST_TOUCHES}; split the performance")
    return Performance(str(tree.get("title", Path(name).stem)), tuple(strokes), name)


_MIDDLES = {
    "pelvis": "hips", "trunk": "chest", "head": "head", "left_hand": "leftHand", "right_hand": "rightHand",
    "left_foot": "leftFoot", "right_foot": "rightFoot",
}  # fmt: skip
_JOINTS = {
    "left_elbow": "leftLowerArm", "right_elbow": "rightLowerArm", "left_knee": "leftLowerLeg",
    "right_knee": "rightLowerLeg",
}  # fmt: skip
PARTS = (*_MIDDLES, *_JOINTS)
"""Names that ``on`` takes."""


AT_EASE = (0.17, -0.97, 0.10)
"""Direction of the left arm of a figure that stands at ease."""


def part_places() -> dict[str, Array]:
    """World positions (3) m of the middle of each part of the default figure that stands at ease: the rest pose
    with its arms at its sides."""
    skeleton = default_figure()
    joints = np.array(skeleton.rest_positions)
    middles = joints + skeleton.box_centers  # at rest every joint is turned as the world
    for side, sign in (("left", 1.0), ("right", -1.0)):
        down = np.array([sign * AT_EASE[0], AT_EASE[1], AT_EASE[2]])
        down /= np.linalg.norm(down)
        chain = [skeleton.role(side + part) for part in ("UpperArm", "LowerArm", "Hand")]
        place = joints[chain[0]]
        for above, below in pairwise(chain):
            place = joints[below] = place + down * np.linalg.norm(skeleton.offsets[below])
            middles[above] = 0.5 * (joints[above] + place)
        middles[chain[-1]] = place + down * np.linalg.norm(skeleton.box_centers[chain[-1]])
    places = {name: middles[skeleton.role(role)] for name, role in _MIDDLES.items()}
    places |= {name: joints[skeleton.role(role)] for name, role in _JOINTS.items()}
    return places


class _Reader:
    """Checks tables with the file's name in every message."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.places: dict[str, Array] | None = None

    def fail(self, where: str, text: str) -> PerformanceError:
        return PerformanceError(f"{self.name}: {where}: {text}")

    def only(self, table: dict[str, Any], where: str, keys: set[str]) -> None:
        for key in table:
            if key not in keys:
                raise self.fail(f"{where}: {key}" if where else key, f"no such key (has: {', '.join(sorted(keys))})")

    def number(self, value: Any, where: str, low: float, high: float) -> float:
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
            raise self.fail(where, f"{value!r} is no number")
        if not low <= value <= high:
            raise self.fail(where, f"{value} is outside {low:g}..{high:g}")
        return float(value)

    def row(self, value: Any, where: str, width: int, low: float, high: float) -> list[float]:
        if not isinstance(value, list) or len(value) != width:
            raise self.fail(where, f"{value!r} is no list of {width} numbers")
        return [self.number(one, where, low, high) for one in value]

    def rows(self, value: Any, where: str, width: int, low: float, high: float) -> list[list[float]]:
        if not isinstance(value, list) or not value or len(value) > MOST_POINTS:
            raise self.fail(where, f"write 1 to {MOST_POINTS} rows of {width} numbers")
        rows: list[list[float]] = []
        for one in value:
            if not isinstance(one, list) or len(one) != width:
                raise self.fail(where, f"{one!r} is no row of {width} numbers")
            time = self.number(one[0], where, 0.0, LONGEST)
            if rows and time <= rows[-1][0]:
                raise self.fail(where, f"times must rise, {time:g} s comes after {rows[-1][0]:g} s")
            rows.append([time, *(self.number(n, where, low, high) for n in one[1:])])
        return rows

    def strokes(self, table: Any, where: str) -> list[Stroke]:
        if not isinstance(table, dict):
            raise self.fail(where, "must be a [[touch]] table")
        self.only(table, where, {
            "on", "at", "offset", "start", "drag", "path", "hold", "pressure", "ellipse", "end", "curve", "repeat",
            "every", "view",
        })  # fmt: skip
        if ("on" in table) == ("at" in table):
            raise self.fail(where, 'give either on = "PART" or at = [x, y]')
        if "drag" in table and "path" in table:
            raise self.fail(where, "give either drag or path")
        ending = table.get("end", "up")
        if ending not in ("up", "cancel"):
            raise self.fail(f"{where}: end", f'{ending!r} is neither "up" nor "cancel"')
        curve = table.get("curve", "smooth")
        if curve not in ("smooth", "linear"):
            raise self.fail(f"{where}: curve", f'{curve!r} is neither "smooth" nor "linear"')
        azimuth, elevation = self.row(
            table.get("view", [Orbit.azimuth, Orbit.elevation]), f"{where}: view", 2, -math.pi, math.pi
        )
        camera = Orbit(azimuth=azimuth, elevation=elevation).camera()
        begin, scale = self.begin(table, where, camera)
        start = self.number(table.get("start", 0.0), f"{where}: start", 0.0, LONGEST)
        hold = self.number(table.get("hold", 0.0), f"{where}: hold", 0.0, LONGEST)
        path = self.path(table, where, begin, scale * camera.aspect, scale, linear=curve == "linear")
        repeat = int(self.number(table.get("repeat", 1), f"{where}: repeat", 1, MOST_TOUCHES))
        length = float(path.t[-1]) + hold
        if length <= 0.0:
            raise self.fail(where, "the finger is down for no time; give hold, drag or path")
        every = self.number(table.get("every", length + 0.1), f"{where}: every", length, LONGEST)
        extra = {
            "pressure": self.channel(table, "pressure", where, 1, 0.0, 1.0),
            "ellipse": self.channel(table, "ellipse", where, 3, -10.0, 10.0),
        }
        return [
            Stroke(start + k * every, start + k * every + length, path, ending=ending, **extra) for k in range(repeat)
        ]

    def begin(self, table: dict[str, Any], where: str, camera: Camera) -> tuple[tuple[float, float], float]:
        """Where the touch begins (shares), and metres that the picture's height spans there."""
        if "at" in table:
            x, y = self.row(table["at"], f"{where}: at", 2, -1.0, 2.0)
            scale = metres_per_height(camera, (0.0, 0.9, 0.0))
        else:
            part = table["on"]
            if part not in PARTS:
                raise self.fail(f"{where}: on", f"{part!r} is no part (has: {', '.join(PARTS)})")
            if self.places is None:
                self.places = part_places()
            x, y = project(camera, self.places[part])
            scale = metres_per_height(camera, self.places[part])
        right, up = self.row(table.get("offset", [0.0, 0.0]), f"{where}: offset", 2, -10.0, 10.0)
        return (float(x) + right / (scale * camera.aspect), float(y) - up / scale), scale

    def path(
        self, table: dict[str, Any], where: str, begin: tuple[float, float], wide: float, tall: float, *, linear: bool
    ) -> Curve:
        """Its way over the picture, which is ``wide`` and ``tall`` m where the touch begins."""
        rows: list[list[float]] = []
        if "path" in table:
            rows = self.rows(table["path"], f"{where}: path", 3, -1.0, 2.0)
        elif "drag" in table:
            rows = [
                [t, begin[0] + right / wide, begin[1] - up / tall]
                for t, right, up in self.rows(table["drag"], f"{where}: drag", 3, -100.0, 100.0)
            ]
        for _, x, y in rows:
            if not (-4.0 <= x <= 5.0 and -4.0 <= y <= 5.0):
                raise self.fail(where, f"the finger runs off to ({x:.1f}, {y:.1f}); the picture is 0..1")
        if not rows or rows[0][0] > 0.0:
            rows.insert(0, [0.0, *begin])
        return Curve([row[0] for row in rows], [row[1:] for row in rows], linear=linear)

    def channel(self, table: dict[str, Any], key: str, where: str, width: int, low: float, high: float) -> Curve | None:
        """A constant, or rows with a time first."""
        if key not in table:
            return None
        value = table[key]
        if isinstance(value, list) and value and isinstance(value[0], list):
            rows = self.rows(value, f"{where}: {key}", width + 1, low, high)
            return Curve([row[0] for row in rows], [row[1:] for row in rows])
        one = self.row(value if isinstance(value, list) else [value], f"{where}: {key}", width, low, high)
        return Curve([0.0], [one])
