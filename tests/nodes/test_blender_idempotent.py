"""Commands are whole: hearing one again, late, often or after a restart changes nothing."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bunraku.motion.player import PACE
from bunraku.motion.synth import builtin_set
from bunraku.msgs import Action, Command, HandPose, Jump, Locomotion, PathPoint, Stand, Step, Turn, WalkGesture
from bunraku.nodes.blender.core import BlenderCore
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


# What was heard before, again, among other commands

_SET = builtin_set()


def _line(x: float, z: float, far: float) -> list[PathPoint]:
    return [PathPoint(x=x, z=z + far * k / 30, speed=1.3) for k in range(31)]


def _commands(id: int, x: float, z: float) -> dict[str, Command]:
    return {
        "walk": Locomotion(id=id, path=_line(x, z, 1.6), complete=True),
        "growing walk": Locomotion(id=id, path=_line(x, z, 1.2), complete=False),
        "walk to a heading": Locomotion(id=id, path=_line(x, z, 1.2), complete=True, heading=0.7),
        "gesture": WalkGesture(id=id, gait="sneak", path=[(x, z + 0.1 * k) for k in range(12)], complete=True),
        "stand": Stand(id=id, tilt=0.2, bend=0.1 * (id % 3)),
        "stand with a heading": Stand(id=id, heading=0.9 - 0.3 * id),
        "step": Step(id=id, goal=(x + 0.3, 0.0, z + 0.2)),
        "jump": Jump(id=id, goal=(x, 0.0, z + 0.5)),
        "jump up": Jump(id=id, height=0.3),
        "turn": Turn(id=id, heading=0.4 * id - 1.0),
        "hand": HandPose(id=id, weights=[0.4]),
    }


KINDS = list(_commands(1, 0.0, 0.0))


def _heard(said: list[tuple[float, Command]], seconds: float, restart: float | None = None) -> np.ndarray:
    """(F, 3) place of the figure that hears these commands at these times (s); saved and restored at ``restart``."""
    core = BlenderCore(_SET, pace=PACE)
    rows, left = [], sorted(said, key=lambda one: one[0])
    for frame in range(round(seconds * 60)):
        if restart is not None and frame == round(restart * 60):
            state = core.save()
            core = BlenderCore(_SET, pace=PACE)
            core.restore(state)
        while left and left[0][0] * 60 <= frame:
            core.hear(left.pop(0)[1])
        core.update(1 / 60)
        rows.append([core.player.place.x, core.player.place.z, core.player.place.heading, *core.player.posture])
    return np.array(rows)


def test_an_old_posture_does_not_stop_a_walk():
    walk = Locomotion(id=3, path=_line(0.0, 0.0, 3.9), complete=False)
    old = Stand(id=1, tilt=0.2)
    said = [(0.2, old), (1.0, walk)]
    once, again = _heard(said, 6.0), _heard([*said, (2.0, old)], 6.0)
    assert once[-1, 1] > 3.8
    assert np.abs(once - again).max() < 1e-9


def test_an_old_heading_is_not_turned_to_again():
    old = Stand(id=1, tilt=0.2, heading=1.0)
    said = [
        (0.2, old),
        (2.5, Turn(id=2, heading=0.0)),
        (5.0, Locomotion(id=3, path=_line(0.0, 0.0, 2.0), complete=True)),
    ]
    once = _heard(said, 9.0)
    for late in (4.5, 6.0, 8.0):
        assert np.abs(once - _heard([*said, (late, old)], 9.0)).max() < 1e-9


def test_a_walk_that_a_posture_stopped_is_not_taken_up_again():
    walk = Locomotion(id=1, path=_line(0.0, 0.0, 8.0), complete=False)
    said = [(0.1, walk), (2.0, Stand(id=2, bend=0.3))]
    once = _heard(said, 6.0)
    assert once[-1, 1] < 3.0
    for late in (2.2, 5.0):
        assert np.abs(once - _heard([*said, (late, walk)], 6.0)).max() < 1e-9


def test_a_walk_that_another_took_over_is_not_taken_up_again():
    walk = Locomotion(id=1, path=_line(0.0, 0.0, 8.0), complete=True)
    other = Locomotion(id=2, path=_line(0.0, 1.0, 2.0), complete=True)
    said = [(0.1, walk), (1.2, other)]
    once = _heard(said, 6.0)
    assert once[-1, 1] == pytest.approx(3.0, abs=0.03)
    for late in (1.5, 5.0):
        assert np.abs(once - _heard([*said, (late, walk)], 6.0)).max() < 1e-9


def test_a_path_whose_end_was_said_does_not_wait_for_more():
    short = Locomotion(id=1, path=_line(0.0, 0.0, 1.5), complete=False)
    whole = Locomotion(id=1, path=_line(0.0, 0.0, 1.5), complete=True)
    core = BlenderCore(_SET, pace=PACE)
    for command in (short, whole, short):
        core.hear(command)
        for _ in range(30):
            core.update(1 / 60)
    for _ in range(240):
        core.update(1 / 60)
    assert core.walk is None


def test_a_posture_that_changes_is_followed_and_its_heading_turned_to_once():
    core = BlenderCore(_SET, pace=PACE)
    for tilt in (0.1, 0.2, 0.3):
        core.hear(Stand(id=1, tilt=tilt, heading=0.8))
        for _ in range(90):
            core.update(1 / 60)
    assert core.player.posture[0] == pytest.approx(0.3)
    assert core.player.place.heading == pytest.approx(0.8, abs=0.04)
    core.hear(Stand(id=1, tilt=0.3, heading=-0.2))
    for _ in range(120):
        core.update(1 / 60)
    assert core.player.place.heading == pytest.approx(-0.2, abs=0.04)


def test_what_was_dropped_because_too_many_waited_stays_dropped():
    core = BlenderCore(_SET, pace=PACE)
    turns = [Turn(id=k, heading=0.1 * k) for k in range(1, 22)]
    for turn in turns:
        core.hear(turn)
    waiting = [one.id for one in core.waiting]
    for turn in turns:
        core.hear(turn)
    assert [one.id for one in core.waiting] == waiting


@st.composite
def _stories(draw: st.DrawFn) -> tuple[list[tuple[float, Command]], list[tuple[float, Command]], float]:
    """Commands of every kind one after another, any of them heard again later, and when it restarts."""
    said: list[tuple[float, Command]] = []
    now = 0.1
    for id in range(1, draw(st.integers(2, 4)) + 1):
        kind = draw(st.sampled_from(KINDS))
        said.append((now, _commands(id, draw(st.sampled_from([0.0, 0.4])), 0.6 * (id - 1))[kind]))
        now += draw(st.sampled_from([0.0, 0.2, 0.7, 1.6, 2.8]))
    echoes = []
    for _ in range(draw(st.integers(1, 3))):
        time, command = draw(st.sampled_from(said))
        echoes.append((time + draw(st.sampled_from([0.05, 0.4, 1.1, 2.4, 4.0, 6.5])), command))
    return said, echoes, draw(st.sampled_from([0.5, 1.3, 2.2, 4.0]))


@settings(max_examples=25, deadline=None)
@given(_stories())
def test_old_commands_heard_again_among_others_change_nothing(story):
    said, echoes, _ = story
    once, again = _heard(said, 11.0), _heard([*said, *echoes], 11.0)
    assert np.abs(once - again).max() < 1e-6


@settings(max_examples=8, deadline=None)
@given(_stories())
def test_old_commands_heard_again_after_a_restart_change_nothing(story):
    said, echoes, restart = story
    late = [(max(time, restart), command) for time, command in echoes]
    once, again = _heard(said, 11.0, restart), _heard([*said, *late], 11.0, restart)
    assert np.abs(once - again).max() < 1e-6


def test_a_figure_that_waits_for_a_path_stands_when_it_hears_it_again():
    walk = Locomotion(id=1, path=_line(0.0, 0.0, 1.2), complete=False)
    core = BlenderCore(_SET, pace=PACE)
    core.hear(walk)
    for _ in range(240):
        core.update(1 / 60)
    assert core.player.waiting
    core.hear(walk)
    assert core.player.waiting
