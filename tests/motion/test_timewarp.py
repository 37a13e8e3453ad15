import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bunraku.motion.timewarp import (
    advance,
    generic_keys,
    own_times,
    seconds_between,
    seconds_per_unit,
    segment_of,
)

KEYS = [np.array([0.0, 0.3, 0.6, 1.0]), np.array([0.1, 0.9, 1.1, 2.1])]


def _spans() -> np.ndarray:
    return np.stack([np.diff(row) for row in KEYS])


def test_generic_keys_run_from_zero_to_one_and_lie_between_the_examples():
    generic = generic_keys(KEYS)
    assert generic[0] == 0.0
    assert generic[-1] == 1.0
    assert 0.3 < generic[1] < 0.4
    assert np.all(np.diff(generic) > 0)


def test_key_events_fall_together():
    generic = generic_keys(KEYS)
    for row in KEYS:
        np.testing.assert_allclose(own_times(generic, row, generic), row)


@given(st.floats(0.0, 1.0), st.floats(0.0, 0.999), st.floats(1e-4, 0.1))
@settings(max_examples=100, deadline=None)
def test_time_goes_on_at_the_blended_rate(weight, u, dt):
    generic, spans = generic_keys(KEYS), _spans()
    weights = np.array([weight, 1.0 - weight])
    later = advance(generic, spans, weights, u, dt)
    assert later > u
    if later <= 1.0:
        assert seconds_between(generic, spans, weights, u, later) == pytest.approx(dt, rel=1e-9)
    # One step is the same as two halves, as long as the motion lasts.
    half = advance(generic, spans, weights, u, 0.5 * dt)
    assert advance(generic, spans, weights, half, 0.5 * dt) == pytest.approx(later, abs=1e-12)


@pytest.mark.parametrize("example", [0, 1])
def test_one_example_alone_keeps_its_own_time(example):
    generic, spans = generic_keys(KEYS), _spans()
    weights = np.eye(2)[example]
    u, t, row = 0.0, float(KEYS[example][0]), KEYS[example]
    while u < 0.98:
        u = advance(generic, spans, weights, u, 0.01)
        t += 0.01
        assert float(own_times(generic, row, np.array([u]))[0]) == pytest.approx(t, abs=1e-9)


def test_negative_weights_never_stop_or_turn_time():
    generic, spans = generic_keys(KEYS), _spans()
    for weights in (np.array([3.0, -2.0]), np.array([-5.0, 6.0])):
        for segment in range(3):
            rate = seconds_per_unit(generic, spans, weights, segment)
            assert 0.0 < rate < 20.0


def test_at_a_key_the_segment_that_begins_there_counts():
    generic = np.array([0.0, 0.25, 0.5, 1.0])
    assert [segment_of(generic, u) for u in (0.0, 0.25, 0.4999, 0.5, 1.0)] == [0, 1, 1, 2, 2]
