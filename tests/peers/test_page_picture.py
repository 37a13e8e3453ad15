"""What the page shows: every overlay, on every screen, and what a picture costs."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pages import SHOTS, Hall, Person, needs_browser
from PIL import Image
from reach import FAULTS

from bunraku.figure.camera import project
from bunraku.figure.default import default_figure
from bunraku.figure.fk import fk
from bunraku.msgs import Camera, Overlay, Primitive
from bunraku.nodes.renderer.overlay import PANEL, draw
from bunraku.nodes.renderer.view import Layer
from bunraku.runtime.control import ask

pytestmark = needs_browser(300)


COLORS = {
    "circle": (0.9, 0.1, 0.1, 1.0), "line": (0.1, 0.7, 0.1, 1.0), "polygon": (0.1, 0.2, 0.9, 1.0),
    "points": (0.8, 0.1, 0.8, 1.0), "figure": (0.1, 0.7, 0.8, 1.0), "bar": (0.9, 0.6, 0.0, 1.0),
    "text": (0.1, 0.1, 0.1, 1.0),
}  # fmt: skip


def every_primitive(joints: np.ndarray) -> tuple[list[dict[str, Any]], list[tuple[str, str, tuple[float, ...]]]]:
    """Every kind in every space, and a place that each must cover."""
    made: list[dict[str, Any]] = []
    places: list[tuple[str, str, tuple[float, ...]]] = []

    def add(kind: str, space: str, points: Any, size: float, at: tuple[float, ...] | None, label: str = "") -> None:
        rows = [list(map(float, point)) for point in points]
        made.append(
            {"kind": kind, "space": space, "points": rows, "size": size, "color": list(COLORS[kind]), "label": label}
        )
        if at is not None:
            places.append((kind, space, at))

    for space, left, unit in (("screen", 0.03, 0.1), ("panel", 0.1, 0.22)):
        top = 0.06 if space == "screen" else 0.12
        flat = [(left + 0.1 * unit, top), (left + 1.2 * unit, top), (left + 1.2 * unit, top + 0.7 * unit)]
        add("line", space, flat, 0.015 if space == "screen" else 0.05, (left + 0.6 * unit, top))
        hollow = [(0, 1), (1, 1), (1, 2.4), (0.8, 2.4), (0.8, 1.3), (0.2, 1.3), (0.2, 2.4), (0, 2.4)]
        shape = [(left + 0.3 * unit + unit * x, top + unit * y) for x, y in hollow]
        add("polygon", space, shape, 0.0, (left + 0.4 * unit, top + 2 * unit))
        add("circle", space, [(left + 2 * unit, top + 0.4 * unit)], 0.3 * unit, None, f"circle {space}")
        dots = [(left + (2 + 0.3 * k) * unit, top + 1.5 * unit) for k in range(3)]
        add("points", space, dots, 0.12 * unit, dots[1])
        bar = [(left + 2 * unit, top + 2.2 * unit), (left + 3 * unit, top + 2.2 * unit)]
        add("bar", space, bar, 0.5, (left + 2.25 * unit, top + 2.2 * unit))
        add("text", space, [(left + 0.3 * unit, top + 3 * unit)], 0.3 * unit, None, f"Text on the {space}")
        stick = [(left + (3.4 + 0.4 * x) * unit, top + (2.1 - y) * unit) for x, y, _ in joints]
        add("figure", space, stick, 0.01, stick[0])
    add("polygon", "world", [(0.8 + 0.6 * x, 0.01, 0.4 * z - 0.4) for x, z in hollow], 0.02, (0.86, 0.01, 0.3))
    add("line", "world", [(-1.2, 0.01, -0.6), (-0.5, 0.01, -0.9), (0.4, 0.01, -0.6)], 0.08, (-0.85, 0.01, -0.75))
    add("circle", "world", [(-0.4, 0.0, 0.4)], 0.3, None, "circle in the world")
    add("points", "world", [(-1.2, 0.6 + 0.2 * k, 0.0) for k in range(4)], 0.08, (-1.2, 0.8, 0.0))
    add("bar", "world", [(-1.6, 0.3, 0.0), (-1.6, 1.3, 0.0)], 0.7, (-1.6, 0.7, 0.0))
    add("figure", "world", joints + np.array([1.3, 0.0, -0.8]), 0.02, tuple(joints[0] + np.array([1.3, 0.0, -0.8])))
    add("text", "world", [(0.6, 1.9, 0.0)], 0.12, None, "Text in the world")
    return made, places


def test_every_kind_of_overlay_is_drawn_in_every_space_as_in_the_film(person: Person, hall: Hall) -> None:
    figure = default_figure()
    joints, _ = fk(figure, *figure.rest_pose())
    made, places = every_primitive(np.asarray(joints))
    command = [sys.executable, "-m", "bunraku.cli", "topic", "pub", "overlay/all"]
    environment = {**os.environ, **hall.environment}
    said = subprocess.Popen([*command, json.dumps({"primitives": made}), "--rate", "5"], env=environment)
    try:
        person.until("bunraku.stage.overlays.has('overlay/all')", 60)
        person.ask("document.getElementById('hint').classList.add('away')")
        person.page.wait_for_timeout(1500)  # the camera is at rest
        body = person.ask(
            "(({position, rotation, yfov, aspect}) => ({position, rotation, yfov, aspect}))(bunraku.stage.camera)"
        )
        rect = person.ask("bunraku.stage.picture()")
        shown = person.shot("overlays-page")
        person.page.emulate_media(color_scheme="dark")
        person.page.wait_for_timeout(600)
        person.shot("overlays-dark")
    finally:
        said.terminate()
        said.wait(20)
    subprocess.run([*command, '{"primitives": []}'], env=environment, check=True, timeout=60)
    person.until("!bunraku.stage.overlays.get('overlay/all').primitives.length")
    camera = Camera(position=body["position"], rotation=body["rotation"], yfov=body["yfov"], aspect=body["aspect"])
    width, height = round(rect["width"]), round(rect["height"])
    film = np.full((height, width, 4), (228, 231, 234, 0), np.uint8)
    layers = [Layer(tuple(Overlay(primitives=[Primitive(**one) for one in made]).primitives), tuple(figure.parents))]
    draw(film, camera, layers)
    if SHOTS:
        Image.fromarray(film[..., :3]).save(Path(SHOTS) / "overlays-film.png")
    for kind, space, at in places:
        if space == "world":
            x, y = project(camera, [at])[0]
        else:
            x, y = at if space == "screen" else (PANEL[0] + at[0] * PANEL[2], PANEL[1] + at[1] * PANEL[3])
        i, j = round(rect["top"] + y * rect["height"]), round(rect["left"] + x * rect["width"])
        wanted = np.array(COLORS[kind][:3]) * 255
        for picture in (shown[i - 1 : i + 2, j - 1 : j + 2], film[round(y * height), round(x * width), :3].astype(int)):
            assert np.abs(picture - wanted).max(axis=-1).min() < 80, (kind, space, picture)
    for hollow in ([(1.1, 0.01, 0.3)], [(1.1, 0.01, 0.5)]):  # within the U of the world's polygon
        x, y = project(camera, hollow)[0]
        here = shown[round(rect["top"] + y * rect["height"]), round(rect["left"] + x * rect["width"])]
        assert np.abs(here - np.array(COLORS["polygon"][:3]) * 255).max() > 100
    x, y = project(camera, [(0.6, 1.9, 0.0)])[0]  # a label has its primitive's colour, not the last one's
    x, y = round(rect["left"] + x * rect["width"]), round(rect["top"] + y * rect["height"])
    ink = shown[y - 22 : y + 2, x + 4 : x + 120].reshape(-1, 3)
    assert ink[np.argsort(ink.sum(axis=1))[:20]].mean(axis=0).max() < 110


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize(
    ("width", "height"), [(1280, 800), (1180, 820), (800, 1280), (390, 844), (844, 390), (320, 568)]
)
def test_everything_is_within_reach(browser: Any, hall: Hall, scheme: str, width: int, height: int) -> None:
    person = Person(browser, hall, viewport={"width": width, "height": height}, color_scheme=scheme)
    try:
        for way in ("Touch", "Pen", "Hands"):
            person.page.locator("label", has_text=way).first.click()
            person.page.wait_for_timeout(250)
            person.until("document.getAnimations().every(one => one.playState !== 'running')")
            picture = person.shot(f"{scheme}-{width}x{height}-{way.lower()}")
            assert person.ask(FAULTS) == []
            stage = person.ask("(({width, height}) => [width, height])(bunraku.stage.picture())")
            assert stage[0] > 0.3 * width
            dark = picture[5, 5].mean() < 90
            assert dark == (scheme == "dark")
        person.page.get_by_role("button", name="Settings").click()
        person.page.locator("summary", has_text="interpreter").wait_for()
        person.shot(f"{scheme}-{width}x{height}-settings")
        person.ask("document.querySelectorAll('#drawer details').forEach(one => { one.open = true; })")
        person.until("document.getAnimations().every(one => one.playState !== 'running')")  # the hint fades
        assert person.ask(FAULTS) == []
        assert person.ask("bunraku.stage.calls") <= 50
        assert person.faults == []
        assert all(url.startswith((hall.link, "data:", "blob:")) for url in person.requests)
    finally:
        person.close()


def test_the_picture_is_fitted_to_the_screen(person: Person, hall: Hall) -> None:
    page = person.page
    page.get_by_role("button", name="Settings").click()
    page.get_by_role("button", name="Fit this screen").click()
    canvas = person.ask("[bunraku.stage.canvas.clientWidth, bunraku.stage.canvas.clientHeight]")
    person.until(f"Math.abs(bunraku.stage.camera.aspect - {canvas[0]} / {canvas[1]}) < 0.01")
    picture = person.ask("bunraku.stage.picture()")
    assert picture["width"] == pytest.approx(canvas[0], abs=3)
    assert picture["height"] == pytest.approx(canvas[1], abs=3)
    ask(hall.folder, "interpreter", "param.set", name="aspect", value=16 / 9)
    person.until("Math.abs(bunraku.stage.camera.aspect - 16 / 9) < 0.01")


def test_a_phone_held_upright_is_offered_the_whole_screen(browser: Any, hall: Hall) -> None:
    person = Person(browser, hall, viewport={"width": 390, "height": 844}, is_mobile=True)
    try:
        button = person.page.get_by_role("button", name="Fit the picture to this screen")
        button.wait_for()
        before = person.ask("bunraku.stage.picture().height")
        button.click()
        button.wait_for(state="hidden")
        assert person.ask("bunraku.stage.picture().height") > 2 * before
        person.shot("phone-fitted")
        hand = person.where("leftHand")
        person.fingers("touchStart", hand)
        for k in range(20):
            person.fingers("touchMove", (hand[0], hand[1] - 4 * k))
            person.page.wait_for_timeout(16)
        hall.until(lambda: person.where("leftHand")[1] < hand[1] - 40)
        person.shot("phone-dragged")
        person.fingers("touchEnd")
        person.page.get_by_role("button", name="Settings").click()
        person.page.wait_for_timeout(400)
        person.shot("phone-settings")
        assert person.faults == []
    finally:
        ask(hall.folder, "interpreter", "param.set", name="aspect", value=16 / 9)
        person.close()


def drag(person: Person, start: tuple[float, float], moves: int) -> float:
    """Lead a finger that is down round an oval, 60 events a second; the seconds that it took."""
    (x, y), began = start, time.monotonic()
    for k in range(moves):
        person.fingers("touchMove", (x + 40 * np.sin(k / 15), y - 60 + 60 * np.cos(k / 15)))
        person.page.wait_for_timeout(max(0.0, (began + (k + 1) / 60 - time.monotonic()) * 1000))
    return time.monotonic() - began


def script_of_frames(trace: bytes) -> list[float]:
    """The processor's time that the page's own thread spent in each animation frame's script, ms."""
    events = json.loads(trace)["traceEvents"]
    return [one["tdur"] / 1000 for one in events if one.get("name") == "FireAnimationFrame" and "tdur" in one]


