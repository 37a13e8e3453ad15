"""The pen's interpretation: every kind of stroke, at several sample rates, with noise and losses."""

from collections.abc import Callable
from math import cos, hypot, pi, sin
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bunraku.figure.camera import look_at
from bunraku.figure.default import default_figure
from bunraku.msgs import CommandBase, Jump, Locomotion, Pen, Stand, Step
from bunraku.nodes.interpreter.core import Scene
from bunraku.nodes.interpreter.pen import PenCore
from bunraku.nodes.interpreter.pen_ground import in_heading, on_picture
from bunraku.nodes.interpreter.pen_path import Walk, hurried, lay
from bunraku.nodes.interpreter.pen_rules import PenRules
from bunraku.nodes.interpreter.pen_stroke import StrokePoint

RULES = PenRules()
SIZE = (0.25, 0.15)
METRES = SIZE[0] * RULES.scale  # the width of the tablet on the ground
Place = Callable[[float], tuple[float, float]]


class Tablet:
    """Plays strokes given on the ground: from behind the figure, +x right, -z away."""

    def __init__(self, rate: float = 120.0, seed: int | None = None, jitter: float = 0.0, **options: Any) -> None:
        camera = look_at((0.0, 1.6, -4.0), (0.0, 0.9, 0.0), yfov=0.6, aspect=1.6)
        self.scene = Scene.of(default_figure(), camera)
        self.scene.now = 1000.0
        self.core = PenCore(**options)
        self.rate = rate
        self.commands: list[CommandBase] = []
        self.random = np.random.default_rng(seed)
        self.jitter = jitter
        self.place = (0.0, 0.0)
        self.walks = True

    def send(self, place: tuple[float, float], *, contact: bool = True, in_range: bool = True, **more: Any) -> None:
        noise = self.random.normal(0.0, self.jitter, 2) if self.jitter else (0.0, 0.0)
        # The camera looks along +Z from behind: the pen's right is -X, up the tablet is +Z.
        x = 0.5 + (-place[0] + noise[0]) / METRES
        y = 0.5 - (place[1] + noise[1]) / (SIZE[1] * RULES.scale)
        more.setdefault("pressure", 0.3 if contact else 0.0)
        message = Pen(
            device="t", size_m=SIZE, in_range=in_range, contact=contact, x=x, y=y,
            origin=round(self.scene.now * 1e9), **more,
        )  # fmt: skip
        self.core.hear(Pen.decode(message.encode()), self.scene)
        self.place = place
        self.take()

    def take(self) -> None:
        said = self.core.update(self.scene).commands
        self.commands += said
        paths = [one.path for one in said if isinstance(one, Locomotion) and one.path]
        if paths and self.walks:  # the figure keeps a little behind the pen
            path, hips = paths[-1], self.scene.joint("hips")
            spot = path[max(0, len(path) - 1 - round(0.6 / RULES.spacing))]
            self.scene.positions[hips, 0], self.scene.positions[hips, 2] = spot.x, spot.z

    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds * 60)):
            self.scene.now += 1 / 60
            self.take()

    def stroke(self, path: Place, seconds: float, drop: float = 0.0, **more: Any) -> None:
        count = max(2, round(seconds * self.rate))
        for k in range(count + 1):
            if drop and 0 < k < count and self.random.random() < drop:
                self.scene.now += seconds / count
                continue
            self.send(path(k / count), **more)
            self.scene.now += seconds / count

    def line(self, way: tuple[float, float], seconds: float, **more: Any) -> None:
        x0, z0 = self.place
        self.stroke(lambda s: (x0 + way[0] * s, z0 + way[1] * s), seconds, **more)

    def lift(self) -> None:
        self.send(self.place, contact=False)

    def kinds(self) -> list[str]:
        return [type(one).__name__ for one in self.commands if not isinstance(one, Stand)]

    def last(self, kind: type[Any]) -> Any:
        return [one for one in self.commands if isinstance(one, kind)][-1]


