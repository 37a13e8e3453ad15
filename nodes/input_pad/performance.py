"""A gamepad's performance: moments written down in a small TOML file.

    title = "Walk a curve"
    length = 8                    # s

    [[at]]
    time = 0.5                    # s
    left = [0.0, -0.8]            # stick, right and down -1..1
    right = [0.0, 0.0]
    buttons = [0]                 # numbers of the pressed ones, until the next moment

Sticks move evenly from moment to moment; what a moment does not say stays.
"""

import math
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

BUTTONS = 16
LONGEST = 3600.0  # s
KEYS = {"time", "left", "right", "buttons"}


class PerformanceError(ValueError):
    """A performance file that cannot be played; one line naming file, moment and key."""


@dataclass(frozen=True)
class Moment:
    """Sticks and buttons at a time."""

    time: float  # s
    axes: tuple[float, float, float, float]
    buttons: tuple[int, ...]


@dataclass(frozen=True)
class Performance:
    """All moments in order."""

    title: str
    length: float  # s
    moments: tuple[Moment, ...]

    def at(self, t: float) -> tuple[list[float], list[bool]]:
        """Axes and buttons at ``t`` s; at rest before the first moment."""
        before = Moment(0.0, (0.0, 0.0, 0.0, 0.0), ())
        after = None
        for one in self.moments:
            if one.time > t:
                after = one
                break
            before = one
        share = 0.0 if after is None else (t - before.time) / (after.time - before.time)
        goal = before.axes if after is None else after.axes
        axes = [a + (b - a) * share for a, b in zip(before.axes, goal, strict=True)]
        return axes, [number in before.buttons for number in range(BUTTONS)]


def load(path: str | Path) -> Performance:
    """Read a performance; raises `PerformanceError`."""
    try:
        data = tomllib.loads(Path(path).read_text("utf-8"))
    except OSError as error:
        raise PerformanceError(f"{path}: cannot be read ({error.strerror})") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise PerformanceError(f"{path}: is not TOML ({error})") from None
    written = data.get("at")
    if not isinstance(written, list) or not written:
        raise PerformanceError(f"{path}: write one [[at]] table or more")
    moments: list[Moment] = []
    for number, one in enumerate(written, 1):
        try:
            moments.append(_moment(one, moments[-1] if moments else None))
        except (ValueError, TypeError) as error:
            raise PerformanceError(f"{path}: moment {number}: {error}") from None
    length = data.get("length", moments[-1].time)
    if not isinstance(length, int | float) or not moments[-1].time <= length <= LONGEST:
        raise PerformanceError(f"{path}: length: write {moments[-1].time:g} to {LONGEST:g} s")
    return Performance(str(data.get("title", Path(path).stem)), float(length), tuple(moments))


def _moment(one: dict[str, Any], before: Moment | None) -> Moment:
    unknown = sorted(set(one) - KEYS)
    if unknown:
        raise ValueError(f"unknown key {unknown[0]!r} (has: {', '.join(sorted(KEYS))})")
    time = float(one.get("time", math.nan))
    if not (before.time if before else -1.0) < time <= LONGEST or time < 0.0:
        raise ValueError(f"time: write s, later than the moment before, at most {LONGEST:g}")
    held = before.axes if before else (0.0, 0.0, 0.0, 0.0)
    left, right = _stick(one, "left", held[:2]), _stick(one, "right", held[2:])
    buttons = one.get("buttons", list(before.buttons) if before else [])
    if not all(isinstance(number, int) and 0 <= number < BUTTONS for number in buttons):
        raise ValueError(f"buttons: write numbers 0 to {BUTTONS - 1}")
    return Moment(time, (left[0], left[1], right[0], right[1]), tuple(buttons))


def _stick(one: dict[str, Any], key: str, held: tuple[float, ...]) -> tuple[float, float]:
    value = one.get(key, held)
    if len(value) != 2 or not all(-1.0 <= float(v) <= 1.0 for v in value):
        raise ValueError(f"{key}: write two numbers, -1 to 1")
    return float(value[0]), float(value[1])
