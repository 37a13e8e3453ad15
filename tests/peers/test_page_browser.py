"""The stage page in a real browser (Chromium, headless) on the real processes: what hands do there arrives here."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
import trimesh
from pages import BROWSER, SHOTS, Ear, Hall, Person, teal
from PIL import Image

from bunraku.figure.camera import project
from bunraku.figure.default import default_figure
from bunraku.figure.fk import fk
from bunraku.msgs import Camera, Overlay, Primitive
from bunraku.nodes.renderer.overlay import PANEL, draw
from bunraku.nodes.renderer.view import Layer
from bunraku.runtime.control import ask

pytest.importorskip("playwright.sync_api", reason="needs playwright: pip install -e '.[test]'")
pytestmark = [
    pytest.mark.peer,
    pytest.mark.stack,
    pytest.mark.timeout(300),
    pytest.mark.skipif(BROWSER is None, reason="needs Chromium: apt-get install chromium"),
]
LAUNCH = '''"""The page and everything that it drives."""
from bunraku.runtime.launch import NodeSpec, node


def launch() -> list[NodeSpec]:
    """Everything the page drives."""
    return [
        node("recorder"), node("input_touch", params={"drivers": ["web"]}),
        node("input_pen", params={"drivers": ["web"]}), node("input_hand", params={"drivers": ["web"]}),
        node("interpreter"), node("controller"),
        node("web", params={"port": 0, "takes": "TAKES"}, respawn=True),
    ]
'''


@pytest.fixture(scope="module")
def hall(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Hall]:
    folder = tmp_path_factory.mktemp("p")
    file = folder / "page.py"
    file.write_text(LAUNCH.replace("TAKES", str(folder / "takes")))
    one = Hall(folder, [str(file)])
    yield one
    one.close()


@pytest.fixture
def person(browser: Any, hall: Hall) -> Iterator[Person]:
    one = Person(browser, hall)
    one.reset()
    one.page.wait_for_timeout(500)
    try:
        yield one
    finally:
        one.close()
    assert one.faults == []
    hall.until(lambda: True)


@pytest.fixture
def ear(hall: Hall) -> Iterator[Callable[[str], Ear]]:
    made: list[Ear] = []

    def listen(topic: str) -> Ear:
        made.append(Ear(hall.folder, topic))
        time.sleep(0.3)  # ZeroMQ tells nobody that a subscription has arrived
        return made[-1]

    yield listen
    for one in made:
        one.close()


def test_two_fingers_drag_hand_and_pelvis(person: Person, ear: Callable[[str], Ear], hall: Hall) -> None:
    touches, poses = ear("touch"), ear("pose")
    hand, hips = person.where("leftHand"), person.where("hips")
    goal, low = (hand[0] + 75, hand[1] - 125), (hips[0], hips[1] + 45)
    assert teal(person.shot("before"), goal) < 20
    person.fingers("touchStart", hand)
    person.fingers("touchStart", hand, hips)
    for k in range(1, 31):
        share = k / 30
        person.fingers(
            "touchMove",
            (hand[0] + share * (goal[0] - hand[0]), hand[1] + share * (goal[1] - hand[1])),
            (hips[0], hips[1] + share * (low[1] - hips[1])),
        )
        person.page.wait_for_timeout(16)
    hall.until(lambda: float(np.hypot(*np.subtract(person.where("leftHand"), goal))) < 25)
    hall.until(lambda: person.where("hips")[1] - hips[1] > 15)
    assert teal(person.shot("dragged"), goal) > 60
    person.fingers("touchEnd")
    person.until("!bunraku.contacts.any")
    heard = [one for one in touches.listen() if one["device"].startswith("web-")]
    contacts = [contact for one in heard for contact in one["contacts"]]
    assert {len(one["contacts"]) for one in heard} >= {1, 2}
    first = contacts[0]
    picture = person.ask("bunraku.stage.picture()")
    assert (first["phase"], first["x"]) == (
        "down",
        pytest.approx((hand[0] - picture["left"]) / picture["width"], abs=2e-3),
    )
    metre = 0.0254 / 96
    assert first["major"] == pytest.approx(18 * metre, rel=0.15)
    assert first["minor"] == pytest.approx(12 * metre, rel=0.15)
    assert first["angle"] == pytest.approx(np.radians(20), abs=0.02)
    ends: dict[int, str] = {one["id"]: one["phase"] for one in contacts}
    assert set(ends.values()) == {"up"}
    assert any(one["origin"] is not None for one in poses.listen())


def test_a_pen_s_every_value_arrives(person: Person, ear: Callable[[str], Ear]) -> None:
    pens = ear("pen")
    person.page.locator("label", has_text="Pen").first.click()
    picture = person.ask("bunraku.stage.picture()")
    x, y = picture["left"] + 0.25 * picture["width"], picture["top"] + 0.75 * picture["height"]
    person.pen("mouseMoved", x, y)
    person.pen("mousePressed", x, y, button="left", buttons=1, force=0.25, tiltX=30, tiltY=-20, twist=90, clickCount=1)
    for k in range(1, 21):
        person.pen(
            "mouseMoved", x + 4 * k, y, button="left", buttons=1, force=0.25 + 0.03 * k, tiltX=30, tiltY=-20, twist=90
        )
        person.page.wait_for_timeout(8)
    person.pen("mouseReleased", x + 80, y, button="left", buttons=0)
    person.page.wait_for_timeout(300)
    heard = pens.listen()
    touching = [one for one in heard if one["contact"]]
    assert heard[0]["in_range"]
    assert not heard[0]["contact"]
    assert touching[0]["x"] == pytest.approx(0.25, abs=2e-3)
    assert touching[0]["y"] == pytest.approx(0.75, abs=2e-3)
    assert touching[0]["pressure"] == pytest.approx(0.25, abs=0.01)
    assert len(touching) >= 20  # every sample, the coalesced ones too
    assert touching[-1]["pressure"] == pytest.approx(0.85, abs=0.01)
    assert max(np.diff([one["x"] for one in touching])) < 6 / picture["width"]
    tx, ty = np.tan(np.radians([30, -20]))
    assert touching[3]["altitude"] == pytest.approx(np.arctan(1 / np.hypot(tx, ty)), abs=1e-3)
    assert touching[3]["azimuth"] == pytest.approx(np.arctan2(ty, tx) % (2 * np.pi), abs=1e-3)
    assert touching[3]["twist"] == pytest.approx(np.pi / 2)
    assert not heard[-1]["contact"]


def test_slider_made_hands_arrive_and_a_double_click_ramps(person: Person, ear: Callable[[str], Ear]) -> None:
    hands = ear("hands")
    person.page.locator("label", has_text="Hands").first.click()
    person.page.get_by_label("right hand x").fill("0.4")
    person.page.get_by_label("right index finger").fill("-0.7")
    person.page.get_by_label("left middle finger").fill("1")
    plane = person.page.locator("#plane").bounding_box()
    person.page.mouse.dblclick(plane["x"] + 0.75 * plane["width"], plane["y"] + 0.25 * plane["height"])
    person.page.wait_for_timeout(2200)
    person.shot("hands")
    heard = [one for one in hands.listen() if one["left"] is not None]
    last = heard[-1]
    assert last["right"]["position"] == pytest.approx([0.4, 0.0, 0.0])
    assert last["right"]["bend"] == pytest.approx([0.0, -0.7, 0.0, 0.0, 0.0])
    assert last["left"]["bend"][2] == 1.0
    assert last["left"]["position"][:2] == pytest.approx([0.5, 0.5], abs=0.03)
    ramp = [one["left"]["position"][2] for one in heard]
    assert ramp[0] == -1.0
    assert ramp[-1] == -1.0
    assert max(ramp) == 1.0
    rising = ramp[ramp.index(next(z for z in ramp if z > -1)) : ramp.index(1.0)]
    assert len(rising) > 8
    assert rising == sorted(rising)
    person.page.keyboard.press("Escape")
    person.page.locator("label", has_text="Touch").first.click()


def test_a_mouse_alone_holds_two_parts(person: Person, ear: Callable[[str], Ear], hall: Hall) -> None:
    touches = ear("touch")
    hand, hips = person.where("rightHand"), person.where("hips")
    person.page.keyboard.down("Shift")
    person.page.mouse.move(*hips)
    person.page.mouse.down()
    person.page.mouse.up()
    person.page.keyboard.up("Shift")
    person.page.mouse.move(*hand)
    person.page.mouse.down()
    person.page.mouse.move(hand[0] - 30, hand[1] - 100, steps=20)
    hall.until(lambda: float(np.hypot(*np.subtract(person.where("rightHand"), (hand[0] - 30, hand[1] - 100)))) < 25)
    person.page.mouse.up()
    person.until("bunraku.contacts.live.size === 1")
    person.page.keyboard.press("Escape")
    person.until("!bunraku.contacts.any")
    person.page.wait_for_timeout(200)
    heard = [one["contacts"] for one in touches.listen() if one["device"].startswith("web-")]
    assert max(len(one) for one in heard) == 2
    assert {one["phase"] for one in heard[-1]} == {"up"}


def test_a_reload_in_mid_drag_lets_go_and_the_page_plays_on(person: Person, ear: Callable[[str], Ear]) -> None:
    touches = ear("touch")
    person.fingers("touchStart", person.where("leftHand"))
    person.until("bunraku.outbox.sent > 0")
    before = person.ask("bunraku.connection.identity.page")
    person.page.wait_for_timeout(200)
    person.open()
    person.page.wait_for_timeout(300)
    assert person.ask("bunraku.connection.identity.page") == before
    heard = [one["contacts"] for one in touches.listen() if one["device"] == f"web-{before}"]
    assert heard[-1][0]["phase"] in ("cancel", "up")
    person.fingers("touchEnd")
    count = len(heard)
    person.fingers("touchStart", person.where("leftHand"))
    person.until("bunraku.outbox.sent > 0")
    person.fingers("touchEnd")
    person.page.wait_for_timeout(300)
    assert len([one for one in touches.listen() if one["device"] == f"web-{before}"]) > count


def test_a_server_killed_in_mid_drag_is_found_again(person: Person, ear: Callable[[str], Ear], hall: Hall) -> None:
    touches = ear("touch")
    x, y = person.where("leftHand")
    person.fingers("touchStart", (x, y))
    for k in range(10):
        person.fingers("touchMove", (x, y - 4 * k))
        person.page.wait_for_timeout(16)
    hall.until(lambda: person.where("leftHand")[1] < y - 25)
    pid = hall.web_pid()
    os.kill(pid, signal.SIGKILL)
    person.until("!bunraku.connection.open")
    person.until("document.getElementById('lost').hidden === false", 5)
    person.until("bunraku.connection.open", 40)
    assert hall.web_pid() != pid
    person.until("document.getElementById('lost').hidden")
    for k in range(10, 15):
        person.fingers("touchMove", (x, y - 4 * k))
        person.page.wait_for_timeout(30)
    person.fingers("touchEnd")
    person.until("!bunraku.contacts.any")
    x, y = person.where("leftHand")  # the figure may have let it sink meanwhile
    person.fingers("touchStart", (x, y))
    for k in range(15):
        person.fingers("touchMove", (x, y - 4 * k))
        person.page.wait_for_timeout(30)
    hall.until(lambda: person.where("leftHand")[1] < y - 30)
    person.fingers("touchEnd")
    hall.until(lambda: bool(touches.listen()) and touches.heard[-1]["contacts"][0]["phase"] == "up")
    phases: dict[int, list[str]] = {}
    for one in touches.listen():
        for contact in one["contacts"]:
            phases.setdefault(contact["id"], []).append(contact["phase"])
    assert len(phases) == 3  # the finger is told as a new one after the restart, and then put down again
    assert all(one[0] == "down" and one[-1] in ("up", "cancel") for one in phases.values())
    person.faults = [one for one in person.faults if "WebSocket" not in one]  # the browser's line about the lost socket


def test_a_second_page_watches_the_same_figure(person: Person, browser: Any, hall: Hall) -> None:
    other = Person(browser, hall)
    try:
        other.until("bunraku.here.role === 'watch'")
        x, y = person.where("leftHand")
        before = other.where("leftHand")
        person.fingers("touchStart", (x, y))
        for k in range(25):
            person.fingers("touchMove", (x, y - 4 * k))
            person.page.wait_for_timeout(16)
        hall.until(lambda: before[1] - other.where("leftHand")[1] > 50)
        person.fingers("touchEnd")
        other.fingers("touchStart", other.where("hips"))
        other.page.wait_for_timeout(200)
        assert other.ask("bunraku.outbox.sent") == 0
        other.fingers("touchEnd")
        assert other.faults == []
    finally:
        other.close()
    person.until("bunraku.here.pages === 1")


def test_a_take_is_recorded_scrubbed_played_and_saved(person: Person, hall: Hall) -> None:
    page = person.page
    page.get_by_role("button", name="Take", exact=True).click()
    person.until("document.getElementById('take').getAttribute('aria-pressed') === 'true'")
    x, y = person.where("leftHand")
    person.fingers("touchStart", (x, y))
    for k in range(30):
        person.fingers("touchMove", (x, y - 4 * k))
        page.wait_for_timeout(16)
    page.wait_for_timeout(400)
    high = person.where("leftHand")
    person.fingers("touchEnd")
    page.wait_for_timeout(300)
    page.get_by_role("button", name="Stop").click()
    person.until("bunraku.timeline.player.track")
    person.reset()
    page.locator("#scrub").fill("0.001")
    person.until("Math.abs(bunraku.timeline.player.share - 0.001) < 1e-3")
    page.wait_for_timeout(150)
    start = person.where("leftHand")
    assert np.hypot(start[0] - x, start[1] - y) < 25
    page.locator("#scrub").fill("0.75")
    page.wait_for_timeout(150)
    late = person.where("leftHand")
    assert np.hypot(late[0] - high[0], late[1] - high[1]) < 40
    page.get_by_role("button", name="Play the take").click()
    person.until("!bunraku.timeline.player.playing && bunraku.timeline.player.share === 1")
    with page.expect_download() as saved:
        page.locator("#download").select_option("mcap")
    name = saved.value.suggested_filename
    assert (hall.takes / name).read_bytes() == Path(saved.value.path()).read_bytes()
    made: dict[str, Path] = {}
    for form in ("bvh", "glb", "mp4"):
        with page.expect_download(timeout=200_000) as saved:
            page.locator("#download").select_option(form)
            if form == "mp4":
                person.until(
                    "/Making the film: filming [1-9]/.test(document.getElementById('makingtext').textContent)", 150
                )
                person.shot("take-filming")
        assert saved.value.suggested_filename == name.replace("mcap", form)
        made[form] = Path(saved.value.path())
        person.until("document.getElementById('making').hidden")
    assert made["bvh"].read_text().startswith("HIERARCHY")
    figure = next(iter(trimesh.load(made["glb"], file_type="glb").geometry.values()))
    assert figure.bounds[1][1] > 1.2
    with av.open(str(made["mp4"])) as film:
        frames = [frame.to_ndarray(format="rgb24").astype(float) for frame in film.decode(video=0)]
    assert frames[0].shape == (720, 1280, 3)
    assert len(frames) > 20
    assert min(frame.mean() for frame in frames) > 100
    assert np.abs(frames[-1] - frames[0]).max() > 60
    if SHOTS:
        for k in (0, len(frames) // 2, len(frames) - 1):
            Image.fromarray(frames[k].astype(np.uint8)).save(Path(SHOTS) / f"take-film-{k}.png")
    page.locator("#download").select_option("mp4")
    page.get_by_role("button", name="Cancel").click()
    page.get_by_text("Not saved.").wait_for()
    assert page.locator("#making").is_hidden()
    assert page.locator("#download").is_enabled()
    (hall.takes / name).unlink()
    page.locator("#download").select_option("glb")
    page.get_by_text("is not there any more").wait_for()
    page.locator("#takes").select_option("")
    person.until("bunraku.stage.replay === null")


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


def test_parameters_are_shown_with_their_docs_and_changed(person: Person, hall: Hall) -> None:
    page = person.page
    page.get_by_role("button", name="Settings").click()
    page.locator("summary", has_text="interpreter").click()
    assert page.get_by_text("width by height of the picture").is_visible()
    page.get_by_label("interpreter follow").uncheck()
    hall.until(lambda: ask(hall.folder, "interpreter", "param.get")["params"]["follow"] is False)
    page.get_by_label("interpreter follow").check()
    hall.until(lambda: ask(hall.folder, "interpreter", "param.get")["params"]["follow"] is True)
    page.keyboard.press("Escape")
    assert page.locator("#drawer").is_hidden()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize(("width", "height"), [(1280, 800), (800, 1280), (390, 844), (844, 390)])
def test_everything_is_within_reach(browser: Any, hall: Hall, scheme: str, width: int, height: int) -> None:
    person = Person(browser, hall, viewport={"width": width, "height": height}, color_scheme=scheme)
    try:
        for way in ("Touch", "Pen", "Hands"):
            person.page.locator("label", has_text=way).first.click()
            person.page.wait_for_timeout(250)
            picture = person.shot(f"{scheme}-{width}x{height}-{way.lower()}")
            outside = person.ask(
                """() => [...document.querySelectorAll('header button, footer button, footer select, .ways span')]
                  .filter(one => one.offsetParent).filter(one => { const b = one.getBoundingClientRect();
                    return b.left < 0 || b.top < 0 || b.right > innerWidth + 1 || b.bottom > innerHeight + 1
                      || b.width < 36 || b.height < 36; }).map(one => one.id || one.textContent)"""
            )
            assert outside == []
            assert person.ask("document.documentElement.scrollWidth <= innerWidth")
            stage = person.ask("(({width, height}) => [width, height])(bunraku.stage.picture())")
            assert stage[0] > 0.3 * width
            dark = picture[5, 5].mean() < 90
            assert dark == (scheme == "dark")
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
        began, first = time.monotonic(), one.ask("bunraku.connection.bytes")
        for k in range(300):
            place = (x + 40 * np.sin(k / 15), y - 60 + 60 * np.cos(k / 15))
            one.fingers("touchMove", place)
            one.page.wait_for_timeout(max(0.0, (began + (k + 1) / 60 - time.monotonic()) * 1000))
        seconds = time.monotonic() - began
        numbers = one.ask(
            """() => { const {stats, stage} = bunraku, p = (s, q) => Math.round(100 * s.percentile(q)) / 100;
              return {delay: [p(stats.delay, .5), p(stats.delay, .99)], fps: 1000 / p(stats.gaps, .5),
                script: [p(stats.script, .5), p(stats.script, .95)], calls: stage.calls, pixels: stage.scale,
                measured: stats.delay.values.length}; }"""
        )
        numbers["kB/s"] = round((one.ask("bunraku.connection.bytes") - first) / seconds / 1000, 1)
        one.fingers("touchEnd")
        print(f"{width}x{height}, {pages} pages: {numbers}")
        assert numbers["measured"] > 50
        assert 0 < numbers["calls"] <= 50
        assert numbers["kB/s"] < 200
    finally:
        for person in people:
            person.close()


def test_the_page_is_driven_by_keyboard(person: Person) -> None:
    page = person.page
    page.locator("input[value=touch]").focus()
    page.keyboard.press("ArrowRight")
    assert person.ask("document.body.dataset.way") == "pen"
    page.keyboard.press("ArrowRight")
    assert person.ask("document.body.dataset.way") == "hands"
    page.locator("#plane").focus()
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Enter")
    assert person.ask("bunraku.hands.hands.left.position[0]") == pytest.approx(0.1)
    assert person.ask("bunraku.hands.performing") is not None
    page.keyboard.down("2")
    person.until("bunraku.hands.hands.right.bend[1] > 0.5")
    page.keyboard.up("2")
    person.until("bunraku.hands.hands.right.bend[1] === 0")
    page.locator("label", has_text="Touch").first.click()
    person.until("document.getElementById('fitnow').hidden")  # offered while the panels of the hands take the room
    page.locator("input[value=touch]").focus()
    reached = []
    for _ in range(9):
        page.keyboard.press("Tab")
        reached.append(person.ask("document.activeElement.id"))
    assert reached[:5] == ["settings", "view", "reset", "take", "takes"]
    assert person.ask("getComputedStyle(document.activeElement).outlineStyle") != "none" or reached[-1] == ""
    page.locator("#settings").focus()
    page.keyboard.press("Enter")
    assert person.ask("document.activeElement.id") == "closedrawer"
    page.locator("summary", has_text="interpreter").wait_for()  # the drawer is whole once the nodes have answered
    inside = set()
    for _ in range(12):
        page.keyboard.press("Tab")
        inside.add(person.ask("document.activeElement.id"))
    assert {"role", "theme", "fullscreen", "fit", "cardwidth", "forgetcard"} <= inside
    page.keyboard.press("Escape")
    assert person.ask("document.activeElement.id") == "settings"
    unnamed = person.ask(
        """() => [...document.querySelectorAll('button, select, input')].filter(one => {
          const labels = [...one.labels ?? []].some(label => label.textContent.trim());
          return !(one.ariaLabel || one.textContent.trim() || labels);
        }).map(one => one.outerHTML)"""
    )
    assert unnamed == []