@pytest.mark.parametrize("rate", [30.0, 60.0, 120.0, 200.0])
@pytest.mark.parametrize("azimuth", range(0, 360, 45))
def test_a_short_stroke_is_one_step_along_it(azimuth: int, rate: float) -> None:
    way = (0.5 * sin(azimuth * pi / 180), 0.5 * cos(azimuth * pi / 180))
    tablet = Tablet(rate)
    tablet.line(way, 0.3)
    tablet.lift()
    tablet.wait(0.5)
    assert tablet.kinds() == ["Step"]
    goal = tablet.last(Step).goal
    assert np.allclose((goal[0], goal[2]), way, atol=0.02)
    assert tablet.last(Step).heading is None


def test_a_step_is_taken_when_the_pen_stays_down_too() -> None:
    tablet = Tablet()
    tablet.line((0.0, 0.5), 0.3)
    tablet.wait(0.5)  # a still pen sends nothing
    assert tablet.kinds() == ["Step"]
    tablet.line((0.0, 0.4), 0.3)
    tablet.wait(0.5)
    assert tablet.kinds() == ["Step", "Step"]
    assert tablet.last(Step).goal[2] == pytest.approx(0.9, abs=0.03)
    assert tablet.commands[-1].id > tablet.commands[0].id


@pytest.mark.parametrize("rate", [30.0, 120.0, 200.0])
def test_a_long_stroke_is_locomotion_at_the_pens_speed(rate: float) -> None:
    tablet = Tablet(rate)
    tablet.line((0.0, 2.4), 2.0)
    assert set(tablet.kinds()) == {"Locomotion"}
    first, last = (one for one in (tablet.commands[0], tablet.commands[-1]) if isinstance(one, Locomotion))
    assert first.path[-1].z < 1.0, "it starts before the stroke is complete"
    assert first.id == last.id
    assert not last.complete
    assert last.path[-1].z == pytest.approx(2.4, abs=0.02)
    assert np.mean([one.speed for one in last.path]) == pytest.approx(1.2, abs=0.12)
    tablet.lift()
    tablet.wait(0.4)
    assert tablet.last(Locomotion).complete


def test_speed_follows_the_pen_point_by_point_within_the_running_limit() -> None:
    tablet = Tablet()
    tablet.line((0.0, 1.0), 1.25)
    tablet.line((0.0, 1.2), 0.4)
    speeds = [one.speed for one in tablet.last(Locomotion).path]
    assert speeds[8] == pytest.approx(0.8, abs=0.15)
    assert speeds[-3] > 2.0
    fast = Tablet()
    fast.line((0.0, 2.4), 0.25)
    assert max(one.speed for one in fast.last(Locomotion).path) == RULES.fastest


def test_a_pause_lengthens_the_same_path_while_the_figure_is_behind() -> None:
    tablet = Tablet()
    tablet.line((0.0, 1.2), 1.0)
    tablet.wait(0.5)
    assert tablet.last(Locomotion).complete
    tablet.line((1.0, 0.0), 1.0)
    walk = tablet.last(Locomotion)
    assert not walk.complete
    assert len({one.id for one in tablet.commands if isinstance(one, Locomotion)}) == 1
    assert (walk.path[-1].x, walk.path[-1].z) == pytest.approx((1.0, 1.2), abs=0.03)


def test_a_reset_far_away_goes_on_from_the_last_point() -> None:
    tablet = Tablet()
    tablet.place = (0.0, -1.0)
    tablet.line((0.0, 2.0), 1.5)
    tablet.lift()
    tablet.wait(1.0)
    tablet.place = (0.0, -1.0)  # back at the tablet's edge
    tablet.line((0.0, 2.0), 1.5)
    assert set(tablet.kinds()) == {"Locomotion"}
    assert tablet.last(Locomotion).path[-1].z == pytest.approx(4.0, abs=0.05)


