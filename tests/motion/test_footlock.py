import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bunraku.figure.default import default_figure
from bunraku.figure.fk import fk
from bunraku.figure.limits import limit_excess
from bunraku.figure.metrics import floor_penetration, self_penetration
from bunraku.motion import rotation as rot
from bunraku.motion.clip import Clip
from bunraku.motion.constraint import path_of
from bunraku.motion.footlock import FREE, LOCKED, feet_of
from bunraku.motion.footprint import planted, print_under, roll_of, soft_part, sole_depth, yaw_pitch
from bunraku.motion.ground import Heightfield, lowest, roll, rolled, sole_of
from bunraku.motion.leg import move_leg
from bunraku.motion.player import Player
from bunraku.motion.synth import builtin_set


def _soles(player: Player):
    """Where heel and ball of each foot are, and its pitch."""
    places, turns = fk(player.skeleton, player.root, player.rotations)
    out = []
    for side in range(2):
        height, heel, ball = (float(v) for v in player.feet.soles[side])
        foot = int(player.feet.joints[side, 2])
        points = [places[foot] + rot.rotate(turns[foot], np.array([0.0, -height, z])) for z in (heel, ball)]
        out.append((points, float(rot.rotate(turns[foot], np.array([0.0, 0.0, 1.0]))[1])))
    return out


@given(st.floats(-1.2, 0.6))
@settings(deadline=None)
def test_a_rolling_foot_stands_on_heel_or_ball(pitch):
    sole = sole_of(default_figure(), "left")
    out = np.empty(2)
    roll(sole.height, sole.heel, sole.ball, pitch, out)
    np.testing.assert_allclose(out, rolled(sole, np.array(pitch)))
    pivot = sole.heel if pitch >= 0 else sole.ball
    # The pivot's place, from the ankle, is where it is when the foot is flat.
    c, s = np.cos(pitch), np.sin(pitch)
    y = out[0] - sole.height * c + pivot * s
    z = out[1] + sole.height * s + pivot * c
    assert (y, z) == (pytest.approx(0.0, abs=1e-12), pytest.approx(pivot))
    assert lowest(sole, np.array(out[0]), np.array(pitch), np.array(max(-pitch, 0.0))) > -1e-9


@given(st.integers(0, 10**6))
@settings(max_examples=60, deadline=None)
def test_a_leg_that_is_put_where_it_is_stays_as_it_is_and_else_gets_there(seed):
    figure, random = default_figure(), np.random.default_rng(seed)
    feet = feet_of(figure)
    rotations = rot.exp(random.normal(0.0, 0.2, (len(figure), 3)))
    hip, knee, foot = (figure.role("left" + part) for part in ("UpperLeg", "LowerLeg", "Foot"))
    rotations[hip] = rot.exp(np.array([random.uniform(-1.0, 0.4), random.normal(0, 0.2), random.normal(0, 0.1)]))
    rotations[knee] = rot.exp(np.array([random.uniform(0.3, 1.5), 0.0, 0.0]))
    places, turns = fk(figure, np.array([0.0, 0.9, 0.0]), rotations)
    local, lengths = rotations.copy(), feet.lengths[0]
    before = places.copy(), turns.copy()
    beyond = move_leg(
        figure.parents, feet.joints[0], places, turns, local, before[0][foot].copy(), before[1][foot].copy(),
        lengths[0], lengths[1], lengths.sum(),
    )  # fmt: skip
    assert beyond == 0.0
    np.testing.assert_allclose(np.abs(np.sum(local * rotations, axis=1)), 1.0, atol=1e-6)
    goal = before[0][foot] + random.normal(0.0, 0.08, 3)
    beyond = move_leg(figure.parents, feet.joints[0], places, turns, local, goal, before[1][foot].copy(),
                      lengths[0], lengths[1], 0.9985 * lengths.sum())  # fmt: skip
    again, again_turns = fk(figure, np.array([0.0, 0.9, 0.0]), local)
    np.testing.assert_allclose(again[foot], places[foot], atol=1e-9)
    assert np.linalg.norm(again[foot] - goal) <= beyond + 1e-6
    assert abs(np.sum(again_turns[foot] * before[1][foot])) == pytest.approx(1.0, abs=1e-9)


