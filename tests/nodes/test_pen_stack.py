"""The pen through interpreter and blender: what was drawn is what the figure does, and how well it does it."""

from collections.abc import Callable
from math import atan2, cos, hypot, pi, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from bunraku.figure.default import default_figure
from bunraku.figure.fk import fk
from bunraku.motion.footlock import LOCKED
from bunraku.msgs import Locomotion, PathPoint, Pen
from bunraku.nodes.blender.node import Blender
from bunraku.nodes.interpreter.node import Interpreter
from bunraku.nodes.interpreter.pen_rules import PenRules
from bunraku.nodes.interpreter.pen_stroke import jump_range
from bunraku.runtime.memory import MemoryStage

RULES = PenRules()
SIZE = (0.40, 0.40)
SKELETON = default_figure()
HIPS, HEAD = 0, SKELETON.names.index("head")
Array = NDArray[np.float64]
Place = Callable[[float], tuple[float, float]]


class Play:
    """A pen on a tablet, seen from straight behind: places are (right, ahead) m of the ground, which is (-x, z)."""

    def __init__(
        self,
        rate: float = 120.0,
        size: tuple[float, float] = SIZE,
        blender: dict[str, Any] | None = None,
        **interpreter: Any,
    ) -> None:
        self.stage = MemoryStage()
        # The camera looks along +Z, where the figure faces, so that pen up is ahead and pen right is -X.
        self.interpreter = self.stage.add(Interpreter, azimuth=pi - 1e-9, elevation=0.5, distance=6.5, **interpreter)
        self.blender = self.stage.add(
            Blender, skeleton=True, remap={"motion": "pose"}, show_overlay=False, **(blender or {})
        )
        self.size, self.rate = size, rate
        self.at = (0.0, 0.0)  # on the tablet, figure metres from its middle
        self.stage.advance(0.5)
        self.begun = len(self.stage.received("pose"))

    def send(self, *, contact: bool = True, in_range: bool = True, **more: Any) -> None:
        more.setdefault("pressure", 0.3 if contact else 0.0)
        x = 0.5 + self.at[0] / (self.size[0] * RULES.scale)
        y = 0.5 - self.at[1] / (self.size[1] * RULES.scale)
        assert 0.0 <= x <= 1.0, "the pen left the tablet"
        assert 0.0 <= y <= 1.0, "the pen left the tablet"
        self.stage.publish(
            "pen", Pen(device="t", size_m=self.size, in_range=in_range, contact=contact, x=x, y=y, **more)
        )

    def move(self, way: tuple[float, float], seconds: float, **more: Any) -> None:
        """Draw a line of this way (right, ahead) m."""
        x, z = self.at
        count = max(1, round(seconds * self.rate))
        for k in range(count + 1):
            self.at = (x + way[0] * k / count, z + way[1] * k / count)
            self.send(**more)
            self.stage.advance(1.0 / self.rate)

    def lift(self) -> None:
        self.send(contact=False)

    def hold(self, seconds: float, **more: Any) -> None:
        """A pen held still, its samples coming (pressure and tilt)."""
        for _ in range(round(seconds * self.rate)):
            self.send(**more)
            self.stage.advance(1.0 / self.rate)

    def wait(self, seconds: float) -> None:
        self.stage.advance(seconds)

    def kinds(self) -> list[str]:
        """The kinds of commands, each id once; posture aside."""
        seen: dict[int, str] = {}
        for one in self.stage.received("command"):
            if type(one).__name__ != "Stand":
                seen[one.id] = type(one).__name__
        return list(seen.values())

    def poses(self) -> list[Any]:
        return self.stage.received("pose")[self.begun :]

    def hips(self) -> Array:
        """(F, 3) m, as (right, up, ahead)."""
        return np.array([one.root for one in self.poses()], dtype=np.float64) * np.array([-1.0, 1.0, 1.0])

    def headings(self) -> Array:
        """(F,) rad to the right of ahead."""
        out = []
        for one in self.poses():
            x, y, z, w = one.rotations[0].astype(np.float64)
            out.append(-atan2(2 * (x * z + w * y), 1 - 2 * (x * x + y * y)))
        return np.unwrap(np.array(out))

    def places(self) -> tuple[Array, Array]:
        """World positions (F, J, 3) and orientations (F, J, 4)."""
        positions, turns = zip(
            *(fk(SKELETON, one.root.astype(np.float64), one.rotations.astype(np.float64)) for one in self.poses()),
            strict=True,
        )
        return np.array(positions), np.array(turns)


