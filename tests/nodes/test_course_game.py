"""The course's rules by hand-worked numbers: tiles, obstacles on their tracks, course-outs, collisions, the score."""

from math import hypot, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bunraku.nodes.course.game import Game, Rules, Score, Seen, gap
from bunraku.nodes.course.stages import Obstacle, Stage, beam, inside, low_bar, pillar, ribbon, square, stages

NOWHERE = (np.array([[0.0, 50.0, 0.0]]), np.array([[0.0, 51.0, 0.0]]), np.array([[0.1, 0.1]]))
"""A body far above everything."""


def seen(
    x: float,
    z: float,
    *,
    feet: tuple[float, float] = (0.1, 0.0),
    standing: tuple[bool, bool] = (True, True),
    body: tuple[np.ndarray, np.ndarray, np.ndarray] = NOWHERE,
) -> Seen:
    """A figure at (x, z) whose feet stand ``feet[0]`` m to the sides and ``feet[1]`` m ahead."""
    side, ahead = feet
    return Seen((x, z), np.array([[x + side, z + ahead], [x - side, z + ahead]]), standing, *body)


def line(*obstacles: Obstacle) -> Stage:
    """Three tiles of 1 m, 1 m wide: start -0.5..0.5, one more, goal 1.5..2.5."""
    return Stage("line", "", ribbon([(0.0, -0.5), (0.0, 0.5), (0.0, 1.5), (0.0, 2.5)], 1.0), obstacles)


def test_a_place_is_on_a_tile_its_rim_included() -> None:
    tiles = np.concatenate([square(0.0, 0.0, 1.0), square(2.0, 0.0, 1.0, 2.0)])
    found = inside(tiles, [(0.0, 0.0), (0.5, 0.5), (0.51, 0.0), (2.0, 0.99), (2.0, 1.01)])
    assert found.tolist() == [[True, False], [True, False], [False, False], [False, True], [False, False]]
    assert inside(tiles[:, ::-1], [(0.0, 0.0)])[0, 0], "either way round"


def test_a_ribbon_is_as_wide_as_asked_and_mitred_at_its_corners() -> None:
    tiles = ribbon([(0.0, 0.0), (0.0, 2.0), (3.0, 2.0)], 0.8)
    # The corner's rim runs from (-0.4, 2.4) to (0.4, 1.6): 45 degrees, 0.8 * sqrt(2) long.
    assert sorted(map(tuple, tiles[0].round(9).tolist())) == sorted([(0.4, 0.0), (-0.4, 0.0), (-0.4, 2.4), (0.4, 1.6)])
    assert hypot(*(tiles[0][1] - tiles[0][2])) == pytest.approx(0.8 * 2**0.5)
    assert {tuple(p) for p in tiles[1].round(9).tolist()} >= {(3.0, 1.6), (3.0, 2.4)}


def test_an_obstacle_goes_to_and_fro_at_its_speed() -> None:
    one = pillar((0.0, 1.0), (2.0, 1.0), 0.5)
    assert [one.at(t)[0] for t in (0.0, 2.0, 4.0, 6.0, 8.0)] == pytest.approx([0.0, 1.0, 2.0, 1.0, 0.0])
    later = pillar((0.0, 1.0), (2.0, 1.0), 0.5, phase=0.25)
    assert later.at(0.0)[0] == pytest.approx(1.0)
    assert pillar((1.0, 1.0), (1.0, 1.0), 0.5).at(3.0) == (1.0, 1.0)


@given(st.floats(0.0, 1e4))
def test_an_obstacle_stays_on_its_track(t: float) -> None:
    for stage in stages():
        for one in stage.obstacles:
            x, z = one.at(t)
            away = hypot(x - one.begin[0], z - one.begin[1]) + hypot(x - one.end[0], z - one.end[1])
            assert away == pytest.approx(one.way, abs=1e-9)


