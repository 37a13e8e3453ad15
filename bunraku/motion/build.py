"""Make a motion set from captures by a recipe: read, retarget, cut, edit and measure each piece."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.skeleton import Skeleton
from bunraku.motion import rotation as rot
from bunraku.motion.analysis import headings
from bunraku.motion.analysis_contacts import Flags, contacts, on_floor
from bunraku.motion.build_edit import (
    calmed,
    carried,
    closed,
    ducked,
    leaned,
    levelled,
    marched,
    repeated,
    slowed,
    spun,
    step_flags,
    stepping,
    there_and_back,
)
from bunraku.motion.build_plant import planted
from bunraku.motion.build_recipe import Piece, Recipe, RecipeError
from bunraku.motion.clip import Clip, ClipError
from bunraku.motion.files import load_capture
from bunraku.motion.motionset import MODULES, Example, Module, MotionSet
from bunraku.motion.parameters import measured
from bunraku.motion.retarget import retarget

Array = NDArray[np.float64]
Report = Callable[[float, float, str], None]

FPS = 60.0
MOST_TIMES = 8  # how often a loop is repeated for its keys


@dataclass(frozen=True, eq=False)
class Source:
    """A capture on the set's figure, with its contacts."""

    file: str
    clip: Clip
    flags: Flags

    def mirrored(self) -> "Source":
        """Left and right exchanged."""
        return Source(self.file, self.clip.mirrored(), self.flags[:, ::-1])


def load_source(folder: Path, file: str, skeleton: Skeleton) -> Source:
    """Read a file below ``folder`` onto the figure at 60 frames a second, on a level floor.

    Raises:
        CaptureError, SkeletonError: the file cannot be read or is of no humanoid.
    """
    clip = retarget(load_capture(folder / file).clip.resampled(FPS), skeleton, floor=True)
    if len(clip) < 2:
        return Source(file, clip, np.ones((len(clip), 2), dtype=np.bool_))
    clip = levelled(clip, contacts(clip))
    return Source(file, clip, contacts(clip))


def example_of(piece: Piece, source: Source) -> Example:
    """The example that a piece describes.

    Raises:
        RecipeError: the piece's times are not in the file.
    """
    if piece.mirrored:
        source = source.mirrored()
    clip, flags = source.clip, source.flags
    if piece.loop is not None:
        first, last = (round(t * clip.fps) for t in piece.loop)
        if last >= len(clip) or last - first < 4:
            raise RecipeError(
                f"{piece.name}: loop {piece.loop} is not within the {clip.duration:.2f} s of {piece.file}"
            )
        clip, flags = clip.slice(first, last + 1), flags[first : last + 1]
        if piece.back:
            clip, flags = there_and_back(clip), np.concatenate([flags, flags[-2::-1]])
        times = min(MOST_TIMES, int(np.ceil(piece.keys[-1] / clip.duration - 1e-6)))
        clip = repeated(closed(clip), times)
        flags = np.concatenate([flags, *[flags[1:]] * (times - 1)])
    keys = np.array(piece.keys)
    first, last = round(keys[0] * clip.fps), round(keys[-1] * clip.fps)
    if last >= len(clip) or last - first < 2:
        raise RecipeError(f"{piece.name}: keys up to {keys[-1]:.2f} s, {piece.file} has {clip.duration:.2f} s")
    clip, flags = clip.slice(first, last + 1), np.array(flags[first : last + 1])
    keys = _inside(keys - keys[0], clip)
    clip = on_floor(clip)  # the file's floor is one for all of it, and captured floors are not level
    if piece.cycle:
        clip = closed(clip)
        flags[-1] = flags[0]
    if not piece.module.startswith("turn"):  # who turns on the spot does it on feet that turn
        clip = planted(clip, flags, piece.cycle)
    clip, flags = _edited(piece, clip, flags, keys)
    clip = clip.at_origin().renamed(piece.name)
    parameters = MODULES["locomotion"] if piece.module == "canonical" and piece.cycle else MODULES.get(piece.module)
    values = measured(parameters or ("distance", "height"), clip, flags, turns=piece.module.startswith("turn"))
    return Example(clip, values, keys, flags, piece.cycle, piece.made)


