"""Walking and running made from published gait curves: one cycle of two steps, at any speed and along any arc.

Feet are planted on exact footprints and roll over heel and ball; between, the foot follows the leg's published
joint angles, corrected so that it leaves and reaches its footprints in position and velocity. The
pelvis bobs, sways, turns and lists; chest and arms swing against it.

Sources: Boulic, Magnenat-Thalmann, Thalmann 1990 (cycle length and support time against speed, pelvis and
trunk amplitudes, after Inman and Murray); Winter 1991, The Biomechanics and Motor Control of Human Gait
(sagittal angles of hip, knee and foot over the cycle); Orendurff et al. 2004, J. Rehab. Res. Dev. 41(6)
(excursion of the body's centre up and down and to the sides against speed); Murray, Sepic, Barnard 1967,
Phys. Ther. 47 (arm swing); Novacheck 1998, Gait and Posture 7 (running: stance share, knee, hip, trunk).
Speeds and times are those of a leg of 0.83 m; other legs are scaled by equal Froude numbers.
"""

from dataclasses import dataclass, replace
from math import pi

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bunraku.motion.clip import Clip
from bunraku.motion.ground import lowest, rolled
from bunraku.motion.synth_body import FPS, SIGN, Frame, Plan, assemble

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

TAU = 2.0 * pi
THIGH_HEIGHT = 0.915  # m, hip joint over the floor of the reference figure (Boulic's normalisation)
STRIDE = 1.26  # Boulic gives 1.346; people of today's captures take steps shorter by 6 %


@dataclass(frozen=True)
class Gait:
    """One way of going, in metres, seconds and radians of the reference figure; angles in degrees where named so."""

    speed: float  # m/s along the path
    turn: float = 0.0  # rad/s
    cycle: float = 1.1  # s, two steps
    stance: float = 0.62  # share of the cycle that a foot stands
    running: float = 0.0  # 0 walking curves, 1 running curves
    width: float = 0.09  # m between the ankles, side to side
    toe_out: float = 6.0  # degrees
    bob: float = 0.040  # m, lowest to highest
    sway: float = 0.045  # m, side to side
    surge: float = 0.008  # m, amplitude back and forth
    pelvis_turn: float = 4.5  # degrees, amplitude
    pelvis_list: float = 3.5  # degrees, amplitude
    pelvis_tilt: float = 3.0  # degrees forward
    chest_turn: float = 4.0  # degrees, amplitude, against the pelvis
    lean: float = 3.0  # degrees forward, chest
    bend: float = 0.0  # rad, asked for on top
    tilt: float = 0.0  # rad, to the left
    duck: float = 0.0  # share of 0.4 legs
    arm: float = 17.0  # degrees, amplitude of the upper arm
    arm_mean: float = -6.0  # degrees, forward of hanging
    elbow: float = 20.0  # degrees, mean
    elbow_swing: float = 11.0  # degrees, amplitude
    abduct: float = 9.0  # degrees
    heel_pitch: float = 20.0  # degrees at heel strike
    toe_pitch: float = 60.0  # degrees at toe-off
    thigh: float = 1.0  # scale of the swing leg's curves
    lift: float = 0.0  # degrees: the thigh is raised by so much more in the middle of the swing
    clearance: float = 0.012  # m under the swinging foot
    above: float = 0.40  # where in the stance the hips pass over the ankle
    reach: float = 0.9985  # of the leg's length, at most, while standing


ROUND = 0.014
"""Share of a cycle over which published curves are rounded: between their keys they have no jumps of acceleration."""


def curve(keys: ArrayLike, phase: Array) -> Array:
    """A closed curve by (phase, value) rows, monotone between neighbouring keys (PCHIP) and rounded a little."""
    from scipy.interpolate import PchipInterpolator

    rows = np.asarray(keys, dtype=np.float64)
    rows = rows[np.argsort(rows[:, 0])]
    x = np.concatenate([rows[:, 0] - 1.0, rows[:, 0], rows[:, 0] + 1.0])
    through = PchipInterpolator(x, np.tile(rows[:, 1], 3))
    nodes, shares = np.polynomial.hermite_e.hermegauss(7)
    at = np.asarray(phase, dtype=np.float64)[..., None] + ROUND * nodes
    return np.asarray(through(np.mod(at, 1.0)) @ (shares / shares.sum()), dtype=np.float64)


