"""Pages that come, go and come again, and what a performer does there: takes and parameters."""

import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
import trimesh
from pages import SHOTS, Ear, Hall, Person, needs_browser
from PIL import Image

from bunraku.runtime.control import ask
from bunraku.runtime.graph import nodes

pytestmark = needs_browser(300)


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
    pid, camera = hall.pid("web/events"), person.ask("[...bunraku.stage.camera.position]")
    os.kill(pid, signal.SIGKILL)
    person.until("!bunraku.connection.open")
    person.until("document.getElementById('lost').hidden === false", 5)
    person.until("bunraku.connection.open", 40)
    assert hall.pid("web/events") != pid
    person.until("document.getElementById('lost').hidden")
    assert person.page.get_by_text("Lift your hand and touch it again").is_visible()
    person.page.wait_for_timeout(400)
    person.shot("found-again")
    for k in range(10):  # what it held has sunk: it neither takes hold of another part nor turns the camera
        person.fingers("touchMove", (x + 8 * k, y - 40))
        person.page.wait_for_timeout(30)
    person.fingers("touchEnd")
    person.until("!bunraku.contacts.any")
    assert person.ask("[...bunraku.stage.camera.position]") == pytest.approx(camera, abs=0.02)
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
    assert len(phases) == 2  # the finger, and when it is put down again
    assert all(one[0] == "down" and one[-1] in ("up", "cancel") for one in phases.values())
    person.faults = [one for one in person.faults if "WebSocket" not in one]  # the browser's line about the lost socket


def test_what_a_node_drew_goes_with_the_node(person: Person, hall: Hall) -> None:
    circles = "(bunraku.stage.overlays.get('overlay/interpreter')?.primitives.length ?? 0)"
    person.fingers("touchStart", person.where("leftHand"))
    person.until(f"{circles} > 0")
    person.shot("drawn")
    pid = hall.pid("overlay/interpreter")
    os.kill(pid, signal.SIGKILL)
    person.fingers("touchEnd")  # the one that comes after it knows of no finger
    person.until(f"{circles} === 0")
    person.shot("gone")
    hall.until(lambda: "interpreter" in nodes(hall.folder) and hall.pid("overlay/interpreter") != pid)
    x, y = person.where("leftHand")
    person.fingers("touchStart", (x, y))
    person.until(f"{circles} > 0")
    person.fingers("touchEnd")
    person.until(f"{circles} === 0")


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
        assert other.page.locator("#playnow").is_hidden()
        person.page.goto("about:blank")
        other.page.get_by_role("button", name="Nobody plays: play here").click()
        other.until("bunraku.here.role === 'play'")
        assert other.page.locator("#playnow").is_hidden()
        person.open()
        assert person.ask("bunraku.here.role") == "watch"
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
    sent = person.ask("bunraku.outbox.sent")
    person.fingers("touchStart", person.where("hips"))
    person.fingers("touchMove", (x, y))
    page.get_by_text("This is a take. Go back to live to play.").wait_for()
    person.fingers("touchEnd")
    assert person.ask("bunraku.outbox.sent") == sent, "what cannot be seen is not played"
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
    person.shot("take-offered")
    page.get_by_role("button", name="back to live").click()
    person.until("bunraku.stage.replay === null")
    assert page.locator("#takes").input_value() == ""
    person.fingers("touchStart", person.where("leftHand"))
    person.until(f"bunraku.outbox.sent > {sent}")
    person.fingers("touchEnd")


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
