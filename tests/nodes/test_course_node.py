"""The course node with fake publishers: poses in; the overlay, the record and requests out; and the overlay drawn."""

from typing import Any

import numpy as np
import pytest

from bunraku.figure.camera import Orbit, project
from bunraku.figure.default import default_figure
from bunraku.figure.wire import to_message
from bunraku.launch.course import VIEW
from bunraku.msgs import Contacts, Course, Overlay, Pose
from bunraku.nodes.course.node import CourseGame
from bunraku.nodes.course.stages import stages
from bunraku.nodes.renderer.overlay import draw
from bunraku.nodes.renderer.view import Layer
from bunraku.runtime.launch import LaunchError, LaunchFile
from bunraku.runtime.memory import MemoryStage

FIGURE = default_figure()


def stand(stage: MemoryStage, x: float, z: float, *, air: bool = False) -> None:
    """The figure at rest (a T-pose that faces +Z) at a place, for a frame."""
    rotations = np.tile([0.0, 0.0, 0.0, 1.0], (len(FIGURE), 1))
    root = np.array([x, float(FIGURE.rest_positions[0, 1]), z])
    contacts = Contacts(left_foot=not air, right_foot=not air)
    stage.publish("pose", Pose(skeleton=FIGURE.hash, root=root, rotations=rotations, contacts=contacts))
    stage.advance(1.0 / 60.0)


def started(**params: Any) -> tuple[MemoryStage, CourseGame]:
    stage = MemoryStage()
    node = stage.add(CourseGame, **params)
    stage.publish("skeleton", to_message(FIGURE))
    return stage, node


def news(stage: MemoryStage) -> Course:
    stage.advance(0.04)
    last = stage.last("course")
    assert isinstance(last, Course)
    return last


def words(stage: MemoryStage) -> list[str]:
    return [one.label for one in stage.last("overlay/course").primitives if one.kind == "text"]


def test_a_run_from_start_to_goal_is_timed_and_told() -> None:
    stage, _ = started(obstacles=False, again=0.0)
    stand(stage, 0.0, 0.0)
    assert news(stage).phase == "ready"
    for k in range(81):
        stand(stage, 0.0, 0.1 * k)
    last = news(stage)
    assert last.phase == "finished"
    # The clock starts at 0.2 m (the first beyond 0.10) and stops at 7.5 m, where the blue tile begins: 73 frames.
    assert last.seconds == pytest.approx(73 / 60.0, abs=0.035)
    assert (last.course_outs, last.collisions, last.runs) == (0, 0, 1)
    assert last.points == pytest.approx(last.seconds)
    assert "There!" in words(stage)
    assert {one.phase for one in stage.received("course")} == {"ready", "running", "finished"}


def test_leaving_the_course_and_coming_back_is_told() -> None:
    stage, _ = started(obstacles=False)
    for x, z in ((0.0, 0.0), (0.0, 0.3), (0.9, 0.5)):
        stand(stage, x, z)
    assert news(stage).off
    assert "off the course" in words(stage)
    for _ in range(25):
        stand(stage, 0.0, 0.5)
    last = news(stage)
    assert (last.off, last.course_outs) == (False, 1)
    assert last.points == pytest.approx(last.seconds + 2.0)


def test_a_figure_in_an_obstacles_way_is_hit() -> None:
    stage, node = started()
    for k in range(4):
        stand(stage, 0.0, 0.8 * k)
    for _ in range(240):  # the first pillar comes by within its 5.2 s
        stand(stage, 0.0, 2.6)
    last = news(stage)
    assert last.collisions >= 1
    x, _ = stages()[0].obstacles[0].at(node.game.since(node._time()))
    assert abs(x) <= 1.3


def test_reset_lays_the_start_where_the_figure_is_and_so_does_the_first_pose() -> None:
    stage, node = started(obstacles=False)
    stand(stage, 3.0, -2.0)
    assert node.place == pytest.approx((3.0, -2.0))
    for k in range(30):
        stand(stage, 3.0, -2.0 + 0.1 * k)
    assert news(stage).phase == "running"
    assert stage.ask(node, "reset")["ok"]
    last = news(stage)
    assert (last.phase, last.seconds, last.course_outs) == ("ready", 0.0, 0)
    assert node.place == pytest.approx((3.0, 0.9))
    first = stage.last("overlay/course").primitives[0]
    middle = np.array(first.points).mean(axis=0)
    assert middle == pytest.approx([3.0, 0.004, 0.9], abs=1e-6)


