"""Edits that make one motion from another: leaning, ducking, carrying elsewhere, marching, closing to a loop.

Whatever an edit does to the body, feet that stood on the ground stand there again: the legs follow by inverse
kinematics.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bunraku.motion import rotation as rot
from bunraku.motion.analysis import DUCK_SHARE, headings, lean
from bunraku.motion.analysis_contacts import Flags, floor_height, runs, sole_points
from bunraku.motion.body import leg_length
from bunraku.motion.clip import Clip, local, world
from bunraku.motion.leg import move_leg
from bunraku.motion.parameters import cycle_path

Array = NDArray[np.float64]

_BACK = ("spine", "chest", "upperChest")
SHIFT = 0.45  # of the way to the standing foot that the hips go while the other one is in the air
MOST_REACH = 0.998  # of the leg's length
HANG, ELBOW = np.radians(80.0), np.radians(16.0)  # of hanging arms: down from the T-pose, and the elbow's bend
HEAD_SHARE = 0.35  # of a lean that the head goes along with; it looks ahead


def leg_of(clip: Clip) -> float:
    """m: thigh and shin."""
    skeleton = clip.skeleton
    return leg_length(skeleton.offsets, [int(p) for p in skeleton.parents], skeleton.roles)


def with_legs(clip: Clip, ankles: Array, feet: Array) -> Clip:
    """The clip with its ankles at ``ankles`` (F, 2, 3; m) and its feet turned as ``feet`` (F, 2, 4; world).

    Where a leg is too short, the hips come down for it, smoothly; knees keep their side.
    """
    skeleton = clip.skeleton
    clip = replace(clip, roots=clip.roots - _lowering(clip, ankles)[:, None] * rot.UP)
    rotations = np.array(clip.rotations)
    places, turns = (np.array(part) for part in world(skeleton, clip.roots, rotations))
    rest = skeleton.rest_positions
    for side, name in enumerate(("left", "right")):
        joints = np.array([skeleton.role(name + part) for part in ("UpperLeg", "LowerLeg", "Foot")])
        upper, lower = (float(np.linalg.norm(rest[b] - rest[a])) for a, b in pairwise(joints))
        for frame in range(len(clip)):
            move_leg(
                skeleton.parents, joints, places[frame], turns[frame], rotations[frame],
                np.ascontiguousarray(ankles[frame, side]), np.ascontiguousarray(feet[frame, side]),
                upper, lower, MOST_REACH * (upper + lower),
            )  # fmt: skip
    return replace(clip, rotations=rotations)


def _lowering(clip: Clip, ankles: Array) -> Array:
    """(F,) m: how far the hips have to come down for both ankles to be in reach, smoothed."""
    skeleton = clip.skeleton
    places = clip.world[0]
    rest = skeleton.rest_positions
    down = np.zeros(len(clip))
    for side, name in enumerate(("left", "right")):
        hip, knee, foot = (skeleton.role(name + part) for part in ("UpperLeg", "LowerLeg", "Foot"))
        length = float(np.linalg.norm(rest[knee] - rest[hip]) + np.linalg.norm(rest[foot] - rest[knee]))
        # As far as the clip's own leg is stretched is far enough.
        own = np.linalg.norm(places[:, foot] - places[:, hip], axis=1)
        reach = np.maximum(MOST_REACH * length, np.minimum(own, length))
        off = places[:, hip] - ankles[:, side]
        flat = np.linalg.norm(off[:, [0, 2]], axis=1)
        high = np.sqrt(np.maximum(reach**2 - flat**2, 0.0))
        down = np.maximum(down, off[:, 1] - high)
    if not np.any(down > 0.0):
        return down
    half = max(1, round(0.05 * clip.fps))
    padded = np.pad(down, 2 * half, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1).max(axis=-1)
    return np.asarray(np.convolve(windows, np.full(2 * half + 1, 1.0 / (2 * half + 1)), "valid"), dtype=np.float64)


def feet_of(clip: Clip) -> tuple[Array, Array]:
    """Places (F, 2, 3; m) and world orientations (F, 2, 4) of both ankles."""
    joints = [clip.skeleton.role("leftFoot"), clip.skeleton.role("rightFoot")]
    places, turns = clip.world
    return np.array(places[:, joints]), np.array(turns[:, joints])


def levelled(clip: Clip, flags: Flags) -> Clip:
    """On a level floor at height 0: the rise of the planted feet, by a straight line along the time, taken off."""
    low = sole_points(clip)[:, :, :2, 1].min(axis=2)
    times = np.arange(len(clip)) / max(len(clip) - 1, 1)
    t = np.concatenate([times[flags[:, foot]] for foot in range(2)])
    h = np.concatenate([low[flags[:, foot], foot] for foot in range(2)])
    roots = np.array(clip.roots)
    if len(t) >= 10 and float(np.ptp(t)) > 0.6 and float(np.linalg.norm((roots[-1] - roots[0])[[0, 2]])) > 1.0:
        roots[:, 1] -= np.polyfit(t, h, 1)[0] * (times - 0.5)
    flat = replace(clip, roots=roots)
    roots[:, 1] -= floor_height(flat)
    return replace(clip, roots=roots)


def leaned(clip: Clip, tilt: float, bend: float) -> Clip:
    """Leaning on average by ``tilt`` (rad to the left) and ``bend`` (rad forward) more, from hips to neck.

    The pelvis takes a quarter, the back's joints share the rest evenly; the head follows a third and looks ahead;
    the feet stay.
    """
    ankles, feet = feet_of(clip)
    asked = np.array([tilt, bend])
    before = np.array([float(np.mean(part)) for part in lean(clip)])
    turn = asked
    leaning = _bent(clip, turn)
    for _ in range(2):  # the line from hips to neck leans less than the chest does
        got = np.array([float(np.mean(part)) for part in lean(leaning)]) - before
        turn = turn + (asked - got)
        leaning = _bent(clip, turn)
    return with_legs(leaning, ankles, feet)


def _bent(clip: Clip, turn: Array) -> Clip:
    """Pelvis, back, neck and head turned by their shares of ``turn`` (2: tilt, bend; rad) about the body's axes."""
    skeleton = clip.skeleton
    turns = np.array(clip.world[1])
    heading = rot.yaw(headings(clip))
    back = [skeleton.roles[r] for r in _BACK if r in skeleton.roles]
    shares = {skeleton.role("hips"): 0.25}
    shares |= {joint: 0.25 + 0.75 * (k + 1) / len(back) for k, joint in enumerate(back)}
    if "neck" in skeleton.roles:
        shares[skeleton.role("neck")] = 0.5 * (1.0 + HEAD_SHARE)
    if "head" in skeleton.roles:
        shares[skeleton.role("head")] = HEAD_SHARE
    vector = np.array([turn[1], 0.0, -turn[0]])
    share = np.zeros(len(skeleton))
    for joint in range(len(skeleton)):
        parent = int(skeleton.parents[joint])
        share[joint] = shares.get(joint, share[parent] if parent >= 0 else 0.25)
        own = rot.mul(rot.mul(heading, rot.exp(vector * share[joint])), rot.inverse(heading))
        turns[:, joint] = rot.mul(own, turns[:, joint])
    return replace(clip, rotations=local(skeleton, turns))


