"""Captured feet slide while they stand, by a centimetre and more: here each is held on one print instead.

The print lies where the foot stood on average. While the foot is down it rolls over heel and ball about that print;
in the air what it was moved by passes over to what it is moved by next (Kovar, Schreiner, Gleicher 2002: footskate
clean-up). Turn and pitch of the foot and its height stay as captured.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bunraku.motion import rotation as rot
from bunraku.motion.analysis_contacts import SIDES, Flags, runs
from bunraku.motion.build_edit import closed, feet_of, repeated, with_legs
from bunraku.motion.clip import Clip
from bunraku.motion.ground import sole_of

Array = NDArray[np.float64]

AHEAD = np.array([0.0, 0.0, 1.0])
FASTEST = 0.5
"""m/s: what a foot is moved by changes no faster than this where it leaves its print and comes to it."""


def prints(clip: Clip) -> Array:
    """(F, 2, 2) m: where (x, z) each ankle would be if the foot were put flat, on the point of the sole that bears it.

    The heel bears while the toes point up, the ball of the foot while they point down.
    """
    ankles, feet = feet_of(clip)
    out = np.empty((len(clip), 2, 2))
    for foot, side in enumerate(SIDES):
        sole = sole_of(clip.skeleton, side)
        ahead = rot.rotate(feet[:, foot], AHEAD)
        pivot = np.where(ahead[:, 1] >= 0.0, sole.heel, sole.ball)
        arm = np.stack([np.zeros(len(clip)), np.full(len(clip), -sole.height), pivot], axis=1)
        flat = ahead[:, [0, 2]] / np.maximum(np.linalg.norm(ahead[:, [0, 2]], axis=1, keepdims=True), 1e-9)
        out[:, foot] = (ankles[:, foot] + rot.rotate(feet[:, foot], arm))[:, [0, 2]] - pivot[:, None] * flat
    return out


def planted(clip: Clip, flags: Flags, cycle: bool = False) -> Clip:
    """The clip with feet that stay where they stand.

    Args:
        flags: (F, 2) when the left and the right foot is on the ground.
        cycle: the clip is closed and goes on at its end as it began.
    """
    frames = len(clip)
    whole, on = clip, flags
    if cycle:  # a stance may go over the end: as it is in the midst of three repetitions
        whole, on = repeated(clip, 3), np.concatenate([flags, flags[1:], flags[1:]])
    marks = prints(whole)
    ankles, feet = feet_of(whole)
    for foot in range(2):
        ankles[:, foot][:, [0, 2]] += _moved(marks[:, foot], on[:, foot], whole.fps)
    out = with_legs(whole, ankles, feet)
    return _brought_back(closed(out.slice(frames - 1, 2 * frames - 1)), clip) if cycle else out


def _brought_back(clip: Clip, first: Clip) -> Clip:
    """A later repetition carried to where the first one began."""
    back = rot.yaw(rot.heading(first.rotations[0, 0]) - rot.heading(clip.rotations[0, 0]))
    start = clip.roots[0] * (1.0, 0.0, 1.0)
    rotations = np.array(clip.rotations)
    rotations[:, 0] = rot.mul(back, rotations[:, 0])
    return replace(
        clip, roots=rot.rotate(back, clip.roots - start) + first.roots[0] * (1.0, 0.0, 1.0), rotations=rotations
    )


def _moved(marks: Array, on: Flags, fps: float) -> Array:
    """(F, 2) m by which one foot is moved: onto its print while it is down, smoothly over to the next one between."""
    out = np.zeros_like(marks)
    stances = runs(on)
    for first, last in stances:
        out[first:last] = marks[first:last].mean(axis=0) - marks[first:last]
    if not stances:
        return out
    out[: stances[0][0]] = out[stances[0][0]]
    out[stances[-1][1] :] = out[stances[-1][1] - 1]
    for (a, b), (c, d) in pairwise(stances):
        span = c - (b - 1)
        t = (np.arange(b, c) - (b - 1))[:, None] / span
        most = FASTEST / fps
        leaving = np.clip(out[b - 1] - out[max(b - 2, a)], -most, most) * span
        coming = np.clip(out[min(c + 1, d - 1)] - out[c], -most, most) * span
        out[b:c] = (
            (2.0 * t**3 - 3.0 * t**2 + 1.0) * out[b - 1] + (3.0 * t**2 - 2.0 * t**3) * out[c]
            + (t**3 - 2.0 * t**2 + t) * leaving + (t**3 - t**2) * coming
        )  # fmt: skip
    return out
