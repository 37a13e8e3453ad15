import numpy as np
import pytest

from bunraku.motion.ground import Heightfield
from bunraku.motion.rotation import heading as heading_of
from bunraku.msgs import Jump, Locomotion, Motion, PathPoint, Pose, Stand, Step, Turn, WalkGesture
from bunraku.nodes.blender.node import Blender, ground_of
from bunraku.runtime.memory import MemoryStage


def _stage(**params):
    stage = MemoryStage()
    return stage, stage.add(Blender, **params)


def _line(length: float, count: int = 20, **fields) -> list[PathPoint]:
    return [PathPoint(x=0.0, z=float(z), **fields) for z in np.linspace(0.0, length, count)]


def _heading(motion: Motion) -> float:
    return float(heading_of(np.asarray(motion.rotations[0], dtype=float)))


def _run(stage: MemoryStage, node: Blender, seconds: float) -> list[Motion]:
    """Motion until the figure stands with nothing to do, at most ``seconds``."""
    before = len(stage.received("motion"))
    core = node.core
    for _ in range(int(seconds * 60)):
        stage.advance(1 / 60)
        if core.player.free and core.walk is None and not core.waiting:
            break
    stage.advance(0.5)
    return stage.received("motion")[before:]


def _steps(motions: list[Motion]) -> np.ndarray:
    roots = np.array([m.root for m in motions], dtype=float)
    return np.linalg.norm(np.diff(roots, axis=0), axis=1)


def test_it_stands_and_breathes_sixty_times_a_second():
    stage, _ = _stage()
    stage.advance(1.0)
    motions = stage.received("motion")
    assert 59 <= len(motions) <= 61
    assert all(m.contacts.left_foot and m.contacts.right_foot for m in motions[5:])
    assert np.ptp([m.root[1] for m in motions]) > 1e-4
    assert stage.last("skeleton") is None


def test_where_it_says_the_pose_it_says_the_skeleton():
    stage = MemoryStage()
    stage.add(Blender, remap={"motion": "pose"}, skeleton=True)
    stage.advance(0.1)
    message = stage.last("skeleton")
    assert stage.last("pose").skeleton
    assert message.roles["hips"] == 0


def test_it_walks_to_the_end_of_a_path():
    stage, node = _stage()
    stage.publish("command", Locomotion(id=1, path=_line(3.0, speed=1.2), complete=True))
    motions = _run(stage, node, 8.0)
    assert abs(motions[-1].root[2] - 3.0) < 0.03
    assert abs(motions[-1].root[0]) < 0.02
    assert _steps(motions).max() < 0.04
    assert any(not m.contacts.left_foot for m in motions)
    assert not any(not m.contacts.left_foot and not m.contacts.right_foot for m in motions)


def test_a_path_may_grow_and_is_walked_once():
    stage, node = _stage()
    for length in np.arange(0.4, 3.01, 0.1):
        stage.publish("command", Locomotion(id=5, path=_line(float(length)), complete=bool(length > 2.95)))
        stage.advance(0.1)
    _run(stage, node, 8.0)
    assert abs(stage.last("motion").root[2] - 3.0) < 0.05
    before = stage.last("motion").root.copy()
    stage.publish("command", Locomotion(id=5, path=_line(3.0), complete=True))
    stage.advance(1.5)
    assert np.abs(stage.last("motion").root - before).max() < 0.03
    assert node.core.player.free


def test_a_path_cut_off_at_its_beginning_goes_on():
    stage, node = _stage()
    whole = _line(4.0, 81)
    stage.publish("command", Locomotion(id=5, path=whole, complete=False))
    stage.advance(2.0)
    rest = [p for p in whole if p.z >= 1.0]
    stage.publish("command", Locomotion(id=5, path=rest, start=rest[0].z, complete=True))
    motions = _run(stage, node, 8.0)
    assert _steps(motions).max() < 0.04
    assert abs(motions[-1].root[2] - 4.0) < 0.03