def calmed(clip: Clip, share: float) -> Clip:
    """The arms hanging: ``share`` of the way (0..1) to arms a little off the body with elbows a little bent."""
    skeleton = clip.skeleton
    rotations = np.array(clip.rotations)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        down = rot.axis_angle([0.0, 0.0, 1.0], np.array(-sign * HANG))
        elbow = rot.mul(rot.mul(rot.inverse(down), rot.axis_angle([1.0, 0.0, 0.0], np.array(-ELBOW))), down)
        still = np.array([0.0, 0.0, 0.0, 1.0])
        for part, pose in (("Shoulder", still), ("UpperArm", down), ("LowerArm", elbow), ("Hand", still)):
            joint = skeleton.roles.get(side + part)
            if joint is not None:
                rotations[:, joint] = rot.slerp(
                    rotations[:, joint], pose, np.full(len(clip), min(max(share, 0.0), 1.0))
                )
    return replace(clip, rotations=rotations)


def ducked(clip: Clip, duck: float) -> Clip:
    """The hips lower by ``duck`` times 0.4 leg lengths, the feet where they were."""
    ankles, feet = feet_of(clip)
    low = replace(clip, roots=clip.roots - np.array([0.0, duck * DUCK_SHARE * leg_of(clip), 0.0]))
    return with_legs(low, ankles, feet)


def carried(clip: Clip, flags: Flags, x: float, z: float, off: float, land: float) -> Clip:
    """The same motion ending ``x``, ``z`` (m, world) farther on.

    Each foot goes the way while it is in the air, and stands where it stood, moved, otherwise; the body goes from
    shortly before ``off`` (s) to shortly after ``land``.
    """
    frames = len(clip)
    times = np.arange(frames) / clip.fps
    way = np.array([x, 0.0, z])
    margin = 0.25 * (land - off) + 0.12
    body = _eased(times, max(off - margin, 0.0), min(land + margin, clip.duration))
    ankles, feet = feet_of(clip)
    for foot in range(2):
        ankles[:, foot] += _air_share(flags[:, foot], times, off, land)[:, None] * way
    moved = replace(clip, roots=clip.roots + body[:, None] * way)
    return with_legs(moved, ankles, feet)


