"""What the ground asks of the body: legs that reach their planted feet, feet that come down well apart."""

from math import acos, atan2, cos, exp, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel
from bunraku.figure.quat import rotate
from bunraku.figure.rig import PELVIS_BACK_RATIO, Rig
from bunraku.nodes.controller.state import ANKLE_BEND, TRUNK_LEAN
from bunraku.nodes.controller.step import (
    DURATION,
    FIRST,
    FROM,
    HEADING,
    LEFT,
    PHASE,
    PREPARE,
    RIGHT,
    SWING_FIRST,
    TIME,
    TO,
    minimum_jerk,
)

Array = NDArray[np.float64]

ANKLE, FORWARD = float(ANKLE_BEND), float(TRUNK_LEAN[0])
HIP_FLEXION, FOLD = 1.90, 2.30
"""rad: how far a hip bends, and how far trunk and thigh fold before they touch."""
LANDING_HIGH, LANDING_BLEND = 0.16, 0.08  # m above the ground where the pelvis begins to meet a landing foot
LANDING_REACH = 0.965  # share of the leg's length with which a foot lands
NARROW, WIDE, LONG = 0.12, 0.45, 0.24
"""m: how near and far aside, and how far ahead or behind, a foot comes down from the other one."""
NEAR_BOTH, BESIDE, NEAR_ONE = 0.17, 0.03, 0.20
"""m: how far the pelvis gets from the line between both feet, past its ends, or from the one that stands."""
CALM_KNEE = 0.90
"""rad/s: the fastest that a knee turns by relaxing."""
RISE_TO_STEP = 1.2
"""m/s at which a step brings a low pelvis up at most beyond its course."""
STRETCH_TIME = 0.1
"""s, time constant in which a planted leg stretches to its end under a held pelvis."""
LOWEST_PELVIS = 0.25
"""m above the floor."""


@kernel
def keep_pelvis_over_feet(
    rig: Rig, exact: Array, pelvis: Array, hips: Array, points: Array, feet: Array, planted: Array, duck: float,
    rise: bool, near: bool, shins: bool,
) -> None:  # fmt: skip
    """Move the pelvis (3, m, in place) the least that lets the legs reach every planted foot.

    Args:
        exact: (4,) m, how far each limb reaches exactly (a `Base`'s).
        hips: (2, 3) m from the pelvis to each hip joint.
        duck: least hip to ankle as a share of the leg.
        near: whether the pelvis also has to be near its feet (not while they step).
        shins: whether they may lean only so far (a motion's own lean as its maker wanted).
        rise: where the shins lean too far, rise instead of sitting back (balance needs the place).
    """
    forward, ahead = np.empty(3), np.array([0.0, 0.0, 1.0])
    v = np.empty(3)
    pelvis[1] = max(pelvis[1], LOWEST_PELVIS)
    for _ in range(6):
        worst = keep_near_feet(points, planted, pelvis) if near else 0.0
        for side in range(2):
            if planted[side] < 0.5:
                continue
            upper, lower = rig.lengths[2 + side, 0], rig.lengths[2 + side, 1]
            d = 0.0
            for k in range(3):
                v[k] = points[3 + side, k] - pelvis[k] - hips[side, k]
                d += v[k] * v[k]
            d = max(sqrt(d), 1e-6)
            longest = exact[2 + side]
            shortest = max(duck * (upper + lower), rig.reach[2 + side, 0])
            off = 0.0
            if d > longest:
                off = 1.0 - longest / d
            elif d < shortest:
                off = 1.0 - shortest / d
            for k in range(3):
                pelvis[k] += off * v[k]
            worst = max(worst, abs(off) * d)
            if not shins:
                continue
            # The shin may lean over the foot only so far; farther down, the seat goes back.
            d = min(longest, max(shortest, d))
            rotate(feet[side], ahead, forward)
            n = max(sqrt(forward[0] ** 2 + forward[2] ** 2), 1e-6)
            fx, fz = forward[0] / n, forward[2] / n
            hip_ahead = (pelvis[0] + hips[side, 0] - points[3 + side, 0]) * fx
            hip_ahead += (pelvis[2] + hips[side, 2] - points[3 + side, 2]) * fz
            height = max(pelvis[1] + hips[side, 1] - points[3 + side, 1], 1e-3)
            fold = (d * d + lower * lower - upper * upper) / (2.0 * d * lower)
            lean = acos(min(1.0, max(-1.0, fold))) + atan2(hip_ahead, height)
            if lean > ANKLE:
                back = min(height * (lean - ANKLE), 0.05)
                if rise:
                    pelvis[1] += back
                else:
                    pelvis[0] -= back * fx
                    pelvis[2] -= back * fz
                worst = max(worst, back)
        if worst < 1e-6:
            break
    pelvis[1] = max(pelvis[1], LOWEST_PELVIS)