def _inside(keys: Array, clip: Clip) -> Array:
    """Key times from 0 to the clip's whole length, a frame apart at least."""
    out = np.array(keys)
    out[-1] = clip.duration
    step = 0.5 / clip.fps
    for k in range(1, len(out) - 1):
        out[k] = min(max(out[k], out[k - 1] + step), clip.duration - step * (len(out) - 1 - k))
    return out


def _edited(piece: Piece, clip: Clip, flags: Flags, keys: Array) -> tuple[Clip, Flags]:
    """What the piece says is done to the clip."""
    if piece.calm:
        clip = calmed(clip, piece.calm)
    if piece.lift and len(keys) == 6:
        flags = step_flags(flags, keys, clip.fps, 1 if piece.module.endswith("right") else 0)
        clip = stepping(clip, flags, piece.lift)
    if piece.turn:
        clip = spun(clip, flags, float(np.radians(piece.turn)), float(keys[1]), float(keys[4]))
    if piece.slow:
        clip = planted(slowed(clip, min(max(piece.slow, 0.0), 1.0)), flags, piece.cycle)
    if piece.march:
        clip = marched(clip, flags, piece.march)
    if piece.tilt or piece.bend:
        clip = leaned(clip, np.radians(piece.tilt), np.radians(piece.bend))
    if piece.duck:
        clip = ducked(clip, piece.duck)
    if piece.distance:
        facing = float(headings(clip)[0])
        way = rot.rotate(rot.yaw(facing + np.radians(piece.angle)), np.array([0.0, 0.0, piece.distance]))
        gone = clip.roots[-1] - clip.roots[0]
        # Carried so that the whole way is the one asked for.
        clip = carried(clip, flags, float(way[0] - gone[0]), float(way[2] - gone[2]), *_way_times(piece, keys))
    if piece.cycle and piece.made:
        clip = closed(clip)
    return clip, flags


def _way_times(piece: Piece, keys: Array) -> tuple[float, float]:
    """When the body leaves and when it arrives: the flight of a jump, both steps of a step."""
    return (float(keys[2]), float(keys[4])) if piece.module.startswith("jump") else (float(keys[1]), float(keys[4]))


def make(recipe: Recipe, folder: Path, skeleton: Skeleton, report: Report | None = None) -> MotionSet:
    """The motion set of a recipe, from the files below ``folder``.

    Args:
        report: called with what is done, the whole, and the piece's name.

    Raises:
        RecipeError, CaptureError: a piece or its file cannot be used; the message names it.
    """
    sources: dict[str, Source] = {}
    modules: dict[str, list[Example]] = {}
    canonical: dict[str, Example] = {}
    for number, piece in enumerate(recipe.pieces):
        if report is not None:
            report(number, len(recipe.pieces), piece.name)
        if piece.file not in sources:
            sources[piece.file] = load_source(folder, piece.file, skeleton)
        try:
            example = example_of(piece, sources[piece.file])
        except ClipError as error:
            raise RecipeError(f"{piece.name}: {error}") from None
        if piece.module == "canonical":
            canonical[piece.name] = example
        else:
            modules.setdefault(piece.module, []).append(example)
    ordered = [name for name in MODULES if name in modules]
    return MotionSet(
        recipe.name,
        skeleton,
        {name: Module(name, MODULES[name], tuple(modules[name])) for name in ordered},
        canonical,
    )


def renamed(pieces: Iterable[Piece]) -> tuple[Piece, ...]:
    """The pieces with names that differ within each module."""
    seen: dict[tuple[str, str], int] = {}
    out = []
    for piece in pieces:
        label = (piece.module, piece.name)
        seen[label] = seen.get(label, 0) + 1
        out.append(piece if seen[label] == 1 else replace(piece, name=f"{piece.name}_{seen[label]}"))
    return tuple(out)
