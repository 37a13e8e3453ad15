"""A pen at the stage page in a real browser walks and ducks the figure; fingers and a pen share one page."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pages import Ear, Hall, Person, differs, needs_browser

from bunraku.figure.camera import on_plane, ray
from bunraku.figure.default import default_figure
from bunraku.figure.fk import fk
from bunraku.msgs import Camera

pytestmark = needs_browser(400)
SKELETON = default_figure()
DOWN = {"button": "left", "buttons": 1}


class Scene:
    """What is heard of the figure beside what is seen of it."""

    def __init__(self, hall: Hall) -> None:
        self.hall = hall
        self.poses, self.cameras = Ear(hall.folder, "pose"), Ear(hall.folder, "camera")
        hall.until(lambda: bool(self.poses.listen() and self.cameras.listen()))

    def close(self) -> None:
        self.poses.close()
        self.cameras.close()

    def root(self) -> NDArray[np.float64]:
        return np.frombuffer(self.poses.listen()[-1]["root"], "<f4").astype(float)

    def joint(self, name: str) -> NDArray[np.float64]:
        """Where a joint is, m."""
        turns = np.frombuffer(self.poses.listen()[-1]["rotations"], "<f4").reshape(-1, 4).astype(float)
        places, _ = fk(SKELETON, self.root(), turns)
        return np.asarray(places)[SKELETON.names.index(name)]

    def ground(self, person: Person, x: float, y: float) -> NDArray[np.float64]:
        """The place on the ground (x, z) m under a pixel of the page."""
        picture = person.ask("bunraku.stage.picture()")
        body = self.cameras.listen()[-1]
        camera = Camera(**{key: body[key] for key in ("position", "rotation", "yfov", "aspect")})
        eye, way = ray(camera, (x - picture["left"]) / picture["width"], (y - picture["top"]) / picture["height"])
        t = on_plane(eye, way, np.zeros(3), np.array([0.0, 1.0, 0.0]))
        assert t is not None
        return np.asarray(eye + t * way)[[0, 2]]

    def pixel(self, person: Person) -> tuple[float, float]:
        """Where on the page the ground under the hips is seen."""
        x, _, z = (float(v) for v in self.root())
        return person.seen([x, 0.0, z])

    def settle(self, person: Person) -> None:
        """Wait until figure and camera are at rest."""
        before = np.full(6, np.inf)

        def still() -> bool:
            nonlocal before
            now = np.concatenate([self.root(), self.cameras.listen()[-1]["position"]])
            moved = np.abs(now - before).max()
            before = now
            return bool(moved < 2e-3)

        for _ in range(8):
            self.until(still, person)

    def until(self, condition: Callable[[], bool], person: Person, seconds: float = 60.0) -> None:
        def met() -> bool:
            person.page.wait_for_timeout(30)  # the browser goes on
            self.poses.listen()
            return condition()

        self.hall.until(met, seconds)


@pytest.fixture(scope="module")
def words() -> list[str]:
    return ["pen", "window:=off"]


@pytest.fixture
def scene(hall: Hall, person: Person) -> Iterator[Scene]:
    person.page.locator("label", has_text="Pen").first.click()
    one = Scene(hall)
    one.settle(person)
    yield one
    one.close()


def stroke(person: Person, begin: tuple[float, float], end: tuple[float, float], **more: Any) -> None:
    """Draw a line in 60 samples; the pen stays down."""
    person.pen("mouseMoved", *begin)
    person.pen("mousePressed", *begin, clickCount=1, **DOWN, **more)
    for k in range(1, 61):
        share = k / 60
        at = [a + share * (b - a) for a, b in zip(begin, end, strict=True)]
        person.pen("mouseMoved", at[0], at[1], **DOWN, **more)
        person.page.wait_for_timeout(20)


@pytest.mark.parametrize(("right", "down"), [(260, 0), (-200, 40)])
def test_a_pen_walks_the_figure_where_it_goes_and_ducks_and_leans_it(
    person: Person, scene: Scene, right: float, down: float
) -> None:
    start, feet = scene.root(), scene.pixel(person)
    before = person.shot(f"pen-{right}-before")
    goal = (feet[0] + right, feet[1] + down)
    way = scene.ground(person, *goal) - scene.ground(person, *feet)
    stroke(person, feet, goal, force=0.25)

    def left() -> float:
        return float(np.linalg.norm((scene.root() - start)[[0, 2]] - way))

    scene.until(lambda: left() < 0.3, person)
    scene.settle(person)
    walked = person.shot(f"pen-{right}-walked")
    drawn = person.seen([start[0] + way[0], 0.0, start[2] + way[1]])  # the camera may have gone along
    assert np.hypot(*(a - b for a, b in zip(scene.pixel(person), drawn, strict=True))) < 40
    assert (drawn[0] - feet[0]) * right > 50 * abs(right), "it is seen on the side that the pen went to"
    assert differs(before, walked, person.where("hips"), 20) > 0.3, "the figure is drawn where the pen went"
    assert differs(before, walked, (feet[0], feet[1] - 80), 20) > 0.3, "and not where it was"

    stands = scene.root()[1]
    for k in range(31):
        person.pen("mouseMoved", *goal, force=0.25 + 0.025 * k, **DOWN)
        person.page.wait_for_timeout(20)
    scene.until(lambda: scene.root()[1] < stands - 0.15, person)
    person.page.wait_for_timeout(300)
    head = person.where("head")
    ducked = person.shot(f"pen-{right}-ducked")
    top = (walked - ducked)[:, round(head[0]) - 15 : round(head[0]) + 15]
    assert np.abs(top[round(head[1]) - 40 : round(head[1]) - 25]).max() > 60, "its head was where now is none"

    for _ in range(10):
        person.pen("mouseMoved", *goal, force=0.25, **DOWN)
        person.page.wait_for_timeout(20)
    scene.until(lambda: scene.root()[1] > stands - 0.03, person)
    upright = scene.joint("head")[0] - scene.root()[0]
    for _ in range(10):
        person.pen("mouseMoved", *goal, force=0.25, tiltX=45, **DOWN)  # its cap to the right
        person.page.wait_for_timeout(20)
    scene.until(lambda: scene.joint("head")[0] - scene.root()[0] > upright + 0.15, person)
    person.shot(f"pen-{right}-leaning")
    person.pen("mouseReleased", *goal, button="left", buttons=0)


def test_a_pen_that_is_taken_away_in_mid_stroke_leaves_nothing_held(person: Person, scene: Scene, hall: Hall) -> None:
    pens = Ear(hall.folder, "pen")
    try:
        feet = scene.pixel(person)
        stroke(person, feet, (feet[0] + 100, feet[1]), force=0.25)
        scene.until(lambda: any(one["contact"] for one in pens.listen()), person)
        person.open()  # the page is loaded anew with the pen still down
        hall.until(lambda: not pens.listen()[-1]["in_range"])
        assert not pens.heard[-1]["contact"]
    finally:
        pens.close()


def test_who_has_not_chosen_plays_as_the_stage_is_played(person: Person) -> None:
    assert person.ask("document.body.dataset.way") == "pen"
    assert person.page.get_by_label("Pen", exact=True).is_checked()


def test_a_way_that_no_node_hears_says_so(person: Person) -> None:
    idle = "[...document.querySelectorAll('#ways .idle')].map(one => one.value).join()"
    person.until(f"{idle} === 'touch,hands'")
    person.page.locator("label", has_text="Pen").first.click()
    assert "path" in person.page.locator("#hint").inner_text()
    person.page.locator("label", has_text="Touch").first.click()
    assert person.page.locator("#hint").inner_text() == "This stage is not played by touch. It is played by pen."


def test_a_mouse_is_a_pen(person: Person, scene: Scene) -> None:
    start, feet = scene.root(), scene.pixel(person)
    goal = (feet[0] - 150, feet[1])
    way = scene.ground(person, *goal) - scene.ground(person, *feet)
    person.page.mouse.move(*feet)
    person.page.mouse.down()
    person.page.mouse.move(*goal, steps=60)
    scene.until(lambda: bool(np.linalg.norm((scene.root() - start)[[0, 2]] - way) < 0.35), person)
    stands = scene.root()[1]
    for _ in range(9):
        person.page.mouse.wheel(0, -100)  # presses harder
        person.page.wait_for_timeout(60)
    assert float(person.page.locator("#pressure").input_value()) > 0.9
    scene.until(lambda: scene.root()[1] < stands - 0.1, person)
    person.page.mouse.up()
