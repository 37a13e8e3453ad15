"""Tracking and balance agree on trunk and pelvis (Oshita 2013 eq. 13).

Each says what trunk and pelvis would have to do; the weighted mean of their votes is taken again and again until
both are content (averaged projections, so that the order does not matter). What legs and ground allow is kept in
every round; balance has the last word.
"""

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel, kernel_inline
from bunraku.figure.mass import center_of_mass_into
from bunraku.figure.quat import angle, mul_inv, slerp
from bunraku.figure.rig import Rig
from bunraku.nodes.controller.balance import balance_shift, pelvis_correction, sole_polygon, trunk_correction
from bunraku.nodes.controller.blend import blend_point, blend_turn
from bunraku.nodes.controller.contacts import Contacts
from bunraku.nodes.controller.legs import keep_pelvis_over_feet, lean_room
from bunraku.nodes.controller.placing import place_body
from bunraku.nodes.controller.state import Gains, Held, State, Under
from bunraku.nodes.controller.step import IDLE, PHASE
from bunraku.nodes.controller.tracking import keep_lean, reach_with_trunk, root_shift

Array = NDArray[np.float64]

ROUNDS = 10
"""Most rounds of tracking and balance in one step."""
PULL = 0.06
"""m by which tracking pulls a limb's root in one round."""
LAST_ROUNDS = 6
"""Most rounds in which balance alone has the last word."""
ENOUGH = 2e-4
"""m: shifts below this end the rounds."""
STILL_BENDS = 0.04
"""rad by which the trunk bends in a round in which the knees still wait."""
STALLED = 1e-4
"""m and rad of a round below which tracking and balance will not come any nearer to each other."""
STRAIN = 0.005
"""m that an end held over a motion lacks from which the step is made of short ones."""
REACH_DUCK = 0.74
"""Shortest hip to ankle that a reach pulls the pelvis down to, as a share of the leg."""
BODY_WAY, BODY_SPEED, BODY_TURN, BODY_SPIN = 2.5, 0.06, 8.0, 0.4
"""How far the pelvis goes for every metre of the held ends, m/s on top, rad/m and rad/s for the trunk."""
BODY_RUSH, BODY_SPIN_RUSH = 2.0, 13.0
"""m/s² and rad/s² at which they take up what comes on top: a release is no jerk."""
BODY_FASTEST, BODY_FASTEST_SPIN = 1.2, 6.0
"""m/s and rad/s at which hands and feet pull pelvis and trunk along at most: about the fastest lunge of a person."""
UNTOUCHED = 2e-3
"""m and rad, summed over all parts, up to which a figure is where its motion has it."""
FROM_MOTION = 0.12
"""m: how far a reach takes the pelvis from where its motion has it."""
SHIFT_WEIGHT = 0.8
"""m/s of the same for a foot that leaves the ground."""


@kernel
def nothing_driven(held: Held, ways: Array, turns: Array) -> bool:
    """Whether nothing is held and every part is where its motion has it (see `way_from_motion`)."""
    for n in range(held.flags.shape[0]):
        if held.flags[n] > 0.5:
            return False
    off = 0.0
    for k in range(3):
        for n in range(5):
            off += abs(ways[n, k])
        for n in range(2):
            off += abs(turns[n, k])
    return off < UNTOUCHED


@kernel
def keep_near(middle: Array, most: float, point: Array) -> None:
    """Keep a point (3) within ``most`` (m) of another (3), in place."""
    d = sqrt((point[0] - middle[0]) ** 2 + (point[1] - middle[1]) ** 2 + (point[2] - middle[2]) ** 2)
    if d > most:
        for k in range(3):
            point[k] = middle[k] + most / d * (point[k] - middle[k])


@kernel
def only_added(shift: Array, own: Array) -> None:
    """Take off a way back to balance (3, m, in place) what the motion's own (3) is of it.

    A motion may be out of balance by itself, as every walk is; where it is and the figure is not, nothing is asked for.
    """
    size, along = 0.0, 0.0
    for k in range(3):
        size += shift[k] * shift[k]
        along += shift[k] * own[k]
    left = 0.0 if size < 1e-12 else min(1.0, max(0.0, 1.0 - along / size))
    for k in range(3):
        shift[k] *= left


