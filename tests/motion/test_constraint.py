import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bunraku.motion.constraint import Ground, path_of, smoothstep, wrapped


def test_a_straight_path_is_itself():
    path = path_of([[0, 0], [0, 1], [0, 3]], start=2.0, speeds=[1.0, 1.0, 1.0])
    assert path.end == pytest.approx(5.0)
    for s in (2.0, 3.3, 4.99, 5.0, 9.0):
        x, z, heading = path.at(s)
        assert (x, heading) == (pytest.approx(0.0), pytest.approx(0.0))
        assert z == pytest.approx(min(s, 5.0) - 2.0, abs=1e-9)
    assert path.style(3.0)[1] == pytest.approx(1.0)
    assert path.nearest(0.3, 1.5) == pytest.approx(3.5, abs=0.011)


def test_a_circle_has_its_tangent_and_bend():
    t = np.linspace(0, 1.5 * np.pi, 200)
    path = path_of(np.stack([2.0 - 2.0 * np.cos(t), 2.0 * np.sin(t)], -1))
    for s in (1.5, 4.0, 7.0):
        x, z, heading = path.at(s)
        assert np.hypot(x - 2.0, z) == pytest.approx(2.0, abs=0.005)
        assert heading == pytest.approx(s / 2.0, abs=0.01)
        assert path.style(s)[0] == pytest.approx(0.5, abs=0.02)


def test_arcs_keep_their_radius_and_corners_are_rounded():
    t = np.linspace(0.0, np.pi, 300)
    path = path_of(np.stack([1.0 - np.cos(t), np.sin(t)], -1))
    for s in (1.0, 1.5, 2.0):
        x, z, _ = path.at(s)
        assert np.hypot(x - 1.0, z) == pytest.approx(1.0, abs=0.001)
    corner = path_of([[0, 0], [0, 2], [2, 2]])
    x, z, heading = corner.at(2.0)
    assert np.hypot(x, z - 2.0) == pytest.approx(0.045, abs=0.01)
    assert heading == pytest.approx(np.pi / 4, abs=0.02)
    assert np.abs(corner.bends).max() < 2.6


@given(st.floats(0.3, 3.1), st.floats(0.5, 4.0), st.floats(0.5, 4.0))
@settings(max_examples=40, deadline=None)
def test_bends_limit_the_speed_and_are_braked_for(angle, turning, brake):
    path = path_of([[0, 0], [0, 2], [2 * np.sin(angle), 2 + 2 * np.cos(angle)]])
    limits = path.limits(turning, brake)
    assert (limits * np.abs(path.bends) <= turning * (1 + 1e-9)).all()
    squares = limits**2
    assert (squares[:-1] - squares[1:] <= 2.0 * brake * 0.02 * (1 + 1e-6) + 1e-9 * squares[:-1]).all()
    slowest = turning / np.abs(path.bends).max()
    assert limits.min() == pytest.approx(slowest)
    assert limits[path.point(0.5)] > slowest


def test_ends_stay_where_they_were_drawn():
    random = np.random.default_rng(1)
    drawn = np.cumsum(random.normal(0.02, 0.03, (150, 2)), axis=0)
    path = path_of(drawn)
    np.testing.assert_allclose(path.places[0], drawn[0], atol=1e-9)
    np.testing.assert_allclose(path.places[-1], drawn[-1], atol=1e-9)


@given(st.integers(0, 10**6), st.integers(10, 60))
@settings(max_examples=40, deadline=None)
def test_what_was_drawn_stays_while_the_path_grows(seed, more):
    random = np.random.default_rng(seed)
    heading = np.cumsum(random.normal(0.0, 0.08, 150))
    drawn = np.cumsum(0.03 * np.stack([np.sin(heading), np.cos(heading)], -1), axis=0)
    short, long = path_of(drawn[:-more]), path_of(drawn)
    for s in np.linspace(0.0, max(short.end - 1.1, 0.0), 9):
        np.testing.assert_allclose(short.at(float(s)), long.at(float(s)), atol=1e-6)


def test_styles_are_averaged_along_the_path_and_missing_speeds_stay_missing():
    points = np.stack([np.zeros(101), np.linspace(0, 4, 101)], -1)
    speeds = np.where(points[:, 1] < 2.0, np.nan, 2.0)
    path = path_of(points, speeds=speeds, postures=np.tile([0.1, 0.2, 0.3], (101, 1)))
    assert np.isnan(path.style(0.5)[1])
    assert path.style(3.5)[1] == pytest.approx(2.0)
    np.testing.assert_allclose(path.style(1.0)[2], [0.1, 0.2, 0.3])


@pytest.mark.parametrize("points", [[[1.0, 2.0]], [[1.0, 2.0]] * 5, [[1.0, 2.0], [1.0, 2.01]]])
def test_a_path_of_no_length_is_a_place(points):
    path = path_of(points, heading=0.7)
    x, z, heading = path.at(0.5)
    assert (x, z) == (pytest.approx(1.0), pytest.approx(2.0, abs=0.02))
    assert heading == pytest.approx(0.7)
    assert path.end == path.start


def test_an_empty_path_is_refused():
    with pytest.raises(ValueError, match="at least one point"):
        path_of(np.zeros((0, 2)))


def test_trimming_keeps_what_lies_before():
    path = path_of([[0, 0], [0, 3]])
    short = path.trimmed(1.01)
    assert short.end == pytest.approx(1.0, abs=0.02)
    assert short.at(0.5) == pytest.approx(path.at(0.5))
    assert path.trimmed(9.0).end == path.end


@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(-9, 9), st.floats(-5, 5), st.floats(-5, 5))
@settings(deadline=None)
def test_a_place_seen_from_a_frame_is_where_moving_there_leads(x, z, heading, left, ahead):
    frame = Ground(x, z, heading)
    there = frame.after(left, ahead, 1.0)
    assert frame.seen(there.x, there.z) == pytest.approx((left, ahead), abs=1e-9)
    assert wrapped(there.heading - heading) == pytest.approx(1.0)


def test_smoothstep_rests_at_both_ends():
    assert [smoothstep(t) for t in (-1.0, 0.0, 0.5, 1.0, 2.0)] == [0.0, 0.0, 0.5, 1.0, 1.0]
