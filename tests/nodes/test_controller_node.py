"""The controller node on a stage without processes."""

import numpy as np
import pytest

from bunraku.figure.default import default_figure
from bunraku.figure.fk import fk
from bunraku.figure.wire import from_message
from bunraku.msgs import Contacts, Motion, Step, Target
from bunraku.nodes.controller.node import Controller
from bunraku.runtime.memory import MemoryStage

FIGURE = default_figure()
LEFT_HAND = FIGURE.role("leftHand")


def places(pose) -> np.ndarray:
    positions, _ = fk(FIGURE, pose.root.astype(float), pose.rotations.astype(float))
    return positions


def test_it_says_its_skeleton_and_a_pose_at_once() -> None:
    stage = MemoryStage()
    stage.add(Controller)
    skeleton = from_message(stage.last("skeleton"))
    assert skeleton.hash == FIGURE.hash
    pose = stage.last("pose")
    assert pose.skeleton == FIGURE.hash
    assert pose.contacts.left_foot
    assert pose.contacts.right_foot


def test_it_ticks_by_itself_sixty_times_a_second() -> None:
    stage = MemoryStage()
    stage.add(Controller)
    stage.clear()
    stage.advance(1.0)
    assert 59 <= len(stage.received("pose")) <= 61
    assert stage.last("pose").origin is None


def test_a_target_is_answered_at_once_with_its_origin() -> None:
    stage = MemoryStage()
    stage.add(Controller)
    stage.advance(0.1)
    stage.clear()
    stage.publish("target", Target(left_hand=(0.4, 1.3, 0.4)), origin=123)
    assert [pose.origin for pose in stage.received("pose")] == [123]
    stage.advance(1.5)
    np.testing.assert_allclose(places(stage.last("pose"))[LEFT_HAND], (0.4, 1.3, 0.4), atol=1e-3)
    stage.publish("target", Target())
    stage.advance(5.0)
    assert places(stage.last("pose"))[LEFT_HAND][1] < 0.95


def test_messages_and_ticks_together_are_not_twice_as_many_poses() -> None:
    stage = MemoryStage()
    stage.add(Controller)
    stage.clear()
    for n in range(60):
        stage.publish("target", Target(left_hand=(0.4, 1.2 + 0.002 * n, 0.4)))
        stage.advance(1 / 60)
    assert len(stage.received("pose")) <= 62


def test_a_step_command_is_done_once_however_often_it_is_heard() -> None:
    stage = MemoryStage()
    stage.add(Controller)
    for _ in range(3):
        stage.publish("command", Step(id=7, goal=(0.5, 0.0, 0.0)))
    stage.advance(4.0)
    assert places(stage.last("pose"))[0, 0] == pytest.approx(0.5, abs=0.02)
    stage.publish("command", Step(id=8, goal=(0.0, 0.0, 0.0)))
    stage.advance(4.0)
    assert places(stage.last("pose"))[0, 0] == pytest.approx(0.0, abs=0.02)


def test_a_motion_is_shown_and_one_of_another_figure_is_refused_with_a_line() -> None:
    stage = MemoryStage()
    stage.add(Controller)
    root, rotations = FIGURE.rest_pose()
    root = root + np.array([0.0, 0.0, 1.0])
    stage.publish("motion", Motion(skeleton="other", root=root, rotations=rotations))
    stage.publish("motion", Motion(skeleton="other", root=root, rotations=rotations))
    lines = [log.text for log in stage.received("log/controller")]
    assert sum("skeleton other" in line for line in lines) == 1
    for _ in range(1200):
        stage.publish(
            "motion",
            Motion(
                skeleton=FIGURE.hash, root=root, rotations=rotations,
                contacts=Contacts(left_foot=True, right_foot=True),
            ),
        )  # fmt: skip
        stage.advance(1 / 60)
    pose = stage.last("pose")
    np.testing.assert_allclose(pose.root, root, atol=2e-3)
    np.testing.assert_allclose(np.abs((pose.rotations * rotations).sum(axis=1)), 1.0, atol=1e-3)


def test_parameters_act_while_it_runs() -> None:
    stage = MemoryStage()
    node = stage.add(Controller, relax_ends=0.1)
    stage.ask(node, "param.set", name="relax_ends", value=0.5)
    assert node.core.gains.relax_ends == 0.5
    assert not stage.ask(node, "param.set", name="relax_ends", value=-1)["ok"]


def test_reset_returns_to_the_start_pose() -> None:
    stage = MemoryStage()
    node = stage.add(Controller, x=0.5, yaw=1.0)
    before = stage.last("pose")
    stage.publish("target", Target(pelvis=(0.5, 0.7, 0.0), left_hand=(0.6, 1.5, 0.3)))
    stage.advance(1.0)
    stage.publish("target", Target())
    assert stage.ask(node, "reset")["ok"]
    after = stage.last("pose")
    np.testing.assert_allclose(after.root, before.root, atol=1e-3)
    np.testing.assert_allclose(np.abs((after.rotations * before.rotations).sum(axis=1)), 1.0, atol=1e-4)


def test_started_again_it_goes_on_from_where_it_was() -> None:
    stage = MemoryStage()
    node = stage.add(Controller)
    stage.publish("target", Target(left_hand=(0.4, 1.5, 0.6), pelvis=(0.02, 0.8, 0.0)))
    stage.advance(0.7)
    before = places(stage.last("pose"))
    state = node.save()
    assert len(state) < 10_000
    again = MemoryStage(now=stage.clock.now() + 1_500_000_000)
    again.add(Controller, state=state)
    again.advance(0.05)
    for pose in again.received("pose")[1:]:
        assert np.linalg.norm(places(pose) - before, axis=1).max() < 0.05
    damaged = MemoryStage()
    damaged.add(Controller, state=b"12345678" + b"x" * 80)
    assert damaged.last("pose") is not None
    assert any("starts anew" in log.text for log in damaged.received("log/controller"))


def test_the_overlay_is_said_when_it_changes_and_not_otherwise() -> None:
    stage = MemoryStage()
    node = stage.add(Controller)
    stage.advance(0.5)
    stage.clear()
    stage.advance(1.0)
    assert stage.received("overlay/controller") == []
    stage.publish("target", Target(pelvis=(0.05, 0.85, 0.0)))
    stage.advance(0.5)
    shown = stage.received("overlay/controller")
    assert 1 <= len(shown) <= 20
    kinds = [primitive.kind for primitive in shown[-1].primitives]
    assert kinds.count("polygon") == 3
    assert kinds.count("circle") == 1
    stage.ask(node, "param.set", name="show_overlay", value=False)
    stage.publish("target", Target(pelvis=(0.0, 0.80, 0.0)))
    stage.advance(0.5)
    assert stage.last("overlay/controller").primitives == []


def test_an_unknown_figure_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="no figure is named 'nobody'"):
        MemoryStage().add(Controller, figure="nobody")