@kernel
def agree(
    rig: Rig, gains: Gains, st: State, held: Held, under: Under, contacts: Contacts, exact: Array, untouched: bool,
    arms: Array, flags: Array, mass_share: float, hull: Array, center: Array, rotations_ls: Array, positions_ws: Array,
    rotations_ws: Array,
) -> int:  # fmt: skip
    """Rounds of tracking and balance on trunk and pelvis until both are content; returns the hull's size.

    ``exact`` (4,) m is how far each leg stretches in this step. On return the world arrays hold the agreed pose, with
    the swivels of the last step.
    """
    st.mode[2] = 0.0
    shift, part, rest, chest, shoulder = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    pelvis_votes, trunk_votes = np.empty((2, 3)), np.empty((2, 4))
    pelvis_weights, trunk_weights = np.empty(2), np.empty(2)
    hips, start, turn, room = np.empty((2, 3)), np.empty(3), np.empty(4), np.empty(2)
    pelvis_free, trunk_free = flags[0] < 0.5, held.flags[5] < 0.5
    stepping = st.step[PHASE] != IDLE
    over = under.active[0] > 0.5
    # A pelvis that is held, or was left low, may be low; a reach alone does not pull it far down.
    low = not pelvis_free or st.pelvis_rest[1] < -0.02
    duck = gains.duck if low else max(gains.duck, REACH_DUCK)
    farthest = 0.0
    if over:
        duck = 0.0
        for k in range(3):
            farthest += (st.points[0, k] - under.points[0, k]) ** 2
        farthest = max(FROM_MOTION, sqrt(farthest))
    # Feet in the air are where their motion has them, too: what comes down comes down where it should.
    kept, longest = st.planted.copy(), exact.copy()
    for side in range(2):
        if over and pelvis_free and flags[3 + side] < 0.5 and kept[side] < 0.5:
            kept[side] = 1.0
            off = 0.0
            for k in range(3):
                off += (st.points[3 + side, k] - under.points[3 + side, k]) ** 2
            longest[2 + side] += sqrt(off)
    back = rig.back[0]
    size = 0
    # A pelvis that is held where no leg reaches must not be looked at there.
    for k in range(3):
        for side in range(2):
            hips[side, k] = positions_ws[rig.limbs[2 + side, 0], k] - positions_ws[0, k]
    if not over:
        keep_pelvis_over_feet(
            rig, exact, st.points[0], hips, st.points, st.feet, st.planted, duck, False, not stepping,
            not stepping,
        )  # fmt: skip
    round_ = 0
    while round_ < ROUNDS + LAST_ROUNDS:
        last_word = round_ >= ROUNDS
        # Held limbs as far as their joints go: what those hold back weighs where it is.
        place_body(rig, st, under, contacts.limits, flags, arms, flags[1:], rotations_ls, positions_ws, rotations_ws)
        center_of_mass_into(rig.masses, rig.mass_centers, positions_ws, rotations_ws, center)
        size = sole_polygon(rig, st.points, st.feet, st.support, hull)
        if untouched:
            break
        lean_room(rig, positions_ws, st.planted, st.heading[0], room)
        for k in range(3):
            start[k] = st.points[0, k]
            chest[k] = positions_ws[rig.neck[0], k]
            for side in range(2):
                hips[side, k] = positions_ws[rig.limbs[2 + side, 0], k] - st.points[0, k]
        for k in range(2):
            pelvis_weights[k], trunk_weights[k] = 0.0, 0.0
        most = 0.0
        # Tracking: the mean of what the held ends still lack.
        if not last_word:
            lacking, arms_lacking = 0, 0
            for k in range(3):
                shift[k], shoulder[k] = 0.0, 0.0
            for limb in range(4):
                # (An end that a held elbow takes along asks for nothing.)
                if held.flags[1 + limb] > 0.5 and flags[1 + limb] > 0.5:
                    lack = root_shift(
                        st.points[1 + limb], positions_ws[rig.limbs[limb, 0]], under.base.exact[limb], part
                    )  # fmt: skip
                    if lack > 0.0:
                        most = max(most, lack)
                        lacking += 1
                        if limb < 2:
                            arms_lacking += 1
                            for k in range(3):
                                shoulder[k] += positions_ws[rig.limbs[limb, 0], k]
                        for k in range(3):
                            shift[k] += part[k]
            if lacking > 0:
                if over and most > STRAIN:
                    st.mode[2] = 1.0
                size_ = 0.0
                for k in range(3):
                    shift[k] /= lacking
                    size_ += shift[k] * shift[k]
                # In small strides: the legs' limits then turn the pelvis aside instead of pulling it down.
                stride = min(1.0, PULL / max(sqrt(size_), 1e-9))
                for k in range(3):
                    shift[k] *= stride
                    rest[k] = shift[k]
                if arms_lacking > 0 and trunk_free:
                    for k in range(3):
                        shoulder[k] /= arms_lacking
                    reach_with_trunk(
                        shift, shoulder, positions_ws[back], st.turns[0], st.heading[0],
                        under.turns[0], room, trunk_votes[0], rest,
                    )  # fmt: skip
                    trunk_weights[0] = gains.w_tracking
                    mul_inv(trunk_votes[0], st.turns[0], turn)
                    if rest[1] < 0.0:
                        # Down with the trunk first, then with the knees.
                        rest[1] *= 1.0 - 0.9 * min(1.0, angle(turn) / STILL_BENDS)
                if pelvis_free:
                    for k in range(3):
                        pelvis_votes[0, k] = st.points[0, k] + rest[k]
                    pelvis_weights[0] = gains.w_tracking
        # Balance, but not in the middle of a step, nor for a motion that nobody touches.
        if size > 0 and not stepping and not untouched:
            balance_shift(hull, size, center, gains.margin, shift)
            if over:
                balance_shift(hull, size, under.center, gains.margin, part)
                only_added(shift, part)
            lack = sqrt(shift[0] ** 2 + shift[2] ** 2)
            if lack > 1e-6:
                most = max(most, lack)
                share = gains.pelvis_trunk
                if not trunk_free or last_word:
                    share = 1.0
                elif not pelvis_free:
                    share = 0.0
                if share > 0.0 and (pelvis_free or last_word):
                    pelvis_correction(shift, share, max(mass_share, 0.1), part)
                    for k in range(3):
                        pelvis_votes[1, k] = st.points[0, k] + part[k]
                    pelvis_weights[1] = gains.w_balance
                if share < 1.0:
                    trunk_correction(
                        shift, 1.0 - share, max(mass_share, 0.1), chest, positions_ws[back], st.turns[0],
                        trunk_votes[1],
                    )  # fmt: skip
                    trunk_weights[1] = gains.w_balance
        blend_point(pelvis_votes, pelvis_weights, start, st.points[0])
        turned = 0.0
        if trunk_weights[0] + trunk_weights[1] > 0.0:
            for k in range(4):
                turn[k] = st.turns[0, k]
            blend_turn(trunk_votes, trunk_weights, turn, st.turns[0])
            keep_lean(st.turns[0], st.heading[0], under.turns[0], room)
            for k in range(4):
                turned += 2.0 * abs(st.turns[0, k] - turn[k])
        keep_pelvis_over_feet(
            rig, longest, st.points[0], hips, st.points, st.feet, kept, duck, last_word,
            not stepping and not over, not over and not stepping,
        )  # fmt: skip
        if over and pelvis_free:
            keep_near(under.points[0], farthest, st.points[0])
        moved = 0.0
        for k in range(3):
            moved += (st.points[0, k] - start[k]) ** 2
        round_ += 1
        if moved < STALLED * STALLED:
            if most < ENOUGH:
                break
            if not last_word and turned < STALLED:
                round_ = ROUNDS
    return size


