"""One finger through touch messages, interpreter and controller: any part, from any side, to any edge of the picture.

What a person does with a figure: take hold of a part and pull it as far as the picture goes, hold it there, let go.
None of it may break the body: joints within their ranges, parts out of each other, soles on the floor, no joint faster
than a person's. Run as a program it prints the table of measurements.
"""

import itertools
import sys

import numpy as np
import pytest
from table import JOINTS

from bunraku.figure.camera import orbit_from, project
from bunraku.figure.default import default_figure
from bunraku.figure.limits import limit_excess
from bunraku.figure.metrics import floor_penetration, foot_drift, joint_speeds, self_penetration
from bunraku.figure.quat import rotate
from bunraku.msgs import Contact, Touch
from bunraku.nodes.controller.node import Controller
from bunraku.nodes.interpreter.node import Interpreter
from bunraku.runtime.memory import MemoryStage

FIGURE = default_figure()
PARTS = (
    "pelvis", "left_hand", "right_hand", "left_foot", "right_foot", "trunk", "head", "left_elbow", "right_knee",
)  # fmt: skip
VIEWS = {
    "front": (0.6, 1.2, 4.2),
    "side": (4.2, 1.2, 0.4),
    "behind": (-0.4, 1.3, -4.2),
    "above": (0.3, 4.0, 2.4),
}
EDGES = {"left": (0.0, 0.5), "right": (1.0, 0.5), "top": (0.5, 0.0), "bottom": (0.5, 1.0), "middle": (0.5, 0.45)}
HZ = 60
PULL, HOLD, AFTER = 1.5, 0.7, 1.3
"""s: the way of the finger, how long it rests, how long the figure is watched after it."""


def drag(part: str, eye: tuple[float, float, float], to: tuple[float, float]) -> dict[str, float]:
    """What is the worst of one drag: degrees, mm, degrees a second."""
    stage = MemoryStage()
    interpreter = stage.add(Interpreter)
    core = stage.add(Controller, show_overlay=False).core
    interpreter.viewer.orbit = orbit_from(eye, (0.0, 0.9, 0.0), 0.576, 16 / 9)
    stage.advance(0.2)
    joint, middle = FIGURE.role(JOINTS[part]), np.empty(3)
    rotate(core.rotations_ws[joint], np.array(FIGURE.box_centers[joint]), middle)
    start = np.array(project(stage.last("camera"), core.positions_ws[joint] + middle)[:2])
    frames = []
    for n in range(round((PULL + HOLD + AFTER) * HZ)):
        t = n / HZ
        if t < PULL + HOLD:
            x, y = np.clip(start + (np.array(to) - start) * min(1.0, t / PULL), 0.0, 1.0)
            contact = Contact(id=1, phase="down" if n == 0 else "move", x=float(x), y=float(y))
            stage.publish("touch", Touch(device="t", contacts=[contact]))
        elif t < PULL + HOLD + 1.0 / HZ:
            stage.publish("touch", Touch(device="t", contacts=[]))
        stage.advance(1.0 / HZ)
        stage.clear()
        frames.append((
            core.positions_ws.copy(), core.rotations_ws.copy(), core.rotations_ls.copy(), core.state.planted > 0.5,
        ))  # fmt: skip
    positions, orientations, rotations, planted = (np.array(column) for column in zip(*frames, strict=True))
    return {
        "limit": float(np.degrees(limit_excess(FIGURE, rotations)).max()),
        "overlap": 1e3 * float(self_penetration(FIGURE, positions, orientations).max()),
        "floor": 1e3 * float(floor_penetration(FIGURE, positions, orientations).max()),
        "drift": 1e3 * float(foot_drift(positions[:, core.rig.limbs[2:, 2]], planted)),
        "speed": float(np.degrees(joint_speeds(rotations, 1.0 / HZ)).max()),
    }


BOUNDS = {"limit": 1.0, "overlap": 5.0, "floor": 10.0, "drift": 2.0, "speed": 2000.0}
"""Degrees, mm, mm, mm, degrees a second (a throwing arm; the knee of a quick kick)."""


@pytest.mark.parametrize(("part", "view"), list(itertools.product(PARTS, VIEWS)))
def test_no_drag_to_an_edge_breaks_the_body(part: str, view: str) -> None:
    broken = {}
    for edge, to in EDGES.items():
        found = drag(part, VIEWS[view], to)
        over = {name: round(found[name], 1) for name, most in BOUNDS.items() if not found[name] <= most}
        if over:
            broken[edge] = over
    assert not broken


if __name__ == "__main__":
    chosen = sys.argv[1].split(",") if len(sys.argv) > 1 else list(PARTS)
    print(" " * 28 + " ".join(f"{name:>8}" for name in BOUNDS))
    for part, (view, eye), (edge, to) in itertools.product(chosen, VIEWS.items(), EDGES.items()):
        found = drag(part, eye, to)
        mark = "" if all(found[name] <= most for name, most in BOUNDS.items()) else "  <"
        print(f"{part:11}{view:8}{edge:9}" + " ".join(f"{value:8.1f}" for value in found.values()) + mark, flush=True)