def test_a_figure_that_is_put_back_begins_again_there() -> None:
    stage, node = started(obstacles=False)
    for k in range(30):
        stand(stage, 0.0, 0.1 * k)
    assert news(stage).phase == "running"
    stand(stage, 0.0, 0.0)  # 2.9 m in a frame: a reset of the figure
    assert news(stage).phase == "ready"
    assert node.place == pytest.approx((0.0, 0.0))


def test_after_a_while_at_the_goal_the_next_run_lies_there() -> None:
    stage, node = started(obstacles=False, again=2.0)
    for k in range(11):
        stand(stage, 0.0, 0.8 * k)
    assert news(stage).phase == "finished"
    stage.advance(1.5)
    assert node.game.phase == "finished"
    stage.advance(0.6)
    assert node.game.phase == "ready"
    assert node.place == pytest.approx((0.0, 8.0))


def test_another_stage_begins_a_new_run() -> None:
    stage, node = started()
    stand(stage, 0.0, 0.0)
    stand(stage, 0.0, 0.9)
    node.set_param("stage_number", 4)
    last = news(stage)
    assert (last.stage, last.phase) == (4, "ready")
    assert sum(one.kind == "polygon" for one in stage.last("overlay/course").primitives) == 7


def test_a_restarted_node_goes_on_with_the_run() -> None:
    stage, node = started(obstacles=False)
    for x, z in ((1.0, 1.0), (1.0, 1.5), (1.9, 1.5)):
        stand(stage, x, z)
    before = news(stage)
    state = node.save()
    stage.remove(node)
    later = stage.add(CourseGame, state=state, obstacles=False)
    stage.publish("skeleton", to_message(FIGURE))
    stand(stage, 1.9, 1.6)
    after = news(stage)
    assert after.course_outs == before.course_outs == 1
    assert after.seconds > before.seconds
    assert later.place == pytest.approx((1.0, 1.0))


def test_a_pose_of_another_figure_is_left_out() -> None:
    stage, node = started()
    stage.publish("pose", Pose(skeleton="x", root=[0.0, 1.0, 5.0], rotations=np.array([[0.0, 0.0, 0.0, 1.0]])))
    assert not node.posed


@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_the_overlay_is_drawn_where_the_course_is(number: int) -> None:
    stage, _ = started(stage_number=number)
    stand(stage, 0.0, 0.0)
    stage.advance(0.1)
    said = stage.last("overlay/course")
    assert isinstance(said, Overlay)
    camera = Orbit(**VIEW).camera()  # type: ignore[arg-type]
    pixels = np.full((360, 640, 4), 230, dtype=np.uint8)
    pixels[..., 3] = 0
    draw(pixels, camera, [Layer(tuple(said.primitives), ())])
    tiles = [one for one in said.primitives if one.kind == "polygon"]
    for one, strong in ((tiles[0], 1), (tiles[1], 2)):  # green, then cyan: its red is weakest
        u, v = project(camera, np.array(one.points).mean(axis=0))
        red, green, blue = (int(value) for value in pixels[int(v * 360), int(u * 640), :3])
        assert red < 215, "a tile is painted"
        assert (green >= blue) if strong == 1 else (blue > red + 30)
    bars = [one for one in said.primitives if one.kind == "line" and one.label]
    assert {one.label for one in bars} == ({"jump"} if number != 3 else {"duck"})


def test_the_launch_file_lays_the_course_over_the_pens_stack() -> None:
    file = LaunchFile.find("course")
    specs = {one.kind: one for one in file.specs(file.parse(["stage:=3", "obstacles:=false", "device:=pad"]))}
    assert {"input_pad", "interpreter", "blender", "course", "web"} <= set(specs)
    assert specs["course"].params == {"stage_number": 3, "obstacles": False}
    assert specs["interpreter"].params["elevation"] == VIEW["elevation"]
    assert specs["blender"].remap == {"motion": "pose"}
    with pytest.raises(LaunchError, match="none of 1, 2, 3, 4"):
        file.specs(file.parse(["stage:=5"]))
