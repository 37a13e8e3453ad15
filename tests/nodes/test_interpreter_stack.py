"""Touch to pose: the written examples through input, interpreter and controller on one stage in virtual time."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from bunraku.figure.camera import ray
from bunraku.figure.default import default_figure
from bunraku.figure.fk import fk
from bunraku.figure.quat import rotate
from bunraku.msgs import Pose, Touch
from bunraku.nodes.blender.node import Blender
from bunraku.nodes.controller.node import Controller
from bunraku.nodes.input_touch.node import InputTouch
from bunraku.nodes.input_touch.performance import load
from bunraku.nodes.interpreter.core import TARGETS
from bunraku.nodes.interpreter.grabs import PointGrab, TurnGrab
from bunraku.nodes.interpreter.node import Interpreter
from bunraku.runtime.memory import MemoryStage
from bunraku.runtime.node import Node, subscribe

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
FIGURE = default_figure()


class Witness(Node):
    """Measures, at every touch, how far the touched point of each grabbed part is from its finger's ray."""

    name = "witness"
    journal = False
    interpreter: Interpreter

    def setup(self) -> None:
        self.gaps: dict[str, list[tuple[float, float]]] = {}
        self.moved: list[float] = []

    @subscribe("pose", Pose)
    def on_pose(self, msg: Pose) -> None:
        positions, turns = fk(FIGURE, msg.root.astype(float), msg.rotations.astype(float))
        core = self.interpreter.cores["figure"]
        for finger in core.fingers.values():  # type: ignore[attr-defined]
            grab = finger.grab
            if isinstance(grab, (PointGrab, TurnGrab)):
                grip = grab.offset.local if isinstance(grab, PointGrab) else grab.grip
                out = np.empty(3)
                rotate(turns[grab.part.joint], grip, out)
                touched = positions[grab.part.joint] - out
                origin, way = ray(self.interpreter.viewer.camera(), finger.x, finger.y)
                line = touched - origin
                gap = float(np.linalg.norm(line - way * (line @ way)))
                self.gaps.setdefault(grab.part.name, []).append((self.now / 1e9, gap))


def perform(name: str) -> tuple[MemoryStage, Witness]:
    stage = MemoryStage()
    interpreter = stage.add(Interpreter)
    Witness.interpreter = interpreter
    stage.add(Controller)
    witness = stage.add(Witness)
    stage.advance(0.2)
    file = EXAMPLES / f"{name}.touch"
    stage.add(InputTouch, script=str(file))
    stage.advance(load(file).length + 1.0)
    return stage, witness


def parts_of(name: str) -> set[str]:
    """The parts that a performance names."""
    touches = tomllib.loads((EXAMPLES / f"{name}.touch").read_text())["touch"]
    return {one["on"] for one in touches if one.get("on")}


@pytest.mark.parametrize("name", sorted(file.stem for file in EXAMPLES.glob("*.touch")))
def test_each_example_says_the_parts_that_it_names(name: str) -> None:
    stage, _ = perform(name)
    said = stage.received("target")
    held = {one for one in TARGETS for target in said if getattr(target, one) is not None}
    assert held - {"yaw"} == parts_of(name)
    assert ("yaw" in held) == (name == "turn")
    poses = stage.received("pose")
    assert all(np.isfinite(one.rotations).all() for one in poses)
    assert bool(stage.received("command")) == (name == "step")
    touches: list[Touch] = stage.received("touch")
    assert all(one.phase in ("up", "cancel") for one in touches[-1].contacts)


@pytest.mark.parametrize("name", ["wave", "point"])
def test_the_hand_stays_under_the_finger(name: str) -> None:
    _, witness = perform(name)
    for part, gaps in witness.gaps.items():
        if not part.endswith("hand"):
            continue
        values = np.array([gap for _, gap in gaps])
        assert np.quantile(values, 0.95) < 0.02
        assert values[-1] < 0.001


def test_a_bow_over_a_motion_bends_without_a_twist() -> None:
    """The pelvis turns along with a held trunk: its heading must not lead the trunk round, or nothing ends that."""
    stage = MemoryStage()
    stage.add(Interpreter)
    stage.add(Blender)
    core = stage.add(Controller).core
    stage.advance(1.0)
    stage.add(InputTouch, script=str(EXAMPLES / "bow.touch"))
    tilts, yaws = [], []
    for _ in range(38):
        stage.advance(0.1)
        turn = core.state.turns[0]
        tilts.append(np.degrees(2.0 * np.arcsin(np.hypot(turn[0], turn[2]))))
        yaws.append(abs(np.degrees(2.0 * np.arctan2(turn[1], turn[3]))))
    assert max(tilts) > 40.0
    assert max(yaws) < 3.0
    assert tilts[-1] < 5.0
