"""Paths that people walk, and obstacles that are gone round, given time to pass, read and heard."""

from itertools import pairwise
from math import hypot, pi, sin
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from bunraku.msgs import Overlay, Pen, Primitive
from bunraku.nodes.blender.node import Blender
from bunraku.nodes.interpreter.node import Interpreter
from bunraku.nodes.interpreter.obstacles import BODY, Heard, Obstacle, ObstacleError, Placed, detour, load
from bunraku.nodes.interpreter.pen_path import Walk, grid, lay, minimum_jerk, slowed
from bunraku.nodes.interpreter.pen_rules import PenRules
from bunraku.nodes.interpreter.pen_stroke import StrokePoint
from bunraku.runtime.memory import MemoryStage
from bunraku.runtime.node import ParamProblem

RULES = PenRules()
Array = NDArray[np.float64]


def corner(angle: float, leg: float = 3.0, spacing: float = 0.05) -> Array:
    """Two straight legs, the second one turned by ``angle`` (rad)."""
    count = round(leg / spacing)
    first = np.stack([np.zeros(count), np.linspace(-leg, 0.0, count, endpoint=False)], -1)
    way = np.linspace(0.0, leg, count + 1)[:, None] * np.array([np.sin(angle), np.cos(angle)])
    return np.concatenate([first, way])


# Natural paths


@pytest.mark.parametrize("angle", [pi / 4, pi / 2, 2.0])
def test_a_corner_is_cut_as_the_kernel_says(angle: float) -> None:
    drawn = corner(angle)
    walked = minimum_jerk(drawn, 0.4, 0.05, 100.0)
    cut = np.linalg.norm(walked, axis=1).min()
    assert cut == pytest.approx(2.0 / 3.0 * 0.4 * sin(0.5 * angle), rel=0.03)
    assert walked[0] == pytest.approx(drawn[0], abs=1e-9)
    assert walked[-1] == pytest.approx(drawn[-1], abs=1e-9)


def test_a_straight_line_stays_and_tremor_goes() -> None:
    line = np.stack([np.linspace(0.0, 1.0, 80), np.linspace(0.0, 4.0, 80)], -1)
    assert minimum_jerk(line, 0.7, 0.05, 0.8) == pytest.approx(line, abs=1e-9)
    shaken = line + np.random.default_rng(1).normal(0.0, 0.02, line.shape) * (np.arange(80) % 79 > 0)[:, None]
    calm = minimum_jerk(shaken, 0.7, 0.05, 0.8)

    def jerk(path: Array) -> float:
        return float((np.diff(path, n=3, axis=0) ** 2).sum())

    assert jerk(calm) < 1e-4 * jerk(shaken)
    assert np.abs(calm - line).max() < 0.03


@given(st.lists(st.tuples(st.floats(-3, 3), st.floats(-3, 3)), min_size=2, max_size=60), st.floats(0.1, 1.0))
@settings(max_examples=80)
def test_no_place_moves_farther_than_it_may(points: list[tuple[float, float]], most: float) -> None:
    drawn = np.array(points)
    walked = minimum_jerk(drawn, 0.7, 0.05, most)
    assert np.isfinite(walked).all()
    assert np.linalg.norm(walked - drawn, axis=1).max() <= most + 1e-9


def test_people_slow_down_where_they_bend() -> None:
    radius, spacing = 0.8, 0.05
    turn = np.arange(60) * spacing / radius
    arc = radius * np.stack([np.sin(turn), np.cos(turn)], -1)
    slow = slowed(np.full(60, 2.5), arc, np.full(60, spacing), RULES)
    assert slow[30] == pytest.approx((RULES.sideways * radius) ** 0.5, rel=0.03)
    line = np.stack([np.zeros(60), np.arange(60) * spacing], -1)
    assert slowed(np.full(60, 2.5), line, np.full(60, spacing), RULES) == pytest.approx(2.5)


def drawn_walk(places: Array, speed: float = 1.2, place: float = 0.0) -> Walk:
    arcs = np.append(0.0, np.cumsum(np.hypot(*np.diff(places, axis=0).T)))
    points = [
        StrokePoint((float(x), float(z)), float(arc), speed, (0.0, 0.0), 0.2, float(arc) / speed)
        for (x, z), arc in zip(places, arcs, strict=True)
    ]
    return Walk(1, points, complete=True, place=place)


def test_what_was_said_under_the_feet_stays_and_arc_lengths_go_on() -> None:
    places = corner(pi / 2)
    walk = drawn_walk(places)
    walk.complete = False
    whole, before = walk.points, None
    for count in range(70, len(whole) + 1, 5):
        walk.points = whole[:count]
        walk.place = whole[count - 1].arc - 1.5
        path, start = lay(walk, walk.place / 1.2, RULES, natural=True)
        said = np.array([(one.x, one.z) for one in path])
        arcs = start + np.append(0.0, np.cumsum(np.hypot(*np.diff(said, axis=0).T)))
        if before is not None:
            here = (walk.laid[:, 0] <= walk.place - 0.25 + 1e-6) & (walk.laid[:, 0] >= before[0][0])
            for arc, place, own in zip(walk.laid[here, 0], said[here], arcs[here], strict=True):
                old = np.array([np.interp(arc, before[0], before[1][:, k]) for k in range(2)])
                assert place == pytest.approx(old, abs=1e-6)
                assert own == pytest.approx(np.interp(arc, before[0], before[2]), abs=1e-3)
        before = (walk.laid[:, 0].copy(), said, arcs)
    assert start < walk.laid[0, 0], "the corner was cut: the own way is shorter than the drawn one"


