"""Single steps and turns on the spot, planned in task space.

Feet go from footprint to footprint with bell-shaped speed (reaching movements, as Wu 2008 for steps), and the weight
shifts over the foot that stands before the other one leaves the ground.
"""

from math import pi

import numpy as np
from numpy.typing import NDArray

from bunraku.motion.synth_body import FPS, SIGN, Frame, Plan, assemble
from bunraku.motion.synth_curves import blend
from bunraku.motion.synth_stand import TOE_OUT, Made, home_of, lowered, put_foot, quiet_plan, smooth, track

Array = NDArray[np.float64]

WIDE, LARGE = 0.035, (np.radians(85.0), np.radians(130.0))
"""m that both feet stand aside after a large turn, on the inner foot's side, so that heels do not meet; rad."""


def step(name: str, frame: Frame, lead: int, angle: float, distance: float) -> Made:
    """One step without turning: the ``lead`` foot goes first, the other one follows beside it.

    ``angle`` rad from straight ahead, positive to the left; ``distance`` m of the reference figure.
    """
    return _two_steps(name, frame, lead, np.array([np.sin(angle), 0.0, np.cos(angle)]) * distance * frame.length, 0.0)


def turn(name: str, frame: Frame, angle: float) -> Made:
    """A turn on the spot by ``angle`` (rad, positive to the left), the inner foot first."""
    return _two_steps(name, frame, 0 if angle > 0 else 1, np.zeros(3), angle)


def _two_steps(name: str, frame: Frame, lead: int, way: Array, angle: float) -> Made:
    """Both feet, one after the other, to the standing place that is moved by ``way`` and turned by ``angle``."""
    size, slow = frame.length, frame.time
    far = float(np.hypot(way[0], way[2])) / size
    # People turn on the spot faster than they step aside.
    off, air, gap, calm = 0.24, 0.34 + 0.16 * min(far, 1.0), 0.10, 0.30
    if angle:
        off, air, gap, calm = 0.20, 0.29 + 0.04 * min(abs(angle), 2.6), 0.07, 0.25
    strike = off + air
    off2 = strike + gap
    strike2 = off2 + air * 0.92
    end = strike2 + calm
    keys = np.array([0.0, off, strike, off2, strike2, end]) * slow
    frames = round(keys[-1] * FPS)
    keys *= frames / FPS / keys[-1]
    times = np.arange(frames + 1) / FPS
    plan = quiet_plan(frame, times)
    t_off, t_on, u_off, u_on, t_end = keys[1:]
    follow = 1 - lead
    share = track(times, [(0.6 * t_off, 0.0), (0.5 * (u_off + t_on), 0.55), (u_on + 0.55 * (t_end - u_on), 1.0)])
    # One bell-shaped run over both steps, a little held back while the lead foot is in the air.
    whole = track(times, [(0.45 * t_off, 0.0), (u_on + 0.5 * (t_end - u_on), 1.0)])
    share = 0.35 * share + 0.65 * whole
    plan.heading = angle * share
    plan.root += share[:, None] * way
    # Weight over the standing foot, seen from between the feet.
    width = frame.width
    rest = np.radians(1.0)
    lead_side, follow_side = SIGN[lead], SIGN[follow]
    weight = (
        smooth(
            times,
            [
                (0.0, 0.0),
                (t_off, 0.52 * follow_side),
                (0.55 * t_off + 0.45 * t_on, 0.55 * follow_side),
                (t_on, 0.15 * follow_side),
                (u_off, 0.46 * lead_side),
                (0.5 * (u_off + u_on), 0.50 * lead_side),
                (u_on, 0.22 * lead_side),
                (t_end, 0.0),
            ],
        )
        * width
    )
    # A side step in the weight's own direction already carries the body there.
    aside = way[0] * lead_side
    ease = 1.0 - 0.55 * min(max(aside / (0.5 * size), 0.0), 1.0)
    cos, sin = np.cos(plan.heading), np.sin(plan.heading)
    plan.root[:, 0] += weight * ease * cos
    plan.root[:, 2] -= weight * ease * sin
    bob = -0.010 * np.sin(pi * np.clip(times / t_off, 0, 1)) ** 2
    for a, b in ((t_off, t_on), (u_off, u_on)):
        bob = bob + 0.008 * np.sin(pi * np.clip((times - a) / (b - a), 0.0, 1.0)) ** 2
    dip = -(0.004 + 0.014 * far) * np.sin(pi * np.clip((times - 0.6 * t_on) / (u_on - 0.6 * t_on), 0, 1)) ** 2
    plan.root[:, 1] += size * (bob + dip)
    along = float(way[2]) / size
    for side, a, b in ((lead, t_off, t_on), (follow, u_off, u_on)):
        _step_foot(frame, plan, times, side, a, b, way, angle, along)
    turn_lag = angle * (track(times, [(0.3 * t_off, 0.0), (u_on, 1.0)]) - share)
    head_lead = angle * (track(times, [(0.0, 0.0), (t_on + 0.3 * (u_on - t_on), 1.0)]) - share)
    plan.trunk[:, 1] += turn_lag
    plan.gaze[:, 1] += np.clip(turn_lag + head_lead, -0.8, 0.8)
    swaying = weight / width
    plan.pelvis[:, 2] -= np.radians(2.6) * swaying
    plan.trunk[:, 2] += np.radians(1.6) * swaying
    speed = np.gradient(share, times)
    speed = speed / max(float(speed.max()), 1e-9)
    plan.trunk[:, 0] += rest + np.radians(5.0) * along * speed
    plan.trunk[:, 2] += np.radians(3.0) * (way[0] / size) * speed
    # Arms balance: they lag behind turns and swing against the legs of forward steps.
    for side in (0, 1):
        swing = (
            np.radians(16.0)
            * along
            * np.gradient(track(times, [(0.5 * t_off, 0.0), (u_off, 1.0), (t_end, 0.0)]), times)
        )
        plan.shoulder[side] += (-1.0 if side == lead else 1.0) * 0.30 * swing
        plan.shoulder[side] += SIGN[side] * 0.20 * np.radians(20.0) * np.sign(angle) * min(abs(angle), 1.0) * speed
        plan.abduct[side] += np.radians(5.0 * min(abs(float(way[0])) / size, 1.0) + 4.0 * min(abs(angle), 1.0)) * speed
        plan.elbow[side] += np.radians(6.0) * speed
    lowered(frame, plan)
    return assemble(name, frame, plan), keys, plan.contacts


