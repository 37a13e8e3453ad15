"""The controller's modules one by one, on numbers worked out by hand."""

from math import atan2, cos, exp, pi, radians, sin, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bunraku.figure.default import default_figure
from bunraku.figure.limits import joint_excess, limits_of
from bunraku.figure.rig import pack_rig, rig_of, unpack_rig
from bunraku.nodes.controller.balance import balance_shift, pelvis_correction, sole_polygon, trunk_correction
from bunraku.nodes.controller.blend import blend_point, blend_turn
from bunraku.nodes.controller.collision import turn_back
from bunraku.nodes.controller.interaction import end_from_trunk, trunk_from_ends
from bunraku.nodes.controller.legs import (
    keep_near_feet,
    keep_pelvis_over_feet,
    knee_pace,
    landing_place,
    lean_room,
    pelvis_home,
    reach_gently,
)
from bunraku.nodes.controller.placing import keep_in_range
from bunraku.nodes.controller.relaxing import carry_hand, relax_hand, relax_point, relax_turn, twist_of, yaw_turn
from bunraku.nodes.controller.state import TRUNK_LEAN, Gains, unpack_gains, unpack_state, unpack_under
from bunraku.nodes.controller.step import (
    FIRST,
    IDLE,
    LEFT,
    PHASE,
    RIGHT,
    advance_step,
    begin_step,
    first_foot,
    foot_goal,
    minimum_jerk,
    wrap,
)
from bunraku.nodes.controller.tracking import follow_point, keep_lean, reach_with_trunk, root_shift

RIG = rig_of(default_figure())
UNTURNED = np.array([0.0, 0.0, 0.0, 1.0])
FREE = np.array([float(TRUNK_LEAN[0]), 1.0])


def turn(axis: str, degrees: float) -> np.ndarray:
    half = radians(degrees) / 2
    q = np.zeros(4)
    q["xyz".index(axis)], q[3] = sin(half), cos(half)
    return q


def same_turn(a: np.ndarray, b: np.ndarray, atol: float = 1e-9) -> None:
    assert abs(abs(float(a @ b)) - 1.0) < atol


# Blend (eq. 13)


def test_votes_average_by_weight() -> None:
    votes = np.array([[1.0, 0, 0], [0.0, 1, 0], [0.0, 0, 5]])
    out = np.empty(3)
    blend_point(votes, np.array([1.0, 1.0, 0.1]), np.zeros(3), out)
    np.testing.assert_allclose(out, [1 / 2.1, 1 / 2.1, 0.5 / 2.1])


def test_who_abstains_does_not_count_and_all_abstaining_keeps_the_start() -> None:
    votes = np.array([[1.0, 2, 3], [9.0, 9, 9]])
    out = np.empty(3)
    blend_point(votes, np.array([1.0, 0.0]), np.zeros(3), out)
    np.testing.assert_allclose(out, [1, 2, 3])
    blend_point(votes, np.zeros(2), np.array([4.0, 5, 6]), out)
    np.testing.assert_allclose(out, [4, 5, 6])


def test_turns_average_in_log_space_from_the_start() -> None:
    start = turn("y", 20)
    votes = np.array([turn("y", 20 + 60), turn("y", 20)])
    out = np.empty(4)
    blend_turn(votes, np.array([1.0, 0.5]), start, out)
    same_turn(out, turn("y", 60))  # 20 + 60 * 1 / 1.5


# Tracking (eqs 14-15)


def test_root_shift_is_the_least_that_brings_the_target_within_reach() -> None:
    out = np.empty(3)
    assert root_shift(np.array([0.0, 0, 0.8]), np.zeros(3), 0.5, out) == pytest.approx(0.3)
    np.testing.assert_allclose(out, [0, 0, 0.3])
    assert root_shift(np.array([0.3, 0, 0.3]), np.zeros(3), 0.5, out) == 0.0
    np.testing.assert_array_equal(out, 0.0)


def test_trunk_turns_by_the_shortest_arc_and_leaves_the_rest_to_the_pelvis() -> None:
    out, rest = np.empty(4), np.empty(3)
    back, shoulder = np.array([0.0, 1.0, 0.0]), np.array([0.0, 1.4, 0.0])
    reach_with_trunk(
        np.array([0.0, 0.0, 0.3]), shoulder, back, UNTURNED, 0.0, UNTURNED, FREE, out, rest
    )  # fmt: skip
    angle = atan2(0.3, 0.4)
    same_turn(out, turn("x", np.degrees(angle)))
    # The shoulder goes to 0.4 (sin, cos): 0.24 ahead and 0.08 down; 0.06 ahead and 0.08 up are left.
    np.testing.assert_allclose(rest, [0.0, 0.08, 0.06], atol=1e-9)


