"""TUIO 1.1 datagrams to frames, on bundles that python-osc built, and over a real socket of this process."""

import random
import socket
from math import pi

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
from pythonosc.osc_message_builder import OscMessageBuilder

from bunraku.nodes.input_touch.frame import Frame
from bunraku.nodes.input_touch.node import InputTouch
from bunraku.nodes.input_touch.tuio import BadDatagram, TuioDecoder
from bunraku.runtime.memory import MemoryStage
from bunraku.runtime.node import ParamProblem

MS = 1_000_000


def bundle(
    profile: str,
    fseq: int,
    alive: list[int],
    sets: dict[int, tuple[float, ...]] | None = None,
    *,
    source: str | None = "table@127.0.0.1",
) -> bytes:
    """One datagram of a TUIO sender."""
    built = OscBundleBuilder(IMMEDIATELY)

    def say(*words: object) -> None:
        message = OscMessageBuilder(address=f"/tuio/{profile}")
        for word in words:
            message.add_arg(word)
        built.add_content(message.build())

    if source is not None:
        say("source", source)
    say("alive", *alive)
    for key, values in (sets or {}).items():
        say("set", key, *[float(one) for one in values])
    say("fseq", fseq)
    body: bytes = built.build().dgram
    return body


def cur(x: float, y: float) -> tuple[float, ...]:
    return (x, y, 0.0, 0.0, 0.0)


def blb(x: float, y: float, angle: float = 0.0, w: float = 0.02, h: float = 0.01) -> tuple[float, ...]:
    return (x, y, angle, w, h, w * h, 0.0, 0.0, 0.0, 0.0, 0.0)


class Line:
    """A decoder, and what a socket would do around it."""

    def __init__(self, size_m: tuple[float, float] | None = None) -> None:
        self.decoder = TuioDecoder(size_m)
        self.now = 1_000 * MS
        self.frames: list[Frame] = []

    def hear(self, *bodies: bytes, address: str = "127.0.0.1:5000") -> list[Frame]:
        """Datagrams that follow each other at once, then the wait is over."""
        self.now += 16 * MS
        said = []
        for body in bodies:
            said += self.decoder.datagram(body, address, self.now)
        said += self.decoder.flush(self.now)
        self.frames += said
        return said

    def places(self) -> dict[int, tuple[float, float]]:
        return {key: (round(one.x, 4), round(one.y, 4)) for key, one in self.frames[-1].live.items()}


def test_a_finger_comes_stays_unmoved_and_goes() -> None:
    line = Line()
    assert line.hear(bundle("2Dcur", -1, [], source=None)) == []  # the reference server's opening bundles
    line.hear(bundle("2Dcur", 1, [4], {4: cur(0.25, 0.5)}))
    assert line.places() == {4: (0.25, 0.5)}
    assert line.frames[-1].device == "tuio-table@127.0.0.1"
    line.hear(bundle("2Dcur", 2, [4]))  # alive only: where it was
    assert line.places() == {4: (0.25, 0.5)}
    line.hear(bundle("2Dcur", 3, [4, 5], {5: cur(0.1, 0.1)}))
    assert line.places() == {4: (0.25, 0.5), 5: (0.1, 0.1)}
    line.hear(bundle("2Dcur", 4, [5]))
    assert line.places() == {5: (0.1, 0.1)}
    assert [one.origin is not None for one in line.frames] == [True] * 4


def test_a_frame_in_several_bundles_is_one_frame() -> None:
    line = Line()
    alive = list(range(10))
    parts = [
        bundle("2Dcur", 7, alive, {k: cur(0.05 * k, 0.5) for k in some}) for some in (range(4), range(4, 8), (8, 9))
    ]
    said = line.hear(*parts)
    assert len(said) == 1
    assert sorted(said[0].live) == alive


def test_a_frame_closes_without_waiting_when_all_was_told() -> None:
    line = Line()
    said = line.decoder.datagram(bundle("2Dcur", 1, [0], {0: cur(0.5, 0.5)}), "a", line.now)
    assert len(said) == 1
    assert not line.decoder.waiting()


