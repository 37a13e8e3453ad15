"""What a clip does, in numbers: speed, turn, lean, duck, jump, measured from the clip itself.

The body's place is the middle of its hip joints, its heading square to the line between them, and its lean
that of the line from there to the neck: points that any humanoid has, whatever its root joint is.
"""

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from bunraku.motion import rotation as rot
from bunraku.motion.analysis_contacts import Flags, contacts, foot_joints, foot_skate, runs
from bunraku.motion.body import leg_length
from bunraku.motion.clip import Clip

Array = NDArray[np.float64]

STRIDE = 0.1  # s between the places whose distances add up to the way gone (the capture's jitter must not)
DUCK_SHARE = 0.4  # of the leg length: how far down the hips are at a duck of 1
GRAVITY = 9.81  # m/s²


@dataclass(frozen=True)
class Measures:
    """The measures of one clip. Lengths m, times s, angles rad; left, forward and up are positive."""

    seconds: float
    speed: float  # m/s, mean along the way gone
    net_forward: float  # from first frame to last, as the first one faces
    net_left: float
    distance: float  # between first and last place on the ground
    direction: float  # of that from straight ahead
    heading_change: float
    turn_rate: float  # rad/s, mean
    hips_min: float  # height of the middle of the hip joints
    hips_max: float
    rise: float  # the hips' highest over their height at the beginning
    bend_mean: float
    bend_max: float
    tilt_mean: float
    tilt_min: float
    tilt_max: float
    duck_mean: float  # how far the hips are below their height at rest, in 0.4 leg lengths
    duck_max: float
    flight_height: float  # how far the lowest of ankles and toe joints rises over where it mostly is
    flight_seconds: float  # longest time with no foot on the ground
    left_foot_max: float  # the ankle's highest place over the feet's lowest joints
    right_foot_max: float
    left_hand_speed: float  # m/s, mean, relative to the hips
    right_hand_speed: float
    foot_skate: float  # m/s, mean of feet on the ground

    def as_dict(self) -> dict[str, float]:
        """Name -> value, for tables and JSON."""
        return asdict(self)


def hips(clip: Clip) -> Array:
    """(F, 3) m: the middle of the two hip joints."""
    places = clip.world[0]
    left, right = clip.skeleton.role("leftUpperLeg"), clip.skeleton.role("rightUpperLeg")
    return np.asarray(0.5 * (places[:, left] + places[:, right]), dtype=np.float64)


def headings(clip: Clip) -> Array:
    """(F,) rad, continuous: square to the line of the hip joints; 0 is +Z, positive to the left.

    Unlike the turn of the hips' own joint it means the same on any skeleton, and upside down too.
    """
    places = clip.world[0]
    left = places[:, clip.skeleton.role("leftUpperLeg")] - places[:, clip.skeleton.role("rightUpperLeg")]
    return np.asarray(np.unwrap(np.arctan2(-left[:, 2], left[:, 0])), dtype=np.float64)


def lean(clip: Clip) -> tuple[Array, Array]:
    """(F,) tilt to the left and (F,) bend forward, rad, of the line from the hips to the neck."""
    top = next((clip.skeleton.roles[r] for r in ("neck", "head", "upperChest", "chest") if r in clip.skeleton.roles), 0)
    line = rot.rotate(rot.yaw(-headings(clip)), clip.world[0][:, top] - hips(clip))
    return np.arctan2(line[:, 0], line[:, 1]), np.arctan2(line[:, 2], line[:, 1])


def ducks(clip: Clip) -> Array:
    """(F,) how far the hips are below their height at rest, as a share of 0.4 leg lengths."""
    skeleton = clip.skeleton
    rest = skeleton.rest_positions
    stand = 0.5 * (rest[skeleton.role("leftUpperLeg"), 1] + rest[skeleton.role("rightUpperLeg"), 1])
    leg = leg_length(skeleton.offsets, [int(p) for p in skeleton.parents], skeleton.roles)
    return np.asarray((stand - hips(clip)[:, 1]) / (DUCK_SHARE * leg), dtype=np.float64)


def path_speed(places: Array, fps: float) -> float:
    """m/s: length of the way (F, 3) over the ground, sampled ten times a second, over its duration."""
    if len(places) < 2:
        return 0.0
    times = np.arange(len(places)) / fps
    count = max(1, round(times[-1] / STRIDE))
    at = np.linspace(0.0, times[-1], count + 1)
    way = np.stack([np.interp(at, times, places[:, axis]) for axis in (0, 2)], axis=1)
    return float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum() / times[-1])


def measure(clip: Clip, flags: Flags | None = None) -> Measures:
    """Everything of a humanoid clip; ``flags`` (F, 2) are its contacts where they are known already.

    Raises:
        SkeletonError: the clip is of no humanoid.
    """
    on = contacts(clip) if flags is None else flags
    middle, heading = hips(clip), headings(clip)
    tilt, bend = lean(clip)
    duck = ducks(clip)
    places = clip.world[0]
    skeleton = clip.skeleton
    seconds = clip.duration
    went = rot.rotate(rot.yaw(-heading[0]), middle[-1] - middle[0])
    turned = float(heading[-1] - heading[0])
    low = places[:, foot_joints(clip), 1].min(axis=1)
    floor = float(np.percentile(low, 5))
    flight = max((last - first for first, last in runs(np.logical_not(on.any(axis=1)))), default=0)
    feet = [skeleton.role(side + "Foot") for side in ("left", "right")]
    lifted = [float(places[:, j, 1].max() - floor) for j in feet]
    hand = [_hand_speed(places[:, skeleton.role(side + "Hand")] - middle, clip.fps) for side in ("left", "right")]
    return Measures(
        seconds=seconds,
        speed=path_speed(middle, clip.fps),
        net_forward=float(went[2]),
        net_left=float(went[0]),
        distance=float(np.hypot(went[0], went[2])),
        direction=float(np.arctan2(went[0], went[2])) if np.hypot(went[0], went[2]) > 1e-6 else 0.0,
        heading_change=turned,
        turn_rate=turned / seconds if seconds > 0.0 else 0.0,
        hips_min=float(middle[:, 1].min()),
        hips_max=float(middle[:, 1].max()),
        rise=float(middle[:, 1].max() - middle[0, 1]),
        bend_mean=float(bend.mean()),
        bend_max=float(bend.max()),
        tilt_mean=float(tilt.mean()),
        tilt_min=float(tilt.min()),
        tilt_max=float(tilt.max()),
        duck_mean=float(duck.mean()),
        duck_max=float(duck.max()),
        flight_height=float(low.max() - floor),
        flight_seconds=flight / clip.fps,
        left_foot_max=lifted[0],
        right_foot_max=lifted[1],
        left_hand_speed=hand[0],
        right_hand_speed=hand[1],
        foot_skate=foot_skate(clip, on),
    )


def _hand_speed(track: Array, fps: float) -> float:
    return float(np.linalg.norm(np.diff(track, axis=0), axis=1).mean() * fps) if len(track) > 1 else 0.0
