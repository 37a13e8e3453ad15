"""Gamepads: what the page, the kernel or a written performance says arrives as `pad`, and the figure walks by it."""

from math import atan2, hypot, pi
from pathlib import Path

import numpy as np
import pytest

from bunraku.msgs import Event, Pad
from bunraku.nodes.blender.node import Blender
from bunraku.nodes.input_pad.evdev import PadState
from bunraku.nodes.input_pad.node import InputPad
from bunraku.nodes.input_pad.performance import PerformanceError, load
from bunraku.nodes.interpreter.node import Interpreter
from bunraku.nodes.interpreter.pad import stick
from bunraku.runtime.memory import MemoryStage


def test_a_pages_gamepad_is_said_and_let_go_when_the_page_is_gone_or_silent() -> None:
    stage = MemoryStage()
    stage.add(InputPad, drivers=["web"], lost=1.0)
    for device in ("web-a", "web-b"):
        stage.publish("web/events", Event(device=device, kind="pad", axes=[0.5, -1.0], buttons=[True]))
    first = stage.received("pad")[0]
    assert (first.device, first.axes, first.buttons) == ("web-a", [0.5, -1.0], [True])
    stage.publish("web/events", Event(device="web-a", kind="gone"))
    last = stage.last("pad")
    assert (last.device, last.axes, last.buttons) == ("web-a", [0.0, 0.0], [False])
    assert not stage.last("device/web_a_pad").connected
    stage.advance(1.5)
    assert stage.last("pad").device == "web-b"
    assert stage.last("pad").axes == [0.0, 0.0]


def test_a_performance_moves_evenly_and_holds_buttons(tmp_path: Path) -> None:
    file = tmp_path / "a.pad"
    file.write_text(
        "length = 3\n[[at]]\ntime = 1.0\nleft = [0.0, -1.0]\n[[at]]\ntime = 2.0\nleft = [1.0, 0.0]\nbuttons = [1]\n"
    )
    performance = load(file)
    assert performance.at(0.5)[0] == pytest.approx([0.0, -0.5, 0.0, 0.0])
    axes, buttons = performance.at(1.5)
    assert axes == pytest.approx([0.5, -0.5, 0.0, 0.0])
    assert not any(buttons)
    assert performance.at(2.5)[1][1]
    stage = MemoryStage()
    stage.add(InputPad, drivers=["script"], script=str(file), wait_for="0")
    stage.advance(3.1)
    assert stage.last("pad").axes == [0.0] * 4
    assert stage.status == 0


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "at"),
        ("[[at]]\ntime = -1\n", "time"),
        ("[[at]]\ntime = 1\n[[at]]\ntime = 1\n", "later"),
        ("[[at]]\ntime = 1\nleft = [2, 0]\n", "left"),
        ("[[at]]\ntime = 1\nbuttons = [99]\n", "buttons"),
        ("[[at]]\ntime = 1\nstick = 3\n", "unknown key"),
        ("length = 0.5\n[[at]]\ntime = 1\n", "length"),
    ],
)
def test_a_performance_that_cannot_be_played_says_why(tmp_path: Path, text: str, why: str) -> None:
    file = tmp_path / "a.pad"
    file.write_text(text)
    with pytest.raises(PerformanceError, match=why):
        load(file)


def test_kernel_events_become_frames_and_a_loss_spoils_none() -> None:
    state = PadState({0: (0, 255), 1: (-32768, 32767)})
    assert not state.event(3, 0, 255)
    state.event(3, 1, -32768)
    state.event(1, 0x131, 1)
    assert state.event(0, 0, 0)
    assert state.axes[:2] == [1.0, -1.0]
    assert state.buttons[:3] == [False, True, False]
    state.event(0, 3, 0)
    state.event(1, 0x131, 0)
    assert state.buttons[1], "what comes after a loss is incomplete"
    assert not state.event(0, 0, 0)
    state.event(1, 0x131, 0)
    assert state.event(0, 0, 0)
    assert not state.buttons[1]


def test_dead_zone_is_radial_and_full_tilt_is_one() -> None:
    assert stick([0.1, 0.1], (0, 1), 0.15) == (0.0, 0.0)
    assert stick([], (0, 1), 0.15) == (0.0, 0.0)
    assert hypot(*stick([1.0, 1.0], (0, 1), 0.15)) == pytest.approx(1.0)
    assert stick([0.0, -1.0], (0, 1), 0.15) == pytest.approx((0.0, 1.0))