def test_it_waits_where_an_unfinished_path_stops_and_resumes():
    stage, node = _stage()
    stage.publish("command", Locomotion(id=5, path=_line(1.2), complete=False))
    stage.advance(5.0)
    assert node.core.player.free
    assert node.core.walk is not None
    stage.publish("command", Locomotion(id=5, path=_line(2.4), complete=True))
    _run(stage, node, 6.0)
    assert abs(stage.last("motion").root[2] - 2.4) < 0.03


def test_it_turns_before_a_path_that_leads_back():
    stage, node = _stage()
    path = [PathPoint(x=0.0, z=-float(z)) for z in np.linspace(0.0, 2.0, 20)]
    stage.publish("command", Locomotion(id=2, path=path, complete=True))
    motions = _run(stage, node, 10.0)
    assert abs(motions[-1].root[2] + 2.0) < 0.03
    assert abs(abs(_heading(motions[-1])) - np.pi) < 0.1
    assert max(m.root[2] for m in motions) < 0.15


@pytest.mark.parametrize("goal", [(0.45, 0.0), (-0.3, 0.3), (0.0, -0.4), (0.1, 0.6), (1.2, 0.2)])
def test_a_step_ends_at_its_goal_without_turning(goal):
    stage, node = _stage()
    x, z = goal
    stage.publish("command", Step(id=1, goal=(x, 0.0, z)))
    motions = _run(stage, node, 8.0)
    assert np.hypot(motions[-1].root[0] - x, motions[-1].root[2] - z) < 0.02
    assert abs(_heading(motions[-1])) < 0.05
    assert _steps(motions).max() < 0.05
    # The same one again: nothing.
    stage.publish("command", Step(id=1, goal=(x + 1.0, 0.0, z)))
    assert node.core.player.free


@pytest.mark.parametrize("angle", [0.5, -1.2, 3.0, -2.5])
def test_a_turn_ends_at_its_heading(angle):
    stage, node = _stage()
    stage.publish("command", Turn(id=1, heading=angle))
    motions = _run(stage, node, 8.0)
    assert abs((_heading(motions[-1]) - angle + np.pi) % (2 * np.pi) - np.pi) < 0.04
    assert np.hypot(motions[-1].root[0], motions[-1].root[2]) < 0.03


@pytest.mark.parametrize("goal", [(0.0, 0.9), (0.5, 0.1), (-0.4, -0.1), (0.1, -0.4)])
def test_a_jump_lands_at_its_goal(goal):
    stage, node = _stage()
    x, z = goal
    stage.publish("command", Jump(id=1, goal=(x, 0.0, z)))
    motions = _run(stage, node, 8.0)
    assert np.hypot(motions[-1].root[0] - x, motions[-1].root[2] - z) < 0.02
    assert any(not m.contacts.left_foot and not m.contacts.right_foot for m in motions)


def test_a_jump_on_the_spot_has_its_height():
    stage, node = _stage()
    stage.advance(0.5)
    stand = float(stage.last("motion").root[1])
    stage.publish("command", Jump(id=1, height=0.4))
    motions = _run(stage, node, 5.0)
    assert max(float(m.root[1]) for m in motions) - stand == pytest.approx(0.4, abs=0.03)


def test_postures_are_taken_while_standing():
    stage, _ = _stage()
    stage.advance(1.0)
    upright = float(stage.last("motion").root[1])
    stage.publish("command", Stand(id=1, duck=0.8))
    stage.advance(1.5)
    assert float(stage.last("motion").root[1]) < upright - 0.2
    stage.publish("command", Stand(id=1))
    stage.advance(1.5)
    assert float(stage.last("motion").root[1]) == pytest.approx(upright, abs=0.01)


