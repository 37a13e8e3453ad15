"""Forward kinematics and full reconstruction of a point pose, for 1 and 1000 figures, beside numpy in one run.

python benchmarks/figure.py
"""

import timeit
from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from bunraku.figure.default import default_figure
from bunraku.figure.fk import fk_batch_into, fk_into
from bunraku.figure.pointpose import analyse, reconstruct_batch_into, reconstruct_into
from bunraku.figure.rig import rig_of

MANY = 1000


def best(function: Callable[[], object], number: int) -> float:
    """µs a call, the best of five."""
    function()
    return min(timeit.repeat(function, number=number, repeat=5)) / number * 1e6


def main() -> None:
    skeleton = default_figure()
    rig = rig_of(skeleton)
    joints = len(skeleton)
    root, rest = skeleton.rest_pose()
    turns = np.tile(rest, (MANY, 1, 1))
    roots = np.tile(root, (MANY, 1))
    positions, worlds = np.empty((MANY, joints, 3)), np.empty((MANY, joints, 4))

    def by_scipy() -> None:
        place, turn = [root], [Rotation.from_quat(rest[0])]
        for joint in range(1, joints):
            parent = int(skeleton.parents[joint])
            place.append(place[parent] + turn[parent].apply(np.array(skeleton.offsets[joint])))
            turn.append(turn[parent] * Rotation.from_quat(rest[joint]))

    one = best(lambda: fk_into(rig.parents, rig.offsets, root, turns[0], positions[0], worlds[0]), 5000)
    many = best(lambda: fk_batch_into(rig.parents, rig.offsets, roots, turns, positions, worlds), 20)
    slow = best(by_scipy, 20)
    pose, base = analyse(skeleton, root, rest)
    arrays = [pose.points, pose.turns, pose.swivels, pose.feet, np.ones(2)]
    stacks = [np.ascontiguousarray(np.broadcast_to(one, (MANY, *one.shape))) for one in arrays]
    full = best(lambda: reconstruct_into(rig, base, *arrays, turns[0], positions[0], worlds[0]), 5000)
    crowd = best(lambda: reconstruct_batch_into(rig, base, *stacks, turns, positions, worlds), 20)
    print(f"{joints} joints{'':20}{'1 figure, µs':>14}{f'{MANY} figures, ms':>20}")
    print(f"{'forward kinematics':30}{one:14.2f}{many / 1e3:20.2f}")
    print(f"{'reconstruction of a pose':30}{full:14.2f}{crowd / 1e3:20.2f}")
    print(f"{'the same kinematics by scipy':30}{slow:14.0f}   ({slow / one:.0f} times)")


if __name__ == "__main__":
    main()