def test_a_figure_on_a_path_that_comes_back_over_itself_is_not_taken_to_be_on_its_way_back() -> None:
    out = np.stack([np.zeros(61), np.linspace(0.0, 3.0, 61)], -1)
    walk = drawn_walk(np.concatenate([out, out[-2::-1]]), place=0.0)
    sway = 0.03 * np.sin(np.arange(300.0))
    for k, off in enumerate(sway):
        gone = 0.02 * k
        walk.locate((float(off), gone if gone <= 3.0 else 6.0 - gone))
        assert walk.place == pytest.approx(gone, abs=0.2)


def test_points_keep_their_places_while_a_path_grows() -> None:
    first, second = grid(0.37, 2.013, 0.05), grid(0.37, 2.61, 0.05)
    assert first[:-1] == pytest.approx(second[: len(first) - 1])
    assert (first[-1], second[-1]) == (2.013, 2.61)
    assert len(grid(1.0, 1.0, 0.05)) == 2


# Obstacles


def line(length: float = 6.0) -> tuple[Array, Array]:
    at = np.arange(0.0, length, 0.05)
    return np.stack([np.zeros_like(at), at], -1), at


@pytest.mark.parametrize("x", [-0.5, -0.1, 0.0, 0.2, 0.6])
@pytest.mark.parametrize("radius", [0.2, 0.5])
def test_a_standing_obstacle_is_gone_round_on_the_nearer_side(x: float, radius: float) -> None:
    places, ahead = line()
    sides: dict[str, int] = {}
    out, free = detour(places, ahead, ahead / 1.2, [Obstacle("a", x, 3.0, radius)], sides)
    away = np.hypot(out[:, 0] - x, out[:, 1] - 3.0)
    assert away.min() > radius + BODY - 0.05
    assert out[0] == pytest.approx(places[0])
    assert out[-1] == pytest.approx(places[-1], abs=0.02)
    if abs(x) > 0.05 and abs(x) < radius + BODY:
        assert np.sign(out[np.abs(out[:, 0]).argmax(), 0]) == -np.sign(x)
        assert free.min() < 1.0, "slower beside it"
    steps = np.diff(out, axis=0)
    turns = np.abs(np.diff(np.unwrap(np.arctan2(steps[:, 0], steps[:, 1]))))
    assert turns.max() < 0.2, "no corners"


def test_a_side_once_chosen_is_kept_and_forgotten_when_it_is_passed() -> None:
    places, ahead = line()
    sides: dict[str, int] = {}
    one = [Obstacle("a", -0.02, 3.0, 0.3)]
    detour(places, ahead, ahead, one, sides)
    chosen = dict(sides)
    assert chosen
    moved = [Obstacle("a", 0.05, 3.0, 0.3)]
    detour(places, ahead, ahead, moved, sides)
    assert sides == chosen
    detour(places, ahead - 5.0, ahead, moved, sides)
    assert sides == {}


@pytest.mark.parametrize("start", np.linspace(-2.5, 2.5, 11))
def test_what_crosses_is_given_time_to_pass(start: float) -> None:
    places, ahead = line()
    eta = ahead / 1.2
    one = Obstacle("a", start, 2.0, 0.3, vx=-1.0 if start > 0 else 1.0)
    out, free = detour(places, ahead, eta, [one], {})
    assert out == pytest.approx(places), "it is not gone round"
    then = eta / free
    minded = then < one.foreseen
    away = np.hypot(*(places[minded] - one.after(then[minded])).T)
    assert away.min() >= 0.3 + BODY - 1e-6


def test_obstacles_of_a_file(tmp_path: Path) -> None:
    file = tmp_path / "room.toml"
    file.write_text(
        "[[obstacle]]\nat = [1, 2.5]\nradius = 0.4\n[[obstacle]]\nat = [0.0, 0.0]\nto = [2.0, 0.0]\nseconds = 4\n"
    )
    still, moving = load(str(file))
    assert still == Placed("1", (1.0, 2.5), 0.4)
    assert still.now(3.0).foreseen == float("inf")
    there = moving.now(1.0)
    assert (there.x, there.vx) == (0.5, 0.5)
    back = moving.now(7.0)
    assert (back.x, back.vx) == (0.5, -0.5)
    assert moving.now(3.0).after(np.array([0.0, 1.0, 2.0]))[:, 0] == pytest.approx([1.5, 2.0, 1.5])
    for text, why in (
        ("[[obstacle]]\n", r"obstacle 1: at = \[x, z\] is missing"),
        ("[[obstacle]]\nat = [0, 'a']\n", r"at is \[x, z\]"),
        ("[[obstacle]]\nat = [0, 0]\nradius = 99\n", "0.02..5"),
        ("[[obstacle]]\nat = [0, 0]\ncolour = 3\n", "unknown key 'colour'"),
        ("", "1 to 64"),
        ("[[", "is not TOML"),
    ):
        file.write_text(text)
        with pytest.raises(ObstacleError, match=why):
            load(str(file))
    with pytest.raises(ParamProblem, match="cannot be read"):
        MemoryStage().add(Interpreter, obstacles=str(tmp_path / "none.toml"))


