"""Published curves of walking and running: how people go at a speed, and the angles of leg and foot over a cycle.

Sources: Boulic, Magnenat-Thalmann, Thalmann 1990 (cycle length and support time against speed, pelvis and
trunk amplitudes, after Inman and Murray); Winter 1991, The Biomechanics and Motor Control of Human Gait
(sagittal angles of hip, knee and foot over the cycle); Orendurff et al. 2004, J. Rehab. Res. Dev. 41(6)
(excursion of the body's centre up and down and to the sides against speed); Murray, Sepic, Barnard 1967,
Phys. Ther. 47 (arm swing); Novacheck 1998, Gait and Posture 7 (running: stance share, knee, hip, trunk); Bruijn
et al. 2008, Gait and Posture 27(3) (pelvis and chest turn together in slow walks, the pelvis with the swinging leg in
fast ones). Where the sources give no times those of captured walks and runs at the same speed are taken.
Speeds and times are those of a leg of 0.83 m; other legs are scaled by equal Froude numbers.
"""

from dataclasses import dataclass, replace
from math import pi

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

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
    dip: float = 0.0  # m, amplitude: sharper low and flatter high than a cosine's
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
    # Shares of the cycle from the left foot's strike:
    high_at: float = 0.335  # the body is highest over the left foot
    sway_at: float = 0.335  # it is farthest to the left
    pelvis_at: float = 0.55  # the left hip is farthest back
    chest_at: float = 1.0  # the left shoulder is farthest back
    arm_at: float = 0.51  # the left arm is farthest forward
    elbow_at: float = 0.55  # the left elbow is bent most


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

    def at(*rows: tuple[float, float]) -> float:
        """By (speed, value) rows, straight between, held at the ends."""
        return float(np.interp(speed, [row[0] for row in rows], [row[1] for row in rows]))

    relative = max(speed, 0.0) / THIGH_HEIGHT
    stride = STRIDE * np.sqrt(max(relative, 1e-6)) * THIGH_HEIGHT
    # Below a strolling pace people who are led take shorter, not ever slower steps.
    cycle = min(stride / max(speed, 1e-6), at((0.0, 1.22), (0.35, 1.32), (0.7, 1.44)))
    support = 0.752 * cycle - 0.143
    slow = float(1.0 - blend(speed, 0.0, 0.6))
    gait = Gait(
        speed=speed,
        cycle=cycle,
        stance=float(np.clip(support / cycle - 0.004, 0.58, 0.68)) + at((0.3, 0.0), (0.7, 0.009), (1.1, 0.0)),
        width=0.10 + 0.05 * slow,
        bob=at((0.0, 0.010), (0.7, 0.018), (1.25, 0.035), (1.6, 0.044), (2.2, 0.055)),
        dip=0.0036 * float(blend(speed, 0.2, 0.8)),
        sway=at((0.0, 0.058), (0.7, 0.060), (1.6, 0.038), (2.2, 0.032)),
        surge=0.008 * float(blend(speed, 0.0, 0.8)),
        pelvis_turn=at((0.0, 0.5), (0.6, 3.6), (1.3, 5.2), (2.2, 8.0)),
        pelvis_list=at((0.0, 2.2), (0.6, 2.6), (1.3, 3.6), (2.2, 4.8)),
        chest_turn=at((0.0, 0.3), (0.6, 3.2), (1.3, 3.2), (2.2, 5.5)),
        lean=at((0.0, 1.0), (1.3, 2.0), (2.2, 4.5)),
        arm=at((0.0, 1.5), (0.6, 9.0), (1.3, 17.5), (2.2, 27.0)),
        arm_mean=at((0.0, -1.0), (1.3, -5.0), (2.2, -4.0)),
        elbow=at((0.0, 17.0), (1.3, 24.0), (2.2, 42.0)),
        elbow_swing=at((0.0, 1.0), (0.6, 5.0), (1.3, 12.0), (2.2, 17.0)),
        abduct=at((1.3, 9.0), (1.9, 11.5)),
        heel_pitch=at((0.0, -4.0), (0.4, 9.0), (1.3, 23.0), (2.2, 28.0)),
        toe_pitch=at((0.0, 17.0), (0.7, 38.0), (1.3, 52.0), (2.2, 54.5)),
        thigh=at((0.0, 0.45), (0.6, 0.74), (1.3, 1.0), (2.2, 1.15)),
        clearance=0.012 + 0.025 * slow,
        above=at((0.3, 0.385), (0.7, 0.45), (1.1, 0.385)),
        reach=at((0.3, 0.9985), (0.7, 0.980), (1.1, 0.9985)),
        high_at=at((0.7, 0.305), (1.3, 0.335)),
        sway_at=at((0.7, 0.390), (1.3, 0.335)),
        pelvis_at=at((0.75, 0.80), (1.1, 0.59), (1.35, 0.56), (1.8, 0.545)),
        chest_at=at((0.7, 0.88), (1.3, 0.99), (1.8, 1.01)),
        arm_at=at((0.7, 0.45), (1.2, 0.51)),
        elbow_at=at((0.7, 0.50), (1.3, 0.55)),
    )
    return replace(gait, **changes)


def running(speed: float, **changes: float) -> Gait:
    """A natural run at a speed of 1.8..5 m/s."""
    fast = float(np.clip((speed - 2.0) / 2.5, 0.0, 1.2))
    stance = 0.345 - 0.085 * fast
    gait = Gait(
        speed=speed,
        cycle=0.76 - 0.07 * fast,
        stance=stance,
        running=1.0,
        width=0.055,
        toe_out=5.0,
        bob=0.105 - 0.015 * fast,
        sway=0.018,
        surge=0.006,
        pelvis_turn=3.5 + 2.0 * fast,
        pelvis_list=4.5,
        pelvis_tilt=6.0,
        chest_turn=6.0 + 2.0 * fast,
        lean=9.5 + 4.0 * fast,
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
        high_at=0.5 * stance + 0.25,
        sway_at=0.5 * stance,
        # From the walk's way of turning the pelvis to that of fast runners, whose hip is back when the foot lands.
        pelvis_at=float(np.interp(speed, [2.0, 3.0, 3.6, 4.5], [0.41, 0.325, 0.09, 0.04])),
        chest_at=0.93,
        arm_at=0.33,
        elbow_at=0.33,
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


def toe_bend(gait: Gait, own: Array, pitch: Array) -> Array:
    """(n,) rad: toes stay on the ground while the heel rises, then come back to the foot, which is at ``pitch`` (n)."""
    phase = np.mod(own, 1.0)
    release = 1.0 - blend(phase, gait.stance, gait.stance + 0.45 * (1.0 - gait.stance))
    standing = np.where(phase <= gait.stance, 1.0, release)
    # As far as toes bend, softly.
    limit, soft = np.radians(76.0), np.radians(4.0)
    up = np.maximum(-pitch, 0.0)
    return np.asarray((up - soft * np.logaddexp(0.0, (up - limit) / soft)) * standing, dtype=np.float64)
