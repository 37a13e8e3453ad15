"""The built-in motion set: every module and canonical clip, generated for any humanoid skeleton.

Nothing is downloaded and nothing is shipped: the set is made in a second or two at first use and kept in the user's
cache, in a file named by the sources that made it and the skeleton that it is for.
"""

import hashlib
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.default import default_figure
from bunraku.figure.skeleton import Skeleton
from bunraku.motion.motionset import MODULES, Example, Module, MotionSet, MotionSetError
from bunraku.motion.parameters import measured
from bunraku.motion.synth_body import Frame
from bunraku.motion.synth_curves import Gait, running, walking
from bunraku.motion.synth_gait import gait_clip
from bunraku.motion.synth_jump import jump
from bunraku.motion.synth_move import step, turn
from bunraku.motion.synth_stand import Made, stand

Array = NDArray[np.float64]

DEG = np.pi / 180.0

# (name, gait): speed m/s, turn rad/s, tilt and bend rad, duck 0..1
_LOCOMOTION: tuple[tuple[str, Gait], ...] = (
    ("in_place", walking(0.0)),
    ("stroll", walking(0.55)),
    ("walk", walking(1.25)),
    ("brisk_walk", walking(1.9)),
    ("jog", running(2.5)),
    ("run", running(3.8)),
    ("turn_in_place_left", walking(0.25, turn=100 * DEG, width=0.24)),
    ("turn_in_place_right", walking(0.25, turn=-100 * DEG, width=0.24)),
    ("walk_left", walking(1.1, turn=60 * DEG)),
    ("walk_right", walking(1.1, turn=-60 * DEG)),
    ("run_left", running(2.7, turn=50 * DEG)),
    ("run_right", running(2.7, turn=-50 * DEG)),
    ("walk_tilt_left", walking(1.0, tilt=22 * DEG)),
    ("walk_tilt_right", walking(1.0, tilt=-22 * DEG)),
    ("walk_bent", walking(0.95, bend=42 * DEG)),
    ("walk_stretched", walking(1.0, bend=-16 * DEG)),
    ("walk_ducked", walking(0.85, duck=0.80)),
    ("walk_ducked_left", walking(0.85, turn=55 * DEG, duck=0.80)),
    ("walk_ducked_right", walking(0.85, turn=-55 * DEG, duck=0.80)),
    ("run_bent", running(2.6, bend=20 * DEG)),
    ("run_ducked", running(2.6, duck=0.55, toe_pitch=48.0)),
    ("walk_crouched_left", walking(0.9, tilt=18 * DEG, bend=24 * DEG, duck=0.55)),
    ("walk_crouched_right", walking(0.9, tilt=-18 * DEG, bend=24 * DEG, duck=0.55)),
    ("run_tilt_left", running(2.6, tilt=14 * DEG)),
    ("run_tilt_right", running(2.6, tilt=-14 * DEG)),
    ("in_place_ducked", walking(0.0, duck=0.75)),
)

# tilt and bend rad, duck 0..1
_STAND: tuple[tuple[str, float, float, float], ...] = (
    ("upright", 0.0, 0.0, 0.0),
    ("tilt_left", 28 * DEG, 0.0, 0.0),
    ("tilt_right", -28 * DEG, 0.0, 0.0),
    ("bent", 0.0, 62 * DEG, 0.0),
    ("stretched", 0.0, -22 * DEG, 0.0),
    ("ducked", 0.0, 0.0, 1.0),
    ("ducked_bent", 0.0, 45 * DEG, 0.9),
)

_STEP_ANGLES = (0.0, 45.0, 90.0, 135.0, 180.0)
_STEP_NEAR, _STEP_FAR = 0.30, (0.70, 0.62, 0.55, 0.52, 0.50)
_TURNS = (8.0, 40.0, 70.0, 100.0, 130.0)
_JUMP_HEIGHTS = (0.20, 0.36, 0.52)
# module: directions (degrees, left positive), (distance, height) m
_JUMPS: dict[str, tuple[tuple[float, ...], tuple[tuple[float, float], ...]]] = {
    "jump_forward": ((-45.0, 0.0, 45.0), ((0.40, 0.26), (1.15, 0.36))),
    "jump_back": ((135.0, 180.0, 225.0), ((0.22, 0.22), (0.55, 0.28))),
    "jump_left": ((45.0, 90.0, 135.0), ((0.25, 0.22), (0.65, 0.28))),
    "jump_right": ((-45.0, -90.0, -135.0), ((0.25, 0.22), (0.65, 0.28))),
}

_SNEAK = walking(
    0.60, cycle=1.56, stance=0.60, duck=0.34, bend=26 * DEG, heel_pitch=6.0, toe_pitch=46.0, thigh=1.0, lift=26.0,
    clearance=0.05, bob=0.030, sway=0.070, arm=10.0, arm_mean=22.0, elbow=72.0, elbow_swing=14.0, abduct=16.0,
    pelvis_turn=4.0, chest_turn=3.0, width=0.11,
)  # fmt: skip
_MARCH = walking(
    1.10, cycle=1.08, stance=0.60, heel_pitch=2.0, toe_pitch=34.0, lift=46.0, clearance=0.05, bob=0.03, arm=36.0,
    arm_mean=4.0, elbow=13.0, elbow_swing=6.0, lean=-1.5, pelvis_turn=3.0, chest_turn=4.0, abduct=7.0,
)  # fmt: skip


