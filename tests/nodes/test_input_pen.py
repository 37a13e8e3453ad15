"""The pen's node: what a page or a written performance does arrives as `pen` messages."""

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bunraku.figure.camera import default_camera, project
from bunraku.msgs import Event, Pen, PenSample
from bunraku.nodes.input_pen.node import InputPen
from bunraku.nodes.input_pen.performance import PerformanceError, load
from bunraku.runtime.memory import MemoryStage
from bunraku.runtime.params import ParamProblem


def sample(time: float, **fields: object) -> PenSample:
    return PenSample(time=time, x=0.4, y=0.6, **fields)  # type: ignore[arg-type]


def test_every_coalesced_sample_is_said_with_its_own_time() -> None:
    stage = MemoryStage()
    stage.add(InputPen)
    samples = [
        sample(100.0, contact=True, pressure=0.25, altitude=1.0, azimuth=2.0),
        sample(105.0, contact=True, pressure=0.5, twist=0.3, buttons=3),
    ]
    stage.publish("web/events", Event(device="web-ab", kind="pen", size_m=(0.2, 0.1), pen=samples), origin=10**18)
    first, second = stage.received("pen")
    assert (first.device, first.size_m, first.contact, first.pressure) == ("web-ab", (0.2, 0.1), True, 0.25)
    assert (first.altitude, first.azimuth, first.twist) == (1.0, 2.0, None)
    assert (second.twist, second.buttons, second.pressure) == (0.3, 3, 0.5)
    assert second.origin == 10**18
    assert first.origin == 10**18 - 5_000_000
    device = stage.last("device/web_ab_pen")
    assert device.connected
    assert device.kind == "pen"
    assert device.fields == ["pressure", "altitude", "azimuth", "twist"]


def test_a_page_that_goes_away_lifts_its_pen() -> None:
    stage = MemoryStage()
    stage.add(InputPen)
    stage.publish("web/events", Event(device="web-ab", kind="pen", pen=[sample(1.0, contact=True, pressure=1.0)]))
    stage.publish("web/events", Event(device="web-ab", kind="gone"))
    last = stage.last("pen")
    assert not last.in_range
    assert not last.contact
    assert last.pressure == 0.0
    assert (last.x, last.y) == (0.4, 0.6)
    assert not stage.last("device/web_ab_pen").connected
    stage.clear()
    stage.publish("web/events", Event(device="web-ab", kind="gone"))
    stage.publish("web/events", Event(device="web-cd", kind="gone"))
    assert stage.received("pen") == []


def test_a_silent_page_loses_a_pen_that_touches_but_not_one_that_hovers() -> None:
    stage = MemoryStage()
    stage.add(InputPen, lost=1.0)
    stage.publish("web/events", Event(device="web-ab", kind="pen", pen=[sample(1.0, contact=True)]))
    stage.publish("web/events", Event(device="web-cd", kind="pen", pen=[sample(1.0)]))
    stage.advance(0.9)
    assert len(stage.received("pen")) == 2
    stage.advance(0.5)
    said = stage.received("pen")
    assert [(one.device, one.in_range) for one in said[2:]] == [("web-ab", False)]
    stage.clear()
    # It was only frozen: the pen draws on when it is lifted and put down again, not from where it is now.
    for contact in (True, True, False, True):
        stage.publish("web/events", Event(device="web-ab", kind="pen", pen=[sample(2.0, contact=contact)]))
    assert [one.contact for one in stage.received("pen")] == [False, True]


PERFORMANCE = """
title = "A stroke"
[[stroke]]
start = 0.5
ground = [[0.0, 0.0, 0.5], [1.0, 0.8, 0.5]]
pressure = [[0.0, 0.2], [1.0, 0.8]]
tilt = [[0.0, 90, 350], [1.0, 50, 10]]
hover = 0.2
"""


def write(folder: Path, text: str) -> str:
    path = folder / "walk.pen"
    path.write_text(text)
    return str(path)