@kernel
def reach_gently(
    rig: Rig, exact: Array, positions_ws: Array, points: Array, planted: Array, held: bool, dt: float, out: Array
) -> None:
    """How far (4,) m each limb reaches in this step: planted legs under a held pelvis stretch to their ends no faster
    than they stop there, for a knee that is nearly straight turns fast for little way.

    ``exact`` (4,) m see `Base`; ``positions_ws`` is how everything was.
    """
    for limb in range(4):
        out[limb] = exact[limb]
        if limb < 2 or not held or planted[limb - 2] < 0.5:
            continue
        was = 0.0
        for k in range(3):
            was += (points[1 + limb, k] - positions_ws[rig.limbs[limb, 0], k]) ** 2
        was = sqrt(was)
        if was < exact[limb]:
            out[limb] = exact[limb] - (exact[limb] - was) * exp(-dt / STRETCH_TIME)


@kernel
def least_hip_height(upper: float, lower: float, ahead: float) -> float:
    """How high a hip must be over its ankle (m) so that the shin leans no farther than an ankle bends.

    ``ahead`` is how far the hip is in front of the ankle (m); 0 where no height is too low.
    """
    out = ahead - lower * sin(ANKLE)
    if abs(out) >= upper:
        return 0.0
    return float(lower * cos(ANKLE) + sqrt(upper * upper - out * out))


@kernel
def rise_to_step(
    rig: Rig, step: Array, pelvis: Array, hips: Array, points: Array, planted: Array, yaws: Array, most: float
) -> None:
    """Bring a low pelvis (3, m, in place) up in time for where a step takes it: no ankle bends too far there.

    A planted foot that is left behind, and one that comes down behind, ask for a higher hip than one below it.

    Args:
        hips: (2, 3) m from the pelvis to each hip joint; points: (5, 3) m; yaws: (2,) rad of the feet.
        most: m by which it rises at most beyond what the course of the step says.
    """
    first = int(step[FIRST])
    moving = -1
    if step[PHASE] != PREPARE:
        moving = first if step[PHASE] == SWING_FIRST else 1 - first
    then, now = 0.0, 0.0
    for side in range(2):
        upper, lower = rig.lengths[2 + side, 0], rig.lengths[2 + side, 1]
        goal = LEFT if side == 0 else RIGHT
        x, z, yaw = points[3 + side, 0], points[3 + side, 2], yaws[side]
        if side == moving:
            x, z, yaw = step[goal], step[goal + 2], step[HEADING]
        fx, fz = sin(yaw), cos(yaw)
        up = rig.ankle_heights[side] - hips[side, 1]
        ahead = (step[TO] + hips[side, 0] - x) * fx + (step[TO + 2] + hips[side, 2] - z) * fz
        then = max(then, up + least_hip_height(upper, lower, ahead))
        if planted[side] > 0.5:
            ahead = (pelvis[0] + hips[side, 0] - x) * fx + (pelvis[2] + hips[side, 2] - z) * fz
            now = max(now, up + least_hip_height(upper, lower, ahead))
    s = minimum_jerk(step[TIME] / max(step[DURATION], 1e-9))
    pelvis[1] = max(pelvis[1], step[FROM + 1] + s * (then - step[FROM + 1]) if then > step[FROM + 1] else 0.0)
    pelvis[1] = max(pelvis[1], min(now, pelvis[1] + most))


@kernel
def keep_near_feet(points: Array, planted: Array, pelvis: Array) -> float:
    """Keep the pelvis, seen from above, near the line between its planted feet; how far it was moved (m)."""
    if planted[0] < 0.5 and planted[1] < 0.5:
        return 0.0
    a = 3 if planted[0] > 0.5 else 4
    b = 4 if planted[1] > 0.5 else 3
    ex, ez = points[b, 0] - points[a, 0], points[b, 2] - points[a, 2]
    x, z = pelvis[0] - points[a, 0], pelvis[2] - points[a, 2]
    length = sqrt(ex * ex + ez * ez)
    if length < 1e-6:
        d = sqrt(x * x + z * z)
        keep = min(1.0, NEAR_ONE / max(d, 1e-9))
        pelvis[0] += (keep - 1.0) * x
        pelvis[2] += (keep - 1.0) * z
        return (1.0 - keep) * d
    ex, ez = ex / length, ez / length
    along, across = x * ex + z * ez, z * ex - x * ez
    to_along = min(length + BESIDE, max(-BESIDE, along))
    to_across = min(NEAR_BOTH, max(-NEAR_BOTH, across))
    pelvis[0] += (to_along - along) * ex - (to_across - across) * ez
    pelvis[2] += (to_along - along) * ez + (to_across - across) * ex
    return float(abs(to_along - along) + abs(to_across - across))


@kernel
def landing_place(rig: Rig, side: int, x: Array, anchor: Array, over_foot: bool, heading: float, out: Array) -> None:
    """Where a free foot at ``x`` (3, m) comes down: straight below, but well apart from the other foot.

    ``anchor`` (3) is the other foot's ankle or, with ``over_foot`` false, the pelvis.
    """
    sign = 1.0 if side == 0 else -1.0
    c, s = cos(heading), sin(heading)
    dx, dz = x[0] - anchor[0], x[2] - anchor[2]
    aside, ahead = sign * (c * dx - s * dz), s * dx + c * dz
    shift = 0.0 if over_foot else 0.09
    aside = min(WIDE - shift, max(NARROW - shift, aside))
    ahead = min(LONG, max(-LONG, ahead))
    out[0] = anchor[0] + c * sign * aside + s * ahead
    out[1] = rig.ankle_heights[side]
    out[2] = anchor[2] - s * sign * aside + c * ahead


