"""A finger on the trunk, the head or the pelvis: bends, leans, crouches, steps and turns."""

from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from table import FIGURE, HZ, Table

from bunraku.figure.camera import metres_per_height, project
from bunraku.msgs import Contact, Touch
from bunraku.nodes.controller.node import Controller
from bunraku.nodes.interpreter.grabs import straight_parts
from bunraku.nodes.interpreter.node import Interpreter
from bunraku.runtime.memory import MemoryStage


@pytest.mark.parametrize(("part", "axis"), [("trunk", 0), ("head", 0)])
def test_dragging_down_bends_forward_and_up_backward(part: str, axis: int) -> None:
    for way in (1, -1):
        table = Table()
        table.look_from((0.0, 1.2, 4.2))
        x, y = table.place(part)
        table.down(1, (x, y))
        table.drag(1, (x, y + 0.03 * way), 1.0)
        q = getattr(table.target, part)
        assert np.sign(q[axis]) == way  # about +X: the front goes down
        assert abs(q[1]) < 1e-3
        assert np.linalg.norm(q) == pytest.approx(1.0, abs=1e-6)


def test_a_trunk_dragged_nearly_sideways_leans_and_does_not_bend() -> None:
    bends, leans = [], []
    for down in (-0.012, 0.0, 0.012):  # 3 cm, on a way of 28 cm
        table = Table()
        table.look_from((0.0, 1.2, 4.2))
        x, y = table.place("trunk")
        table.down(1, (x, y))
        table.drag(1, (x + 0.06, y + down), 1.0)
        bends.append(table.target.trunk[0])
        leans.append(table.target.trunk[2])
    assert np.ptp(bends) < 0.01
    assert max(leans) < -0.15


@given(st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)), st.floats(0.0, 2 * pi))
def test_straightening_is_continuous_and_keeps_the_larger_part(way: tuple[float, float, float], angle: float) -> None:
    one = np.array(way)
    out = straight_parts(one) * one
    assert np.all(np.abs(out) <= np.abs(one) + 1e-12)
    level = float(np.hypot(one[0], one[2]))
    if level > abs(one[1]):
        assert out[[0, 2]] == pytest.approx(one[[0, 2]])
    elif abs(one[1]) > level:
        assert out[1] == pytest.approx(one[1])
    if np.linalg.norm(one) > 1e-3:
        near = one + 1e-6 * np.array([np.cos(angle), np.sin(angle), 0.0])
        assert np.linalg.norm(straight_parts(near) * near - out) < 1e-4


def test_a_level_drag_of_the_trunk_leans_the_figure_on_stage_without_bending_it() -> None:
    """With the controller: what a lean takes the touched point down is not worked off by bending."""
    stage = MemoryStage()
    node = stage.add(Interpreter, azimuth=0.12, elevation=0.10)
    core = stage.add(Controller).core
    stage.advance(0.5)
    neck = FIGURE.role("neck")
    before = core.positions_ws[neck].copy()
    x, y = project(stage.last("camera"), 0.6 * before + 0.4 * core.positions_ws[FIGURE.role("spine")])
    for k in range(120):
        share = min(1.0, k / 60)
        phase = "down" if k == 0 else "move"
        one = Contact(id=1, phase=phase, x=float(x) - 0.02 * share, y=float(y))  # type: ignore[arg-type]
        stage.publish("touch", Touch(device="test", contacts=[one]))
        stage.advance(1.0 / HZ)
    assert node.cores["figure"].held.keys() == {"trunk"}  # type: ignore[attr-defined]
    moved = core.positions_ws[neck] - before
    assert moved[0] < -0.10
    assert abs(moved[2]) < 0.03


def test_a_trunk_dragged_sideways_never_turns_about_y() -> None:
    table = Table()
    x, y = table.place("trunk")
    table.down(1, (x, y))
    table.drag(1, (x + 0.08, y + 0.05), 1.0)
    q = np.array(table.target.trunk)
    assert abs(q[1]) < 1e-6
    assert np.linalg.norm(q[[0, 2]]) > 0.05


def pelvis_step(table: Table, dx: float, dy: float) -> list[object]:
    x, y = table.place("pelvis")
    table.down(1, (x, y))
    table.drag(1, (x + dx, y + dy), 0.5)
    return table.stage.received("command")


def test_the_pelvis_moves_over_the_feet_and_bends_the_knees() -> None:
    table = Table()
    x, y = table.place("pelvis")
    table.down(1, (x, y))
    table.drag(1, (x + 0.01, y + 0.06), 1.0)
    assert table.stage.received("command") == []
    assert 0.75 < table.target.pelvis[1] < 0.85
    assert table.target.pelvis[0] == pytest.approx(0.05, abs=0.03)


