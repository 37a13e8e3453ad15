"""One page plays both ways at once: a pen walks the figure while a finger holds its hand, and a mouse chooses."""

import numpy as np
import pytest
from pages import Person, needs_browser

pytestmark = needs_browser(400)
DOWN = {"button": "left", "buttons": 1}


@pytest.fixture(scope="module")
def words() -> list[str]:
    return ["mixed", "window:=off"]


def place(person: Person, role: str) -> np.ndarray:
    """Where a joint is, m."""
    return np.array(person.ask("role => [...bunraku.stage.figures.get(0).place(role)]", role))


def test_a_pen_walks_while_a_finger_holds_the_hand(person: Person) -> None:
    hand, hips = person.where("leftHand"), place(person, "hips")
    low = place(person, "leftHand")[1] - hips[1]
    person.fingers("touchStart", hand)
    for k in range(1, 26):
        person.fingers("touchMove", (hand[0] + 2 * k, hand[1] - 5 * k))
        person.page.wait_for_timeout(16)
    person.until(f"bunraku.stage.figures.get(0).place('leftHand')[1] > {hips[1] + low + 0.25}", 60)
    person.shot("mixed-hand")
    x, y = person.seen([float(hips[0]), 0.0, float(hips[2])])
    person.pen("mouseMoved", x, y)
    person.pen("mousePressed", x, y, force=0.2, clickCount=1, **DOWN)
    for k in range(1, 61):
        person.pen("mouseMoved", x - 3 * k, y, force=0.2, **DOWN)
        person.page.wait_for_timeout(20)
    moved = f"(p => Math.hypot(p[0] - {hips[0]}, p[2] - {hips[2]}))(bunraku.stage.figures.get(0).place('hips'))"
    person.until(f"{moved} > 0.6", 60)
    assert person.ask("bunraku.contacts.any"), "the finger still holds"
    assert person.ask("bunraku.samples.last.contact"), "the pen still draws"
    assert place(person, "leftHand")[1] - place(person, "hips")[1] > low + 0.1
    person.shot("mixed-walking")
    person.pen("mouseReleased", x - 180, y, button="left", buttons=0)
    person.fingers("touchEnd")
    person.until("!bunraku.contacts.any && !bunraku.samples.last.contact")


def test_a_mouse_chooses_its_way(person: Person) -> None:
    person.reset()
    person.page.wait_for_timeout(1500)
    hand, high = person.where("rightHand"), place(person, "rightHand")[1] + 0.1
    person.page.mouse.move(*hand)
    person.page.mouse.down()
    person.page.mouse.move(hand[0], hand[1] - 70, steps=20)
    person.until(f"bunraku.stage.figures.get(0).place('rightHand')[1] > {high}", 60)
    person.page.mouse.up()
    person.page.locator("label", has_text="Pen").first.click()
    hips = place(person, "hips")
    x, y = person.seen([float(hips[0]), 0.0, float(hips[2])])
    person.page.mouse.move(x, y)
    person.page.mouse.down()
    person.page.mouse.move(x + 160, y, steps=50)
    moved = f"(p => Math.hypot(p[0] - {hips[0]}, p[2] - {hips[2]}))(bunraku.stage.figures.get(0).place('hips'))"
    person.until(f"{moved} > 0.5", 60)
    person.page.mouse.up()
