"""Who comes in to the page server: files, hosts, origins, tokens, certificates."""

import shutil
import ssl
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from house import House, closed, get, hello, pose, run, touch
from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus

from bunraku.figure.default import default_figure
from bunraku.nodes.web.access import AccessError, Gate, TokenBucket, certificate, host_names, peer_user, qr
from bunraku.nodes.web.audience import Hooks
from bunraku.nodes.web.files import load_page, weight
from bunraku.nodes.web.mesh import pack_mesh
from bunraku.nodes.web.protocol import POSE, Call, pack_pose
from bunraku.nodes.web.server import PageServer

TOKEN = "s3cret-token-of-128-bits"


@pytest.fixture
def guarded() -> Iterator[House]:
    one = House(TOKEN)
    yield one
    one.server.stop()


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
