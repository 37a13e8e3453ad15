"""How long a blended pose takes: twelve examples, root constraints, transition, foot lock and leg IK.

    python benchmarks/blend.py [--steps 3000]

Prints medians of one figure's step, in µs, of the compiled player; of the same blend in numpy, in the same run; and
of the parts. ozz-animation 0.16 (C++, SIMD) takes 8.4-10.6 µs a figure for sampling and blending 12 clips, local to
model space and two-bone IK on comparable hardware.
"""

import argparse
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from bunraku.motion import rotation as rot
from bunraku.motion.blend import pose_into
from bunraku.motion.clip import world
from bunraku.motion.constraint import path_of
from bunraku.motion.footlock import plant_into
from bunraku.motion.motionset import Module, MotionSet
from bunraku.motion.player import Player
from bunraku.motion.synth import builtin_set
from bunraku.motion.weights import weights_into

Array = NDArray[np.float64]


def median(work: Callable[[], None], steps: int) -> tuple[float, float]:
    """Median and 5 % quantile, µs."""
    for _ in range(20):
        work()
    taken = np.empty(steps)
    for k in range(steps):
        begin = time.perf_counter()
        work()
        taken[k] = time.perf_counter() - begin
    return float(np.median(taken)) * 1e6, float(np.quantile(taken, 0.05)) * 1e6


def twelve(motion_set: MotionSet) -> MotionSet:
    """The set with the first twelve examples of locomotion."""
    whole = motion_set.module("locomotion")
    modules = dict(motion_set.modules)
    modules["locomotion"] = Module(whole.name, whole.parameters, whole.examples[:12])
    return MotionSet(motion_set.name, motion_set.skeleton, modules)


def walker(motion_set: MotionSet) -> Callable[[], None]:
    """A figure that walks around a bend without end."""
    player = Player(motion_set)
    t = np.linspace(0.0, 40.0 * np.pi, 6000)
    player.follow(path_of(np.stack([3.0 - 3.0 * np.cos(t), 3.0 * np.sin(t)], -1), speeds=np.full(6000, 1.4)))

    def step() -> None:
        player.update(1.0 / 60.0)

    return step


def in_numpy(motion_set: MotionSet) -> Callable[[], None]:
    """Blend and forward kinematics alone, of the same tables, in numpy."""
    player = Player(motion_set)
    voice = player.voices["locomotion"]
    table, weights = voice.table, voice.weights([1.3, 0.1, 0.0, 0.05, 0.1])
    joints = len(motion_set.skeleton)

    def step() -> None:
        logs = np.einsum("i,ijk,j->k", weights, table.logs[:, 10:14], np.array([-0.06, 0.56, 0.56, -0.06]))
        local = rot.mul(table.means, rot.exp(logs.reshape(joints, 3)))
        world(motion_set.skeleton, np.zeros((1, 3)), local[None])

    return step


def parts(motion_set: MotionSet, steps: int) -> None:
    """What the kernels take by themselves."""
    player = Player(motion_set)
    voice = player.voices["locomotion"]
    out, asked = np.empty(len(voice.table.logs)), np.array([1.3, 0.1, 0.0, 0.05, 0.1])
    place, turns, signal = np.empty(3), np.empty((len(motion_set.skeleton), 4)), np.ones(2)
    weights = voice.weights(asked)
    parents, offsets = np.array(motion_set.skeleton.parents), np.array(motion_set.skeleton.offsets)
    positions, world_turns, heights = np.empty((len(parents), 3)), np.empty((len(parents), 4)), np.zeros(3)

    def plant() -> None:
        signal[:] = 1.0
        root = np.array([0.0, 0.9, 0.0])
        plant_into(player.feet, player.state, parents, offsets, root, turns, positions, world_turns, signal, heights,
                   False, True, 1.0 / 60.0)  # fmt: skip

    for name, work in (
        ("weights", lambda: weights_into(voice.weights.table, asked, out) and None),
        ("pose", lambda: pose_into(voice.table, weights, 0.37, place, turns, signal)),
        ("forward kinematics, foot lock, leg IK", plant),
    ):
        middle, low = median(work, steps)
        print(f"  {name:40} {middle:7.1f} µs   (5 %: {low:.1f})")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--steps", type=int, default=3000)
    steps = parser.parse_args().steps
    whole = builtin_set()
    small = twelve(whole)
    for name, work in (
        ("step, 12 examples", walker(small)),
        (f"step, all {len(whole.module('locomotion').examples)} examples", walker(whole)),
        ("numpy: blend of 12 and FK only", in_numpy(small)),
    ):
        middle, low = median(work, steps)
        print(f"{name:42} {middle:7.1f} µs   (5 %: {low:.1f})")
    parts(small, steps)


if __name__ == "__main__":
    main()
