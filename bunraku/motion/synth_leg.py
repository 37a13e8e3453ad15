"""One leg through a cycle: planted on its footprint, then carried to the next one.

The foot rolls over heel and ball. In the air it follows the leg's published joint angles, corrected so that it leaves
its print in position, velocity and acceleration and meets the next one in position and velocity.
"""

from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from bunraku.motion.ground import lowest, rolled
from bunraku.motion.synth_body import SIGN, Frame, Plan
from bunraku.motion.synth_curves import Gait, blend, foot_pitch, swing_angles, toe_bend

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

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
class Arc:
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


def to_world(places: Array, base: Array, heading: Array) -> Array:
    """(..., 3) m in the world of places (..., 3) m seen from the path at ``base`` (..., 3) m, ``heading`` (...) rad."""
    c, s = np.cos(heading), np.sin(heading)
    x = places[..., 0] * c + places[..., 2] * s
    z = -places[..., 0] * s + places[..., 2] * c
    return np.stack([base[..., 0] + x, base[..., 1] + places[..., 1], base[..., 2] + z], -1)


def from_world(places: Array, base: Array, heading: Array) -> Array:
    """(..., 3) m seen from the path (+Z ahead, +X to the left) of places (..., 3) m in the world; undoes `to_world`."""
    d = places - base
    c, s = np.cos(heading), np.sin(heading)
    return np.stack([d[..., 0] * c - d[..., 2] * s, d[..., 1], d[..., 0] * s + d[..., 2] * c], -1)


@dataclass
class Foot:
    """One foot's stances over the clip, in the world."""

    ankle: Array  # (F, 3)
    pitch: Array  # (F,)
    yaw: Array  # (F,)
    contact: Flags  # (F,)


def _prints(frame: Frame, gait: Gait, side: int, period: float, arc: Arc, cycle: int) -> tuple[Array, float]:
    """Where the ankle stands (3, on the ground) and the foot's yaw in the given repetition."""
    start = (cycle + 0.5 * side) * period
    base, heading = arc.at(np.array([start + gait.above * gait.stance * period]))
    inside = SIGN[side] * 0.5 * gait.width * frame.length
    place = to_world(np.array([[inside, 0.0, 0.0]]), base, heading)[0]
    out = SIGN[side] * np.radians(gait.toe_out)
    return place, float(heading[0] + out)


class Roll:
    """How one foot is pitched over its own cycle: as published, and as the range of its ankle asks for besides.

    Args:
        added: (n,) rad, toes up positive, at n even phases from the foot's strike.
    """

    def __init__(self, gait: Gait, added: Array) -> None:
        from scipy.interpolate import CubicSpline

        self.gait = gait
        closed = np.append(added, added[0])
        self._more = CubicSpline(np.linspace(0.0, 1.0, len(closed)), closed, bc_type="periodic")

    def pitch(self, phase: Array) -> Array:
        """(n,) rad, toes up positive, at phases (n) from the foot's strike."""
        return foot_pitch(self.gait, phase) + np.asarray(self._more(np.mod(phase, 1.0)), dtype=np.float64)

    def toes(self, phase: Array) -> Array:
        """(n,) rad that the toes are bent up against the foot."""
        return toe_bend(self.gait, phase, self.pitch(phase))


def stance(frame: Frame, gait: Gait, side: int, phase: Array, period: float, arc: Arc, roll: Roll) -> Foot:
    """One foot (0 left, 1 right) on its prints, at phases (F) of a cycle of ``period`` s; not yet placed in the air."""
    own = phase - 0.5 * side
    foot = Foot(np.zeros((len(phase), 3)), roll.pitch(own), np.zeros(len(phase)), np.zeros(len(phase), np.bool_))
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