def test_commands_wait_for_their_turn():
    stage, node = _stage()
    stage.publish("command", Step(id=1, goal=(0.0, 0.0, 0.4)))
    stage.advance(0.3)
    stage.publish("command", Turn(id=2, heading=1.0))
    stage.publish("command", Jump(id=3, height=0.3))
    stage.publish("command", Jump(id=3, height=0.3))
    assert len(node.core.waiting) == 2
    motions = _run(stage, node, 12.0)
    assert abs(motions[-1].root[2] - 0.4) < 0.03
    assert abs(_heading(motions[-1]) - 1.0) < 0.05
    assert node.core.done == [1, 2, 3]


def test_standing_ends_a_walk():
    stage, node = _stage()
    stage.publish("command", Locomotion(id=1, path=_line(20.0), complete=False))
    stage.advance(2.5)
    stage.publish("command", Stand(id=2))
    motions = _run(stage, node, 5.0)
    assert node.core.player.free
    assert node.core.walk is None
    assert motions[-1].root[2] < 4.5
    assert _steps(motions).max() < 0.04


@pytest.mark.parametrize("gait", ["walk", "jog", "run", "sneak", "march"])
def test_finger_walks_are_walked(gait):
    stage, node = _stage()
    path = [(0.0, float(z)) for z in np.linspace(0.0, 4.0, 30)]
    stage.publish("command", WalkGesture(id=1, gait=gait, path=path, complete=True))
    motions = _run(stage, node, 12.0)
    assert abs(motions[-1].root[2] - 4.0) < 0.03


@pytest.mark.parametrize(("gait", "far"), [("jump_up", 0.0), ("short_jump", 0.7), ("long_jump", 1.4)])
def test_finger_jumps_are_jumped(gait, far):
    stage, node = _stage()
    stage.publish("command", WalkGesture(id=1, gait=gait, path=[(0.0, 0.0), (0.0, far)], complete=True))
    motions = _run(stage, node, 8.0)
    assert abs(motions[-1].root[2] - far) < 0.02


def test_a_walk_of_the_legs_leaves_the_arms_hanging():
    stage, node = _stage()
    stage.publish("command", Locomotion(id=1, path=_line(3.0, speed=1.6), complete=True, body=["lower"]))
    stage.advance(2.0)
    arm = node.core.skeleton.role("leftUpperArm")
    turns = np.array([m.rotations[arm] for m in stage.received("motion")[-40:]])
    assert np.degrees(2 * np.arccos(np.clip(np.abs(turns @ turns[0]), 0, 1))).max() < 3.0
    stage.publish("command", Locomotion(id=2, path=_line(3.0), complete=True, body=["left_arm"]))
    assert "moves no leg" in stage.last("log/blender").text


def test_it_takes_up_from_where_it_was():
    stage, node = _stage()
    stage.publish("command", Locomotion(id=1, path=_line(5.0), complete=True))
    stage.advance(2.0)
    state, before = node.save(), stage.last("motion")
    assert len(state) < 80_000
    again = MemoryStage(now=stage.clock.now())
    other = again.add(Blender, state=state)
    again.advance(1 / 30)
    after = again.received("motion")[0]
    assert np.linalg.norm(after.root - before.root) < 0.05
    assert np.abs(np.abs(np.sum(after.rotations * before.rotations, axis=1)) - 1.0).max() < 0.01
    motions = _run(again, other, 8.0)
    assert abs(motions[-1].root[2] - 5.0) < 0.03
    again.publish("command", Locomotion(id=1, path=_line(5.0), complete=True))
    again.advance(0.5)
    assert other.core.player.free


@pytest.mark.parametrize("seconds", [0.3, 0.9, 1.1, 1.6])
def test_it_takes_up_in_the_middle_of_a_jump(seconds):
    stage, node = _stage()
    stage.publish("command", Jump(id=1, goal=(0.0, 0.0, 0.8)))
    stage.publish("command", Turn(id=2, heading=1.0))
    stage.advance(seconds)
    before = stage.last("motion")
    again = MemoryStage(now=stage.clock.now())
    other = again.add(Blender, state=node.save())
    again.advance(1 / 30)
    assert np.linalg.norm(again.received("motion")[0].root - before.root) < 0.10
    motions = _run(again, other, 8.0)
    assert abs(motions[-1].root[2] - 0.8) < 0.02
    assert abs(_heading(motions[-1]) - 1.0) < 0.05


