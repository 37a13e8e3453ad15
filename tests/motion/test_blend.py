import numpy as np
import pytest

from bunraku.motion import rotation as rot
from bunraku.motion.blend import blend_table, pose_into, speeds_into, way_into
from bunraku.motion.synth import builtin_set
from bunraku.motion.timewarp import own_times


@pytest.fixture(scope="module")
def motion_set():
    return builtin_set()


def _angle(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(2.0 * np.arccos(np.clip(np.abs(np.sum(a * b, axis=-1)), 0.0, 1.0)).max()))


def _pose(table, weights, u):
    place, turns, signal = np.empty(3), np.empty((table.means.shape[0], 4)), np.empty(2)
    pose_into(table, weights, u, place, turns, signal)
    return place, turns, signal


@pytest.mark.parametrize("name", ["locomotion", "step_left", "jump_forward", "turn_right", "stand"])
def test_all_weight_on_one_example_gives_that_example_back(motion_set, name):
    module = motion_set.module(name)
    table = blend_table(module.examples)
    for n in (0, len(module.examples) - 1):
        example = module.examples[n]
        weights = np.eye(len(module.examples))[n]
        for u in (0.02, 0.2, 0.37, 0.5, 0.73, 0.96):
            place, turns, _ = _pose(table, weights, u)
            t = float(own_times(table.generic, example.keys, np.array([u]))[0])
            root, own = example.clip.sample(t)
            assert _angle(turns[1:], own[1:]) < 2.5
            assert place[1] == pytest.approx(root[1], abs=0.006)


def test_a_blend_of_equals_is_what_they_are(motion_set):
    examples = motion_set.module("locomotion").examples
    table = blend_table([examples[2], examples[2]])
    one = _pose(table, np.array([1.0, 0.0]), 0.3)
    for weights in ([0.5, 0.5], [1.7, -0.7]):
        place, turns, signal = _pose(table, np.array(weights), 0.3)
        np.testing.assert_allclose(place, one[0], atol=1e-9)
        np.testing.assert_allclose(turns, one[1], atol=1e-7)
        np.testing.assert_allclose(signal, one[2], atol=1e-9)


def test_a_cycle_closes_without_a_step(motion_set):
    table = blend_table(motion_set.module("locomotion").examples)
    weights = np.zeros(len(table.logs))
    weights[2], weights[3] = 0.5, 0.5
    before, after = _pose(table, weights, 0.999999), _pose(table, weights, 0.000001)
    assert _angle(before[1], after[1]) < 0.01
    np.testing.assert_allclose(before[0], after[0], atol=1e-4)


def test_rotations_have_unit_length_also_with_negative_weights(motion_set):
    table = blend_table(motion_set.module("stand").examples)
    weights = np.array([2.0, -0.5, -0.5, 0.4, -0.2, -0.1, -0.1])
    _, turns, _ = _pose(table, weights, 0.4)
    np.testing.assert_allclose(np.linalg.norm(turns, axis=1), 1.0, atol=1e-9)


def test_speeds_are_blended_as_the_weights_say(motion_set):
    module = motion_set.module("locomotion")
    table, out = blend_table(module.examples), np.empty(2)
    weights = np.zeros(len(module.examples))
    weights[1], weights[3] = 0.25, 0.75
    speeds_into(table, weights, out)
    assert out[0] == pytest.approx(0.25 * module.values[1, 0] + 0.75 * module.values[3, 0], abs=0.01)


def test_the_way_of_a_single_motion_is_the_examples_ways_weighted(motion_set):
    module = motion_set.module("step_left")
    table, out = blend_table(module.examples), np.empty(3)
    weights = np.zeros(len(module.examples))
    weights[1], weights[5] = 0.5, 0.5
    way_into(table, weights, 1.0, out)
    expected = sum(
        0.5 * module.values[k, 1] * np.array([np.sin(module.values[k, 0]), np.cos(module.values[k, 0])]) for k in (1, 5)
    )
    np.testing.assert_allclose(out[:2], expected, atol=0.003)
    assert abs(out[2]) < 0.01


def test_contacts_come_where_the_example_has_them(motion_set):
    examples = motion_set.module("locomotion").examples
    table = blend_table(examples)
    for n in (2, 5):  # a walk and a run
        weights = np.eye(len(examples))[n]
        example = examples[n]
        wrong = 0
        for u in np.linspace(0.0, 0.999, 200):
            _, _, signal = _pose(table, weights, u)
            t = float(own_times(table.generic, example.keys, np.array([u]))[0])
            own = example.contacts[min(round(t * example.clip.fps), len(example.contacts) - 1)]
            wrong += int(np.any((signal > 0) != own))
        assert wrong <= 12


def test_means_do_not_depend_on_signs(motion_set):
    examples = motion_set.module("turn_left").examples
    table = blend_table(examples)
    assert np.abs(np.linalg.norm(table.means, axis=1) - 1.0).max() < 1e-9
    assert np.abs(rot.log(table.means)).max() < np.pi
