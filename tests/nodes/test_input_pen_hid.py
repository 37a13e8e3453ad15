"""Pens by their own HID reports: real descriptors, reports made for them, and a device that comes and goes."""

import os
import queue
from collections.abc import Callable
from math import degrees, pi, radians, tan
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bunraku.msgs import Pen
from bunraku.nodes.input_pen import hid as hid_module
from bunraku.nodes.input_pen.hid_descriptor import DescriptorError, parse
from bunraku.nodes.input_pen.hid_report import DescribedPen, decoder_of
from bunraku.nodes.input_pen.node import InputPen
from bunraku.nodes.input_pen.tablet import spherical, tilts
from bunraku.nodes.input_pen.wacom import MODELS, BambooPen, IntuosPen
from bunraku.runtime.memory import MemoryStage

DATA = Path(os.environ.get("BUNRAKU_DEVICE_DATA", Path(__file__).parents[2].parent / "shared" / "devices"))
REAL = DATA / "hid-descriptors"
needs_devices = pytest.mark.skipif(not REAL.is_dir(), reason=f"no descriptors at {REAL} (set BUNRAKU_DEVICE_DATA)")

# A tablet of this test's own: report 7, tip, barrel, in range, X and Y of 16 bits (0..10000, 20 x 10 cm), pressure of
# 10 bits, tilts of 8 bits; the second half of the first byte and 6 bits after the pressure are padding.
OWN = bytes.fromhex(
    "050d0902a1018507 0920a100 0942094409321500250175019503 8102 9505 8103"
    "a4 0501 6511 55fe 75109501 35004 6d007 150026 1027 0930 8102 46e803 0931 8102 b4".replace(
        "35004 6d007", "350046d007"
    ).replace(" ", "")
    + "0930150026ff03750a95018102 75069501 8103 093d093e15c4253c750895028102 c0c0".replace(" ", "")
)


def own_report(x: int, y: int, pressure: int, tilt: tuple[int, int] = (0, 0), flags: int = 0b101) -> bytes:
    """Of the tablet above; flags: tip, barrel, in range."""
    body = x.to_bytes(2, "little") + y.to_bytes(2, "little") + (pressure & 0x3FF).to_bytes(2, "little")
    return bytes([7, flags]) + body + bytes(one & 0xFF for one in tilt)


def real(name: str) -> bytes:
    return next(REAL.glob(f"*{name}*")).read_bytes()


def test_fields_of_a_descriptor_with_push_and_pop_and_signed_ranges() -> None:
    fields = {one.usage: one for one in parse(OWN)}
    x, tilt = fields[0x10030], fields[0xD003E]
    assert (x.report, x.offset, x.size, x.low, x.high) == (7, 8, 16, 0, 10000)
    assert x.metres == pytest.approx(0.20)
    assert fields[0x10031].metres == pytest.approx(0.10)
    assert fields[0xD0030].unit == 0, "the unit was of the place only"
    assert (tilt.offset, tilt.size, tilt.low, tilt.high, tilt.signed) == (64, 8, -60, 60, True)
    assert tilt.raw(bytes(8) + b"\xe2") == -30


def test_reports_of_a_described_pen() -> None:
    pen = decoder_of(OWN, 0x1234, 1)
    assert pen is not None
    assert pen.size_m == pytest.approx((0.20, 0.10))
    assert pen.fields == ["pressure", "altitude", "azimuth"]
    one = pen.report(own_report(2500, 7500, 512, (30, 0)))
    assert one is not None
    assert (one.x, one.y, one.near, one.contact) == (0.25, 0.75, True, True)
    assert one.pressure == pytest.approx(512 / 1023)
    assert (degrees(one.altitude), one.azimuth) == (pytest.approx(60.0), 0.0)
    hovering = pen.report(own_report(0, 0, 0, flags=0b110))
    assert hovering is not None
    assert (hovering.near, hovering.contact, hovering.buttons) == (True, False, 2)
    assert pen.report(bytes([9, 1, 2, 3])) is None, "another report"
    assert pen.report(b"\x07\x01") is None, "cut short"
    assert pen.report(b"") is None


def test_what_is_no_descriptor_is_refused() -> None:
    for body in (b"\x05", b"\xfe", b"\xb4", b"\xc0", b"\xfe\x03\x00", b"\x75\xff\x96\xff\xff\x81\x02"):
        if body[0] == 0xFE and len(body) == 3:
            assert parse(body) == []  # a long item, passed over
            continue
        with pytest.raises(DescriptorError):
            parse(body)