@pytest.mark.parametrize("length", [0.05, 0.2, 0.5])
@pytest.mark.parametrize("aside", [-60, 0, 60])
@pytest.mark.parametrize("arrived", [False, True])
def test_after_a_reset_a_short_stroke_goes_on_with_the_path(length: float, aside: int, arrived: bool) -> None:
    tablet = Tablet()
    tablet.place = (0.0, -1.0)
    tablet.line((0.0, 2.0), 1.5)
    tablet.lift()
    if arrived:
        tablet.scene.positions[tablet.scene.joint("hips")] = 0.0, 0.9, 2.0
    tablet.wait(0.8)
    tablet.place = (0.0, -1.0)
    way = (length * sin(aside * pi / 180), length * cos(aside * pi / 180))
    tablet.line(way, 0.3)
    tablet.lift()
    tablet.wait(0.8)
    tablet.place = (0.0, -1.0)  # what such strokes add up to is not lost
    tablet.line((0.0, 1.0), 0.8)
    tablet.lift()
    tablet.wait(0.5)
    assert set(tablet.kinds()) == {"Locomotion"}
    end = tablet.last(Locomotion).path[-1]
    assert (end.x, end.z) == pytest.approx((way[0], 3.0 + way[1]), abs=0.03)


def test_a_short_stroke_back_after_a_walk_is_a_step_and_so_is_one_that_comes_later() -> None:
    for pause, way in ((0.8, (0.0, -0.4)), (2.0, (0.0, 0.4)), (0.8, (0.4, 0.0))):
        tablet = Tablet()
        tablet.place = (0.0, -1.0)
        tablet.line((0.0, 2.0), 1.5)
        tablet.lift()
        tablet.scene.positions[tablet.scene.joint("hips")] = 0.0, 0.9, 2.0
        tablet.wait(pause)
        tablet.place = (0.0, -1.0)
        tablet.line(way, 0.3)
        tablet.lift()
        tablet.wait(0.5)
        assert tablet.kinds()[-1] == "Step"


def test_a_jump_between_a_reset_and_a_stroke_ends_the_path_that_was_drawn_before() -> None:
    tablet = Tablet()
    tablet.place = (0.0, -1.0)
    tablet.line((0.0, 2.0), 1.5)
    tablet.lift()
    tablet.wait(0.4)
    tablet.send((0.0, -1.0))  # a reset, and a jump from there
    tablet.wait(0.1)
    tablet.lift()
    tablet.wait(0.2)
    tablet.send((0.0, -0.5))
    tablet.wait(0.1)
    tablet.line((0.3, 0.3), 0.3)
    tablet.lift()
    tablet.wait(0.5)
    assert tablet.kinds()[-2:] == ["Jump", "Step"]


@pytest.mark.parametrize("gap", [0.03, 0.06, 0.15, 0.3, 0.5, 0.65, 0.69])
@pytest.mark.parametrize("azimuth", range(0, 360, 45))
def test_lift_and_land_near_is_a_jump_there(azimuth: int, gap: float) -> None:
    way = (0.75 * sin(azimuth * pi / 180), 0.75 * cos(azimuth * pi / 180))
    tablet = Tablet()
    tablet.send((0.0, 0.0), pressure=0.4)
    tablet.scene.now += 0.3
    tablet.lift()
    tablet.scene.now += gap
    tablet.send(way)
    assert tablet.kinds() == ["Jump"]
    goal = tablet.last(Jump).goal
    assert np.allclose((goal[0], goal[2]), way, atol=0.02)


@pytest.mark.parametrize(("pressure", "height"), [(0.2, 0.18), (0.5, 0.30), (1.0, 0.50)])
def test_lift_and_land_at_the_same_place_jumps_as_high_as_was_pressed(pressure: float, height: float) -> None:
    tablet = Tablet()
    for _ in range(20):
        tablet.send((0.0, 0.0), pressure=pressure)
        tablet.scene.now += 0.01
    tablet.lift()
    tablet.scene.now += 0.2
    tablet.send((0.05, 0.05))
    jump = tablet.last(Jump)
    assert jump.goal is None
    assert jump.height == pytest.approx(height, abs=0.01)


