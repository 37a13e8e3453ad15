"""The launch files of pen, touch and page: which nodes they ask for, with what."""

from typing import Any

import pytest

from bunraku.runtime.launch import LaunchError, LaunchFile


def nodes(name: str, *words: str) -> dict[str, dict[str, Any]]:
    """Node -> parameters of what a launch file asks for."""
    file = LaunchFile.find(name)
    return {f"{one.ns}/{one.kind}".lstrip("/"): one.params for one in file.specs(file.parse(list(words)))}


def test_the_page_has_a_recorder_for_its_takes() -> None:
    for words in ((), ("source:=hid", "page:=true"), ("source:=script", "script:=a.pen", "page:=true")):
        asked = nodes("pen", *words)
        assert asked["recorder"]["output"] == ""
        assert "web" in asked
        assert "web" in asked["input_pen"]["drivers"]
    assert "recorder" not in nodes("pen", "source:=script", "script:=a.pen")
    assert nodes("pen", "source:=script", "script:=a.pen", "record:=b.mcap")["recorder"]["output"] == "b.mcap"
    assert nodes("motion", "page:=true")["recorder"]["output"] == ""
    assert "recorder" not in nodes("motion")


def test_tablets_are_read_by_their_driver() -> None:
    assert nodes("pen", "source:=hid", "path:=056a:0027")["input_pen"] == {"drivers": ["hid"], "hid": "056a:0027"}
    assert nodes("pen", "source:=evdev", "path:=/dev/input/event5")["input_pen"]["evdev"] == "/dev/input/event5"
    assert nodes("pen", "source:=evdev", "device:=pad")["input_pad"] == {"drivers": ["evdev"]}
    with pytest.raises(LaunchError, match="hid reads pens"):
        nodes("pen", "source:=hid", "device:=pad")


def test_a_duet_is_two_figures_with_a_pen_each() -> None:
    asked = nodes("duet", "source:=script", "alice:=a.pen", "bob:=b.pen")
    assert asked["alice/input_pen"]["script"] == "a.pen"
    assert asked["bob/input_pen"]["script"] == "b.pen"
    assert asked["bob/blender"]["x"] - asked["alice/blender"]["x"] == pytest.approx(2.0)
    assert asked["renderer"]["figures"] == ["alice", "bob"]
    assert nodes("duet")["web"]["figures"] == ["alice", "bob"]
    with pytest.raises(LaunchError, match=r"alice:=\.\.\. bob:="):
        nodes("duet", "source:=hid")


@pytest.mark.parametrize("name", ["touch", "pen", "mixed"])
def test_the_network_is_let_in_when_asked_and_over_https_when_asked(name: str) -> None:
    assert nodes(name)["web"] == {"lan": False, "tls": False}
    assert nodes(name, "lan:=true", "tls:=true")["web"] == {"lan": True, "tls": True}