def test_the_gap_between_round_bars() -> None:
    # Upright cone at the origin, radius 0.1 at the ground, 0.3 at 1 m; a level bar passes at 0.5 m height, 0.6 m away.
    starts, ends, radii = np.array([[0.0, 0.0, 0.0]]), np.array([[0.0, 1.0, 0.0]]), np.array([[0.1, 0.3]])
    bar = np.array([-1.0, 0.5, 0.6]), np.array([1.0, 0.5, 0.6])
    assert gap(starts, ends, radii, *bar, 0.05) == pytest.approx(0.6 - 0.2 - 0.05)
    # Beside the bar's end: its end is nearest.
    assert gap(starts, ends, radii, np.array([0.3, 0.5, 0.4]), np.array([2.0, 0.5, 0.4]), 0.05) == pytest.approx(0.25)
    # Parallel, and a ball for a cone.
    up = np.array([0.0, 0.2, 0.7]), np.array([0.0, 0.8, 0.7])
    level = np.array([[0.2, 0.2]])
    assert gap(starts, ends, level, *up, 0.1) == pytest.approx(0.4)
    assert gap(starts, starts, level, *up, 0.1) == pytest.approx(hypot(0.2, 0.7) - 0.3)


@given(st.lists(st.floats(-2.0, 2.0), min_size=12, max_size=12))
def test_no_pair_of_points_is_nearer_than_the_gap(numbers: list[float]) -> None:
    p = np.array(numbers).reshape(4, 3)
    found = gap(p[:1], p[1:2], np.zeros((1, 2)), p[2], p[3], 0.0)
    s, t = np.meshgrid(np.linspace(0, 1, 25), np.linspace(0, 1, 25))
    on_cone = p[0] + s[..., None] * (p[1] - p[0])
    on_bar = p[2] + t[..., None] * (p[3] - p[2])
    sampled = float(np.linalg.norm(on_cone - on_bar, axis=-1).min())
    assert found <= sampled + 1e-6
    assert found >= sampled - 0.12, "and the nearest of a fine net is not much farther"


def test_the_clock_starts_when_the_figure_moves_and_stops_at_the_goal() -> None:
    game = Game(line(), obstacles=False)
    game.update(5.0, seen(0.0, 0.0))
    game.update(6.0, seen(0.0, 0.09))
    assert game.phase == "ready"
    game.update(7.0, seen(0.0, 0.11))
    assert game.phase == "running"
    game.update(9.5, seen(0.0, 1.4))
    assert game.score.seconds == pytest.approx(2.5)
    game.update(10.0, seen(0.0, 1.6, standing=(False, False)))
    assert game.phase == "running", "in the air it has not arrived"
    game.update(10.25, seen(0.0, 1.7))
    assert game.phase == "finished"
    game.update(12.0, seen(0.0, 9.0))
    assert game.score == Score(3.25, 0, 0)


def test_a_standing_foot_beside_the_course_is_one_course_out_until_it_is_back_for_a_while() -> None:
    game = Game(line(), obstacles=False)
    game.update(0.0, seen(0.0, 0.0))
    game.update(1.0, seen(0.0, 0.5))
    game.update(1.1, seen(0.45, 0.5))  # the left foot at x = 0.55
    assert (game.score.outs, game.off) == (1, True)
    game.update(1.2, seen(0.0, 0.5))
    game.update(1.4, seen(0.45, 0.5))  # back for 0.2 s only: the same one
    game.update(1.5, seen(0.0, 0.5))
    game.update(1.79, seen(0.0, 0.5))
    assert (game.score.outs, game.off) == (1, True)
    game.update(1.81, seen(0.0, 0.5))
    assert not game.off
    game.update(1.9, seen(-0.45, 0.5))
    assert game.score.outs == 2


