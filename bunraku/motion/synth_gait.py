"""Walking and running made from published gait curves: one cycle of two steps, at any speed and along any arc.

The pelvis bobs, sways, turns and lists; chest and arms swing against it; the legs are `bunraku.motion.synth_leg`'s.
"""

import numpy as np
from numpy.typing import NDArray

from bunraku.motion import rotation as rot
from bunraku.motion.clip import Clip
from bunraku.motion.synth_body import FPS, SIGN, Frame, Plan, assemble, posed, turned
from bunraku.motion.synth_bounds import ANKLE_TRIES, pitched_more
from bunraku.motion.synth_curves import TAU, Gait
from bunraku.motion.synth_leg import Arc, Roll, from_world, stance, swing, to_world

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def gait_clip(name: str, frame: Frame, gait: Gait) -> tuple[Clip, Array, Flags]:
    """One cycle from a left foot strike to the next, with its key times (s) and contacts (F, 2).

    The last frame is the first of the next cycle. See `bunraku.motion.motionset.EVENTS` for the keys.
    """
    slow = frame.time
    steps = round(gait.cycle * slow * FPS)
    period = steps / FPS
    phase = np.arange(steps + 1) / steps
    arc = Arc(gait.speed * slow, gait.turn / slow)
    # Where an ankle comes to the end of its range the foot is pitched otherwise, and with it all of the leg.
    pitched = np.zeros((2, steps))
    for _ in range(ANKLE_TRIES):
        plan = _planned(frame, gait, phase, period, arc, pitched)
        more = pitched_more(posed(name, frame, plan), closed=True)
        if not more.any():
            break
        for side in (0, 1):
            pitched[side] += np.interp(np.mod(phase[:-1] + 0.5 * side, 1.0), phase, more[side])
    clip = assemble(name, frame, plan, closed=True)
    passes = _passing(plan, *arc.at(phase * period), period)
    return clip, np.array([0.0, passes[0], 0.5 * period, passes[1], period]), plan.contacts


def _planned(frame: Frame, gait: Gait, phase: Array, period: float, arc: Arc, pitched: Array) -> Plan:
    """The cycle at phases (F), its feet pitched by ``pitched`` (2, n) rad more, from their own strikes on."""
    base, heading = arc.at(phase * period)
    frames = len(phase)
    root, pelvis, chest, gaze = _trunk(frame, gait, phase)
    plan = Plan(
        root=root, heading=heading, ankles=np.zeros((2, frames, 3)), foot_yaw=np.zeros((2, frames)),
        foot_pitch=np.zeros((2, frames)), contacts=np.zeros((frames, 2), np.bool_), pelvis=pelvis, trunk=chest,
        gaze=gaze,
    )  # fmt: skip
    _arms(gait, phase, plan)
    hips = [root + _rotate(pelvis, frame.hip_offsets[side]) for side in (0, 1)]
    drop = 0.0
    feet, rolls = [], [Roll(gait, pitched[side]) for side in (0, 1)]
    for side in (0, 1):
        foot = stance(frame, gait, side, phase, period, arc, rolls[side])
        feet.append(foot)
        # In the frame of the path, with all cycles that the clip touches.
        standing, local_ankle = foot.contact, from_world(foot.ankle, base, heading)
        away = np.hypot(local_ankle[:, 0] - hips[side][:, 0], local_ankle[:, 2] - hips[side][:, 2])
        most = np.sqrt(np.maximum((gait.reach * frame.leg) ** 2 - away**2, 0.01))
        over = hips[side][:, 1] - local_ankle[:, 1] - most
        drop = max(drop, float(np.max(over[standing])))
    root[:, 1] -= drop
    root[:, 1] -= max(gait.duck * 0.4 * frame.leg - (frame.standing - float(root[:-1, 1].mean())), 0.0) * (
        gait.duck > 0
    )
    for side in (0, 1):
        hip = root + _rotate(pelvis, frame.hip_offsets[side])
        swing(frame, gait, side, phase, period, arc, hip, feet[side], rolls[side], plan)
    plan.root = to_world(root, base, heading)
    return plan


