"""What a touch means: the nearest box on its ray, or one a finger's width beside it; a plane that a ray grazes."""

import numpy as np
import pytest
from table import FIGURE, Table

from bunraku.figure.camera import project, ray
from bunraku.nodes.interpreter.core import Scene
from bunraku.nodes.interpreter.drag import DragPlane, HeadingFrame
from bunraku.nodes.interpreter.picking import PartTable, pick, span
from bunraku.nodes.interpreter.rules import RULES


def scene_from(eye: tuple[float, float, float]) -> Scene:
    table = Table()
    table.look_from(eye)
    return Scene.of(FIGURE, table.camera)


def names(scene: Scene, origin: np.ndarray, way: np.ndarray, finger: float = RULES.finger) -> list[str]:
    return [hit.part.name for hit in pick(PartTable(FIGURE), scene, origin, way, finger)]


def test_the_nearest_box_on_the_ray_comes_first() -> None:
    scene = scene_from((4.2, 1.4, 0.0))
    middle = FIGURE.rest_positions[FIGURE.role("leftHand")] + FIGURE.box_centers[FIGURE.role("leftHand")]
    left, right = np.array([1.0, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0])  # through both arms and the trunk
    from_left = names(scene, middle + left, right)
    assert from_left[0] == "left_hand"
    assert from_left[-1] == "right_hand"
    assert "trunk" in from_left
    from_right = names(scene, middle * [-1, 1, 1] + right, left)
    assert from_right[0] == "right_hand"
    assert from_right[-1] == "left_hand"


@pytest.mark.parametrize(("widths", "grabbed"), [(0.7, ["left_hand"]), (1.4, [])])
def test_beside_a_box_a_finger_s_width_decides(widths: float, grabbed: list[str]) -> None:
    scene = scene_from((0.0, 1.4, 4.2))
    joint = FIGURE.role("leftHand")
    middle = FIGURE.rest_positions[joint] + FIGURE.box_centers[joint]
    right = np.array([1.0, 0.0, 0.0])
    edge = middle + float(FIGURE.box_sizes[joint][0]) * right
    beside = edge + widths * RULES.finger * span(scene.camera, edge) * right
    origin, way = ray(scene.camera, *(float(v) for v in project(scene.camera, beside)))
    assert names(scene, origin, way) == grabbed
    assert names(scene, origin, way, 0.0) == []


def test_a_plane_that_the_ray_grazes_is_chosen_anew_without_a_jump() -> None:
    scene = scene_from((0.0, 1.2, 4.2))
    frame = HeadingFrame(0.0, 0.0, 0.0)
    point = np.array([0.5, 1.2, 0.0])
    plane = DragPlane(scene, frame, point)
    assert plane.axis == 2
    places = []
    for angle in np.radians(
        np.linspace(0.0, 85.0, 171)
    ):  # the view goes round to the side, the finger stays on the point
        way = np.array([-np.sin(angle), 0.0, -np.cos(angle)])
        places.append(plane.crossing(frame, point - 4.0 * way, way))
    assert plane.axis == 0
    np.testing.assert_allclose(places, [point] * len(places), atol=1e-9)
    plane = DragPlane(scene, frame, point)
    for tilt, axis in ((0.31, 2), (0.29, 0)):
        way = np.array([-np.sqrt(1 - tilt * tilt), 0.0, -tilt])
        plane.crossing(frame, point - 4.0 * way, way)
        assert plane.axis == axis
