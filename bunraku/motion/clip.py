"""A clip: the motion of one figure as equally spaced frames."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bunraku.figure.skeleton import Index, Skeleton, frozen
from bunraku.motion import rotation as rot

Array = NDArray[np.float64]


class ClipError(ValueError):
    """A clip that cannot be made or used as asked; the message says what to do."""


@dataclass(frozen=True, eq=False)
class Clip:
    """F frames of a figure, ``fps`` of them a second; the arrays are read-only.

    Frame of reference: right-handed, Y up, metres. Rotations are made continuous in sign along time, so
    that neighbouring frames may be mixed component by component.
    """

    name: str
    skeleton: Skeleton
    fps: float
    roots: Array  # (F, 3) m, world position of the root joint (its rest offset is not added)
    rotations: Array  # (F, J, 4) xyzw, relative to the parent

    def __post_init__(self) -> None:
        if not (np.isfinite(self.fps) and self.fps > 0.0):
            raise ClipError(f"clip {self.name!r}: {self.fps} frames a second; give a positive number")
        roots, rotations = np.asarray(self.roots, dtype=float), np.asarray(self.rotations, dtype=float)
        frames = len(roots)
        if frames == 0 or roots.shape != (frames, 3) or rotations.shape != (frames, len(self.skeleton), 4):
            raise ClipError(
                f"clip {self.name!r}: expected roots (F, 3) and rotations (F, {len(self.skeleton)}, 4) with F >= 1, "
                f"got {roots.shape} and {rotations.shape}"
            )
        if not (np.isfinite(roots).all() and np.isfinite(rotations).all()):
            raise ClipError(f"clip {self.name!r} holds values that are not finite")
        object.__setattr__(self, "fps", float(self.fps))
        object.__setattr__(self, "roots", frozen(roots))
        object.__setattr__(self, "rotations", frozen(rot.continuous(rot.normalized(rotations))))

    def __len__(self) -> int:
        return len(self.roots)

    @property
    def duration(self) -> float:
        """Seconds from the first frame to the last; 0 for a single pose."""
        return (len(self) - 1) / self.fps

    @cached_property
    def world(self) -> tuple[Array, Array]:
        """World positions (F, J, 3) and orientations (F, J, 4) of every joint."""
        return world(self.skeleton, self.roots, self.rotations)

    @cached_property
    def headings(self) -> Array:
        """(F,) rad, continuous: which way the hips face; 0 is +Z, positive to the figure's left."""
        return np.asarray(np.unwrap(rot.heading(self.rotations[:, 0])), dtype=np.float64)

    def sample(self, time: float) -> tuple[Array, Array]:
        """The pose at ``time`` (s; held at the ends): root (3) and rotations (J, 4)."""
        roots, rotations = self.samples(np.array([time]))
        return roots[0], rotations[0]

    def samples(self, times: ArrayLike) -> tuple[Array, Array]:
        """Poses at ``times`` (n; s, held at the ends): roots (n, 3) and rotations (n, J, 4)."""
        at = np.clip(np.asarray(times, dtype=np.float64) * self.fps, 0.0, len(self) - 1.0)
        first = np.minimum(at.astype(np.int64), max(len(self) - 2, 0))
        second = np.minimum(first + 1, len(self) - 1)
        part = at - first
        roots = self.roots[first] + part[:, None] * (self.roots[second] - self.roots[first])
        return roots, rot.slerp(self.rotations[first], self.rotations[second], part[:, None])

    def slice(self, first: int, last: int) -> "Clip":
        """Frames ``first`` up to, but without, ``last`` (as Python slices count)."""
        roots = self.roots[first:last]
        if len(roots) == 0:
            raise ClipError(f"clip {self.name!r}: frames {first} to {last} of {len(self)} leave nothing")
        return replace(self, roots=roots, rotations=self.rotations[first:last])

    def resampled(self, fps: float) -> "Clip":
        """The same motion at another rate; the last frame stays within half a frame of where it was."""
        if not (np.isfinite(fps) and fps > 0.0):
            raise ClipError(f"clip {self.name!r}: cannot be sampled at {fps} frames a second")
        if fps == self.fps:
            return self
        count = int(np.floor(self.duration * fps + 0.5)) + 1
        roots, rotations = self.samples(np.arange(count) / fps)
        return replace(self, fps=fps, roots=roots, rotations=rotations)

    def reversed(self) -> "Clip":
        """Played backwards."""
        return replace(self, roots=self.roots[::-1], rotations=self.rotations[::-1])

    def moved(self, yaw: float, x: float = 0.0, z: float = 0.0) -> "Clip":
        """Turned by ``yaw`` (rad, positive to the left) about the world's vertical axis, then shifted by x, z (m)."""
        turn = rot.yaw(yaw)
        rotations = np.array(self.rotations)
        rotations[:, 0] = rot.mul(turn, rotations[:, 0])
        return replace(self, roots=rot.rotate(turn, self.roots) + np.array([x, 0.0, z]), rotations=rotations)

    def at_origin(self) -> "Clip":
        """Moved so that the first frame stands above the origin and faces +Z."""
        turn = -float(self.headings[0])
        x, _, z = rot.rotate(rot.yaw(turn), self.roots[0])
        return self.moved(turn, -float(x), -float(z))

    def mirrored(self) -> "Clip":
        """Left and right exchanged, reflected in the plane x = 0.

        Raises `ClipError` when the skeleton's left and right joints cannot be paired or are not alike.
        """
        other = mirror_map(self.skeleton)
        reflected = self.rotations[:, other] * np.array([1.0, -1.0, -1.0, 1.0])
        return replace(self, roots=self.roots * np.array([-1.0, 1.0, 1.0]), rotations=reflected)

    def renamed(self, name: str) -> "Clip":
        """The same clip under another name."""
        return replace(self, name=name)