def blend(x: ArrayLike, low: float, high: float) -> Array:
    """0 below ``low``, 1 above ``high``, smooth between."""
    t = np.clip((np.asarray(x, dtype=np.float64) - low) / (high - low), 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t), dtype=np.float64)


def walking(speed: float, **changes: float) -> Gait:
    """A natural walk at a speed of 0..2.2 m/s."""
    relative = max(speed, 0.0) / THIGH_HEIGHT
    stride = STRIDE * np.sqrt(max(relative, 1e-6)) * THIGH_HEIGHT
    # Below a strolling pace people who are led take shorter, not ever slower steps.
    cycle = min(stride / max(speed, 1e-6), 1.32 - 0.10 * float(blend(0.35 - speed, 0.0, 0.35)))
    support = 0.752 * cycle - 0.143
    slow = float(1.0 - blend(speed, 0.0, 0.6))
    gait = Gait(
        speed=speed,
        cycle=cycle,
        stance=float(np.clip(support / cycle - 0.004, 0.58, 0.68)),
        width=0.10 + 0.05 * slow,
        bob=float(np.interp(speed, [0.0, 0.7, 1.6, 2.2], [0.010, 0.022, 0.044, 0.055])),
        sway=float(np.interp(speed, [0.0, 0.7, 1.6, 2.2], [0.058, 0.060, 0.038, 0.032])),
        surge=0.008 * float(blend(speed, 0.0, 0.8)),
        pelvis_turn=float(np.interp(speed, [0.0, 0.6, 1.3, 2.2], [0.5, 2.5, 4.5, 9.0])),
        pelvis_list=float(np.interp(speed, [0.0, 0.6, 1.3, 2.2], [2.2, 2.6, 3.6, 4.8])),
        chest_turn=float(np.interp(speed, [0.0, 0.6, 1.3, 2.2], [0.3, 1.8, 3.6, 6.0])),
        lean=float(np.interp(speed, [0.0, 1.3, 2.2], [1.0, 2.0, 4.5])),
        arm=float(np.interp(speed, [0.0, 0.6, 1.3, 2.2], [1.5, 9.0, 17.5, 27.0])),
        arm_mean=float(np.interp(speed, [0.0, 1.3, 2.2], [-1.0, -5.0, -4.0])),
        elbow=float(np.interp(speed, [0.0, 1.3, 2.2], [17.0, 22.0, 42.0])),
        elbow_swing=float(np.interp(speed, [0.0, 0.6, 1.3, 2.2], [1.0, 5.0, 11.0, 15.0])),
        heel_pitch=float(np.interp(speed, [0.0, 0.4, 1.3, 2.2], [-4.0, 9.0, 23.0, 28.0])),
        toe_pitch=float(np.interp(speed, [0.0, 0.6, 1.3, 2.2], [17.0, 42.0, 52.0, 58.0])),
        thigh=float(np.interp(speed, [0.0, 0.6, 1.3, 2.2], [0.45, 0.74, 1.0, 1.15])),
        clearance=0.012 + 0.025 * slow,
        above=0.385,
    )
    return replace(gait, **changes)


def running(speed: float, **changes: float) -> Gait:
    """A natural run at a speed of 1.8..5 m/s."""
    fast = float(np.clip((speed - 2.0) / 2.5, 0.0, 1.2))
    gait = Gait(
        speed=speed,
        cycle=0.76 - 0.07 * fast,
        stance=0.345 - 0.085 * fast,
        running=1.0,
        width=0.055,
        toe_out=5.0,
        bob=0.105 - 0.015 * fast,
        sway=0.018,
        surge=0.006,
        pelvis_turn=3.5 + 2.0 * fast,
        pelvis_list=4.5,
        pelvis_tilt=6.0,
        chest_turn=8.0 + 3.0 * fast,
        lean=7.0 + 3.5 * fast,
        arm=22.0 + 13.0 * fast,
        arm_mean=-14.0,
        elbow=92.0 + 4.0 * fast,
        elbow_swing=14.0,
        abduct=13.0,
        heel_pitch=8.0,
        toe_pitch=50.0 + 6.0 * fast,
        thigh=0.88 + 0.22 * fast,
        clearance=0.02,
        above=0.345,
        reach=0.987,
    )
    return replace(gait, **changes)