def step_flags(flags: Flags, keys: Array, fps: float, lead: int) -> Flags:
    """(F, 2) contacts of a step made at the key times (6; s): the leading foot's swing, then the other one's."""
    on = np.ones_like(flags)
    for foot, (off, down) in ((lead, (keys[1], keys[2])), (1 - lead, (keys[3], keys[4]))):
        on[round(off * fps) : round(down * fps), foot] = False
    return on


def stepping(clip: Clip, flags: Flags, lift: float) -> Clip:
    """Feet that are in the air by ``flags`` lifted by up to ``lift`` (m), the weight over the one that stands."""
    ankles, feet = feet_of(clip)
    roots = np.array(clip.roots)
    times = np.arange(len(clip)) / clip.fps
    for foot in range(2):
        for first, last in runs(np.logical_not(flags[:, foot])):
            u = np.clip((np.arange(len(clip)) - first + 1) / (last - first + 1), 0.0, 1.0)
            ankles[:, foot, 1] += lift * np.sin(np.pi * u) ** 2
            toward = ankles[first, 1 - foot] - roots[first]
            share = _eased(times, (first - 0.12 * clip.fps) / clip.fps, 0.5 * (first + last) / clip.fps)
            share -= _eased(times, 0.5 * (first + last) / clip.fps, (last + 0.12 * clip.fps) / clip.fps)
            roots += SHIFT * share[:, None] * toward * np.array([1.0, 0.0, 1.0])
    return with_legs(replace(clip, roots=roots), ankles, feet)


def _air_share(on: Flags, times: Array, off: float, land: float) -> Array:
    """(F,) 0 to 1: how much of the way a foot has gone; all of it in its longest time in the air near off to land."""
    fps = 1.0 / (times[1] - times[0])
    air = [(a, b) for a, b in runs(np.logical_not(on)) if b / fps > off - 0.3 and a / fps < land + 0.3]
    if not air:
        return _eased(times, off, land)
    first, last = max(air, key=lambda run: run[1] - run[0])
    return _eased(times, max(first - 1, 0) / fps, min(last, len(on) - 1) / fps)


def _eased(times: Array, first: float, last: float) -> Array:
    """0 before ``first``, 1 after ``last``, minimum jerk between."""
    u = np.clip((times - first) / max(last - first, 1e-6), 0.0, 1.0)
    return np.asarray(10.0 * u**3 - 15.0 * u**4 + 6.0 * u**5, dtype=np.float64)


def marched(clip: Clip, flags: Flags, lift: float) -> Clip:
    """A walk whose free feet are raised by up to ``lift`` leg lengths more, the knees going up before the body."""
    ankles, feet = feet_of(clip)
    heading = headings(clip)
    ahead = np.stack([np.sin(heading), np.zeros(len(clip)), np.cos(heading)], axis=1)
    leg = leg_of(clip)
    for foot in range(2):
        for first, last in runs(np.logical_not(flags[:, foot])):
            u = (np.arange(first, last) - first + 0.5) / (last - first)
            whole = min(1.0, (last - first) / (0.25 * clip.fps))
            if first == 0 or last == len(clip):  # cut by the clip's end: as the other half would have it
                u = u * 0.5 + (0.5 if first == 0 else 0.0)
            up = whole * np.sin(np.pi * u) ** 2
            ankles[first:last, foot, 1] += lift * leg * up
            ankles[first:last, foot] += 0.25 * lift * leg * up[:, None] * ahead[first:last]
            level = rot.mul(rot.yaw(heading[first:last]), rot.axis_angle([1.0, 0.0, 0.0], 0.5 * up))
            feet[first:last, foot] = rot.slerp(feet[first:last, foot], level, 0.7 * up)
    return with_legs(clip, ankles, feet)


