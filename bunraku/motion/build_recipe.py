"""The recipe of a motion set: which pieces of which files it is made of, as a small text to look over and change."""

import json
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from bunraku.motion.motionset import CANONICAL, EVENTS, MODULES

HEAD = """\
# Recipe of a motion set, found by `bunraku motion build` and read again by `--recipe`.
# Take out a [[piece]], change its times, or put one in; then build again: nothing is searched then.
# file: below the folder. keys: seconds in the file (with loop: in it, repeated), at the events of the module.
# mirrored: left and right exchanged. tilt, bend: degrees added, left and forward. duck: added, in 0.4 leg lengths.
# angle, distance: carried that way (degrees to the left, metres). march: feet lifted higher, in leg lengths.
# lift: metres that the feet are lifted to step from standing, at the keys of a step. calm: 1 lets the arms hang.
# back: the loop is played there and back. slow: share (0..1) of a straight walk's way that is taken out.
# turn: degrees to the left that standing feet step around, at the keys of a turn.
"""


class RecipeError(ValueError):
    """A recipe that cannot be used; one line with the file and what to change."""


@dataclass(frozen=True)
class Piece:
    """One example: where it is cut from and what is done to it."""

    module: str  # a module's name, or "canonical"
    name: str
    file: str
    keys: tuple[float, ...]  # s
    loop: tuple[float, float] | None = None  # s in the file: closed and repeated before the keys count
    mirrored: bool = False
    tilt: float = 0.0  # degrees
    bend: float = 0.0
    duck: float = 0.0
    angle: float = 0.0
    distance: float = 0.0
    march: float = 0.0
    calm: float = 0.0
    lift: float = 0.0
    slow: float = 0.0
    turn: float = 0.0
    back: bool = False

    @property
    def made(self) -> bool:
        """Whether it is edited rather than as it was captured."""
        return (
            self.mirrored
            or self.back
            or any(
                (self.tilt, self.bend, self.duck, self.distance, self.march, self.calm, self.lift, self.slow, self.turn)
            )
        )

    @property
    def cycle(self) -> bool:
        """Whether the example repeats."""
        return self.module in ("locomotion", "stand") or (self.module == "canonical" and len(self.keys) == 5)


@dataclass(frozen=True)
class Recipe:
    """All pieces of one set."""

    name: str
    pieces: tuple[Piece, ...]


def events_of(module: str) -> tuple[str, ...]:
    """The events at the key times of a module's pieces."""
    return EVENTS.get(module) or EVENTS["jump"]


def write_recipe(recipe: Recipe, path: Path) -> None:
    """Write the recipe as TOML."""
    path.write_text(recipe_text(recipe), encoding="utf-8", newline="\n")


def recipe_text(recipe: Recipe) -> str:
    """What `write_recipe` writes."""
    lines = [HEAD, f"name = {json.dumps(recipe.name)}"]
    module = ""
    for piece in recipe.pieces:
        if piece.module != module:
            module = piece.module
            events = ", ".join(events_of(module)) if module != "canonical" else "of locomotion or jump"
            lines.append(f"\n# {module}: {events}")
        lines.append("\n[[piece]]")
        for field in fields(Piece):
            value = getattr(piece, field.name)
            if field.name in ("module", "name", "file"):
                lines.append(f"{field.name} = {json.dumps(value)}")
            elif field.name in ("keys", "loop") and value is not None:
                lines.append(f"{field.name} = [{', '.join(f'{v:.4f}' for v in value)}]")
            elif value is True:
                lines.append(f"{field.name} = true")
            elif isinstance(value, float) and value != 0.0:
                lines.append(f"{field.name} = {value:.4g}")
    return "\n".join(lines) + "\n"


def read_recipe(path: Path) -> Recipe:
    """Read a recipe; raises `RecipeError` with the file's name and what to change."""
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise RecipeError(f"{path}: {error.strerror or error}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise RecipeError(f"{path.name}: {' '.join(str(error).split())}") from None
    rows = data.get("piece", [])
    if not isinstance(rows, list) or not rows or not all(isinstance(row, dict) for row in rows):
        raise RecipeError(f"{path.name}: no [[piece]]; build without --recipe to have one written")
    unknown = sorted(set(data) - {"name", "piece"})
    if unknown:
        raise RecipeError(f"{path.name}: unknown key {unknown[0]!r} (known: name, piece)")
    pieces = tuple(_piece(row, f"{path.name}: piece {number}") for number, row in enumerate(rows, 1))
    _check_names(pieces, path.name)
    return Recipe(str(data.get("name", path.stem)), pieces)


def _piece(row: dict[str, Any], at: str) -> Piece:
    known = {field.name for field in fields(Piece)}
    unknown = sorted(set(row) - known)
    if unknown:
        raise RecipeError(f"{at}: unknown key {unknown[0]!r} (known: {', '.join(sorted(known))})")
    values: dict[str, Any] = {}
    for key in ("module", "name", "file"):
        if not isinstance(row.get(key), str) or not row[key]:
            raise RecipeError(f"{at}: {key!r} must be a word")
        values[key] = row[key]
    at = f"{at} ({values['name']})"
    if values["module"] not in (*MODULES, "canonical"):
        raise RecipeError(f"{at}: unknown module {values['module']!r} (there is: {', '.join(MODULES)}, canonical)")
    if Path(values["file"]).is_absolute() or ".." in Path(values["file"]).parts:
        raise RecipeError(f"{at}: file {values['file']!r} must be below the folder that is built from")
    values["keys"] = _times(row.get("keys"), f"{at}: keys")
    wanted = {len(EVENTS["locomotion"]), len(EVENTS["jump"])}
    if values["module"] != "canonical":
        wanted = {len(events_of(values["module"]))}
    if len(values["keys"]) not in wanted:
        raise RecipeError(f"{at}: {len(values['keys'])} keys; expected {', '.join(map(str, sorted(wanted)))}")
    if "loop" in row:
        loop = _times(row["loop"], f"{at}: loop")
        if len(loop) != 2:
            raise RecipeError(f"{at}: loop must be two times")
        values["loop"] = (loop[0], loop[1])
    for key in ("mirrored", "back"):
        if not isinstance(row.get(key, False), bool):
            raise RecipeError(f"{at}: {key} must be true or false")
        values[key] = row.get(key, False)
    if values["back"] and "loop" not in values:
        raise RecipeError(f"{at}: back needs a loop to play there and back")
    for key in ("tilt", "bend", "duck", "angle", "distance", "march", "calm", "lift", "slow", "turn"):
        value = row.get(key, 0.0)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= 360.0:
            raise RecipeError(f"{at}: {key} must be a number within -360..360")
        values[key] = float(value)
    return Piece(**values)


def _times(value: object, at: str) -> tuple[float, ...]:
    if not isinstance(value, list) or not all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in value):
        raise RecipeError(f"{at} must be a list of seconds")
    times = tuple(float(v) for v in value)
    if len(times) < 2 or not all(0.0 <= v < 1e6 for v in times) or sorted(set(times)) != list(times):
        raise RecipeError(f"{at} must be two or more seconds, increasing")
    return times


def _check_names(pieces: Sequence[Piece], file: str) -> None:
    seen: set[tuple[str, str]] = set()
    for piece in pieces:
        label = (piece.module, piece.name)
        if label in seen:
            raise RecipeError(f"{file}: two pieces named {piece.name!r} in {piece.module}")
        seen.add(label)
        if piece.module == "canonical" and piece.name not in CANONICAL:
            raise RecipeError(f"{file}: canonical {piece.name!r} is not one of {', '.join(CANONICAL)}")
