"""The tcp side of the bridge: addresses, keys, greetings, what is latched, and who is kept out."""

import stat
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import zmq

from bunraku.nodes.bridge import keys
from bunraku.nodes.bridge.keys import KeyProblem, write_pair
from bunraku.nodes.bridge.link import FORGET, Link, LinkProblem, address_of


@pytest.fixture
def make() -> Iterator[Callable[..., Link]]:
    made: list[Link] = []

    def make(**options: str) -> Link:
        made.append(Link(**options))
        return made[-1]

    yield make
    for one in made:
        one.close()


class Pump:
    """Drives links by a steady clock of their own until something is there."""

    def __init__(self, *links: Link) -> None:
        self.links = links
        self.now = 0.0
        self.got: list[list[Any]] = [[] for _ in links]

    def until(self, condition: Callable[[], Any], seconds: float = 20.0) -> None:
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, "it did not come"
            self.turn()

    def turn(self) -> None:
        self.now += 0.02
        for link, got in zip(self.links, self.got, strict=True):
            link.keep(self.now)
            got.extend(link.receive())
        time.sleep(0.001)


def port(link: Link) -> str:
    return link.endpoint.removeprefix("tcp://")


@pytest.mark.parametrize(
    ("text", "endpoint", "local"),
    [
        ("7447", "tcp://127.0.0.1:7447", True),
        ("127.0.0.1:7447", "tcp://127.0.0.1:7447", True),
        ("tcp://localhost:7447", "tcp://localhost:7447", True),
        ("[::1]:7447", "tcp://[::1]:7447", True),
        ("0", "tcp://127.0.0.1:*", True),
        ("0.0.0.0:7447", "tcp://0.0.0.0:7447", False),
        ("*:7447", "tcp://*:7447", False),
        ("10.0.0.1:7447", "tcp://10.0.0.1:7447", False),
        ("stage.local:7447", "tcp://stage.local:7447", False),
        ("127.0.0.1.evil.org:7447", "tcp://127.0.0.1.evil.org:7447", False),
    ],
)
def test_addresses(text, endpoint, local):
    assert address_of(text) == (endpoint, local)


@pytest.mark.parametrize("text", ["", "host", "host:99999", "udp://a:1", "a b:1", "a:1:2"])
def test_wrong_addresses_are_refused(text):
    with pytest.raises(LinkProblem, match="write host:port"):
        address_of(text)


@pytest.mark.parametrize("side", ["listen", "connect"])
@pytest.mark.parametrize("host", ["0.0.0.0", "*", "192.168.1.2", "stage.local"])
def test_no_keys_only_on_this_machine(side, host):
    with pytest.raises(LinkProblem, match=rf"{side}: .* without keys: .*bunraku keys DIR"):
        Link(**{side: f"{host}:7447"})


def test_one_of_listen_and_connect():
    with pytest.raises(LinkProblem, match="give one of listen and connect"):
        Link()
    with pytest.raises(LinkProblem, match="give one of listen and connect"):
        Link(listen="1", connect="2")


def test_a_taken_port_is_told(make):
    first = make(listen="0")
    with pytest.raises(LinkProblem, match="in use"):
        Link(listen=port(first))


def test_bodies_go_both_ways_and_latched_ones_wait_for_a_peer(make):
    here = make(listen="0")
    there = make(connect=port(here))
    here.send("camera", b"old", latched=True)
    here.send("camera", b"new", latched=True)
    there.send("skeleton", b"bones", latched=True)
    here.send("pose", b"lost: nobody is there")
    pump = Pump(here, there)
    pump.until(lambda: all(pump.got))
    assert pump.got == [[("skeleton", True, b"bones")], [("camera", True, b"new")]]
    here.send("alice/pose", b"1")
    there.send("touch", b"2")
    pump.until(lambda: len(pump.got[0]) == 2 and len(pump.got[1]) == 2)
    assert pump.got[0][1] == ("touch", False, b"2")
    assert pump.got[1][1] == ("alice/pose", False, b"1")


