"""What the tests with a browser share."""

import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from pages import BROWSER, FLAGS, Ear, Hall, Person

LAUNCH = '''"""The page and everything that it drives."""
from bunraku.runtime.launch import NodeSpec, node


def launch() -> list[NodeSpec]:
    """Everything the page drives."""
    return [
        node("recorder"), node("input_touch", params={"drivers": ["web"]}),
        node("input_pen", params={"drivers": ["web"]}), node("input_hand", params={"drivers": ["web"]}),
        node("interpreter", respawn=True), node("controller"),
        node("web", params={"port": 0}, respawn=True),
    ]
'''


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    from playwright import sync_api

    with sync_api.sync_playwright() as driver:
        one = driver.chromium.launch(executable_path=BROWSER, args=FLAGS)
        yield one
        one.close()


@pytest.fixture(scope="module")
def words(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """What is launched: the page and everything that it drives, or what a module says instead."""
    file = tmp_path_factory.mktemp("l") / "page.py"
    file.write_text(LAUNCH)
    return [str(file)]


@pytest.fixture(scope="module")
def hall(tmp_path_factory: pytest.TempPathFactory, words: list[str]) -> Iterator[Hall]:
    one = Hall(tmp_path_factory.mktemp("p"), words)
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
