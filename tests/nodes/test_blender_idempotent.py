"""Commands are whole: hearing one again, late, often or after a restart changes nothing."""

import numpy as np
import pytest

from bunraku.msgs import Action, HandPose, Jump, Locomotion, PathPoint, Stand, Step, Turn, WalkGesture
from bunraku.nodes.blender.node import Blender
from bunraku.runtime.memory import MemoryStage

PATH = [PathPoint(x=0.3 * float(np.sin(z)), z=float(z), speed=1.3) for z in np.linspace(0.0, 3.0, 60)]
LINE = [(0.0, float(z)) for z in np.linspace(0.0, 2.5, 40)]

COMMANDS = {
    "locomotion": Locomotion(id=1, path=PATH, complete=True),
    "locomotion that ends in a heading": Locomotion(id=1, path=PATH, complete=True, heading=1.2),
    "locomotion of the legs": Locomotion(id=1, path=PATH, complete=True, body=["lower"]),
    "stand": Stand(id=1, tilt=0.1, bend=0.3, duck=0.2),
    "stand with a heading": Stand(id=1, heading=0.8),
    "step": Step(id=1, goal=(0.3, 0.0, 0.3)),
    "steps": Step(id=1, goal=(1.1, 0.0, 0.2), heading=0.6),
    "jump": Jump(id=1, goal=(0.0, 0.0, 0.8)),
    "jump up": Jump(id=1, height=0.4),
    "turn": Turn(id=1, heading=0.9),
    "turn about": Turn(id=1, heading=2.9),
    "walk gesture": WalkGesture(id=1, gait="sneak", path=LINE, complete=True),
    "jump gesture": WalkGesture(id=1, gait="long_jump", path=[(0.0, 0.0), (0.0, 1.3)], complete=True),
}


def _played(command, seconds: float, again: float = 0.0, restart: float = 0.0) -> np.ndarray:
    """(F, 7) root and its rotation, frame by frame; heard every ``again`` s, restarted at ``restart`` s."""
    stage = MemoryStage()
    node = stage.add(Blender)
    stage.advance(0.2)
    stage.publish("command", command)
    rows = []
    heard = 0.0
    for frame in range(round(seconds * 60)):
        if restart and frame == round(restart * 60):
            rows += _rows(stage)
            fresh = MemoryStage(now=stage.clock.now())
            node = fresh.add(Blender, state=node.save())
            stage = fresh
            stage.publish("command", command)
        if again and frame / 60 - heard >= again:
            heard = frame / 60
            stage.publish("command", command)
        stage.advance(1 / 60)
    assert node.core.player.free
    assert not node.core.waiting
    return np.array(rows + _rows(stage))


def _rows(stage: MemoryStage) -> list[np.ndarray]:
    return [np.concatenate([m.root, m.rotations[0]]).astype(float) for m in stage.received("motion")]


def _differ(a: np.ndarray, b: np.ndarray) -> tuple[float, float]:
    """Largest distance of the roots, m, and of their rotations, rad."""
    n = min(len(a), len(b))
    dots = np.abs(np.sum(a[:n, 3:] * b[:n, 3:], axis=1))
    return float(np.linalg.norm(a[:n, :3] - b[:n, :3], axis=1).max()), float(2 * np.arccos(np.clip(dots, 0, 1)).max())


@pytest.mark.parametrize("name", COMMANDS)
def test_hearing_a_command_again_changes_nothing(name):
    once = _played(COMMANDS[name], 7.0)
    often = _played(COMMANDS[name], 7.0, again=0.13)
    far, turned = _differ(once, often)
    assert far < 1e-5
    assert turned < 1e-3


@pytest.mark.parametrize("at", [0.05, 0.6, 1.3])
@pytest.mark.parametrize("name", COMMANDS)
def test_hearing_a_command_again_after_a_restart_changes_nothing(name, at):
    once = _played(COMMANDS[name], 7.0)
    later = _played(COMMANDS[name], 7.0, restart=at)
    # While it goes on from its saved state a passage may differ a little; the end is the same.
    assert np.linalg.norm(once[-1, :3] - later[-1, :3]) < 0.01
    assert 2 * np.arccos(min(abs(float(once[-1, 3:] @ later[-1, 3:])), 1.0)) < 0.03
    assert np.linalg.norm(np.diff(later[:, :3], axis=0), axis=1).max() < 0.09


def test_what_is_for_others_is_not_heard():
    stage = MemoryStage()
    node = stage.add(Blender)
    for command in (HandPose(id=1, weights=[0.1, 0.2]), Action(id=2, model="punch")):
        for _ in range(3):
            stage.publish("command", command)
    stage.advance(0.5)
    assert node.core.player.free
    assert not node.core.waiting
    assert node.core.done == []


def test_a_finished_command_stays_finished_after_many_others():
    stage = MemoryStage()
    node = stage.add(Blender)
    step = Step(id=1, goal=(0.0, 0.0, 0.4))
    stage.publish("command", step)
    stage.advance(3.0)
    for id in range(2, 12):
        stage.publish("command", Turn(id=id, heading=0.5 * (id % 2)))
        stage.advance(2.5)
    before = node.core.player.place
    stage.publish("command", step)
    stage.advance(2.0)
    after = node.core.player.place
    assert np.hypot(after.x - before.x, after.z - before.z) < 1e-6