EIGHT = [k * pi / 4 for k in range(8)]


def way(angle: float, length: float) -> tuple[float, float]:
    """(right, ahead) of an angle to the right of ahead."""
    return length * sin(angle), length * cos(angle)


@pytest.mark.parametrize("speed", [0.7, 1.2, 1.8, 3.0])
def test_walks_and_runs_at_the_pens_speed(speed: float) -> None:
    play = Play()
    play.at = (0.0, -2.9)
    play.move((0.0, 5.8), 5.8 / speed)
    play.lift()
    play.wait(3.0)
    hips = play.hips()
    assert play.kinds() == ["Locomotion"]
    assert hypot(hips[-1, 0], hips[-1, 2] - 5.8) < 0.06, "the last step ends at the path's end"
    middle = (hips[:, 2] > 2.5) & (hips[:, 2] < 3.9)
    assert 1.4 / (middle.sum() / 60.0) == pytest.approx(speed, rel=0.12)
    assert np.abs(hips[:, 0]).max() < 0.08


def test_a_very_fast_pen_is_followed_within_the_running_limit() -> None:
    play = Play()
    play.at = (0.0, -2.9)
    play.move((0.0, 5.8), 0.5)  # 11.6 m/s
    play.lift()
    play.wait(5.0)
    hips = play.hips()
    speeds = np.hypot(*np.diff(hips[:, [0, 2]], axis=0).T) * 60.0
    assert play.kinds() == ["Locomotion"]
    assert 2.5 < speeds.max() < RULES.fastest * 1.15
    assert hips[-1, 2] == pytest.approx(5.8, abs=0.06)


def test_catches_up_slows_and_waits_for_the_pen_and_goes_on() -> None:
    play = Play()
    play.at = (0.0, -2.9)
    play.move((0.0, 1.6), 1.0)
    play.wait(3.0)  # the pen rests on the tablet
    there = play.hips()[-1]
    assert there[2] == pytest.approx(1.6, abs=0.08)
    play.move((0.0, 1.6), 1.0)
    play.lift()
    play.wait(3.0)
    assert play.hips()[-1, 2] == pytest.approx(3.2, abs=0.08)
    assert np.diff(play.hips()[:, 2]).min() > -0.004, "never backwards"


def test_a_path_that_was_caught_up_with_ends_and_the_next_one_is_walked() -> None:
    play = Play()
    play.at = (0.0, -2.9)
    play.move((0.0, 1.6), 2.0)
    play.move((0.0, 0.03), 0.8)  # crawls until the figure is there
    play.lift()
    play.wait(1.5)
    assert play.interpreter.cores["tablet"].walk is None
    assert play.blender.core.walk is None
    play.move((0.0, 1.5), 1.5)
    play.lift()
    play.wait(2.5)
    assert play.kinds() == ["Locomotion", "Locomotion"]
    assert play.hips()[-1, 2] == pytest.approx(3.13, abs=0.08)


def test_what_comes_while_the_figure_waits_for_a_growing_path_is_done() -> None:
    play = Play()
    path = [PathPoint(x=0.0, z=0.1 * k, speed=1.2) for k in range(16)]
    play.stage.publish("command", Locomotion(id=7, path=path))  # its end is never said
    play.wait(3.0)
    further = [PathPoint(x=0.0, z=1.5 + 0.1 * k, speed=1.2) for k in range(11)]
    play.stage.publish("command", Locomotion(id=8, path=further, complete=True))
    play.wait(3.0)
    assert play.hips()[-1, 2] == pytest.approx(2.5, abs=0.06)


def test_slows_when_it_catches_up_with_a_pen_that_slows() -> None:
    play = Play()
    play.at = (0.0, -2.9)
    play.move((0.0, 2.0), 1.2)
    play.move((0.0, 0.6), 3.0)
    play.lift()
    play.wait(2.0)
    hips = play.hips()
    begun = 0.5 * RULES.longest_step
    assert hips[-1, 2] == pytest.approx(2.6, abs=0.08)
    late = (hips[:, 2] > 2.15) & (hips[:, 2] < 2.4)
    assert 0.25 / (late.sum() / 60.0) < 0.75
    assert begun < 2.0


