"""What the controller keeps from step to step, what it is asked for, and the numbers it works with."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel
from bunraku.figure.pointpose import Base
from bunraku.figure.rig import DEEPEST_CROUCH

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
    """Above 0 parts of the body are kept apart wholly (there is no half of that); 0 lets them overlap."""
    ee_to_trunk: float = 2.0
    """Influence of an end's velocity on the trunk (eq. 20)."""
    trunk_to_ee: float = 0.2
    """Influence of the trunk's velocity on the ends (eq. 22)."""
    pelvis_trunk: float = 0.5
    """The pelvis's part of a balance correction (eqs 17-18)."""
    relax_trunk: float = 0.33
    """rad/s at which the trunk and the head come upright."""
    relax_ends: float = 0.40
    """m/s at which free hands sink."""
    relax_reach: float = 0.16
    """m/s at which the pelvis comes back from a reach."""
    landing_half_life: float = 0.10
    """Half-life with which a free foot comes down to the floor, and the pelvis to meet it."""
    relax_pelvis: float = 0.0
    """m/s at which a released pelvis comes back; 0 leaves it where it was let go."""
    relax_time: float = 0.22
    """Time constant of the last bit of relaxing."""
    ease_time: float = 0.05
    """Time constant with which a relaxing part takes up its speed."""
    half_life: float = 0.10
    """Half-life of what a grab, a release or a jump of the target leaves to even out."""
    swivel_half_life: float = 0.04
    """Half-life with which elbows and knees follow their swivel."""
    input_speed: float = 12.0
    """m/s up to which a held part is right under its target; what is twice as fast has jumped and is evened out."""
    turn_speed: float = 2.5
    """rad/s at which the figure turns."""
    margin: float = 0.02
    """m that the centre of mass keeps inside the edge of the support polygon."""
    support_time: float = 0.12
    """Half-life with which a lifted foot leaves the support polygon."""
    clearance: float = 0.002
    """m kept between parts of the body."""
    duck: float = DEEPEST_CROUCH
    """Shortest hip to ankle, as a share of the leg, with the foot on the ground."""
    step_lift: float = 0.07
    """m by which a stepping foot is lifted."""
    step_time: float = 0.24
    """s that every phase of a step takes at least."""
    step_pace: float = 0.40
    """s/m added for its length."""
    motion_half_life: float = 0.15
    """Half-life of what a touch leaves between a motion and the figure that is laid over it."""


TRUNK_LEAN = np.radians([80.0, 30.0, 38.0])
"""How far the trunk leans forward, backward and to a side (rad, pelvis and back together)."""
TRUNK_TWIST = np.radians(35.0)
"""How far the trunk turns against the figure's heading."""
ANKLE_BEND = np.radians(36.0)
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
    examples: Array  # (4,) rad, the examples' swivels at the last step
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
    wishes: Array  # (4, 3) m, the ends as they went into the limbs, before joint limits held them back
    stuck: Array  # (4,) s that a free limb could not go on
    hurry: Array  # (4,) m/s, how fast each limb's goal has moved lately
    beyond: Array  # (4, 3) m, forearm or shin when its elbow or knee was grabbed, against the heading
    lift: Array  # (2,) a foot that a held knee has lifted
    mode: Array  # (3,) started, over a motion, something touches or pulls
    step: Array  # (32,) see bunraku.nodes.controller.step
    leads: Array  # (4, 3, 4) each limb's joints at the last step, without fades; 0 over no motion
    bases: Array  # (4, 3, 4) the same of the motion
    reaches: Array  # (4, 3) m, where held ends were wanted, seen from what their limbs hang from; 0 for free ones
    fades: Array  # (4, 3, 3) rad, what is left of changes that were too quick
    fade_rates: Array  # (4, 3, 3) rad/s
    lead_rates: Array  # (2, 3, 3) rad/s, how fast held arms' joints leave their motion
    legs: Array  # (2, 2, 4) hips and knees of both legs, as put out
    legs_kept: Array  # (2,) 1 where joint limits held that leg off its foot's place
    sought: Array  # (2,) the same in this step
    landed: Array  # (2,) 1 for a free foot that is where it can stand, -1 for one that something holds above that
    leg_pace: Array  # (2,) rad by which such a leg goes back to its swivel in this step
    leg_rates: Array  # (2,) rad/s, how fast the fastest joint of each leg in the air turned
    dodges: Array  # (2, 3) rad by which free arms are turned out of the body over a motion
    dodge_rates: Array  # (2, 3) rad/s


