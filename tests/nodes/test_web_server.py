"""The page server's conversation: input comes in, the newest goes out, and a slow or bad page harms nobody."""

import asyncio
import contextlib
import json
import struct

import pytest
from house import House, bundle, closed, hello, pose, run, told, touch
from websockets.asyncio.client import ClientConnection
from websockets.exceptions import ConnectionClosed

from bunraku.msgs import Event, InvalidMessage
from bunraku.nodes.web.audience import WINDOW
from bunraku.nodes.web.protocol import POSE, Call, Hello, Input, Ping, decode_text, pack_pose, with_echo


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
        assert house.server.audience.counts["broken"] > 50

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
    assert house.server.audience.counts["flooded"] == 1
    assert len([one for one in house.inputs if one[0] == "bad00001"]) < 2000
    house.wait(lambda: ("bad00001", "") in house.gone)


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