def _example(made: Made, values: Array, cycle: bool) -> Example:
    clip, keys, contacts = made
    return Example(clip, values, keys, contacts, cycle, made=True)


def _measured(module: str, made: Made) -> Array:
    clip, _, contacts = made
    return measured(MODULES[module], clip, contacts, turns=module.startswith("turn"))


def _gaits(frame: Frame, rows: tuple[tuple[str, Gait], ...]) -> Iterator[tuple[str, Made]]:
    for name, gait in rows:
        yield name, gait_clip(name, frame, gait)


def _module(frame: Frame, name: str) -> Iterator[Made]:
    """The clips of one module."""
    if name == "locomotion":
        yield from (made for _, made in _gaits(frame, _LOCOMOTION))
    elif name == "stand":
        yield from (stand(label, frame, tilt, bend, duck) for label, tilt, bend, duck in _STAND)
    elif name in ("step_left", "step_right"):
        lead, sign = (0, 1.0) if name == "step_left" else (1, -1.0)
        yield step(f"{name}_in_place", frame, lead, 0.0, 0.0)
        for angle, far in zip(_STEP_ANGLES, _STEP_FAR, strict=True):
            for distance in (_STEP_NEAR, far):
                yield step(f"{name}_{angle:.0f}_{distance * 100:.0f}cm", frame, lead, sign * angle * DEG, distance)
    elif name in ("turn_left", "turn_right"):
        sign = 1.0 if name == "turn_left" else -1.0
        yield from (turn(f"{name}_{angle:.0f}", frame, sign * angle * DEG) for angle in _TURNS)
    elif name == "jump_up":
        yield from (jump(f"jump_up_{h * 100:.0f}cm", frame, 0.0, 0.0, h) for h in _JUMP_HEIGHTS)
    else:
        angles, reaches = _JUMPS[name]
        for angle in angles:
            for distance, height in reaches:
                yield jump(f"{name}_{angle:.0f}_{distance * 100:.0f}cm", frame, angle * DEG, distance, height)


def _canonical(frame: Frame) -> Iterator[tuple[str, Example]]:
    cycles = (
        ("walk", walking(1.30)),
        ("jog", running(2.45)),
        ("run", running(3.7)),
        ("sneak", _SNEAK),
        ("march", _MARCH),
    )
    for name, made in _gaits(frame, cycles):
        yield name, _example(made, _measured("locomotion", made), True)
    for name, distance, height in (("jump_up", 0.0, 0.42), ("short_jump", 0.60, 0.28), ("long_jump", 1.50, 0.40)):
        clip, keys, contacts = jump(name, frame, 0.0, distance, height)
        yield name, Example(clip, measured(("distance", "height"), clip, contacts), keys, contacts, False, made=True)


def generate(skeleton: Skeleton) -> MotionSet:
    """The whole built-in set for a humanoid skeleton, made anew.

    Raises:
        SkeletonError: the skeleton lacks a required role.
    """
    skeleton.check_humanoid()
    frame = Frame(skeleton)
    modules = {}
    for name, parameters in MODULES.items():
        cycle = name in ("locomotion", "stand")
        examples = tuple(_example(made, _measured(name, made), cycle) for made in _module(frame, name))
        modules[name] = Module(name, parameters, examples)
    return MotionSet("built-in", skeleton, modules, dict(_canonical(frame)))


def cache_file(skeleton: Skeleton) -> Path:
    """Where the built-in set of this skeleton is kept, by the sources that make it."""
    digest = hashlib.sha256()
    here = Path(__file__).parent
    for source in sorted(here.glob("synth*.py")):
        digest.update(source.read_bytes())
    for name in ("motionset.py", "parameters.py", "analysis.py", "ground.py", "leg.py", "clip.py"):
        digest.update((here / name).read_bytes())
    digest.update((here.parent / "figure" / "limits.py").read_bytes())
    digest.update(skeleton.hash.encode())
    for array in (skeleton.masses, skeleton.mass_centers, skeleton.box_centers, skeleton.box_sizes):
        digest.update(array.tobytes())
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return root / "bunraku" / "motion" / f"built-in-{digest.hexdigest()[:16]}.npz"


def builtin_set(skeleton: Skeleton | None = None) -> MotionSet:
    """The built-in set (of the default figure when none is given), from the cache or made now and kept there.

    A set from the cache and one just made are the same to the bit; a cache that cannot be written is not missed.
    """
    figure = default_figure() if skeleton is None else skeleton
    path = cache_file(figure)
    if path.is_file():
        try:
            return MotionSet.load(path)
        except MotionSetError:
            pass  # damaged: made again below
    data = generate(figure).to_bytes()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = path.with_name(f".{path.name}.{os.getpid()}.part")
        partial.write_bytes(data)
        partial.replace(path)
    except OSError:
        pass
    return MotionSet.from_bytes(data)