def test_a_listener_that_starts_again_gets_what_is_latched_again(make):
    here = make(listen="0")
    address = port(here)
    there = make(connect=address)
    there.send("skeleton", b"bones", latched=True)
    pump = Pump(here, there)
    pump.until(lambda: pump.got[0])
    here.close()
    again = make(listen=address)
    pump = Pump(again, there)
    pump.until(lambda: pump.got[0])
    assert pump.got[0][0] == ("skeleton", True, b"bones")


def test_a_silent_peer_is_forgotten(make):
    here = make(listen="0")
    there = make(connect=port(here))
    pump = Pump(here, there)
    pump.until(lambda: here.peers)
    here.keep(pump.now + FORGET + 1)
    assert not here.peers


def test_one_who_does_not_greet_hears_and_says_nothing(make):
    here = make(listen="0")
    there = make(connect=port(here))
    stranger = make(connect=port(here))
    stranger._send([b"touch", b"", b"forged"])
    pump = Pump(here, there)
    pump.until(lambda: here.peers and there.peers)
    there.send("touch", b"true")
    pump.until(lambda: pump.got[0])
    assert pump.got[0] == [("touch", False, b"true")]


def test_keys_are_for_their_owner_alone(tmp_path):
    folder = tmp_path / "keys"
    for path in write_pair(folder, "listen"):
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    with pytest.raises(KeyProblem, match="is there already"):
        write_pair(folder, "listen")
    with pytest.raises(KeyProblem, match="holds no peer's"):
        keys.listener(folder)
    (folder / "listen.key_secret").chmod(0o644)
    with pytest.raises(KeyProblem, match="chmod 600"):
        keys.listener(folder)
    with pytest.raises(KeyProblem, match="bunraku keys"):
        keys.listener(tmp_path)
    with pytest.raises(KeyProblem, match=r"must hold one peer's .key_secret"):
        keys.connector(tmp_path)


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    """The keys as they lie on two machines."""
    here, there = tmp_path / "here", tmp_path / "there"
    write_pair(here, "listen")
    write_pair(here, "connect")
    there.mkdir(mode=0o700)
    for name in ("connect.key_secret", "listen.key"):
        (there / name).write_bytes((here / name).read_bytes())
        (there / name).chmod(0o600)
    (here / "connect.key_secret").unlink()
    return here, there


def test_known_keys_join(make, folders):
    here = make(listen="0", keys=str(folders[0]))
    there = make(connect=port(here), keys=str(folders[1]))
    here.send("skeleton", b"bones", latched=True)
    pump = Pump(here, there)
    pump.until(lambda: pump.got[1])
    assert pump.got[1] == [("skeleton", True, b"bones")]
    there.send("touch", b"x")
    pump.until(lambda: pump.got[0])
    assert here.denied == 0


def test_an_unknown_key_and_no_key_get_nothing(make, folders, tmp_path):
    here = make(listen="0", keys=str(folders[0]))
    here.send("skeleton", b"bones", latched=True)
    strange = tmp_path / "strange"
    write_pair(strange, "mallory")
    (strange / "listen.key").write_bytes((folders[1] / "listen.key").read_bytes())
    mallory = make(connect=port(here), keys=str(strange))
    bare = make(connect=port(here))
    known = make(connect=port(here), keys=str(folders[1]))
    pump = Pump(here, mallory, bare, known)
    # refused for certain, while one that is known is served and what the others say is not heard
    pump.until(lambda: here.denied and pump.got[3])
    mallory.send("touch", b"forged")
    bare.send("touch", b"forged")
    known.send("touch", b"true")
    pump.until(lambda: pump.got[0])
    assert pump.got[0] == [("touch", False, b"true")]
    assert pump.got[1] == pump.got[2] == []
    assert not mallory.peers
    assert not bare.peers


def test_a_listener_with_another_key_is_not_believed(make, folders, tmp_path):
    false = tmp_path / "false"
    write_pair(false, "listen")
    (false / "connect.key").write_bytes((folders[0] / "connect.key").read_bytes())
    here = make(listen="0", keys=str(false))
    there = make(connect=port(here), keys=str(folders[1]))
    watcher = there._socket.get_monitor_socket(zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL | zmq.EVENT_DISCONNECTED)
    pump = Pump(here, there)
    pump.until(lambda: watcher.poll(0))
    assert not there.peers
    there._socket.disable_monitor()