def _step_foot(
    frame: Frame, plan: Plan, times: Array, side: int, off: float, on: float, way: Array, angle: float, along: float
) -> None:
    """One foot's way from where it stands to its new place, in the air from ``off`` to ``on`` (s)."""
    size = frame.length
    home = home_of(frame, side)
    out = (
        SIGN[side] * (1.0 if side == (0 if angle > 0 else 1) else -1.0) * WIDE * size * float(blend(abs(angle), *LARGE))
    )
    way = way + np.array([out, 0.0, 0.0])
    u = track(times, [(off, 0.0), (on, 1.0)])
    # The foot keeps out of the way of the standing one: around the body in a turn, in an arc about it.
    apart = np.sin(pi * np.clip((times - off) / (on - off), 0, 1)) ** 2
    aside = home[0] + SIGN[side] * (0.02 + 0.015 * abs(angle)) * size * apart
    ground = u[:, None] * way + np.stack([aside * np.cos(angle * u), 0.0 * u, -aside * np.sin(angle * u)], -1)
    goal = way + home[0] * np.array([np.cos(angle), 0.0, -np.sin(angle)])
    far = float(np.linalg.norm(goal - home)) / size
    yaw = SIGN[side] * TOE_OUT + angle * track(times, [(off, 0.0), (on, 1.0)])
    lift = size * (0.035 + 0.035 * min(far, 1.0)) * np.sin(pi * np.clip((times - off) / (on - off), 0.0, 1.0)) ** 1.5
    toe_off = np.radians(10.0 + 34.0 * min(far, 1.0) * max(along, 0.25) / max(far, 0.25))
    land = np.radians(15.0) * min(max(along, -0.4), 1.0) - np.radians(3.0)
    span = on - off
    knots = [
        (off - min(0.16, 0.7 * off), 0.0),
        (off, -0.55 * toe_off),
        (off + 0.22 * span, -toe_off),
        (off + 0.72 * span, 0.5 * land),
        (on, land),
        (on + 0.10, 0.0),
    ]
    put_foot(frame, plan, side, ground, yaw, smooth(times, knots), lift)
    plan.contacts[:, side] = (times <= off + 1e-9) | (times >= on - 1e-9)
