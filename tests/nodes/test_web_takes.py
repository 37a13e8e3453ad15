"""Takes and parameters: what a page may ask of the stage, and what it may not."""

import asyncio
from pathlib import Path
from typing import Any

import pytest
from house import House, get, pose, run

from bunraku.figure.default import default_figure
from bunraku.figure.wire import to_message
from bunraku.msgs import Parameter, Params
from bunraku.nodes.web.calls import Calls
from bunraku.nodes.web.protocol import Call
from bunraku.nodes.web.takes import Takes
from bunraku.runtime.bag import BagWriter, Channel


def one(value: Any, **fields: Any) -> Parameter:
    return Parameter(value=value, type=type(value).__name__, **fields)


def test_a_page_changes_numbers_and_choices_but_no_paths_and_no_keys(tmp_path: Path) -> None:
    calls = Calls(tmp_path, Takes(tmp_path))
    own = {
        "gain": one(0.5),
        "on": one(True),
        "mode": one("a", choices=["a", "b"]),
        "file": one("x"),
        "names": one([]),
    }
    for node in ("controller", "web", "alice/recorder"):
        calls.params[node] = Params(node=node, params=own)
    assert [name for name in own if calls.settable("controller", name)] == ["gain", "on", "mode"]
    assert not any(calls.settable(node, name) for node in ("web", "alice/recorder", "none") for name in own)
    with pytest.raises(ValueError, match="cannot be changed from a page"):
        asyncio.run(calls("p", Call(id=1, verb="param", args={"node": "web", "name": "gain", "value": 1})))
    with pytest.raises(ValueError, match="no such call"):
        asyncio.run(calls("p", Call(id=1, verb="__init__")))
    with pytest.raises(TypeError):
        asyncio.run(calls("p", Call(id=1, verb="take.file", args={"path": "/etc/passwd"})))


def test_the_ways_that_this_stage_hears_are_those_of_its_device_nodes(tmp_path: Path) -> None:
    calls = Calls(tmp_path, Takes(tmp_path))
    assert calls.ways() == []
    calls.params["alice/input_pen"] = Params(node="alice/input_pen", params={"drivers": one(["web", "hid"])})
    calls.params["input_touch"] = Params(node="input_touch", params={"drivers": one(["tuio"])})
    calls.params["input_hand"] = Params(node="input_hand", params={"drivers": one(["web"])})
    assert calls.ways() == ["pen", "hands"]


@pytest.mark.parametrize("name", ["../secret", "take-1", "/etc/passwd", 7, None, "take-20260101-120000"])
def test_only_takes_are_found(tmp_path: Path, name: Any) -> None:
    (tmp_path / "secret.mcap").write_bytes(b"")
    with pytest.raises(ValueError, match=r"no such take|not there"):
        Takes(tmp_path).find(name)


def test_takes_are_listed_newest_first_and_never_share_a_name(tmp_path: Path) -> None:
    takes = Takes(tmp_path / "takes")
    first = takes.new()
    first.write_bytes(b"a")
    second = takes.new()
    assert second != first
    second.write_bytes(b"bb")
    (tmp_path / "takes" / "other.mcap").write_bytes(b"")
    assert {one["name"] for one in takes.listed()} == {first.stem, second.stem}


def a_take(folder: Path, frames: int = 30) -> Path:
    """A small take of the figure at rest."""
    path = folder / "take-20260101-120000.mcap"
    with BagWriter(path) as writer:
        writer.add_channel(Channel("skeleton", "SkeletonMessage", latched=True))
        writer.add_channel(Channel("pose", "Pose"))
        writer.write("skeleton", 10**18, to_message(default_figure()).encode())
        for k in range(frames):
            one = pose(k)
            one.stamp = 10**18 + k * 20_000_000
            writer.write("pose", one.stamp, one.encode())
    return path


def test_a_take_is_made_into_other_formats_and_nothing_is_left_behind(house: House, tmp_path: Path) -> None:
    path = a_take(tmp_path)
    calls = Calls(tmp_path, Takes(tmp_path))
    calls.server = house.server

    async def fetch(format: str) -> bytes:
        answer = await calls("p", Call(id=1, verb="take.file", args={"name": path.stem, "format": format}))
        with await asyncio.to_thread(get, house, answer["url"]) as got:
            assert f'filename="{path.stem}.{format}"' in got.headers["Content-Disposition"]
            body: bytes = got.read()
        assert len(body) == answer["bytes"]
        return body

    async def work() -> None:
        assert (await fetch("mcap")) == path.read_bytes()
        assert (await fetch("bvh")).startswith(b"HIERARCHY")
        assert (await fetch("glb")).startswith(b"glTF")

    run(work())
    assert calls._made is not None
    made = Path(calls._made.name)
    assert list(made.iterdir()) == []
    calls.close()
    assert not made.exists()


def test_why_a_take_is_not_made_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = Calls(tmp_path, Takes(tmp_path))
    path = tmp_path / "take-20260101-120000.mcap"

    def refused(format: str) -> str:
        with pytest.raises(ValueError) as raised:
            asyncio.run(calls("p", Call(id=1, verb="take.file", args={"name": path.stem, "format": format})))
        return str(raised.value)

    assert "is not there any more" in refused("mcap")
    with BagWriter(path) as writer:
        writer.write("touch", 10**18, b"")
    assert "no topic 'pose'" in refused("bvh")
    assert "a take can be had as" in refused("exe")
    monkeypatch.setattr("bunraku.nodes.web.calls.MAX_DOWNLOAD", 10)
    assert "too much for a page" in refused("mcap")
    assert calls._made is not None
    assert list(Path(calls._made.name).iterdir()) == []
    calls.close()