def swing_angles(gait: Gait, phase: Array) -> tuple[Array, Array]:
    """Thigh against the vertical (forward positive) and knee flexion, rad, of the swinging leg.

    ``phase`` 0 at the foot's strike, 1 at the next. The stance part only carries the curve around.
    """
    s = gait.stance
    w = 1.0 - s

    def at(share: float) -> float:
        return s + share * w

    thigh_walk = [(0.0, 24.0), (0.5 * s, 0.0), (0.86 * s, -21.0), (at(0.0), -10.0), (at(0.36), 13.0),
                  (at(0.66), 23.5), (at(0.86), 24.5)]  # fmt: skip
    knee_walk = [(0.0, 8.0), (0.25 * s, 17.0), (0.6 * s, 8.0), (at(0.0), 42.0), (at(0.27), 63.0), (at(0.52), 46.0),
                 (at(0.78), 19.0), (at(0.94), 6.0)]  # fmt: skip
    thigh_run = [(0.0, 21.0), (0.5 * s, 5.0), (at(0.0), -24.0), (at(0.10), -20.0), (at(0.45), 16.0), (at(0.72), 32.0),
                 (at(0.88), 25.0)]  # fmt: skip
    knee_run = [(0.0, 22.0), (0.5 * s, 42.0), (at(0.0), 20.0), (at(0.16), 52.0), (at(0.40), 104.0),
                (at(0.62), 84.0), (at(0.86), 46.0), (at(0.95), 30.0)]  # fmt: skip
    r = gait.running
    thigh = (1.0 - r) * curve(thigh_walk, phase) + r * curve(thigh_run, phase)
    knee = (1.0 - r) * curve(knee_walk, phase) + r * curve(knee_run, phase)
    bump = np.exp(-(((np.mod(phase, 1.0) - at(0.5)) / (0.27 * w)) ** 2))
    thigh = gait.thigh * thigh + gait.lift * bump
    knee = np.maximum(gait.thigh, 0.55) * knee + 1.55 * gait.lift * bump
    return np.radians(thigh), np.radians(np.maximum(knee, 0.0))


def foot_pitch(gait: Gait, phase: Array) -> Array:
    """Pitch of the foot over its own cycle, rad, toes up positive; exactly zero while the sole is flat."""
    s, up, down = gait.stance, gait.heel_pitch, gait.toe_pitch
    w = 1.0 - s
    flat_from = (0.12 if gait.running else 0.13) * s
    heel_off = (0.48 if gait.running else 0.66 - 0.05 * min(gait.speed / 2.0, 1.0)) * s
    # The foot goes on turning after the toes have left the ground.
    most = np.interp(gait.running, [0.0, 1.0], [1.38 * down, 46.0 + 0.9 * down])
    walk = [
        (0.0, up), (0.45 * flat_from, 0.42 * up), (flat_from, 0.0), (0.5 * (flat_from + heel_off), 0.0),
        (heel_off, 0.0),
        (0.42 * heel_off + 0.58 * s, -0.30 * down), (s, -down), (s + (0.11 + 0.20 * gait.running) * w, -most),
        (s + (0.45 + 0.13 * gait.running) * w, -0.40 * most), (s + 0.73 * w, -4.0),
        (s + 0.90 * w, 0.95 * max(up, -4.0)),
    ]  # fmt: skip
    return np.radians(curve(walk, phase))


SOFT = 0.13  # s, over which a difference in velocity at a swing's end dies away
SWINGING = (0.955, 0.988)  # of its length: from where on and how far a leg may straighten in the air
TAKEN_OVER = (0.30, 0.18)  # of the swing, walking and running: up to there the leg comes to the published curves


def _landed(p1: Array, v1: Array, t: Array, span: float) -> Array:
    """(n, 3) from nothing to p1 (3), t 0..1 over ``span`` s, that ends with velocity v1.

    The velocity is worked off near the end, so that it does not carry the middle away.
    """
    u = t[:, None]
    width = min(SOFT, 0.5 * span)
    left = (1.0 - u) * span
    out = p1 * u * u * (3.0 - 2.0 * u) - v1 * left * np.maximum(1.0 - left / width, 0.0) ** 2
    return np.asarray(out, dtype=np.float64)


