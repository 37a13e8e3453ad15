"""The course at the stage page in a real browser: tiles and obstacles are seen, and a pen there plays it."""

from typing import Any

import pytest
from pages import Ear, Hall, Person, needs_browser

from bunraku.nodes.course.stages import stages

pytestmark = needs_browser(400)
DOWN = {"button": "left", "buttons": 1}


@pytest.fixture(scope="module")
def words() -> list[str]:
    return ["course", "stage:=1", "window:=off"]


def red_part(person: Person, place: list[float]) -> tuple[int, int, int]:
    """The picture's colour (r, g, b) where a place of the world is seen."""
    x, y = person.seen(place)
    r, g, b = person.shot("course")[round(y), round(x)]
    return int(r), int(g), int(b)


def test_the_course_is_seen_and_played_with_a_pen(browser: Any, hall: Hall) -> None:
    record = Ear(hall.folder, "course")
    person = Person(browser, hall)
    try:
        person.until("bunraku.stage.overlays && [...bunraku.stage.overlays.keys()].some(k => k.includes('course'))")
        hall.until(lambda: bool(record.listen()))
        tile = stages()[0].tiles[2].mean(axis=0)
        r, g, b = red_part(person, [float(tile[0]) + 0.5, 0.0, float(tile[1])])
        assert b > r + 25, "a cyan tile"
        assert g > r + 15
        beside = red_part(person, [2.2, 0.0, float(tile[1])])
        assert abs(beside[2] - beside[0]) < 25, "the ground beside it is grey"
        assert record.heard[-1]["phase"] == "ready"
        x, y = person.seen([0.0, 0.0, 0.1])
        u, v = person.seen([0.0, 0.0, 1.6])
        person.pen("mouseMoved", x, y)
        person.pen("mousePressed", x, y, **DOWN)
        for k in range(1, 41):
            person.pen("mouseMoved", x + (u - x) * k / 40, y + (v - y) * k / 40, force=0.3, **DOWN)
            person.page.wait_for_timeout(25)
        person.pen("mouseReleased", u, v, button="left")
        hall.until(lambda: record.listen()[-1]["phase"] == "running", 60.0)
        hall.until(lambda: record.listen()[-1]["seconds"] > 0.5, 60.0)
        assert person.faults == []
    finally:
        person.close()
        record.close()
