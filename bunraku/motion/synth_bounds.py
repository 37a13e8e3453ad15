"""Generated bodies kept within their own bounds: arms out of trunk and legs, ankles within their range of motion."""

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.limits import limits_of
from bunraku.figure.rig import rig_of
from bunraku.figure.skeleton import Skeleton
from bunraku.motion import rotation as rot
from bunraku.motion.clip import Clip

Array = NDArray[np.float64]

SIDES = ("left", "right")
TOUCH = 0.004  # m that arms may be in the body: boxes have corners that bodies have not
SHARE = 0.97  # of its range that an ankle may use
DONE = 1e-3  # rad beyond that which is left as it is
ANKLE_TRIES = 12
"""How often feet are pitched anew until their ankles are within their range."""
_GRID = np.stack(np.meshgrid(*(np.linspace(-1.0, 1.0, n) for n in (7, 3, 5)), indexing="ij"), -1).reshape(-1, 3)


def eased(lack: Array, radius: int, closed: bool) -> Array:
    """A smooth curve (F) at least ``lack`` (F) and little more: its largest within ``radius`` frames, rounded.

    Of a ``closed`` curve the last frame is the first again; any other one is held at its ends.
    """
    if lack.max() <= 0.0:
        return np.zeros_like(lack)
    row = lack[:-1] if closed else lack
    wide = np.pad(row, 2 * radius, mode="wrap" if closed else "edge")
    widest = np.array([wide[k : k + 2 * radius + 1].max() for k in range(len(row) + 2 * radius)])
    kernel = np.hanning(2 * radius + 3)[1:-1]
    smooth = np.convolve(widest, kernel / kernel.sum(), "valid")
    return np.append(smooth, smooth[0]) if closed else smooth


def pitched_more(clip: Clip, closed: bool = False) -> Array:
    """(2, F) rad, smooth, by which the feet are to be pitched (toes up positive) for their ankles' range.

    It is not all that is needed where the leg changes with the pitch of its foot: to be repeated till nothing is.
    """
    lack = ankles_beyond(clip)
    if np.abs(lack).max() < DONE:
        return np.zeros_like(lack)
    return np.stack([eased(np.maximum(row, 0.0), 2, closed) - eased(np.maximum(-row, 0.0), 2, closed) for row in lack])


def _axes(turns: Array) -> Array:
    """(F, 3, 3) of rotations (F, 4): each one's axes in the world, a row each."""
    return np.stack([rot.rotate(turns, axis) for axis in np.eye(3)], axis=1)


def arms_in_body(clip: Clip) -> Array:
    """(2, F) rad by which either arm has to be lifted aside, about, to be out of trunk and legs."""
    skeleton = clip.skeleton
    rig = rig_of(skeleton)
    places, turns = clip.world
    body = [0, *(int(j) for j in rig.back), *(int(j) for limb in rig.limbs[2:] for j in limb[:2])]
    arms = [(side, int(j)) for side in range(2) for j in rig.limbs[side, 1:]]
    boxed = [j for j in body if skeleton.box_sizes[j].any()]
    axes = {j: _axes(turns[:, j]) for j in {*boxed, *(j for _, j in arms)}}
    out = np.zeros((2, len(clip)))
    for side, joint in arms:
        size = skeleton.box_sizes[joint]
        middle = places[:, joint] + skeleton.box_centers[joint] @ axes[joint]
        for other in boxed:
            half = skeleton.box_sizes[other]
            from_box = middle - places[:, other] - skeleton.box_centers[other] @ axes[other]
            seen = (axes[other] @ from_box[:, :, None])[..., 0]
            near = np.flatnonzero(np.linalg.norm(np.maximum(np.abs(seen) - half, 0.0), axis=1) < np.linalg.norm(size))
            if not len(near):
                continue
            between = axes[joint][near] @ axes[other][near].transpose(0, 2, 1)
            spots = np.abs((_GRID * size) @ between + seen[near, None])
            deep = half[0] - spots[..., 0]
            for k in (1, 2):
                np.minimum(deep, half[k] - spots[..., k], out=deep)
            lever = np.linalg.norm(middle[near] - places[near, rig.limbs[side, 0]], axis=1)
            lack = np.maximum(deep.max(axis=1) - TOUCH, 0.0) / np.maximum(lever, 1e-3)
            out[side, near] = np.maximum(out[side, near], lack)
    return out


def ankles_beyond(clip: Clip) -> Array:
    """(2, F) rad by which either foot has to be pitched (toes up positive) to be in the range of its ankle."""
    skeleton: Skeleton = clip.skeleton
    limits, rig = limits_of(skeleton), rig_of(skeleton)
    out = np.zeros((2, len(clip)))
    for side in range(2):
        joint = int(rig.limbs[2 + side, 2])
        swing = rot.log(clip.rotations[:, joint])
        low, high = (float(v) for v in limits.ranges[joint, 1])
        across = swing[:, 2] / np.where(swing[:, 2] >= 0.0, *limits.ranges[joint, 2, ::-1])
        room = SHARE * np.sqrt(np.maximum(1.0 - across**2, 0.0))
        out[side] = np.maximum(swing[:, 0] - room * high, 0.0) - np.maximum(room * low - swing[:, 0], 0.0)
    return out