def test_a_pelvis_that_is_nearly_upright_is_upright_and_a_crouch_is_as_deep_as_asked() -> None:
    table = Table()
    table.look_from((0.0, 0.95, 4.2))
    x, y = table.place("pelvis")
    table.down(1, (x, y))
    top = table.target.pelvis[1]
    tall = metres_per_height(table.camera, (0.0, 0.95, 0.0))
    heights = []
    for down in np.linspace(0.0, 0.30, 61):
        table.drag(1, (x, y + down / tall), 0.05)
        heights.append(table.target.pelvis[1])
    assert top - heights[2] < 0.001  # a centimetre down
    assert top - heights[4] < 0.008
    assert top - heights[-1] == pytest.approx(0.30, abs=0.03)
    assert max(np.diff(heights)) <= 1e-9
    assert min(np.diff(heights)) > -0.012  # no jump: at most about twice the finger's way


def test_a_pelvis_dragged_beyond_the_feet_is_one_step_at_a_time() -> None:
    table = Table()
    table.look_from((0.0, 1.5, 4.2))
    steps = pelvis_step(table, 0.12, 0.0)
    assert len(steps) == 1
    goal = np.array(steps[0].goal)  # type: ignore[attr-defined]
    assert goal[1] == 0.0
    assert 0.5 - 1e-6 <= np.hypot(goal[0], goal[2]) <= 0.8 + 1e-6
    assert goal[0] > 0.45
    assert table.target.pelvis is None  # the step has the pelvis
    table.drag(1, table.fingers[1], 1.0)
    assert len(table.stage.received("command")) == 1
    # The figure makes the step: the finger is nearly over it now, and nothing goes back and forth.
    table.pose(np.array([goal[0], 0.95, goal[2]]))
    table.drag(1, table.fingers[1], 1.0)
    assert len(table.stage.received("command")) == 1
    assert table.target.pelvis is not None
    assert table.target.pelvis[1] > 0.935  # it stands upright again
    # Farther on: the next step, with another id.
    table.drag(1, (table.fingers[1][0] + 0.15, table.fingers[1][1]), 0.3)
    later = table.stage.received("command")
    assert len(later) == 2
    assert later[1].id > later[0].id


@pytest.mark.parametrize("lower", [0.0, 0.02, 0.25])
def test_a_level_drag_is_a_step_to_the_side_however_low_the_hips_have_sunk(lower: float) -> None:
    table = Table()  # the camera stands 7 degrees above the level
    x, y = table.place("pelvis")
    table.down(1, (x, y))
    if lower > 0.1:
        table.drag(1, (x, y + lower / 2.73), 1.0)  # ducks first
    table.pose(np.array([0.0, FIGURE.rest_positions[0, 1] - lower, 0.0]))
    table.drag(1, (x + 0.12, table.fingers[1][1]), 0.5)
    steps = table.stage.received("command")
    assert len(steps) == 1
    assert steps[0].goal[0] > 0.45
    assert abs(steps[0].goal[2]) < 0.12


def test_up_and_down_on_the_picture_step_away_from_and_toward_the_viewer() -> None:
    table = Table()
    table.look_from((0.0, 1.8, 4.0))
    away = pelvis_step(table, 0.0, -0.10)
    assert away
    assert away[0].goal[2] < -0.45  # type: ignore[attr-defined]
    other = Table()
    other.look_from((0.0, 1.8, 4.0))
    toward = pelvis_step(other, 0.0, 0.30)
    assert toward
    assert toward[0].goal[2] > 0.45  # type: ignore[attr-defined]


def test_a_ray_above_the_horizon_gives_a_step_s_direction() -> None:
    table = Table()
    table.look_from((0.0, 1.0, 4.0))
    steps = pelvis_step(table, 0.0, -0.30)
    assert steps
    assert steps[0].goal[2] == pytest.approx(-0.8, abs=0.02)  # type: ignore[attr-defined]


def test_two_fingers_turn_the_figure_the_way_they_twist() -> None:
    table = Table()
    x, y = table.place("pelvis")
    table.down(1, (x, y))
    table.down(2, (x + 0.11, y + 0.0))
    assert table.target.yaw == pytest.approx(0.0, abs=1e-6)
    assert table.target.pelvis is not None
    table.drag(2, (x, y + 0.11 * 16 / 9), 0.5)  # a quarter turn clockwise as seen
    assert table.target.yaw == pytest.approx(-pi / 2, abs=0.02)
    assert table.stage.received("command") == []
    table.drag(2, (x - 0.11, y), 0.5)
    assert abs(table.target.yaw) == pytest.approx(pi, abs=0.05)
    before = table.target.pelvis
    table.up(2)
    assert table.target.yaw is None
    assert table.target.pelvis == pytest.approx(before, abs=0.01)