def world(skeleton: Skeleton, roots: Array, rotations: Array) -> tuple[Array, Array]:
    """Forward kinematics of many frames at once, one numpy step a joint.

    Args:
        roots: (F, 3) m; rotations: (F, J, 4) xyzw, relative to the parent.

    Returns:
        positions (F, J, 3) and orientations (F, J, 4) in world coordinates.
    """
    positions = np.empty((*rotations.shape[:2], 3))
    orientations = np.empty(rotations.shape)
    positions[:, 0], orientations[:, 0] = roots, rotations[:, 0]
    for joint in range(1, len(skeleton)):
        parent = skeleton.parents[joint]
        above = orientations[:, parent]
        positions[:, joint] = positions[:, parent] + rot.rotate(above, skeleton.offsets[joint])
        orientations[:, joint] = rot.mul(above, rotations[:, joint])
    return positions, orientations


def local(skeleton: Skeleton, orientations: Array) -> Array:
    """(F, J, 4) world orientations to rotations relative to the parent."""
    parents = np.maximum(skeleton.parents, 0)
    out = rot.mul(rot.inverse(orientations[:, parents]), orientations)
    out[:, 0] = orientations[:, 0]
    return out


def mirror_map(skeleton: Skeleton) -> Index:
    """(J,) for each joint the one on the other side, itself for those in the middle.

    Joints are paired by their names (left/right, L/R) and, failing that, by their VRM roles. Raises
    `ClipError` when a joint has no partner or the partner's offset is no reflection (1 mm or 2 %).
    """
    index = {name: joint for joint, name in enumerate(skeleton.names)}
    by_role = {joint: role for role, joint in skeleton.roles.items()}
    other = np.arange(len(skeleton))
    for joint, name in enumerate(skeleton.names):
        role = by_role.get(joint, "")
        partner = next((index[swap] for swap in _swapped(name) if swap in index), None)
        if partner is None and role[:4] == "left":
            partner = skeleton.roles.get("right" + role[4:])
        if partner is None and role[:5] == "right":
            partner = skeleton.roles.get("left" + role[5:])
        if partner is None:
            if (
                abs(skeleton.offsets[joint, 0]) > 0.02
                and joint > 0
                and other[skeleton.parents[joint]] == skeleton.parents[joint]
            ):
                raise ClipError(f"joint {name!r} has no partner on the other side; cannot mirror")
            partner = joint
        other[joint] = partner
    reflected = skeleton.offsets[other] * np.array([-1.0, 1.0, 1.0])
    wrong = np.linalg.norm(reflected - skeleton.offsets, axis=1) > np.maximum(
        1e-3, 0.02 * np.linalg.norm(skeleton.offsets, axis=1)
    )
    wrong[0] = False
    if np.any(other[other] != np.arange(len(skeleton))) or np.any(wrong):
        name = skeleton.names[int(np.argmax(wrong))]
        raise ClipError(f"left and right are not alike at joint {name!r}; retarget to a symmetric figure, then mirror")
    return other


