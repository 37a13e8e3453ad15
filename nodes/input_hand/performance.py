"""A performance of the hands, written down in a small TOML file.

    title = "Reach and punch"
    unit = "normalised"                      # of the bends: normalised (-1..1), raw or rad

    [[move]]
    hand = "right"
    start = 0.5                              # s
    position = [[0.0, 0, 0, 0], [1.0, 0.4, 0.2, 0]]      # [s since the start, x, y, z]
    bend = [[0.0, 0, 0, 0, 0, 0], [1.0, 0, 1, 1, 0, 0]]  # [s since the start, thumb .. little]

A hand runs smoothly through its points, without overshoot, and stays where its last move left it. Moves of one hand
follow each other; what a move does not tell stays.
"""

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.solids import monotone
from bunraku.msgs import Hand

Array = NDArray[np.float64]
Unit = Literal["rad", "raw", "normalised"]

LONGEST = 3600.0  # s
MOST_MOVES = 256
MOST_POINTS = 4096
KEYS = {"hand", "start", "position", "bend"}
UNITS: dict[str, Unit] = {"rad": "rad", "raw": "raw", "normalised": "normalised"}


class PerformanceError(ValueError):
    """A performance file that cannot be played; one line naming file, move and key."""


@dataclass(frozen=True, eq=False)
class Move:
    """One hand's rows over time; None for what it leaves as it was."""

    hand: str
    start: float
    position: Array | None  # (n, 4)
    bend: Array | None  # (n, 6)

    @property
    def end(self) -> float:
        """s, when its last point is reached."""
        return self.start + max(float(rows[-1, 0]) for rows in (self.position, self.bend) if rows is not None)


@dataclass(frozen=True, eq=False)
class Performance:
    """All moves in order."""

    title: str
    unit: Unit
    moves: tuple[Move, ...]

    @property
    def length(self) -> float:
        """s until the last move is over."""
        return max(move.end for move in self.moves)

    def hand(self, side: str, t: float) -> Hand | None:
        """A hand at ``t`` s; None for one that never moves."""
        position, bend, found = [0.0, 0.0, 0.0], [0.0] * 5, False
        for move in self.moves:
            if move.hand != side:
                continue
            found = True
            if t < move.start:
                break
            if move.position is not None:
                position = _sample(move.position, t - move.start)
            if move.bend is not None:
                bend = _sample(move.bend, t - move.start)
        if not found:
            return None
        return Hand(
            position=(position[0], position[1], position[2]), bend=(bend[0], bend[1], bend[2], bend[3], bend[4])
        )


def load(path: str | Path) -> Performance:
    """Read a performance; raises `PerformanceError`."""
    try:
        data = tomllib.loads(Path(path).read_text("utf-8"))
    except OSError as error:
        raise PerformanceError(f"{path}: cannot be read ({error.strerror})") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise PerformanceError(f"{path}: is not TOML ({error})") from None
    unit = UNITS.get(str(data.get("unit", "normalised")))
    if unit is None:
        raise PerformanceError(f"{path}: unit is one of {', '.join(UNITS)}")
    written = data.get("move")
    if not isinstance(written, list) or not 0 < len(written) <= MOST_MOVES:
        raise PerformanceError(f"{path}: write 1 to {MOST_MOVES} [[move]] tables")
    moves = []
    for number, one in enumerate(written, 1):
        try:
            moves.append(_move(one))
        except (ValueError, TypeError) as error:
            raise PerformanceError(f"{path}: move {number}: {error}") from None
    moves.sort(key=lambda move: move.start)
    return Performance(str(data.get("title", Path(path).stem)), unit, tuple(moves))


def _move(one: dict[str, Any]) -> Move:
    unknown = sorted(set(one) - KEYS)
    if unknown:
        raise ValueError(f"unknown key {unknown[0]!r} (has: {', '.join(sorted(KEYS))})")
    if one.get("hand") not in ("left", "right"):
        raise ValueError("hand is left or right")
    if "position" not in one and "bend" not in one:
        raise ValueError("give position, bend or both")
    start = float(one.get("start", 0.0))
    if not 0.0 <= start <= LONGEST:
        raise ValueError(f"start is 0..{LONGEST:g} s")
    return Move(str(one["hand"]), start, _rows(one, "position", 4), _rows(one, "bend", 6))


def _rows(one: dict[str, Any], key: str, width: int) -> Array | None:
    if key not in one:
        return None
    rows = np.array(one[key], dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != width or not 0 < len(rows) <= MOST_POINTS:
        raise ValueError(f"{key}: write rows of {width} numbers, the time first")
    if not np.isfinite(rows).all() or rows[0, 0] < 0.0 or (np.diff(rows[:, 0]) <= 0.0).any() or rows[-1, 0] > LONGEST:
        raise ValueError(f"{key}: times must rise, from 0 to {LONGEST:g} s")
    if np.abs(rows).max() > 1e6:
        raise ValueError(f"{key}: a number is out of any range")
    return rows


def _sample(rows: Array, t: float) -> list[float]:
    if len(rows) == 1:
        return [float(value) for value in rows[0, 1:]]
    inside = np.array([min(max(t, float(rows[0, 0])), float(rows[-1, 0]))])
    return [float(value) for value in monotone(rows[:, 0], rows[:, 1:], inside)[0]]