@pytest.mark.parametrize(
    ("axis", "degrees", "kept"), [("x", 60, 60), ("x", 120, 80), ("x", -60, -30), ("z", 70, 38), ("y", 90, 35)]
)
def test_lean_is_kept_within_a_backs_range(axis: str, degrees: float, kept: float) -> None:
    q = turn(axis, degrees)
    keep_lean(q, 0.0, UNTURNED, FREE)
    same_turn(q, turn(axis, kept))


def test_lean_counts_from_where_the_figure_faces() -> None:
    # Facing +X, forward is a turn about -Z.
    q = turn("z", -60)
    yaw = turn("y", 90)
    q = np.array([
        q[3] * yaw[0] + q[0] * yaw[3] + q[1] * yaw[2] - q[2] * yaw[1],
        q[3] * yaw[1] - q[0] * yaw[2] + q[1] * yaw[3] + q[2] * yaw[0],
        q[3] * yaw[2] + q[0] * yaw[1] - q[1] * yaw[0] + q[2] * yaw[3],
        q[3] * yaw[3] - q[0] * yaw[0] - q[1] * yaw[1] - q[2] * yaw[2],
    ])  # fmt: skip
    before = q.copy()
    keep_lean(q, pi / 2, yaw, FREE)
    same_turn(q, before)
    keep_lean(q, pi / 2, yaw, np.array([radians(20), 1.0]))
    assert abs(float(q @ before)) < 1.0 - 1e-3


class Held:
    """One followed point and its state."""

    def __init__(self, x: tuple[float, float, float], velocity: tuple[float, float, float] = (0, 0, 0)) -> None:
        self.x, self.velocity = np.array(x, dtype=float), np.array(velocity, dtype=float)
        self.before, self.aim = np.zeros(3), np.zeros(3)
        self.offset, self.rate = np.zeros(3), np.zeros(3)
        self.grabbed = True

    def step(self, target: tuple[float, float, float], dt: float, half_life: float = 0.1) -> np.ndarray:
        follow_point(
            np.array(target, dtype=float), self.before, self.grabbed, self.x, self.aim, self.velocity, self.offset,
            self.rate, 6.0, half_life, dt,
        )  # fmt: skip
        self.grabbed = False
        self.x = self.aim.copy()
        return self.x


def test_a_held_point_is_exactly_under_a_moving_target() -> None:
    held = Held((0.0, 1.0, 0.0))
    for n in range(60):
        held.step((0.01 * n, 1.0, 0.0), 1 / 60)
        assert held.x[0] == pytest.approx(0.01 * n, abs=1e-12)


def test_a_grab_evens_out_as_a_critically_damped_spring() -> None:
    held = Held((0.1, 0.0, 0.0))
    held.step((0.0, 0.0, 0.0), 0.1)
    y = 2 * np.log(2) / 0.1
    assert held.x[0] == pytest.approx(0.1 * (1 + y * 0.1) * exp(-y * 0.1))
    held = Held((0.0, 0.0, 0.0), velocity=(1.0, 0.0, 0.0))  # grabbed while it moves: goes on without a step
    held.step((0.0, 0.0, 0.0), 0.001)
    assert held.velocity[0] == pytest.approx(1.0, abs=0.03)


def test_a_jump_of_a_metre_does_not_pop_and_arrives() -> None:
    held = Held((0.0, 0.0, 0.0))
    held.step((0.0, 0.0, 0.0), 1 / 60)
    y = 2 * np.log(2) / 0.1
    speeds = []
    for _ in range(120):
        before = held.x[0]
        held.step((1.0, 0.0, 0.0), 1 / 60)
        speeds.append((held.x[0] - before) * 60)
    assert max(abs(np.diff([0.0, *speeds]))) <= y * y / 60  # the spring's largest acceleration, y² of a metre
    assert held.x[0] == pytest.approx(1.0, abs=1e-6)


# Balance (eqs 16-18)


