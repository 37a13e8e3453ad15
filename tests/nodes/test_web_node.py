"""The page's node: what pages do is said, what the stage says is shown, and bad parameters end in a line."""

import asyncio
import socket as socketlib
import urllib.error
import urllib.request

import pytest
from house import bundle, closed, hello, pose, run, told, touch
from websockets.asyncio.client import connect

from bunraku.figure.default import default_figure
from bunraku.figure.wire import to_message
from bunraku.msgs import Camera, Overlay, Primitive
from bunraku.nodes.web.node import Web
from bunraku.runtime.memory import MemoryStage
from bunraku.runtime.params import ParamProblem


def test_the_node_says_what_pages_do_and_shows_what_the_stage_says() -> None:
    stage = MemoryStage()
    web = stage.add(Web, port=0)
    try:
        stage.publish("skeleton", to_message(default_figure()))
        stage.publish("camera", Camera(position=(0, 1, 4), rotation=(0, 0, 0, 1), yfov=0.6))
        stage.publish("overlay/interpreter", Overlay(primitives=[Primitive(kind="circle", points=[(0, 0, 0)])]))
        stage.publish("pose", pose())
        origin = f"http://127.0.0.1:{web.server.port}"

        async def work() -> None:
            async with connect(f"{origin.replace('http', 'ws')}/socket", origin=origin) as socket:
                await hello(socket)
                skeleton = await told(socket, "skeleton")
                assert skeleton["names"] == list(default_figure().names)
                with urllib.request.urlopen(origin + skeleton["mesh"], timeout=10) as answer:
                    assert answer.read()[:4] == b"BKM1"
                await socket.send(touch())
                while not stage._posts:
                    await asyncio.sleep(0.005)

        run(work())
        while len(stage.received("web/events")) < 2:
            stage.poll(0.01)
    finally:
        stage.remove(web)
    event, gone = stage.received("web/events")
    assert (event.device, event.kind, event.contacts[0].x) == ("web-aaaa1111", "touch", 0.5)
    assert event.origin is not None
    assert (gone.device, gone.kind) == ("web-aaaa1111", "gone")


def test_what_a_node_drew_goes_with_the_node_for_pages_that_come_later_too(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = MemoryStage()
    web = stage.add(Web, port=0, figures=["", "alice"])
    try:
        stage.publish("alice/overlay/interpreter", Overlay(primitives=[Primitive(kind="circle", points=[(0, 0, 0)])]))
        monkeypatch.setattr(web.presence, "gone", lambda: ["alice/overlay/interpreter"])
        stage.advance(0.6)
        origin = f"http://127.0.0.1:{web.server.port}"

        async def work() -> None:
            async with connect(f"{origin.replace('http', 'ws')}/socket", origin=origin) as socket:
                await hello(socket)
                _, payload = await bundle(socket)
                assert b'"primitives":[]' in payload
                assert b"alice/overlay/interpreter" in payload

        run(work())
    finally:
        stage.remove(web)


def test_a_node_started_again_lets_go_for_the_pages_of_before_and_keeps_its_place() -> None:
    stage = MemoryStage()
    web = stage.add(Web, port=0)
    web.kept.playing["aaaa1111"] = ""
    state, port = web.save(), web.server.port
    stage.remove(web)
    again = MemoryStage()
    web = again.add(Web, port=0, state=state)
    assert web.server.port == port
    assert [(one.device, one.kind) for one in again.received("web/events")] == [("web-aaaa1111", "gone")]
    again.remove(web)


def test_two_nodes_take_two_ports() -> None:
    first, second = MemoryStage(), MemoryStage()
    one_ = first.add(Web, port=0)
    two_ = second.add(Web, port=one_.server.port)
    assert two_.server.port != one_.server.port
    first.remove(one_)
    second.remove(two_)


def test_a_port_that_cannot_be_had_ends_the_node_with_a_line(caplog: pytest.LogCaptureFixture) -> None:
    stage = MemoryStage()
    with socketlib.socket() as taken:
        taken.bind(("127.0.0.1", 65535))
        taken.listen()
        web = stage.add(Web, port=65535)
    assert stage.status == 2
    assert "choose another port" in caplog.text
    stage.remove(web)


def test_bad_parameters_are_refused() -> None:
    with pytest.raises(ParamProblem):
        MemoryStage().add(Web, port=99999)


def test_on_the_network_the_link_has_a_token_that_no_log_holds(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("bunraku.nodes.web.node.lan_address", lambda: "127.0.0.1")
    stage = MemoryStage()
    with caplog.at_level("INFO"):
        web = stage.add(Web, port=0, lan=True)
    try:
        printed = capsys.readouterr().err
        link = next(line for line in printed.splitlines() if line.startswith("http"))
        token = link.partition("#t=")[2]
        assert len(token) >= 22
        assert "█" in printed
        assert token not in caplog.text
        assert not any(token in one.text for one in stage.received("log/web"))
        assert web.save() is not None
        assert token in (web.save() or b"").decode("latin-1")  # a page finds back to a restarted server
        origin = f"http://127.0.0.1:{web.server.port}"

        async def work() -> None:
            socket = await connect(f"{origin.replace('http', 'ws')}/socket", origin=origin)
            await socket.send('{"t":"hello","page":"aaaa1111"}')
            assert await closed(socket) == 4003
            async with connect(f"{origin.replace('http', 'ws')}/socket", origin=origin) as socket:
                await hello(socket, token=token)

        run(work())
    finally:
        stage.remove(web)
