"""Find the pieces of a motion set in captures: cycles, stands, steps, turns and jumps; fill what is missing."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.skeleton import Skeleton, SkeletonError
from bunraku.motion import rotation as rot
from bunraku.motion.analysis import headings, hips, measure
from bunraku.motion.analysis_contacts import runs
from bunraku.motion.analysis_flaws import flaws
from bunraku.motion.analysis_gait import gait_cycles, jump_keys, step_keys, swings
from bunraku.motion.build import Source, example_of, load_source, renamed
from bunraku.motion.build_choose import Found, choose
from bunraku.motion.build_edit import closed, gap, repeated
from bunraku.motion.build_recipe import Piece, Recipe, RecipeError
from bunraku.motion.clip import ClipError
from bunraku.motion.files import find_captures
from bunraku.motion.motionset import MotionSetError

Array = NDArray[np.float64]
Report = Callable[[float, float, str], None]

BAD = ("flip", "spike", "fast", "under", "sitting", "flat", "sliding")
"""Kinds of flaws that keep a piece out of the set; a floor that is off or not level is mended."""


@dataclass(frozen=True)
class PlanLimits:
    """What counts as a good piece; angles rad."""

    cycle_gap: float = 0.16  # between a cycle's first and last pose, root mean square over the joints
    loop: tuple[float, float] = (0.6, 2.2)  # s that a loop found by its poses may take
    off_course: float = 0.6  # rad between heading and way gone, beyond which it is no walk ahead
    slowest: float = 0.3  # m/s of a walk
    stand_speed: float = 0.12  # m/s
    stand_seconds: tuple[float, ...] = (4.0, 2.0, 1.0)
    stand_bob: float = 0.04  # m of the hips up and down
    step: tuple[float, float] = (0.12, 1.0)  # m
    step_turn: float = 0.45
    turn: tuple[float, float] = (0.6, 4.0)
    turn_way: float = 0.65  # m
    jump_seconds: float = 2.6
    jump_together: float = 0.13  # s between the feet's leaving the ground, and between their coming back
    jump_rise: float = 0.12  # m of the hips
    jump_turn: float = 0.6  # rad
    move_bend: float = 0.75  # rad, beyond which a step or turn is something else, and likewise
    move_duck: float = 0.55
    hands_up: float = 0.15  # m over the hips, above which the arms do something of their own
    feet_apart: float = 0.30  # m, wider than people stand
    move_hands: float = 0.9  # m/s, mean of either hand
    move_foot: float = 0.40  # m over the ground
    jump_up: float = 0.35  # m that a jump straight up may go along the ground
    jump_sway: float = 0.7  # rad from straight ahead
    longest: float = 8.0  # s of a file that steps and turns are looked for in


LIMITS = PlanLimits()


@dataclass
class Plan:
    """What came out: the recipe, and a line about each file or gap that is worth one."""

    recipe: Recipe
    notes: list[str] = field(default_factory=list)


def plan(folder: Path, skeleton: Skeleton, name: str | None = None, report: Report | None = None) -> Plan:
    """Look through every capture below ``folder`` and put a recipe together.

    Raises:
        MotionSetError: there is no capture, or none that can be read.
    """
    files = find_captures(folder)
    if not files:
        raise MotionSetError(f"{folder}: no .bvh or .amc file below it")
    notes: list[str] = []
    found: dict[str, list[Found]] = {}
    read = 0
    for number, path in enumerate(files):
        label = path.relative_to(folder).as_posix()
        if report is not None:
            report(number, len(files), label)
        try:
            source = load_source(folder, label, skeleton)
            read += 1
            for module, candidate in candidates(source, notes):
                found.setdefault(module, []).append(candidate)
        except (ClipError, SkeletonError) as error:
            notes.append(f"{label}: left out: {error}")
    if not read:
        raise MotionSetError(f"{folder}: no file could be used; the first: {notes[0]}")
    pieces = choose(found, notes)
    if not pieces:
        raise MotionSetError(f"{folder}: no walk, stand, step, turn or jump was found in {read} files")
    return Plan(Recipe(name or folder.resolve().name, renamed(pieces)), notes)


def candidates(source: Source, notes: list[str]) -> Iterator[tuple[str, Found]]:
    """(module, candidate) of everything that a file holds."""
    bad = [flaw for flaw in flaws(source.clip, source.flags) if flaw.kind in BAD]
    notes += [f"{source.file}: {flaw.text}" for flaw in bad]
    frames = [flaw.frame for flaw in bad if flaw.frame >= 0]
    if any(flaw.frame < 0 for flaw in bad) or len(source.clip) < 20:
        return
    stem = Path(source.file).stem
    tries: list[Piece] = []
    flown = _jumps(source, stem)
    tries += flown
    walks = [] if flown and source.clip.duration < LIMITS.longest else _cycles(source, stem)
    tries += walks
    if source.clip.duration <= LIMITS.longest and not flown:
        tries += _moves(source, stem)
    tries += _stands(source, stem)
    for piece in tries:
        if _spoiled(piece, source, frames):
            continue
        try:
            example = example_of(piece, source)
        except (RecipeError, MotionSetError, ClipError):
            continue
        clip = example.clip
        if piece.cycle:
            apart = 0.0 if piece.back else _piece_gap(piece, source)
            if apart > LIMITS.cycle_gap:
                continue
            if piece.module == "stand":
                if any(flaw.kind == "sitting" for flaw in flaws(clip, example.contacts)):
                    continue
                first, last = (round(t * clip.fps) for t in piece.loop or piece.keys)
                apart = _unrest(source, first, last) + 0.4 / clip.duration + (0.1 if piece.calm else 0.0)
            yield piece.module, Found(piece, example.values, apart)
        else:
            m = measure(clip, example.contacts)
            busy = 0.1 * (m.left_hand_speed + m.right_hand_speed) + 0.3 * m.bend_max + 0.1 * abs(clip.duration - 1.4)
            yield piece.module, Found(piece, example.values, busy)


def _spoiled(piece: Piece, source: Source, frames: Sequence[int]) -> bool:
    """Whether a flaw lies within the piece."""
    times = piece.loop or (piece.keys[0], piece.keys[-1])
    return any(times[0] - 0.05 <= frame / source.clip.fps <= times[-1] + 0.05 for frame in frames)


def _piece_gap(piece: Piece, source: Source) -> float:
    times = piece.loop or (piece.keys[0], piece.keys[-1])
    first, last = (min(round(t * source.clip.fps), len(source.clip) - 1) for t in (times[0], times[-1]))
    return gap(source.clip, first, last)


def _cycles(source: Source, stem: str) -> list[Piece]:
    """Walks and runs: cycles from strike to strike, else a loop found by its poses."""
    out = []
    for mirrored in (False, True):
        here = source.mirrored() if mirrored else source
        for number, cycle in enumerate(gait_cycles(here.clip, here.flags)):
            first, last = (round(t * here.clip.fps) for t in (cycle.keys[0], cycle.keys[-1]))
            if _ahead(here, first, last):
                label = f"{stem}{'_mirrored' if mirrored else ''}{f'_{number + 1}' if number else ''}"
                out.append(Piece("locomotion", label, source.file, cycle.keys, mirrored=mirrored))
    if any(not piece.mirrored and _piece_gap(piece, source) <= LIMITS.cycle_gap for piece in out):
        return out
    loop = best_loop(source)
    if loop is None:
        return out
    first, last = loop
    if not _ahead(source, first, last):
        return out
    fps = source.clip.fps
    twice = repeated(closed(source.clip.slice(first, last + 1)))
    flags = np.concatenate([source.flags[first : last + 1], source.flags[first + 1 : last + 1]])
    inside = gait_cycles(twice, flags)
    if inside:
        out.insert(0, Piece("locomotion", stem, source.file, inside[0].keys, loop=(first / fps, last / fps)))
    return out


def _ahead(source: Source, first: int, last: int) -> bool:
    """Whether the body goes the way that it faces (backward and sideways walks are no examples of the module)."""
    middle = hips(source.clip)[first : last + 1]
    heading = headings(source.clip)[first : last + 1]
    steps = np.diff(middle[:, [0, 2]], axis=0)
    facing = np.stack([np.sin(heading[:-1]), np.cos(heading[:-1])], axis=1)
    along = float(np.sum(steps * facing))
    across = float(np.abs(np.sum(steps[:, 0] * facing[:, 1] - steps[:, 1] * facing[:, 0])))
    return along > LIMITS.slowest * (last - first) / source.clip.fps and np.arctan2(across, along) < LIMITS.off_course


def best_loop(source: Source) -> tuple[int, int] | None:
    """The two frames, a cycle apart, whose poses are most alike."""
    clip = source.clip
    low, high = (round(t * clip.fps) for t in LIMITS.loop)
    count = len(clip)
    if count <= low + 2 or count > 8 * high:
        return None
    best: tuple[float, int, int] | None = None
    for first in range(0, count - low, 2):
        for last in range(first + low, min(first + high, count - 1) + 1, 2):
            if float(np.linalg.norm((clip.roots[last] - clip.roots[first])[[0, 2]])) < 0.3:
                continue
            apart = gap(clip, first, last)
            if best is None or apart < best[0]:
                best = (apart, first, last)
    return (best[1], best[2]) if best is not None and best[0] < LIMITS.cycle_gap else None


def _jumps(source: Source, stem: str) -> list[Piece]:
    """The jump of a short file, or each of a long one."""
    clip, flags = source.clip, source.flags
    air = np.logical_not(flags.any(axis=1))
    flights = [(a, b) for a, b in runs(air) if a > 0 and b < len(clip) and b - a >= 0.22 * clip.fps]
    out = []
    for number, (first, last) in enumerate(flights):
        reach = round(1.3 * clip.fps)
        before, after = max(0, first - reach), min(len(clip), last + reach)
        others = [run for run in flights if run != (first, last)]
        before = max([before, *(b + 1 for _, b in others if b < first)])
        after = min([after, *(a - 1 for a, _ in others if a > last)])
        if after - before < 10:
            continue
        keys = jump_keys(clip.slice(before, after), flags[before:after])
        if keys is None or keys[-1] - keys[0] > LIMITS.jump_seconds:
            continue
        times = tuple(key + before / clip.fps for key in keys)
        ends = [round(times[0] * clip.fps), round(times[-1] * clip.fps)]
        if not all(flags[max(0, e - 3) : e + 4].any() for e in ends) or not _is_jump(source, first, last, ends):
            continue
        gone = hips(clip)[ends[1]] - hips(clip)[ends[0]]
        way = float(np.hypot(gone[0], gone[2]))
        side = _wrap(float(np.arctan2(gone[0], gone[2])) - float(headings(clip)[ends[0]]))
        module = "jump_up" if way < LIMITS.jump_up else _jump_module(side)
        label = f"{stem}{f'_{number + 1}' if number else ''}"
        out.append(Piece(module, label, source.file, times))
    return out


def _is_jump(source: Source, off: int, land: int, ends: Sequence[int]) -> bool:
    """Whether both feet leave together and come back together, the body rises and does not spin."""
    clip, flags = source.clip, source.flags
    margin = round(LIMITS.jump_together * clip.fps)
    together = all(
        flags[max(0, off - margin) : off + 1, foot].any() and flags[land : land + margin + 1, foot].any()
        for foot in range(2)
    )
    height = hips(clip)[ends[0] : ends[1] + 1, 1]
    turned = headings(clip)[[*ends]]
    rise = float(height.max() - height[0])
    return together and rise >= LIMITS.jump_rise and abs(float(turned[1] - turned[0])) <= LIMITS.jump_turn


def _jump_module(side: float) -> str:
    if abs(side) <= LIMITS.jump_sway:
        return "jump_forward"
    if abs(side) >= np.pi - LIMITS.jump_sway:
        return "jump_back"
    return "jump_left" if side > 0.0 else "jump_right"


def _moves(source: Source, stem: str) -> list[Piece]:
    """A step or a turn on the spot: one swing of each foot."""
    clip, flags = source.clip, source.flags
    found = step_keys(clip, flags)
    if found is None or len(swings(flags, clip.fps)) > 4:
        return []
    lead, keys = found
    ends = [round(keys[0] * clip.fps), min(round(keys[-1] * clip.fps), len(clip) - 1)]
    part = measure(clip.slice(ends[0], ends[1] + 1), flags[ends[0] : ends[1] + 1])
    turned = part.heading_change
    calm = 1.0 if _hands_up(source, ends[0], ends[1]) > LIMITS.hands_up else 0.0
    if part.bend_max > LIMITS.move_bend or part.duck_max > LIMITS.move_duck:
        return []
    if max(part.left_foot_max, part.right_foot_max) > LIMITS.move_foot:
        return []
    if max(part.left_hand_speed, part.right_hand_speed) > LIMITS.move_hands:
        return []
    if LIMITS.turn[0] <= abs(turned) <= LIMITS.turn[1] and part.distance <= LIMITS.turn_way:
        module = "turn_left" if turned > 0.0 else "turn_right"
        return [Piece(module, stem, source.file, keys, calm=calm)]
    if abs(turned) <= LIMITS.step_turn and LIMITS.step[0] <= part.distance <= LIMITS.step[1]:
        side = part.direction
        sideways = 0.15 < abs(side) < np.pi - 0.15
        leading = 0 if (side > 0.0 if sideways else lead == 0) else 1
        if leading == lead:
            return [Piece("step_left" if lead == 0 else "step_right", stem, source.file, keys, calm=calm)]
    return []


def _unrest(source: Source, first: int, last: int) -> float:
    """How far a stand is from standing still, upright, with the feet beside each other under the hips."""
    part = source.clip.slice(first, last + 1)
    m = measure(part, source.flags[first : last + 1])
    feet = [part.skeleton.role(side + "Foot") for side in ("left", "right")]
    places, heading = part.world[0], headings(part)
    apart = rot.rotate(rot.yaw(-heading), places[:, feet[0]] - places[:, feet[1]]).mean(axis=0)
    wide = max(0.0, abs(float(apart[0])) - LIMITS.feet_apart) + max(0.0, 0.1 - float(apart[0])) + abs(float(apart[2]))
    lean_ = abs(m.tilt_mean) + abs(m.bend_mean) + (m.bend_max - m.bend_mean)
    return 4.0 * wide + 2.0 * lean_ + 2.0 * abs(m.duck_mean) + 4.0 * m.speed + float(np.ptp(heading))


def _hands_up(source: Source, first: int, last: int) -> float:
    """m: how high the higher hand is over the hips, on average."""
    places = source.clip.world[0][first : last + 1]
    hands = places[:, [source.clip.skeleton.role("leftHand"), source.clip.skeleton.role("rightHand")], 1]
    return float((hands.max(axis=1) - hips(source.clip)[first : last + 1, 1]).mean())


def _stands(source: Source, stem: str) -> list[Piece]:
    """The calmest stretch of standing, played there and back; arms that do something are let hang."""
    clip = source.clip
    best: tuple[float, int, int] | None = None
    height = hips(clip)[:, 1]
    for seconds in LIMITS.stand_seconds:
        length = round(seconds * clip.fps)
        for first in range(0, len(clip) - length, max(1, length // 3)):
            last = first + length
            if not source.flags[first : last + 1].all() or np.ptp(height[first : last + 1]) > LIMITS.stand_bob:
                continue
            m = measure(clip.slice(first, last + 1), source.flags[first : last + 1])
            if m.speed > LIMITS.stand_speed or m.duck_max > 0.3 or abs(m.bend_mean) > 0.3:
                continue
            unrest = _unrest(source, first, last) + 0.2 / seconds
            if best is None or unrest < best[0]:
                best = (unrest, first, last)
    if best is None:
        return []
    calm = 1.0 if _hands_up(source, best[1], best[2]) > 0.0 else 0.0
    loop = (best[1] / clip.fps, best[2] / clip.fps)
    return [Piece("stand", stem, source.file, (0.0, 2.0 * (loop[1] - loop[0])), loop=loop, calm=calm, back=True)]


def _wrap(angle: float) -> float:
    return float((angle + np.pi) % (2.0 * np.pi) - np.pi)