def _states(places: Array, step: float, last: bool) -> tuple[Array, Array, Array]:
    """Place, velocity and acceleration (3 each) of three places ``step`` s apart: at the last or the middle one."""
    v0, v1 = (places[1] - places[0]) / step, (places[2] - places[1]) / step
    a = (v1 - v0) / step
    return (places[2], v1 + 0.5 * step * a, a) if last else (places[1], 0.5 * (v0 + v1), a)


def _quintic(start: tuple[Array, Array, Array], end: tuple[Array, Array, Array], t: Array, span: float) -> Array:
    """(n, 3) between two states, t 0..1 over ``span`` s: the smoothest way in jerk (Flash and Hogan 1985)."""
    p0, v0, a0 = start[0], start[1] * span, start[2] * span**2
    p1, v1, a1 = end[0], end[1] * span, end[2] * span**2
    c3 = 10.0 * (p1 - p0) - 6.0 * v0 - 4.0 * v1 - 1.5 * a0 + 0.5 * a1
    c4 = -15.0 * (p1 - p0) + 8.0 * v0 + 7.0 * v1 + 1.5 * a0 - a1
    c5 = 6.0 * (p1 - p0) - 3.0 * (v0 + v1) - 0.5 * (a0 - a1)
    u = t[:, None]
    return np.asarray(p0 + u * (v0 + u * (0.5 * a0 + u * (c3 + u * (c4 + u * c5)))), dtype=np.float64)


def _bent(leg: Array, length: float, first: float, last: float, share: Array) -> Array:
    """A swinging leg (n, 3), ``first`` m long when it leaves the ground and ``last`` m when it comes down, kept softly
    from straightening much further in between; ``share`` 0..1 of the swing."""
    far = np.linalg.norm(leg, axis=1)
    start = np.maximum(SWINGING[0] * length, first + (last - first) * share)
    room = np.maximum(SWINGING[1] * length - start, 0.004 * length)
    soft = np.where(far > start, start + room * (1.0 - np.exp(-(far - start) / room)), far)
    return np.asarray(leg * (soft / far)[:, None], dtype=np.float64)


@dataclass(frozen=True)
class _Arc:
    """The path: constant speed and turn rate."""

    speed: float
    turn: float

    def at(self, t: Array) -> tuple[Array, Array]:
        """Ground positions (n, 3) and headings (n) at times t (s)."""
        t = np.asarray(t, dtype=np.float64)
        heading = self.turn * t
        if abs(self.turn) < 1e-9:
            x, z = np.zeros_like(t), self.speed * t
        else:
            x = self.speed / self.turn * (1.0 - np.cos(heading))
            z = self.speed / self.turn * np.sin(heading)
        return np.stack([x, np.zeros_like(t), z], -1), heading


def _to_world(places: Array, base: Array, heading: Array) -> Array:
    c, s = np.cos(heading), np.sin(heading)
    x = places[..., 0] * c + places[..., 2] * s
    z = -places[..., 0] * s + places[..., 2] * c
    return np.stack([base[..., 0] + x, base[..., 1] + places[..., 1], base[..., 2] + z], -1)


