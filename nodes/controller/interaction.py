"""Inter-body interaction: parts that are moved take their neighbours along a little (section 6.3, eqs 19-22).

The time step cancels: what counts is how far a part has moved since the last step.
"""

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel, kernel_inline
from bunraku.figure.quat import between, mul, mul_inv, rotate
from bunraku.figure.rig import Rig
from bunraku.nodes.controller.blend import blend_point, blend_turn
from bunraku.nodes.controller.state import Gains, Held, State

Array = NDArray[np.float64]


@kernel
def trunk_from_ends(moved: Array, chest: Array, back: Array, influence: float, turn: Array, out: Array) -> None:
    """The trunk (4) when driven ends have moved by ``moved`` (3, m, summed): eqs 19-20."""
    lever, to, q = np.empty(3), np.empty(3), np.empty(4)
    for k in range(3):
        lever[k] = chest[k] - back[k]
        to[k] = lever[k] + influence * moved[k]
    between(lever, to, q)
    mul(q, turn, out)


@kernel
def end_from_trunk(
    end: Array, back: Array, turn_before: Array, turn: Array, pelvis_moved: Array, influence: float, out: Array
) -> None:
    """A free end (3) when the trunk has turned about the back joint and the pelvis moved: eqs 21-22."""
    q, arm, v = np.empty(4), np.empty(3), np.empty(3)
    mul_inv(turn, turn_before, q)
    for k in range(3):
        arm[k] = end[k] - back[k]
    rotate(q, arm, v)
    for k in range(3):
        out[k] = end[k] + influence * (v[k] - arm[k] + pelvis_moved[k])


@kernel_inline
def sway_trunk(
    rig: Rig, gains: Gains, st: State, held: Held, flags: Array, aims_before: Array, positions_ws: Array
) -> None:
    """Interaction's vote on the trunk against relaxing's and balance's, which both vote for it as it is now."""
    moved = np.zeros(3)
    driven = False
    for limb in range(4):
        if flags[1 + limb] > 0.5 and held.flags[1 + limb] > 0.5:
            driven = True
            for k in range(3):
                moved[k] += st.aims[1 + limb, k] - aims_before[1 + limb, k]
    if not driven or held.flags[5] > 0.5:
        return
    n = sqrt(moved[0] ** 2 + moved[1] ** 2 + moved[2] ** 2)
    if n > 0.25:
        for k in range(3):
            moved[k] *= 0.25 / n
    votes, weights, turn = np.empty((3, 4)), np.empty(3), np.empty(4)
    for k in range(4):
        turn[k] = st.turns[0, k]
        votes[1, k], votes[2, k] = turn[k], turn[k]
    trunk_from_ends(
        moved, positions_ws[rig.neck[0]], positions_ws[rig.back[0]], gains.ee_to_trunk, turn, votes[0]
    )  # fmt: skip
    supported = st.support[0] > 0.0 or st.support[1] > 0.0
    weights[0], weights[1] = gains.w_interaction, gains.w_relaxing
    weights[2] = gains.w_balance if supported else 0.0
    blend_turn(votes, weights, turn, st.turns[0])


@kernel_inline
def sway_hands(
    rig: Rig, gains: Gains, st: State, flags: Array, trunk_before: Array, pelvis_before: Array, arms: Array,
    positions_ws: Array,
) -> None:  # fmt: skip
    """Interaction's vote on free hands against relaxing's: the shoulders take them along, the trunk some more."""
    votes, weights, hand, shift, out = np.empty((2, 3)), np.empty(2), np.empty(3), np.empty(3), np.empty(3)
    weights[0], weights[1] = gains.w_interaction, gains.w_relaxing
    for k in range(3):
        shift[k] = st.points[0, k] - pelvis_before[k]
    for limb in range(2):
        if flags[1 + limb] > 0.5:
            continue
        root = positions_ws[rig.limbs[limb, 0]]
        for k in range(3):
            hand[k] = root[k] + arms[limb, k]
            votes[1, k] = hand[k]
        end_from_trunk(
            hand, positions_ws[rig.back[0]], trunk_before, st.turns[0], shift, gains.trunk_to_ee, votes[0]
        )  # fmt: skip
        blend_point(votes, weights, hand, out)
        for k in range(3):
            arms[limb, k] = out[k] - root[k]
