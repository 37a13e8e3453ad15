"""Blending a module's examples (Oshita 2005 6.1, after Park 2002): poses, way and contacts at a generic time.

At load every example is sampled on one grid of generic time and split in two: the *path frame*, which carries the
figure over the ground, and the *local pose* in it (the root's sway and height, the root's turn against the path,
and the joints' rotations). Rotations are kept as logarithms about their joint's mean, so that blending them is one
weighted sum. A cycle's way over the ground is blended as velocity and integrated; a single motion's is the weighted
sum of its examples' ways from where it began, and what that lacks at its goal is made up for.

A cycle's path is the arc of its constant speed and turn rate; a single motion's is the root's own way and heading.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel
from bunraku.figure.quat import exp, mul, normalize
from bunraku.motion import rotation as rot
from bunraku.motion.motionset import Example
from bunraku.motion.parameters import cycle_path
from bunraku.motion.timewarp import generic_keys, own_times

Array = NDArray[np.float64]

SAMPLES = (24, 144)
"""Fewest and most grid points of a motion; otherwise as many as its longest example has frames."""


class BlendTable(NamedTuple):
    """n examples of J joints on S grid points of generic time; a cycle's last point is before its first one."""

    cycle: bool
    generic: Array  # (k,) generic times of the key events
    spans: Array  # (n, k-1) s between them
    means: Array  # (J, 4) per joint; the root's against the path
    logs: Array  # (n, S, 3 J) rad, rotations about the means
    places: Array  # (n, S, 3) m, root in the path frame: left, up, ahead
    ways: Array  # (n, S, 3) single motions: path frame since the start: left m, ahead m, turned rad
    speeds: Array  # (n, 2) cycles: m/s ahead, rad/s to the left
    contacts: Array  # (n, S, 2) generic time to the nearest lift or touch of a foot: > 0 on the ground


def blend_table(examples: Sequence[Example]) -> BlendTable:
    """The table of a module's examples, which must fit together (see `bunraku.motion.motionset.Module`)."""
    cycle = examples[0].cycle
    generic = generic_keys([example.keys for example in examples])
    spans = np.stack([np.diff(example.keys) for example in examples])
    longest = max(round(example.duration * example.clip.fps) for example in examples)
    count = int(np.clip(longest, *SAMPLES))
    grid = np.arange(count) / count if cycle else np.linspace(0.0, 1.0, count)
    joints = len(examples[0].clip.skeleton)
    rotations = np.empty((len(examples), count, joints, 4))
    places, ways = np.empty((len(examples), count, 3)), np.zeros((len(examples), count, 3))
    speeds, contacts = np.zeros((len(examples), 2)), np.empty((len(examples), count, 2))
    for i, example in enumerate(examples):
        clip = example.clip
        fine = np.linspace(example.keys[0], example.keys[-1], max(2, round(example.duration * clip.fps)) + 1)
        roots, turns = clip.samples(fine)
        facing = np.unwrap(rot.heading(turns[:, 0]))
        if cycle:
            path = cycle_path(roots[:, [0, 2]], facing, (len(fine) - 1) / example.duration)
            base, directions = path.places, path.directions
            speeds[i] = path.speed, path.turn
        else:
            base, directions = roots[:, [0, 2]], facing
        offset = roots[:, [0, 2]] - base
        c, s = np.cos(directions), np.sin(directions)
        local = np.stack([offset[:, 0] * c - offset[:, 1] * s, roots[:, 1], offset[:, 0] * s + offset[:, 1] * c], -1)
        turns = np.array(turns)
        turns[:, 0] = rot.mul(rot.yaw(-directions), turns[:, 0])
        turns = rot.continuous(turns)
        if cycle:
            local, turns = _closed(local, turns)
        at = own_times(generic, example.keys, grid)
        for k in range(3):
            places[i, :, k] = np.interp(at, fine, local[:, k])
        rotations[i] = _at(fine, turns, at)
        if not cycle:
            way = base - base[0]
            c0, s0 = np.cos(directions[0]), np.sin(directions[0])
            ways[i, :, 0] = np.interp(at, fine, way[:, 0] * c0 - way[:, 1] * s0)
            ways[i, :, 1] = np.interp(at, fine, way[:, 0] * s0 + way[:, 1] * c0)
            ways[i, :, 2] = np.interp(at, fine, directions - directions[0])
        contacts[i] = _signals(example, generic, grid)
    means = _means(rotations)
    logs = rot.log(rot.mul(rot.inverse(means), rotations))
    return BlendTable(
        cycle, generic, spans, means, np.ascontiguousarray(logs.reshape(len(examples), count, 3 * joints)),
        places, ways, speeds, contacts,
    )  # fmt: skip


def _at(times: Array, turns: Array, at: Array) -> Array:
    """Rotations (F, J, 4) at times ``times`` (F), sampled at ``at`` (n)."""
    step = times[1] - times[0]
    where = np.clip((at - times[0]) / step, 0.0, len(times) - 1.0)
    first = np.minimum(where.astype(np.int64), len(times) - 2)
    return rot.slerp(turns[first], turns[first + 1], (where - first)[:, None])


def _closed(local: Array, turns: Array) -> tuple[Array, Array]:
    """A cycle whose ends meet: what they differ by is spread evenly over it, half to either end."""
    share = (np.arange(len(local)) / (len(local) - 1) - 0.5)[:, None]
    gap = local[-1] - local[0]
    turned = rot.log(rot.mul(turns[-1], rot.inverse(turns[0])))
    back = rot.exp(-share[..., None] * turned[None])
    return local - share * gap, rot.normalized(rot.mul(back, turns))


