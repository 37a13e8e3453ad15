import numpy as np
import pytest

from bunraku.motion import rotation as rot
from bunraku.motion.player import Player
from bunraku.motion.synth import builtin_set
from bunraku.motion.transition import apply_offset, decay, difference_into, inertialise, toward


def _pose(seed: int, joints: int = 6, size: float = 0.5):
    random = np.random.default_rng(seed)
    return random.normal(size=3), rot.exp(random.normal(0.0, size, (joints, 3)))


def test_an_offset_carries_one_pose_to_the_other():
    (pa, ra), (pb, rb) = _pose(1), _pose(2)
    offset = np.empty(3 + 3 * len(ra))
    difference_into(pa, ra, pb, rb, offset)
    apply_offset(offset, pb, rb)
    np.testing.assert_allclose(pb, pa)
    np.testing.assert_allclose(np.abs(np.sum(rb * ra, axis=1)), 1.0, atol=1e-9)


def test_pose_and_velocity_go_on_without_a_step():
    dt, joints = 1e-5, 6
    (p0, r0), (q0, s0) = _pose(3), _pose(4)
    random = np.random.default_rng(5)
    spin, pace = random.normal(0.0, 1.0, (joints, 3)), random.normal(0.0, 1.0, 3)
    before_p, before_r = p0 - pace * dt, rot.mul(rot.exp(-spin * dt), r0)
    # The new motion stands still.
    offset, velocity = np.empty(3 + 3 * joints), np.empty(3 + 3 * joints)
    inertialise(p0, r0, before_p, before_r, q0, s0, q0, s0, dt, offset, velocity)
    decay(offset, velocity, 0.1, dt)
    place, turns = q0.copy(), s0.copy()
    apply_offset(offset, place, turns)
    np.testing.assert_allclose((place - p0) / dt, pace, atol=0.02)
    np.testing.assert_allclose(rot.log(rot.mul(turns, rot.inverse(r0))) / dt, spin, atol=0.02)
    decay(offset, velocity, 0.1, 1.5)
    place, turns = q0.copy(), s0.copy()
    apply_offset(offset, place, turns)
    np.testing.assert_allclose(place, q0, atol=1e-6)
    np.testing.assert_allclose(np.abs(np.sum(turns * s0, axis=1)), 1.0, atol=1e-9)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_toward_goes_the_share_of_the_way(share):
    (pa, ra), (pb, rb) = _pose(6), _pose(7)
    place, turns = pa.copy(), ra.copy()
    toward(share, pb, rb, place, turns)
    np.testing.assert_allclose(place, pa + share * (pb - pa))
    np.testing.assert_allclose(turns, rot.slerp(ra, rb, np.full(len(ra), share)), atol=1e-7)


@pytest.mark.parametrize(("kind", "least", "most"), [("example", 0.0, 2.0), ("inertialise", 5.0, 30.0)])
@pytest.mark.parametrize(("module", "values"), [("jump_forward", [0.2, 0.8]), ("step_left", [1.2, 0.4])])
def test_the_next_posture_is_there_when_a_motion_ends_or_comes_afterwards(module, values, kind, least, most):
    player = Player(builtin_set(), transition=kind)
    back = [player.skeleton.role(name) for name in ("spine", "chest", "neck")]
    player.stand(0.15, 0.3, 0.3)
    for _ in range(60):
        player.update(1 / 60)
    player.move(module, values)
    turns = [player.rotations[back]]
    while player.activity == "move":
        player.update(1 / 60)
        turns.append(player.rotations[back])
    for _ in range(60):
        player.update(1 / 60)
        turns.append(player.rotations[back])

    def apart(a, b):
        return np.degrees(np.linalg.norm(rot.log(rot.mul(turns[a], rot.inverse(turns[b]))), axis=-1).max())

    assert least <= apart(-61, -1) <= most
    assert max(apart(k + 1, k) for k in range(-66, -55)) < 6.0, "no step"