def test_too_late_or_too_far_is_no_jump() -> None:
    for way, gap in (((0.5, 0.0), 0.72), ((0.5, 0.0), 0.9), ((1.05, 0.0), 0.3), ((0.0, 1.7), 0.3)):
        tablet = Tablet()
        tablet.send((0.0, 0.0))
        tablet.scene.now += 0.2
        tablet.lift()
        tablet.scene.now += gap
        tablet.send(way)
        tablet.wait(0.5)
        assert tablet.kinds() == []


def test_fast_motion_with_a_gap_is_no_jump() -> None:
    tablet = Tablet()
    tablet.line((0.0, 1.0), 0.12)
    tablet.lift()
    tablet.scene.now += 0.05
    tablet.place = (0.0, 1.5)
    tablet.line((0.0, 0.8), 0.1)
    assert "Jump" not in tablet.kinds()


def test_a_bounce_of_the_tip_is_no_event() -> None:
    tablet = Tablet()
    tablet.line((0.0, 1.2), 1.0)
    tablet.lift()
    tablet.scene.now += 0.02
    tablet.line((0.0, 0.8), 0.7)
    assert set(tablet.kinds()) == {"Locomotion"}
    assert len({one.id for one in tablet.commands}) == 1
    assert tablet.last(Locomotion).path[-1].z == pytest.approx(2.0, abs=0.03)


def test_out_of_range_in_mid_stroke_ends_the_path_where_it_was() -> None:
    tablet = Tablet()
    tablet.line((0.0, 1.5), 1.2)
    tablet.send(tablet.place, contact=False, in_range=False)
    tablet.wait(0.5)
    assert tablet.last(Locomotion).complete
    other = Tablet()
    other.line((0.0, 1.5), 1.2)
    other.core.lose("t", other.scene)
    other.wait(0.5)
    assert other.last(Locomotion).complete


def test_the_path_the_jump_range_and_the_cursor_are_drawn() -> None:
    tablet = Tablet()
    tablet.line((0.0, 0.5), 0.4)
    path = tablet.core.update(tablet.scene).overlay
    assert [one.kind for one in path] == ["line"]
    assert path[0].points[0] == pytest.approx((0.0, 0.0, 0.0), abs=0.02)
    assert path[0].points[-1] == pytest.approx((0.0, 0.0, 0.5), abs=0.02)
    tablet.lift()
    tablet.send((0.3, 0.9), contact=False)
    _, same, edge, cursor = tablet.core.update(tablet.scene).overlay
    assert (same.kind, same.label, same.size) == ("circle", "jump", RULES.jump_same)
    assert same.points[0] == pytest.approx((0.0, 0.0, 0.5), abs=0.02)
    reach = [hypot(x - same.points[0][0], z - same.points[0][2]) for x, _, z in edge.points]
    assert (max(reach), min(reach)) == pytest.approx((RULES.jump_range, RULES.jump_back), abs=0.01)
    assert edge.points[reach.index(max(reach))][2] > 2.0, "farthest ahead"
    assert cursor.points[0] == pytest.approx((0.3, 0.0, 0.9), abs=0.02)
    tablet.wait(RULES.jump_time + 0.1)
    assert not [one for one in tablet.core.update(tablet.scene).overlay if one.label == "jump"]