def _means(rotations: Array) -> Array:
    """(J, 4) the mean rotation of each joint over examples and time (three Karcher steps from the first)."""
    flat = rotations.reshape(-1, *rotations.shape[-2:])
    means = np.array(flat[0])
    for _ in range(3):
        means = rot.normalized(rot.mul(means, rot.exp(rot.log(rot.mul(rot.inverse(means), flat)).mean(axis=0))))
    return means


def _signals(example: Example, generic: Array, grid: Array) -> Array:
    """(S, 2) signed generic time to the nearest change of each foot's contact, within +-0.5."""
    times = np.arange(len(example.clip)) / example.clip.fps
    inside = (times >= example.keys[0] - 1e-9) & (times <= example.keys[-1] + 1e-9)
    own = np.interp(times[inside], example.keys, generic)
    out = np.empty((len(grid), 2))
    for foot in range(2):
        on = example.contacts[inside, foot]
        changes = np.nonzero(on[1:] != on[:-1])[0]
        # A foot has left the ground after the last frame on it, and comes down on the way to the first one.
        lifts = on[changes]
        marks = np.where(lifts, own[changes], 0.5 * (own[changes] + own[changes + 1]))
        down = on[0] ^ (np.searchsorted(marks, grid + 1e-12) % 2 == 1)
        sign = np.where(down, 1.0, -1.0)
        if len(marks) == 0:
            out[:, foot] = 0.5 * sign
            continue
        if example.cycle:
            if on[0] != on[-1]:
                marks = np.append(marks, [0.0, 1.0])
            marks = np.concatenate([marks - 1.0, marks, marks + 1.0])
        distance = np.abs(grid[:, None] - marks[None]).min(axis=1)
        out[:, foot] = sign * np.minimum(distance, 0.5)
    return out


@kernel
def taps(table: BlendTable, u: float, index: NDArray[np.int64], share: Array) -> float:
    """The four grid points about generic time ``u`` and their Catmull-Rom weights; returns the part between the two
    in the middle."""
    count = table.logs.shape[1]
    at = (u - np.floor(u)) * count if table.cycle else min(max(u, 0.0), 1.0) * (count - 1)
    base = int(at)
    if not table.cycle:
        base = min(base, count - 2)
    t = at - base
    for k in range(4):
        n = base + k - 1
        index[k] = n % count if table.cycle else min(max(n, 0), count - 1)
    t2, t3 = t * t, t * t * t
    share[0] = 0.5 * (-t3 + 2.0 * t2 - t)
    share[1] = 0.5 * (3.0 * t3 - 5.0 * t2 + 2.0)
    share[2] = 0.5 * (-3.0 * t3 + 4.0 * t2 + t)
    share[3] = 0.5 * (t3 - t2)
    return t  # type: ignore[no-any-return]


@kernel
def pose_into(table: BlendTable, weights: Array, u: float, place: Array, rotations: Array, contact: Array) -> None:
    """The blended local pose at generic time ``u``.

    Args:
        place: (3) out, m: the root in the path frame: left, up, ahead.
        rotations: (J, 4) out: local rotations; the root's against the path frame.
        contact: (2) out: > 0 where the foot is on the ground.
    """
    n, joints = table.logs.shape[0], table.means.shape[0]
    index, share = np.empty(4, np.int64), np.empty(4)
    t = taps(table, u, index, share)
    v = np.zeros(3 * joints)
    for k in range(3):
        place[k] = 0.0
    contact[0] = 0.0
    contact[1] = 0.0
    for i in range(n):
        w = weights[i]
        if abs(w) < 1e-7:
            continue
        a, b, c, d = w * share[0], w * share[1], w * share[2], w * share[3]
        l0, l1 = table.logs[i, index[0]], table.logs[i, index[1]]
        l2, l3 = table.logs[i, index[2]], table.logs[i, index[3]]
        for k in range(3 * joints):
            v[k] += a * l0[k] + b * l1[k] + c * l2[k] + d * l3[k]
        for k in range(3):
            place[k] += (
                a * table.places[i, index[0], k] + b * table.places[i, index[1], k]
                + c * table.places[i, index[2], k] + d * table.places[i, index[3], k]
            )  # fmt: skip
        for k in range(2):
            contact[k] += w * ((1.0 - t) * table.contacts[i, index[1], k] + t * table.contacts[i, index[2], k])
    q = np.empty(4)
    for joint in range(joints):
        exp(v[3 * joint : 3 * joint + 3], q)
        mul(table.means[joint], q, rotations[joint])
        normalize(rotations[joint], rotations[joint])


@kernel
def way_into(table: BlendTable, weights: Array, u: float, out: Array) -> None:
    """How far a single motion's path frame has come at ``u``: left m, ahead m, turned rad, from its start."""
    index, share = np.empty(4, np.int64), np.empty(4)
    taps(table, u, index, share)
    for k in range(3):
        out[k] = 0.0
    for i in range(weights.shape[0]):
        for t in range(4):
            for k in range(3):
                out[k] += weights[i] * share[t] * table.ways[i, index[t], k]


@kernel
def speeds_into(table: BlendTable, weights: Array, out: Array) -> None:
    """The blended velocity of a cycle's path frame: m/s ahead, rad/s to the left."""
    out[0] = 0.0
    out[1] = 0.0
    for i in range(weights.shape[0]):
        out[0] += weights[i] * table.speeds[i, 0]
        out[1] += weights[i] * table.speeds[i, 1]