def _swapped(name: str) -> list[str]:
    """Names that ``name``'s partner on the other side may have."""
    found = []
    for left, right in (("left", "right"), ("Left", "Right"), ("LEFT", "RIGHT")):
        if left in name:
            found.append(name.replace(left, right))
        elif right in name:
            found.append(name.replace(right, left))
    swap = {"L": "R", "R": "L", "l": "r", "r": "l"}
    if len(name) > 1 and name[0] in swap and not name[1].islower():
        found.append(swap[name[0]] + name[1:])
    if len(name) > 2 and name[-1] in swap and name[-2] in "_.- ":
        found.append(name[:-1] + swap[name[-1]])
    for separator in "_.- ":
        parts = name.split(separator)
        for k, part in enumerate(parts):
            if len(part) == 1 and part in swap and len(parts) > 1:
                found.append(separator.join([*parts[:k], swap[part], *parts[k + 1 :]]))
    if len(name) > 1 and name[0] in "lr" and name[1:].islower():  # ASF: lfemur, rfemur
        found.append(swap[name[0]] + name[1:])
    return found


def clip_from_poses(
    skeleton: Skeleton, stamps: ArrayLike, roots: ArrayLike, rotations: ArrayLike, fps: float, name: str = "take"
) -> Clip:
    """A clip from poses that came at any times, as a recording holds them.

    Args:
        stamps: (n,) ns; need not be in order; of several poses with one stamp the last counts.
        roots: (n, 3) m, root joint in world coordinates. rotations: (n, J, 4) xyzw.
        fps: frames a second of the clip; frame 0 is the first pose.

    Raises:
        ClipError: there is no pose, or shapes do not fit.
    """
    at = np.asarray(stamps, dtype=np.int64).reshape(-1)
    places = np.asarray(roots, dtype=np.float64)
    turns = np.asarray(rotations, dtype=np.float64)
    if len(at) == 0:
        raise ClipError(f"clip {name!r}: no poses; record the topic 'pose'")
    if not (np.isfinite(fps) and fps > 0.0):
        raise ClipError(f"clip {name!r}: {fps} frames a second; give a positive number")
    if places.shape != (len(at), 3) or turns.shape != (len(at), len(skeleton), 4):
        raise ClipError(
            f"clip {name!r}: {len(at)} stamps do not fit roots {places.shape} and rotations {turns.shape} "
            f"of {len(skeleton)} joints"
        )
    order = np.argsort(at, kind="stable")
    keep = order[np.append(np.diff(at[order]) > 0, True)]
    seconds = (at[keep] - at[keep[0]]) / 1e9
    places, turns = places[keep], rot.continuous(rot.normalized(turns[keep]))
    count = int(np.floor(seconds[-1] * fps + 0.5)) + 1
    times = np.arange(count) / fps
    second = np.clip(np.searchsorted(seconds, times, side="right"), min(1, len(seconds) - 1), len(seconds) - 1)
    first = np.maximum(second - 1, 0)
    span = seconds[second] - seconds[first]
    part = np.clip(np.where(span > 0.0, (times - seconds[first]) / np.where(span > 0.0, span, 1.0), 1.0), 0.0, 1.0)
    mixed = places[first] + part[:, None] * (places[second] - places[first])
    return Clip(name, skeleton, fps, mixed, rot.slerp(turns[first], turns[second], part[:, None]))