def test_polygon_of_both_soles_and_of_one() -> None:
    points = np.zeros((5, 3))
    points[3], points[4] = (0.095, 0.085, 0.0), (-0.095, 0.085, 0.0)
    feet = np.array([UNTURNED, UNTURNED])
    hull = np.empty((18, 2))
    size = sole_polygon(RIG, points, feet, np.array([1.0, 1.0]), hull)
    assert size == 4
    np.testing.assert_allclose(hull[:4].min(axis=0), [-0.137, -0.055], atol=1e-9)
    np.testing.assert_allclose(hull[:4].max(axis=0), [0.137, 0.210], atol=1e-9)
    size = sole_polygon(RIG, points, feet, np.array([1.0, 0.0]), hull)
    np.testing.assert_allclose(hull[:size].min(axis=0), [0.053, -0.055], atol=1e-9)
    assert sole_polygon(RIG, points, feet, np.zeros(2), hull) == 0


def test_shift_back_over_the_support_is_shared() -> None:
    hull = np.array([[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]])
    shift, part, out = np.empty(3), np.empty(3), np.empty(4)
    balance_shift(hull, 4, np.array([0.15, 1.0, 0.0]), 0.02, shift)
    np.testing.assert_allclose(shift, [-0.07, 0, 0], atol=1e-9)
    pelvis_correction(shift, 0.5, 0.7, part)
    np.testing.assert_allclose(part, [-0.05, 0, 0], atol=1e-9)  # 0.5 * 0.07 / 0.7
    trunk_correction(shift, 0.5, 0.7, np.array([0.0, 1.5, 0.0]), np.array([0.0, 1.0, 0.0]), UNTURNED, out)
    same_turn(out, turn("z", np.degrees(atan2(0.05, 0.5))))  # the chest 0.5 above the back goes 0.05 to -X
    balance_shift(hull, 4, np.array([0.03, 1.0, 0.0]), 0.02, shift)
    np.testing.assert_array_equal(shift, 0.0)


# Interaction (eqs 19-22)


def test_a_moved_hand_takes_the_trunk_along() -> None:
    out = np.empty(4)
    trunk_from_ends(
        np.array([0.0, 0.0, 0.05]), np.array([0.0, 1.4, 0.0]), np.array([0.0, 1.0, 0.0]), 2.0, UNTURNED, out
    )
    same_turn(out, turn("x", np.degrees(atan2(0.1, 0.4))))  # 2.0 * 0.05 at a lever of 0.4


def test_a_turned_trunk_takes_free_hands_along() -> None:
    out = np.empty(3)
    hand, back = np.array([0.0, 1.0, 0.5]), np.array([0.0, 1.0, 0.0])
    end_from_trunk(hand, back, UNTURNED, turn("y", 90), np.array([0.0, 0.1, 0.0]), 0.2, out)
    # The lever goes from (0, 0, 0.5) to (0.5, 0, 0); a fifth of that and of the pelvis's way.
    np.testing.assert_allclose(out, hand + 0.2 * np.array([0.5, 0.1, -0.5]), atol=1e-9)


# Relaxing (eqs 23-26)


def test_trunk_comes_upright_at_its_speed() -> None:
    q, spin = turn("x", 60), np.array([-0.5, 0.0, 0.0])  # at full speed already
    relax_turn(q, spin, UNTURNED, 0.5, 0.2, 0.05, 0.4)
    same_turn(q, turn("x", 60 - np.degrees(0.5 * 0.4)))


def test_relaxing_starts_with_the_velocity_that_was_there_and_ends_at_rest() -> None:
    x, v = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.8, 0.0])
    before = x.copy()
    relax_point(x, v, np.zeros(3), 0.3, 0.2, 0.05, 1e-4)
    assert (x[1] - before[1]) / 1e-4 == pytest.approx(0.8, abs=0.01)
    for _ in range(600):
        relax_point(x, v, np.zeros(3), 0.3, 0.2, 0.05, 1 / 60)
    np.testing.assert_allclose(x, 0.0, atol=1e-6)
    np.testing.assert_allclose(v, 0.0, atol=1e-5)


