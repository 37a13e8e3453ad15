"""Walking and running cycles in a clip, and the key times of other motions.

The legs' phase is read from how far one ankle is ahead of the other along the way gone: it passes zero where
the feet are side by side and peaks near the strikes, at any speed and in any direction. Each strike is then
put where the contact begins. Event names are those of `bunraku.motion.motionset.EVENTS`.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bunraku.motion.analysis import headings, hips
from bunraku.motion.analysis_contacts import Flags, contacts, runs
from bunraku.motion.body import leg_length
from bunraku.motion.clip import Clip

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GaitLimits:
    """What counts as a step and a cycle."""

    stride: float = 0.12  # leg lengths that one ankle gets ahead of the other, at least
    cycle: tuple[float, float] = (0.35, 2.6)  # s
    refine: float = 0.25  # of the half cycle, how far a contact's beginning may be from the peak
    smoothing: float = 0.05  # s
    travel: float = 0.5  # s over which the direction of travel is averaged
    speed: float = 0.15  # m/s of travel, below which the heading gives the direction


LIMITS = GaitLimits()


@dataclass(frozen=True)
class Cycle:
    """One cycle: left strike, right foot passes, right strike, left foot passes, left strike; s in the clip."""

    keys: tuple[float, float, float, float, float]

    @property
    def seconds(self) -> float:
        """How long the cycle takes."""
        return self.keys[-1] - self.keys[0]


def gait_cycles(clip: Clip, flags: Flags | None = None, limits: GaitLimits = LIMITS) -> list[Cycle]:
    """The whole cycles from left strike to left strike, in order; they may share their ends."""
    if len(clip) < 8:
        return []
    on = contacts(clip) if flags is None else flags
    ahead = stride_signal(clip, limits)
    passes = _crossings(ahead, limits.stride * _leg(clip))
    bounds = [0.0, *(at for at, _ in passes), len(clip) - 1.0]
    # Half cycles between passes; which foot is ahead in each (the first and the last may be cut).
    signs = [-1.0 if rising else 1.0 for _, rising in passes[:1]] + [1.0 if rising else -1.0 for _, rising in passes]
    strikes = []
    for k, sign in enumerate(signs):
        foot = 0 if sign > 0.0 else 1
        strikes.append(_strike(ahead, on[:, foot], bounds[k], bounds[k + 1], sign, limits))
    found = []
    for k, sign in enumerate(signs[:-2]):
        start, other, end = strikes[k : k + 3]
        if sign < 0.0 or start is None or other is None or end is None:
            continue
        times = np.array([start, bounds[k + 1], other, bounds[k + 2], end]) / clip.fps
        if np.all(np.diff(times) >= 0.02) and limits.cycle[0] <= times[-1] - times[0] <= limits.cycle[1]:
            found.append(Cycle((float(times[0]), float(times[1]), float(times[2]), float(times[3]), float(times[4]))))
    return found


def stride_signal(clip: Clip, limits: GaitLimits = LIMITS) -> Array:
    """(F,) m: how far the left ankle is ahead of the right one along the way gone."""
    middle = hips(clip)
    places = clip.world[0]
    apart = places[:, clip.skeleton.role("leftFoot")] - places[:, clip.skeleton.role("rightFoot")]
    way = travel_directions(middle, headings(clip), clip.fps, limits)
    return _smoothed(apart[:, 0] * way[:, 0] + apart[:, 2] * way[:, 1], limits.smoothing * clip.fps)


def travel_directions(middle: Array, heading: Array, fps: float, limits: GaitLimits = LIMITS) -> Array:
    """(F, 2) unit x, z of the way gone; the heading's where the figure hardly moves."""
    frames = len(middle)
    half = max(1, round(0.5 * limits.travel * fps))
    at = np.arange(frames)
    first, last = np.maximum(at - half, 0), np.minimum(at + half, frames - 1)
    step = (middle[last] - middle[first])[:, [0, 2]] / ((last - first) / fps)[:, None]
    speed = np.linalg.norm(step, axis=1)
    facing = np.stack([np.sin(heading), np.cos(heading)], axis=1)
    moving = speed > limits.speed
    return np.where(moving[:, None], step / np.where(moving, speed, 1.0)[:, None], facing)


def _leg(clip: Clip) -> float:
    return leg_length(clip.skeleton.offsets, [int(p) for p in clip.skeleton.parents], clip.skeleton.roles)


def _smoothed(values: Array, width: float) -> Array:
    """Averaged over ``width`` frames, shorter at the ends."""
    half = round(0.5 * width)
    total = np.concatenate([[0.0], np.cumsum(values)])
    at = np.arange(len(values))
    reach = np.minimum(half, np.minimum(at, len(values) - 1 - at))
    return np.asarray((total[at + reach + 1] - total[at - reach]) / (2 * reach + 1), dtype=np.float64)


