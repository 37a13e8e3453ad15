"""What is wrong in a capture: found by looking at the numbers, before anybody animates with it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bunraku.motion.analysis import hips
from bunraku.motion.analysis_contacts import Flags, contacts, floor_height, foot_skate, sole_points
from bunraku.motion.body import leg_length
from bunraku.motion.clip import Clip

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FlawLimits:
    """Beyond what people and good captures do."""

    flip: float = 0.8  # rad that a joint may turn from one frame to the next, if also
    flip_speed: float = 52.0  # rad/s (3000 degrees/s)
    acceleration: float = 400.0  # m/s² of a joint
    hand_speed: float = 18.0  # m/s relative to the hips
    floor: float = 0.04  # m that the floor may be off zero
    slope: float = 0.04  # m that planted feet may rise or sink over a clip
    depth: float = 0.12  # m that a sole may be under the floor
    sitting: float = 0.28  # leg lengths that the feet may be ahead of or behind the hips for most of a clip
    sliding: float = 0.5  # m/s of feet on the ground
    still: float = 0.0005  # m that the hips of somebody who walks must go up and down


LIMITS = FlawLimits()


@dataclass(frozen=True)
class Flaw:
    """One finding: its kind, the frame where it is worst (-1: the whole clip), and a line in words."""

    kind: str  # flip, spike, fast, floor, slope, under, sitting, sliding, flat
    frame: int
    text: str


def flaws(clip: Clip, flags: Flags | None = None, limits: FlawLimits = LIMITS) -> list[Flaw]:
    """What is doubtful in a humanoid clip, the worst first of each kind."""
    on = contacts(clip) if flags is None else flags
    found = _flips(clip, limits) + _spikes(clip, limits) + _ground(clip, on, limits)
    middle = hips(clip)
    leg = leg_length(clip.skeleton.offsets, [int(p) for p in clip.skeleton.parents], clip.skeleton.roles)
    places = clip.world[0]
    ankles = 0.5 * (places[:, clip.skeleton.role("leftFoot")] + places[:, clip.skeleton.role("rightFoot")])
    apart = np.linalg.norm((ankles - middle)[:, [0, 2]], axis=1)
    upright = (middle[:, 1] - ankles[:, 1]) > 0.6 * leg
    grounded = on.any(axis=1)
    if upright.mean() > 0.8 and grounded.mean() > 0.8 and float(np.median(apart)) > limits.sitting * leg:
        found.append(
            Flaw(
                "sitting",
                -1,
                f"the feet are {100 * float(np.median(apart)):.0f} cm beside the hips most of the time: sitting?",
            )
        )
    return found


def _flips(clip: Clip, limits: FlawLimits) -> list[Flaw]:
    if len(clip) < 2:
        return []
    dots = np.abs(np.sum(clip.rotations[1:] * clip.rotations[:-1], axis=-1))
    step = 2.0 * np.arccos(np.clip(dots, 0.0, 1.0))
    found = []
    bad = step > max(limits.flip, limits.flip_speed / clip.fps)
    for joint in np.flatnonzero(bad.any(axis=0)):
        frame = int(np.argmax(step[:, joint]))
        found.append(
            Flaw(
                "flip",
                frame + 1,
                f"joint {clip.skeleton.names[joint]!r} turns {np.degrees(step[frame, joint]):.0f} degrees "
                f"in one frame ({int(bad[:, joint].sum())} times)",
            )
        )
    return found


def _spikes(clip: Clip, limits: FlawLimits) -> list[Flaw]:
    found = []
    places = clip.world[0]
    if len(clip) >= 3:
        size = np.linalg.norm(np.diff(places, n=2, axis=0), axis=-1) * clip.fps**2
        frame, joint = np.unravel_index(int(np.argmax(size)), size.shape)
        if size[frame, joint] > limits.acceleration:
            name = clip.skeleton.names[int(joint)]
            found.append(Flaw("spike", int(frame) + 1, f"joint {name!r} jerks: {size[frame, joint]:.0f} m/s²"))
    if len(clip) >= 2:
        for side in ("left", "right"):
            hand = clip.skeleton.roles.get(side + "Hand")
            if hand is None:
                continue
            speed = np.linalg.norm(np.diff(places[:, hand] - hips(clip), axis=0), axis=1) * clip.fps
            if speed.max() > limits.hand_speed:
                found.append(Flaw("fast", int(np.argmax(speed)) + 1, f"the {side} hand moves at {speed.max():.0f} m/s"))
    return found


def _ground(clip: Clip, on: Flags, limits: FlawLimits) -> list[Flaw]:
    found = []
    middle = hips(clip)
    floor = floor_height(clip)
    if abs(floor) > limits.floor:
        found.append(Flaw("floor", -1, f"the floor is {100 * floor:+.0f} cm off zero"))
    soles = sole_points(clip)[:, :, :2, 1]
    low = soles.min(axis=(1, 2)) - floor
    if float(low.min()) < -limits.depth:
        found.append(Flaw("under", int(np.argmin(low)), f"a foot is {-100 * float(low.min()):.0f} cm under the floor"))
    if float(middle[:, 1].min()) < floor - 0.02:
        frame = int(np.argmin(middle[:, 1]))
        found.append(
            Flaw("under", frame, f"the hips are {100 * (floor - float(middle[frame, 1])):.0f} cm under the floor")
        )
    went = float(np.linalg.norm(np.diff(middle[:, [0, 2]], axis=0), axis=1).sum()) if len(clip) > 1 else 0.0
    rise = _rise_of_planted_feet(clip, soles, on)
    if went > 1.0 and abs(rise) > limits.slope:
        found.append(Flaw("slope", -1, f"the floor is not level: planted feet {'rise' if rise > 0 else 'sink'} "
                                       f"{100 * abs(rise):.0f} cm over {went:.1f} m"))  # fmt: skip
    skate = foot_skate(clip, on)
    if skate > limits.sliding:
        found.append(Flaw("sliding", -1, f"feet slide on the ground at {skate:.2f} m/s"))
    if went > 1.0 and float(np.ptp(middle[:, 1])) < limits.still:
        found.append(Flaw("flat", -1, "the hips move without going up or down: the vertical part is missing"))
    return found


def _rise_of_planted_feet(clip: Clip, soles: Array, on: Flags) -> float:
    """m: how much the planted feet's lowest points rise from the clip's beginning to its end, by a straight line."""
    times, heights = [], []
    for foot in range(2):
        at = np.flatnonzero(on[:, foot])
        times.append(at / max(len(clip) - 1, 1))
        heights.append(soles[at, foot].min(axis=1))
    t, h = np.concatenate(times), np.concatenate(heights)
    if len(t) < 10 or float(np.ptp(t)) < 0.5:
        return 0.0
    return float(np.polyfit(t, h, 1)[0] * np.ptp(t))
