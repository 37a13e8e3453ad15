"""Choose the examples of each module among what was found in captures, and make those that are missing."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bunraku.motion.build_recipe import Piece

Array = NDArray[np.float64]

STRAIGHT = 0.35
"""rad/s of turn, below which a walk is straight."""
MADE = 0.3
"""How much worse a mirrored piece is than a captured one (standard deviations of what it adds to a module)."""
COUNTS = {"locomotion": 16, "step_left": 10, "step_right": 10, "jump_forward": 6, "jump_back": 4, "jump_left": 6,
          "jump_right": 6, "jump_up": 3, "turn_left": 4, "turn_right": 4}  # fmt: skip
"""Examples that a module should have: table 2 of the paper, and some more."""


@dataclass(frozen=True, eq=False)
class Found:
    """A candidate with its measured values."""

    piece: Piece
    values: Array
    quality: float  # smaller is better


def choose(found: dict[str, list[Found]], notes: list[str]) -> list[Piece]:
    """The pieces of a set from candidates by module; ``notes`` gets a line about what was made."""
    out: list[Piece] = []
    walks = found.get("locomotion", [])
    if walks:
        out += _locomotion(walks, notes)
    stands = found.get("stand", [])
    if stands:
        out += _standing(stands)
    out += _steps(found, stands, notes)
    out += _jumping(found, notes)
    out += _turning(found, stands, notes)
    out += _canonical(walks, found)
    return out


def spread(found: Sequence[Found], count: int, scale: Array, first: int | None = None) -> list[Found]:
    """``count`` candidates that cover the range: each the farthest from those taken, in units of ``scale``."""
    if not found:
        return []
    values = np.stack([f.values for f in found]) / scale
    quality = np.array([f.quality + (MADE if f.piece.made else 0.0) for f in found])
    taken = [
        int(np.argmin(np.linalg.norm(values - np.median(values, axis=0), axis=1) + quality)) if first is None else first
    ]
    while len(taken) < min(count, len(found)):
        near = np.min(np.linalg.norm(values[:, None] - values[None, taken], axis=-1), axis=1)
        near[taken] = -np.inf
        best = int(np.argmax(near - quality))
        if near[best] < 0.35:
            break
        taken.append(best)
    return [found[k] for k in taken]


def _locomotion(walks: list[Found], notes: list[str]) -> list[Piece]:
    """A spread of walks and runs, and walks leaning, bent and ducked where none was captured."""
    scale = np.array([0.6, 0.6, 0.20, 0.30, 0.35])
    straight = [w for w in walks if abs(w.values[1]) < STRAIGHT]
    base = min(
        straight or walks, key=lambda w: abs(w.values[0] - 1.2) + 4.0 * w.quality + (0.3 if w.piece.made else 0.0)
    )
    taken = spread(walks, COUNTS["locomotion"], scale, walks.index(base))
    pieces = [w.piece for w in taken]
    values = np.stack([w.values for w in taken])
    # A turn to one side without its like on the other is mirrored.
    for w in taken:
        if abs(w.values[1]) > STRAIGHT:
            other = w.values * np.array([1.0, -1.0, -1.0, 1.0, 1.0])
            if np.min(np.linalg.norm((values - other) / scale, axis=1)) > 0.8:
                like = [m for m in walks if m.piece.mirrored and m.piece.file == w.piece.file]
                if like:
                    apart = [float(np.linalg.norm((m.values - other) / scale)) for m in like]
                    twin = like[int(np.argmin(apart))]
                    if twin.piece in pieces:
                        continue
                    pieces.append(twin.piece)
                    values = np.vstack([values, twin.values])
    b = base.piece
    slow, fast = base, max(straight or [base], key=lambda w: w.values[0] - 8.0 * w.quality)
    made: list[tuple[str, Piece]] = []
    if straight and values[:, 0].min() > 0.2:
        upright = [w for w in straight if w.values[3] < 0.35 and w.values[4] < 0.5] or straight
        s = min(upright, key=lambda w: abs(w.values[0] - 0.8) + 4.0 * w.quality + (0.3 if w.piece.made else 0.0))
        made += [("slow", replace(s.piece, name=f"{s.piece.name}_in_place", slow=1.0))]
    if values[:, 2].max() < 0.2:
        made += [("tilt", replace(b, name=f"{b.name}_tilt_left", tilt=20.0))]
    if values[:, 2].min() > -0.2:
        made += [("tilt", replace(b, name=f"{b.name}_tilt_right", tilt=-20.0))]
    if values[:, 3].max() < 0.5:
        made += [("bend", replace(b, name=f"{b.name}_bent", bend=35.0))]
    if values[:, 3].min() > -0.15:
        made += [("bend", replace(b, name=f"{b.name}_stretched", bend=-16.0))]
    if values[:, 4].max() < 0.7:
        made += [("duck", replace(b, name=f"{b.name}_ducked", duck=0.7))]
    if fast is not slow and fast.values[0] > 2.2:
        f = fast.piece
        made += [("tilt", replace(f, name=f"{f.name}_tilt_left", tilt=14.0)),
                 ("tilt", replace(f, name=f"{f.name}_tilt_right", tilt=-14.0))]  # fmt: skip
    if made:
        notes.append(f"locomotion: made by editing: {', '.join(p.name for _, p in made)}")
    return pieces + [piece for _, piece in made]


def _standing(stands: list[Found]) -> list[Piece]:
    """The calmest stand, and the same leaning, bent and ducked."""
    best = min(stands, key=lambda s: s.quality)
    b = best.piece
    return [
        b,
        replace(b, name=f"{b.name}_tilt_left", tilt=26.0),
        replace(b, name=f"{b.name}_tilt_right", tilt=-26.0),
        replace(b, name=f"{b.name}_bent", bend=55.0),
        replace(b, name=f"{b.name}_stretched", bend=-18.0),
        replace(b, name=f"{b.name}_ducked", duck=0.9),
        replace(b, name=f"{b.name}_ducked_bent", duck=0.8, bend=40.0),
    ]


STEP_TIMES = (0.0, 0.12, 0.52, 0.60, 1.00, 1.20)
"""s of a step made from standing: begin, the leading foot off and down, the other one off and down, end."""

TURN_TIMES = (0.0, 0.12, 0.45, 0.52, 0.85, 1.05)
"""s of a turn made from standing, likewise."""
SMALL_TURNS = (10.0, 45.0, 90.0)
"""degrees"""


def _steps(found: dict[str, list[Found]], stands: list[Found], notes: list[str]) -> list[Piece]:
    """Captured steps, and from standing those in the directions and of the lengths that are missing."""
    out = []
    base = min(stands, key=lambda s: s.quality).piece if stands else None
    for module, sign in (("step_left", 1.0), ("step_right", -1.0)):
        mine = sorted((f for f in found.get(module, []) if not f.piece.calm), key=lambda f: f.quality)[:6]
        made = []
        if base is not None:
            for angle in (0.0, 45.0, 90.0, 135.0, 180.0):
                for distance in (0.3, 0.65 if angle < 60.0 else 0.5):
                    if not any(_near(f, sign * np.radians(angle), distance) for f in mine):
                        name = f"{module}_{angle:.0f}_{distance * 100:.0f}cm"
                        made.append(replace(base, module=module, name=name, keys=STEP_TIMES, angle=sign * angle,
                                            distance=distance, lift=0.07 + 0.06 * distance))  # fmt: skip
        out += [f.piece for f in mine] + made
        if out:
            notes.append(f"{module}: {len(mine)} captured, {len(made)} made from standing")
    return out


def _near(f: Found, angle: float, distance: float) -> bool:
    here = f.values[1] * np.exp(1j * f.values[0])
    return bool(abs(here - distance * np.exp(1j * angle)) < 0.10)


def _jumping(found: dict[str, list[Found]], notes: list[str]) -> list[Piece]:
    """Captured jumps; sideways and backward ones are carried there from a jump straight up."""
    out: list[Piece] = []
    ups = sorted(found.get("jump_up", []), key=lambda f: float(f.values[0]))
    forwards = found.get("jump_forward", [])
    base = (min(ups, key=lambda f: abs(float(f.values[0]) - 0.4)) if ups else None) or (
        min(forwards, key=lambda f: float(f.values[1])) if forwards else None
    )
    if base is None:
        return out
    grid = {"jump_forward": ((-40.0, 0.0, 40.0), (0.45, 1.0)), "jump_back": ((150.0, 180.0, 210.0), (0.3, 0.55)),
            "jump_left": ((50.0, 90.0, 130.0), (0.3, 0.65)),
            "jump_right": ((-50.0, -90.0, -130.0), (0.3, 0.65))}  # fmt: skip
    scale = np.array([0.5, 0.35])
    for module, (angles, reaches) in grid.items():
        mine = spread(found.get(module, []), COUNTS[module], scale)
        made = [
            replace(
                base.piece,
                module=module,
                name=f"{module}_{angle:.0f}_{reach * 100:.0f}cm",
                angle=angle,
                distance=reach,
            )
            for angle in angles
            for reach in reaches
            if not any(_near(f, np.radians(angle), reach) for f in mine)
        ]
        out += [f.piece for f in mine] + made
        notes.append(f"{module}: {len(mine)} captured, {len(made)} carried from {base.piece.name}")
    if ups:
        apart = [ups[0]] + [b for a, b in pairwise(ups) if b.values[0] - a.values[0] > 0.03]
        out += [f.piece for f in apart[-COUNTS["jump_up"] :]]
    return out


def _turning(found: dict[str, list[Found]], stands: list[Found], notes: list[str]) -> list[Piece]:
    """Turns to both sides; those of one side mirrored where the other has too few, small ones made from standing."""
    out: list[Piece] = []
    base = min(stands, key=lambda s: s.quality).piece if stands else None
    for module, other in (("turn_left", "turn_right"), ("turn_right", "turn_left")):
        mine = spread(found.get(module, []), COUNTS[module], np.array([0.5]))
        made: list[tuple[float, Piece]] = []
        for f in sorted(found.get(other, []), key=lambda f: f.quality):
            if len(mine) + len(made) >= COUNTS[module]:
                break
            angle = -float(f.values[0])
            if all(abs(angle - float(m.values[0])) > 0.3 for m in mine) and all(abs(angle - a) > 0.3 for a, _ in made):
                piece = replace(f.piece, module=module, name=f"{f.piece.name}_mirrored", mirrored=not f.piece.mirrored)
                made.append((angle, piece))
        sign = 1.0 if module == "turn_left" else -1.0
        angles = [abs(float(f.values[0])) for f in mine] + [abs(angle) for angle, _ in made]
        small = [
            replace(base, module=module, name=f"{module}_{angle:.0f}", keys=TURN_TIMES, turn=sign * angle, lift=0.05)
            for angle in SMALL_TURNS
            if base is not None and np.radians(angle) < min(angles, default=np.pi) - 0.3
        ]
        if mine or made or small:
            out += [f.piece for f in mine] + [piece for _, piece in made] + small
            notes.append(f"{module}: {len(mine)} captured, {len(made)} mirrored, {len(small)} made from standing")
    return out


def _canonical(walks: list[Found], found: dict[str, list[Found]]) -> list[Piece]:
    """One straight example of each way of going and jumping."""
    out = []
    straight = [replace(w, quality=w.quality + (MADE if w.piece.made else 0.0)) for w in walks]
    straight = [w for w in straight if abs(w.values[1]) < STRAIGHT]

    def take(name: str, f: Found | None, march: float = 0.0) -> None:
        """Add what was found as the canonical clip ``name``; ``march`` rad that its thighs are raised more."""
        if f is not None:
            out.append(replace(f.piece, module="canonical", name=name, march=march))

    if straight:
        upright = [w for w in straight if w.values[3] < 0.35 and w.values[4] < 0.5] or straight
        runs_ = [w for w in straight if w.values[0] > 2.2]
        take("walk", min(upright, key=lambda w: abs(w.values[0] - 1.3) + 2.0 * w.quality))
        if runs_:
            take("jog", min(runs_, key=lambda w: w.values[0] + 2.0 * w.quality))
            take("run", max(runs_, key=lambda w: w.values[0] - 2.0 * w.quality))
        sneaks = [w for w in straight if w.values[0] < 1.2 and w.values[3] + 0.5 * w.values[4] > 0.3]
        if sneaks:
            take("sneak", min(sneaks, key=lambda w: w.quality - w.values[3]))
        take("march", min(upright, key=lambda w: abs(w.values[0] - 1.1) + 2.0 * w.quality), march=0.28)
    ups, ahead = found.get("jump_up", []), found.get("jump_forward", [])
    take("jump_up", max(ups, key=lambda f: float(f.values[0])) if ups else None)
    if ahead:
        take("short_jump", min(ahead, key=lambda f: abs(float(f.values[1]) - 0.8)))
        take("long_jump", max(ahead, key=lambda f: float(f.values[1])))
    return out