@kernel_inline
def hold_back(
    rig: Rig, gains: Gains, st: State, held: Held, under: Under, flags: Array, aims_before: Array, pelvis: Array,
    trunk: Array, positions_ws: Array, dt: float,
) -> bool:  # fmt: skip
    """Let trunk and pelvis go to what tracking and balance agreed on only about as fast as the held ends move.

    The agreement may jump from one way of reaching to another; the body takes its time. ``pelvis`` (3) and
    ``trunk`` (4) are where they were before; what is held stays. True if something was held back.
    """
    moved = 0.0
    for limb in range(4):
        if flags[1 + limb] > 0.5:
            way = 0.0
            for k in range(3):
                way += (st.aims[1 + limb, k] - aims_before[1 + limb, k]) ** 2
            moved += sqrt(way)
    for side in range(2):
        if st.support[side] > 0.0 and st.planted[side] < 0.5:
            moved += SHIFT_WEIGHT * dt
    way = 0.0
    if flags[0] < 0.5:
        for k in range(3):
            way += (st.points[0, k] - pelvis[k]) ** 2
    turned = 0.0
    if held.flags[5] < 0.5:
        q = np.empty(4)
        mul_inv(st.turns[0], trunk, q)
        turned = angle(q)
    drift, spin = 0.0, 0.0
    for k in range(3):
        drift += st.drifts[0, k] ** 2
        spin += st.drifts[1, k] ** 2
    speed = min(BODY_SPEED, sqrt(drift) + BODY_RUSH * dt) * dt
    spin = min(BODY_SPIN, sqrt(spin) + BODY_SPIN_RUSH * dt) * dt
    most = min(1.0, min(BODY_WAY * moved + speed, BODY_FASTEST * dt) / max(sqrt(way), 1e-9))
    most = min(most, min(BODY_TURN * moved + spin, BODY_FASTEST_SPIN * dt) / max(turned, 1e-9))
    if most >= 1.0:
        return False
    if held.flags[5] < 0.5:
        slerp(trunk, st.turns[0], most, st.turns[0])
    if flags[0] < 0.5:
        hips = np.empty((2, 3))
        for k in range(3):
            st.points[0, k] = pelvis[k] + most * (st.points[0, k] - pelvis[k])
            for side in range(2):
                hips[side, k] = positions_ws[rig.limbs[2 + side, 0], k] - positions_ws[0, k]
        keep_pelvis_over_feet(
            rig, under.base.exact, st.points[0], hips, st.points, st.feet, st.planted, gains.duck, False, True, True
        )  # fmt: skip
    return True
