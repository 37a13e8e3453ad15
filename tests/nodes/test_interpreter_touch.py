"""Touches become targets, steps and the camera: a fake pose and fake touches, in virtual time."""

from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bunraku.figure.camera import Orbit, look_at, metres_per_height, orbit_from, project, ray
from bunraku.figure.default import default_figure
from bunraku.figure.fk import fk
from bunraku.figure.wire import to_message
from bunraku.msgs import Camera, Contact, Contacts, Device, Pose, Target, Touch
from bunraku.nodes.controller.node import Controller
from bunraku.nodes.interpreter.grabs import straight_parts
from bunraku.nodes.interpreter.node import Interpreter, Plays
from bunraku.nodes.interpreter.rules import RULES
from bunraku.runtime.memory import MemoryStage
from bunraku.runtime.node import ParamProblem

FIGURE = default_figure()
HZ = 60.0
NAMES = ("pelvis", "left_hand", "right_hand", "left_foot", "right_foot", "trunk", "head", "yaw",
         "left_elbow", "right_elbow", "left_knee", "right_knee")  # fmt: skip
ROLES = {"pelvis": "hips", "left_hand": "leftHand", "right_hand": "rightHand", "left_foot": "leftFoot",
         "right_foot": "rightFoot", "trunk": "chest", "head": "head"}  # fmt: skip
JOINTS = {**ROLES, "left_elbow": "leftLowerArm", "right_elbow": "rightLowerArm", "left_knee": "leftLowerLeg",
          "right_knee": "rightLowerLeg"}  # fmt: skip


class Table:
    """A stage with a figure at rest and fingers on its picture."""

    def __init__(self, device: str = "test", **params: object) -> None:
        self.stage = MemoryStage()
        self.node = self.stage.add(Interpreter, **params)
        self.root, self.rotations = FIGURE.rest_pose()
        self.device = device
        self.fingers: dict[int, tuple[float, float]] = {}
        self.stage.publish("skeleton", to_message(FIGURE))
        self.pose()

    def pose(self, root: np.ndarray | None = None) -> None:
        if root is not None:
            self.root = np.array(root, dtype=float)
        self.stage.publish(
            "pose",
            Pose(
                skeleton=FIGURE.hash,
                root=self.root,
                rotations=self.rotations,
                contacts=Contacts(left_foot=True, right_foot=True),
            ),
        )

    @property
    def camera(self) -> Camera:
        camera: Camera = self.stage.last("camera")
        return camera

    @property
    def target(self) -> Target:
        target: Target = self.stage.last("target")
        return target

    def held(self) -> set[str]:
        return {name for name in NAMES if getattr(self.target, name) is not None}

    def place(self, part: str) -> tuple[float, float]:
        """Where the middle of a part appears."""
        joint = FIGURE.role(JOINTS[part])
        positions, _ = fk(FIGURE, self.root, self.rotations)
        middle = positions[joint] + (FIGURE.box_centers[joint] if part in ROLES else 0.0)
        x, y = project(self.camera, middle)
        return float(x), float(y)

    def send(self, *contacts: Contact, device: str | None = None) -> None:
        self.stage.publish("touch", Touch(device=device or self.device, contacts=list(contacts)))

    def frame(self, phase: dict[int, str] | None = None) -> None:
        self.send(*[
            Contact(id=key, phase=(phase or {}).get(key, "move"), x=x, y=y)  # type: ignore[arg-type]
            for key, (x, y) in self.fingers.items()
        ])  # fmt: skip

    def down(self, key: int, place: tuple[float, float]) -> None:
        self.fingers[key] = place
        self.frame({key: "down"})

    def drag(self, key: int, to: tuple[float, float], seconds: float) -> None:
        start = np.array(self.fingers[key])
        steps = max(1, round(seconds * HZ))
        for k in range(1, steps + 1):
            self.stage.advance(1.0 / HZ)
            self.pose()
            x, y = start + (np.array(to) - start) * k / steps
            self.fingers[key] = (float(x), float(y))
            self.frame()

    def up(self, key: int) -> None:
        self.frame({key: "up"})
        del self.fingers[key]


@pytest.mark.parametrize("part", sorted(JOINTS))
def test_a_finger_on_a_part_grabs_it_without_moving_it(part: str) -> None:
    table = Table()
    table.down(1, table.place(part))
    assert table.held() == {part}
    value = getattr(table.target, part)
    positions, turns = fk(FIGURE, table.root, table.rotations)
    if part in ("trunk", "head"):
        assert value == pytest.approx(turns[FIGURE.role(ROLES[part])], abs=1e-6)
    else:
        # The pelvis's own range ends a little below straight legs.
        assert value == pytest.approx(positions[FIGURE.role(JOINTS[part])], abs=0.003)
    table.up(1)
    assert table.held() == set()


