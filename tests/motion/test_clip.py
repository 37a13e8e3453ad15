"""Clips: sampling, mirroring, moving and poses that came at any times."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bunraku.figure.default import default_figure
from bunraku.motion import rotation as rot
from bunraku.motion.clip import Clip, ClipError, clip_from_poses, mirror_map


def a_clip(frames: int = 12, seed: int = 0, fps: float = 60.0, spread: float = 0.6) -> Clip:
    rng = np.random.default_rng(seed)
    skeleton = default_figure()
    turns = Rotation.from_rotvec(rng.normal(size=(frames * len(skeleton), 3)) * spread).as_quat()
    roots = rng.normal(size=(frames, 3)) + np.array([0.0, 1.0, 0.0])
    return Clip("a", skeleton, fps, roots, turns.reshape(frames, len(skeleton), 4))


def same_turn(a, b, tolerance=1e-9):
    return np.all(np.abs(np.abs(np.sum(a * b, axis=-1)) - 1.0) < tolerance)


def test_rotations_are_continuous_in_sign_and_arrays_cannot_be_written():
    clip = a_clip()
    flipped = np.array(clip.rotations)
    flipped[::2] *= -1.0
    again = Clip("b", clip.skeleton, 60.0, clip.roots, flipped)
    assert np.all(np.sum(again.rotations[1:] * again.rotations[:-1], axis=-1) >= 0.0)
    with pytest.raises(ValueError, match="read-only"):
        clip.roots[0, 0] = 1.0


@pytest.mark.parametrize(
    ("roots", "rotations", "fps"),
    [
        (np.zeros((0, 3)), np.zeros((0, 21, 4)), 60.0),
        (np.zeros((2, 3)), np.zeros((2, 20, 4)), 60.0),
        (np.zeros((2, 3)), np.zeros((3, 21, 4)), 60.0),
        (np.full((2, 3), np.nan), np.zeros((2, 21, 4)), 60.0),
        (np.zeros((2, 3)), np.zeros((2, 21, 4)), 0.0),
        (np.zeros((2, 3)), np.zeros((2, 21, 4)), np.nan),
    ],
)
def test_refuses_what_is_no_clip(roots, rotations, fps):
    with pytest.raises(ClipError, match="'x'"):
        Clip("x", default_figure(), fps, roots, rotations)


def test_world_agrees_with_the_kernel():
    from bunraku.figure.fk import fk

    clip = a_clip()
    positions, orientations = fk(clip.skeleton, clip.roots, clip.rotations)
    assert np.allclose(clip.world[0], positions, atol=1e-12)
    assert same_turn(clip.world[1], orientations)


@given(seed=st.integers(0, 1000))
@settings(max_examples=20, deadline=None)
def test_mirrored_reflects_every_joint_and_twice_is_the_same(seed):
    clip = a_clip(seed=seed)
    mirrored = clip.mirrored()
    reflected = clip.world[0][:, mirror_map(clip.skeleton)] * [-1.0, 1.0, 1.0]
    assert np.allclose(mirrored.world[0], reflected, atol=1e-9)
    assert np.allclose(mirrored.mirrored().roots, clip.roots)
    assert same_turn(mirrored.mirrored().rotations, clip.rotations)


@given(yaw=st.floats(-7.0, 7.0), x=st.floats(-5.0, 5.0), z=st.floats(-5.0, 5.0))
@settings(max_examples=30, deadline=None)
def test_moved_turns_and_shifts_every_joint(yaw, x, z):
    clip = a_clip(3)
    there = rot.rotate(rot.yaw(yaw), clip.world[0]) + np.array([x, 0.0, z])
    assert np.allclose(clip.moved(yaw, x, z).world[0], there, atol=1e-9)


def test_at_origin_faces_forward_above_zero():
    clip = a_clip(spread=0.2).moved(2.0, 3.0, -1.0).at_origin()
    assert abs(clip.headings[0]) < 1e-9
    assert np.allclose(clip.roots[0, [0, 2]], 0.0)


def test_sample_is_exact_at_frames_half_way_between_and_held_at_the_ends():
    clip = a_clip()
    root, turns = clip.sample(3 / 60.0)
    assert np.allclose(root, clip.roots[3])
    assert same_turn(turns, clip.rotations[3])
    root, turns = clip.sample(3.5 / 60.0)
    assert np.allclose(root, clip.roots[3:5].mean(axis=0))
    half = Rotation.from_quat(clip.rotations[3]).inv() * Rotation.from_quat(clip.rotations[4])
    expected = Rotation.from_quat(clip.rotations[3]) * Rotation.from_rotvec(0.5 * half.as_rotvec())
    assert same_turn(turns, expected.as_quat(), 1e-7)
    assert np.allclose(clip.sample(-1.0)[0], clip.roots[0])
    assert np.allclose(clip.sample(99.0)[0], clip.roots[-1])
    assert np.allclose(a_clip(1).sample(5.0)[0], a_clip(1).roots[0])


def test_resampled_keeps_the_duration_and_reversed_the_poses():
    clip = a_clip(61)
    half = clip.resampled(30.0)
    assert len(half) == 31
    assert half.duration == pytest.approx(clip.duration)
    assert np.allclose(half.roots, clip.roots[::2])
    assert np.allclose(clip.reversed().roots, clip.roots[::-1])
    assert len(clip.slice(5, 9)) == 4
    with pytest.raises(ClipError, match="leave nothing"):
        clip.slice(70, 80)


def test_poses_at_uneven_times_become_even_frames():
    clip = a_clip(31, spread=0.1)
    stamps = (np.arange(31) / 60.0 * 1e9).astype(np.int64) + 1_700_000_000_000_000_000
    shuffled = np.random.default_rng(3).permutation(31)
    back = clip_from_poses(clip.skeleton, stamps[shuffled], clip.roots[shuffled], clip.rotations[shuffled], 60.0)
    assert len(back) == 31
    assert np.allclose(back.roots, clip.roots, atol=1e-6)
    assert same_turn(back.rotations, clip.rotations, 1e-6)


def test_poses_with_a_pause_are_bridged_and_of_two_with_one_stamp_the_last_counts():
    skeleton = default_figure()
    rest = np.tile(skeleton.rest_pose()[1], (4, 1, 1))
    roots = np.array([[0.0, 1, 0], [9.0, 1, 0], [1.0, 1, 0], [2.0, 1, 0]])
    clip = clip_from_poses(skeleton, [0, 500_000_000, 500_000_000, 1_000_000_000], roots, rest, 4.0)
    assert np.allclose(clip.roots[:, 0], [0.0, 0.5, 1.0, 1.5, 2.0])
    single = clip_from_poses(skeleton, [7], roots[:1], rest[:1], 30.0)
    assert len(single) == 1
    with pytest.raises(ClipError, match="no poses"):
        clip_from_poses(skeleton, [], np.zeros((0, 3)), np.zeros((0, 21, 4)), 30.0)


@given(seed=st.integers(0, 10_000))
@settings(max_examples=50, deadline=None)
def test_array_rotations_agree_with_scipy(seed):
    rng = np.random.default_rng(seed)
    a, b = Rotation.random(8, random_state=rng), Rotation.random(8, random_state=rng)
    v = rng.normal(size=(8, 3))
    p, q = a.as_quat(), b.as_quat()
    assert same_turn(rot.mul(p, q), (a * b).as_quat())
    assert np.allclose(rot.rotate(p, v), a.apply(v))
    assert same_turn(rot.exp(rot.log(p)), p)
    assert same_turn(rot.from_euler("zxy", rot.to_zxy(p)), p, 1e-7)
    assert np.allclose(rot.rotate(rot.between(v, v[::-1]), v) / np.linalg.norm(v, axis=1)[:, None],
                       v[::-1] / np.linalg.norm(v[::-1], axis=1)[:, None], atol=1e-7)  # fmt: skip


@pytest.mark.parametrize("x", [np.pi / 2, -np.pi / 2])
def test_euler_angles_at_the_gimbal_still_give_the_rotation(x):
    angles = np.stack([np.linspace(-3, 3, 20), np.full(20, x), np.linspace(2, -2, 20)], -1)
    q = rot.from_euler("zxy", angles)
    assert same_turn(rot.from_euler("zxy", rot.to_zxy(q)), q, 1e-7)


def test_opposite_directions_turn_half_round():
    v = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.3, -0.2, 5.0]])
    assert np.allclose(rot.rotate(rot.between(v, -v), v), -v, atol=1e-9)
    assert np.allclose(rot.between(np.zeros(3), v[0]), [0, 0, 0, 1])