@pytest.mark.parametrize("azimuth", range(0, 360, 45))
def test_the_pens_tilt_leans_the_standing_figure_the_same_way(azimuth: int) -> None:
    tablet = Tablet()
    for _ in range(60):
        tablet.send((0.0, 0.0), contact=False, altitude=pi / 2 - 0.95, azimuth=azimuth * pi / 180)
        tablet.scene.now += 0.01
    stand = tablet.last(Stand)
    # Seen from behind: the cap to the right (azimuth 0) leans to the figure's right, up the tablet (270) forward.
    assert stand.tilt == pytest.approx(-RULES.lean * cos(azimuth * pi / 180), abs=0.01)
    assert stand.bend == pytest.approx(-RULES.lean * sin(azimuth * pi / 180), abs=0.01)
    tablet.send((0.0, 0.0), contact=False, in_range=False)
    tablet.wait(1.0)
    assert abs(tablet.last(Stand).tilt) < 0.02


def test_pressing_ducks_and_writing_pressure_does_not() -> None:
    tablet = Tablet()
    for pressure, duck in ((0.4, 0.0), (0.7, 0.5), (0.95, 1.0)):
        for _ in range(50):
            tablet.send((0.0, 0.0), pressure=pressure)
            tablet.scene.now += 0.01
        if duck:
            assert tablet.last(Stand).duck == pytest.approx(duck, abs=0.01)
        else:
            assert not [one for one in tablet.commands if isinstance(one, Stand)]


def test_posture_is_kept_where_it_was_on_the_path() -> None:
    tablet = Tablet()
    tablet.line((0.0, 1.2), 1.0)
    tablet.line((0.0, 0.8), 0.7, pressure=0.95, altitude=pi / 2 - 0.95, azimuth=3 * pi / 2)
    path = tablet.last(Locomotion).path
    begin, end = path[8], path[-2]
    assert (begin.duck, begin.bend) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert end.duck == pytest.approx(1.0, abs=0.1)
    assert end.bend == pytest.approx(RULES.lean, abs=0.1)
    assert end.tilt == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("rate", [30.0, 120.0, 200.0])
@pytest.mark.parametrize("seed", range(4))
def test_noise_jitter_and_lost_samples_change_no_meaning(rate: float, seed: int) -> None:
    tablet = Tablet(rate, seed=seed, jitter=0.004)
    tablet.line((0.4, 0.2), 0.3, drop=0.2)
    tablet.lift()
    tablet.wait(1.0)
    assert tablet.kinds() == ["Step"]
    tablet.line((0.0, 1.8), 1.5, drop=0.2)
    tablet.lift()
    tablet.wait(0.2)
    assert set(tablet.kinds()[1:]) == {"Locomotion"}
    path = tablet.last(Locomotion).path
    assert np.std([one.x for one in path]) < 0.03


def test_an_unambiguous_stroke_can_start_early() -> None:
    def begin(way: tuple[float, float], early: bool) -> float:
        tablet = Tablet(early=early)
        tablet.line(way, 1.0)
        end = next(one.path[-1] for one in tablet.commands if isinstance(one, Locomotion))
        return hypot(end.x, end.z)

    assert begin((0.0, 2.0), True) < 0.2
    assert begin((1.7, 1.0), True) < 0.6 < RULES.longest_step < begin((1.7, 1.0), False)
    quick = Tablet(early=True)
    quick.stroke(lambda s: (0.6 * s * s * (3.0 - 2.0 * s), 0.0), 0.35)  # fast, but it slows down to its end
    quick.lift()
    quick.wait(0.5)
    assert quick.kinds() == ["Step"]
    slow = Tablet(early=True)
    slow.line((0.6, 0.0), 0.6)
    slow.lift()
    slow.wait(0.5)
    assert slow.kinds() == ["Step"]


def test_an_early_start_straight_ahead_ends_where_the_step_would() -> None:
    tablet = Tablet(early=True)
    tablet.line((0.05, 0.4), 0.3)
    tablet.lift()
    tablet.wait(0.5)
    assert set(tablet.kinds()) == {"Locomotion"}
    walk = tablet.last(Locomotion)
    assert walk.complete
    assert (walk.path[-1].x, walk.path[-1].z) == pytest.approx((0.05, 0.4), abs=0.01)