STATE_SIZE = 521
"""Numbers in a state."""


@kernel
def unpack_state(b: Array) -> State:
    """The state that lies in a flat buffer of `STATE_SIZE` numbers, as views."""
    return State(
        b[0:15].reshape(5, 3),
        b[15:30].reshape(5, 3),
        b[30:38].reshape(2, 4),
        b[38:44].reshape(2, 3),
        b[44:48],
        b[48:52],
        b[52:56],
        b[56:60],
        b[60:64],
        b[64:72].reshape(2, 4),
        b[72:74],
        b[74:76],
        b[76:82].reshape(2, 3),
        b[82:84],
        b[84:86],
        b[86:98].reshape(4, 3),
        b[98:113].reshape(5, 3),
        b[113:121].reshape(2, 4),
        b[121:133],
        b[133:148].reshape(5, 3),
        b[148:163].reshape(5, 3),
        b[163:171].reshape(2, 4),
        b[171:186].reshape(5, 3),
        b[186:201].reshape(5, 3),
        b[201:207].reshape(2, 3),
        b[207:213].reshape(2, 3),
        b[213:216],
        b[216:228].reshape(4, 3),
        b[228:232],
        b[232:236],
        b[236:248].reshape(4, 3),
        b[248:250],
        b[250:253],
        b[253:285],
        b[285:333].reshape(4, 3, 4),
        b[333:381].reshape(4, 3, 4),
        b[381:393].reshape(4, 3),
        b[393:429].reshape(4, 3, 3),
        b[429:465].reshape(4, 3, 3),
        b[465:483].reshape(2, 3, 3),
        b[483:499].reshape(2, 2, 4),
        b[499:501],
        b[501:503],
        b[503:505],
        b[505:507],
        b[507:509],
        b[509:515].reshape(2, 3),
        b[515:521].reshape(2, 3),
    )


class Held(NamedTuple):
    """What is held now; rows whose flag is 0 mean nothing."""

    flags: Array  # (12,) five points, trunk, head, yaw, four elbows and knees
    points: Array  # (5, 3) m
    turns: Array  # (2, 4)
    yaw: Array  # (1,) rad
    hinges: Array  # (4, 3) m, held elbows and knees


HELD_SIZE = 48
"""Numbers in a `Held`."""


@kernel
def unpack_held(b: Array) -> Held:
    """What is held, as views of a buffer of `HELD_SIZE` numbers."""
    return Held(b[0:12], b[12:27].reshape(5, 3), b[27:35].reshape(2, 4), b[35:36], b[36:48].reshape(4, 3))


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
    center: Array  # (3,) m, its centre of mass


def under_size(joints: int) -> int:
    """Numbers in an `Under` of so many joints."""
    return 91 + 8 * joints


@kernel
def unpack_under(b: Array, joints: int) -> Under:
    """What the stack is laid over, as views of a buffer of `under_size` numbers."""
    k = 91
    base = Base(
        b[k : k + 4 * joints].reshape(joints, 4), b[k + 4 * joints : k + 8 * joints].reshape(joints, 4),
        b[50:82].reshape(4, 2, 4), b[82:86], b[89:91],
    )  # fmt: skip
    return Under(
        b[0:1], base, b[1:16].reshape(5, 3), b[16:24].reshape(2, 4), b[24:28], b[28:36].reshape(2, 4), b[36:38],
        b[38:50].reshape(4, 3), b[86:89],
    )  # fmt: skip


@kernel
def unpack_gains(b: Array) -> Gains:
    """The gains that lie in an array in the order of their fields."""
    return Gains(
        b[0],
        b[1],
        b[2],
        b[3],
        b[4],
        b[5],
        b[6],
        b[7],
        b[8],
        b[9],
        b[10],
        b[11],
        b[12],
        b[13],
        b[14],
        b[15],
        b[16],
        b[17],
        b[18],
        b[19],
        b[20],
        b[21],
        b[22],
        b[23],
        b[24],
        b[25],
        b[26],
    )