@given(st.floats(-1.1, 0.6), st.floats(-0.3, 0.3), st.floats(-3.0, 3.0), st.floats(-0.25, 0.25))
@settings(deadline=None)
def test_a_foot_on_its_print_rolls_and_leans_about_heel_or_ball(pitch, lean, yaw, slope):
    feet = feet_of(default_figure())
    mark = np.array([0.3, 0.1, -0.7, yaw, slope])
    position, turn, flat, flat_turn = np.empty(3), np.empty(4), np.empty(3), np.empty(4)
    planted(feet, 0, mark, pitch, lean, position, turn)
    planted(feet, 0, mark, 0.0, 0.0, flat, flat_turn)
    height, heel, ball = feet.soles[0]
    arm = np.array([0.0, -height, heel if pitch >= 0.0 else ball])
    np.testing.assert_allclose(position + rot.rotate(turn, arm), flat + rot.rotate(flat_turn, arm), atol=1e-12)
    angles = np.empty(2)
    yaw_pitch(turn, angles)
    assert angles[1] == pytest.approx(pitch + slope, abs=1e-9)
    assert roll_of(turn) == pytest.approx(lean, abs=1e-9)


@given(st.integers(0, 10**6))
@settings(max_examples=60, deadline=None)
def test_the_print_of_a_foot_lies_under_what_it_stands_on(seed):
    random = np.random.default_rng(seed)
    feet, mark = feet_of(default_figure()), np.empty(5)
    slope = random.uniform(-0.4, 0.4) if seed % 2 else 0.0
    wanted = np.array([*random.normal(0.0, 2.0, 3), random.uniform(-3, 3), slope])
    ankle, turn, again, turned = np.empty(3), np.empty(4), np.empty(3), np.empty(4)
    pitch, lean = random.uniform(-1.0, 0.5), random.uniform(-0.3, 0.3)
    planted(feet, 1, wanted, pitch, lean, ankle, turn)
    if slope == 0.0:
        assert sole_depth(feet, 1, ankle, turn, float(wanted[1])) == pytest.approx(0.0, abs=1e-9)
    under = wanted[1] + feet.soles[1, 1 if pitch >= 0.0 else 2] * np.sin(slope)
    ankle[1] += 0.02
    print_under(feet, 1, ankle, turn, float(under), slope, mark)
    np.testing.assert_allclose(mark, wanted, atol=1e-9)
    planted(feet, 1, mark, pitch, lean, again, turned)
    np.testing.assert_allclose(again, ankle - np.array([0.0, 0.02, 0.0]), atol=1e-9)


@given(st.floats(-0.1, 0.1), st.floats(1e-6, 0.05))
def test_the_soft_part_is_never_less_than_the_positive_part(x, width):
    assert max(x, 0.0) - 1e-12 <= soft_part(x, width) <= max(x, 0.0) + 0.25 * width + 1e-12
    assert abs(soft_part(x + 1e-9, width) - soft_part(x, width)) <= 1.01e-9


def _velocity_steps(rotations) -> np.ndarray:
    """(F - 2, J) degrees/s by which each joint's velocity changes from one frame to the next, 60 a second."""
    rotations = np.array(rotations)
    speeds = rot.log(rot.mul(rotations[1:], rot.inverse(rotations[:-1]))) * 60.0
    return np.degrees(np.linalg.norm(np.diff(speeds, axis=0), axis=-1))


@pytest.mark.parametrize("speed", [0.9, 1.5, 2.0, 2.6])
def test_a_leg_that_is_let_go_makes_no_jerk(speed):
    motion_set = builtin_set()
    player = Player(motion_set)
    t = np.linspace(0.0, 5.0, 200)
    player.follow(path_of(np.stack([0.6 * np.sin(1.7 * t), t], -1), speeds=np.full(200, speed)))
    turns, released = [], []
    for _ in range(500):
        was = player.state.mode.copy()
        player.update(1 / 60)
        turns.append(player.rotations.copy())
        if ((was == LOCKED) & (player.state.mode == FREE)).any():
            released.append(len(turns) - 1)
        if player.free:
            break
    sources = max(_velocity_steps(e.clip.rotations).max() for e in motion_set.module("locomotion").examples)
    steps = _velocity_steps(turns).max(axis=1)
    assert len(released) > 4
    at_release = max(float(steps[max(k - 2, 0) : k + 2].max()) for k in released)
    assert at_release < 0.85 * sources  # and 1.0 is what the sources themselves have
    assert steps.max() < sources


@pytest.mark.parametrize("speed", [0.6, 1.4, 3.2])
def test_locked_feet_do_not_move(speed):
    player = Player(builtin_set())
    t = np.linspace(0.0, 3.0, 100)
    player.follow(path_of(np.stack([1.5 - 1.5 * np.cos(t), 1.5 * np.sin(t)], -1), speeds=np.full(100, speed)))
    held: dict[tuple[int, int], np.ndarray] = {}
    worst = 0.0
    for _ in range(600):
        player.update(1 / 60)
        for side, (points, pitch) in enumerate(_soles(player)):
            for k, bears in ((0, pitch > -1e-3), (1, pitch < 1e-3)):
                if player.state.mode[side] == LOCKED and bears:
                    start = held.setdefault((side, k), points[k])
                    worst = max(worst, float(np.hypot(*(points[k] - start)[[0, 2]])))
                else:
                    held.pop((side, k), None)
        assert player.beyond < 1e-9
        if player.free:
            break
    assert worst < 0.002