@pytest.mark.parametrize("angle", EIGHT)
def test_a_short_stroke_steps_there_without_turning(angle: float) -> None:
    play = Play()
    play.move(way(angle, 0.45), 0.3)
    play.lift()
    play.wait(2.5)
    hips, headings = play.hips(), play.headings()
    goal = way(angle, 0.45)
    assert play.kinds() == ["Step"]
    assert hypot(hips[-1, 0] - goal[0], hips[-1, 2] - goal[1]) < 0.06
    assert abs(headings[-1]) < 0.06
    assert np.abs(headings).max() < 0.5, "it keeps its front"


def test_repeated_short_strokes_keep_stepping() -> None:
    play = Play()
    for _ in range(3):
        play.move(way(pi / 2, 0.4), 0.25)
        play.wait(1.6)
    play.lift()
    play.wait(1.0)
    assert play.kinds() == ["Step"] * 3
    assert play.hips()[-1, 0] == pytest.approx(1.2, abs=0.08)
    assert abs(play.headings()[-1]) < 0.06


@pytest.mark.parametrize("angle", [pi / 2, -pi / 2, 0.9 * pi, -0.75 * pi])
def test_a_long_stroke_aside_turns_and_then_walks(angle: float) -> None:
    play = Play()
    play.move(way(angle, 2.2), 1.8)
    play.lift()
    play.wait(4.5)
    hips, headings = play.hips(), play.headings()
    goal = way(angle, 2.2)
    assert play.kinds() == ["Locomotion"]
    assert hypot(hips[-1, 0] - goal[0], hips[-1, 2] - goal[1]) < 0.08
    assert abs(np.angle(np.exp(1j * (headings[-1] - angle)))) < 0.12
    along = hips[:, 0] * sin(angle) + hips[:, 2] * cos(angle)
    faced = np.abs(np.angle(np.exp(1j * (headings[along > 0.5] - angle))))
    assert faced.max() < 0.5, "turned before it walks"


@pytest.mark.parametrize("angle", EIGHT)
@pytest.mark.parametrize("length", [0.5, 0.75])
def test_lifted_and_landed_near_jumps_there_without_turning(angle: float, length: float) -> None:
    play = Play()
    play.hold(0.2)
    play.lift()
    play.wait(0.15)
    play.at = way(angle, length)
    play.send()
    play.wait(0.1)
    play.lift()
    play.wait(2.6)
    hips, headings = play.hips(), play.headings()
    assert play.kinds() == ["Jump"]
    assert hypot(hips[-1, 0] - play.at[0], hips[-1, 2] - play.at[1]) < 0.10
    assert abs(np.angle(np.exp(1j * headings[-1]))) < 0.10
    flying = [one for one in play.poses() if not (one.contacts.left_foot or one.contacts.right_foot)]
    assert len(flying) >= 8


@pytest.mark.parametrize("degrees", range(0, 360, 15))
def test_a_jump_almost_to_the_blue_line_lands_where_the_pen_did(degrees: int) -> None:
    play = Play()
    right, ahead = way(np.radians(degrees), 1.0)
    far = 0.98 * jump_range((-right, ahead), 0.0, RULES)
    play.hold(0.2)
    play.lift()
    play.wait(0.15)
    play.at = (far * right, far * ahead)
    play.send()
    play.wait(0.1)
    play.lift()
    play.wait(2.6)
    hips = play.hips()
    assert play.kinds() == ["Jump"]
    assert hypot(hips[-1, 0] - play.at[0], hips[-1, 2] - play.at[1]) < 0.03


def test_landed_at_the_same_place_jumps_up_the_higher_the_more_was_pressed() -> None:
    rise = []
    for pressure in (0.1, 0.6, 1.0):
        play = Play()
        play.hold(0.05, pressure=pressure)
        play.lift()
        play.wait(0.15)
        play.send(pressure=0.3)
        play.wait(0.1)
        play.lift()
        play.wait(2.6)
        assert play.kinds() == ["Jump"]
        hips = play.hips()
        rise.append(hips[:, 1].max() - hips[-1, 1])
        assert hypot(hips[-1, 0], hips[-1, 2]) < 0.05
    assert rise[0] + 0.05 < rise[1] < rise[2] - 0.05