@pytest.mark.parametrize("size", [(0.05, 0.03), (0.0762, 0.0508), (0.25, 0.15), (0.62, 0.46), (2.0, 1.2), None])
def test_the_same_centimetres_are_the_same_step_on_a_tablet_of_any_size(size: tuple[float, float] | None) -> None:
    tablet = Tablet()
    width, height = size or (RULES.tablet_width, 0.625 * RULES.tablet_width)
    for k in range(31):  # 2.5 cm up and 1.5 cm to the right, as far as the tablet is large enough
        share = min(k / 30, 0.9 * height / 0.025)
        x, y = 0.02 + 0.015 * share / width, 0.98 - 0.025 * share / height
        pen = Pen(device="t", size_m=size, in_range=True, contact=True, x=x, y=y, origin=round(tablet.scene.now * 1e9))
        tablet.core.hear(pen, tablet.scene)
        tablet.take()
        tablet.scene.now += 0.01
    tablet.wait(0.5)
    assert tablet.kinds() == ["Step"]
    x, _, z = tablet.last(Step).goal
    assert (-x, z) == pytest.approx((0.015 * share * RULES.scale, 0.025 * share * RULES.scale), abs=0.03)


def test_twist_turns_the_standing_body() -> None:
    tablet = Tablet()
    for twist in np.linspace(0.0, 1.0, 40):
        tablet.send((0.0, 0.0), contact=False, twist=float(twist))
        tablet.scene.now += 0.01
    assert tablet.last(Stand).heading == pytest.approx(-1.0, abs=0.05)


def test_a_second_pen_waits_until_the_first_is_away() -> None:
    tablet = Tablet()
    tablet.send((0.0, 0.0), contact=False)
    other = Pen(device="other", size_m=SIZE, in_range=True, contact=True, x=0.1, y=0.1, pressure=0.9)
    tablet.core.hear(other, tablet.scene)
    assert tablet.core.device == "t"
    tablet.send((0.0, 0.0), contact=False, in_range=False)
    tablet.core.hear(other, tablet.scene)
    assert tablet.core.device == "other"


def test_on_the_picture_the_ray_meets_the_ground() -> None:
    scene = Tablet().scene
    pen = Pen(device="p", in_range=True, contact=True, x=0.5, y=0.9)
    place = on_picture(pen, scene.camera)
    assert place is not None
    assert place[0] == pytest.approx(0.0, abs=1e-6)
    assert on_picture(Pen(device="p", in_range=True, contact=True, x=0.5, y=0.05), scene.camera) is None


def test_the_path_keeps_its_beginning_out_when_it_grows_long() -> None:
    tablet = Tablet()
    tablet.place = (0.0, -1.1)
    tablet.walks = False
    hips = tablet.scene.joint("hips")
    for _ in range(8):
        for _ in range(20):
            tablet.line((0.0, 0.11), 0.08)
            tablet.scene.positions[hips, 2] = max(0.0, tablet.core.walk.length - 0.4 if tablet.core.walk else 0.0)
        tablet.lift()
        tablet.wait(0.9)
        tablet.place = (0.0, -1.1)
    walk = tablet.last(Locomotion)
    assert walk.start > 5.0
    assert len(walk.path) < 100
    assert walk.path[0].z == pytest.approx(walk.start, abs=0.3)


def test_a_figure_that_lags_hurries_and_the_lag_goes_down_along_the_path() -> None:
    tablet = Tablet()
    tablet.walks = False  # something holds the figure at the path's beginning
    tablet.line((0.0, 1.0), 1.0)
    tablet.line((0.0, 1.0), 1.0)
    tablet.lift()
    tablet.wait(2.0)
    walks = [one for one in tablet.commands if isinstance(one, Locomotion)]
    assert walks[-1].complete
    assert len([one for one in walks if one.complete]) > 4, "said again while it lags"
    speeds = [one.speed for one in walks[-1].path]
    assert all(one.speed == pytest.approx(1.0, abs=0.15) for one in walks[0].path)
    assert speeds[3] == pytest.approx(RULES.most_hurry, rel=0.15)
    assert speeds[3] > speeds[-2] > 1.0
    assert [one.z for one in walks[-1].path] == pytest.approx([one.z for one in walks[-2].path])


