"""Elbows and knees: where their swivels go (Oshita 2013 eqs 5-6, and held ones)."""

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel
from bunraku.figure.limb import swivel_of
from bunraku.figure.pointpose import default_swivel
from bunraku.figure.quat import inv_rotate
from bunraku.figure.rig import Rig
from bunraku.figure.spring import spring_to_into
from bunraku.nodes.controller.relaxing import twist_of
from bunraku.nodes.controller.state import Gains, Held, State, Under
from bunraku.nodes.controller.step import wrap

Array = NDArray[np.float64]

STANDING_TWIST = 0.4
"""rad that a held knee turns about the line from its hip to a foot that stands."""
KNEES_ALONG = 0.35
"""rad that the hips turn against standing feet with the knees wholly along."""
SWIVEL_PER_WAY, SWIVEL_RATE = 8.0, 0.3
"""rad/m and rad/s: the fastest that an elbow or knee turns by itself."""


@kernel
def turn_hinges(
    rig: Rig, gains: Gains, st: State, held: Held, under: Under, positions_ws: Array, rotations_ws: Array,
    before: Array, plain: Array, dt: float,
) -> None:  # fmt: skip
    """The swivels: the examples', the motion's difference from them, a held elbow or knee, collisions'.

    ``before`` (5, 3) are the points of the last step; ``plain`` (4) is written: where the swivels go without
    collisions.
    """
    axis, pole = np.empty(3), np.empty(3)
    for limb in range(4):
        upper = rig.limbs[limb, 0]
        parent = rotations_ws[rig.parents[upper]]
        goal = default_swivel(rig, limb, st.points[1 + limb], positions_ws[upper], parent)
        now = st.extra[limb]
        if under.active[0] > 0.5:
            # A motion takes its swivels along; only what is added is eased.
            now += wrap(goal - st.examples[limb])
        st.examples[limb] = goal
        if limb >= 2 and under.active[0] < 0.5:
            goal -= 0.5 * wrap(twist_of(st.feet[limb - 2]) - st.heading[0])
            # Hips that turn far with a twisted trunk take the knees over standing feet only half-way along.
            turned = wrap(twist_of(parent) - st.heading[0])
            goal += 0.5 * st.support[limb - 2] * (turned - min(KNEES_ALONG, max(-KNEES_ALONG, turned)))
        if held.flags[8 + limb] > 0.5:
            n = 0.0
            for k in range(3):
                axis[k] = st.points[1 + limb, k] - positions_ws[upper, k]
                pole[k] = held.hinges[limb, k] - positions_ws[upper, k]
                n += axis[k] * axis[k]
            n = max(sqrt(n), 1e-6)
            for k in range(3):
                axis[k] /= n
            along = axis[0] * pole[0] + axis[1] * pole[1] + axis[2] * pole[2]
            out = 0.0
            for k in range(3):
                out += (pole[k] - along * axis[k]) ** 2
            inv_rotate(parent, axis, axis)
            inv_rotate(parent, pole, pole)
            wanted = swivel_of(axis, pole, rig.references[limb, 0], rig.references[limb, 1])
            wanted -= under.swivels[limb]
            away = wrap(wanted - goal)
            if limb >= 2 and st.planted[limb - 2] > 0.5 and under.active[0] < 0.5:
                # Over a foot that stands the hip twists only so far.
                away = min(STANDING_TWIST, max(-STANDING_TWIST, away))
            goal += min(1.0, sqrt(out) / 0.05) * away
        plain[limb] = under.swivels[limb] + now + wrap(goal - now)
        aim = np.array([now + wrap(goal + st.pushes[limb] - now)])
        st.extra[limb] = now
        spring_to_into(st.extra[limb : limb + 1], st.extra_rates[limb : limb + 1], aim, gains.swivel_half_life, dt)
        over = under.active[0] > 0.5 and limb < 2 and held.flags[1 + limb] < 0.5 and held.flags[8 + limb] < 0.5
        if st.mode[0] < 1.5 or over:
            # (Over a motion a free arm is as that has it, and what a touch has left evens out by `even_limbs`.)
            st.extra[limb], st.extra_rates[limb] = aim[0], 0.0
        elif held.flags[8 + limb] < 0.5:
            way = 0.0
            for k in range(3):
                way += (st.points[1 + limb, k] - positions_ws[upper, k] - before[1 + limb, k] + st.roots[limb, k]) ** 2
            most = SWIVEL_PER_WAY * sqrt(way) + SWIVEL_RATE * dt
            st.extra[limb] = now + min(most, max(-most, st.extra[limb] - now))
        st.swivels[limb] = under.swivels[limb] + st.extra[limb]
