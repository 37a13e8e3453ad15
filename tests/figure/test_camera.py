"""Rays and projection undo each other, and known views give known numbers."""

from math import pi, radians

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from bunraku.figure.camera import (
    Orbit,
    axes,
    default_camera,
    forward,
    letterbox,
    look_at,
    metres_per_height,
    on_plane,
    orbit_from,
    project,
    quat_from_axes,
    ray,
    to_camera,
    wrap,
)
from bunraku.msgs import Camera

share = st.floats(-0.5, 1.5)
coordinate = st.floats(-5.0, 5.0)
vector = st.tuples(coordinate, coordinate, coordinate)


@st.composite
def cameras(draw: st.DrawFn) -> Camera:
    eye, center = np.array(draw(vector)), np.array(draw(vector))
    assume(np.linalg.norm(eye - center) > 0.1)
    aspect = draw(st.floats(0.3, 3.0))
    if draw(st.booleans()):
        return look_at(eye, center, yfov=draw(st.floats(0.1, 2.5)), aspect=aspect)
    return look_at(eye, center, ortho_height=draw(st.floats(0.1, 10.0)), aspect=aspect)


@given(cameras(), share, share, st.floats(0.05, 20.0))
def test_a_point_on_a_ray_projects_to_the_ray_s_place(camera: Camera, x: float, y: float, t: float) -> None:
    origin, direction = ray(camera, x, y)
    assert np.linalg.norm(direction) == pytest.approx(1.0)
    assert project(camera, origin + t * direction) == pytest.approx([x, y], abs=1e-6)


@given(cameras())
def test_axes_are_a_right_handed_frame_and_level(camera: Camera) -> None:
    frame = np.stack(axes(camera))
    assert frame @ frame.T == pytest.approx(np.eye(3), abs=1e-9)
    assert np.linalg.det(frame) == pytest.approx(1.0)
    assert frame[0][1] == pytest.approx(0.0, abs=1e-9)  # the picture's horizontal is the world's
    assert quat_from_axes(*frame) == pytest.approx(camera.rotation, abs=1e-7) or quat_from_axes(
        *frame
    ) == pytest.approx(tuple(-c for c in camera.rotation), abs=1e-7)


def test_numbers_worked_out_by_hand() -> None:
    camera = look_at((0, 1, 4), (0, 1, 0), yfov=radians(90), aspect=2.0)
    assert forward(camera) == pytest.approx([0, 0, -1])
    # At 4 m a right angle spans 8 m of height and 16 m of width.
    assert metres_per_height(camera, (0, 1, 0)) == pytest.approx(8.0)
    assert project(camera, (4.0, 3.0, 0.0)) == pytest.approx([0.75, 0.25])
    assert to_camera(camera, (1.0, 2.0, 3.0)) == pytest.approx([1.0, 1.0, -1.0])
    assert np.isnan(project(camera, (0.0, 1.0, 5.0))).all()
    plane = look_at((0, 1, 4), (0, 1, 0), ortho_height=2.0, aspect=1.0)
    origin, direction = ray(plane, 1.0, 0.0)
    assert origin == pytest.approx([1.0, 2.0, 4.0])
    assert direction == pytest.approx([0, 0, -1])


def test_the_default_view_shows_the_whole_figure_from_the_front_left_quarter() -> None:
    camera = default_camera()
    # Crown, soles and the finger tips of the T-pose of a person of 1.75 m.
    places = project(camera, [(0, 1.75, 0), (0, 0, 0.15), (0.92, 1.44, 0), (-0.92, 1.44, 0), (0, 2.15, 0)])
    assert (places > 0.02).all()
    assert (places < 0.98).all()
    assert project(camera, (0, 0.9, 0)) == pytest.approx([0.5, 0.5])
    assert Orbit().eye == pytest.approx((2.40, 1.446, 3.90), abs=0.01)


@given(vector, vector)
def test_an_orbit_is_found_again_from_its_eye(eye: tuple[float, ...], center: tuple[float, ...]) -> None:
    assume(np.linalg.norm(np.subtract(eye, center)) > 0.1)
    assert orbit_from(eye, center, 0.6, 1.5).eye == pytest.approx(eye, abs=1e-6)


def test_a_plane_behind_or_along_the_ray_is_not_met() -> None:
    origin, direction = np.zeros(3), np.array([0.0, 0.0, -1.0])
    normal = np.array([0.0, 0.0, 1.0])
    assert on_plane(origin, direction, np.array([0.0, 0.0, -2.0]), normal) == pytest.approx(2.0)
    assert on_plane(origin, direction, np.array([0.0, 0.0, 2.0]), normal) is None
    assert on_plane(origin, direction, np.array([0.0, 1.0, 0.0]), np.array([0.0, 1.0, 0.0])) is None


def test_letterbox() -> None:
    assert letterbox(2.0, 400, 100) == (100, 0, 200, 100)
    assert letterbox(2.0, 100, 100) == (0, 25, 100, 50)
    with pytest.raises(ValueError, match="positive"):
        letterbox(1.0, 0, 10)


def test_looking_straight_down_has_minus_z_at_the_top() -> None:
    camera = look_at((0, 5, 0), (0, 0, 0), yfov=1.0, aspect=1.0)
    assert project(camera, (0, 0, -1))[1] < 0.5
    assert project(camera, (1, 0, 0))[0] > 0.5


def test_wrap() -> None:
    assert wrap(3 * pi / 2) == pytest.approx(-pi / 2)
    with pytest.raises(ValueError, match="looks at"):
        look_at((0, 0, 0), (0, 0, 0))
