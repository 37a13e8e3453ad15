"""Jumps from both feet, in any direction: crouch, push, ballistic flight, landing."""

from math import pi

import numpy as np
from numpy.typing import NDArray

from bunraku.motion.ground import rolled
from bunraku.motion.synth_body import FPS, GRAVITY, SIGN, Frame, Plan, assemble, posed
from bunraku.motion.synth_bounds import ANKLE_TRIES, pitched_more
from bunraku.motion.synth_curves import blend
from bunraku.motion.synth_stand import TOE_OUT, Made, home_of, lowered, put_foot, quiet_plan, smooth, standing_height

Array = NDArray[np.float64]


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
    down_time, push = 0.27 + 0.32 * low, 2.1 * (low + tiptoe) / speed_up
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
    plan = quiet_plan(frame, times)
    home = standing_height(frame)
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
    _jump_body(plan, t, deep, off, apex, on, settle, end, ahead, aside, height, low, dip_land)
    root, pitched = plan.root, np.zeros((2, frames + 1))
    for _ in range(ANKLE_TRIES):
        plan.root = root.copy()
        _jump_feet(frame, plan, t, way, deep, off, apex, on, settle, ahead, height, pitched)
        lowered(frame, plan, 0.9985)
        more = pitched_more(posed(name, frame, plan))
        if not more.any():
            break
        pitched += more
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
    pitched: Array,
) -> None:
    """Feet push off over the toes, are drawn up in the air and come down before the body."""
    size = frame.length
    span = on - off
    tuck = 0.05 + 0.16 * height + 0.05 * float(np.hypot(way[0], way[2]))
    for side in (0, 1):
        stagger = 0.012 * SIGN[side] * np.sign(way[0]) if abs(way[0]) > 0.05 else 0.0
        home = home_of(frame, side)
        u = np.clip((t - off - stagger) / span, 0.0, 1.0)
        move = u * u * (3 - 2 * u)
        move = 0.55 * move + 0.45 * (10 * u**3 - 15 * u**4 + 6 * u**5)
        ground = home + (size * move)[:, None] * way
        toe = np.radians(58.0)
        land = np.radians(-16.0 + 30.0 * np.clip(ahead, 0.0, 1.0) - 8.0 * np.clip(-ahead, 0.0, 1.0))
        pitch = smooth(
            t,
            [
                (deep + 0.30 * (off - deep), 0.0),
                (deep + 0.72 * (off - deep), -0.18 * toe),
                (off, -0.86 * toe),
                (off + 0.12 * span, -0.96 * toe),
                (off + 0.60 * span, -0.45 * toe + 0.3 * land),
                (on, land),
                (on + 0.07, 0.0),
            ],
        )
        pitch = pitch + pitched[side]
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
        put_foot(frame, plan, side, ground, np.full(len(t), SIGN[side] * TOE_OUT), pitch, lift)
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
    effort = min(0.15 + 1.1 * height + 0.45 * abs(ahead), 1.1)
    fold = 26.0 + 60.0 * low
    fold_land = 14.0 + 60.0 * dip
    fly = 6.0 * np.clip(ahead, 0.0, 1.0)
    trunk = smooth(
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
    side = smooth(
        t,
        [(0.0, 0.0), (deep, 6.0 * aside), (off, 9.0 * aside), (on, -4.0 * aside), (settle, -3.0 * aside), (end, 0.0)],
    )
    plan.trunk[:, 2] += np.radians(side)
    plan.pelvis[:, 2] += np.radians(0.4 * side)
    back, up = -16.0 - 32.0 * effort, 14.0 + 104.0 * effort
    arms = smooth(
        t,
        [
            (0.0, -2.0),
            (0.55 * deep, 16.0 * effort),
            (deep, back),
            (deep + 0.45 * (off - deep), 0.3 * back),
            (off, 0.80 * up),
            (0.5 * (off + apex), up),
            (on, 0.46 * up),
            (settle, 30.0),
            (end, -2.0),
        ],
    )
    elbow = smooth(
        t,
        [
            (0.0, 16.0),
            (deep, 24.0),
            (0.5 * (deep + off), 54.0),
            (off, 64.0),
            (apex, 58.0),
            (on, 46.0),
            (settle, 42.0),
            (end, 16.0),
        ],
    )
    by = deep + 0.6 * (off - deep)  # the hands come by the thighs
    out = smooth(t, [(0.0, 9.0), (deep, 17.0), (by, 23.0), (off, 14.0), (apex, 17.0), (settle, 22.0), (end, 9.0)])
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
