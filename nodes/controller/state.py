"""What the controller keeps from step to step, what it is asked for, and the numbers it works with."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.pointpose import Base, rest_base
from bunraku.figure.rig import Rig

Array = NDArray[np.float64]


class Gains(NamedTuple):
    """Weights and speeds. Values given by Oshita 2013 are the defaults; the others are ours.

    m, s, rad; a time is a time constant where nothing else is said.
    """

    w_tracking: float = 1.0
    w_balance: float = 1.0
    w_interaction: float = 0.1
    w_relaxing: float = 0.1
    w_collision: float = 1.0
    ee_to_trunk: float = 2.0
    """Influence of an end's velocity on the trunk (eq. 20)."""
    trunk_to_ee: float = 0.2
    """Influence of the trunk's velocity on the ends (eq. 22)."""
    pelvis_trunk: float = 0.5
    """The pelvis's part of a balance correction (eqs 17-18)."""
    relax_trunk: float = 0.45
    """rad/s at which the trunk and the head come upright."""
    relax_ends: float = 0.34
    """m/s at which free hands sink."""
    relax_reach: float = 0.2
    """m/s at which the pelvis comes back from a reach."""
    relax_feet: float = 0.40
    """m/s at which free feet sink to the floor."""
    relax_pelvis: float = 0.0
    """m/s at which a released pelvis comes back; 0 leaves it where it was let go."""
    relax_time: float = 0.22
    """Time constant of the last bit of relaxing."""
    ease_time: float = 0.05
    """Time constant with which a relaxing part takes up its speed."""
    half_life: float = 0.08
    """Half-life of what a grab, a release or a jump of the target leaves to even out."""
    swivel_half_life: float = 0.04
    """Half-life with which elbows and knees follow their swivel."""
    input_speed: float = 8.0
    """m/s: a target that moves faster has jumped, and the jump is evened out."""
    turn_speed: float = 2.5
    """rad/s at which the figure turns."""
    margin: float = 0.02
    """m that the centre of mass keeps inside the edge of the support polygon."""
    support_time: float = 0.12
    """Half-life with which a lifted foot leaves the support polygon."""
    clearance: float = 0.002
    """m kept between parts of the body."""
    duck: float = 0.55
    """Shortest hip to ankle, as a share of the leg, with the foot on the ground."""
    step_lift: float = 0.07
    """m by which a stepping foot is lifted."""
    step_time: float = 0.24
    """s that every phase of a step takes at least."""
    step_pace: float = 0.40
    """s/m added for its length."""


TRUNK_LEAN = np.radians([80.0, 30.0, 38.0])
"""How far the trunk leans forward, backward and to a side (rad, pelvis and back together)."""
TRUNK_TWIST = np.radians(35.0)
"""How far the trunk turns against the figure's heading."""
ANKLE_BEND = np.radians(42.0)
"""How far the shin leans forward over a flat foot."""


class State(NamedTuple):
    """Everything that a step changes: views of one buffer, so that it is saved and restored whole."""

    points: Array  # (5, 3) m, the point pose as put out
    velocities: Array  # (5, 3) m/s against each part's own goal
    turns: Array  # (2, 4)
    spins: Array  # (2, 3) rad/s
    swivels: Array  # (4,) rad, as put out
    extra: Array  # (4,) rad beyond the motion's own swivel
    extra_rates: Array  # (4,)
    pushes: Array  # (4,) rad by which self-collision turns the elbows and knees
    feet: Array  # (2, 4) world orientation of the feet where they stand
    feet_level: Array  # (2,)
    planted: Array  # (2,) 1 for a foot that holds its place
    drifts: Array  # (2, 3) m/s and rad/s at which pelvis and trunk really moved
    support: Array  # (2,) 0..1, how much of each sole is in the support polygon
    heading: Array  # (2,) rad, rad/s
    roots: Array  # (4, 3) where the limbs hung
    goals: Array  # (5, 3) where the parts would rest; hands against their shoulders
    goal_turns: Array  # (2, 4)
    held: Array  # (12,) what was held: five points, trunk, head, yaw, four elbows and knees
    targets: Array  # (5, 3)
    aims: Array  # (5, 3) m, where held points are wanted, offset included
    target_turns: Array  # (2, 4)
    offsets: Array  # (5, 3) m from target to part, evening out
    offset_rates: Array  # (5, 3)
    turn_offsets: Array  # (2, 3) rad
    turn_offset_rates: Array  # (2, 3)
    pelvis_rest: Array  # (3,) m, where the pelvis was left against its place over the feet
    beyond: Array  # (4, 3) m, forearm or shin when its elbow or knee was grabbed
    lift: Array  # (2,) a foot that a held knee has lifted
    mode: Array  # (3,) started, over a motion, something touches
    step: Array  # (32,) see bunraku.nodes.controller.step


_SHAPES = {
    "points": (5, 3), "velocities": (5, 3), "turns": (2, 4), "spins": (2, 3), "swivels": (4,), "extra": (4,),
    "extra_rates": (4,), "pushes": (4,), "feet": (2, 4), "feet_level": (2,), "planted": (2,), "drifts": (2, 3),
    "support": (2,), "heading": (2,), "roots": (4, 3), "goals": (5, 3), "goal_turns": (2, 4), "held": (12,),
    "targets": (5, 3), "aims": (5, 3),
    "target_turns": (2, 4), "offsets": (5, 3), "offset_rates": (5, 3), "turn_offsets": (2, 3),
    "turn_offset_rates": (2, 3), "pelvis_rest": (3,), "beyond": (4, 3), "lift": (2,),
    "mode": (3,), "step": (32,),
}  # fmt: skip
STATE_SIZE = sum(int(np.prod(shape)) for shape in _SHAPES.values())


def state_views(buffer: Array) -> State:
    """The state that lies in a flat buffer of `STATE_SIZE` numbers."""
    if buffer.shape != (STATE_SIZE,):
        raise ValueError(f"a state has {STATE_SIZE} numbers, not {buffer.size}")
    views, at = [], 0
    for shape in _SHAPES.values():
        size = int(np.prod(shape))
        views.append(buffer[at : at + size].reshape(shape))
        at += size
    return State(*views)


class Held(NamedTuple):
    """What is held now; rows whose flag is 0 mean nothing."""

    flags: Array  # (12,) five points, trunk, head, yaw, four elbows and knees
    points: Array  # (5, 3) m
    turns: Array  # (2, 4)
    yaw: Array  # (1,) rad
    hinges: Array  # (4, 3) m, held elbows and knees


def nothing_held() -> Held:
    """Held by nobody."""
    turns = np.zeros((2, 4))
    turns[:, 3] = 1.0
    return Held(np.zeros(12), np.zeros((5, 3)), turns, np.zeros(1), np.zeros((4, 3)))


class Under(NamedTuple):
    """The motion that the stack is laid over, or the rest pose."""

    active: Array  # (1,) 1 over a motion
    base: Base
    points: Array  # (5, 3) m
    turns: Array  # (2, 4)
    swivels: Array  # (4,) rad beyond the examples' (see `default_swivel`)
    feet: Array  # (2, 4)
    contacts: Array  # (2,)
    roots: Array  # (4, 3) m, where its limbs hang


def rest_under(rig: Rig) -> Under:
    """No motion: the figure stands by itself."""
    turns = np.zeros((2, 4))
    turns[:, 3] = 1.0
    return Under(
        np.zeros(1), rest_base(rig), np.zeros((5, 3)), turns, np.zeros(4), turns.copy(), np.ones(2), np.zeros((4, 3))
    )  # fmt: skip