@given(st.lists(st.floats(RULES.slowest, RULES.fastest), min_size=2, max_size=120), st.floats(0.0, 8.0))
@settings(max_examples=60)
def test_hurrying_stays_within_the_running_limit_and_never_overtakes(speeds: list[float], lag: float) -> None:
    pen, gaps = np.array(speeds), np.full(len(speeds), 0.05)
    fast = hurried(pen, gaps, lag, RULES)
    assert (fast >= pen - 1e-12).all()
    assert (fast <= RULES.fastest + 1e-12).all()
    saved = (gaps / pen - gaps / fast).sum()
    assert saved <= lag + 1e-6


def test_state_survives_a_crash() -> None:
    tablet = Tablet()
    tablet.line((0.0, 0.5), 0.3)
    tablet.lift()
    tablet.wait(0.5)
    again = PenCore()
    again.restore(tablet.core.save(), tablet.scene)
    assert again.count == tablet.core.count
    assert again.track.end == pytest.approx(tablet.core.track.end)


@given(st.floats(-pi, pi), st.floats(-1, 1), st.floats(-1, 1))
def test_in_heading_is_a_rotation(heading: float, x: float, z: float) -> None:
    tilt, bend = in_heading((x, z), heading)
    assert hypot(tilt, bend) == pytest.approx(hypot(x, z), abs=1e-9)
    assert in_heading((sin(heading), cos(heading)), heading) == pytest.approx((0.0, 1.0), abs=1e-9)


@given(st.lists(st.tuples(st.floats(0.001, 0.3), st.floats(-0.5, 0.5)), min_size=2, max_size=60), st.floats(0.0, 3.0))
@settings(max_examples=60)
def test_resampled_paths_stay_on_the_stroke(steps: list[tuple[float, float]], begin: float) -> None:
    points, x, z, arc, turn = [], 0.0, 0.0, 0.0, 0.0
    for step, bend in steps:
        points.append(StrokePoint((x, z), arc, 1.0, (0.0, 0.0), 0.2))
        turn += bend
        x, z, arc = x + step * sin(turn), z + step * cos(turn), arc + step
    path, _ = lay(Walk(1, points, place=begin + RULES.behind), 0.0, RULES)
    spots = np.array([(one.x, one.z) for one in path])
    corners = np.array([one.place for one in points])
    assert np.isfinite(spots).all()
    assert spots[-1] == pytest.approx(corners[-1])
    gaps = np.linalg.norm(np.diff(spots, axis=0), axis=1)
    assert (gaps < RULES.spacing * 1.6).all()


@given(st.data())
@settings(max_examples=60, deadline=None)
def test_any_samples_in_any_order_give_commands_and_nothing_else(data: st.DataObject) -> None:
    tablet = Tablet()
    for _ in range(data.draw(st.integers(1, 40))):
        tablet.scene.now += data.draw(st.sampled_from([0.0, 0.004, 0.02, 0.3, 2.0]))
        spot = (data.draw(st.floats(-3, 3)), data.draw(st.floats(-2, 2)))
        tablet.send(
            spot,
            contact=data.draw(st.booleans()),
            in_range=data.draw(st.booleans()),
            pressure=data.draw(st.floats(0, 1)),
            altitude=data.draw(st.floats(0, 1.57)),
            azimuth=data.draw(st.floats(0, 6.28)),
        )
    tablet.wait(0.5)
    for command in tablet.commands:
        assert type(command).decode(command.encode())
    ids = [one.id for one in tablet.commands if isinstance(one, (Step, Jump))]
    assert ids == sorted(set(ids))