@pytest.mark.parametrize("part", ["left_hand", "right_foot", "left_elbow"])
def test_the_grabbed_point_stays_under_the_finger(part: str) -> None:
    table = Table()
    x, y = table.place(part)
    table.down(1, (x, y))
    before = np.array(getattr(table.target, part))
    out = 0.03 if part.startswith("left") else -0.03  # away from the body, which would push it off its plane
    table.drag(1, (x + out, y - 0.08), 2.0)  # slower than the speed threshold
    after = np.array(getattr(table.target, part))
    # The fake part does not turn, so target and touched point move alike: by the finger's way on the picture.
    touched_before, touched_after = project(table.camera, before), project(table.camera, after)
    assert touched_after - touched_before == pytest.approx([out, -0.08], abs=0.004)
    # From the front the plane is that of the figure's X and Y.
    assert after[2] == pytest.approx(before[2], abs=1e-6)


@pytest.mark.parametrize(
    ("eye", "axis"), [((0, 1.2, 4), 2), ((0, 1.2, -4), 2), ((4, 1.2, 0.3), 0), ((0.3, 6, 0.4), 1), ((-4, 1.0, 1), 0)]
)
def test_the_drag_plane_is_square_to_the_axis_that_is_most_along_the_view(
    eye: tuple[float, float, float], axis: int
) -> None:
    table = Table()
    table.node.viewer.orbit = orbit_from(eye, (0, 0.9, 0), 0.576, 16 / 9)
    table.stage.advance(0.05)
    x, y = table.place("left_hand")
    table.down(1, (x, y))
    first = np.array(table.target.left_hand)
    table.drag(1, (x + 0.02, y + 0.02), 2.0)
    moved = np.array(table.target.left_hand) - first
    assert abs(moved[axis]) < 1e-6
    assert np.linalg.norm(moved) > 0.02


def test_the_plane_follows_a_figure_that_walks_and_a_still_finger_keeps_its_ray() -> None:
    table = Table(follow=False)
    place = table.place("left_hand")
    table.down(1, place)
    first = np.array(table.target.left_hand)
    for k in range(30):
        table.stage.advance(1.0 / HZ)
        table.pose(FIGURE.rest_pose()[0] + np.array([0.0, 0.0, 0.02 * k]))
    table.stage.advance(0.1)
    last = np.array(table.target.left_hand)
    assert last[2] - first[2] == pytest.approx(0.58, abs=0.01)
    origin, direction = ray(table.camera, *place)
    touched = last - first + origin + direction * np.dot(first - origin, direction)
    grip = first - (origin + direction * np.dot(first - origin, direction))
    assert np.linalg.norm(grip) < 0.2
    line = touched - origin
    assert np.linalg.norm(line - direction * (line @ direction)) < 0.15


def test_a_quick_drag_is_a_punch_toward_the_viewer_and_goes_back_softly() -> None:
    table = Table()
    table.node.viewer.orbit = look_orbit((0.3, 1.3, 4.0))
    table.stage.advance(0.05)
    x, y = table.place("left_hand")
    table.down(1, (x, y))
    # In toward the chest first, slowly: then out in front of it in 0.12 s.
    table.drag(1, (x - 0.06, y + 0.10), 1.5)
    still = table.target.left_hand[2]
    assert still == pytest.approx(0.0, abs=0.02)
    table.drag(1, (x - 0.09, y), 0.12)
    forward = table.target.left_hand[2]
    assert forward > 0.10
    assert np.linalg.norm(np.array(table.target.left_hand) - FIGURE.rest_positions[FIGURE.role("leftUpperArm")]) < 0.60
    path = []
    for _ in range(90):
        table.stage.advance(1.0 / HZ)
        path.append(table.target.left_hand[2])
    assert path[-1] == pytest.approx(still, abs=0.02)
    assert min(np.diff(path)) > -0.05  # no jump on the way back


def look_orbit(eye: tuple[float, float, float]) -> Orbit:
    return orbit_from(eye, (0, 0.9, 0), 0.576, 16 / 9)


def test_a_punch_leaves_no_faster_than_a_fist_and_stays_out_for_a_moment() -> None:
    table = Table()
    table.node.viewer.orbit = look_orbit((0.0, 1.3, 4.0))
    table.stage.advance(0.05)
    x, y = table.place("left_hand")
    table.down(1, (x, y))
    table.drag(1, (x - 0.06, y + 0.10), 1.5)
    depths = [table.target.left_hand[2]]
    for k in range(1, 9):  # out and up by half a metre in 0.13 s
        table.drag(1, (x - 0.06 - 0.01 * k, y + 0.10 - 0.02 * k), 1.0 / HZ)
        depths.append(table.target.left_hand[2])
    assert max(np.diff(depths)) * HZ <= RULES.speed_rise + 1.0  # eq. 11 adds its own
    most = max(depths)
    assert most > 0.3
    table.stage.advance(0.1)
    assert table.target.left_hand[2] > 0.75 * most
    table.stage.advance(3.0)
    grab = table.node.cores["figure"].held["left_hand"].grab  # type: ignore[attr-defined]
    assert not grab.speed.moving  # what is left is eq. 11's: clear of the chest


