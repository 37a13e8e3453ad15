"""The controller's step beside mink solving the same targets, and a crowd of reconstructions; one run.

    python benchmarks/controller.py [--steps 2000] [--figures 1000]

Prints medians and 95 % marks in microseconds, and ratios. mink (`pip install 'bunraku[bench]'`) is a general
solver: five positions and two orientations with costs, a posture task, and QP steps with daqp.
"""

import argparse
import time
from collections.abc import Callable
from importlib.metadata import version

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.boxes import collision_pairs, deepest_overlap_batch_into
from bunraku.figure.default import default_figure
from bunraku.figure.pointpose import reconstruct_batch_into, rest_base
from bunraku.figure.rig import rig_of
from bunraku.figure.skeleton import Skeleton
from bunraku.nodes.controller.core import Stack

Array = NDArray[np.float64]


def timed(action: Callable[[int], object], count: int) -> tuple[float, float]:
    """Median and 95 % mark (µs) of ``action(n)``."""
    spent = []
    for n in range(count):
        begin = time.perf_counter()
        action(n)
        spent.append((time.perf_counter() - begin) * 1e6)
    return float(np.median(spent)), float(np.percentile(spent, 95))


def targets(n: int) -> dict[str, Array]:
    """Two hands, the pelvis and a foot on their way."""
    t = n / 60
    return {
        "left_hand": np.array([0.40 + 0.10 * np.sin(t), 1.25 + 0.15 * np.sin(1.3 * t), 0.35 + 0.1 * np.cos(t)]),
        "right_hand": np.array([-0.35, 1.10 + 0.15 * np.cos(1.1 * t), 0.30 + 0.1 * np.sin(t)]),
    }


def steps(count: int) -> float:
    """The step of one figure; returns the median of the common case."""
    stack = Stack(default_figure())

    def hold(wanted: dict[str, Array]) -> None:
        for part in ("left_hand", "right_hand"):
            stack.hold(part, wanted.get(part))

    def touched(n: int) -> None:
        hold(targets(n))
        stack.step(1 / 60)

    def beyond(n: int) -> None:
        hold({"left_hand": targets(n)["left_hand"] + [0.0, 0.0, 0.45]})
        stack.step(1 / 60)

    def alone(n: int) -> None:
        hold({})
        stack.step(1 / 60)

    print(f"controller step, one figure, {count} steps      median    95 %")
    common = 0.0
    for name, action in (("two hands held", touched), ("a hand beyond reach", beyond), ("nothing held", alone)):
        for n in range(60):
            action(n)
        median, high = timed(action, count)
        common = common or median
        print(f"  {name:42} {median:7.1f} {high:7.1f} µs")
    return common


def crowd(figures: int) -> None:
    """Reconstruction and one collision pass of many figures."""
    skeleton = default_figure()
    rig, base = rig_of(skeleton), rest_base(rig_of(skeleton))
    rng = np.random.default_rng(1)
    stack = Stack(skeleton)
    points = stack.state.points + rng.uniform(-0.05, 0.05, (figures, 5, 3))
    turns = np.repeat(stack.state.turns[None], figures, axis=0)
    swivels = np.repeat(stack.state.swivels[None], figures, axis=0)
    feet = np.repeat(stack.state.feet[None], figures, axis=0)
    level = np.ones((figures, 2))
    joints = len(skeleton)
    rotations_ls, depths = np.empty((figures, joints, 4)), np.empty(figures)
    positions_ws, rotations_ws = np.empty((figures, joints, 3)), np.empty((figures, joints, 4))
    pairs = collision_pairs(skeleton)

    def reconstruct(n: int) -> None:
        reconstruct_batch_into(
            rig, base, points, turns, swivels, feet, level, rotations_ls, positions_ws, rotations_ws
        )  # fmt: skip

    def collide(n: int) -> None:
        deepest_overlap_batch_into(
            pairs, skeleton.box_centers, skeleton.box_sizes, positions_ws, rotations_ws, depths
        )  # fmt: skip

    reconstruct(0)
    collide(0)
    a, b = timed(reconstruct, 30)[0], timed(collide, 30)[0]
    print(
        f"{figures} figures: reconstruction {a / 1e3:.2f} ms, "
        f"one pass over {len(pairs)} pairs of boxes {b / 1e3:.2f} ms,"
    )
    print(f"  together {(a + b) / 1e3:.2f} ms ({(a + b) / figures:.2f} µs a figure)")


def mjcf(skeleton: Skeleton) -> str:
    """The figure as a MuJoCo model: a free root and a ball at every joint."""
    children: dict[int, list[int]] = {}
    for joint, parent in enumerate(skeleton.parents):
        children.setdefault(int(parent), []).append(joint)

    def body(joint: int) -> str:
        x, y, z = skeleton.offsets[joint]
        kind = '<freejoint name="root"/>' if joint == 0 else f'<joint name="{skeleton.names[joint]}" type="ball"/>'
        inner = "".join(body(child) for child in children.get(joint, []))
        return (
            f'<body name="{skeleton.names[joint]}" pos="{x} {y} {z}">{kind}'
            f'<geom type="sphere" size="0.02" mass="{max(skeleton.masses[joint], 0.1)}"/>{inner}</body>'
        )

    return f'<mujoco><option gravity="0 0 0"/><worldbody>{body(0)}</worldbody></mujoco>'


def beside_mink(count: int, ours: float) -> None:
    """mink on the same hand targets, feet and pelvis held; one step a frame."""
    try:
        import mink
        import mujoco
    except ImportError:
        print("mink: not installed (pip install 'bunraku[bench]')")
        return
    skeleton = default_figure()
    model = mujoco.MjModel.from_xml_string(mjcf(skeleton))
    configuration = mink.Configuration(model)
    places = skeleton.rest_positions

    def task(name: str, position: float, orientation: float) -> object:
        made = mink.FrameTask(name, "body", position_cost=position, orientation_cost=orientation, lm_damping=1e-4)
        made.set_target(mink.SE3.from_translation(places[skeleton.names.index(name)]))
        return made

    hands = {part: task(part, 1.0, 0.0) for part in ("left_hand", "right_hand")}
    held = [task("left_foot", 1.0, 1.0), task("right_foot", 1.0, 1.0), task("hips", 0.1, 0.1)]
    held += [task("chest", 0.0, 0.1), task("head", 0.0, 0.1)]
    posture = mink.PostureTask(model, cost=1e-3)
    posture.set_target_from_configuration(configuration)
    everything = [*hands.values(), *held, posture]

    def step(n: int) -> None:
        for part, place in targets(n).items():
            hands[part].set_target(mink.SE3.from_translation(place))  # type: ignore[attr-defined]
        velocity = mink.solve_ik(configuration, everything, 1 / 60, "daqp", 1e-5)
        configuration.integrate_inplace(velocity, 1 / 60)

    for n in range(30):
        step(n)
    median, high = timed(step, min(count, 500))
    print(f"mink {version('mink')}, one step of the same targets    {median:7.1f} {high:7.1f} µs")
    print(f"ratio mink / controller: {median / ours:.1f} (mink has no balance, no self-collision, no steps here)")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=2000)
    parser.add_argument("--figures", type=int, default=1000)
    chosen = parser.parse_args()
    common = steps(chosen.steps)
    crowd(chosen.figures)
    beside_mink(chosen.steps, common)


if __name__ == "__main__":
    main()