def test_without_the_lock_the_pose_is_as_blended():
    locked, free = Player(builtin_set()), Player(builtin_set(), lock=False)
    for player in (locked, free):
        player.follow(path_of([[0, 0], [1.0, 1.5], [3.0, 1.5]]))
    gap = 0.0
    for _ in range(120):
        locked.update(1 / 60)
        free.update(1 / 60)
        assert not free.contacts.any()
        gap = max(gap, float(np.abs(locked.rotations - free.rotations).max()))
    assert gap > 0.01


def test_a_figure_that_stands_wrong_settles_its_feet():
    player = Player(builtin_set())
    player.follow(path_of([[0, 0], [0, 1.5]]))
    for _ in range(500):
        player.update(1 / 60)
    assert player.free
    for side, sign in enumerate((1.0, -1.0)):
        mark = player.state.prints[side]
        assert mark[2] == pytest.approx(1.5, abs=0.06)
        assert mark[0] * sign == pytest.approx(player.feet.lengths.sum() / 2 * 0.109, abs=0.05)


@pytest.mark.parametrize("slope", [-0.18, 0.0, 0.18])
def test_feet_stand_on_a_slope(slope):
    field = Heightfield(slope * np.linspace(-1, 5, 61)[:, None] * np.ones((1, 61)), 0.1, -3.0, -1.0)
    player = Player(builtin_set(), ground=field)
    player.follow(path_of([[0, 0], [0, 3.0]]))
    for frame in range(400):
        player.update(1 / 60)
        for side, (points, pitch) in enumerate(_soles(player)):
            settled = player.state.mode[side] == LOCKED and np.abs(player.state.offset[side]).max() < 0.004
            if frame > 30 and settled and abs(pitch - np.sin(player.state.prints[side, 4])) < 0.02:
                for point in points:
                    assert point[1] == pytest.approx(field(float(point[0]), float(point[2])), abs=0.012)
        assert player.beyond < 1e-6
    assert player.place.z == pytest.approx(3.0, abs=0.01)
    assert player.root[1] == pytest.approx(0.92 + slope * 3.0, abs=0.06)


@pytest.mark.parametrize(("speed", "begin"), [(0.8, 2.9), (1.3, 2.5), (2.4, 3.1), (3.2, 2.5)])
def test_feet_stay_where_they_stand_on_a_kerb_and_none_is_thrown_up(speed, begin):
    """A kerb 12 cm high, up and down again within 30 cm: contact points stay, prints lie on it, no leg jerks."""
    z = -2.0 + 0.025 * np.arange(400)
    rise = np.clip((z - begin) / 0.3, 0.0, 1.0) - np.clip((z - begin - 2.1) / 0.3, 0.0, 1.0)
    field = Heightfield(0.12 * rise[:, None] * np.ones((1, 401)), 0.025, -5.0, -2.0)
    player = Player(builtin_set(), ground=field)
    player.follow(path_of([[0, 0], [0, 7.0]], speeds=[speed, speed]))
    held = [[], []]  # per side: marks of the present lock, places of its contact point
    turned, rates = [], []
    for _ in range(1500):
        player.update(1 / 60)
        turned.append(player.rotations.copy())
        for side, (points, pitch) in enumerate(_soles(player)):
            mark = player.state.prints[side]
            if player.state.mode[side] != LOCKED:
                held[side].clear()
                continue
            _, heel, ball = player.feet.soles[side]
            for end in (heel, ball):
                along = end * np.cos(mark[4])
                x, at = mark[0] + along * np.sin(mark[3]), mark[2] + along * np.cos(mark[3])
                assert mark[1] + end * np.sin(mark[4]) == pytest.approx(field(x, at), abs=1e-3)
            which = 0 if pitch > np.sin(mark[4]) else 1
            held[side].append((which, points[which][[0, 2]]))
            same = [place for one, place in held[side] if one == which]
            assert np.linalg.norm(same[-1] - same[0]) < 0.5e-3
        if player.free:
            break
    assert player.place.z == pytest.approx(7.0, abs=0.02)
    turned = np.array(turned)
    rates = rot.log(rot.mul(turned[1:], rot.inverse(turned[:-1]))) * 60.0
    assert np.degrees(np.linalg.norm(np.diff(rates, axis=0), axis=-1)).max() < 800.0