def test_a_hand_sinks_on_an_arc_at_its_speed() -> None:
    rest = np.array([0.0, -0.5, 0.0])
    arm = np.array([0.5, 0.0, 0.0])
    v = np.array([0.0, -0.3, 0.0])
    relax_hand(arm, v, rest, np.array([1.0, 0, 0]), 0.28, 0.25, 0.3, 0.2, 0.05, 0.01)
    assert np.linalg.norm(arm) == pytest.approx(0.5, abs=1e-4)
    assert atan2(-arm[1], arm[0]) == pytest.approx(0.3 * 0.01 / 0.5, rel=0.01)
    for _ in range(1200):
        relax_hand(arm, v, rest, np.array([1.0, 0, 0]), 0.28, 0.25, 0.3, 0.2, 0.05, 0.01)
    np.testing.assert_allclose(arm, rest, atol=1e-4)


def test_a_hand_overhead_comes_down_outward_not_through_the_face() -> None:
    rest = np.array([0.08, -0.5, 0.05])
    arm = np.array([-0.10, 0.48, 0.05])  # up and inward
    v, low = np.zeros(3), 1.0
    for _ in range(1500):
        relax_hand(arm, v, rest, np.array([0.85, 0, 0.5]), 0.28, 0.25, 0.3, 0.2, 0.05, 0.01)
        if abs(arm[1]) < 0.1:
            low = min(low, arm[0])
    assert low > 0.2
    np.testing.assert_allclose(arm, rest, atol=1e-3)


def test_a_carried_hand_that_hangs_still_hangs() -> None:
    before, now = np.array([0.1, -0.5, 0.0]), np.array([0.0, -0.5, -0.1])
    arm = before.copy()
    carry_hand(arm, before, now)
    np.testing.assert_allclose(arm, now, atol=1e-9)


@settings(deadline=None)
@given(st.floats(-3.1, 3.1))
def test_yaw_and_twist_are_inverse(heading: float) -> None:
    q = np.empty(4)
    yaw_turn(heading, q)
    assert twist_of(q) == pytest.approx(heading, abs=1e-9)


# Legs


def test_pelvis_comes_down_to_what_the_legs_reach() -> None:
    points = np.zeros((5, 3))
    points[3], points[4] = (0.095, 0.085, 0.0), (-0.095, 0.085, 0.0)
    hips = np.array([[0.095, -0.035, 0.0], [-0.095, -0.035, 0.0]])
    feet = np.array([UNTURNED, UNTURNED])
    pelvis = np.array([0.0, 1.3, 0.0])
    keep_pelvis_over_feet(RIG, RIG.reach[:, 1], pelvis, hips, points, feet, np.ones(2), 0.55, False, True, True)
    np.testing.assert_allclose(pelvis, [0.0, 0.085 + RIG.reach[2, 1] + 0.035, 0.0], atol=1e-5)
    pelvis = np.array([0.0, 0.1, 0.0])
    keep_pelvis_over_feet(RIG, RIG.reach[:, 1], pelvis, hips, points, feet, np.ones(2), 0.55, False, True, True)
    assert pelvis[1] > 0.5
    assert pelvis[2] < -0.05  # the seat goes back, for shins lean only so far


def test_pelvis_stays_near_its_feet() -> None:
    points = np.zeros((5, 3))
    points[3], points[4] = (0.1, 0.085, 0.0), (-0.1, 0.085, 0.0)
    pelvis = np.array([0.5, 0.9, 0.4])
    moved = keep_near_feet(points, np.ones(2), pelvis)
    assert moved > 0.3
    np.testing.assert_allclose(pelvis, [0.13, 0.9, 0.17], atol=1e-9)


def test_feet_come_down_apart() -> None:
    out = np.empty(3)
    landing_place(RIG, 0, np.array([-0.3, 0.5, 0.1]), np.array([-0.1, 0.085, 0.0]), True, 0.0, out)
    np.testing.assert_allclose(out, [-0.1 + 0.12, 0.085, 0.1])  # not across the other foot
    landing_place(RIG, 1, np.array([-0.3, 0.5, 0.1]), np.array([0.1, 0.085, 0.0]), True, 0.0, out)
    np.testing.assert_allclose(out, [-0.3, 0.085, 0.1])  # straight below
    landing_place(RIG, 1, np.array([0.0, 0.5, 0.3]), np.array([0.0, 0.085, 0.0]), True, pi / 2, out)
    np.testing.assert_allclose(out, [0.0, 0.085, 0.3], atol=1e-9)  # facing +X, the right is +Z


