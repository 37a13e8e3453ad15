"""Over a motion: free parts are where the motion has them, plus what a touch has left, which evens out.

The motion's own movement is never smoothed; only the way from it to the figure is, as a critically damped spring.
"""

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel
from bunraku.figure.quat import exp, log, mul, mul_inv
from bunraku.figure.spring import spring_decay_into
from bunraku.nodes.controller.state import State

Array = NDArray[np.float64]


@kernel
def way_from_motion(st: State, goals: Array, goal_turns: Array, ways: Array, turns: Array) -> None:
    """From the motion's parts to the figure's: ``ways`` (5, 3) m, hands against their shoulders, ``turns`` (2, 3)."""
    q = np.empty(4)
    for n in range(5):
        for k in range(3):
            ways[n, k] = st.points[n, k] - goals[n, k]
            if n == 1 or n == 2:
                ways[n, k] -= st.roots[n - 1, k]
    for n in range(2):
        mul_inv(st.turns[n], goal_turns[n], q)
        log(q, turns[n])


@kernel
def ease_point(way: Array, velocity: Array, goal: Array, half_life: float, dt: float, out: Array) -> None:
    """Where a free part (3, m) is: at the motion's place with what is left of the way (3) from it."""
    spring_decay_into(way, velocity, half_life, dt)
    for k in range(3):
        out[k] = goal[k] + way[k]


@kernel
def ease_turn(way: Array, spin: Array, goal: Array, half_life: float, dt: float, out: Array) -> None:
    """`ease_point` for an orientation (4); the way (3) is a rotation vector."""
    q = np.empty(4)
    spring_decay_into(way, spin, half_life, dt)
    exp(way, q)
    mul(q, goal, out)


@kernel
def remember_ways(st: State, before: Array, turned: Array, goals: Array, goal_turns: Array, span: float) -> None:
    """Keep how fast every part moves against the motion, so that one that is let go goes on as it moved.

    ``before`` (5, 3) and ``turned`` (2, 3) are the ways of the last step (`way_from_motion`).
    """
    ways, turns = np.empty((5, 3)), np.empty((2, 3))
    way_from_motion(st, goals, goal_turns, ways, turns)
    for n in range(5):
        for k in range(3):
            st.velocities[n, k] = (ways[n, k] - before[n, k]) / span
    for n in range(2):
        for k in range(3):
            st.spins[n, k] = (turns[n, k] - turned[n, k]) / span
