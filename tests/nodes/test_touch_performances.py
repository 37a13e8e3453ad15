"""The performances in examples/: every finger takes hold of what it says, and each shows the action of its name."""

import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from bunraku.figure.default import default_figure
from bunraku.nodes.controller.node import Controller
from bunraku.nodes.input_touch.node import InputTouch
from bunraku.nodes.interpreter.node import Interpreter
from bunraku.runtime.memory import MemoryStage

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
FIGURE = default_figure()
STEP = 1 / 30  # s
Track = NDArray[np.float64]


def play(name: str) -> tuple[dict[str, Track], list[str]]:
    """The way of each joint by its role (n, 3), and what went wrong with a finger's grip."""
    file = EXAMPLES / f"{name}.touch"
    touches = tomllib.loads(file.read_text())["touch"]
    stage = MemoryStage()
    interpreter = stage.add(Interpreter)
    core = stage.add(Controller, show_overlay=False).core
    stage.advance(1.0)
    stage.add(InputTouch, script=str(file), at_end="stay")
    began = stage.clock.now()
    ways, wrong, seen = [], [], set()
    fingers = interpreter.cores["figure"].fingers  # type: ignore[attr-defined]
    last = max(max((row[0] for row in one.get("drag", one.get("path", [[0.0]]))), default=0.0) + one["start"]
               + one.get("hold", 0.0) for one in touches)  # fmt: skip
    while (stage.clock.now() - began) / 1e9 < last + 1.5:
        stage.advance(STEP)
        stage.clear()
        ways.append(core.positions_ws.copy())
        for (_, key), finger in list(fingers.items()):
            if key in seen:
                continue
            seen.add(key)
            wanted = touches[key].get("on", "")
            holds = finger.grab.part.name if finger.grab else ""
            if holds != wanted and not (finger.twists and wanted == "pelvis"):
                wrong.append(f"finger {key} on {wanted or 'nothing'} holds {holds or 'nothing'}")
    assert seen == set(range(len(touches)))
    track = np.array(ways)
    return {role: track[:, joint] for role, joint in FIGURE.roles.items()}, wrong


def speed(way: Track) -> float:
    return float(np.linalg.norm(np.diff(way, axis=0), axis=1).max() / STEP)


ACTIONS: dict[str, Callable[[dict[str, Track]], bool]] = {
    "pose": lambda at: at["hips"][:, 1].min() < 0.85 and at["rightHand"][:, 1].max() > 1.5,
    "reach": lambda at: at["leftHand"][:, 1].max() > 1.6 and at["leftHand"][:, 1].min() < 0.37,
    "step": lambda at: (
        at["hips"][:, 0].max() > 0.45 and at["hips"][:, 2].max() > 0.4 and at["leftFoot"][:, 1].max() > 0.12
    ),
    "nod": lambda at: np.ptp(at["head"][:, 2]) > 0.02,
    "point": lambda at: (at["leftHand"][:, 0] - at["leftUpperArm"][:, 0]).max() > 0.45,
    "wave": lambda at: int((np.diff(np.sign(np.diff(at["leftHand"][30:, 0]))) != 0).sum()) >= 4,
    "punch": lambda at: all(
        at[f"{side}Hand"][:, 2].max() > 0.40 and speed(at[f"{side}Hand"]) > 3.0 for side in ("left", "right")
    ),
    "kick": lambda at: (at["leftFoot"] - at["hips"])[:, 2].max() > 0.6 and at["leftFoot"][:, 1].max() > 0.6,
    "turn": lambda at: (at["leftUpperLeg"] - at["rightUpperLeg"])[-1, 0] < 0.10,
    "crouch": lambda at: at["hips"][:, 1].min() < 0.65 and at["rightHand"][:, 2].max() > 0.35,
    "bow": lambda at: at["neck"][:, 2].max() > 0.20,
    "limbs": lambda at: at["leftLowerArm"][:, 1].max() > 1.3 and at["leftLowerLeg"][:, 1].max() > 0.75,
    "combination": lambda at: at["leftHand"][:, 2].max() > 0.4 and at["leftFoot"][:, 1].max() > 0.45,
    "camera": lambda at: max(float(np.ptp(way, axis=0).max()) for way in at.values()) < 0.01,
}


def test_every_performance_is_known_here() -> None:
    assert {file.stem for file in EXAMPLES.glob("*.touch")} == set(ACTIONS)


@pytest.mark.parametrize("name", sorted(ACTIONS))
def test_a_performance_shows_its_action(name: str) -> None:
    at, wrong = play(name)
    assert not wrong
    assert ACTIONS[name](at)
    assert all(np.isfinite(way).all() for way in at.values())