def test_home_is_over_both_feet_or_the_one_that_stands() -> None:
    points = np.zeros((5, 3))
    points[3], points[4] = (0.2, 0.085, 0.1), (-0.2, 0.3, -0.1)
    out = np.empty(3)
    pelvis_home(RIG, points, np.ones(2), 0.0, out)
    np.testing.assert_allclose(out[[0, 2]], 0.0, atol=1e-9)
    pelvis_home(RIG, points, np.array([1.0, 0.0]), 0.0, out)
    assert out[0] > 0.19


def test_raised_thighs_leave_less_room_to_lean() -> None:
    positions = np.array(RIG.rest_positions)
    room = np.empty(2)
    lean_room(RIG, positions, np.ones(2), 0.0, room)
    np.testing.assert_allclose(room, FREE)
    for side in (2, 3):
        hip, knee = RIG.limbs[side, 0], RIG.limbs[side, 1]
        positions[knee] = positions[hip] + [0.0, 0.0, 0.42]
    lean_room(RIG, positions, np.ones(2), 0.0, room)
    assert room[0] < radians(45)
    assert room[1] < 0.3


@pytest.mark.parametrize("side", [0, 1])
def test_a_leg_under_a_held_pelvis_stretches_ever_slower(side: int) -> None:
    exact, planted, out = np.array([0.5, 0.5, 0.8, 0.8]), np.zeros(2), np.empty(4)
    planted[side] = 1.0
    positions, points = np.array(RIG.rest_positions), np.zeros((5, 3))
    points[3 + side] = positions[RIG.limbs[2 + side, 0]] - [0.0, 0.7, 0.0]
    reach_gently(RIG, exact, positions, points, planted, True, 0.02, out)
    # Of the 10 cm that are left, all but e^-0.2 in 0.02 s; the other leg is in the air.
    assert out[2 + side] == pytest.approx(0.8 - 0.1 * exp(-0.2))
    assert out[3 - side] == 0.8
    # Two steps are one of twice the time.
    once = 0.8 - 0.1 * exp(-0.4)
    points[3 + side] = positions[RIG.limbs[2 + side, 0]] - [0.0, out[2 + side], 0.0]
    reach_gently(RIG, exact, positions, points, planted, True, 0.02, out)
    assert out[2 + side] == pytest.approx(once)
    reach_gently(RIG, exact, positions, points, planted, False, 0.02, out)
    np.testing.assert_array_equal(out, exact)


def test_a_turned_knee_goes_back_at_its_speed_at_most() -> None:
    assert turn_back(0.4, 1.0, 0.25) == pytest.approx(0.2)  # half of it in a half-life
    assert turn_back(0.4, 0.01, 0.25) == pytest.approx(0.39)
    assert turn_back(-0.4, 0.01, 0.25) == pytest.approx(-0.39)
    assert turn_back(1e-4, 0.01, 0.25) == pytest.approx(5e-5)


@given(st.floats(-0.4, 0.4), st.floats(-0.9, 0.9), st.floats(-0.4, 0.4))
@settings(max_examples=60, deadline=None)
def test_a_joint_is_kept_in_its_range_and_none_is_moved_in_it(x: float, y: float, z: float) -> None:
    limits, ankle = limits_of(default_figure()), RIG.limbs[2, 2]
    q = np.array([x, y, z, 0.0])
    q[3] = sqrt(max(0.0, 1.0 - float(q @ q)))
    q /= np.linalg.norm(q)
    excess, kept = joint_excess(limits, ankle, q), q.copy()
    assert keep_in_range(limits, ankle, kept) == (excess > 0.0)
    if excess <= 0.0:
        np.testing.assert_array_equal(kept, q)
    assert joint_excess(limits, ankle, kept) < radians(0.5)
    if excess < 0.002:
        # Just beyond it, it is moved just a little.
        assert 2.0 * np.arccos(min(1.0, abs(float(kept @ q)))) < 0.02


def test_a_straight_knee_is_moved_slowly() -> None:
    hip = np.array([0.0, 0.9, 0.0])
    down = np.array([0.0, -0.3, 0.0])
    straight = knee_pace(RIG, 2, hip, np.array([0.0, 0.9 - 0.82, 0.0]), down)
    bent = knee_pace(RIG, 2, hip, np.array([0.0, 0.9 - 0.55, 0.0]), down)
    assert straight < 0.5 * bent
    assert knee_pace(RIG, 2, hip, np.array([0.0, 0.3, 0.0]), np.array([0.1, 0.0, 0.0])) == 1.0


