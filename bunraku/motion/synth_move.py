"""Standing, single steps, turns on the spot and jumps, planned in task space.

Feet go from footprint to footprint with bell-shaped speed (reaching movements, as Wu 2008 for steps), the weight
shifts over the foot that stands before the other one leaves the ground, and jumps fly ballistically. Lengths in
metres and times in seconds are those of a leg of 0.83 m, see `bunraku.motion.synth_body.Frame`.
"""

from itertools import pairwise
from math import pi

import numpy as np
from numpy.typing import NDArray

from bunraku.motion.clip import Clip
from bunraku.motion.ground import rolled
from bunraku.motion.synth_body import FPS, GRAVITY, SIGN, Frame, Plan, assemble
from bunraku.motion.synth_gait import blend

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Made = tuple[Clip, Array, Flags]
"""A clip, its key times (s) and its contacts (F, 2)."""

STAND = 0.993
"""Share of full leg length from hip to ankle in quiet standing: knees a little bent, ready to move."""
TOE_OUT = np.radians(6.0)
ARM_OUT, ARM_ROLL, ELBOW, ARM_BACK = np.radians(9.0), np.radians(18.0), np.radians(16.0), np.radians(-2.0)


def _track(times: Array, knots: list[tuple[float, float]]) -> Array:
    """Through (time, value) knots with rest at each knot, minimum jerk between, held outside."""
    out = np.full(len(times), knots[0][1])
    for (t0, a), (t1, b) in pairwise(knots):
        u = np.clip((times - t0) / max(t1 - t0, 1e-9), 0.0, 1.0)
        out = np.where(times >= t0, a + (b - a) * (10 * u**3 - 15 * u**4 + 6 * u**5), out)
    return out


def _smooth(times: Array, knots: list[tuple[float, float]]) -> Array:
    """Through (time, value) knots, monotone between, at rest at both ends (PCHIP)."""
    from scipy.interpolate import PchipInterpolator

    rows = np.asarray(knots)
    x = np.concatenate([[rows[0, 0] - 1.0], rows[:, 0], [rows[-1, 0] + 1.0]])
    y = np.concatenate([[rows[0, 1]], rows[:, 1], [rows[-1, 1]]])
    return np.asarray(PchipInterpolator(x, y)(np.clip(times, x[0], x[-1])), dtype=np.float64)


def _home(frame: Frame, side: int) -> Array:
    """Where an ankle stands at ease (3, on the ground) with the root over the origin."""
    return np.array([SIGN[side] * frame.width * 0.95, 0.0, 0.0])


def _standing_height(frame: Frame) -> float:
    """Root height in quiet standing, m."""
    return float(frame.soles[0].height + STAND * frame.leg - frame.hip_offsets[0, 1])


