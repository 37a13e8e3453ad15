"""The touch node: contract of its topic whatever the driver, and the written performance."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bunraku.figure.camera import Orbit, default_camera, metres_per_height, project
from bunraku.figure.default import default_figure
from bunraku.msgs import Contact, Event, Touch
from bunraku.nodes.input_touch.frame import Ledger, Sample
from bunraku.nodes.input_touch.node import InputTouch
from bunraku.nodes.input_touch.performance import Curve, PerformanceError, parse
from bunraku.runtime.driver import DriverProblem, Silence, find, known, listeners_wanted
from bunraku.runtime.memory import MemoryStage
from bunraku.runtime.node import Node, ParamProblem, subscribe

TWO = """
[[touch]]
at = [0.25, 0.5]
start = 0.5
path = [[1.0, 0.75, 0.5]]
hold = 0.25

[[touch]]
at = [0.1, 0.2]
start = 1.0
hold = 0.5
pressure = [[0.0, 0.2], [0.5, 0.8]]
ellipse = [0.012, 0.009, 0.3]
end = "cancel"
"""


class Ear(Node):
    """Hears touches."""

    name = "ear"
    journal = False

    @subscribe("touch", Touch)
    def on_touch(self, msg: Touch) -> None:
        pass


def play(text: str, tmp_path: Path, *, seconds: float = 3.0, **params: object) -> MemoryStage:
    file = tmp_path / "two.touch"
    file.write_text(text)
    stage = MemoryStage()
    stage.add(Ear)
    stage.add(InputTouch, script=str(file), **params)
    stage.advance(seconds)
    return stage


def test_a_performance_becomes_frames_of_all_live_contacts(tmp_path: Path) -> None:
    stage = play(TWO, tmp_path, rate=100.0)
    said = stage.received("touch")
    by_id: dict[int, list[tuple[str, float]]] = {}
    for message in said:
        assert message.device == "script-two"
        assert message.origin == message.stamp
        for one in message.contacts:
            by_id.setdefault(one.id, []).append((one.phase, one.x))
    for phases in by_id.values():
        names = [phase for phase, _ in phases]
        assert names[0] == "down"
        assert set(names[1:-1]) == {"move"}
    assert by_id[0][-1][0] == "up"
    assert by_id[1][-1][0] == "cancel"
    assert by_id[0][0][1] == pytest.approx(0.25)
    assert by_id[0][-1][1] == pytest.approx(0.75)
    # 1.25 s at 100 Hz, and the up; both are listed in the same messages while both are there.
    assert len(by_id[0]) == pytest.approx(126, abs=2)
    assert sum(len(message.contacts) == 2 for message in said) == pytest.approx(51, abs=2)
    assert np.diff([message.stamp for message in said]).max() <= 10_000_001
    second = [one for message in said for one in message.contacts if one.id == 1]
    assert second[0].pressure == pytest.approx(0.2)
    assert second[0].major == pytest.approx(0.012)
    assert max(one.pressure or 0.0 for one in second) <= 0.8


def test_it_waits_for_its_listeners_and_ends_itself(tmp_path: Path) -> None:
    file = tmp_path / "one.touch"
    file.write_text("[[touch]]\nat = [0.5, 0.5]\nhold = 0.2\n")
    stage = MemoryStage()
    stage.add(InputTouch, script=str(file), wait_for="interpreter,recorder", delay=0.5)
    stage.add(Ear)
    stage.advance(2.0)
    assert stage.received("touch") == []
    stage.add(Ear, name="second")
    stage.advance(0.4)
    assert stage.received("touch") == []
    assert stage.status is None
    stage.advance(0.5)
    assert [one.contacts[0].phase for one in (stage.received("touch")[0], stage.last("touch"))] == ["down", "up"]
    assert stage.status == 0


def test_it_loops(tmp_path: Path) -> None:
    stage = play("[[touch]]\nat=[0.5,0.5]\nhold=0.2\n", tmp_path, seconds=3.0, at_end="loop", pause=0.3)
    downs = sum(one.contacts[0].phase == "down" for one in stage.received("touch"))
    assert downs == 6
    assert stage.status is None


def test_a_part_s_name_means_its_place_at_ease_seen_by_the_default_camera() -> None:
    one = parse('[[touch]]\non = "left_foot"\nhold = 1.0\n').strokes[0].at(0.0)
    figure = default_figure()
    foot = figure.role("leftFoot")
    assert (one.x, one.y) == pytest.approx(
        tuple(project(default_camera(), figure.rest_positions[foot] + figure.box_centers[foot]))
    )
    moved = parse('[[touch]]\non = "left_foot"\ndrag = [[1.0, 0.0, 0.5]]\n').strokes[0]
    assert moved.at(2.0).x == pytest.approx(one.x)
    assert moved.at(2.0).y < one.y - 0.1


def test_after_a_swipe_parts_are_where_the_new_view_shows_them() -> None:
    """The swipe of the first touch, as the interpreter takes it, brings the view that the second one names."""
    text = """
        [[touch]]
        at = [0.85, 0.3]
        path = [[0.8, 0.6905, 0.3183]]

        [[touch]]
        on = "left_foot"
        view = [1.4427, 0.1763]
        start = 1.0
        drag = [[0.5, 0.1, 0.2]]
    """
    swipe, foot = parse(text).strokes
    begin, end = swipe.path.v[0], swipe.path.v[-1]
    orbit = Orbit()
    turned = Orbit(
        azimuth=orbit.azimuth - (end[0] - begin[0]) * orbit.aspect * np.pi,
        elevation=orbit.elevation + (end[1] - begin[1]) * np.pi,
    )
    assert (turned.azimuth, turned.elevation) == pytest.approx((1.4427, 0.1763), abs=2e-4)
    figure = default_figure()
    joint = figure.role("leftFoot")
    place = project(turned.camera(), figure.rest_positions[joint] + figure.box_centers[joint])
    assert tuple(foot.path.v[0]) == pytest.approx(tuple(place), abs=1e-4)
    tall = metres_per_height(turned.camera(), figure.rest_positions[joint] + figure.box_centers[joint])
    moved = foot.path.v[-1] - foot.path.v[0]
    assert tuple(moved) == pytest.approx((0.1 / tall * 9 / 16, -0.2 / tall), rel=1e-3)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "at least one"),
        ("[[touch]]\nat=[0,0]\non='head'\nhold=1", "either on"),
        ("[[touch]]\non='tail'\nhold=1", "no part"),
        ("[[touch]]\nat=[0,0]", "no time"),
        ("[[touch]]\nat=[0,0]\npath=[[1,0,0],[0.5,1,1]]", "rise"),
        ("[[touch]]\nat=[0,nan]\nhold=1", "no number"),
        ("[[touch]]\nat=[0,0]\nhold=1\nspeed=2", "no such key"),
        ("[[touch]]\nat=[0,0]\nhold=1\npressure=2", "outside"),
        ("[[touch]]\nat=[0,0]\ndrag=[[1,90,0]]", "runs off"),
        ("title = ", "not TOML"),
        ("touch = 3", "at least one"),
        ("touch = [3]", "must be"),
        ("[[touch]]\nat=[0,0]\nhold=1\nend='off'", "neither"),
        ("[[touch]]\nat=[0,0]\npath=3", "rows"),
        ("[[touch]]\non='head'\nhold=1\nview=[4,0]", "outside"),
        ("[[touch]]\non='head'\nhold=1\nview=1", "list of 2"),
    ],
)
def test_faults_of_a_file_are_named_in_one_line(text: str, says: str) -> None:
    with pytest.raises(PerformanceError, match=says) as caught:
        parse(text, "file.touch")
    assert str(caught.value).startswith("file.touch: ")
    assert "\n" not in str(caught.value)


def test_a_missing_file_or_driver_is_refused_before_anything_runs(tmp_path: Path) -> None:
    with pytest.raises(ParamProblem, match="cannot be read"):
        MemoryStage().add(InputTouch, script=str(tmp_path / "none.touch"))
    with pytest.raises(ParamProblem, match="parameter script"):
        MemoryStage().add(InputTouch)
    with pytest.raises(ParamProblem, match="no touch driver 'kinect'"):
        MemoryStage().add(InputTouch, drivers=["kinect"])
    with pytest.raises(DriverProblem, match="has: evdev, script, tuio, web"):
        find("touch", "kinect", InputTouch.built_in)
    assert [find("touch", name, InputTouch.built_in).name for name in known("touch", InputTouch.built_in)] == [
        "evdev",
        "script",
        "tuio",
        "web",
    ]


def test_listeners_wanted() -> None:
    assert listeners_wanted(" 3 ") == 3
    assert listeners_wanted("interpreter, recorder") == 2
    assert listeners_wanted("") == 0


@given(st.lists(st.tuples(st.floats(0.01, 2.0), st.floats(-1.0, 1.0)), min_size=1, max_size=8), st.booleans())
def test_a_curve_passes_its_points_and_never_overshoots(steps: list[tuple[float, float]], linear: bool) -> None:
    times = np.cumsum([dt for dt, _ in steps])
    values = [v for _, v in steps]
    curve = Curve(times, [[v] for v in values], linear=linear)
    for t, v in zip(times, values, strict=True):
        assert curve.at(float(t))[0] == pytest.approx(v, abs=1e-9)
    for k in range(len(times) - 1):
        inside = [curve.at(t)[0] for t in np.linspace(times[k], times[k + 1], 9)]
        assert min(inside) >= min(values[k : k + 2]) - 1e-9
        assert max(inside) <= max(values[k : k + 2]) + 1e-9


@given(st.lists(st.sets(st.integers(0, 5)), max_size=20))
def test_the_ledger_lists_each_finger_down_then_moves_then_once_up(frames: list[set[int]]) -> None:
    ledger = Ledger()
    state: dict[int, str] = {}
    for live in [*frames, set()]:
        said = {one.id: one.phase for one in ledger.frame({key: Sample(0.0, 0.0) for key in sorted(live)})}
        assert {key for key, phase in said.items() if phase != "up"} == live
        for key, phase in said.items():
            assert phase == ({"none": "down"}.get(state.get(key, "none"), "move") if key in live else "up")
            if phase == "up":
                assert state[key] in ("down", "move")
        state = {key: phase for key, phase in said.items() if phase != "up"}


def page(device: str, kind: str, *contacts: Contact) -> Event:
    return Event(device=device, kind=kind, contacts=list(contacts), size_m=(0.2, 0.1))  # type: ignore[arg-type]


def test_the_page_s_fingers_and_its_closing() -> None:
    stage = MemoryStage()
    stage.add(InputTouch, drivers=["web"])
    finger = Contact(id=3, phase="down", x=0.5, y=0.25, major=0.01, pressure=0.4)
    stage.publish("web/events", page("web-a", "touch", finger), origin=77)
    first = stage.last("touch")
    assert (first.device, first.origin, first.size_m) == ("web-a", 77, (0.2, 0.1))
    assert (first.contacts[0].phase, first.contacts[0].major) == ("down", 0.01)
    # The same finger of another page is another finger; a move that was never put down is put down.
    stage.publish("web/events", page("web-b", "touch", Contact(id=3, phase="move", x=0.1, y=0.1)))
    assert [one.phase for one in stage.last("touch").contacts] == ["down"]
    assert stage.last("device/web_a_touch").connected
    stage.publish("web/events", page("web-a", "gone"))
    assert [(one.id, one.phase) for one in stage.last("touch").contacts] == [(3, "cancel")]
    assert not stage.last("device/web_a_touch").connected
    stage.publish("web/events", page("web-b", "touch", Contact(id=3, phase="cancel", x=0.1, y=0.1)))
    assert [one.phase for one in stage.last("touch").contacts] == ["cancel"]
    assert stage.last("device/web_b_touch").connected
    # A page that comes back is connected again.
    stage.publish("web/events", page("web-a", "touch", finger))
    assert stage.last("device/web_a_touch").connected


def test_a_page_that_is_silent_while_it_holds_contacts_loses_them() -> None:
    stage = MemoryStage()
    stage.add(InputTouch, drivers=["web"])
    finger = Contact(id=3, phase="down", x=0.5, y=0.25)
    stage.publish("web/events", page("web-a", "touch", finger))
    for _ in range(20):  # a page tells what is held four times a second
        stage.advance(0.25)
        stage.publish("web/events", page("web-a", "touch", Contact(id=3, phase="move", x=0.5, y=0.25)))
    assert [one.phase for one in stage.last("touch").contacts] == ["move"]
    stage.advance(1.4)
    assert [one.phase for one in stage.last("touch").contacts] == ["move"]
    stage.advance(0.3)
    assert [(one.id, one.phase) for one in stage.last("touch").contacts] == [(3, "cancel")]
    assert (stage.last("device/web_a_touch").connected, stage.last("device/web_a_touch").note) == (
        False,
        "the page is silent",
    )
    count = len(stage.received("touch"))
    stage.advance(5.0)
    assert len(stage.received("touch")) == count
    # It was only frozen. The figure has moved meanwhile: the finger takes hold of nothing until it is put down again.
    still = Contact(id=3, phase="move", x=0.6, y=0.25)
    other = Contact(id=4, phase="down", x=0.1, y=0.1)
    stage.publish("web/events", page("web-a", "touch", still, other))
    assert [(one.id, one.phase) for one in stage.last("touch").contacts] == [(4, "down")]
    assert stage.last("device/web_a_touch").connected
    stage.publish("web/events", page("web-a", "touch", still, Contact(id=4, phase="move", x=0.1, y=0.1)))
    stage.publish("web/events", page("web-a", "touch", Contact(id=3, phase="up", x=0.6, y=0.25)))
    assert [(one.id, one.phase) for one in stage.last("touch").contacts] == [(4, "up")]
    stage.publish("web/events", page("web-a", "touch", finger))
    assert [(one.id, one.phase) for one in stage.last("touch").contacts] == [(3, "down")]


def test_fingers_stay_taken_away_however_often_their_page_falls_silent() -> None:
    stage = MemoryStage()
    stage.add(InputTouch, drivers=["web"])
    first, second = (Contact(id=k, phase="down", x=0.5, y=0.25) for k in (1, 2))
    moved = [Contact(id=k, phase="move", x=0.5, y=0.3) for k in (1, 2)]
    stage.publish("web/events", page("web-a", "touch", first))
    stage.advance(2.0)
    stage.publish("web/events", page("web-a", "touch", moved[0], second))
    stage.advance(2.0)
    assert [(one.id, one.phase) for one in stage.last("touch").contacts] == [(2, "cancel")]
    stage.publish("web/events", page("web-a", "touch", *moved))
    assert stage.last("touch").contacts == []


def test_a_page_that_holds_nothing_may_be_silent() -> None:
    stage = MemoryStage()
    stage.add(InputTouch, drivers=["web"])
    stage.publish("web/events", page("web-a", "touch", Contact(id=3, phase="down", x=0.5, y=0.25)))
    stage.publish("web/events", page("web-a", "touch", Contact(id=3, phase="up", x=0.5, y=0.25)))
    stage.advance(30.0)
    assert stage.last("device/web_a_touch").connected
    assert [one.phase for one in stage.last("touch").contacts] == ["up"]


def test_silence_does_not_count_while_the_node_itself_was_held_up() -> None:
    silence, second = Silence(), 10**9
    silence.heard["web-a"] = 10 * second
    assert silence.late(10 * second, 1.5) == []
    assert silence.late(14 * second, 1.5) == []  # four seconds without a look: what came is not read yet
    for tenth in range(141, 155):
        assert silence.late(tenth * second // 10, 1.5) == []
    assert silence.late(156 * second // 10, 1.5) == ["web-a"]


def test_pages_that_went_make_room_for_others() -> None:
    stage = MemoryStage()
    stage.add(InputTouch, drivers=["web"])
    for visitor in range(40):
        name = f"web-{visitor}"
        stage.publish("web/events", page(name, "touch", Contact(id=1, phase="down", x=0.5, y=0.5)))
        assert stage.last("touch").device == name
        stage.publish("web/events", page(name, "gone"))
    for visitor in range(100, 120):
        stage.publish("web/events", page(f"web-{visitor}", "touch", Contact(id=1, phase="down", x=0.5, y=0.5)))
    assert stage.last("touch").device == "web-115"  # sixteen at once


def test_a_performance_that_is_not_there_is_bad_input(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "bunraku.cli", "run", "input_touch", "--set", "script:=none.touch"]
    environment = {**os.environ, "XDG_RUNTIME_DIR": str(tmp_path), "BUNRAKU_STAGE": "t"}
    done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "none.touch: cannot be read" in line