def slowed(clip: Clip, share: float) -> Clip:
    """A straight walking cycle that gets less far: ``share`` (0..1) of its way is taken out, 1 walks in place.

    The feet's way ahead and back under the body shrinks with it, so that planted feet stand as before; they come
    down flatter.
    """
    path = cycle_path(clip.roots[:, [0, 2]], np.unwrap(rot.heading(clip.rotations[:, 0])), clip.fps)
    keep = 1.0 - share
    ahead = np.stack([np.sin(path.directions), np.zeros(len(clip)), np.cos(path.directions)], axis=1)
    base = np.stack([path.places[:, 0], np.zeros(len(clip)), path.places[:, 1]], axis=1)
    ankles, feet = feet_of(clip)
    middle = float(np.mean([np.sum((ankles[:, foot] - base) * ahead, axis=1) for foot in range(2)]))
    back = share * (base - base[0])
    for foot in range(2):
        far = np.sum((ankles[:, foot] - base) * ahead, axis=1) - middle
        ankles[:, foot] -= back + share * far[:, None] * ahead
        level = rot.mul(rot.yaw(path.directions), rot.yaw(rot.heading(feet[:, foot]) - path.directions))
        feet[:, foot] = rot.slerp(level, feet[:, foot], np.full(len(clip), 0.35 + 0.65 * keep))
    flat = with_legs(replace(clip, roots=clip.roots - back), ankles, feet)
    return replace(flat, roots=flat.roots - np.array([0.0, floor_height(flat), 0.0]))


def spun(clip: Clip, flags: Flags, angle: float, off: float, land: float) -> Clip:
    """Turned on the spot by ``angle`` (rad to the left) on the way: the body from before ``off`` (s) to after
    ``land``, each foot while it is in the air."""
    times = np.arange(len(clip)) / clip.fps
    middle = clip.roots[0] * np.array([1.0, 0.0, 1.0])
    body = rot.yaw(angle * _eased(times, max(off - 0.08, 0.0), min(land + 0.08, clip.duration)))
    rotations = np.array(clip.rotations)
    rotations[:, 0] = rot.mul(body, rotations[:, 0])
    ankles, feet = feet_of(clip)
    for foot in range(2):
        own = rot.yaw(angle * _air_share(flags[:, foot], times, off, land))
        ankles[:, foot] = middle + rot.rotate(own, ankles[:, foot] - middle)
        feet[:, foot] = rot.mul(own, feet[:, foot])
    roots = middle + rot.rotate(body, clip.roots - middle)
    return with_legs(replace(clip, roots=roots, rotations=rotations), ankles, feet)


def closed(clip: Clip) -> Clip:
    """A loop: the last frame becomes the first one, turned about the vertical and carried along.

    What differs between the two is spread evenly over the clip, half at each end.
    """
    frames = len(clip)
    share = np.arange(frames)[:, None] / (frames - 1) - 0.5
    heading = np.unwrap(rot.heading(clip.rotations[:, 0]))
    free = np.array(clip.rotations)
    free[:, 0] = rot.mul(rot.yaw(-heading), free[:, 0])
    apart = rot.log(rot.mul(rot.inverse(free[-1]), free[0]))
    free = rot.mul(free, rot.exp(apart[None] * share[..., None]))
    free[:, 0] = rot.mul(rot.yaw(heading), free[:, 0])
    roots = np.array(clip.roots)
    roots[:, 1] += (roots[0, 1] - roots[-1, 1]) * share[:, 0]
    return replace(clip, roots=roots, rotations=free)


def there_and_back(clip: Clip) -> Clip:
    """Played to its end and back to its beginning: any calm stretch repeats that way."""
    return replace(
        clip,
        roots=np.concatenate([clip.roots, clip.roots[-2::-1]]),
        rotations=np.concatenate([clip.rotations, clip.rotations[-2::-1]]),
    )


def gap(clip: Clip, first: int, last: int) -> float:
    """rad: root mean square over the joints of how far frame ``last`` is from ``first``, headings apart."""
    a, b = np.array(clip.rotations[first]), np.array(clip.rotations[last])
    a[0] = rot.mul(rot.yaw(-rot.heading(a[0])), a[0])
    b[0] = rot.mul(rot.yaw(-rot.heading(b[0])), b[0])
    return float(np.sqrt(np.mean(np.sum(rot.log(rot.mul(rot.inverse(a), b)) ** 2, axis=-1))))


def repeated(clip: Clip, times: int = 2) -> Clip:
    """A closed clip several times over, each time from where the time before has led."""
    heading = rot.heading(clip.rotations[[0, -1], 0])
    turn = float((heading[1] - heading[0] + np.pi) % (2.0 * np.pi) - np.pi)
    roots, rotations = [clip.roots], [clip.rotations]
    for _ in range(times - 1):
        q = rot.yaw(turn * len(roots))
        start = roots[-1][-1]
        place = rot.rotate(q, clip.roots[1:] - clip.roots[0])
        roots.append(place + np.array([start[0], clip.roots[0, 1], start[2]]))
        turned = np.array(clip.rotations[1:])
        turned[:, 0] = rot.mul(q, turned[:, 0])
        rotations.append(turned)
    return replace(clip, roots=np.concatenate(roots), rotations=np.concatenate(rotations))
