"""Parameters of motion modules: their measured values, and the space in which they are blended.

A way gone is given as ``angle`` and ``distance``, but blended as the vector it is: weights reproduce linear
functions of the blending space exactly, so between two examples lies the way between theirs, none cut short.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bunraku.motion.analysis import headings, hips, measure
from bunraku.motion.clip import Clip

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class CyclePath:
    """The arc that a cycle's body moves along at constant speed and turn rate, its sway taken off."""

    speed: float  # m/s
    turn: float  # rad/s
    places: Array  # (F, 2) m, x and z
    directions: Array  # (F,) rad, of the arc; 0 is +Z, positive to the left


def cycle_path(places: Array, facing: Array, fps: float) -> CyclePath:
    """The arc of a cycle's places (F, 2; x and z, m) and headings (F; rad); first and last frame are one phase.

    A cycle is carried on by the motion from its first to its last frame: a turn about a centre, or a shift. Seen from
    that moving frame the body only sways, about the place whose arc this is.
    """
    frames = len(places) - 1
    span = frames / fps
    turned = float(facing[-1] - facing[0])
    share = np.arange(frames + 1) / frames
    way = places[-1] - places[0]
    # (x, z) turned by a: headings turn +Z toward +X.
    c, s = np.cos(turned), np.sin(turned)
    if abs(turned) > 0.02:
        # centre = R (centre - first) + last
        lhs = np.array([[1.0 - c, -s], [s, 1.0 - c]])
        centre = np.linalg.solve(lhs, places[-1] - np.array([[c, s], [-s, c]]) @ places[0])
        angle = turned * share
        d = places - centre
        still = np.stack([d[:, 0] * np.cos(angle) - d[:, 1] * np.sin(angle),
                          d[:, 0] * np.sin(angle) + d[:, 1] * np.cos(angle)], -1)  # fmt: skip
        arm = still[:-1].mean(axis=0)
        x = arm[0] * np.cos(angle) + arm[1] * np.sin(angle)
        z = -arm[0] * np.sin(angle) + arm[1] * np.cos(angle)
        base = centre + np.stack([x, z], -1)
        speed = abs(turned) / span * float(np.hypot(*arm))
        sign = np.sign(turned)
        first = float(np.arctan2(sign * arm[1], -sign * arm[0]))
    else:
        angle = turned * share
        mean = (places - share[:, None] * way)[:-1].mean(axis=0)
        base = mean + share[:, None] * way
        speed = float(np.hypot(*way)) / span
        first = float(np.arctan2(way[0], way[1])) - 0.5 * turned
    middle = float(np.mean((facing - turned * share)[:-1]))
    if speed * span < 0.25 * 0.83:  # hardly moves: the direction is the body's own
        first = middle
    first = middle + (first - middle + np.pi) % (2.0 * np.pi) - np.pi
    return CyclePath(speed, turned / span, base, first + angle)


def arc_speed(clip: Clip) -> float:
    """m/s of a cycle along its path, without the sway to either side of it."""
    return cycle_path(hips(clip)[:, [0, 2]], headings(clip), clip.fps).speed if len(clip) > 1 else 0.0


def measured(parameters: Sequence[str], clip: Clip, flags: Flags, *, turns: bool = False) -> Array:
    """(m,) a clip's values of the named parameters (`bunraku.motion.motionset.MODULES` says what they mean).

    ``turns``: the parameter ``angle`` is how far the figure turned, not which way it went.
    """
    found = measure(clip, flags)
    turned = headings(clip)
    values = {
        "speed": arc_speed(clip) if "speed" in parameters else 0.0,
        "turn": found.turn_rate,
        "tilt": found.tilt_mean,
        "bend": found.bend_mean,
        "duck": found.duck_mean,
        "angle": float(turned[-1] - turned[0]) if turns else found.direction,
        "distance": found.distance,
        "height": found.rise,
    }
    return np.array([values[name] for name in parameters])


def embed(parameters: Sequence[str], values: ArrayLike) -> Array:
    """(..., m) parameter values to the blending space: angle and distance become (left, forward) m."""
    out = np.array(values, dtype=np.float64)
    if "angle" in parameters and "distance" in parameters:
        a, d = list(parameters).index("angle"), list(parameters).index("distance")
        angle, distance = out[..., a].copy(), out[..., d].copy()
        out[..., a], out[..., d] = distance * np.sin(angle), distance * np.cos(angle)
    return out


def unembed(parameters: Sequence[str], place: ArrayLike) -> Array:
    """(..., m) the inverse of `embed`."""
    out = np.array(place, dtype=np.float64)
    if "angle" in parameters and "distance" in parameters:
        a, d = list(parameters).index("angle"), list(parameters).index("distance")
        left, ahead = out[..., a].copy(), out[..., d].copy()
        out[..., a], out[..., d] = np.arctan2(left, ahead), np.hypot(left, ahead)
    return out