# Step (eq. 29)


def test_feet_keep_their_place_against_the_pelvis() -> None:
    out = np.empty(3)
    foot_goal(np.array([1.0, 0, 2.0]), np.array([0.1, 0.085, -0.05]), np.zeros(3), 0.0, out)
    np.testing.assert_allclose(out, [1.1, 0.085, 1.95])
    foot_goal(np.zeros(3), np.array([0.1, 0.085, 0.0]), np.zeros(3), pi / 2, out)
    np.testing.assert_allclose(out, [0.0, 0.085, -0.1], atol=1e-9)  # turned to the left


def test_the_nearer_foot_goes_first() -> None:
    left, right = np.array([0.1, 0.085, 0.0]), np.array([-0.1, 0.085, 0.0])
    assert first_foot(np.array([0.6, 0, 0.0]), left, right) == 0
    assert first_foot(np.array([-0.6, 0, 0.0]), left, right) == 1


def test_minimum_jerk_starts_and_ends_at_rest() -> None:
    assert minimum_jerk(0.0) == 0.0
    assert minimum_jerk(0.5) == pytest.approx(0.5)
    assert minimum_jerk(1.0) == 1.0
    assert minimum_jerk(1e-4) < 1e-10
    assert 1.0 - minimum_jerk(1 - 1e-4) < 1e-10


def test_wrap() -> None:
    assert wrap(3 * pi / 2) == pytest.approx(-pi / 2)
    assert wrap(-7.0) == pytest.approx(-7.0 + 2 * pi)


@pytest.mark.parametrize("dt", [1 / 30, 1 / 60, 1 / 120, 0.0037])
def test_a_whole_step_ends_at_its_goal_with_one_foot_down_all_the_time(dt: float) -> None:
    step, points, planted = np.zeros(32), np.zeros((5, 3)), np.ones(2)
    points[3], points[4] = (0.095, 0.085, 0.0), (-0.095, 0.085, 0.0)
    pelvis, home = np.array([0.0, 0.93, 0.0]), np.array([0.0, 0.93, 0.0])
    yaws, ankles = np.zeros(2), np.array([0.085, 0.085])
    begin_step(step, np.array([0.6, 0, 0.2]), 0.0, 0.3, pelvis, home, points[3], points[4], 0.24, 0.4)
    assert step[FIRST] == 0.0
    goals = step[LEFT : LEFT + 3].copy(), step[RIGHT : RIGHT + 3].copy()
    lifted, frames = [0.0, 0.0], 0
    stood = [points[3].copy(), points[4].copy()]
    while step[PHASE] != IDLE:
        advance_step(step, pelvis, points, yaws, planted, ankles, 0.07, 0.24, 0.4, dt)
        frames += 1
        assert frames * dt < 3.0
        assert planted.sum() >= 1.0
        for side in range(2):
            lifted[side] = max(lifted[side], points[3 + side, 1] - 0.085)
            if planted[side] > 0.5:
                near = min(np.linalg.norm(points[3 + side] - p) for p in (stood[side], goals[side]))
                assert near < 1e-9  # planted means exactly there
    np.testing.assert_allclose(pelvis[[0, 2]], [0.6, 0.2], atol=1e-9)
    np.testing.assert_allclose(points[3], goals[0], atol=1e-9)
    np.testing.assert_allclose(points[4], goals[1], atol=1e-9)
    np.testing.assert_allclose(yaws, 0.3, atol=1e-9)
    assert min(lifted) > 0.05


# Packing


def test_packed_records_come_back() -> None:
    again = unpack_rig(*pack_rig(RIG))
    for name, a, b in zip(RIG._fields, RIG, again, strict=True):
        np.testing.assert_array_equal(a, b, err_msg=name)
    gains = Gains()
    assert unpack_gains(np.array(gains)) == gains
    buffer = np.arange(1000.0)
    state = unpack_state(buffer)
    numbers = np.concatenate([a.ravel() for a in state])
    np.testing.assert_array_equal(numbers, np.arange(len(numbers)))  # every number once, in order
    under = unpack_under(np.arange(91.0 + 8 * 21), 21)
    flat = [a for a in under if isinstance(a, np.ndarray)] + list(under.base)
    assert sorted(np.concatenate([a.ravel() for a in flat])) == list(range(91 + 8 * 21))
    assert sqrt(under.base.rotations_ls.size) == sqrt(84)