def test_a_state_that_does_not_fit_is_no_crash():
    stage = MemoryStage()
    node = stage.add(Blender, state=b"\x81\xa1a\x01")
    stage.advance(0.1)
    assert "does not take up" in stage.last("log/blender").text
    assert node.core.player.free


def test_without_a_saved_state_it_goes_on_from_the_pose():
    other = MemoryStage()
    node = other.add(Blender)
    pose = Pose(skeleton=node.core.skeleton.hash, root=np.array([1.0, 0.9, 2.0]),
                rotations=np.tile([0.0, 0.0, 0.0, 1.0], (len(node.core.skeleton), 1)))  # fmt: skip
    other.publish("pose", pose)
    other.advance(0.1)
    assert np.hypot(other.last("motion").root[0] - 1.0, other.last("motion").root[2] - 2.0) < 0.03


def test_the_overlay_shows_path_and_footprints():
    stage, _ = _stage()
    stage.publish("command", Locomotion(id=1, path=_line(5.0), complete=True))
    stage.advance(2.0)
    kinds = [p.kind for p in stage.last("overlay/blender").primitives]
    assert "line" in kinds
    assert kinds.count("polygon") >= 4


def test_the_same_commands_give_the_same_motion_to_the_bit():
    def play() -> list[bytes]:
        stage, _ = _stage()
        stage.publish("command", Locomotion(id=1, path=_line(2.0), complete=True))
        stage.advance(2.0)
        stage.publish("command", Jump(id=2, height=0.3))
        stage.advance(3.0)
        return [m.rotations.tobytes() + m.root.tobytes() for m in stage.received("motion")]

    assert play() == play()


def test_it_can_be_driven_by_speed_and_turn():
    stage, node = _stage(drive_speed=1.2, drive_turn=0.6)
    stage.advance(6.0)
    motions = stage.received("motion")[180:]
    speed = _steps(motions).mean() * 60.0
    assert speed == pytest.approx(1.2, abs=0.08)
    turned = np.unwrap([_heading(m) for m in motions])
    assert (turned[-1] - turned[0]) / (len(motions) - 1) * 60.0 == pytest.approx(0.6, abs=0.06)
    assert _steps(motions).max() < 0.04
    stage.publish("command", Jump(id=1, height=0.3))
    node.set_param("drive_speed", 0.0)
    stage.advance(6.0)
    assert node.core.done == [1]
    assert node.core.player.free


def test_it_walks_over_uneven_ground(tmp_path):
    x = np.linspace(-3, 3, 61)
    heights = 0.06 * np.sin(2.0 * x)[None, :] + 0.10 * np.sin(1.3 * np.linspace(-1, 7, 81))[:, None]
    path = tmp_path / "ground.npz"
    np.savez(path, heights=heights, cell=0.1, x=-3.0, z=-1.0)
    stage, node = _stage(ground=str(path))
    field = Heightfield(heights, 0.1, -3.0, -1.0)
    stage.publish("command", Locomotion(id=1, path=_line(5.0), complete=True))
    for _ in range(420):
        stage.advance(1 / 60)
        core = node.core
        state = core.player.state
        for side in range(2):
            if state.mode[side] == 1:
                mark = state.prints[side]
                assert abs(mark[1] - field(float(mark[0]), float(mark[2]))) < 0.02
        assert core.player.beyond < 1e-3
    assert abs(stage.last("motion").root[2] - 5.0) < 0.05


def test_bad_files_are_one_line(tmp_path):
    with pytest.raises(ValueError, match="cannot use ground"):
        ground_of(str(tmp_path / "no.npz"))
    np.savez(tmp_path / "a.npz", cell=1.0)
    with pytest.raises(ValueError, match=r"needs an \.npz with heights") as caught:
        ground_of(str(tmp_path / "a.npz"))
    assert "\n" not in str(caught.value)
