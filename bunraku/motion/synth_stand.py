"""Quiet standing, in any posture, and what every motion from a stand to a stand is planned with.

Lengths in metres and times in seconds are those of a leg of 0.83 m, see `bunraku.motion.synth_body.Frame`.
"""

from itertools import pairwise
from math import pi

import numpy as np
from numpy.typing import NDArray

from bunraku.motion import rotation as rot
from bunraku.motion.clip import Clip
from bunraku.motion.ground import rolled
from bunraku.motion.synth_body import FPS, SIGN, Frame, Plan, assemble, turned
from bunraku.motion.synth_curves import blend

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Made = tuple[Clip, Array, Flags]
"""A clip, its key times (s) and its contacts (F, 2)."""

STAND = 0.993
"""Share of full leg length from hip to ankle in quiet standing: knees a little bent, ready to move."""
TOE_OUT = np.radians(6.0)
ARM_OUT, ARM_ROLL, ELBOW, ARM_BACK = np.radians(9.0), np.radians(18.0), np.radians(16.0), np.radians(-2.0)


def track(times: Array, knots: list[tuple[float, float]]) -> Array:
    """Through (time, value) knots with rest at each knot, minimum jerk between, held outside."""
    out = np.full(len(times), knots[0][1])
    for (t0, a), (t1, b) in pairwise(knots):
        u = np.clip((times - t0) / max(t1 - t0, 1e-9), 0.0, 1.0)
        out = np.where(times >= t0, a + (b - a) * (10 * u**3 - 15 * u**4 + 6 * u**5), out)
    return out


def smooth(times: Array, knots: list[tuple[float, float]]) -> Array:
    """Through (time, value) knots, monotone between, at rest at both ends (PCHIP)."""
    from scipy.interpolate import PchipInterpolator

    rows = np.asarray(knots)
    x = np.concatenate([[rows[0, 0] - 1.0], rows[:, 0], [rows[-1, 0] + 1.0]])
    y = np.concatenate([[rows[0, 1]], rows[:, 1], [rows[-1, 1]]])
    return np.asarray(PchipInterpolator(x, y)(np.clip(times, x[0], x[-1])), dtype=np.float64)


def home_of(frame: Frame, side: int) -> Array:
    """Where an ankle stands at ease (3, on the ground) with the root over the origin."""
    return np.array([SIGN[side] * frame.width * 0.95, 0.0, 0.0])


def standing_height(frame: Frame) -> float:
    """Root height in quiet standing, m."""
    return float(frame.soles[0].height + STAND * frame.leg - frame.hip_offsets[0, 1])


def quiet_plan(frame: Frame, times: Array) -> Plan:
    """Quiet standing, to be changed."""
    n = len(times)
    plan = Plan(
        root=np.tile([0.0, standing_height(frame), 0.0], (n, 1)),
        heading=np.zeros(n),
        ankles=np.zeros((2, n, 3)),
        foot_yaw=np.zeros((2, n)),
        foot_pitch=np.zeros((2, n)),
        contacts=np.ones((n, 2), np.bool_),
    )
    plan.trunk[:, 0] = np.radians(1.0)
    plan.shoulder[:] = ARM_BACK
    plan.abduct[:] = ARM_OUT
    plan.inward[:] = ARM_ROLL
    plan.elbow[:] = ELBOW
    for side in (0, 1):
        plan.ankles[side] = home_of(frame, side) + np.array([0.0, frame.soles[side].height, 0.0])
        plan.foot_yaw[side] = SIGN[side] * TOE_OUT
    return plan


def put_foot(frame: Frame, plan: Plan, side: int, ground: Array, yaw: Array, pitch: Array, lift: Array) -> None:
    """Set a foot from its flat place on the ground (F, 3), yaw, pitch and the height of its sole."""
    offset = rolled(frame.soles[side], pitch)
    ahead = np.stack([np.sin(yaw), np.zeros_like(yaw), np.cos(yaw)], -1)
    plan.ankles[side] = ground + offset[:, 1:] * ahead
    plan.ankles[side, :, 1] = ground[:, 1] + offset[:, 0] + lift
    plan.foot_yaw[side], plan.foot_pitch[side] = yaw, pitch
    plan.toe_bend[side] = np.clip(-pitch, 0.0, np.radians(62.0)) * (1.0 - blend(lift, 0.0, 0.06))


