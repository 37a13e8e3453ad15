"""Touches become targets, steps and the camera: a fake pose and fake touches, in virtual time."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from table import FIGURE, HZ, JOINTS, Table

from bunraku.figure.camera import look_at, project, ray
from bunraku.msgs import Contact, Device, Pose
from bunraku.nodes.interpreter.node import Interpreter, Plays
from bunraku.nodes.interpreter.rules import RULES
from bunraku.runtime.memory import MemoryStage
from bunraku.runtime.node import ParamProblem


def test_a_swipe_on_nothing_orbits_and_a_pinch_zooms() -> None:
    table = Table()
    first = table.camera
    table.down(1, (0.1, 0.3))
    assert table.held() == set()
    table.drag(1, (0.2, 0.3), 0.3)
    turned = table.camera
    center = np.array([0, 0.9, 0])
    assert np.linalg.norm(np.array(turned.position) - center) == pytest.approx(
        np.linalg.norm(np.array(first.position) - center), abs=1e-6
    )
    assert turned.position != first.position
    table.down(2, (0.9, 0.3))
    assert table.camera.position == turned.position
    table.drag(2, (0.7, 0.3), 0.3)  # together: farther away
    far = np.linalg.norm(np.array(table.camera.position) - center)
    assert far == pytest.approx(np.linalg.norm(np.array(turned.position) - center) * 0.7 / 0.5, rel=0.01)
    table.up(1)
    table.up(2)
    table.stage.ask(table.node, "reset")
    assert table.camera.position == pytest.approx(first.position, abs=1e-9)


def test_several_parts_and_two_hands_at_one_place() -> None:
    table = Table()
    table.down(1, table.place("left_hand"))
    table.down(2, table.place("right_foot"))
    table.down(3, table.place("pelvis"))
    assert table.held() == {"left_hand", "right_foot", "pelvis"}
    # A second finger on a part that is held takes what lies behind it, or nothing: never the camera.
    table.down(4, table.place("left_hand"))
    before = table.camera.position
    table.drag(4, (0.3, 0.3), 0.2)
    assert table.camera.position == before
    table.up(2)
    assert "right_foot" not in table.held()
    assert "left_hand" in table.held()


def test_same_ids_on_two_devices_are_two_fingers() -> None:
    table = Table()
    x, y = table.place("left_hand")
    fx, fy = table.place("right_foot")
    table.send(Contact(id=0, phase="down", x=x, y=y), device="a")
    table.send(Contact(id=0, phase="down", x=fx, y=fy), device="b")
    assert table.held() == {"left_hand", "right_foot"}
    table.send(Contact(id=0, phase="up", x=x, y=y), device="a")
    assert table.held() == {"right_foot"}
    # Device b goes without a word of its finger.
    table.stage.publish("device/b", Device(device="b", kind="touch", driver="tuio", connected=False))
    assert table.held() == set()


def test_garbage_order_and_lost_endings_do_no_harm() -> None:
    table = Table(forget=3.0)
    x, y = table.place("left_hand")
    table.send(Contact(id=1, phase="up", x=x, y=y))
    table.send(Contact(id=5, phase="cancel", x=9 / 10, y=y))
    assert table.held() == set()
    table.send(Contact(id=1, phase="move", x=x, y=y))  # a move before its down
    assert table.held() == {"left_hand"}
    table.send(Contact(id=1, phase="down", x=x, y=y), Contact(id=1, phase="up", x=x, y=y))  # listed twice
    assert table.held() == {"left_hand"}
    table.send()  # a frame without it: it has left
    assert table.held() == set()
    table.send(Contact(id=2, phase="down", x=x, y=y))
    table.stage.advance(2.5)
    assert table.held() == {"left_hand"}
    table.stage.advance(1.0)  # the device has been silent too long
    assert table.held() == set()


def test_who_says_touches_anew_starts_with_no_fingers() -> None:
    table = Table()
    table.down(1, table.place("left_hand"))
    for _ in range(3):
        table.frame()
    table.stage._seq["touch"] = 0
    table.send(device="another")
    assert table.held() == set()


def test_released_is_said_again_so_that_a_restarted_listener_hears_it() -> None:
    table = Table()
    table.stage.advance(2.0)
    table.stage.clear()
    table.stage.advance(3.0)
    said = table.stage.received("target")
    assert 2 <= len(said) <= 4
    assert table.held() == set()


def test_what_devices_play() -> None:
    plays = Plays.parse(["figure", "tuio-*=camera"], ["figure", "camera"])
    assert plays.of("tuio-table") == "camera"
    assert plays.of("web-1") == "figure"
    with pytest.raises(ParamProblem, match="none of figure, camera"):
        Plays.parse(["dance"], ["figure", "camera"])
    table = Table(touch_plays=["figure", "pad=camera"])
    x, y = table.place("left_hand")
    table.send(Contact(id=0, phase="down", x=x, y=y), device="pad")
    assert table.held() == set()


def test_the_overlay_shows_the_fingers_and_is_cleared() -> None:
    table = Table()
    table.down(1, table.place("left_hand"))
    table.drag(1, (0.6, 0.3), 0.3)
    kinds = [one.kind for one in table.stage.last("overlay/interpreter").primitives]
    assert kinds.count("circle") == 1
    assert "line" in kinds
    assert "polygon" in kinds
    table.up(1)
    assert table.stage.last("overlay/interpreter").primitives == []


def test_the_camera_follows_a_figure_that_walks_off_but_not_a_dragged_pelvis() -> None:
    table = Table()
    for k in range(120):
        table.stage.advance(1.0 / HZ)
        table.pose(np.array([0.02 * k, 0.95, 0.0]))
    table.stage.advance(2.0)
    x, _ = project(table.camera, (table.root[0], 0.9, 0.0))
    assert abs(x - 0.5) < 0.15
    place = table.camera.position
    table.down(1, table.place("pelvis"))
    table.drag(1, (0.9, 0.5), 0.4)
    assert table.camera.position == place


def test_a_node_that_starts_again_keeps_its_view_and_counts_on() -> None:
    table = Table()
    table.down(1, (0.1, 0.3))
    table.drag(1, (0.2, 0.35), 0.3)
    state = table.node.save()
    again = MemoryStage(now=table.stage.clock.now())
    again.add(Interpreter, state=state)
    assert again.last("camera").position == pytest.approx(table.camera.position)


def test_a_skeleton_or_pose_that_does_not_fit_is_left_out() -> None:
    table = Table()
    table.stage.publish("pose", Pose(skeleton="x", root=np.zeros(3), rotations=np.tile([0, 0, 0, 1.0], (3, 1))))
    table.down(1, table.place("left_hand"))
    assert table.held() == {"left_hand"}


def test_orthographic_rays_are_understood() -> None:
    camera = look_at((0, 1, 4), (0, 1, 0), ortho_height=2.0)
    origin, direction = ray(camera, 0.25, 0.5)
    assert direction == pytest.approx([0, 0, -1])
    assert origin[0] == pytest.approx(-0.5 * 16 / 9)


def test_what_is_held_stays_while_another_finger_turns_the_view() -> None:
    table = Table()
    x, y = table.place("left_hand")
    table.down(1, (x, y))
    table.drag(1, (x + 0.02, y - 0.05), 1.5)
    before = np.array(table.target.left_hand)
    table.down(2, (0.1, 0.3))
    table.drag(2, (0.45, 0.3), 0.8)
    assert np.array(table.target.left_hand) == pytest.approx(before, abs=1e-3)
    table.up(2)
    assert np.array(table.target.left_hand) == pytest.approx(before, abs=1e-3)
    # From the side now: the same finger moves it to front and back.
    hx, hy = table.fingers[1]
    table.drag(1, (hx + 0.04, hy), 1.0)
    moved = np.array(table.target.left_hand) - before
    assert abs(moved[2]) > 0.05
    assert abs(moved[0]) < 1e-3


def test_a_flood_of_fingers_and_devices_stays_bounded() -> None:
    table = Table(forget=1.0)
    for device in range(60):
        table.send(*[Contact(id=k, phase="down", x=0.01 * k, y=0.02 * k) for k in range(40)], device=f"device-{device}")
    core = table.node.cores["figure"]
    assert len(core.fingers) <= 40  # type: ignore[attr-defined]
    table.stage.advance(2.0)
    assert core.fingers == {}  # type: ignore[attr-defined]
    assert core.contacts.heard == {}  # type: ignore[attr-defined]


def test_how_long_a_silent_device_is_remembered_is_set_live() -> None:
    table = Table()
    table.down(1, table.place("left_hand"))
    assert table.stage.ask(table.node, "param.set", name="forget", value=0.6)["ok"]
    table.stage.advance(0.4)
    assert table.held() == {"left_hand"}
    table.stage.advance(0.4)
    assert table.held() == set()


@pytest.mark.parametrize("resting", [1, 2])
def test_fingers_that_rest_on_nothing_do_not_hold_a_drag_up(resting: int) -> None:
    alone, table = Table(), Table()
    x, y = table.place("left_hand")
    alone.down(1, (x, y))
    table.down(1, (x, y))
    for key in range(resting):
        table.down(10 + key, (0.05 + 0.03 * key, 0.9))
    for k in range(60):
        share = (k + 1) / 60
        alone.drag(1, (x + 0.02 * share, y - 0.06 * share), 1.0 / HZ)
        # Fingers are never quite still.
        for key in range(resting):
            table.fingers[10 + key] = (0.05 + 0.03 * key + 0.0002 * (-1) ** k, 0.9)
        table.drag(1, (x + 0.02 * share, y - 0.06 * share), 1.0 / HZ)
    assert np.array(table.target.left_hand) == pytest.approx(np.array(alone.target.left_hand), abs=0.02)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_wild_fingers_give_whole_targets_within_bounds(seed: int) -> None:
    """Fingers that jump about and off the picture, come and go, and turn the view meanwhile."""
    rng = np.random.default_rng(seed)
    table = Table()
    parts = sorted(JOINTS)
    for key in range(4):
        table.down(key, table.place(str(rng.choice(parts))) if key < 3 else (0.05, 0.3))
    for _ in range(40):
        table.stage.advance(float(rng.choice([0.0, 1e-4, 1 / 120, 1 / 30, 0.5])))
        for key in list(table.fingers):
            x, y = table.fingers[key] + rng.normal(0.0, rng.choice([0.002, 0.05, 0.6]), 2)
            table.fingers[key] = (float(np.clip(x, 0.0, 1.0)), float(np.clip(y, 0.0, 1.0)))
        table.frame()
        table.pose(FIGURE.rest_pose()[0] + rng.normal(0.0, 0.05, 3))
        for name in table.held():
            value = np.atleast_1d(getattr(table.target, name))
            assert np.isfinite(value).all()
            if name in ("trunk", "head"):
                assert np.linalg.norm(value) == pytest.approx(1.0, abs=1e-6)
            elif name != "yaw":
                assert np.linalg.norm(value - [0.0, 1.0, 0.0]) < RULES.far + 1.5
        position = np.array(table.camera.position)
        assert np.isfinite(position).all()
        assert 0.5 < np.linalg.norm(position) < 25.0
        if rng.random() < 0.1 and table.fingers:
            table.up(int(rng.choice(list(table.fingers))))
        if rng.random() < 0.1:
            key = int(rng.integers(0, 8))
            if key not in table.fingers:
                table.down(key, table.place(str(rng.choice(parts))))