def test_both_profiles_of_a_frame_are_one_message_and_one_finger() -> None:
    line = Line(size_m=(0.5, 0.3))
    line.hear(bundle("2Dcur", 1, [3], {3: cur(0.4, 0.6)}), bundle("2Dblb", 1, [3], {3: blb(0.4, 0.6, 0.3)}))
    assert line.places() == {3: (0.4, 0.6)}
    line.hear(bundle("2Dcur", 2, [3], {3: cur(0.5, 0.6)}), bundle("2Dblb", 2, [3], {3: blb(0.5, 0.6, 0.3)}))
    said = line.hear(bundle("2Dcur", 3, [3], {3: cur(0.5, 0.7)}), bundle("2Dblb", 3, [3], {3: blb(0.5, 0.7, 0.3)}))
    assert len(said) == 1
    finger = said[0].live[3]
    assert (finger.major, finger.minor, finger.angle) == (
        pytest.approx(0.01, abs=1e-6),
        pytest.approx(0.003, abs=1e-6),
        pytest.approx(0.3, abs=1e-6),
    )
    # The cursor goes, the blob stays: the finger is still there under its id.
    line.hear(bundle("2Dcur", 4, []), bundle("2Dblb", 4, [3]))
    assert line.places() == {3: (0.5, 0.7)}


def test_one_id_in_two_places_is_two_fingers() -> None:
    line = Line()
    line.hear(bundle("2Dcur", 1, [0], {0: cur(0.1, 0.1)}), bundle("2Dblb", 1, [0], {0: blb(0.9, 0.9)}))
    assert sorted(line.places().values()) == [(0.1, 0.1), (0.9, 0.9)]
    ids = set(line.places())
    line.hear(bundle("2Dcur", 2, [0]), bundle("2Dblb", 2, [0]))
    assert set(line.places()) == ids


def test_different_ids_in_one_place_are_one_finger() -> None:
    line = Line()
    line.hear(bundle("2Dcur", 1, [10], {10: cur(0.3, 0.3)}), bundle("2Dblb", 1, [11], {11: blb(0.3001, 0.3)}))
    assert len(line.places()) == 1


def test_an_upright_ellipse_has_its_long_axis_along_y() -> None:
    line = Line(size_m=(1.0, 1.0))
    line.hear(bundle("2Dblb", 1, [0], {0: blb(0.5, 0.5, 0.1, 0.01, 0.02)}))
    one = line.frames[-1].live[0]
    assert (one.major, one.minor) == (pytest.approx(0.02), pytest.approx(0.01))
    assert one.angle == pytest.approx(0.1 - pi / 2)
    unknown = Line()
    unknown.hear(bundle("2Dblb", 1, [0], {0: blb(0.5, 0.5)}))
    assert unknown.frames[-1].live[0].major is None


def test_late_datagrams_are_dropped_and_a_sender_that_begins_anew_is_not() -> None:
    line = Line()
    line.hear(bundle("2Dcur", 50, [0], {0: cur(0.5, 0.5)}))
    assert line.hear(bundle("2Dcur", 48, [0], {0: cur(0.1, 0.1)})) == []
    assert line.decoder.late == 1
    line.hear(bundle("2Dcur", 500, [0], {0: cur(0.6, 0.5)}))
    line.hear(bundle("2Dcur", 1, [0], {0: cur(0.7, 0.5)}))  # more than 100 lower
    assert line.places() == {0: (0.7, 0.5)}
    line.hear(bundle("2Dcur", -1, [0], {0: cur(0.8, 0.5)}))  # a frame without a number
    assert line.places() == {0: (0.8, 0.5)}
    line.hear(bundle("2Dcur", 2, [0], {0: cur(0.9, 0.5)}))
    assert line.places() == {0: (0.9, 0.5)}


def test_lost_datagrams_heal() -> None:
    line = Line()
    line.hear(bundle("2Dcur", 1, [0], {0: cur(0.1, 0.1)}))
    # The frame that put 1 down is lost: nothing is known of its place until it moves.
    line.hear(bundle("2Dcur", 3, [0, 1]))
    assert line.places() == {0: (0.1, 0.1)}
    line.hear(bundle("2Dcur", 4, [0, 1], {1: cur(0.7, 0.7)}))
    assert line.places() == {0: (0.1, 0.1), 1: (0.7, 0.7)}
    # The frame that lifted 0 is lost as well: the next alive list tells.
    line.hear(bundle("2Dcur", 6, [1]))
    assert line.places() == {1: (0.7, 0.7)}
    # A set of one that is not alive is not believed.
    line.hear(bundle("2Dcur", 7, [1], {0: cur(0.2, 0.2)}))
    assert line.places() == {1: (0.7, 0.7)}