@given(st.binary(max_size=200))
@settings(max_examples=300)
def test_any_bytes_are_fields_or_a_descriptor_error(body: bytes) -> None:
    try:
        fields = parse(body)
    except DescriptorError:
        return
    pen = DescribedPen(fields)
    pen.report(bytes(64))


@given(st.binary(max_size=40))
def test_any_report_is_a_pen_on_its_tablet_or_nothing(data: bytes) -> None:
    for decoder in (decoder_of(OWN, 0, 0), IntuosPen(MODELS[0xB1]), BambooPen(MODELS[0xDE])):
        assert decoder is not None
        one = decoder.report(data)
        if one is not None:
            Pen.decode(one.sample("x", decoder.size_m, 0).encode())


@needs_devices
@pytest.mark.parametrize(
    ("name", "vendor", "product", "size", "fields"),
    [
        ("28BD-0905.0033", 0x28BD, 0x0905, (254.0, 158.75), ["pressure", "altitude", "azimuth"]),
        ("256C-006D", 0x256C, 0x006D, (160.0, 100.0), ["pressure"]),
        ("056A-0374", 0x056A, 0x0374, (152.0, 95.0), ["pressure"]),
        ("056A-00B1", 0x056A, 0x00B1, (203.2, 152.4), ["pressure", "altitude", "azimuth"]),
        ("056A-0027", 0x056A, 0x0027, (223.52, 139.7), ["pressure", "altitude", "azimuth"]),
        ("056A-0317", 0x056A, 0x0317, (325.12, 203.2), ["pressure", "altitude", "azimuth"]),
        ("056A-00DE", 0x056A, 0x00DE, (147.2, 92.0), ["pressure"]),
        ("056A-033C", 0x056A, 0x033C, (152.0, 95.0), ["pressure"]),
    ],
)
def test_real_tablets_are_known_by_their_descriptors(
    name: str, vendor: int, product: int, size: tuple[float, float], fields: list[str]
) -> None:
    pen = decoder_of(real(name), vendor, product)
    assert pen is not None
    assert pen.size_m is not None
    assert (1e3 * pen.size_m[0], 1e3 * pen.size_m[1]) == (
        pytest.approx(size[0], abs=0.1),
        pytest.approx(size[1], abs=0.1),
    )
    assert pen.fields == fields


@needs_devices
def test_the_mouse_of_a_tablet_is_no_pen() -> None:
    assert decoder_of(real("28BD-0905.0031"), 0x28BD, 0x0905) is None


@needs_devices
def test_reports_of_described_real_tablets() -> None:
    deco = decoder_of(real("28BD-0905.0033"), 0x28BD, 0x0905)
    assert deco is not None
    report = (
        bytes([2, 0b100001])
        + (25400).to_bytes(2, "little")
        + (7938).to_bytes(2, "little")
        + (4096).to_bytes(2, "little")
    )
    one = deco.report(report + bytes([0, (-30) & 0xFF]))
    assert one is not None
    assert (one.x, one.y) == (0.5, pytest.approx(0.25, abs=1e-4))
    assert (one.near, one.contact, one.pressure) == (True, True, pytest.approx(0.5, abs=1e-3))
    assert (degrees(one.altitude), degrees(one.azimuth)) == (pytest.approx(60.0), pytest.approx(270.0))

    huion = decoder_of(real("256C-006D"), 0x256C, 0x006D)
    assert huion is not None
    report = (
        bytes([8, 0b1000010]) + (8000).to_bytes(3, "little") + (20000).to_bytes(3, "little") + (0).to_bytes(2, "little")
    )
    one = huion.report(report)
    assert one is not None
    assert (one.x, one.y, one.near, one.contact, one.buttons) == (0.25, 1.0, True, False, 2)

    intuos = decoder_of(real("056A-0374"), 0x056A, 0x0374)
    assert intuos is not None
    report = (
        bytes([16, 0b1100001])
        + (3800).to_bytes(3, "little")
        + (4750).to_bytes(3, "little")
        + (4095).to_bytes(2, "little")
    )
    one = intuos.report(report + bytes(18))
    assert one is not None
    assert (one.x, one.y, one.pressure, one.near, one.contact) == (0.25, 0.5, 1.0, True, True)
    one = intuos.report(bytes([16]) + bytes(26))
    assert one is not None
    assert not one.near