class Play:
    """A gamepad, interpreter and blender; the camera looks along +Z: stick up is ahead, right is -X."""

    def __init__(self) -> None:
        self.stage = MemoryStage()
        self.interpreter = self.stage.add(Interpreter, azimuth=pi - 1e-9, elevation=0.5)
        self.blender = self.stage.add(Blender, skeleton=True, remap={"motion": "pose"}, show_overlay=False)
        self.stage.advance(0.5)

    def hold(self, seconds: float, left: tuple[float, float] = (0, 0), right: tuple[float, float] = (0, 0),
             *buttons: int) -> None:  # fmt: skip
        for _ in range(round(seconds * 60)):
            self.stage.publish(
                "pad", Pad(device="p", axes=[*left, *right], buttons=[number in buttons for number in range(16)])
            )
            self.stage.advance(1 / 60)

    def hips(self) -> np.ndarray:
        """(F, 3) m as (right, up, ahead)."""
        return np.array([one.root for one in self.stage.received("pose")], dtype=np.float64) * [-1.0, 1.0, 1.0]

    def kinds(self) -> list[str]:
        seen = {one.id: type(one).__name__ for one in self.stage.received("command")}
        return [kind for kind in seen.values() if kind != "Stand"]


@pytest.mark.parametrize(("tilt", "low", "high"), [(0.5, 0.7, 1.4), (1.0, 2.7, 3.9)])
def test_the_left_stick_is_a_velocity(tilt: float, low: float, high: float) -> None:
    play = Play()
    play.hold(3.5, (0.0, -tilt))
    hips = play.hips()
    speed = (hips[-1, 2] - hips[-61, 2]) / 1.0
    assert low < speed < high
    assert np.abs(hips[:, 0]).max() < 0.1
    play.hold(2.5)
    stopped = play.hips()
    assert np.abs(stopped[-1] - stopped[-10]).max() < 0.02
    assert play.kinds() == ["Locomotion"]


def test_turning_the_stick_bends_the_walk() -> None:
    play = Play()
    play.hold(2.0, (0.0, -0.6))
    play.hold(2.5, (0.6, 0.0))
    hips = play.hips()
    way = hips[-1] - hips[-30]
    assert abs(atan2(way[0], way[2]) - pi / 2) < 0.15


def test_the_right_stick_leans_and_bends_standing_and_walking() -> None:
    for right, lean in (((1.0, 0.0), (-0.70, 0.0)), ((0.0, -1.0), (0.0, 0.70))):
        play = Play()
        play.hold(0.5, (0, 0), right)
        stand = play.stage.last("command")
        assert (stand.tilt, stand.bend) == pytest.approx(lean, abs=0.02)
        play.hold(1.0, (0.0, -0.5), right)
        end = play.stage.last("command").path[-1]
        assert (end.tilt, end.bend) == pytest.approx(lean, abs=0.05)
        play.hold(2.5)
        assert play.blender.core.player.posture == pytest.approx([0.0, 0.0, 0.0], abs=0.02)


def test_the_right_stick_aims_steps_and_jumps_with_a_button() -> None:
    play = Play()
    play.hold(0.1, (0, 0), (1.0, 0.0), 1)
    play.hold(2.0)
    assert play.kinds() == ["Step"]
    assert play.hips()[-1, 0] == pytest.approx(0.60, abs=0.06)
    play.hold(0.1, (0, 0), (0.0, -0.8), 0)
    play.hold(2.5)
    assert play.kinds() == ["Step", "Jump"]
    assert 0.5 < play.hips()[-1, 2] < 1.3
    play.hold(0.1, (0, 0), (0, 0), 0)
    play.hold(2.5)
    assert play.stage.received("command")[-1].goal is None


def test_the_duck_button_ducks_the_longer_the_lower() -> None:
    play = Play()
    play.hold(0.3)
    tall = play.hips()[-1, 1]
    play.hold(0.35, (0, 0), (0, 0), 5)
    some = play.hips()[-1, 1]
    play.hold(1.5, (0, 0), (0, 0), 5)
    low = play.hips()[-1, 1]
    play.hold(1.5)
    assert low < some - 0.03 < tall - 0.03
    assert play.hips()[-1, 1] == pytest.approx(tall, abs=0.03)


@pytest.mark.parametrize("tilt", [0.3, 0.7, 1.0])
@pytest.mark.parametrize("frames", [1, 6])
def test_a_stick_that_is_let_go_stops_the_figure_as_people_stop(tilt: float, frames: int) -> None:
    stage = MemoryStage()
    stage.add(Interpreter, azimuth=pi - 1e-9, elevation=0.5, distance=6.5)
    blender = stage.add(Blender, skeleton=True, remap={"motion": "pose"}, show_overlay=False)

    def push(share: float) -> None:
        stage.publish("pad", Pad(device="p", axes=[0.0, -tilt * share, 0.0, 0.0], buttons=[False] * 8))
        stage.advance(1 / 60)

    for _ in range(200):
        push(1.0)
    player = blender.core.player
    fast, begin, speeds = player.speed, player.place.z, []
    for k in range(150):
        push(max(0.0, 1.0 - (k + 1) / frames))
        speeds.append(player.speed)
    slowing = -np.diff(speeds) * 60.0
    assert player.free
    assert np.convolve(slowing, np.full(4, 0.25), "valid").max() < 6.5
    assert 0.25 < player.place.z - begin < 0.5 + fast**2 / (2.0 * 4.5)
