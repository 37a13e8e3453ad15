"""Ankles and toes of a figure that is played: within their ranges, and out of the ground while a foot is in the air."""

from math import exp, sqrt
from math import log as log_of

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel
from bunraku.figure.quat import from_axis_angle, log, mul, rotate, slerp
from bunraku.figure.spring import spring_decay_into
from bunraku.motion.footprint import Feet, planted, soft_part, sole_depth, yaw_pitch

Array = NDArray[np.float64]

NEAR = 0.03
"""Share of an ankle's range over which it is held back, softly."""
TOES_UP = 1.45
"""rad: as far as toes bend up."""
TOES = 0.05
"""s, half-life in which they come back."""
JERKED = 420.0
"""rad/s²: no faster are they bent up."""


@kernel
def ankle_excess(feet: Feet, turn_ls: Array) -> float:
    """By how much (rad) an ankle (its local rotation, 4) is bent beyond its range: plantar > 0, dorsal < 0."""
    v = np.empty(3)
    log(turn_ls, v)
    low, high, aside = feet.ankle[0], feet.ankle[1], feet.ankle[2]
    # What it is turned aside leaves less for bending: the range is an ellipse.
    room = (1.0 - NEAR) * sqrt(max(1.0 - (v[2] / aside) ** 2, 0.25))
    return soft_part(v[0] - room * high, NEAR * high) - soft_part(room * low - v[0], -NEAR * low)


@kernel
def pitch_ankle(feet: Feet, turn_ls: Array, turn: Array) -> bool:
    """Pitch a free foot (orientation ``turn``, 4, in place) by what its ankle is beyond its range; whether it was."""
    over = ankle_excess(feet, turn_ls)
    if over == 0.0:
        return False
    back = np.empty(4)
    from_axis_angle(1.0, 0.0, 0.0, -over, back)
    mul(turn, back, turn)
    return True


@kernel
def roll_ankle(feet: Feet, side: int, mark: Array, offset: Array, turn_ls: Array, goal: Array, turn: Array) -> bool:
    """Roll a foot on its print (5) by what its ankle is beyond its range: sets ``goal`` (3) and ``turn`` (4).

    ``offset`` (3) is what it is above its print (m), pitched and leaned (rad); whether it was rolled is returned.
    """
    over = ankle_excess(feet, turn_ls)
    if over == 0.0:
        return False
    angles = np.empty(2)
    yaw_pitch(turn, angles)
    planted(feet, side, mark, angles[1] - mark[4] + over, offset[2], goal, turn)
    goal[1] += offset[0]
    return True


@kernel
def lift_out(feet: Feet, side: int, turn: Array, height: float, goal: Array) -> None:
    """Raise an ankle (``goal``, 3, in place), softly, so that heel and ball of its foot are not in the ground."""
    graze = feet.limits[11]
    depth = sole_depth(feet, side, goal, turn, height)
    if depth > 0.0:
        goal[1] += depth * depth / (2.0 * graze) if depth < graze else depth - 0.5 * graze


@kernel
def bend_toes(
    feet: Feet, side: int, joint: Array, turn: Array, height: float, free: bool, bent: Array, toes_ls: Array, dt: float
) -> None:
    """Bend toes (``toes_ls``, 4, in place) up where the tips of a free foot's would be in the ground; never at once.

    Args:
        joint: (3) m, the toe joint. turn: (4) the foot's orientation. height: m, of the ground.
        bent: (2) rad and rad/s, by which they are bent more; kept from step to step.
    """
    thick, long = feet.tips[side, 0], feet.tips[side, 1]
    toes, tip, v, up = np.empty(4), np.empty(3), np.empty(3), np.empty(4)
    log(toes_ls, v)
    room = max(TOES_UP + v[0], 0.05)
    before, need = bent[0], 0.0
    if free:
        # No deeper than the sole is under the joint itself, which the foot's roll may lower.
        ground = min(height, joint[1] - thick)
        for _ in range(2):
            from_axis_angle(1.0, 0.0, 0.0, -need, up)
            mul(toes_ls, up, toes)
            mul(turn, toes, toes)
            tip[0], tip[1], tip[2] = 0.0, -thick, long
            rotate(toes, tip, tip)
            need += soft_part(ground - joint[1] - tip[1], feet.limits[11]) / long
        need = -room * log_of(1.0 - min(need / room, 0.85))
    rate = bent[1]
    spring_decay_into(bent[0:1], bent[1:2], TOES, dt)
    if need > bent[0]:
        bent[1] = min((need - before) / max(dt, 1e-9), max(rate, 0.0) + JERKED * dt)
        bent[0] = before + bent[1] * dt
    from_axis_angle(1.0, 0.0, 0.0, -room * (1.0 - exp(-max(bent[0], 0.0) / room)), up)
    mul(toes_ls, up, toes_ls)


@kernel
def lay_toes(
    feet: Feet, side: int, slope: float, grip: float, height: float, clear: bool, offset: Array, bent: Array,
    positions_ws: Array, rotations_ws: Array, rotations_ls: Array, dt: float,
) -> None:  # fmt: skip
    """Bring a foot's toes after it, in place: flat on the ground under a foot that is held, out of it otherwise.

    Args:
        slope: rad, of the print. grip: 0..1, how far the foot is held. height: m, of the ground.
        clear: keep the tip of free toes out of the ground. offset: (3) m, of the toe joint. bent: as of `bend_toes`.
        positions_ws, rotations_ws, rotations_ls: of all joints.
    """
    foot, toes = feet.joints[side, 2], feet.joints[side, 3]
    angles, turn, ahead = np.empty(2), np.empty(4), np.empty(3)
    if grip > 1e-3:
        yaw_pitch(rotations_ws[foot], angles)
        from_axis_angle(1.0, 0.0, 0.0, -min(max(-(angles[1] - slope), 0.0), TOES_UP), turn)
        slerp(rotations_ls[toes], turn, grip, rotations_ls[toes])
    rotate(rotations_ws[foot], offset, ahead)
    for k in range(3):
        positions_ws[toes, k] = positions_ws[foot, k] + ahead[k]
    bend_toes(feet, side, positions_ws[toes], rotations_ws[foot], height, clear, bent, rotations_ls[toes], dt)
    mul(rotations_ws[foot], rotations_ls[toes], rotations_ws[toes])