def intuos_report(x: int, y: int, pressure: int, tilt: tuple[int, int], buttons: int = 0) -> bytes:
    """The layout of Intuos tablets, written the other way round: pressure of 11 bits, tilts in degrees."""
    a, b = tilt[0] + 64, tilt[1] + 64
    data = bytearray(10)
    data[0], data[1] = 0x02, 0xE0 | buttons | pressure & 1
    data[2:4], data[4:6] = (x >> 1).to_bytes(2, "big"), (y >> 1).to_bytes(2, "big")
    data[6] = pressure >> 3
    data[7] = (pressure >> 1 & 3) << 6 | a >> 1
    data[8] = (a & 1) << 7 | b
    data[9] = (x & 1) << 1 | y & 1
    return bytes(data)


@given(st.integers(0, 44704), st.integers(0, 27940), st.integers(0, 2047), st.integers(-63, 63), st.integers(-63, 63))
def test_intuos_reports_give_back_what_was_put_in(x: int, y: int, pressure: int, a: int, b: int) -> None:
    pen = IntuosPen(MODELS[0x27])
    one = pen.report(intuos_report(x, y, pressure, (a, b), buttons=4))
    assert one is not None
    assert (one.x, one.y, one.pressure) == (
        pytest.approx(x / 44704),
        pytest.approx(y / 27940),
        pytest.approx(pressure / 2047),
    )
    assert one.contact == (pressure > 10)
    assert one.buttons == 4
    assert tilts(one.altitude, one.azimuth) == (pytest.approx(radians(a)), pytest.approx(radians(b)))
    assert pen.report(bytes([2, 0x80, *bytes(8)])).near is False  # type: ignore[union-attr]


def test_an_intuos_tool_says_whether_it_is_a_rubber() -> None:
    pen = IntuosPen(MODELS[0xB1])
    for tool, rubber in ((0x823, False), (0x82A, True)):
        data = bytearray([2, 0xC2, tool >> 4, (tool & 0xF) << 4, 0, 0, 0, 0, 0, 0])
        assert pen.report(bytes(data)) is None
        one = pen.report(intuos_report(20320, 0, 400, (0, 0)))
        assert one is not None
        assert one.eraser is rubber


def test_a_bamboo_comes_near_touches_and_leaves() -> None:
    pen = BambooPen(MODELS[0xDE])
    place = (7360).to_bytes(2, "little") + (2300).to_bytes(2, "little")
    one = pen.report(bytes([2, 0xE1]) + place + (512).to_bytes(2, "little") + bytes([0]))
    assert one is not None
    assert (one.near, one.contact, one.x, one.y, one.pressure) == (True, True, 0.5, 0.25, pytest.approx(0.5, abs=1e-3))
    one = pen.report(bytes([2, 0x00]) + bytes(7))
    assert one is not None
    assert (one.near, one.contact) == (False, False)


@given(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5))
def test_tilt_and_altitude_are_the_same_thing(a: float, b: float) -> None:
    altitude, azimuth = spherical(a, b)
    assert 0.0 <= altitude <= pi / 2 + 1e-12
    assert tilts(altitude, azimuth) == (pytest.approx(a, abs=1e-6), pytest.approx(b, abs=1e-6))


def test_altitude_is_that_of_browsers() -> None:
    # Figures that a browser gives for tilts of (30, -20), (10, 5) and (20, -30) degrees.
    for a, b in ((30, -20), (10, 5), (20, -30)):
        altitude, azimuth = spherical(radians(a), radians(b))
        assert tan(altitude) == pytest.approx(1.0 / (tan(radians(a)) ** 2 + tan(radians(b)) ** 2) ** 0.5)
        assert tan(azimuth) == pytest.approx(tan(radians(b)) / tan(radians(a)))


class FakeHandle:
    """A device of hidapi: reports from a queue; an exception in it is raised."""

    def __init__(self, library: "FakeLibrary") -> None:
        self.library, self.sent = library, list[bytes]()
        self.reports: queue.Queue[bytes | OSError] = queue.Queue()

    def open_path(self, path: bytes) -> None:
        if not self.library.present:
            raise OSError("open failed")
        self.library.handles.append(self)

    def get_report_descriptor(self) -> list[int]:
        return list(OWN)

    def send_feature_report(self, data: bytes) -> int:
        self.sent.append(bytes(data))
        return len(data)

    def read(self, most: int, patience: int) -> list[int]:
        try:
            one = self.reports.get(timeout=patience / 1000)
        except queue.Empty:
            return []
        if isinstance(one, OSError):
            raise one
        return list(one)

    def close(self) -> None:
        pass


