"""What a visitor meets first, in a real browser: the link that invites, an empty stage, a browser without WebGL."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pages import SHOTS, Hall, needs_browser

from bunraku.nodes.web.access import AccessError, lan_address

pytestmark = needs_browser(200)
LAUNCH = '''"""A page for the network."""
from bunraku.runtime.launch import NodeSpec, node


def launch() -> list[NodeSpec]:
    """The page alone."""
    return [node("web", params={"port": 0, "lan": True})]
'''
INVITATION = re.compile(r"http://\S+#t=\S+")


@pytest.fixture(scope="module")
def hall(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Hall]:
    try:
        lan_address()
    except AccessError:
        pytest.skip("needs a network interface")
    folder = tmp_path_factory.mktemp("d")
    (folder / "door.py").write_text(LAUNCH)
    one = Hall(folder, [str(folder / "door.py")])
    one.until(lambda: INVITATION.search(one.said()) is not None)
    yield one
    one.close()


def state_of(page: Any, wanted: str) -> None:
    page.locator(f"#status[data-state={wanted}]").wait_for(state="attached", timeout=30_000)


def test_the_link_lets_in_and_its_token_leaves_the_address(browser: Any, hall: Hall) -> None:
    found = INVITATION.search(hall.said())
    assert found is not None
    link, token = found[0], found[0].partition("#t=")[2]
    context = browser.new_context()
    try:
        page = context.new_page()
        page.goto(link)
        state_of(page, "open")
        assert token not in page.url
        page.reload()  # the session knows it
        state_of(page, "open")
        assert hall.said().count(token) == 1  # on the terminal, in no log line
        page.get_by_text("No figure is on the stage yet").wait_for()
        if SHOTS:
            page.screenshot(path=Path(SHOTS) / "no-figure.png")
    finally:
        context.close()


@pytest.mark.parametrize("words", ["", "#t=AAAAAAAAAAAAAAAAAAAAAA"])
def test_without_the_right_token_it_is_told_why_nothing_comes(browser: Any, hall: Hall, words: str) -> None:
    context = browser.new_context(viewport={"width": 390, "height": 844})
    try:
        page = context.new_page()
        page.goto(hall.link + words)
        state_of(page, "refused")
        assert page.get_by_text("The link is not valid any more").is_visible()
        if SHOTS:
            page.screenshot(path=Path(SHOTS) / "not-let-in.png")
        assert page.evaluate("bunraku.stage.figures.size") == 0
        assert page.evaluate("bunraku.connection.bytes") == 0
    finally:
        context.close()


def test_a_browser_without_webgl_says_what_is_missing(browser: Any, hall: Hall) -> None:
    context = browser.new_context()
    try:
        page = context.new_page()
        page.add_init_script("HTMLCanvasElement.prototype.getContext = () => null")
        page.goto(hall.link)
        state_of(page, "broken")
        assert page.get_by_text("The stage cannot be shown here").is_visible()
        assert page.get_by_text("WebGL 2").is_visible()
        if SHOTS:
            page.screenshot(path=Path(SHOTS) / "no-webgl.png")
    finally:
        context.close()


def test_a_browser_without_javascript_says_what_is_missing(browser: Any, hall: Hall) -> None:
    context = browser.new_context(java_script_enabled=False)
    try:
        page = context.new_page()
        page.goto(hall.link)
        page.get_by_text("JavaScript is switched off").wait_for()
        if SHOTS:
            page.screenshot(path=Path(SHOTS) / "no-javascript.png")
    finally:
        context.close()
