"""Over a motion free arms keep out of the body that the motion, and what is held, put in their way.

An arm turns at its shoulder by a difference from the motion that grows as the body comes into it and fades when
it is out of the way (inertial blending, Bollo 2018), so an arm that touches nothing is where the motion has it.
"""

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.boxes import place_boxes_into
from bunraku.figure.jit import kernel
from bunraku.figure.limits import clamp_joint, joint_excess
from bunraku.figure.quat import exp, inv_rotate, log, mul, mul_inv
from bunraku.figure.rig import Rig
from bunraku.figure.spring import spring_decay_into
from bunraku.nodes.controller.contacts import Contacts, contact_place, deepest_contact, turn_to_leave
from bunraku.nodes.controller.placing import carry_from
from bunraku.nodes.controller.state import State

Array = NDArray[np.float64]

FADE = 0.10
"""s: half-life of an arm's way back to its motion."""
LET, LEFT = 4.0e-3, 5.0e-3
"""m: an overlap that is let be, and the most that is left of a deeper one."""
PUSHES = 8
"""Most pushes in one step."""
FASTEST = 1.2
"""m/s at which a contact is pushed out at most."""


@kernel
def left_over(depth: float) -> float:
    """What is left (m) of an overlap: all of a shallow one, `LEFT` of a deep one, without a corner between."""
    if depth <= LET:
        return depth
    room = LEFT - LET
    more = depth - LET
    return LET + room * more / (room + more)


@kernel
def turn_arm(
    rig: Rig, st: State, contacts: Contacts, limb: int, own: Array, rotations_ls: Array, positions_ws: Array,
    rotations_ws: Array,
) -> None:  # fmt: skip
    """Lay an arm's difference over what the motion says of its upper bone (``own``, 4), within its range."""
    upper = rig.limbs[limb, 0]
    turn, back = np.empty(4), np.empty(4)
    exp(st.dodges[limb], turn)
    mul(turn, own, rotations_ls[upper])
    if joint_excess(contacts.limits, upper, own) <= 0.0:
        clamp_joint(contacts.limits, upper, rotations_ls[upper])
        mul_inv(rotations_ls[upper], own, back)
        log(back, st.dodges[limb])
    carry_from(rig, upper, rotations_ls, positions_ws, rotations_ws)


@kernel
def dodge(
    rig: Rig, st: State, contacts: Contacts, flags: Array, rotations_ls: Array, positions_ws: Array,
    rotations_ws: Array, dt: float,
) -> None:  # fmt: skip
    """Turn free arms out of the body, in place; ``flags`` (5,): which points are driven.

    An arm that is taken hold of loses its difference as it is.
    """
    joints = rig.parents.shape[0]
    centers, axes, push = np.empty((joints, 3)), np.empty((joints, 3, 3)), np.empty(4)
    yielding = np.zeros(joints)
    own, before = np.empty(4), np.empty(3)
    lever, vector, more, turn = np.empty(3), np.empty(3), np.empty(4), np.empty(4)
    place_boxes_into(rig.box_centers, positions_ws, rotations_ws, centers, axes)
    for limb in range(2):
        upper = rig.limbs[limb, 0]
        for k in range(4):
            own[k] = rotations_ls[upper, k]
        for k in range(3):
            before[k] = st.dodges[limb, k]
        spring_decay_into(st.dodges[limb], st.dodge_rates[limb], FADE, dt)
        size = 0.0
        for k in range(3):
            size += abs(st.dodges[limb, k])
        if size > 1e-6:
            turn_arm(rig, st, contacts, limb, own, rotations_ls, positions_ws, rotations_ws)
        else:
            st.dodges[limb] = 0.0
            st.dodge_rates[limb] = 0.0
        if flags[1 + limb] > 0.5:
            continue
        room, pushed = FASTEST * dt, False
        for _ in range(PUSHES):
            gap = deepest_contact(rig, contacts, limb, yielding, positions_ws, rotations_ws, centers, axes, push)
            depth = min(room, -gap - left_over(-gap))
            if depth < 1e-5:
                break
            contact_place(rig, limb, push[3], positions_ws, lever)
            for k in range(3):
                lever[k] -= positions_ws[upper, k]
            room -= turn_to_leave(lever, push[:3], depth, vector)
            pushed = True
            inv_rotate(rotations_ws[rig.parents[upper]], vector, vector)
            exp(vector, more)
            exp(st.dodges[limb], turn)
            mul(more, turn, turn)
            log(turn, st.dodges[limb])
            turn_arm(rig, st, contacts, limb, own, rotations_ls, positions_ws, rotations_ws)
        if pushed and dt > 0.0:
            for k in range(3):
                st.dodge_rates[limb, k] = (st.dodges[limb, k] - before[k]) / dt