def test_two_senders_are_two_devices_and_one_falls_silent() -> None:
    line = Line()
    line.hear(bundle("2Dcur", 1, [0], {0: cur(0.1, 0.1)}, source="a@h"), address="127.0.0.1:1")
    line.hear(bundle("2Dcur", 90, [0], {0: cur(0.9, 0.9)}, source="b@h"), address="127.0.0.1:2")
    line.hear(bundle("2Dcur", 2, [0], {0: cur(0.2, 0.1)}, source=None), address="127.0.0.1:1")
    assert [one.device for one in line.frames] == ["tuio-a@h", "tuio-b@h", "tuio-a@h"]
    assert line.places() == {0: (0.2, 0.1)}
    assert line.decoder.silent(line.now - 10 * MS) == ["tuio-b@h"]


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"#bundle",
        b"\x00" * 64,
        b"/tuio/2Dcur\x00",
        bundle("2Dcur", 1, [0], {0: (float("nan"), 0.5, 0.0, 0.0, 0.0)}),
        bundle("2Dcur", 1, [0], {0: (0.5, 0.5)}),
        bundle("2Dblb", 1, [0], {0: cur(0.5, 0.5)}),
    ],
)
def test_garbage_is_refused_and_nothing_else(body: bytes) -> None:
    with pytest.raises(BadDatagram):
        TuioDecoder().datagram(body, "a", 0)


@given(st.binary(max_size=200), st.integers(0, 180), st.booleans())
def test_no_bytes_can_do_more_than_be_refused(junk: bytes, cut: int, prefix: bool) -> None:
    good = bundle("2Dcur", 3, [0, 1], {0: cur(0.5, 0.5), 1: cur(0.1, 0.2)})
    line = Line()
    try:
        line.hear(good[:cut] + junk if prefix else junk)
    except BadDatagram:
        return
    for frame in line.frames:
        assert len(frame.live) <= 128


@given(st.randoms(use_true_random=False), st.integers(0, 40))
def test_after_loss_and_disorder_the_next_whole_frame_is_the_truth(rng: random.Random, frames: int) -> None:
    line = Line()
    bodies = []
    for number in range(frames):
        alive = sorted(rng.sample(range(12), rng.randint(0, 10)))
        bodies.append(bundle("2Dcur", number, alive, {k: cur(rng.random(), rng.random()) for k in alive}))
    for k in range(len(bodies) - 1):
        if rng.random() < 0.3:
            bodies[k], bodies[k + 1] = bodies[k + 1], bodies[k]
    for body in bodies:
        if rng.random() > 0.2:
            line.hear(body)
    line.hear(bundle("2Dcur", frames + 1, [2, 9], {2: cur(0.5, 0.5), 9: cur(0.25, 0.75)}))
    assert line.places() == {2: (0.5, 0.5), 9: (0.25, 0.75)}


def test_the_driver_on_a_real_socket_and_its_log() -> None:
    stage = MemoryStage()
    node = stage.add(InputTouch, drivers=["tuio"], port=0, size_m=[0.5, 0.3], lost=0.5)
    port = node.running[0].port  # type: ignore[attr-defined]
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    for number in range(3):
        sender.sendto(bundle("2Dcur", number, [1], {1: cur(0.1 * number, 0.5)}), ("127.0.0.1", port))
        stage.poll(2.0)
    phases = [[one.phase for one in message.contacts] for message in stage.received("touch")]
    assert phases == [["down"], ["move"], ["move"]]
    assert stage.last("touch").size_m == (0.5, 0.3)
    for _ in range(50):
        sender.sendto(b"junk", ("127.0.0.1", port))
    stage.poll(2.0)
    stage.advance(1.5)
    warnings = [one.text for one in stage.received("log/input_touch") if one.level == "warning"]
    assert sum("unreadable" in text for text in warnings) == 1
    # Half a second of silence: the sender is gone and its finger with it.
    assert [one.phase for one in stage.last("touch").contacts] == ["cancel"]
    assert not stage.last("device/tuio_table_127_0_0_1").connected
    sender.sendto(bundle("2Dcur", 9, [1], {1: cur(0.3, 0.5)}), ("127.0.0.1", port))
    stage.poll(2.0)
    assert stage.last("device/tuio_table_127_0_0_1").connected
    with pytest.raises(ParamProblem, match="another with parameter port"):
        MemoryStage().add(InputTouch, drivers=["tuio"], port=port)
    stage.remove(node)
    sender.close()


def test_faults_of_the_driver_s_parameters_are_named() -> None:
    with pytest.raises(ParamProblem, match="no IP address"):
        MemoryStage().add(InputTouch, drivers=["tuio"], host="tablet")
    with pytest.raises(ParamProblem, match="size_m"):
        MemoryStage().add(InputTouch, drivers=["tuio"], port=0, size_m=[0.5])