def swing(
    frame: Frame, gait: Gait, side: int, phase: Array, period: float, arc: Arc, hip: Array, foot: Foot, roll: Roll,
    plan: Plan,
) -> None:  # fmt: skip
    """Fill in ankles, yaws and toes of one leg: stances as they are, swings by the angle curves."""
    own = phase - 0.5 * side
    count = len(phase) - 1
    upper, lower = (float(v) for v in frame.rig.lengths[2 + side])
    sole = frame.soles[side]
    seconds = (1.0 - gait.stance) * period
    tick = 0.006
    taken = TAKEN_OVER[0] + gait.running * (TAKEN_OVER[1] - TAKEN_OVER[0])
    leaving = gait.stance + tick * np.array([-2.0, -1.0, 0.0])
    joining = gait.stance + taken * (1.0 - gait.stance) + tick * np.array([-1.0, 0.0, 1.0])
    arriving = np.array([1.0, 1.0 + tick])

    def planted(at: Array, which: int) -> Array:
        """The ankle (n, 3) m on its print at phases (n) of the cycle, seen from the path."""
        place, yaw = _prints(frame, gait, side, period, arc, which)
        rise = rolled(sole, roll.pitch(at))
        spots = (
            place + rise[:, 1:] * np.array([np.sin(yaw), 0.0, np.cos(yaw)]) + rise[:, :1] * np.array([0.0, 1.0, 0.0])
        )
        return from_world(spots, *arc.at((cycle + 0.5 * side + at) * period))

    # The angles are those of upright people: over lowered hips the foot goes as high over the ground as theirs.
    ducked = gait.duck * max(frame.standing + frame.hip_offsets[side, 1] - float(hip[:-1, 1].mean()), 0.0)

    def published(at: Array) -> Array:
        """The ankle (n, 3) m by the published angles, seen from the path."""
        hips = _sample_hip(phase, hip, at + 0.5 * side)
        out = _fk(gait, at, upper, lower) + hips
        out[:, 0] = hips[:, 0]
        out[:, 1] += ducked
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
            """The ankle (n, 3) m in the air at phases (n) of the cycle, led to its next print, seen from the path."""
            share = (at - gait.stance) / (1.0 - gait.stance)
            return published(at) + _landed(lack[0], falling, share, seconds)

        at = frames / count - 0.5 * side - cycle
        share = (at - gait.stance) / (1.0 - gait.stance)
        track = flown(at)
        start = _states(planted(leaving, cycle), tick * period, last=True)
        join = _states(flown(joining), tick * period, last=False)
        early = share < taken
        track[early] = _quintic(start, join, share[early] / taken, taken * seconds)
        hips = _sample_hip(phase, hip, at + 0.5 * side)
        ends = _sample_hip(phase, hip, np.array([gait.stance, 1.0]) + 0.5 * side)
        long = (
            float(np.linalg.norm(start[0] - ends[0])),
            float(np.linalg.norm(planted(arriving, cycle + 1)[0] - ends[1])),
        )
        track = hips + _bent(track - hips, upper + lower, *long, share)
        low = lowest(sole, track[:, 1], roll.pitch(at), roll.toes(at))
        want = gait.clearance * frame.length * np.sin(pi * share) ** 0.8
        track[:, 1] += _raised(np.maximum(want - low, 0.0), share)
        base, heading = arc.at(frames / count * period)
        mine = frames[held]
        foot.ankle[mine] = to_world(track, base, heading)[held]
        yaw0, yaw1 = (_prints(frame, gait, side, period, arc, c)[1] for c in (cycle, cycle + 1))
        foot.yaw[mine] = (yaw0 + (yaw1 - yaw0) * blend(share, 0.05, 0.95))[held]
    plan.ankles[side], plan.foot_yaw[side], plan.foot_pitch[side] = foot.ankle, foot.yaw, foot.pitch
    plan.toe_bend[side] = roll.toes(own)
    plan.contacts[:, side] = foot.contact


def _raised(lack: Array, share: Array) -> Array:
    """A smooth height (n) at least ``lack`` (n) and not much more, at rest at both ends of the swing."""
    radius = 4
    padded = np.pad(lack, radius)
    widest = np.array([padded[k : k + 2 * radius + 1].max() for k in range(len(lack))])
    kernel = np.hanning(2 * radius + 3)[1:-1]
    smooth = np.convolve(np.pad(widest, radius), kernel / kernel.sum(), "valid")
    return np.asarray(smooth * np.minimum(blend(share, 0.0, 0.12), blend(1.0 - share, 0.0, 0.12)), dtype=np.float64)


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