def gait_clip(name: str, frame: Frame, gait: Gait) -> tuple[Clip, Array, Flags]:
    """One cycle from a left foot strike to the next, with its key times (s) and contacts (F, 2).

    The last frame is the first of the next cycle. See `bunraku.motion.motionset.EVENTS` for the keys.
    """
    slow = frame.time
    steps = round(gait.cycle * slow * FPS)
    period = steps / FPS
    phase = np.arange(steps + 1) / steps
    arc = _Arc(gait.speed * slow, gait.turn / slow)
    base, heading = arc.at(phase * period)
    root, pelvis, chest, gaze = _trunk(frame, gait, phase)
    plan = Plan(
        root=root, heading=heading, ankles=np.zeros((2, steps + 1, 3)), foot_yaw=np.zeros((2, steps + 1)),
        foot_pitch=np.zeros((2, steps + 1)), contacts=np.zeros((steps + 1, 2), np.bool_), pelvis=pelvis, trunk=chest,
        gaze=gaze,
    )  # fmt: skip
    _arms(gait, phase, plan)
    hips = [root + _rotate(pelvis, frame.hip_offsets[side]) for side in (0, 1)]
    drop = 0.0
    feet = []
    for side in (0, 1):
        foot = _stance(frame, gait, side, phase, period, arc)
        feet.append(foot)
        # In the frame of the path, with all cycles that the clip touches.
        standing, local_ankle = foot.contact, _from_world(foot.ankle, base, heading)
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
        _swing(frame, gait, side, phase, period, arc, hip, feet[side], plan)
    plan.root = _to_world(root, base, heading)
    clip = assemble(name, frame, plan)
    passes = _passing(plan, base, heading, period)
    return clip, np.array([0.0, passes[0], 0.5 * period, passes[1], period]), plan.contacts


