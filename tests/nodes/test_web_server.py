"""The page server: who comes in, what is refused, and that a slow or bad page harms nobody."""

import asyncio
import contextlib
import json
import shutil
import socket as socketlib
import ssl
import struct
import threading
import urllib.error
import urllib.request
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from bunraku.figure.default import default_figure
from bunraku.figure.wire import to_message
from bunraku.msgs import Camera, Event, InvalidMessage, Overlay, Parameter, Params, Pose, Primitive
from bunraku.nodes.web.access import AccessError, Gate, TokenBucket, certificate, host_names, peer_user, qr
from bunraku.nodes.web.calls import Calls
from bunraku.nodes.web.files import load_page, weight
from bunraku.nodes.web.mesh import pack_mesh
from bunraku.nodes.web.node import Web
from bunraku.nodes.web.protocol import POSE, Call, Hello, Input, Ping, decode_text, pack_pose, with_echo
from bunraku.nodes.web.server import WINDOW, Hooks, PageServer
from bunraku.nodes.web.takes import Takes
from bunraku.runtime.bag import BagWriter, Channel
from bunraku.runtime.memory import MemoryStage
from bunraku.runtime.params import ParamProblem

TOKEN = "s3cret-token-of-128-bits"


class House:
    """A server and what it told."""

    def __init__(self, token: str = "", figures: tuple[str, ...] = ("",)) -> None:
        self.inputs: list[tuple[str, str, Input, int]] = []
        self.gone: list[tuple[str, str]] = []
        self.making = 0
        self.came = threading.Condition()
        self.server = PageServer(
            Hooks(self._input, self._gone, self._call), load_page(), Gate(frozenset(), "http", token), figures
        )
        self.server.start("127.0.0.1", 0)
        self.port = self.server.port
        self.server.gate = Gate(host_names(["127.0.0.1", "localhost"], self.port, "http"), "http", token)

    def _input(self, page: str, figure: str, sample: Input, received: int) -> None:
        with self.came:
            self.inputs.append((page, figure, sample, received))
            self.came.notify_all()

    def _gone(self, page: str, figure: str) -> None:
        with self.came:
            self.gone.append((page, figure))
            self.came.notify_all()

    async def _call(self, page: str, call: Call) -> dict[str, Any]:
        if call.verb == "echo":
            return dict(call.args)
        if call.verb == "take.file":
            self.making += 1
            try:
                for share in range(10):
                    self.server.tell_progress(page, call.id, "filming", share / 10)
                    await asyncio.sleep(0.005)
                await asyncio.sleep(60.0)
            finally:
                with self.came:
                    self.making -= 1
                    self.came.notify_all()
        raise ValueError(f"no such call: {call.verb}")

    def wait(self, condition: Callable[[], bool]) -> None:
        with self.came:
            assert self.came.wait_for(condition, 10.0)

    @property
    def origin(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def connect(self, **options: Any) -> Any:
        options.setdefault("origin", self.origin)
        return connect(f"ws://127.0.0.1:{self.port}/socket", max_size=None, **options)


@pytest.fixture
def house() -> Iterator[House]:
    one = House()
    yield one
    one.server.stop()


@pytest.fixture
def guarded() -> Iterator[House]:
    one = House(TOKEN)
    yield one
    one.server.stop()


def run(work: Awaitable[None]) -> None:
    async def limited() -> None:
        await asyncio.wait_for(work, 30.0)

    asyncio.run(limited())


async def hello(socket: ClientConnection, page: str = "aaaa1111", **fields: Any) -> dict[str, Any]:
    await socket.send(json.dumps({"t": "hello", "page": page, **fields}))
    return await told(socket, "welcome")


async def told(socket: ClientConnection, kind: str) -> dict[str, Any]:
    """The next text of a kind."""
    async for data in socket:
        if isinstance(data, str):
            message: dict[str, Any] = json.loads(data)
            if message["t"] == kind:
                return message
    raise AssertionError(f"closed before {kind} came")


async def closed(socket: ClientConnection) -> int:
    """Read until the end; the code that it was closed with, 1006 where the connection broke."""
    try:
        while True:
            await socket.recv()
    except ConnectionClosed as error:
        return error.rcvd.code if error.rcvd is not None else 1006


async def bundle(socket: ClientConnection) -> tuple[int, bytes]:
    """The next bundle: its number and the payload of its first part."""
    async for data in socket:
        if isinstance(data, bytes):
            number, _, _, _, length = struct.unpack_from("<IBBHI", data)
            return number, data[12 : 12 + length]
    raise AssertionError("closed before a bundle came")


def touch(**contact: Any) -> str:
    one = {"id": 1, "phase": "down", "x": 0.5, "y": 0.25, **contact}
    return json.dumps({"t": "input", "kind": "touch", "time": 12.5, "size_m": [0.3, 0.2], "contacts": [one]})


def pose(seq: int = 0) -> Pose:
    figure = default_figure()
    root, rotations = figure.rest_pose()
    return Pose(skeleton=figure.hash, root=root, rotations=rotations, seq=seq)


def get(house: House, path: str, **headers: str) -> Any:
    request = urllib.request.Request(f"{house.origin}{path}", headers=headers)
    return urllib.request.urlopen(request, timeout=10)


# -- files --------------------------------------------------------------------------------------------------------


def test_the_page_comes_compressed_with_a_strict_policy(house: House) -> None:
    with get(house, "/", **{"Accept-Encoding": "gzip"}) as answer:
        policy = answer.headers["Content-Security-Policy"]
        assert answer.headers["Content-Encoding"] == "gzip"
        etag = answer.headers["ETag"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "frame-ancestors 'none'" in policy
    assert f"connect-src 'self' ws://127.0.0.1:{house.port};" in policy
    with pytest.raises(urllib.error.HTTPError) as raised:
        get(house, "/", **{"If-None-Match": etag})
    assert raised.value.code == 304


@pytest.mark.parametrize("path", ["/../node.py", "/%2e%2e/node.py", "/jsconfig.json", "/ticket/none", "//etc/passwd"])
def test_nothing_but_the_page_is_served(house: House, path: str) -> None:
    with pytest.raises(urllib.error.HTTPError) as raised:
        get(house, path)
    assert raised.value.code == 404


def test_the_page_and_its_figure_weigh_under_60_kb() -> None:
    import gzip

    assert weight(load_page()) + len(gzip.compress(pack_mesh(default_figure()), 9)) < 60_000


def test_the_page_asks_nobody_else_for_anything() -> None:
    for path, file in load_page().items():
        text = file.body.decode()
        assert "https://" not in text, path
        assert text.count("http://") == text.count("http://www.w3.org/"), path
        assert ' style="' not in text, path


def test_a_ticket_is_good_once(house: House, tmp_path: Path) -> None:
    file = tmp_path / "take.mcap"
    file.write_bytes(b"bag")
    url = house.server.tickets.add(house.server._loop.time(), file, "take-1.mcap")
    with get(house, url) as answer:
        assert answer.read() == b"bag"
        assert 'filename="take-1.mcap"' in answer.headers["Content-Disposition"]
    with pytest.raises(urllib.error.HTTPError):
        get(house, url)


# -- the door -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("host", ["evil.example", "evil.example:80", "127.0.0.1", "127.0.0.1.evil.example"])
def test_another_host_name_is_refused(house: House, host: str) -> None:
    with pytest.raises(urllib.error.HTTPError) as raised:
        get(house, "/", Host=host)
    assert raised.value.code == 403


@pytest.mark.parametrize("origin", [None, "http://evil.example", "null", "https://127.0.0.1", "file://"])
def test_another_page_s_socket_is_refused(house: House, origin: str | None) -> None:
    async def work() -> None:
        with pytest.raises(InvalidStatus) as raised:
            await house.connect(origin=origin)
        assert raised.value.response.status_code == 403

    run(work())


@pytest.mark.parametrize(
    "first",
    [
        '{"t":"hello","page":"aaaa1111"}',
        '{"t":"hello","page":"aaaa1111","token":"s3cret-token-of-128-bitz"}',
        '{"t":"hello","page":"aaaa1111","token":""}',
        touch(),
        "garbage",
        b"\x00\x01\x02\x03",
    ],
)
def test_a_page_without_the_token_gets_nothing(guarded: House, first: str | bytes) -> None:
    async def work() -> None:
        guarded.server.offer("0 pose", POSE, 0, pack_pose(pose()))
        async with guarded.connect() as socket:
            await socket.send(first)
            assert await closed(socket) == 4003
        assert guarded.inputs == []
        async with guarded.connect() as socket:
            assert (await hello(socket, token=TOKEN))["t"] == "welcome"

    run(work())


def test_gate_rules() -> None:
    gate = Gate(host_names(["192.0.2.7", "Stage.Local"], 8420, "http"), "http", TOKEN)
    assert gate.host_ok("stage.local:8420")
    assert not gate.host_ok("stage.local")
    assert not gate.host_ok(None)
    assert gate.origin_ok("http://192.0.2.7:8420", "192.0.2.7:8420")
    assert not gate.origin_ok("https://192.0.2.7:8420", "192.0.2.7:8420")
    assert not gate.origin_ok("http://192.0.2.7:8420", "stage.local:8420")
    assert gate.token_ok(TOKEN)
    assert not gate.token_ok("ä")
    assert host_names(["a"], 443, "https") == {"a:443", "a"}


def test_a_loopback_peer_s_user_is_read_from_the_kernel_s_table(tmp_path: Path) -> None:
    table = tmp_path / "tcp"
    head = "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode\n"
    row = "   1: 0100007F:C350 0100007F:20E4 01 00000000:00000000 00:00000000 00000000  1234        0 99\n"
    table.write_text(head + row)
    assert peer_user(("127.0.0.1", 50000), 8420, table) == 1234
    assert peer_user(("127.0.0.1", 50001), 8420, table) is None
    assert peer_user(("127.0.0.1", 50000), 8421, table) is None
    assert peer_user(("127.0.0.1", 50000), 8420, tmp_path / "none") is None


def test_a_token_bucket_lets_a_burst_and_then_a_rate_through() -> None:
    bucket = TokenBucket(10.0, 5.0)
    assert sum(bucket.take(0.0) for _ in range(20)) == 5
    assert sum(bucket.take(1.0) for _ in range(20)) == 5
    assert sum(bucket.take(1.0 + 0.05 * k) for k in range(1, 41)) in (19, 20)


def test_a_qr_code_is_drawn_for_the_link() -> None:
    assert len(qr("http://192.0.2.7:8420/#t=abc").splitlines()) > 12


# -- what pages say ----------------------------------------------------------------------------------------------


def test_input_arrives_with_the_values_that_were_made(house: House) -> None:
    async def work() -> None:
        async with house.connect() as socket:
            await hello(socket)
            await socket.send(touch(major=0.012, minor=0.009, angle=0.5, pressure=None))
            await socket.send(
                json.dumps(
                    {
                        "t": "input", "kind": "hands", "time": 1, "left": None,
                        "right": {"position": [0.1, -1, 1], "rotation": None, "bend": [0, 0, 1, 0, -1]},
                    }
                )
            )  # fmt: skip
            await asyncio.to_thread(house.wait, lambda: len(house.inputs) == 2)
            await socket.close()
        await asyncio.to_thread(house.wait, lambda: house.gone == [("aaaa1111", "")])

    run(work())
    page, figure, first, _ = house.inputs[0]
    assert (page, figure) == ("aaaa1111", "")
    event = first.event("web-aaaa1111")
    contact = event.contacts[0]
    assert (contact.x, contact.y, contact.major, contact.minor, contact.angle) == (0.5, 0.25, 0.012, 0.009, 0.5)
    assert event.size_m == (0.3, 0.2)
    assert Event.decode(event.encode()) == event
    right = house.inputs[1][2].right
    assert right is not None
    assert (right.position, right.bend) == ((0.1, -1.0, 1.0), (0.0, 0.0, 1.0, 0.0, -1.0))


@pytest.mark.parametrize(
    "bad",
    [
        "", "{", "[]", "null", '{"t":"surprise"}',
        '{"t":"input","kind":"gone"}', '{"t":"input","kind":"touch","x":1}',
        touch(x=99), touch(phase="hold"), touch().replace("0.25", "NaN"), touch().replace("0.25", "1e999"),
        "[" * 5000, '{"t":"call","id":-1,"verb":"reset"}', '{"t":"hello","page":"../../x"}',
    ],
)  # fmt: skip
def test_what_is_no_message_is_refused(bad: str) -> None:
    with pytest.raises(InvalidMessage):
        decode_text(bad)


def test_messages_of_every_kind_are_read() -> None:
    assert isinstance(decode_text('{"t":"hello","page":"abcd"}'), Hello)
    assert isinstance(decode_text(touch()), Input)
    assert isinstance(decode_text('{"t":"call","id":1,"verb":"reset"}'), Call)
    assert isinstance(decode_text('{"t":"ping","time":1}'), Ping)


def test_broken_messages_are_dropped_and_too_many_end_the_page(house: House) -> None:
    async def work() -> None:
        async with house.connect() as socket:
            await hello(socket)
            for _ in range(20):
                await socket.send('{"t": "input", "kind": ')
            await socket.send(touch())
            await asyncio.to_thread(house.wait, lambda: len(house.inputs) == 1)
            for _ in range(40):
                await socket.send("\x00")
            assert await closed(socket) == 1007
        assert house.server.counts["broken"] > 50

    run(work())


async def played(house: House, socket: ClientConnection, count: int) -> None:
    """The rightful page goes on: its input arrives and poses come."""
    before = len([one for one in house.inputs if one[0] == "good0001"])
    for k in range(count):
        await socket.send(touch(id=k))
        house.server.offer("0 pose", POSE, 0, pack_pose(pose(k)))
        number, _ = await bundle(socket)
        await socket.send(struct.pack("<I", number))

    def all_there() -> bool:
        return len([one for one in house.inputs if one[0] == "good0001"]) == before + count

    await asyncio.to_thread(house.wait, all_there)


def test_ten_megabytes_end_their_page_only(house: House) -> None:
    async def work() -> None:
        async with house.connect() as good:
            bad = await house.connect()
            await hello(good, "good0001")
            await hello(bad, "bad00001", role="play")
            with contextlib.suppress(ConnectionClosed):
                await bad.send("x" * 10_000_000)
            assert await closed(bad) in (
                1006,
                1009,
            )  # the rest of it may break the connection before the reason is read
            await played(house, good, 20)

    run(work())
    house.wait(lambda: ("bad00001", "") in house.gone)


def test_a_flood_ends_its_page_only(house: House) -> None:
    async def work() -> None:
        async with house.connect() as good, house.connect() as bad:
            await hello(good, "good0001")
            await hello(bad, "bad00001", role="play")

            async def flood() -> int:
                with contextlib.suppress(ConnectionClosed):
                    for _ in range(10_000):
                        await bad.send(touch())
                return await closed(bad)

            code, _ = await asyncio.gather(flood(), played(house, good, 50))
            assert code in (1006, 1008)

    run(work())
    assert house.server.counts["flooded"] == 1
    assert len([one for one in house.inputs if one[0] == "bad00001"]) < 2000
    house.wait(lambda: ("bad00001", "") in house.gone)


# -- what pages hear ----------------------------------------------------------------------------------------------


def test_a_slow_page_gets_the_newest_and_never_a_queue(house: House) -> None:
    async def work() -> None:
        async with house.connect() as socket:
            await hello(socket)
            for k in range(WINDOW):
                house.server.offer("0 pose", POSE, 0, pack_pose(pose(k)))
                assert (await bundle(socket))[0] == k + 1
            for k in range(WINDOW, 500):  # nothing is acknowledged: none of these may be sent
                house.server.offer("0 pose", POSE, 0, pack_pose(pose(k)))
            await socket.send('{"t":"ping","time":5}')
            while True:
                data = await socket.recv()
                assert isinstance(data, str), "a bundle came before room was made for it"
                if json.loads(data)["t"] == "pong":
                    break
            await socket.send(struct.pack("<I", WINDOW))
            number, payload = await bundle(socket)
            assert number == WINDOW + 1
            assert struct.unpack_from("<I", payload, 16)[0] == 499

    run(work())


def test_a_pose_tells_the_page_whose_input_it_stems_from(house: House) -> None:
    async def work() -> None:
        async with house.connect() as one, house.connect() as two:
            await hello(one, "one00001")
            await hello(two, "two00001")
            await one.send(touch())
            await asyncio.to_thread(house.wait, lambda: len(house.inputs) == 1)
            house.server.offer("0 pose", POSE, 0, pack_pose(pose()), house.inputs[0][3])
            (_, mine), (_, other) = await bundle(one), await bundle(two)
            assert struct.unpack_from("<d", mine, 8)[0] == 12.5
            assert struct.unpack_from("<d", other, 8)[0] != 12.5
            assert mine == with_echo(other, 12.5)

    run(work())


def test_a_late_page_gets_what_was_told_before(house: House) -> None:
    async def work() -> None:
        house.server.tell("skeleton ", '{"t":"skeleton","n":1}')
        house.server.tell("skeleton ", '{"t":"skeleton","n":2}')
        house.server.offer("0 pose", POSE, 0, pack_pose(pose(9)))
        async with house.connect() as socket:
            await hello(socket)
            assert (await told(socket, "skeleton"))["n"] == 2
            _, payload = await bundle(socket)
            assert struct.unpack_from("<I", payload, 16)[0] == 9

    run(work())


def test_a_second_page_watches_until_it_asks_to_play() -> None:
    house = House(figures=("", "alice"))

    async def work() -> None:
        async with house.connect() as one, house.connect() as two:
            await hello(one, "one00001")
            assert (await told(one, "stage"))["role"] == "play"
            await hello(two, "two00001")
            assert (await told(two, "stage"))["role"] == "watch"
            await two.send(touch())
            await two.send('{"t":"ping","time":1}')
            await told(two, "pong")
            assert house.inputs == []
            await two.send('{"t":"call","id":1,"verb":"role","args":{"figure":"alice","role":"auto"}}')
            assert (await told(two, "reply"))["data"] == {"role": "play", "figure": "alice"}
            await two.send(touch())
            await asyncio.to_thread(house.wait, lambda: len(house.inputs) == 1)
            assert house.inputs[0][:2] == ("two00001", "alice")
            await two.send('{"t":"call","id":2,"verb":"role","args":{"role":"watch"}}')
            assert (await told(two, "reply"))["ok"]
            assert house.gone == [("two00001", "alice")]
            await two.send('{"t":"call","id":3,"verb":"role","args":{"figure":"nobody"}}')
            assert not (await told(two, "reply"))["ok"]

    try:
        run(work())
    finally:
        house.server.stop()


def test_a_page_that_comes_again_takes_its_old_place(house: House) -> None:
    async def work() -> None:
        async with house.connect() as old:
            await hello(old)
            await old.send(touch())
            await asyncio.to_thread(house.wait, lambda: len(house.inputs) == 1)
            async with house.connect() as new:
                await hello(new)
                assert await closed(old) == 4001
                assert house.gone == [("aaaa1111", "")]
                assert (await told(new, "stage"))["role"] == "play"
                await new.send(touch())
                await asyncio.to_thread(house.wait, lambda: len(house.inputs) == 2)

    run(work())
    house.wait(lambda: len(house.gone) == 2)


def test_calls_are_answered_or_refused_with_the_reason(house: House) -> None:
    async def work() -> None:
        async with house.connect() as socket:
            await hello(socket)
            await socket.send('{"t":"call","id":5,"verb":"echo","args":{"a":1}}')
            assert await told(socket, "reply") == {"t": "reply", "id": 5, "ok": True, "data": {"a": 1}}
            await socket.send('{"t":"call","id":6,"verb":"rm"}')
            answer = await told(socket, "reply")
            assert (answer["ok"], answer["error"]) == (False, "no such call: rm")

    run(work())


def test_what_takes_long_tells_how_far_it_is_and_can_be_cancelled(house: House) -> None:
    async def work() -> None:
        async with house.connect() as socket, house.connect() as other:
            await hello(socket)
            await hello(other, "bbbb2222")
            await socket.send('{"t":"call","id":7,"verb":"take.file"}')
            shares = []
            while not shares or shares[-1] < 0.5:
                told_ = await told(socket, "progress")
                assert (told_["id"], told_["what"]) == (7, "filming")
                shares.append(told_["share"])
            assert shares == sorted(shares)
            await other.send('{"t":"call","id":1,"verb":"cancel","args":{"id":7}}')
            assert (await told(other, "reply"))["data"] == {"cancelled": False}  # another page's work
            assert house.making == 1
            await socket.send('{"t":"call","id":8,"verb":"cancel","args":{"id":7}}')
            replies = {one["id"]: one for one in [await told(socket, "reply"), await told(socket, "reply")]}
            assert (replies[7]["ok"], replies[7]["error"]) == (False, "cancelled")
            assert replies[8]["data"] == {"cancelled": True}
            assert house.making == 0

    run(work())


def test_what_a_page_waits_for_ends_when_it_leaves(house: House) -> None:
    async def work() -> None:
        async with house.connect() as socket:
            await hello(socket)
            await socket.send('{"t":"call","id":7,"verb":"take.file"}')
            await told(socket, "progress")
        await asyncio.to_thread(house.wait, lambda: house.making == 0)

    run(work())


# -- calls --------------------------------------------------------------------------------------------------------


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


# -- the node ---------------------------------------------------------------------------------------------------


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


# -- beyond this machine --------------------------------------------------------------------------------------------


@pytest.mark.skipif(shutil.which("openssl") is None, reason="needs the openssl program: apt-get install openssl")
def test_a_self_made_certificate_serves_and_is_kept(tmp_path: Path) -> None:
    cert, key, fingerprint = certificate(tmp_path / "tls", ["127.0.0.1", "localhost", "[::1]"])
    assert key.stat().st_mode & 0o077 == 0
    assert len(fingerprint.split(":")) == 32
    assert certificate(tmp_path / "tls", ["localhost"])[2] == fingerprint
    other = certificate(tmp_path / "tls", ["localhost", "stage.local"])
    assert other[2] != fingerprint
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(other[0], other[1])

    async def call(page: str, one: Call) -> dict[str, Any]:
        return {}

    server = PageServer(Hooks(lambda *_: None, lambda *_: None, call), load_page(), Gate(frozenset(), "https"))
    server.start("127.0.0.1", 0, context)
    try:
        server.gate = Gate(host_names(["localhost"], server.port, "https"), "https")
        trusting = ssl.create_default_context(cafile=str(cert))
        with urllib.request.urlopen(f"https://localhost:{server.port}/", timeout=10, context=trusting) as answer:
            assert f"wss://localhost:{server.port}" in answer.headers["Content-Security-Policy"]

        async def work() -> None:
            origin = f"https://localhost:{server.port}"
            async with connect(f"wss://localhost:{server.port}/socket", origin=origin, ssl=trusting) as socket:
                await hello(socket)

        run(work())
    finally:
        server.stop()


def test_without_openssl_the_remedy_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(AccessError, match="apt-get install openssl"):
        certificate(tmp_path / "tls", ["localhost"])


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