def test_a_written_stroke_is_played_on_the_ground(tmp_path: Path) -> None:
    stage = MemoryStage()
    heard: list[Pen] = []
    stage.publish("pen", Pen(device="other", in_range=False, contact=False, x=0.0, y=0.0))
    node = stage.add(InputPen, drivers=["script"], script=write(tmp_path, PERFORMANCE), wait_for="0", rate=100.0)
    stage.clear()
    stage.advance(2.5)
    heard = stage.received("pen")
    assert stage.status == 0
    assert node.listeners() == 0
    touching = [one for one in heard if one.contact]
    hovering = [one for one in heard if one.in_range and not one.contact]
    assert len(touching) == pytest.approx(101, abs=2)
    assert len(hovering) == pytest.approx(40, abs=3)
    assert not heard[-1].in_range
    start, end = project(default_camera(), [[0.0, 0.0, 0.5], [0.8, 0.0, 0.5]])
    assert (touching[0].x, touching[0].y) == pytest.approx(tuple(start), abs=1e-3)
    assert (touching[-1].x, touching[-1].y) == pytest.approx(tuple(end), abs=1e-3)
    middle = touching[len(touching) // 2]
    assert middle.pressure == pytest.approx(0.5, abs=0.02)
    assert middle.altitude == pytest.approx(math.radians(70), abs=0.02)
    turned = (middle.azimuth + math.pi) % (2 * math.pi) - math.pi
    assert turned == pytest.approx(0.0, abs=0.05)  # the short way over 0, not back through 180


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "1 to 100"),
        ("[[stroke]]", "one of path, ground or cm"),
        ("[[stroke]]\npath = [[0.0, 0.1]]", "rows of 3"),
        ("[[stroke]]\npath = [[1.0, 0.1, 0.1], [0.5, 0.1, 0.1]]", "must rise"),
        ("[[stroke]]\npath = [[0.0, 0.1, 0.1]]\ncolour = 1", "unknown key 'colour'"),
        ("[[stroke]]\npath = [[0.0, 0.1, 0.1]]\npressure = 3", "pressure is 0..1"),
        ("[[stroke]]\npath = [[0.0, 0.1, 0.1]]\ntilt = [100, 0]", "0..90"),
        ("[[stroke]]\nground = [[0.0, 100.0, 100.0]]", "behind the camera"),
        (
            "[[stroke]]\npath = [[0.0, 0.1, 0.1], [1.0, 0.2, 0.2]]\n[[stroke]]\nstart = 0.5\npath = [[0.0, 0, 0]]",
            "ended",
        ),
        ("[[", "TOML"),
    ],
)  # fmt: skip
def test_a_performance_that_cannot_be_played_says_why(tmp_path: Path, text: str, why: str) -> None:
    with pytest.raises(PerformanceError, match=why):
        load(write(tmp_path, text))


def test_bad_drivers_are_refused_in_a_line() -> None:
    with pytest.raises(ParamProblem, match=r"no pen driver 'spoon'.*script, web"):
        MemoryStage().add(InputPen, drivers=["spoon"])
    with pytest.raises(ParamProblem, match="give parameter script"):
        MemoryStage().add(InputPen, drivers=["script"])
    with pytest.raises(ParamProblem, match="none given"):
        MemoryStage().add(InputPen, drivers=[])


@given(st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=30))
def test_whatever_a_page_does_its_pen_is_out_at_the_end(states: list[tuple[bool, bool]]) -> None:
    stage = MemoryStage()
    stage.add(InputPen)
    for number, (near, down) in enumerate(states):
        one = sample(float(number), in_range=near, contact=near and down)
        stage.publish("web/events", Event(device="web-ab", kind="pen", pen=[one]))
    stage.publish("web/events", Event(device="web-ab", kind="gone"))
    assert not stage.last("pen").in_range


def test_a_tablets_strokes_are_written_in_centimetres(tmp_path: Path) -> None:
    file = tmp_path / "tablet.pen"
    file.write_text("size_cm = [20, 10]\n[[stroke]]\ncm = [[0.0, 0.0, 0.0], [1.0, 5.0, 2.5]]\n")
    performance = load(file)
    assert performance.size_m == pytest.approx((0.2, 0.1))
    assert performance.length == pytest.approx(1.1)
    moment = performance.strokes[0].at(1.0)
    assert (moment.x, moment.y) == pytest.approx((0.75, 0.25))
    file.write_text("[[stroke]]\ncm = [[0.0, 0.0, 0.0], [1.0, 5.0, 2.5]]\n")
    assert load(file).size_m == (0.25, 0.15625)
    file.write_text("length = 5\n[[stroke]]\ncm = [[0.0, 0.0, 0.0], [1.0, 5.0, 2.5]]\n")
    assert load(file).length == 5.0
    assert load(file).at(4.0) is None
    for text, words in (
        ("length = nan\n[[stroke]]\ncm = [[0.0, 0.0, 0.0]]\n", "length: write"),
        ("size_cm = [20]\n[[stroke]]\ncm = [[0.0, 0.0, 0.0]]\n", "width and height"),
        ("[[stroke]]\ncm = [[0.0, 0.0, 9.0]]\n", "beyond the tablet of 25 x 15.625 cm"),
        ("[[stroke]]\ncm = [[0.0, 0.0, 0.0]]\npath = [[0.0, 0.1, 0.1]]\n", "one of path, ground or cm"),
    ):
        file.write_text(text)
        with pytest.raises(PerformanceError, match=words):
            load(file)
