"""Drawn corners beside the corners that people walk: what the natural path of a pen has to be like.

    python studies/walking_paths.py

Reads the turning walks of $BUNRAKU_MOCAP (default ../shared/mocap beside the repository). Each walk's way in and way
out are two straight lines; where they meet is the corner that a hand would draw. The table of docs/pen.md: how far the
walked path is from that corner and from the corner as `minimum_jerk` smooths it, for several widths.
"""

import argparse
import os
import sys
from dataclasses import dataclass
from math import pi
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bunraku.motion.bvh import read_bvh
from bunraku.nodes.interpreter.pen_path import minimum_jerk
from bunraku.nodes.interpreter.pen_rules import PenRules

Array = NDArray[np.float64]
FOLDER = Path(os.environ.get("BUNRAKU_MOCAP") or Path(__file__).resolve().parents[2] / "shared" / "mocap")
RULES = PenRules()
SWAY = 0.30
"""s, standard deviation of the low-pass that takes the body's sway from step to step off the path."""
WIDTHS = (0.3, 0.5, 0.7, 0.9)


@dataclass(frozen=True)
class Turn:
    """A walk round one corner."""

    name: str
    path: Array  # (n, 2) m
    speeds: Array  # (n,) m/s
    bends: Array  # (n,) rad/m
    corner: Array  # (2,)
    angle: float  # rad


def smoothed(values: Array, width: float) -> Array:
    """Gaussian low-pass (frames) of (n, k); ends go on straight."""
    radius = min(round(3 * width), len(values) - 1)
    x = np.arange(-radius, radius + 1)
    kernel = np.exp(-0.5 * (x / width) ** 2)
    kernel /= kernel.sum()
    before = 2 * values[0] - values[radius:0:-1]
    after = 2 * values[-1] - values[-2 : -radius - 2 : -1]
    padded = np.concatenate([before, values, after])
    return np.stack([np.convolve(padded[:, k], kernel, "valid") for k in range(values.shape[1])], -1)


def turn_of(file: Path) -> Turn | None:
    """The corner of a clip; None where its two ways do not meet between them."""
    clip = read_bvh(file)
    raw = np.asarray(clip.roots)[:, [0, 2]]
    fps = clip.fps
    path = smoothed(raw, SWAY * fps)
    flow = np.gradient(path, axis=0) * fps
    speeds = np.hypot(flow[:, 0], flow[:, 1])
    heading = np.unwrap(np.arctan2(flow[:, 0], flow[:, 1]))
    bends = np.gradient(heading) * fps / np.maximum(speeds, 0.05)
    end = max(3, round(0.25 * fps))
    first, last = float(heading[:end].mean()), float(heading[-end:].mean())
    angle = abs(last - first)
    if not pi / 5 < angle < 0.8 * pi:
        return None
    a, b = np.array([np.sin(first), np.cos(first)]), np.array([np.sin(last), np.cos(last)])
    s, t = np.linalg.solve(np.stack([a, -b], -1), path[-1] - path[0])
    if s < 0.2 or t > -0.2:
        return None
    return Turn(file.stem, path, speeds, bends, path[0] + s * a, angle)


def line(turn: Turn) -> Array:
    """The corner as a hand would draw it, every 5 cm, with 3 m of the same ways before and after the clip."""
    before, after = turn.path[0] - turn.corner, turn.path[-1] - turn.corner
    knots = np.array([turn.path[0] + 3.0 * before / np.linalg.norm(before), turn.corner,
                      turn.path[-1] + 3.0 * after / np.linalg.norm(after)])  # fmt: skip
    lengths = np.append(0.0, np.cumsum(np.hypot(*np.diff(knots, axis=0).T)))
    at = np.linspace(0.0, lengths[-1], max(3, round(lengths[-1] / RULES.spacing)))
    return np.stack([np.interp(at, lengths, knots[:, k]) for k in range(2)], -1)


def off(path: Array, others: Array) -> float:
    """Root mean square distance (m) of a path's points from the nearest of others."""
    d = np.linalg.norm(path[:, None] - others[None], axis=-1).min(axis=1)
    return float(np.sqrt((d * d).mean()))


def bent(places: Array) -> float:
    """The sharpest bend (rad/m) of places, over a step of 0.3 m."""
    step = np.gradient(places, axis=0)
    gaps = np.hypot(step[:, 0], step[:, 1])
    bend = np.abs(np.gradient(np.unwrap(np.arctan2(step[:, 0], step[:, 1])))) / np.maximum(gaps, 1e-6)
    return float(np.convolve(bend, np.full(7, 1 / 7), "same").max())


def main() -> None:
    """Print the table."""
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    files = sorted((FOLDER / "clips").glob("walkturn*.bvh"))
    turns = [one for one in map(turn_of, files) if one is not None]
    if not turns:
        sys.exit(f"no turning walks in {FOLDER}; set BUNRAKU_MOCAP to the folder that holds clips/")
    cuts = [float(np.linalg.norm(one.path - one.corner, axis=1).min()) for one in turns]
    drops = [float(one.speeds.min() / np.quantile(one.speeds, 0.9)) for one in turns]
    sides = [float((one.speeds**2 * np.abs(one.bends)).max()) for one in turns]
    angles = np.degrees([one.angle for one in turns])
    pace = np.median([one.speeds.mean() for one in turns])
    print(f"{len(turns)} walks round corners of {angles.min():.0f} to {angles.max():.0f} degrees, at {pace:.2f} m/s")
    print(f"corner cut by {np.median(cuts):.2f} m (median; {min(cuts):.2f} to {max(cuts):.2f})")
    print(f"sharpest bend {np.median([np.abs(one.bends).max() for one in turns]):.2f} rad/m, median")
    print(f"slowest {100 * np.median(drops):.0f} % of the speed, median")
    print(f"sideways at most {np.median(sides):.2f} m/s², median (90 %: {np.quantile(sides, 0.9):.2f})\n")
    print("| path | off the walked one, median / 90 % cm | corner cut, median cm | sharpest bend, median rad/m |")
    print("|---|---|---|---|")
    drawn = [line(one) for one in turns]
    rows = [("as drawn", drawn)]
    rows += [(f"natural, {w:g} m", [minimum_jerk(one, w, RULES.spacing, RULES.natural_most) for one in drawn])
             for w in WIDTHS]  # fmt: skip
    for name, paths in rows:
        away = [100 * off(turn.path, path) for turn, path in zip(turns, paths, strict=True)]
        cut = [
            100 * float(np.linalg.norm(path - turn.corner, axis=1).min())
            for turn, path in zip(turns, paths, strict=True)
        ]
        print(f"| {name} | {np.median(away):.1f} / {np.quantile(away, 0.9):.1f} | {np.median(cut):.0f} "
              f"| {np.median([bent(one) for one in paths]):.2f} |")  # fmt: skip


if __name__ == "__main__":
    main()
