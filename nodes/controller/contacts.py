"""What of a limb touches what: the smallest gap, the way out, who gets out of whose way (Oshita 2013 section 6.5)."""

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.boxes import box_axes, pair_gap
from bunraku.figure.jit import kernel, kernel_inline
from bunraku.figure.limits import Limits
from bunraku.figure.quat import rotate
from bunraku.figure.rig import Rig
from bunraku.nodes.controller.state import State

Array = NDArray[np.float64]
Index = NDArray[np.int64]

NEAR = 0.031
"""m: what is farther apart is not measured."""
SHORTEST_LEVER = 0.12
"""m from the shoulder or hip that a contact counts for at least where its limb is turned as a whole."""
LEAST_LEVER, LEAST_BEND, MOST_PUSH = 0.1, 0.02, 0.05
"""Share of the upper bone below which a contact is taken for farther out; m that an elbow stands out before it is
turned; m that one push moves the end at most."""


class Contacts(NamedTuple):
    """What may touch what, and how far joints go."""

    parts: Index  # (4, 4) joints with a box of each limb, from upper on; -1 for none
    others: Index  # (4, 4, K) joints that each part must not overlap; -1 for none
    limits: Limits


def pack_contacts(contacts: Contacts) -> tuple[Index, Array]:
    """Contacts in two arrays; see `unpack_contacts`."""
    limits = contacts.limits
    ints = [np.array([contacts.others.shape[2]]), contacts.parts, contacts.others, limits.kinds]
    floats = [limits.centers, limits.axes, limits.ranges]
    return np.concatenate([a.ravel() for a in ints]), np.concatenate([a.ravel() for a in floats])


@kernel
def unpack_contacts(ints: Index, floats: Array, joints: int) -> Contacts:
    """What `pack_contacts` packed, as views."""
    widest = ints[0]
    i = 17 + 16 * widest
    limits = Limits(
        ints[i : i + joints],
        floats[0 : 4 * joints].reshape(joints, 4),
        floats[4 * joints : 13 * joints].reshape(joints, 3, 3),
        floats[13 * joints : 19 * joints].reshape(joints, 3, 2),
    )
    return Contacts(ints[1:17].reshape(4, 4), ints[17:i].reshape(4, 4, widest), limits)


@kernel
def contact_point(center: Array, axes: Array, half: Array, way: Array, out: Array) -> None:
    """Where a box (its centre, axes and half extents) is touched from the side to which ``way`` (3, unit) points."""
    for k in range(3):
        out[k] = center[k]
    for n in range(3):
        along = axes[n, 0] * way[0] + axes[n, 1] * way[1] + axes[n, 2] * way[2]
        # The middle of a face that is touched flat, a corner where it is pointed at.
        share = half[n] * min(1.0, max(-1.0, 3.0 * along))
        for k in range(3):
            out[k] += share * axes[n, k]


@kernel
def deepest_contact(
    rig: Rig, contacts: Contacts, limb: int, yielding: Array, positions_ws: Array, rotations_ws: Array,
    centers: Array, axes: Array, push: Array,
) -> float:  # fmt: skip
    """The smallest gap (m, negative for an overlap) of a limb with the rest.

    ``yielding`` (J,) is 1 for joints that get out of this limb's way.
    ``push`` (4): the way out (3) and where on its bone: 0 upper bone's root .. 1 elbow .. 2 end and beyond.
    """
    least = 1e9
    axis, v, point = np.empty(3), np.empty(3), np.empty(3)
    upper, lower = rig.limbs[limb, 0], rig.limbs[limb, 1]
    for n in range(4):
        part = contacts.parts[limb, n]
        if part < 0:
            continue
        rotate(rotations_ws[part], rig.box_centers[part], centers[part])
        for k in range(3):
            centers[part, k] += positions_ws[part, k]
        box_axes(rotations_ws[part], axes[part])
        for m in range(contacts.others.shape[2]):
            other = contacts.others[limb, n, m]
            if other < 0:
                break
            if yielding[other] > 0.5:
                continue
            gap = pair_gap(centers, axes, rig.box_sizes, part, other, axis, NEAR)
            if gap < least:
                least = gap
                for k in range(3):
                    push[k] = axis[k]
                if n >= 2:
                    push[3] = 2.0
                else:
                    bone = upper if n == 0 else lower
                    far = lower if n == 0 else rig.limbs[limb, 2]
                    contact_point(centers[other], axes[other], rig.box_sizes[other], axis, point)
                    along, length = 0.0, 0.0
                    for k in range(3):
                        v[k] = positions_ws[far, k] - positions_ws[bone, k]
                        along += v[k] * (point[k] - positions_ws[bone, k])
                        length += v[k] * v[k]
                    push[3] = n + min(1.0, max(0.0, along / max(length, 1e-9)))
    return least


