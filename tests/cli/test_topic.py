"""`bunraku topic`, `node` and `param` on a stage where something flows."""

import json
import os
import signal
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bunraku.cli.listen import Window, share
from bunraku.msgs import Pose, Target
from bunraku.runtime import graph

stack = pytest.mark.stack
NS = 1_000_000_000
CAMERA = '{"position": [0, 1, 4], "rotation": [0, 0, 0, 1], "yfov": 0.8}'


def body(seq: int, stamp: int = 0, origin: int | None = None) -> bytes:
    return Target(seq=seq, stamp=stamp, origin=origin).encode()


def test_the_rate_is_of_the_window_alone():
    window = Window(seconds=2.0)
    for k in range(100):  # 10 a second
        window.add(k * NS // 10, body(k))
    start = 10 * NS
    for k in range(300):  # then 100 a second
        window.add(start + k * NS // 100, body(100 + k))
    told = window.hz()
    assert told["hz"] == pytest.approx(100.0, rel=0.01)
    assert told["total"] == 400
    assert told["lost"] == 0
    window.trim(start + 100 * NS)
    assert window.hz()["hz"] is None


def test_gaps_are_counted_by_seq_and_a_lower_one_is_a_restart():
    window = Window()
    for seq in (5, 6, 9, 10, 0, 1, 4):
        window.add(seq, body(seq))
    told = window.hz()
    assert (told["lost"], told["restarts"]) == (2 + 2, 1)


def test_a_body_that_is_none_is_counted_and_harms_nothing():
    window = Window()
    for data in (b"", b"\xc1", b"\x93\x01\x02\x03", b"\x81\xa3seq\xa1x", os.urandom(50)):
        window.add(NS, data)
    assert window.hz()["total"] == 5
    assert window.delay()["with_origin"] == 0


def test_delay_is_stamp_less_origin():
    window = Window()
    for k in range(100):
        window.add(k + 10_000_000, body(k, stamp=k + 8_000_000, origin=k + 5_000_000 if k % 2 else None))
    told = window.delay()
    assert (told["p50_ms"], told["p99_ms"], told["with_origin"]) == (3.0, 3.0, 50)
    assert told["travel_p50_ms"] == 2.0


def test_bandwidth_counts_from_the_beginning_until_the_window_is_full():
    window = Window(seconds=5.0)
    data = body(0)
    for k in range(10):
        window.add(k * NS // 10, data)
    told = window.bandwidth(1 * NS, 0)
    assert told["bytes_per_s"] == pytest.approx(10 * len(data))
    assert told["mean_bytes"] == len(data)


@given(st.lists(st.integers(0, 10**9), min_size=1), st.floats(0, 1))
def test_share_is_one_of_the_values(values, part):
    found = share(values, part)
    assert found in [value / 1e6 for value in values]
    assert share(values, 1.0) == max(values) / 1e6
    assert share([], part) is None


def test_plain_values_of_arrays_and_what_is_not_known(tmp_path):
    from bunraku.cli.plain import Plain

    pose = Pose(skeleton="x", root=[0.1, 0.95, 0.0], rotations=[[0, 0, 0, 1], [0.6, 0, 0, 0.8]])
    told = Plain(tmp_path, "alice/pose")(pose.encode())
    assert told["root"] == [0.1, 0.95, 0.0]
    assert told["rotations"] == [[0.0, 0.0, 0.0, 1.0], [0.6, 0.0, 0.0, 0.8]]
    assert Plain(tmp_path, "unheard")(pose.encode())["root"]["base64"]
    assert "invalid" in Plain(tmp_path, "pose")(b"\xc1")
    assert Plain(tmp_path, "pose")(b"\x81\xa4root\xc4\x02ab") == {"root": {"base64": "YWI="}}
    json.dumps(Plain(tmp_path, "pose")(b"\x81\xa1x\xcb\x7f\xf8\x00\x00\x00\x00\x00\x00"))


@pytest.mark.parametrize(
    ("topic", "text", "says"),
    [
        ("pose", "{", "pose: '{' is no JSON"),
        ("pose", "[]", "pose: a message is a JSON object"),
        ("nothing", "{}", "topic 'nothing' is none that has a type"),
        ("target", '{"yaw": "x"}', "target: Expected `float | null`"),
        ("target", '{"pelvis": [0, 1]}', "target: Expected `array` of length 3"),
        ("pose", '{"skeleton": "x", "root": [0, 0], "rotations": []}', "pose: 2 numbers do not make shape (3,)"),
        ("pose", '{"skeleton": "x", "root": ["a"], "rotations": []}', "pose: root: no array of numbers"),
        ("command", '{"kind": "fly", "id": 1}', "command: Invalid value 'fly'"),
        ("camera", '{"position": [0, 0, 0], "rotation": [0, 0, 0, 1]}', "camera: give either yfov or ortho_height"),
    ],
)
def test_pub_checks_the_message(topic, text, says, stage, bunraku):
    done = bunraku("topic", "pub", topic, text)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"bunraku topic: {says}")
    assert not stage.exists()


@stack
def test_pub_waits_for_a_subscriber_and_echo_hears_the_first(stage, start):
    pub = start("topic", "pub", "target", '{"yaw": 0.5, "pelvis": [0, 1, 0]}', "--rate", "100", "-n", "3")
    pub.wait_for("waiting for a subscriber of 'target'")
    echo = start("topic", "echo", "target", "-n", "3")
    assert echo.end() == 0
    assert pub.end() == 0
    told = [json.loads(line) for line in echo.lines if line.startswith("{")]
    assert [one["seq"] for one in told] == [0, 1, 2]
    assert all(one["yaw"] == 0.5 and one["pelvis"] == [0, 1, 0] and one["origin"] == one["stamp"] for one in told)
    assert not list(stage.parent.glob("t/*"))


@stack
def test_pub_reads_lines_and_a_latched_topic_comes_to_whoever_comes_later(stage, start):
    echo = start("topic", "echo", "camera", "-n", "1")
    pub = start("topic", "pub", "camera", CAMERA, "--rate", "1", "--no-wait")
    assert echo.end() == 0
    again = start("topic", "echo", "camera", "-n", "1")
    assert again.end() == 0
    pub.interrupt()
    assert pub.end() == 0


@stack
def test_pub_from_standard_input(stage, start, bunraku):
    echo = start("topic", "echo", "touch", "-n", "2")
    echo.wait_for("waiting for 'touch'")
    lines = '{"device": "a", "contacts": []}\n\n{"device": "b", "contacts": []}\n'
    assert bunraku("topic", "pub", "touch", "-", stdin=lines).returncode == 0
    assert echo.end() == 0
    assert [json.loads(line)["device"] for line in echo.lines[-2:]] == ["a", "b"]


@stack
def test_a_second_publisher_is_refused(stage, start, bunraku, until):
    pub = start("topic", "pub", "target", "{}", "--rate", "50", "--no-wait")
    until(lambda: graph.topics(stage))
    done = bunraku("topic", "pub", "target", "{}", "--no-wait")
    assert done.returncode == 1
    assert done.stderr.startswith("bunraku topic: topic 'target' is said by topic_pub already")
    assert len(done.stderr.splitlines()) == 1
    pub.process.send_signal(signal.SIGTERM)
    assert pub.end() == 0
    assert not stage.exists()


@stack
def test_hz_bw_and_delay_in_words_and_json(stage, start, bunraku, until):
    pub = start("topic", "pub", "target", '{"yaw": 1}', "--rate", "100", "--no-wait")
    until(lambda: graph.topics(stage))
    told = json.loads(bunraku("topic", "hz", "target", "-n", "1", "--json").stdout)
    assert told["topic"] == "target"
    assert told["total"] > 1
    assert told["lost"] == 0
    assert "Hz, interval" in bunraku("topic", "hz", "target", "-n", "1", "--every", "0.2").stdout
    assert "B a message" in bunraku("topic", "bw", "target", "-n", "1", "--every", "0.2").stdout
    assert "input -> target p50 0.00 ms" in bunraku("topic", "delay", "target", "-n", "1", "--every", "0.2").stdout
    hz = start("topic", "hz", "target")
    hz.wait_for("Hz")
    hz.interrupt()
    assert hz.end() == 0
    pub.interrupt()


def test_nothing_comes_in_time(stage, bunraku):
    done = bunraku("topic", "echo", "pose", "--timeout", "0.2")
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("bunraku topic: pose: nothing came in 0.2 s")


def test_an_empty_stage(stage, bunraku):
    for verb in ("topic", "node"):
        done = bunraku(verb, "list")
        assert (done.returncode, done.stdout) == (0, "")
        assert "on stage 't'" in done.stderr
        assert json.loads(bunraku(verb, "list", "--json").stdout) == []
    done = bunraku("node", "info", "controller")
    assert done.returncode == 2
    assert done.stderr == "bunraku node: node 'controller': not there (no node runs on stage 't')\n"
    done = bunraku("topic", "info", "pose")
    assert done.returncode == 2
    assert "nobody says or hears it" in done.stderr


@stack
def test_lists_and_parameters_of_running_nodes(stage, start, bunraku, until):
    node = start("run", "launch_nodes:Counter", "--name", "counter", "--ns", "alice", "--set", "gain:=2")
    until(lambda: graph.nodes(stage))
    rows = {row["topic"]: row for row in json.loads(bunraku("topic", "list", "--json").stdout)}
    assert rows["alice/heard"]["type"] == "Target"
    assert rows["alice/params/counter"]["latched"]
    assert "alice/heard" in bunraku("topic", "list").stdout
    shown = bunraku("topic", "info", "alice/target").stdout
    assert "said by: -" in shown
    assert "heard by: alice/counter" in shown
    told = json.loads(bunraku("topic", "info", "alice/heard", "--json").stdout)
    assert told["node"] == "alice/counter"
    assert Path(told["socket"]).is_socket()
    (row,) = json.loads(bunraku("node", "list", "--json").stdout)
    assert (row["name"], row["class"], row["hears"]) == ("alice/counter", "Counter", ["alice/target"])
    assert "alice/target" in bunraku("node", "info", "alice/counter").stdout
    assert bunraku("param", "get", "alice/counter", "gain").stdout == "2.0\n"
    assert bunraku("param", "set", "alice/counter", "gain", "3.5").stdout == "3.5\n"
    rows = {row["key"]: row for row in json.loads(bunraku("param", "list", "alice/counter", "--json").stdout)}
    assert (rows["gain"]["value"], rows["gain"]["high"], rows["gain"]["doc"]) == (3.5, 10.0, "factor")
    assert "fancy" in bunraku("param", "list").stdout
    for words, says in (
        (
            ("set", "alice/counter", "gain", "11"),
            "alice/counter: gain: 11.0 is above its most, 10.0\n",
        ),
        (("get", "alice/counter", "gian"), "alice/counter: no parameter 'gian', did you mean 'gain'?"),
        (
            ("get", "alice/conter", "gain"),
            "node 'alice/conter': not there, did you mean 'alice/counter'?",
        ),
    ):
        done = bunraku("param", *words)
        assert done.returncode == 2
        assert done.stderr.startswith(f"bunraku param: {says}")
    node.interrupt()
    assert node.end() == 0
    assert not stage.exists()


@stack
def test_a_frozen_node_does_not_hang_the_list(stage, start, bunraku, until):
    node = start("run", "launch_nodes:Counter", "--name", "counter")
    until(lambda: graph.nodes(stage))
    node.process.send_signal(signal.SIGSTOP)
    try:
        (row,) = json.loads(bunraku("node", "list", "--json").stdout)
        assert "did not answer" in row["error"]
        assert bunraku("node", "info", "counter").returncode == 1
    finally:
        node.process.send_signal(signal.SIGCONT)
    node.interrupt()
    assert node.end() == 0