def _trunk(frame: Frame, gait: Gait, phase: Array) -> tuple[Array, Array, Array, Array]:
    """Root (F, 3) in the path's frame and tilts (F, 3) of pelvis, chest and head."""
    size = frame.length
    r = gait.running
    high = TAU * (phase - gait.high_at)
    root = np.stack(
        [
            0.5 * size * gait.sway * np.cos(TAU * (phase - gait.sway_at)) - 0.05 * size * np.sin(gait.tilt),
            frame.standing + size * (0.5 * gait.bob * np.cos(2 * high) - gait.dip * np.cos(4 * high)),
            size * (gait.surge * np.sin(2 * TAU * (phase - 0.08)) - 0.13 * np.sin(gait.bend) - 0.05 * gait.duck),
        ],
        -1,
    )
    turn = np.radians(gait.pelvis_turn)
    # Curving bodies lean into the curve.
    bank = np.arctan(gait.speed * gait.turn / 9.81) * 0.8
    ducked = np.radians(12.0) * gait.duck
    # Walking, the trunk leans most while one leg bears it; running, shortly after it lands.
    nod = (2.0 * r - 1.0) * np.cos(2 * TAU * (phase - 0.125))
    pelvis = np.stack(
        [
            np.radians(gait.pelvis_tilt) + np.radians(1.2) * nod + 0.42 * gait.bend + 0.4 * ducked,
            turn * np.cos(TAU * (phase - gait.pelvis_at)),
            -np.radians(gait.pelvis_list) * np.cos(TAU * (phase - (0.17 - 0.02 * r))) + 0.35 * gait.tilt + 0.6 * bank,
        ],
        -1,
    )
    chest = np.stack(
        [
            np.radians(gait.lean) + np.radians(1.0) * nod + gait.bend * 1.05 + ducked,
            np.radians(gait.chest_turn) * np.cos(TAU * (phase - gait.chest_at)),
            np.radians(1.6) * np.cos(TAU * (phase - 0.24)) + 1.12 * gait.tilt + bank,
        ],
        -1,
    )
    gaze = np.stack(
        [
            0.25 * chest[:, 0] + np.radians(0.7) * np.cos(2 * TAU * (phase - 0.35)),
            0.15 * chest[:, 1] + 0.18 * gait.turn / max(1.0, abs(gait.turn)) * np.ones_like(phase),
            0.35 * chest[:, 2],
        ],
        -1,
    )
    return root, pelvis, chest, gaze


def _arms(gait: Gait, phase: Array, plan: Plan) -> None:
    """Each arm swings with the other side's leg; the elbow follows a little later."""
    for side in (0, 1):
        own = phase + 0.5 * side
        forth = np.cos(TAU * (own - gait.arm_at)) - 0.08 * np.cos(2 * TAU * (own - 0.10))
        ahead = 0.4 * gait.bend + 0.10 * gait.duck  # arms hang while the trunk bends
        plan.shoulder[side] = np.radians(gait.arm_mean + gait.arm * forth) + ahead
        bend = np.cos(TAU * (own - gait.elbow_at))
        plan.elbow[side] = np.radians(np.maximum(gait.elbow + gait.elbow_swing * bend, 6.0))
        plan.abduct[side] = np.radians(gait.abduct + 1.5 * np.cos(2 * TAU * own)) + abs(gait.tilt) * (
            -0.2 if SIGN[side] * gait.tilt < 0 else 0.7
        )
        plan.inward[side] = np.radians(18.0 - 12.0 * gait.running + 6.0 * np.maximum(forth, -0.4))


def _rotate(tilts: Array, offset: Array) -> Array:
    return rot.rotate(turned(tilts), offset)


def _passing(plan: Plan, base: Array, heading: Array, period: float) -> tuple[float, float]:
    """When the right, then the left swinging foot comes by the other one (s)."""
    left = from_world(plan.ankles[0], base, heading)[:, 2]
    right = from_world(plan.ankles[1], base, heading)[:, 2]
    count = len(left) - 1
    found = []
    for first, ahead in ((0.0, right - left), (0.5, left - right)):
        span = np.arange(round((first + 0.08) * count), round((first + 0.45) * count))
        crossing = [k for k in span if ahead[k] < 0.0 <= ahead[k + 1]]
        if crossing and ahead.max() > 0.05:
            k = crossing[0]
            part = -ahead[k] / (ahead[k + 1] - ahead[k])
            found.append((k + part) / count * period)
        else:
            found.append((first + 0.25) * period)
    return found[0], found[1]