def percentiles(values: list[float]) -> list[float]:
    """The 50th and the 95th."""
    assert len(values) > 20
    return [round(float(v), 2) for v in np.percentile(values, [50, 95])]


@pytest.mark.parametrize(("width", "height", "pages"), [(640, 480, 1), (1280, 800, 1), (1280, 800, 2)])
def test_what_a_page_costs_is_measured(browser: Any, hall: Hall, width: int, height: int, pages: int) -> None:
    people = [Person(browser, hall, viewport={"width": width, "height": height}) for _ in range(pages)]
    try:
        one = people[0]
        x, y = one.where("leftHand")
        one.fingers("touchStart", (x, y))
        for k in range(60):  # the first touches find everything still being loaded
            one.fingers("touchMove", (x, y - k))
            one.page.wait_for_timeout(16)
        one.ask("['delay', 'script', 'gaps'].forEach(name => bunraku.stats[name].clear())")
        first = one.ask("bunraku.connection.bytes")
        seconds = drag(one, (x, y), 300)
        numbers = one.ask(
            """() => { const {stats, stage} = bunraku, p = (s, q) => Math.round(100 * s.percentile(q)) / 100;
              return {delay: [p(stats.delay, .5), p(stats.delay, .99)], fps: 1000 / p(stats.gaps, .5),
                clock: [p(stats.script, .5), p(stats.script, .95)], calls: stage.calls, pixels: stage.pace.scale,
                measured: stats.delay.values.length}; }"""
        )
        numbers["kB/s"] = round((one.ask("bunraku.connection.bytes") - first) / seconds / 1000, 1)
        browser.start_tracing(page=one.page, categories=["devtools.timeline"])  # apart: it takes its own time
        drag(one, (x, y), 180)
        numbers["script"] = percentiles(script_of_frames(browser.stop_tracing()))
        one.fingers("touchEnd")
        print(f"{width}x{height}, {pages} pages: {numbers}")
        assert numbers["measured"] > 0
        assert numbers["script"][1] < 4.0  # ms of the processor's time: what other threads take is not counted
        assert 0 < numbers["calls"] <= 50
        assert numbers["kB/s"] < 200
    finally:
        for person in people:
            person.close()