def _crossings(values: Array, threshold: float) -> list[tuple[float, bool]]:
    """Zero crossings (frame, rising) between extremes that pass ``threshold``."""
    beyond = np.flatnonzero(np.abs(values) > threshold)
    found = []
    for a, b in pairwise(beyond.tolist()):
        if values[a] * values[b] < 0.0:
            inside = np.arange(a, b)
            change = inside[values[inside] * values[inside + 1] <= 0.0]
            if len(change) == 0:
                continue
            k = int(change[len(change) // 2])
            step = values[k + 1] - values[k]
            at = k + (-values[k] / step if step else 0.5)
            found.append((float(at), bool(values[b] > 0.0)))
    return found


def _strike(ahead: Array, on: Flags, first: float, last: float, sign: float, limits: GaitLimits) -> float | None:
    """The frame of the strike between two passes: where the contact begins, else the peak; None where cut off."""
    low, high = int(np.ceil(first)), int(np.floor(last))
    if high <= low:
        return None
    peak = low + int(np.argmax(sign * ahead[low : high + 1]))
    near = [a for a, _ in runs(on) if a > 0 and low <= a <= high and abs(a - peak) <= limits.refine * (high - low) + 2]
    if near:
        return float(min(near, key=lambda a: abs(a - peak)))
    inside = 1 < peak < len(ahead) - 2
    return float(peak) if inside and not on[:peak].all() else None


def swings(flags: Flags, fps: float, shortest: float = 0.08) -> list[tuple[int, int, int]]:
    """Each time a foot leaves the ground and comes back: (foot 0/1, first frame off, strike frame), by time."""
    found = []
    for foot in range(2):
        for first, last in runs(np.logical_not(flags[:, foot])):
            if first > 0 and last < len(flags) and last - first >= shortest * fps:
                found.append((foot, first, last))
    return sorted(found, key=lambda swing: swing[1])


def jump_keys(clip: Clip, flags: Flags) -> tuple[float, ...] | None:
    """Key times (s) of a jump: begin, deepest, take-off, apex, landing, end; None when no jump is there.

    The flight is the longest time with no foot on the ground and its hips rising; begin and end are where
    the hips are about to sink and have settled again.
    """
    air = [(a, b) for a, b in runs(np.logical_not(flags.any(axis=1))) if a > 0 and b < len(clip)]
    air = [(a, b) for a, b in air if b - a >= 0.08 * clip.fps]
    if not air:
        return None
    off, land = max(air, key=lambda run: run[1] - run[0])
    height = hips(clip)[:, 1]
    apex = off + int(np.argmax(height[off : land + 1]))
    reach = round(1.2 * clip.fps)
    start = max(0, off - reach)
    deepest = start + int(np.argmin(height[start : off + 1]))
    before = max(0, deepest - reach)
    drop = float(height[before : deepest + 1].max() - height[deepest])
    begin = (
        before + _last_where(height[before : deepest + 1] > height[deepest] + 0.93 * drop) if drop > 0.01 else before
    )
    finish = min(len(clip) - 1, land + reach)
    sunk = land + int(np.argmin(height[land : finish + 1]))
    rise = float(height[sunk : finish + 1].max() - height[sunk])
    up = np.flatnonzero(height[sunk : finish + 1] > height[sunk] + 0.93 * rise)
    end = sunk + int(up[0]) if rise > 0.01 and len(up) else finish
    keys = np.array([begin, deepest, off, min(max(apex, off + 1), land - 1), land, max(end, land + 1)]) / clip.fps
    return tuple(float(key) for key in keys) if np.all(np.diff(keys) > 0.0) and keys[-1] <= clip.duration else None


def _last_where(flags: Flags) -> int:
    at = np.flatnonzero(flags)
    return int(at[-1]) if len(at) else 0


def step_keys(clip: Clip, flags: Flags) -> tuple[int, tuple[float, ...]] | None:
    """The leading foot (0 left, 1 right) and the key times of two swings, of one foot and then of the other.

    Begin, the leading foot's first time off the ground and strike, the other's last, end; None when the clip is
    no such step. Small shuffles between are part of what is between the key times.
    """
    moves = swings(flags, clip.fps)
    if not moves:
        return None
    lead = moves[0]
    follows = [swing for swing in moves if swing[0] != lead[0] and swing[1] >= lead[1] + 1]
    if not follows:
        return None
    follow = follows[-1]
    margin = 0.25 * clip.fps
    begin = max(0.0, lead[1] - margin)
    end = min(len(clip) - 1.0, follow[2] + margin)
    middle = sorted([float(lead[2]), float(follow[1])])
    if middle[1] - middle[0] < 1.0:
        middle[1] = middle[0] + 1.0
    keys = np.array([begin, lead[1], middle[0], middle[1], follow[2], end]) / clip.fps
    if np.any(np.diff(keys) <= 0.0) or keys[-1] > clip.duration + 1e-9:
        return None
    return lead[0], tuple(float(key) for key in keys)