def _plan(frame: Frame, times: Array) -> Plan:
    """Quiet standing, to be changed."""
    n = len(times)
    plan = Plan(
        root=np.tile([0.0, _standing_height(frame), 0.0], (n, 1)),
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
        plan.ankles[side] = _home(frame, side) + np.array([0.0, frame.soles[side].height, 0.0])
        plan.foot_yaw[side] = SIGN[side] * TOE_OUT
    return plan


def _put(frame: Frame, plan: Plan, side: int, ground: Array, yaw: Array, pitch: Array, lift: Array) -> None:
    """Set a foot from its flat place on the ground (F, 3), yaw, pitch and the height of its sole."""
    offset = rolled(frame.soles[side], pitch)
    ahead = np.stack([np.sin(yaw), np.zeros_like(yaw), np.cos(yaw)], -1)
    plan.ankles[side] = ground + offset[:, 1:] * ahead
    plan.ankles[side, :, 1] = ground[:, 1] + offset[:, 0] + lift
    plan.foot_yaw[side], plan.foot_pitch[side] = yaw, pitch
    plan.toe_bend[side] = np.clip(-pitch, 0.0, np.radians(62.0)) * (1.0 - blend(lift, 0.0, 0.06))


def _lower(frame: Frame, plan: Plan, reach: float = 0.994) -> None:
    """Sink the root, smoothly, where a standing leg would have to be longer than ``reach`` of itself."""
    from bunraku.motion import rotation as rot
    from bunraku.motion.synth_body import turned

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
    plan = _plan(frame, times)
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
    _lower(frame, plan)
    clip = assemble(name, frame, plan)
    return clip, np.array([0.0, period]), plan.contacts


def _posture(frame: Frame, plan: Plan, tilt: Array, bend: Array, duck: Array) -> None:
    """Lean and duck (F) on top of a plan: the hips go the other way, so that the weight stays over the feet."""
    size = frame.length
    sink = np.maximum(duck * 0.4 * frame.leg - (frame.standing - _standing_height(frame)), 0.0)
    back = 0.16 * np.sin(bend) * (bend > 0) + 0.10 * np.sin(bend) * (bend < 0)
    c, s = np.cos(plan.heading), np.sin(plan.heading)
    x = -0.10 * size * np.sin(tilt)
    z = -size * back - 0.05 * size * duck
    plan.root[:, 0] += x * c + z * s
    plan.root[:, 2] += -x * s + z * c
    plan.root[:, 1] -= sink + 0.02 * size * np.abs(np.sin(bend)) + 0.02 * size * np.abs(np.sin(tilt))
    lean = np.radians(16.0) * duck
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
        plan.foot_yaw[side] += SIGN[side] * np.radians(8.0) * duck
    plan.knee_out = 0.05 + 0.12 * float(np.mean(duck))


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
    plan = _plan(frame, times)
    t_off, t_on, u_off, u_on, t_end = keys[1:]
    follow = 1 - lead
    share = _track(times, [(0.6 * t_off, 0.0), (0.5 * (u_off + t_on), 0.55), (u_on + 0.55 * (t_end - u_on), 1.0)])
    # One bell-shaped run over both steps, a little held back while the lead foot is in the air.
    whole = _track(times, [(0.45 * t_off, 0.0), (u_on + 0.5 * (t_end - u_on), 1.0)])
    share = 0.35 * share + 0.65 * whole
    plan.heading = angle * share
    plan.root += share[:, None] * way
    # Weight over the standing foot, seen from between the feet.
    width = frame.width
    rest = np.radians(1.0)
    lead_side, follow_side = SIGN[lead], SIGN[follow]
    weight = (
        _smooth(
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
    turn_lag = angle * (_track(times, [(0.3 * t_off, 0.0), (u_on, 1.0)]) - share)
    head_lead = angle * (_track(times, [(0.0, 0.0), (t_on + 0.3 * (u_on - t_on), 1.0)]) - share)
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
            * np.gradient(_track(times, [(0.5 * t_off, 0.0), (u_off, 1.0), (t_end, 0.0)]), times)
        )
        plan.shoulder[side] += (-1.0 if side == lead else 1.0) * 0.30 * swing
        plan.shoulder[side] += SIGN[side] * 0.20 * np.radians(20.0) * np.sign(angle) * min(abs(angle), 1.0) * speed
        plan.abduct[side] += np.radians(5.0 * min(abs(float(way[0])) / size, 1.0) + 4.0 * min(abs(angle), 1.0)) * speed
        plan.elbow[side] += np.radians(6.0) * speed
    _lower(frame, plan)
    return assemble(name, frame, plan), keys, plan.contacts


def _step_foot(
    frame: Frame, plan: Plan, times: Array, side: int, off: float, on: float, way: Array, angle: float, along: float
) -> None:
    """One foot's way from where it stands to its new place, in the air from ``off`` to ``on`` (s)."""
    size = frame.length
    home = _home(frame, side)
    c, s = np.cos(angle), np.sin(angle)
    goal = way + np.array([home[0] * c + home[2] * s, 0.0, -home[0] * s + home[2] * c])
    u = _track(times, [(off, 0.0), (on, 1.0)])
    ground = home + u[:, None] * (goal - home)
    # The foot keeps out of the way of the standing one, in an arc about it.
    apart = np.sin(pi * np.clip((times - off) / (on - off), 0, 1)) ** 2
    ground[:, 0] += SIGN[side] * 0.02 * size * apart
    far = float(np.linalg.norm(goal - home)) / size
    yaw = SIGN[side] * TOE_OUT + angle * _track(times, [(off, 0.0), (on, 1.0)])
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
    _put(frame, plan, side, ground, yaw, _smooth(times, knots), lift)
    plan.contacts[:, side] = (times <= off + 1e-9) | (times >= on - 1e-9)


def jump(name: str, frame: Frame, angle: float, distance: float, height: float, crouch: float = 1.0) -> Made:
    """A jump from both feet: ``distance`` m along ``angle`` (rad, 0 ahead, positive to the left), without turning.

    ``height`` m is how far the hips rise over where they were when standing; both of the reference figure.
    """
    size, slow = frame.length, frame.time
    way = np.array([np.sin(angle), 0.0, np.cos(angle)]) * distance
    ahead, aside = float(way[2]), float(way[0])
    # Take-off with stretched legs on the toes; the rest of the height is flight.
    # How far the hips are from over the ankles then; these come forward as the heels rise.
    lean_out = min(0.20 * distance, 0.22)
    off_ankles = np.hypot(lean_out * np.cos(angle) - 0.12, lean_out * np.sin(angle))
    # Knees go on stretching for a moment after the toes have left the ground.
    tiptoe = 0.036 - (0.795 - float(np.sqrt(0.795**2 - off_ankles**2)))
    rise = max(height - tiptoe, 0.03)
    fall = rise + tiptoe + 0.035  # lands with knees a little bent, on flat feet
    up, down = np.sqrt(2 * rise / GRAVITY), np.sqrt(2 * fall / GRAVITY)
    low = (0.13 + 0.42 * height + 0.06 * distance) * crouch
    low = min(low, 0.36)
    dip_land = min(0.08 + 0.28 * height + 0.07 * distance, 0.34)
    speed_up = GRAVITY * up
    down_time, push = 0.36 + 0.35 * low, 2.1 * (low + tiptoe) / speed_up
    push = float(np.clip(push, 0.16, 0.34))
    land_time, recover = 0.16 + 0.25 * dip_land, 0.42 + 0.5 * dip_land
    deep = down_time
    off = deep + push
    apex = off + up
    on = apex + down
    settle = on + land_time
    end = settle + recover
    scale = slow
    frames = round(end * scale * FPS)
    scale = frames / FPS / end
    keys = np.array([0.0, deep, off, apex, on, end]) * scale
    times = np.arange(frames + 1) / FPS
    t = times / scale
    plan = _plan(frame, times)
    home = _standing_height(frame)
    height_off = tiptoe
    # Root height: crouch, push (smooth to the take-off speed), parabola, absorb (from the landing speed), rise.
    y = np.zeros(len(t))
    y = np.where(t <= deep, -low * _unit(t / deep), y)
    y = np.where((t > deep) & (t <= off), _hermite1(t, deep, off, -low, 0.0, height_off, speed_up), y)
    y = np.where((t > off) & (t <= on), height_off + speed_up * (t - off) - 0.5 * GRAVITY * (t - off) ** 2, y)
    land_y, land_v = tiptoe + rise - fall, -GRAVITY * down
    land_v_soft = max(land_v, -3.0 * dip_land / land_time)
    y = np.where((t > on) & (t <= settle), _hermite1(t, on, settle, land_y, land_v_soft, -dip_land, 0.0), y)
    y = np.where(t > settle, -dip_land * (1.0 - _unit((t - settle) / recover)), y)
    plan.root[:, 1] = home + size * y
    # Over the ground: some way on the feet at either end, the rest in flight at constant speed.
    flight = distance - 1.0 * lean_out - 0.5 * lean_out
    v = flight / (up + down)
    s = np.zeros(len(t))
    back = -0.10 * min(max(ahead, 0.0), 1.0)  # the hips go back in the crouch of a forward jump
    s = np.where(t <= deep, back * _unit(t / deep), s)
    s = np.where((t > deep) & (t <= off), _hermite1(t, deep, off, back, 0.0, lean_out, v), s)
    s = np.where((t > off) & (t <= on), lean_out + v * (t - off), s)
    at_on = lean_out + v * (up + down)
    s = np.where((t > on) & (t <= settle), _hermite1(t, on, settle, at_on, v, distance * 0.985, 0.3 * v * 0.2), s)
    s = np.where(t > settle, distance * 0.985 + 0.015 * distance * _unit((t - settle) / recover), s)
    plan.root += size * s[:, None] * np.array([np.sin(angle), 0.0, np.cos(angle)])
    squat = np.clip(-y / 0.36, 0.0, 1.0)
    plan.root[:, 2] -= 0.05 * size * squat
    _jump_feet(frame, plan, t, way, deep, off, apex, on, settle, ahead, height)
    _jump_body(plan, t, deep, off, apex, on, settle, end, ahead, aside, height, low, dip_land)
    _lower(frame, plan, 0.9985)
    return assemble(name, frame, plan), keys, plan.contacts


def _jump_feet(
    frame: Frame,
    plan: Plan,
    t: Array,
    way: Array,
    deep: float,
    off: float,
    apex: float,
    on: float,
    settle: float,
    ahead: float,
    height: float,
) -> None:
    """Feet push off over the toes, are drawn up in the air and come down before the body."""
    size = frame.length
    span = on - off
    tuck = 0.05 + 0.16 * height + 0.05 * float(np.hypot(way[0], way[2]))
    for side in (0, 1):
        stagger = 0.012 * SIGN[side] * np.sign(way[0]) if abs(way[0]) > 0.05 else 0.0
        home = _home(frame, side)
        u = np.clip((t - off - stagger) / span, 0.0, 1.0)
        move = u * u * (3 - 2 * u)
        move = 0.55 * move + 0.45 * (10 * u**3 - 15 * u**4 + 6 * u**5)
        ground = home + (size * move)[:, None] * way
        toe = np.radians(58.0)
        land = np.radians(-16.0 + 30.0 * np.clip(ahead, 0.0, 1.0) - 8.0 * np.clip(-ahead, 0.0, 1.0))
        pitch = _smooth(
            t,
            [
                (deep + 0.30 * (off - deep), 0.0),
                (deep + 0.72 * (off - deep), -0.18 * toe),
                (off, -0.86 * toe),
                (off + 0.12 * span, -1.14 * toe),
                (off + 0.60 * span, -0.45 * toe + 0.3 * land),
                (on, land),
                (on + 0.07, 0.0),
            ],
        )
        # The soles stay below the body: drawn up in the middle, and all the way no farther off than a leg is long.
        w = np.sin(pi * u)
        lift = size * tuck * w**1.6 * (u > 0) * (u < 1)
        sole = frame.soles[side]
        hip = plan.root[:, 1] + frame.hip_offsets[side, 1]
        rise, forward = rolled(sole, pitch).T
        away = np.hypot(
            plan.root[:, 0] + frame.hip_offsets[side, 0] - ground[:, 0], plan.root[:, 2] - ground[:, 2] - forward
        )
        # A leg goes on stretching, ever slower, while it is drawn up; where it lands it is as long as it has to be.
        far = np.hypot(hip - rise - lift, away) / frame.leg
        landing = float(far[np.searchsorted(t, on)])
        start = 0.935 + (max(landing, 0.955) - 0.935) * (t - off) / span
        room = np.maximum(0.988 - start, 0.006)
        soft = np.where(far > start, start + room * (1.0 - np.exp(-(far - start) / room)), far)
        up = hip - rise - np.sqrt(np.maximum((soft * frame.leg) ** 2 - away**2, 1e-4))
        flying = (t > off) & (t < on)
        lift = np.where(flying, np.maximum(np.maximum(lift, up), 0.0), 0.0)
        _put(frame, plan, side, ground, np.full(len(t), SIGN[side] * TOE_OUT), pitch, lift)
        grounded = np.maximum(1.0 - blend(u, 0.0, 0.35), blend(u, 0.75, 0.97))
        plan.toe_bend[side] = np.clip(-pitch, 0.0, np.radians(62.0)) * grounded
        plan.contacts[:, side] = (t <= off + 1e-9) | (t >= on - 1e-9)
    plan.knee_out = 0.10


def _jump_body(
    plan: Plan,
    t: Array,
    deep: float,
    off: float,
    apex: float,
    on: float,
    settle: float,
    end: float,
    ahead: float,
    aside: float,
    height: float,
    low: float,
    dip: float,
) -> None:
    """Trunk and arms: folded and swung back in the crouch, thrown up at take-off, out to the front on landing."""
    effort = min(0.45 + 1.1 * height + 0.35 * abs(ahead), 1.25)
    fold = 26.0 + 60.0 * low
    fold_land = 14.0 + 60.0 * dip
    fly = 6.0 * np.clip(ahead, 0.0, 1.0)
    trunk = _smooth(
        t,
        [
            (0.0, 1.0),
            (deep, fold),
            (off, 3.0 + 6.0 * ahead),
            (apex, 2.0 + fly),
            (on, 10.0 + 12.0 * max(ahead, 0.0)),
            (settle, fold_land + 6.0 * ahead),
            (end, 1.0),
        ],
    )
    plan.trunk[:, 0] = np.radians(trunk)
    plan.pelvis[:, 0] = np.radians(0.5 * trunk)
    plan.gaze[:, 0] = np.radians(0.15 * trunk)
    side = _smooth(
        t,
        [(0.0, 0.0), (deep, 6.0 * aside), (off, 9.0 * aside), (on, -4.0 * aside), (settle, -3.0 * aside), (end, 0.0)],
    )
    plan.trunk[:, 2] += np.radians(side)
    plan.pelvis[:, 2] += np.radians(0.4 * side)
    back, up = -52.0 * effort, min(118.0 * effort, 150.0)
    arms = _smooth(
        t,
        [
            (0.0, -2.0),
            (0.55 * deep, 16.0 * effort),
            (deep, back),
            (deep + 0.45 * (off - deep), 0.3 * back),
            (off, 0.80 * up),
            (0.5 * (off + apex), up),
            (on, 0.58 * up),
            (settle, 32.0),
            (end, -2.0),
        ],
    )
    elbow = _smooth(
        t,
        [
            (0.0, 16.0),
            (deep, 24.0),
            (0.5 * (deep + off), 50.0),
            (apex, 34.0),
            (on, 28.0),
            (settle, 38.0),
            (end, 16.0),
        ],
    )
    out = _smooth(t, [(0.0, 9.0), (deep, 15.0), (off, 12.0), (apex, 17.0), (settle, 22.0), (end, 9.0)])
    lag = 0.012
    for arm in (0, 1):
        shifted = np.interp(t - (lag if arm else 0.0), t, arms)
        plan.shoulder[arm] = np.radians(shifted)
        plan.elbow[arm] = np.radians(elbow)
        plan.abduct[arm] = np.radians(out + 6.0 * abs(aside))


def _unit(u: Array) -> Array:
    u = np.clip(u, 0.0, 1.0)
    return np.asarray(10 * u**3 - 15 * u**4 + 6 * u**5, dtype=np.float64)


def _hermite1(t: Array, t0: float, t1: float, a: float, va: float, b: float, vb: float) -> Array:
    h = t1 - t0
    u = np.clip((t - t0) / h, 0.0, 1.0)
    return np.asarray(
        (2 * u**3 - 3 * u**2 + 1) * a
        + (u**3 - 2 * u**2 + u) * h * va
        + (-2 * u**3 + 3 * u**2) * b
        + (u**3 - u**2) * h * vb,
        dtype=np.float64,
    )
