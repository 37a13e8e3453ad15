"""What hands, a pen, a mouse and keys do on the page (Chromium, headless) arrives on the stage of real processes."""

from collections.abc import Callable

import numpy as np
import pytest
from pages import Ear, Hall, Person, needs_browser, teal

pytestmark = needs_browser(300)


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