def test_a_touch_far_away_goes_on_from_where_the_path_ended() -> None:
    play = Play()
    play.at = (0.0, -2.9)
    play.move((0.0, 2.0), 1.6)
    play.lift()
    play.wait(0.4)
    play.at = (-2.5, -2.9)  # on the other side of the tablet
    play.move((0.0, 2.0), 1.6)
    play.lift()
    play.wait(3.0)
    hips = play.hips()
    assert "Jump" not in play.kinds()
    assert hypot(hips[-1, 0], hips[-1, 2] - 4.0) < 0.08
    assert np.abs(hips[:, 0]).max() < 0.12


def test_pressing_ducks_standing_for_as_long_as_it_is_pressed() -> None:
    play = Play()
    play.hold(0.3)
    tall = play.hips()[-1, 1]
    play.hold(1.0, pressure=0.95)
    low = play.hips()[-1, 1]
    play.hold(1.0, pressure=0.7)
    half = play.hips()[-1, 1]
    play.hold(1.0, pressure=0.2)
    assert low < half - 0.05 < tall - 0.10
    assert play.hips()[-1, 1] == pytest.approx(tall, abs=0.03)
    assert play.kinds() == []


def test_pressing_ducks_walking_where_it_was_pressed() -> None:
    play = Play()
    play.at = (0.0, -2.9)
    play.move((0.0, 1.5), 1.2)
    play.move((0.0, 2.0), 1.7, pressure=0.95)
    play.move((0.0, 1.5), 1.2)
    play.lift()
    play.wait(3.5)
    hips = play.hips()
    assert play.kinds() == ["Locomotion"]
    upright = hips[(hips[:, 2] > 0.7) & (hips[:, 2] < 1.0), 1].mean()
    ducked = hips[(hips[:, 2] > 2.3) & (hips[:, 2] < 3.0), 1].mean()
    after = hips[(hips[:, 2] > 4.3) & (hips[:, 2] < 4.8), 1].mean()
    assert ducked < upright - 0.10
    assert after == pytest.approx(upright, abs=0.04)


def lean(play: Play, chosen: NDArray[np.bool_]) -> tuple[float, float]:
    """Where the head is off the hips, mean over chosen frames: (right, ahead) m."""
    positions, _ = play.places()
    off = (positions[:, HEAD] - positions[:, HIPS])[chosen].mean(axis=0)
    return -float(off[0]), float(off[2])


@pytest.mark.parametrize("angle", EIGHT)
def test_tilt_leans_and_bends_standing_toward_the_pens_cap(angle: float) -> None:
    play = Play()
    play.hold(0.5)
    rest = lean(play, np.arange(len(play.poses())) > len(play.poses()) - 5)
    # Azimuth counts clockwise from the tablet's right.
    play.hold(1.5, altitude=0.7, azimuth=(angle - pi / 2) % (2 * pi))
    tilted = lean(play, np.arange(len(play.poses())) > len(play.poses()) - 5)
    off = tilted[0] - rest[0], tilted[1] - rest[1]
    assert hypot(*off) > 0.12
    assert abs(np.angle(np.exp(1j * (atan2(*off) - angle)))) < 0.45


@pytest.mark.parametrize("angle", EIGHT)
def test_tilt_leans_and_bends_walking_toward_the_pens_cap(angle: float) -> None:
    upright, tilted = Play(), Play()
    for play, more in ((upright, {}), (tilted, {"altitude": 0.7, "azimuth": (angle - pi / 2) % (2 * pi)})):
        play.at = (0.0, -2.9)
        play.move((0.0, 4.5), 4.0, **more)
        play.lift()
        play.wait(2.5)
        assert play.kinds() == ["Locomotion"]
    offs = []
    for play in (upright, tilted):
        ahead = play.hips()[:, 2]
        offs.append(lean(play, (ahead > 1.5) & (ahead < 3.9)))
    off = offs[1][0] - offs[0][0], offs[1][1] - offs[0][1]
    assert hypot(*off) > 0.08
    assert abs(np.angle(np.exp(1j * (atan2(*off) - angle)))) < 0.55


def test_the_camera_never_turns_and_keeps_figure_or_path_in_the_picture() -> None:
    from bunraku.figure.camera import project

    play = Play()
    play.at = (0.0, -2.9)
    play.move((0.0, 5.8), 2.6)
    camera = play.stage.last("camera")
    assert play.stage.received("camera")[0].rotation == pytest.approx(camera.rotation)
    end = project(camera, np.array([0.0, 0.0, 5.8]))
    assert (np.abs(end - 0.5) < 0.5).all(), "the path's end is seen while it is drawn"
    play.lift()
    play.wait(6.0)
    root = project(play.stage.last("camera"), play.poses()[-1].root.astype(np.float64))
    assert (np.abs(root - 0.5) < 0.3).all(), "the figure is followed"


