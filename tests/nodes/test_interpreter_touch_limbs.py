"""A finger on a hand, a foot, an elbow or a knee: the drag plane, the speed offset, the body kept clear of."""

import numpy as np
import pytest
from table import FIGURE, HZ, JOINTS, ROLES, Table

from bunraku.figure.camera import orbit_from, project, ray
from bunraku.figure.fk import fk
from bunraku.nodes.interpreter.rules import RULES


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
    table.look_from((0.3, 1.3, 4.0))
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


def test_a_punch_leaves_no_faster_than_a_fist_and_stays_out_for_a_moment() -> None:
    table = Table()
    table.look_from((0.0, 1.3, 4.0))
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


def test_the_gain_of_speed_is_settable_while_it_runs() -> None:
    """The next touch goes by it: the same quick drag goes forward with the gain and stays with none."""
    table = Table()
    table.look_from((0.0, 1.3, 4.0))
    forward = []
    for gain in (0.2, 0.0):
        table.stage.ask(table.node, "param.set", name="speed_gain", value=gain)
        x, y = table.place("left_hand")
        table.down(1, (x, y))
        table.drag(1, (x - 0.06, y + 0.10), 1.5)
        still = table.target.left_hand[2]
        table.drag(1, (x - 0.09, y), 0.12)
        forward.append(table.target.left_hand[2] - still)
        table.up(1)
        table.stage.advance(0.5)
    assert forward[0] > 0.10
    assert abs(forward[1]) < 0.01


def test_from_the_side_speed_adds_nothing() -> None:
    table = Table()
    table.look_from((4.2, 1.2, 0.2))
    x, y = table.place("left_hand")
    table.down(1, (x, y))
    table.drag(1, (x, y + 0.2), 0.1)
    assert table.target.left_hand[0] == pytest.approx(0.71, abs=1e-5)


def test_a_hand_dragged_before_the_body_keeps_clear_of_it() -> None:
    table = Table()
    table.look_from((0.0, 1.2, 4.2))
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
        table.look_from((0.0, 1.2, 4.2))
        x, y = table.place(part)
        table.down(1, (x, y))
        before = np.array(getattr(table.target, part))
        table.drag(1, (x, y - 0.12), 2.0)
        moved = np.array(getattr(table.target, part)) - before
        assert moved[1] > 0.25
        assert abs(moved[2]) < 0.01


def test_a_foot_that_is_dragged_across_the_other_leg_passes_before_it() -> None:
    table = Table()
    table.look_from((0.0, 1.2, 4.2))
    x, y = table.place("right_foot")
    leg = project(table.camera, FIGURE.rest_positions[FIGURE.role("leftLowerLeg")])
    table.down(1, (x, y))
    table.drag(1, (x, y - 0.10), 1.0)
    table.drag(1, (float(leg[0]), y - 0.10), 1.5)
    table.stage.advance(0.3)
    box = FIGURE.box_sizes[FIGURE.role("leftLowerLeg")]
    assert table.target.right_foot[2] > box[2] + 0.05