def _trunk(frame: Frame, gait: Gait, phase: Array) -> tuple[Array, Array, Array, Array]:
    """Root (F, 3) in the path's frame and tilts (F, 3) of pelvis, chest and head."""
    size = frame.length
    r = gait.running
    middle = 0.335 * (1.0 - r) + 0.5 * gait.stance * r  # of the left leg's stance
    high = middle + 0.25 * r  # running is lowest there, walking highest
    root = np.stack(
        [
            0.5 * size * gait.sway * np.cos(TAU * (phase - 0.02 - middle)) - 0.05 * size * np.sin(gait.tilt),
            frame.standing + 0.5 * size * gait.bob * np.cos(2 * TAU * (phase - high)),
            size * (gait.surge * np.sin(2 * TAU * (phase - 0.08)) - 0.13 * np.sin(gait.bend) - 0.05 * gait.duck),
        ],
        -1,
    )
    turn = np.radians(gait.pelvis_turn)
    # Curving bodies lean into the curve.
    bank = np.arctan(gait.speed * gait.turn / 9.81) * 0.8
    ducked = np.radians(12.0) * gait.duck
    bob = np.cos(2 * TAU * (phase - 0.06))
    pelvis = np.stack(
        [
            np.radians(gait.pelvis_tilt) + np.radians(1.2) * bob + 0.42 * gait.bend + 0.4 * ducked,
            -turn * np.cos(TAU * (phase - 0.02)),
            -np.radians(gait.pelvis_list) * np.cos(TAU * (phase - (0.17 - 0.02 * r))) + 0.35 * gait.tilt + 0.6 * bank,
        ],
        -1,
    )
    chest = np.stack(
        [
            np.radians(gait.lean) + np.radians(1.0) * np.cos(2 * TAU * (phase - 0.10)) + gait.bend * 1.05 + ducked,
            np.radians(gait.chest_turn) * np.cos(TAU * (phase - 0.04)),
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
        swing = -np.cos(TAU * (own - 0.03 + 0.18 * gait.running)) - 0.08 * np.cos(2 * TAU * (own - 0.10))
        ahead = 0.4 * gait.bend + 0.10 * gait.duck  # arms hang while the trunk bends
        plan.shoulder[side] = np.radians(gait.arm_mean + gait.arm * swing) + ahead
        bend = -np.cos(TAU * (own - 0.09 + 0.24 * gait.running))
        plan.elbow[side] = np.radians(np.maximum(gait.elbow + gait.elbow_swing * bend, 6.0))
        plan.abduct[side] = np.radians(gait.abduct + 1.5 * np.cos(2 * TAU * own)) + abs(gait.tilt) * (
            -0.2 if SIGN[side] * gait.tilt < 0 else 0.7
        )
        plan.inward[side] = np.radians(18.0 + 16.0 * gait.running + 6.0 * np.maximum(swing, -0.4))


@dataclass
class _Foot:
    """One foot's stances over the clip, in the world."""

    ankle: Array  # (F, 3)
    pitch: Array  # (F,)
    yaw: Array  # (F,)
    contact: Flags  # (F,)


def _prints(frame: Frame, gait: Gait, side: int, period: float, arc: _Arc, cycle: int) -> tuple[Array, float]:
    """Where the ankle stands (3, on the ground) and the foot's yaw in the given repetition."""
    start = (cycle + 0.5 * side) * period
    base, heading = arc.at(np.array([start + gait.above * gait.stance * period]))
    inside = SIGN[side] * 0.5 * gait.width * frame.length
    place = _to_world(np.array([[inside, 0.0, 0.0]]), base, heading)[0]
    out = SIGN[side] * np.radians(gait.toe_out)
    return place, float(heading[0] + out)


def _stance(frame: Frame, gait: Gait, side: int, phase: Array, period: float, arc: _Arc) -> _Foot:
    own = phase - 0.5 * side
    foot = _Foot(np.zeros((len(phase), 3)), foot_pitch(gait, own), np.zeros(len(phase)), np.zeros(len(phase), np.bool_))
    sole = frame.soles[side]
    offset = rolled(sole, foot.pitch)
    for cycle in (-1, 0, 1):
        place, yaw = _prints(frame, gait, side, period, arc, cycle)
        mine = (own >= cycle - 1e-9) & (own <= cycle + gait.stance + 1e-9)
        ahead = np.array([np.sin(yaw), 0.0, np.cos(yaw)])
        foot.ankle[mine] = place + offset[mine, 1:] * ahead + offset[mine, :1] * np.array([0.0, 1.0, 0.0])
        foot.yaw[mine] = yaw
        foot.contact |= mine
    return foot


def _swing(
    frame: Frame, gait: Gait, side: int, phase: Array, period: float, arc: _Arc, hip: Array, foot: _Foot, plan: Plan
) -> None:  # fmt: skip
    """Fill in ankles, yaws and toes of one leg: stances as they are, swings by the angle curves."""
    own = phase - 0.5 * side
    count = len(phase) - 1
    upper, lower = (float(v) for v in frame.rig.lengths[2 + side])
    sole = frame.soles[side]
    swing = (1.0 - gait.stance) * period
    tick = 0.006
    taken = TAKEN_OVER[0] + gait.running * (TAKEN_OVER[1] - TAKEN_OVER[0])
    leaving = gait.stance + tick * np.array([-2.0, -1.0, 0.0])
    joining = gait.stance + taken * (1.0 - gait.stance) + tick * np.array([-1.0, 0.0, 1.0])
    arriving = np.array([1.0, 1.0 + tick])

    def planted(at: Array, which: int) -> Array:
        """The ankle on its print at phases of the cycle, seen from the path."""
        place, yaw = _prints(frame, gait, side, period, arc, which)
        rise = rolled(sole, foot_pitch(gait, at))
        spots = (
            place + rise[:, 1:] * np.array([np.sin(yaw), 0.0, np.cos(yaw)]) + rise[:, :1] * np.array([0.0, 1.0, 0.0])
        )
        return _from_world(spots, *arc.at((cycle + 0.5 * side + at) * period))

    def published(at: Array) -> Array:
        """The ankle by the published angles, seen from the path."""
        hips = _sample_hip(phase, hip, at + 0.5 * side)
        out = _fk(gait, at, upper, lower) + hips
        out[:, 0] = hips[:, 0]
        return out

    for cycle in (-1, 0):
        # The whole swing, of which the clip may hold a part only.
        first = int(np.floor((cycle + gait.stance + 0.5 * side) * count + 1e-6)) + 1
        last = int(np.ceil((cycle + 1.0 + 0.5 * side) * count - 1e-6)) - 1
        frames = np.arange(first, last + 1)
        held = (frames >= 0) & (frames <= count)
        if not held.any():
            continue
        lack = planted(arriving, cycle + 1) - published(arriving)
        falling = (lack[1] - lack[0]) / (tick * period)

        def flown(at: Array, lack: Array = lack, falling: Array = falling) -> Array:
            share = (at - gait.stance) / (1.0 - gait.stance)
            return published(at) + _landed(lack[0], falling, share, swing)

        at = frames / count - 0.5 * side - cycle
        share = (at - gait.stance) / (1.0 - gait.stance)
        track = flown(at)
        start = _states(planted(leaving, cycle), tick * period, last=True)
        join = _states(flown(joining), tick * period, last=False)
        early = share < taken
        track[early] = _quintic(start, join, share[early] / taken, taken * swing)
        hips = _sample_hip(phase, hip, at + 0.5 * side)
        ends = _sample_hip(phase, hip, np.array([gait.stance, 1.0]) + 0.5 * side)
        long = (
            float(np.linalg.norm(start[0] - ends[0])),
            float(np.linalg.norm(planted(arriving, cycle + 1)[0] - ends[1])),
        )
        track = hips + _bent(track - hips, upper + lower, *long, share)
        low = lowest(sole, track[:, 1], foot_pitch(gait, at), _toe_bend(gait, at))
        want = gait.clearance * frame.length * np.sin(pi * share) ** 0.8
        track[:, 1] += _raised(np.maximum(want - low, 0.0), share)
        base, heading = arc.at(frames / count * period)
        mine = frames[held]
        foot.ankle[mine] = _to_world(track, base, heading)[held]
        yaw0, yaw1 = (_prints(frame, gait, side, period, arc, c)[1] for c in (cycle, cycle + 1))
        foot.yaw[mine] = (yaw0 + (yaw1 - yaw0) * blend(share, 0.05, 0.95))[held]
    plan.ankles[side], plan.foot_yaw[side], plan.foot_pitch[side] = foot.ankle, foot.yaw, foot.pitch
    plan.toe_bend[side] = _toe_bend(gait, own)
    plan.contacts[:, side] = foot.contact


def _raised(lack: Array, share: Array) -> Array:
    """A smooth height (n) at least ``lack`` (n) and not much more, at rest at both ends of the swing."""
    radius = 4
    padded = np.pad(lack, radius)
    widest = np.array([padded[k : k + 2 * radius + 1].max() for k in range(len(lack))])
    kernel = np.hanning(2 * radius + 3)[1:-1]
    smooth = np.convolve(np.pad(widest, radius), kernel / kernel.sum(), "valid")
    return np.asarray(smooth * np.minimum(blend(share, 0.0, 0.12), blend(1.0 - share, 0.0, 0.12)), dtype=np.float64)


def _toe_bend(gait: Gait, own: Array) -> Array:
    """Toes stay on the ground while the heel rises, then come back to the foot."""
    phase = np.mod(own, 1.0)
    pitch = foot_pitch(gait, phase)
    release = 1.0 - blend(phase, gait.stance, gait.stance + 0.45 * (1.0 - gait.stance))
    standing = np.where(phase <= gait.stance, 1.0, release)
    # As far as toes bend, softly.
    limit, soft = np.radians(64.0), np.radians(4.0)
    up = np.maximum(-pitch, 0.0)
    return np.asarray((up - soft * np.logaddexp(0.0, (up - limit) / soft)) * standing, dtype=np.float64)


def _fk(gait: Gait, phase: Array, upper: float, lower: float) -> Array:
    """The ankle from the hip (n, 3) by the published angles, in the path's frame."""
    thigh, knee = swing_angles(gait, phase)
    shin = thigh - knee
    z = upper * np.sin(thigh) + lower * np.sin(shin)
    y = -upper * np.cos(thigh) - lower * np.cos(shin)
    return np.stack([np.zeros_like(z), y, z], -1)


def _sample_hip(phase: Array, hip: Array, at: Array) -> Array:
    """The hip (n, 3), a closed curve in the path's frame, at any phases."""
    where = np.mod(at, 1.0)
    return np.stack([np.interp(where, phase, hip[:, k]) for k in range(3)], -1)


def _rotate(tilts: Array, offset: Array) -> Array:
    from bunraku.motion import rotation as rot
    from bunraku.motion.synth_body import turned

    return rot.rotate(turned(tilts), offset)


def _from_world(places: Array, base: Array, heading: Array) -> Array:
    d = places - base
    c, s = np.cos(heading), np.sin(heading)
    return np.stack([d[..., 0] * c - d[..., 2] * s, d[..., 1], d[..., 0] * s + d[..., 2] * c], -1)


def _passing(plan: Plan, base: Array, heading: Array, period: float) -> tuple[float, float]:
    """When the right, then the left swinging foot comes by the other one (s)."""
    left = _from_world(plan.ankles[0], base, heading)[:, 2]
    right = _from_world(plan.ankles[1], base, heading)[:, 2]
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