def test_a_pens_twist_turns_the_standing_body() -> None:
    play = Play()
    play.hold(0.2, contact=False, twist=1.0)
    for k in range(120):
        play.send(contact=False, twist=1.0 + 0.9 * k / 119)
        play.wait(1.0 / 120.0)
    play.wait(2.0)
    assert play.headings()[-1] == pytest.approx(0.9, abs=0.1), "clockwise, as seen from above"
    assert hypot(play.hips()[-1, 0], play.hips()[-1, 2]) < 0.12


def test_out_of_range_in_mid_stroke_walks_to_where_the_pen_was_seen_last() -> None:
    play = Play()
    play.at = (0.0, -2.9)
    play.move((0.0, 2.0), 1.6)
    play.send(contact=False, in_range=False)
    play.wait(3.5)
    assert play.kinds() == ["Locomotion"]
    assert hypot(play.hips()[-1, 0], play.hips()[-1, 2] - 2.0) < 0.08
    assert play.blender.core.walk is None


def test_the_pen_walks_over_hills_with_its_feet_on_the_ground() -> None:
    file = Path(__file__).parents[2] / "examples" / "hills.npz"
    play = Play(blender={"ground": str(file)})
    play.at = (-1.5, -2.9)
    ground = play.blender.core.player.ground
    play.move((0.0, 2.4), 2.0)
    play.move((2.4, 1.2), 2.2)
    worst, before = 0.0, np.zeros(3)
    for _ in range(300):
        play.wait(1 / 60)
        player = play.blender.core.player
        for side in range(2):
            if int(player.state.mode[side]) == LOCKED:
                mark = player.state.prints[side]
                worst = max(worst, abs(float(mark[1]) - ground(float(mark[0]), float(mark[2]))))
        assert player.beyond < 1e-3, "no leg is too short"
        root = np.array(player.root)
        assert not before.any() or float(np.linalg.norm(root - before)) < 0.08, "no pop"
        before = root
    play.lift()
    play.wait(3.0)
    assert worst < 0.01
    hips = play.hips()
    assert hypot(hips[-1, 0] - 2.4, hips[-1, 2] - 3.6) < 0.08
    rise = ground(float(play.poses()[-1].root[0]), float(play.poses()[-1].root[2]))
    assert hips[-1, 1] - rise == pytest.approx(hips[0, 1] - ground(0.0, 0.0), abs=0.06)


@pytest.mark.parametrize("rate", [30.0, 200.0])
def test_the_same_hand_moves_the_figure_the_same_at_any_sample_rate(rate: float) -> None:
    random = np.random.default_rng(round(rate))
    play = Play(rate)
    play.at = (0.0, -2.9)

    def noisy(length: tuple[float, float], seconds: float) -> None:
        x, z = play.at
        count = round(seconds * rate)
        for k in range(count + 1):
            play.at = (x + length[0] * k / count, z + length[1] * k / count)
            place = play.at
            if k in (0, count) or random.random() > 0.1:  # a tenth of the samples is lost
                jitter = random.normal(0.0, 0.004, 2)
                play.at = (place[0] + float(jitter[0]), place[1] + float(jitter[1]))
                play.send(pressure=float(np.clip(0.3 + random.normal(0.0, 0.05), 0.0, 1.0)))
            play.at = place
            play.stage.advance(1.0 / rate + float(random.uniform(-0.3, 0.3)) / rate)

    noisy((0.0, 2.0), 1.6)
    play.send(contact=False, in_range=False)  # out of range in mid-stroke
    play.wait(3.5)
    assert play.kinds() == ["Locomotion"]
    assert play.hips()[-1, 2] == pytest.approx(2.0, abs=0.08)
    noisy((0.45, 0.0), 0.3)
    play.send(contact=False)
    play.wait(2.5)
    assert play.kinds() == ["Locomotion", "Step"]
    play.send()
    play.wait(0.1)
    play.send(contact=False)
    play.wait(0.3)
    play.at = (play.at[0], play.at[1] + 0.8)
    play.send()
    play.wait(3.0)
    assert play.kinds() == ["Locomotion", "Step", "Jump"]
    assert play.hips()[-1, 2] == pytest.approx(2.8, abs=0.15)