class FakeLibrary:
    """hidapi with one tablet that can be plugged."""

    def __init__(self, vendor: int = 0x28BD) -> None:
        self.present, self.vendor = True, vendor
        self.handles: list[FakeHandle] = []

    def enumerate(self) -> list[dict[str, Any]]:
        mouse = {"path": b"/dev/hidraw1", "vendor_id": 0x1234, "product_id": 1, "usage_page": 1, "usage": 2}
        tablet = {"path": b"/dev/hidraw3", "vendor_id": self.vendor, "product_id": 0x905, "usage_page": 13, "usage": 2,
                  "product_string": "Deco", "manufacturer_string": "XP"}  # fmt: skip
        return [mouse, tablet] if self.present else [mouse]

    def device(self) -> FakeHandle:
        return FakeHandle(self)


@pytest.fixture
def plugged(monkeypatch: pytest.MonkeyPatch) -> FakeLibrary:
    library = FakeLibrary()
    monkeypatch.setattr(hid_module, "library", lambda: library)
    return library


@pytest.fixture
def posted(monkeypatch: pytest.MonkeyPatch) -> "queue.Queue[Callable[[], None]]":
    """What the reading thread wants done in the node's loop."""
    waiting: queue.Queue[Callable[[], None]] = queue.Queue()
    monkeypatch.setattr(InputPen, "post", lambda node, callback: waiting.put(callback))
    return waiting


def test_reports_become_samples_and_an_unplugged_tablet_comes_back(
    plugged: FakeLibrary, posted: "queue.Queue[Callable[[], None]]"
) -> None:
    stage = MemoryStage()
    node = stage.add(InputPen, drivers=["hid"])
    (handle,) = plugged.handles
    handle.reports.put(own_report(5000, 5000, 1023))
    posted.get(timeout=60)()
    stage.poll()
    assert len(stage.received("pen")) == 1
    one = stage.last("pen")
    assert (one.device, one.size_m, one.x, one.y, one.pressure, one.contact, one.buttons) == (
        "hid-hidraw3", pytest.approx((0.2, 0.1)), 0.5, 0.5, 1.0, True, 1,
    )  # fmt: skip
    device = stage.last("device/hid_hidraw3")
    assert (device.connected, device.driver, device.note) == (True, "hid", "XP Deco")
    plugged.present = False
    handle.reports.put(OSError("read error"))
    posted.get(timeout=60)()
    stage.poll()
    assert not stage.last("device/hid_hidraw3").connected
    assert (stage.last("pen").in_range, stage.last("pen").contact) == (False, False)
    stage.advance(5.0)
    lines = [line.text for line in stage.received("log/input_pen") if line.level == "warning"]
    assert [line for line in lines if "unplugged" in line] == ["hid-hidraw3: gone (unplugged: read error)"]
    assert len([line for line in lines if "no pen tablet found" in line]) == 1
    plugged.present = True
    stage.advance(3.0)
    assert len(plugged.handles) == 2
    assert stage.last("device/hid_hidraw3").connected
    plugged.handles[1].reports.put(own_report(0, 0, 0, flags=0b100))
    posted.get(timeout=60)()
    stage.poll()
    assert stage.last("pen").in_range
    node.teardown()


def test_which_tablet_is_read_can_be_named(plugged: FakeLibrary) -> None:
    for wanted, found in (("28bd:0905", 1), ("/dev/hidraw3", 2), ("ffff:0001", 2)):
        stage = MemoryStage()
        node = stage.add(InputPen, drivers=["hid"], hid=wanted)
        assert len(plugged.handles) == found
        node.teardown()
    lines = [line.text for line in stage.received("log/input_pen")]
    assert any("no pen tablet is ffff:0001; give parameter hid" in line for line in lines)


def test_a_wacom_is_asked_for_whole_reports(monkeypatch: pytest.MonkeyPatch) -> None:
    library = FakeLibrary(vendor=0x056A)
    monkeypatch.setattr(hid_module, "library", lambda: library)
    stage = MemoryStage()
    node = stage.add(InputPen, drivers=["hid"])
    assert library.handles[0].sent == [bytes([2, 2])]
    node.teardown()
