"""Every measure of quality on cases worked out by hand."""

import numpy as np
import pytest

from bunraku.figure import metrics
from bunraku.figure.default import default_figure
from bunraku.figure.fk import fk

FIGURE = default_figure()
HZ = 60.0


def still(frames: int = 4) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    root, rotations = FIGURE.rest_pose()
    local = np.repeat(rotations[None], frames, axis=0)
    positions, orientations = fk(FIGURE, np.repeat(root[None], frames, axis=0), local)
    return positions, orientations, local


def spinning(joint: str, speeds: list[float]) -> np.ndarray:
    """Local rotations whose ``joint`` turns about X at these speeds (rad/s), one a frame."""
    _, rotations = FIGURE.rest_pose()
    angles = np.concatenate([[0.0], np.cumsum(speeds) / HZ])
    local = np.repeat(rotations[None], len(angles), axis=0)
    local[:, FIGURE.names.index(joint)] = np.stack(
        [np.sin(angles / 2), 0 * angles, 0 * angles, np.cos(angles / 2)], axis=-1
    )
    return local


def test_reach_error() -> None:
    assert metrics.reach_error(np.array([0.0, 3.0, 0.0]), np.array([4.0, 0.0, 0.0])) == pytest.approx(5.0)


def test_foot_skate_counts_planted_frames_only() -> None:
    feet = np.zeros((4, 1, 3))
    feet[:, 0, 0] = [0.0, 0.0, 0.06, 0.09]
    planted = np.array([[True], [True], [True], [False]])
    assert metrics.foot_skate(feet, planted, 1 / HZ) == pytest.approx((0.0 + 0.06 * HZ) / 2)


def test_foot_drift_starts_anew_with_every_stance() -> None:
    feet = np.zeros((5, 1, 3))
    feet[:, 0, 0] = [0.0, 0.01, 0.5, 0.5, 0.52]
    planted = np.array([[True], [True], [False], [True], [True]])
    assert metrics.foot_drift(feet, planted) == pytest.approx(0.02)


def test_floor_penetration() -> None:
    positions, orientations, _ = still(2)
    assert metrics.floor_penetration(FIGURE, positions, orientations).max() == pytest.approx(0.0, abs=1e-9)
    positions[1] -= [0.0, 0.03, 0.0]
    np.testing.assert_allclose(metrics.floor_penetration(FIGURE, positions, orientations), [0, 0.03], atol=1e-9)


def test_self_penetration() -> None:
    positions, orientations, _ = still(2)
    hand, chest = FIGURE.role("leftHand"), FIGURE.role("chest")
    positions[1, hand] = positions[1, chest]
    depths = metrics.self_penetration(FIGURE, positions, orientations)
    assert depths[0] == 0.0
    assert depths[1] > 0.01


def test_balance_margin() -> None:
    positions, orientations, _ = still(3)
    planted = np.array([[True, True], [True, False], [False, False]])
    margins = metrics.balance_margin(FIGURE, positions, orientations, planted)
    # Between the feet, 0.055 m behind the ankle is the heels' edge; the centre of mass is about 3 mm ahead.
    assert margins[0] == pytest.approx(0.058, abs=2e-3)
    assert margins[1] == pytest.approx(-(0.095 - 0.042), abs=1e-3)  # beside the left sole
    assert np.isnan(margins[2])


def test_limit_violation() -> None:
    local = spinning("left_lower_leg", [0.0, 0.0])
    local[1, FIGURE.names.index("left_lower_leg")] = [np.sin(np.radians(77.5)), 0, 0, np.cos(np.radians(77.5))]
    violation = np.degrees(metrics.limit_violation(FIGURE, local))
    np.testing.assert_allclose(violation, [0.0, 10.0, 0.0], atol=1e-6)


def test_joint_speeds_and_the_largest_step() -> None:
    local = spinning("left_lower_leg", [1.0, 1.0, 3.0])
    joint = FIGURE.names.index("left_lower_leg")
    np.testing.assert_allclose(metrics.joint_speeds(local, 1 / HZ)[:, joint], [1.0, 1.0, 3.0], rtol=1e-6)
    assert metrics.largest_velocity_step(local, 1 / HZ) == pytest.approx(2.0, rel=1e-6)


def test_joint_speed_does_not_depend_on_a_quaternions_sign() -> None:
    local = spinning("left_lower_leg", [1.0, 1.0])
    local[1] *= -1.0
    assert metrics.joint_speeds(local, 1 / HZ).max() == pytest.approx(1.0, rel=1e-6)


def test_mean_jerk_of_a_cubic() -> None:
    t = np.arange(6) / HZ
    positions = np.zeros((6, 1, 3))
    positions[:, 0, 0] = 2.0 * t**3  # third derivative 12
    assert metrics.mean_jerk(positions, 1 / HZ) == pytest.approx(12.0, rel=1e-6)


def test_path_error() -> None:
    path = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    points = np.array([[0.5, 0.2], [1.0, 0.5], [2.0, 2.0]])
    np.testing.assert_allclose(metrics.path_error(points, path), [0.2, 0.0, np.sqrt(2)])


def test_unexplained_ways_are_what_motion_and_finger_do_not_tell() -> None:
    motion = np.zeros((5, 2, 3))
    motion[:, :, 2] = 0.02 * np.arange(5)[:, None]  # all of it walks off
    motion[:, 1, 1] = [0.0, 0.03, 0.03, 0.0, 0.0]
    figure = motion.copy()
    led = np.zeros(4)
    assert metrics.unexplained_ways(figure, motion, led).max() <= 1e-12
    figure[2:, 1, 0] += 0.10
    found = metrics.unexplained_ways(figure, motion, led)
    assert np.unravel_index(found.argmax(), found.shape) == (1, 1)
    assert found.max() == pytest.approx(0.07)
    led[1] = 0.05
    assert metrics.unexplained_ways(figure, motion, led).max() == pytest.approx(0.02)
