"""From one motion to the next: by inertialisation, or by the next motion's first posture as one more example.

*Inertialisation* keeps what the pose and its velocity differ by at the switch and lets it decay, so that both go on
without a step. *The (n+1)-th example* (Oshita 2005 6.2) blends the next motion's first posture into the end of the
running one, more and more; the pose is continuous, its velocity is not. docs/blending.md compares them.
"""

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel
from bunraku.figure.quat import exp, inv_mul, log, mul, mul_inv, normalize, slerp
from bunraku.figure.spring import spring_decay_into

Array = NDArray[np.float64]


@kernel
def difference_into(
    place_a: Array, rotations_a: Array, place_b: Array, rotations_b: Array, out: Array
) -> None:  # fmt: skip
    """What carries pose b to pose a: ``out`` (3 + 3 J) is the root's shift (m) and each joint's rotation vector."""
    q = np.empty(4)
    for k in range(3):
        out[k] = place_a[k] - place_b[k]
    for joint in range(rotations_a.shape[0]):
        mul_inv(rotations_a[joint], rotations_b[joint], q)
        log(q, out[3 + 3 * joint : 6 + 3 * joint])


@kernel
def inertialise(
    place_a: Array, rotations_a: Array, before_a: Array, turned_a: Array,
    place_b: Array, rotations_b: Array, after_b: Array, turned_b: Array,
    dt: float, offset: Array, velocity: Array,
) -> None:  # fmt: skip
    """Begin a transition from pose a, which came from (before_a, turned_a) dt ago, to pose b, which goes on to
    (after_b, turned_b) in dt: sets ``offset`` and ``velocity`` (3 + 3 J each)."""
    difference_into(place_a, rotations_a, place_b, rotations_b, offset)
    q, r, o = np.empty(4), np.empty(4), np.empty(3)
    for k in range(3):
        velocity[k] = (place_a[k] - before_a[k] - after_b[k] + place_b[k]) / max(dt, 1e-9)
    for joint in range(rotations_a.shape[0]):
        # What they differed by dt ago, pose b taken back as it will go on.
        mul_inv(turned_b[joint], rotations_b[joint], q)
        inv_mul(q, rotations_b[joint], r)
        mul_inv(turned_a[joint], r, q)
        log(q, o)
        apart = 0.0
        for k in range(3):
            velocity[3 + 3 * joint + k] = (offset[3 + 3 * joint + k] - o[k]) / max(dt, 1e-9)
            apart = max(apart, abs(offset[3 + 3 * joint + k] - o[k]))
        if apart > 1.0:  # on either side of half a turn: their difference says nothing
            for k in range(3):
                velocity[3 + 3 * joint + k] = 0.0


@kernel
def apply_offset(offset: Array, place: Array, rotations: Array) -> None:
    """Lay an offset (3 + 3 J) over a pose, in place."""
    q = np.empty(4)
    for k in range(3):
        place[k] += offset[k]
    for joint in range(rotations.shape[0]):
        exp(offset[3 + 3 * joint : 6 + 3 * joint], q)
        mul(q, rotations[joint], rotations[joint])
        normalize(rotations[joint], rotations[joint])


@kernel
def decay(offset: Array, velocity: Array, half_life: float, dt: float) -> None:
    """Let the offset die away over ``dt`` (s), in place."""
    spring_decay_into(offset, velocity, half_life, dt)


@kernel
def toward(share: float, goal_place: Array, goal_rotations: Array, place: Array, rotations: Array) -> None:
    """Blend a pose toward another one by ``share`` (0..1), in place."""
    for k in range(3):
        place[k] += share * (goal_place[k] - place[k])
    for joint in range(rotations.shape[0]):
        slerp(rotations[joint], goal_rotations[joint], share, rotations[joint])