def test_obstacles_that_another_node_draws_and_their_speed() -> None:
    heard = Heard()
    for k in range(12):
        circle = Primitive(kind="circle", points=[(0.1 * k, 0.0, 2.0)], size=0.3, label="cart")
        other = Primitive(kind="line", points=[(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)])
        heard.take([other, circle, Primitive(kind="circle", space="screen", points=[(0.5, 0.5)])], 0.1 * k)
    (one,) = heard.obstacles
    assert (one.x, one.z, one.radius) == (pytest.approx(1.1), 2.0, 0.3)
    assert (one.vx, one.vz) == (pytest.approx(1.0, abs=0.01), 0.0)
    heard.take([], 2.0)
    assert heard.obstacles == ()


class Play:
    """A pen that draws straight ahead, seen from behind; what the figure's hips do."""

    def __init__(self, **interpreter: object) -> None:
        self.stage = MemoryStage()
        self.stage.add(Interpreter, azimuth=pi - 1e-9, elevation=0.5, distance=6.5, **interpreter)
        self.blender = self.stage.add(Blender, skeleton=True, remap={"motion": "pose"}, show_overlay=False)
        self.stage.advance(0.5)

    def draw(self, points: list[tuple[float, float]], speed: float) -> None:
        """Points (right, ahead) m from the tablet's middle."""
        size = (0.4, 0.4)
        for (x0, z0), (x1, z1) in pairwise(points):
            count = round(hypot(x1 - x0, z1 - z0) / speed * 120)
            for k in range(count):
                at = (x0 + (x1 - x0) * k / count, z0 + (z1 - z0) * k / count)
                x, y = 0.5 + at[0] / (size[0] * RULES.scale), 0.5 - at[1] / (size[1] * RULES.scale)
                self.stage.publish("pen", Pen(device="t", size_m=size, in_range=True, contact=True, x=x, y=y))
                self.stage.advance(1 / 120)
        self.stage.publish("pen", Pen(device="t", size_m=size, in_range=True, contact=False, x=x, y=y))

    def hips(self) -> Array:
        """(F, 2): right, ahead, m."""
        roots = np.array([one.root for one in self.stage.received("pose")], dtype=np.float64)
        return np.stack([-roots[:, 0], roots[:, 2]], -1)


def test_the_figure_walks_round_what_stands_in_its_way(tmp_path: Path) -> None:
    file = tmp_path / "room.toml"
    file.write_text("[[obstacle]]\nat = [0.1, 2.5]\nradius = 0.3\n")
    play = Play(obstacles=str(file))
    play.draw([(0.0, -2.9), (0.0, 2.6)], 1.2)
    play.stage.advance(5.0)
    hips = play.hips()
    assert np.hypot(hips[:, 0] + 0.1, hips[:, 1] - 2.5).min() > 0.3 + 0.25, "shoulders clear"
    assert hips[-1] == pytest.approx((0.0, 5.5), abs=0.08)
    shown = play.stage.last("overlay/interpreter").primitives
    assert 0.3 in [one.size for one in shown if one.kind == "circle"], "and it is seen"


def test_the_figure_goes_round_what_another_node_draws() -> None:
    play = Play()
    circle = Primitive(kind="circle", points=[(0.1, 0.0, 2.5)], size=0.3)
    play.stage.publish("overlay/obstacles", Overlay(primitives=[circle]))
    play.draw([(0.0, -2.9), (0.0, 2.6)], 1.2)
    play.stage.advance(5.0)
    hips = play.hips()
    assert np.hypot(hips[:, 0] + 0.1, hips[:, 1] - 2.5).min() > 0.3 + 0.25
    assert hips[-1] == pytest.approx((0.0, 5.5), abs=0.08)


def test_a_drawn_corner_is_walked_as_people_do_where_that_is_wanted() -> None:
    exact, natural = Play(), Play(pen_natural=True)
    cut = []
    for play in (exact, natural):
        play.draw([(0.0, -2.9), (0.0, 0.1), (2.8, 0.1)], 1.2)
        play.stage.advance(5.0)
        hips = play.hips()
        assert hips[-1] == pytest.approx((2.8, 3.0), abs=0.08)
        cut.append(float(np.hypot(hips[:, 0], hips[:, 1] - 3.0).min()))
    assert cut[0] < 0.10
    assert 0.20 < cut[1] < 0.45