@kernel
def sink_to_land(rig: Rig, side: int, foot: Array, landing: Array, pelvis: Array, heading: float, free: bool) -> float:
    """How far the pelvis (3, m) must sink for a foot (3, m), free or near the ground, to reach its landing (3).

    A straight standing leg leaves the other one hanging wherever it is not right below its hip.
    """
    near = 1.0 if free else min(1.0, max(0.0, (LANDING_HIGH - (foot[1] - landing[1])) / LANDING_BLEND))
    if near <= 0.0:
        return 0.0
    c, s = cos(heading), sin(heading)
    hip = rig.limbs[2 + side, 0]
    x = rig.rest_positions[hip, 0] - rig.rest_positions[0, 0]
    y = rig.rest_positions[hip, 1] - rig.rest_positions[0, 1]
    z = rig.rest_positions[hip, 2] - rig.rest_positions[0, 2]
    dx = landing[0] - (pelvis[0] + c * x + s * z)
    dz = landing[2] - (pelvis[2] + c * z - s * x)
    leg = LANDING_REACH * rig.reach[2 + side, 1]
    tall = sqrt(max(0.25 * leg * leg, leg * leg - dx * dx - dz * dz))
    return float(near * max(0.0, pelvis[1] + y - landing[1] - tall))


@kernel
def pelvis_home(rig: Rig, points: Array, support: Array, heading: float, out: Array) -> None:
    """Where the pelvis (3, m) stands at ease over its feet."""
    total = 0.0
    out[0], out[2] = 0.0, 0.0
    for side in range(2):
        w = 0.01 + support[side]
        out[0] += w * points[3 + side, 0]
        out[2] += w * points[3 + side, 2]
        total += w
    out[0] /= total
    out[2] /= total
    hip_x = 0.5 * (rig.rest_positions[rig.limbs[2, 0], 0] + rig.rest_positions[rig.limbs[3, 0], 0])
    hip_z = 0.5 * (rig.rest_positions[rig.limbs[2, 0], 2] + rig.rest_positions[rig.limbs[3, 0], 2])
    drop = rig.rest_positions[0, 1] - 0.5 * (
        rig.rest_positions[rig.limbs[2, 0], 1] + rig.rest_positions[rig.limbs[3, 0], 1]
    )
    c, s = cos(heading), sin(heading)
    hip_z -= rig.rest_positions[0, 2]
    hip_x -= rig.rest_positions[0, 0]
    out[0] -= c * hip_x + s * hip_z
    out[2] -= c * hip_z - s * hip_x
    leg = 0.5 * (rig.reach[2, 1] + rig.reach[3, 1])
    out[1] = 0.5 * (rig.ankle_heights[0] + rig.ankle_heights[1]) + 0.9985 * leg + drop


@kernel
def lean_room(rig: Rig, positions_ws: Array, planted: Array, heading: float, out: Array) -> None:
    """What room planted legs leave the trunk: hips and belly stop it over raised thighs.

    ``out`` (2): how far it may bend forward (rad), and the share of leaning aside and twisting that is left.
    """
    out[0], out[1] = FORWARD, 1.0
    c, s = cos(heading), sin(heading)
    for side in range(2):
        if planted[side] > 0.5:
            hip, knee = rig.limbs[2 + side, 0], rig.limbs[2 + side, 1]
            ahead = s * (positions_ws[knee, 0] - positions_ws[hip, 0]) + c * (
                positions_ws[knee, 2] - positions_ws[hip, 2]
            )
            down = positions_ws[hip, 1] - positions_ws[knee, 1]
            thigh = atan2(max(ahead, 0.0), max(down, -0.2))
            out[0] = min(out[0], (HIP_FLEXION - thigh) / PELVIS_BACK_RATIO, FOLD - thigh)
            out[1] = min(out[1], 1.0 - 0.8 * min(1.0, max(0.0, thigh - 0.35) / 0.9))
    out[0] = max(out[0], 0.1)


@kernel
def knee_pace(rig: Rig, limb: int, hip: Array, ankle: Array, velocity: Array) -> float:
    """The share (0..1) of ``velocity`` (3, m/s, of the ankle against the hip) that keeps the knee calm.

    A nearly straight leg turns its knee fast for little way.
    """
    upper, lower = rig.lengths[limb, 0], rig.lengths[limb, 1]
    r, along = 0.0, 0.0
    for k in range(3):
        r += (ankle[k] - hip[k]) ** 2
        along += (ankle[k] - hip[k]) * velocity[k]
    r = max(sqrt(r), 1e-6)
    c = (r * r - upper * upper - lower * lower) / (2.0 * upper * lower)
    s = sqrt(max(1.0 - c * c, 0.02))
    rate = abs(along) / (upper * lower * s)
    return float(min(1.0, CALM_KNEE / max(rate, 1e-9)))