def test_a_foot_in_the_air_may_be_anywhere_and_before_the_start_nothing_counts() -> None:
    game = Game(line(), obstacles=False)
    game.update(0.0, seen(0.0, 0.0, feet=(2.0, 0.0)))
    assert game.score.outs == 0
    game.update(1.0, seen(0.0, 0.3))
    game.update(1.1, Seen((0.0, 0.5), np.array([[0.0, 0.5], [3.0, 3.0]]), (True, False), *NOWHERE))
    game.update(1.2, seen(0.0, 0.6, feet=(5.0, 0.0), standing=(False, False)))
    assert game.score.outs == 0
    game.update(1.3, Seen((0.0, 0.5), np.array([[0.0, 0.5], [3.0, 3.0]]), (False, True), *NOWHERE))
    assert game.score.outs == 1


def post(x: float, z: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A body of one upright cone, 1.7 m high, 0.2 m in radius."""
    return np.array([[x, 0.2, z]]), np.array([[x, 1.5, z]]), np.array([[0.2, 0.2]])


def test_an_obstacle_that_touches_is_one_collision_until_it_is_clear_for_a_while() -> None:
    # Goes from x = -2 to 2 at 1 m/s: at x = 0 after 2 s; 0.18 + 0.2 = 0.38 m is the reach.
    game = Game(line(pillar((-2.0, 0.9), (2.0, 0.9), 1.0)))
    for t in (0.0, 0.5, 1.5, 1.6):
        game.update(t, seen(0.0, 0.2 * t, body=post(0.0, 0.9)))
    assert game.score.hits == 0, "0.4 m away at 1.6 s"
    for t in (1.65, 2.0, 2.35):
        game.update(t, seen(0.0, 0.5, body=post(0.0, 0.9)))
    assert (game.score.hits, game.touched) == (1, (True,))
    game.update(2.45, seen(0.0, 0.5, body=post(0.0, 0.9)))
    assert game.touched == (True,), "not clear for long"
    game.update(2.86, seen(0.0, 0.5, body=post(0.0, 0.9)))
    assert (game.score.hits, game.touched) == (1, (False,))
    game.update(6.0, seen(0.0, 0.5, body=post(0.0, 0.9)))  # on its way back
    assert game.score.hits == 2


def test_without_obstacles_nothing_hits() -> None:
    game = Game(line(pillar((0.0, 0.9), (0.0, 0.9), 1.0)), obstacles=False)
    for t in (0.0, 1.0, 2.0):
        game.update(t, seen(0.0, 0.3 * t, body=post(0.0, 0.9)))
    assert game.score.hits == 0


def test_bars_are_jumped_over_and_beams_are_ducked_under() -> None:
    low, high = low_bar((0.0, 1.0), (0.0, 1.0), 0.5 * pi, 1.0, 0.3), beam((0.0, 1.0), (0.0, 1.0), 0.5 * pi, 1.0, 0.3)
    for height, radius, hits in ((0.10, 0.05, low), (1.69, 0.05, high)):
        body = np.array([[0.0, height, 1.0]]), np.array([[0.0, height, 1.0]]), np.array([[radius, radius]])
        assert gap(*body, *hits.ends(0.0), hits.radius) < 0.0
    for height, obstacle in ((0.19, low), (1.58, high)):
        body = np.array([[0.0, height, 1.0]]), np.array([[0.0, height, 1.0]]), np.array([[0.05, 0.05]])
        assert gap(*body, *obstacle.ends(0.0), obstacle.radius) > 0.0
    assert low.ends(0.0)[:, 0].tolist() == pytest.approx([0.5, -0.5])


def test_points_are_seconds_with_penalties() -> None:
    assert Score(10.0, 2, 1).points(Rules(out_costs=2.0, hit_costs=3.0)) == pytest.approx(17.0)


def test_every_stage_can_be_begun_and_ended() -> None:
    for stage in stages():
        assert stage.on([(0.0, 0.0)])[0], "the figure begins on the start"
        assert inside(stage.tiles[:1], [(0.0, 0.0)])[0, 0]
        goal = stage.tiles[-1].mean(axis=0)
        assert stage.at_goal(goal)
        assert not stage.at_goal((0.0, 0.0))
        assert stage.obstacles
    assert [len(one.tiles) for one in stages()] == [9, 13, 30, 7]