def lowered(frame: Frame, plan: Plan, reach: float = 0.994) -> None:
    """Sink the root, smoothly, where a standing leg would have to be longer than ``reach`` of itself."""
    pelvis = rot.mul(rot.yaw(plan.heading), turned(plan.pelvis))
    over = np.zeros(len(plan.root))
    for side in (0, 1):
        hips = plan.root + rot.rotate(pelvis, frame.hip_offsets[side])
        away = np.hypot(*(hips - plan.ankles[side])[:, [0, 2]].T)
        most = np.sqrt(np.maximum((reach * frame.leg) ** 2 - away**2, 1e-4))
        over = np.maximum(over, hips[:, 1] - plan.ankles[side, :, 1] - most)
    if over.max() <= 0.0:
        return
    radius = 9
    widest = np.array([over[max(0, k - radius) : k + radius + 1].max() for k in range(len(over))])
    kernel = np.hanning(2 * radius + 1)
    padded = np.pad(widest, radius, mode="edge")
    plan.root[:, 1] -= np.convolve(padded, kernel / kernel.sum(), "valid")


def stand(name: str, frame: Frame, tilt: float, bend: float, duck: float) -> Made:
    """Four seconds of standing with breath and a slow shift of weight; a posture is kept throughout."""
    period = 4.0
    times = np.arange(round(period * FPS) + 1) / FPS
    plan = quiet_plan(frame, times)
    size = frame.length
    breath = np.sin(2 * pi * times / period - 0.5 * pi)
    shift = np.sin(2 * pi * times / period)
    _posture(frame, plan, np.full(len(times), tilt), np.full(len(times), bend), np.full(len(times), duck))
    plan.root[:, 0] += 0.006 * size * shift
    plan.root[:, 1] += 0.0015 * size * breath - 0.002 * size
    plan.root[:, 2] += 0.003 * size * np.sin(2 * pi * times / period + 1.1)
    plan.pelvis[:, 2] -= np.radians(0.6) * shift
    plan.trunk[:, 0] += np.radians(0.7) * breath
    plan.trunk[:, 2] += np.radians(0.4) * shift
    plan.gaze[:, 0] -= np.radians(0.5) * breath
    plan.gaze[:, 1] += np.radians(1.5) * np.sin(2 * pi * times / period + 2.0)
    plan.shoulder += np.radians(0.8) * breath
    plan.abduct += np.radians(0.7) * breath
    lowered(frame, plan)
    clip = assemble(name, frame, plan, closed=True)
    return clip, np.array([0.0, period]), plan.contacts


def _posture(frame: Frame, plan: Plan, tilt: Array, bend: Array, duck: Array) -> None:
    """Lean and duck (F) on top of a plan: the hips go the other way, so that the weight stays over the feet."""
    size = frame.length
    sink = np.maximum(duck * 0.4 * frame.leg - (frame.standing - standing_height(frame)), 0.0)
    back = 0.16 * np.sin(bend) * (bend > 0) + 0.10 * np.sin(bend) * (bend < 0)
    c, s = np.cos(plan.heading), np.sin(plan.heading)
    x = -0.10 * size * np.sin(tilt)
    z = -size * back - 0.08 * size * duck
    plan.root[:, 0] += x * c + z * s
    plan.root[:, 2] += -x * s + z * c
    plan.root[:, 1] -= sink + 0.02 * size * np.abs(np.sin(bend)) + 0.02 * size * np.abs(np.sin(tilt))
    lean = np.radians(20.0) * duck
    plan.pelvis[:, 0] += 0.45 * bend + 0.5 * lean
    plan.trunk[:, 0] += 1.07 * bend + lean
    plan.gaze[:, 0] += 0.55 * bend + 0.2 * lean
    plan.pelvis[:, 2] += 0.25 * tilt
    plan.trunk[:, 2] += 1.20 * tilt
    plan.gaze[:, 2] += 0.75 * tilt
    hang = 0.75 * np.maximum(bend, 0.0) + 0.55 * np.minimum(bend, 0.0)
    for side in (0, 1):
        plan.shoulder[side] += hang + 0.35 * duck
        plan.elbow[side] += 0.25 * duck + 0.08 * np.abs(bend)
        outer = SIGN[side] * tilt < 0  # the arm on the raised side
        plan.abduct[side] += np.where(outer, -0.2 * np.abs(tilt), 0.7 * np.abs(tilt))
        plan.abduct[side] += 0.35 * duck * np.maximum(bend, 0.0)  # beside the knees, not on them
        plan.foot_yaw[side] += SIGN[side] * np.radians(8.0) * duck
    plan.knee_out = 0.05 + 0.12 * float(np.mean(duck))