@kernel
def push_limb(
    rig: Rig, st: State, limb: int, push: Array, depth: float, most_turn: float, positions_ws: Array,
    rotations_ws: Array,
) -> None:  # fmt: skip
    """Move a limb's end, and turn its elbow or knee, by the least that moves the contact ``depth`` (m) out.

    With the end at ``d u`` from the root and the hinge at ``a u + h p`` (``u``, ``p`` the axis and the pole), a
    small movement ``v`` of the end and ``t`` of the swivel moves the hinge by ``(a' u + h' p)(v·u) + (a/d) v_t -
    (h/d)(v·p) u + h t (u x p)``; the contact lies on the bone above or below it, and the push is the least-squares
    solution of that one equation along its way out.
    """
    upper, lower, end = rig.limbs[limb, 0], rig.limbs[limb, 1], rig.limbs[limb, 2]
    axis, pole, lead = np.empty(3), np.empty(3), np.empty(3)
    d = 0.0
    for k in range(3):
        axis[k] = positions_ws[end, k] - positions_ws[upper, k]
        d += axis[k] * axis[k]
    d = max(sqrt(d), 1e-6)
    a = 0.0
    for k in range(3):
        axis[k] /= d
        pole[k] = positions_ws[lower, k] - positions_ws[upper, k]
        a += pole[k] * axis[k]
    h = 0.0
    for k in range(3):
        pole[k] -= a * axis[k]
        h += pole[k] * pole[k]
    radius = sqrt(h)
    h = max(radius, LEAST_BEND)
    out_axis, out_pole = 0.0, 0.0
    for k in range(3):
        pole[k] /= max(radius, 1e-9)
        out_axis += push[k] * axis[k]
        out_pole += push[k] * pole[k]
    # How much of the hinge's and of the end's movement the contact makes.
    place = push[3]
    by_hinge = max(LEAST_LEVER, place) if place < 1.0 else 2.0 - place
    by_end = max(0.0, place - 1.0)
    grow = 1.0 - a / d
    radial = grow * out_axis - a * grow / h * out_pole
    total = 0.0
    for k in range(3):
        across = push[k] - out_axis * axis[k]
        lead[k] = by_hinge * (radial * axis[k] + a / d * across - h / d * out_axis * pole[k]) + by_end * push[k]
        total += lead[k] * lead[k]
    square = (axis[1] * pole[2] - axis[2] * pole[1]) * push[0]
    square += (axis[2] * pole[0] - axis[0] * pole[2]) * push[1]
    square += (axis[0] * pole[1] - axis[1] * pole[0]) * push[2]
    square = by_hinge * square if radius > LEAST_BEND else 0.0
    total += square * square
    if total < 1e-4:
        return
    size = 0.0
    for k in range(3):
        lead[k] *= depth / total
        size += lead[k] * lead[k]
    shorter = min(1.0, MOST_PUSH / max(sqrt(size), 1e-9))
    for k in range(3):
        st.points[limb + 1, k] += shorter * lead[k]
    if radius > LEAST_BEND:
        turn = depth * square / total / radius
        st.swivels[limb] += min(most_turn, max(-most_turn, turn))


@kernel
def contact_place(rig: Rig, limb: int, along: float, positions_ws: Array, out: Array) -> None:
    """Where on a limb (3, m) a contact lies: 0 its root .. 1 its elbow or knee .. 2 its end."""
    near = 0 if along < 1.0 else 1
    share = min(1.0, along - near)
    a, b = rig.limbs[limb, near], rig.limbs[limb, near + 1]
    for k in range(3):
        out[k] = positions_ws[a, k] + share * (positions_ws[b, k] - positions_ws[a, k])


@kernel
def turn_to_leave(lever: Array, way: Array, depth: float, out: Array) -> float:
    """The rotation vector (3) that moves a contact at ``lever`` (3, m) by ``depth`` (m) along ``way`` (3, unit).

    Returns:
        How far (m) the contact moves: less than asked for where it lies near the axis or the way is along the lever.
    """
    out[0] = lever[1] * way[2] - lever[2] * way[1]
    out[1] = lever[2] * way[0] - lever[0] * way[2]
    out[2] = lever[0] * way[1] - lever[1] * way[0]
    square = out[0] ** 2 + out[1] ** 2 + out[2] ** 2
    share = depth / max(square, SHORTEST_LEVER * SHORTEST_LEVER)
    for k in range(3):
        out[k] *= share
    return float(share * square)


@kernel
def mark_limb(rig: Rig, limb: int, value: float, out: Array) -> None:
    """Set a value of ``out`` (J,) for all joints of a limb."""
    upper = rig.limbs[limb, 0]
    for joint in range(upper, rig.parents.shape[0]):
        if joint != upper and rig.parents[joint] < upper:
            break
        out[joint] = value


@kernel_inline
def yields(rig: Rig, st: State, flags: Array, limb: int, out: Array) -> None:
    """Which joints (J,) get out of a limb's way: free limbs yield to driven ones, arms to legs."""
    for joint in range(out.shape[0]):
        out[joint] = 0.0
    mine = 3.0 if flags[1 + limb] > 0.5 else (2.0 if limb >= 2 else 1.0)
    for other in range(4):
        rank = 3.0 if flags[1 + other] > 0.5 else (2.0 if other >= 2 else 1.0)
        if other >= 2 and st.planted[other - 2] > 0.5:
            rank = 4.0
        if rank < mine:
            mark_limb(rig, other, 1.0, out)