@pytest.mark.parametrize("length", [0.3, 0.35, 0.45, 0.6])
def test_a_walk_of_less_than_two_steps_ends_with_both_feet_beside_each_other(length):
    player = Player(builtin_set())
    player.follow(path_of([[0, 0], [0, length]], speeds=[1.4, 1.4]))
    slid = np.zeros(2)
    before = player.state.ankle.copy()
    for _ in range(200):
        player.update(1 / 60)
        ankle = player.state.ankle
        low = (ankle[:, 1] < 0.092) & (before[:, 1] < 0.092)
        slid += low * np.hypot(ankle[:, 0] - before[:, 0], ankle[:, 2] - before[:, 2])
        before = ankle.copy()
    assert slid.max() < 0.06
    assert list(player.state.mode) == [LOCKED, LOCKED]
    assert abs(player.state.ankle[0, 2] - player.state.ankle[1, 2]) < 0.05


@pytest.mark.parametrize(("speed", "bend"), [(1.3, 0.0), (2.0, 0.0), (2.3, 0.35), (3.4, 0.0)])
def test_toes_keep_out_of_the_ground(speed, bend):
    """Feet that leave the ground, blended of walks and runs, point down by up to 76 degrees."""
    player = Player(builtin_set())
    turned = bend * np.arange(0.0, 14.0, 0.05)
    way = 0.05 * np.cumsum(np.stack([np.sin(turned), np.cos(turned)], -1), axis=0)
    player.follow(path_of(way, speeds=np.full(len(way), speed)))
    soles = [sole_of(player.skeleton, side) for side in ("left", "right")]
    lowest_tip = 0.0
    for _ in range(300):
        player.update(1 / 60)
        places, turns = fk(player.skeleton, player.root, player.rotations)
        for sole in soles:
            down = sole.height + float(player.skeleton.offsets[sole.toes, 1])
            tip = places[sole.toes] + rot.rotate(turns[sole.toes], np.array([0.0, -down, sole.tip - sole.ball]))
            lowest_tip = min(lowest_tip, float(tip[1]))
    assert lowest_tip > -0.03


@pytest.mark.parametrize("height", [0.2, 0.36, 0.52])
def test_a_jump_takes_off_with_knees_that_stretch_smoothly(height):
    motion_set = builtin_set()
    player = Player(motion_set)
    player.move("jump_up", [height])
    turns = []
    while not player.free:
        player.update(1 / 60)
        turns.append(player.rotations.copy())
    sources = max(_velocity_steps(e.clip.rotations).max() for e in motion_set.module("jump_up").examples)
    assert _velocity_steps(turns).max() < sources


def _played(kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Roots (F, 3) and rotations (F, J, 4) of a figure that walks, runs, ducks and stops, turns or jumps."""
    player = Player(builtin_set())
    if kind.startswith("turn"):
        player.move("turn_left", [2.0])
    elif kind.startswith("jump"):
        player.move(kind, {"jump_back": [np.pi, 0.5], "jump_left": [1.6, 0.6], "jump_up": [0.4]}[kind])
    else:
        speed, duck = {"walk": (1.3, 0.0), "run": (2.8, 0.0), "duck": (1.2, 0.8)}[kind]
        points = np.array([[0.3 * np.sin(z), z] for z in np.arange(0.0, 4.0, 0.05)])
        postures = np.tile([0.0, 0.0, duck], (len(points), 1))
        postures[50:] = 0.0
        player.follow(path_of(points, speeds=np.full(len(points), speed), postures=postures))
    roots, turns = [], []
    for _ in range(600):
        player.update(1 / 60)
        roots.append(player.root.copy())
        turns.append(player.rotations.copy())
        if player.free and len(turns) > 60:
            break
    for _ in range(40):
        player.update(1 / 60)
        roots.append(player.root.copy())
        turns.append(player.rotations.copy())
    return np.array(roots), np.array(turns)


@pytest.mark.parametrize("kind", ["walk", "run", "duck", "turn", "jump_back", "jump_left", "jump_up"])
def test_what_is_played_keeps_joints_in_their_ranges_and_boxes_out_of_the_floor_and_each_other(kind):
    figure = default_figure()
    clip = Clip(kind, figure, 60.0, *_played(kind))
    excess = np.degrees(limit_excess(figure, clip.rotations)).max(axis=0)
    if kind == "run":  # one that stops at once trails a planted leg
        thighs = [figure.role(side + "UpperLeg") for side in ("left", "right")]
        assert excess[thighs].max() < 15.0
        excess[thighs] = 0.0
    assert excess.max() < 1.0, figure.names[int(excess.argmax())]
    assert floor_penetration(figure, *clip.world).max() < 0.015
    assert self_penetration(figure, *clip.world).max() < 0.04