def test_from_the_side_speed_adds_nothing() -> None:
    table = Table()
    table.node.viewer.orbit = look_orbit((4.2, 1.2, 0.2))
    table.stage.advance(0.05)
    x, y = table.place("left_hand")
    table.down(1, (x, y))
    table.drag(1, (x, y + 0.2), 0.1)
    assert table.target.left_hand[0] == pytest.approx(0.71, abs=1e-5)


def test_a_hand_dragged_before_the_body_keeps_clear_of_it() -> None:
    table = Table()
    table.node.viewer.orbit = look_orbit((0.0, 1.2, 4.2))
    table.stage.advance(0.05)
    x, y = table.place("left_hand")
    table.down(1, (x, y))
    chest = project(table.camera, (0.0, 1.2, 0.0))
    depths = []
    for share in np.linspace(0.1, 1.0, 30):
        table.drag(1, (x + (chest[0] - x) * share, y + (chest[1] - y) * share), 0.1)
        depths.append(table.target.left_hand[2])
    table.stage.advance(0.5)
    # The chest's front is at z = 0.11; a hand's half thickness and the clearance come before it.
    assert table.target.left_hand[2] > 0.11 + 0.06
    assert max(np.diff(depths)) < 0.10  # no jump, at 2.5 cm of drag from one to the next


def test_a_foot_that_is_lifted_beside_the_other_leg_goes_straight_up() -> None:
    for part in ("left_foot", "right_foot"):
        table = Table()
        table.node.viewer.orbit = look_orbit((0.0, 1.2, 4.2))
        table.stage.advance(0.05)
        x, y = table.place(part)
        table.down(1, (x, y))
        before = np.array(getattr(table.target, part))
        table.drag(1, (x, y - 0.12), 2.0)
        moved = np.array(getattr(table.target, part)) - before
        assert moved[1] > 0.25
        assert abs(moved[2]) < 0.01


def test_a_foot_that_is_dragged_across_the_other_leg_passes_before_it() -> None:
    table = Table()
    table.node.viewer.orbit = look_orbit((0.0, 1.2, 4.2))
    table.stage.advance(0.05)
    x, y = table.place("right_foot")
    leg = project(table.camera, FIGURE.rest_positions[FIGURE.role("leftLowerLeg")])
    table.down(1, (x, y))
    table.drag(1, (x, y - 0.10), 1.0)
    table.drag(1, (float(leg[0]), y - 0.10), 1.5)
    table.stage.advance(0.3)
    box = FIGURE.box_sizes[FIGURE.role("leftLowerLeg")]
    assert table.target.right_foot[2] > box[2] + 0.05


@pytest.mark.parametrize(("part", "axis"), [("trunk", 0), ("head", 0)])
def test_dragging_down_bends_forward_and_up_backward(part: str, axis: int) -> None:
    for way in (1, -1):
        table = Table()
        table.node.viewer.orbit = look_orbit((0.0, 1.2, 4.2))
        table.stage.advance(0.05)
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
        table.node.viewer.orbit = look_orbit((0.0, 1.2, 4.2))
        table.stage.advance(0.05)
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
    table.node.viewer.orbit = look_orbit((0.0, 0.95, 4.2))
    table.stage.advance(0.05)
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
    table.node.viewer.orbit = look_orbit((0.0, 1.5, 4.2))
    table.stage.advance(0.05)
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
    table.node.viewer.orbit = look_orbit((0.0, 1.8, 4.0))
    table.stage.advance(0.05)
    away = pelvis_step(table, 0.0, -0.10)
    assert away
    assert away[0].goal[2] < -0.45  # type: ignore[attr-defined]
    other = Table()
    other.node.viewer.orbit = look_orbit((0.0, 1.8, 4.0))
    other.stage.advance(0.05)
    toward = pelvis_step(other, 0.0, 0.30)
    assert toward
    assert toward[0].goal[2] > 0.45  # type: ignore[attr-defined]


def test_a_ray_above_the_horizon_gives_a_step_s_direction() -> None:
    table = Table()
    table.node.viewer.orbit = look_orbit((0.0, 1.0, 4.0))
    table.stage.advance(0.05)
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
