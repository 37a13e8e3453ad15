"""Where the feet are and when they are on the ground, from a clip's own numbers.

A foot is on the ground while a point of its sole is low and slow; both thresholds have hysteresis, and the
floor follows the soles' lowest places within seconds, so that captures on a sloping floor keep their contacts.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bunraku.motion import rotation as rot
from bunraku.motion.clip import Clip
from bunraku.motion.ground import sole_of

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

SIDES = ("left", "right")


@dataclass(frozen=True)
class ContactLimits:
    """When a foot is on the ground."""

    height_on: float = 0.035  # m of heel or ball above the floor
    height_off: float = 0.06
    speed_share: float = 0.25  # of the foot's own highest speed nearby, below which it may be standing
    speed_off: tuple[float, float] = (0.3, 1.1)  # m/s, bounds of that
    speed_on: float = 0.6  # of the speed that ends a contact, the one that begins it
    smoothing: float = 0.05  # s, over which the speed is averaged
    window: float = 0.8  # s before and after: nearby
    slope: float = 0.06  # m that the floor may rise or fall over a clip
    shortest: float = 0.06  # s of a contact or of a gap between two


LIMITS = ContactLimits()


def sole_points(clip: Clip) -> Array:
    """(F, 2, 3, 3) m: world places of heel, ball and toe tip of the left and right sole.

    Heel and ball move with the foot, the tip with the toes; at rest all three are on the floor.
    """
    places, turns = clip.world
    rest = clip.skeleton.rest_positions
    out = np.empty((len(clip), 2, 3, 3))
    for k, side in enumerate(SIDES):
        sole = sole_of(clip.skeleton, side)
        ankle = float(rest[sole.ankle, 1])
        for p, forward in enumerate((sole.heel, sole.ball)):
            out[:, k, p] = places[:, sole.ankle] + rot.rotate(turns[:, sole.ankle], (0.0, -ankle, forward))
        if sole.toes >= 0:
            tip = (0.0, -float(rest[sole.toes, 1]), sole.tip - sole.ball)
            out[:, k, 2] = places[:, sole.toes] + rot.rotate(turns[:, sole.toes], tip)
        else:
            out[:, k, 2] = places[:, sole.ankle] + rot.rotate(turns[:, sole.ankle], (0.0, -ankle, sole.tip))
    return out


def floor_height(clip: Clip) -> float:
    """m: the floor's height: the 5th percentile over time of the lowest ankle or toe joint, less its height at rest.

    The joints rather than the soles, because captured toes often point through the floor.
    """
    joints = foot_joints(clip)
    heights = clip.world[0][:, joints, 1] - clip.skeleton.rest_positions[joints, 1]
    return float(np.percentile(heights.min(axis=1), 5))


def foot_joints(clip: Clip) -> list[int]:
    """The ankles and toe joints."""
    roles = clip.skeleton.roles
    return [roles[side + part] for side in SIDES for part in ("Foot", "Toes") if side + part in roles]


def on_floor(clip: Clip) -> Clip:
    """Raised or lowered so that `floor_height` is 0."""
    shift = np.array([0.0, floor_height(clip), 0.0])
    return Clip(clip.name, clip.skeleton, clip.fps, clip.roots - shift, clip.rotations)


def contacts(clip: Clip, limits: ContactLimits = LIMITS) -> Flags:
    """(F, 2) whether the left and the right foot is on the ground in each frame."""
    points = sole_points(clip)[:, :, :2]  # the toes' tip often goes through the floor when a foot pushes off
    speeds = point_speeds(points, clip.fps, limits.smoothing)
    off = np.clip(limits.speed_share * _nearby_highest(speeds.min(axis=2), clip.fps, limits), *limits.speed_off)[
        :, :, None
    ]
    slow = speeds < limits.speed_on * off
    heights = points[..., 1] - _floor(points[..., 1], slow, clip.fps, limits)
    on: Flags = np.any((heights < limits.height_on) & slow, axis=2)
    stay: Flags = np.any((heights < limits.height_off) & (speeds < off), axis=2)
    shortest = max(1, round(limits.shortest * clip.fps))
    flags = np.empty((len(clip), 2), dtype=np.bool_)
    for k in range(2):
        flags[:, k] = _without_short(_hysteresis(on[:, k], stay[:, k]), shortest)
    return flags


def point_speeds(points: Array, fps: float, smoothing: float) -> Array:
    """(F, ...) m/s: speeds of points (F, ..., 3), averaged over ``smoothing`` seconds."""
    frames = len(points)
    if frames < 2:
        return np.zeros(points.shape[:-1])
    half = max(1, round(0.5 * smoothing * fps))
    at = np.arange(frames)
    first, last = np.maximum(at - half, 0), np.minimum(at + half, frames - 1)
    seconds = ((last - first) / fps).reshape(-1, *[1] * (points.ndim - 2))
    return np.asarray(np.linalg.norm(points[last] - points[first], axis=-1) / seconds, dtype=np.float64)


def _nearby_highest(values: Array, fps: float, limits: ContactLimits) -> Array:
    """(F, ...) the highest value within the window around each frame."""
    from scipy.ndimage import maximum_filter1d

    return np.asarray(maximum_filter1d(values, _width(len(values), fps, limits), axis=0, mode="nearest"))


def _width(frames: int, fps: float, limits: ContactLimits) -> int:
    return min(2 * max(1, round(limits.window * fps)) + 1, 2 * frames + 1)


def _floor(heights: Array, slow: Flags, fps: float, limits: ContactLimits) -> Array:
    """(F, 2, 2) m: the floor under heel and ball of each foot: the lowest slow place nearby.

    Each point has a floor of its own, because captured ankles and toes differ in height at rest by centimetres.
    """
    from scipy.ndimage import minimum_filter1d

    rested = np.where(slow, heights, np.inf)
    lowest = np.percentile(heights, 5, axis=0)
    base = np.array([[_low(rested[:, k, p], lowest[k, p]) for p in range(2)] for k in range(2)])
    # A foot that is in the air all the time has no floor of its own.
    base = np.minimum(base, base.min(axis=0) + limits.slope)
    near = minimum_filter1d(rested, _width(len(heights), fps, limits), axis=0, mode="nearest")
    near = np.where(np.isfinite(near), near, base)
    return np.asarray(np.clip(near, base - limits.slope, base + limits.slope), dtype=np.float64)


def _low(heights: Array, otherwise: float) -> float:
    """The 10th percentile of finite heights; ``otherwise`` where there are hardly any."""
    there = heights[np.isfinite(heights)]
    return float(np.percentile(there, 10)) if len(there) >= 3 else otherwise


def _hysteresis(on: Flags, stay: Flags) -> Flags:
    """True from where ``on`` holds for as long as ``stay`` does, forwards and backwards."""
    flags = np.array(on)
    # A run of ``stay`` belongs to the contact as soon as ``on`` holds anywhere in it.
    for first, last in runs(stay | on):
        flags[first:last] = on[first:last].any()
    return flags


def _without_short(flags: Flags, shortest: int) -> Flags:
    """Gaps, then runs, shorter than ``shortest`` frames are taken out; those at the ends stay."""
    out = np.array(flags)
    for value in (False, True):
        for first, last in runs(out == value):
            if last - first < shortest and first > 0 and last < len(out):
                out[first:last] = not value
    return out


def runs(flags: Flags) -> list[tuple[int, int]]:
    """The runs of True as (first, one past the last)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def foot_skate(clip: Clip, flags: Flags | None = None) -> float:
    """m/s: mean horizontal speed of the slowest sole point of feet that are on the ground; 0 when none is."""
    on = contacts(clip) if flags is None else flags
    points = np.array(sole_points(clip))
    points[..., 1] = 0.0
    slow = point_speeds(points, clip.fps, 0.0).min(axis=2)
    return float(slow[on].mean()) if on.any() else 0.0
