"""`bunraku launch` with real processes: what it prints, how it ends, and that nothing is left."""

import json
import os
import re
import select
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from bunraku.runtime import graph

pytestmark = pytest.mark.stack
NODES = Path(__file__).parent.parent / "runtime"
FILE = """
from typing import Literal
from bunraku.runtime.launch import NodeSpec, node, group, include

def launch(count: int = 50, stay: bool = False, required: bool = True, respawn: bool = False) -> list[NodeSpec]:
    \"\"\"Count.\"\"\"
    return [
        node("launch_nodes:Source", name="source", required=required, params={"count": count, "stay": stay}),
        node("launch_nodes:Counter", name="counter", respawn=respawn),
    ]
"""


@pytest.fixture
def play(stage: Path) -> Path:
    """A launch file play.py in the working folder."""
    Path("play.py").write_text(FILE)
    return stage


def left(stage: Path) -> list[str]:
    return sorted(path.name for path in stage.glob("*"))


def pids(stage: Path) -> dict[str, int]:
    return {topic.node: topic.pid for topic in graph.topics(stage)}


def test_it_runs_to_its_end_and_nothing_is_left(play, start):
    one = start("launch", "play.py")
    assert one.end() == 0
    assert re.search(r"^launch +\| play: 2 nodes up in [\d.]+ s on stage 't'; Ctrl-C ends$", one.text, re.M)
    # the source waited for the counter, so that its very first message was heard
    assert re.search(r"^counter +\| first is 1$", one.text, re.M), one.text
    assert "source is required: ending the others" in one.text
    assert not left(play)
    assert "\x1b" not in one.text


def test_ctrl_c_ends_all(play, start):
    one = start("launch", "play.py", "stay:=true")
    one.wait_for("2 nodes up")
    assert set(pids(play)) == {"source", "counter"}
    one.interrupt()
    assert one.end() == 0
    assert not left(play)


def test_kill_9_of_the_launcher_leaves_nothing(play, start):
    one = start("launch", "play.py", "stay:=true")
    one.wait_for("2 nodes up")
    watched = [os.pidfd_open(pid) for pid in pids(play).values()]
    assert len(watched) == 2
    one.process.kill()
    for number in watched:
        assert select.select([number], [], [], 30.0)[0], "a node outlived its launcher"
        os.close(number)
    assert not left(play)


def test_kill_9_of_a_node_that_is_restarted(play, start, until):
    one = start("launch", "play.py", "count:=100000", "respawn:=true")
    one.wait_for("first is 1")
    state = play / "counter.state"
    until(lambda: state.exists() and state.stat().st_size)
    before = pids(play)["counter"]
    os.kill(before, signal.SIGKILL)
    one.wait_for(r"counter +\| killed by SIGKILL; starting again in 0\.1 s \(1 of 5\)")
    one.wait_for(r"counter +\| took up from where it was")
    assert until(lambda: pids(play).get("counter")) != before
    one.interrupt()
    assert one.end() == 0
    assert not left(play)


def test_the_status_is_the_failing_node_s_and_its_last_lines_are_repeated(play, start):
    Path("broken.py").write_text(
        FILE.replace("required=required", "required=False").replace(
            'node("launch_nodes:Counter", name="counter", respawn=respawn)',
            'node("launch_nodes:Broken", name="broken", required=True)',
        )
    )
    one = start("launch", "broken.py", "stay:=true")
    assert one.end() == 1
    assert one.lines[-2].endswith("| broken ended with status 1; its last lines:")
    assert one.lines[-1] == "broken | error: port 3333 is taken: choose another with port:=N"
    assert not left(play)


def test_kill_9_of_a_required_node_ends_the_stack(play, start):
    one = start("launch", "play.py", "stay:=true")
    one.wait_for("2 nodes up")
    os.kill(pids(play)["source"], signal.SIGKILL)
    assert one.end() == 128 + signal.SIGKILL
    assert not left(play)


def test_a_second_launch_on_the_stage_is_refused(play, start):
    one = start("launch", "play.py", "stay:=true")
    one.wait_for("2 nodes up")
    two = start("launch", "play.py")
    assert two.end() == 2
    assert two.lines == [
        f"bunraku launch: stage 't' is played on by another launch (process {one.process.pid}): "
        "end that one, or add --stage NAME"
    ]
    three = start("launch", "play.py", "--stage", "other")
    assert three.end() == 0
    assert set(pids(play)) == {"source", "counter"}
    one.interrupt()
    assert one.end() == 0


def test_a_topic_that_another_process_says_is_refused(play, start, until):
    pub = start("topic", "pub", "target", "{}", "--no-wait", "--rate", "5")
    until(lambda: pids(play))
    one = start("launch", "play.py")
    assert one.end() == 2
    assert one.lines == [
        f"bunraku launch: play.py: source: topic: 'target' is said by topic_pub (process {pub.process.pid}) already; "
        "end that one, or add --without source or --stage NAME"
    ]
    two = start("launch", "play.py", "--without", "source")
    two.wait_for("first is")
    two.interrupt()
    assert two.end() == 0
    pub.interrupt()
    assert pub.end() == 0
    assert not left(play)


def test_what_a_dead_stack_left_is_swept(play, start, until):
    one = start("launch", "play.py", "stay:=true")
    one.wait_for("2 nodes up")
    killed = list(pids(play).values())
    one.process.send_signal(signal.SIGSTOP)
    for pid in killed:
        os.kill(pid, signal.SIGKILL)
    one.process.kill()
    one.end()
    assert until(lambda: not graph.topics(play))
    assert left(play)
    two = start("launch", "play.py")
    assert two.end() == 0
    assert "took up" not in two.text
    assert not left(play)


def test_a_terminal_gets_colours(play):
    script = f"{sys.executable} -m bunraku.cli launch play.py count:=1"
    shown = subprocess.run(
        ["script", "-qec", script, "/dev/null"], capture_output=True, text=True, stdin=subprocess.DEVNULL,
        env={**os.environ, "TERM": "xterm"}, timeout=60,
    )  # fmt: skip
    assert shown.returncode == 0
    assert "\x1b[" in shown.stdout
    plain = subprocess.run(
        ["script", "-qec", script, "/dev/null"], capture_output=True, text=True, stdin=subprocess.DEVNULL,
        env={**os.environ, "TERM": "xterm", "NO_COLOR": "1"}, timeout=60,
    )  # fmt: skip
    assert "\x1b[" not in plain.stdout


@pytest.mark.parametrize(
    ("change", "words", "says"),
    [
        (("launch_nodes:Counter", "controler"), [], "play.py: counter: node: no node 'controler'"),
        (('"count": count', '"count": 0'), [], "play.py: source: params.count: 0 is below its least, 1"),
        (('"count": count', '"coutn": count'), [], "play.py: source: params.coutn: no such parameter"),
        (("launch_nodes:Counter", "launch_nodes:Source"), [], "play.py: counter: topic: 'target' is said by source"),
        (
            ("    return [\n", "    return [*include('play.py'),\n"),
            [],
            "play.py: include: a cycle: play.py -> play.py",
        ),
        (("", ""), ["cuont:=1"], "play.py: cuont: no such argument, did you mean 'count'?"),
        (("", ""), ["--without", "nobody"], "no node 'nobody' in this launch"),
        (("", ""), ["--replay", "x.mcap"], "--replay BAG and --replace NODE go together"),
    ],
)
def test_it_is_refused_before_anything_starts(play, change, words, says, bunraku):
    Path("play.py").write_text(FILE.replace(*change) if change[0] else FILE)
    done = bunraku("launch", "play.py", *words)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"bunraku launch: {says}")
    assert not play.exists()


def test_show_starts_nothing(play, bunraku):
    done = bunraku("launch", "play.py", "--show", "count:=3")
    assert done.returncode == 0
    assert re.search(
        r"^source +launch_nodes:Source +count=3 stay=false wait_for=1 +- +target +required$", done.stdout, re.M
    )
    shown = json.loads(bunraku("launch", "play.py", "--show", "--json").stdout)
    assert [one["path"] for one in shown] == ["source", "counter"]
    assert shown[1]["hears"] == ["target"]
    assert not play.exists()


def test_the_arguments_are_listed(play, bunraku):
    rows = json.loads(bunraku("launch", "play.py", "--args", "--json").stdout)
    assert rows[0] == {"argument": "count", "type": "int", "default": 50}
    shown = bunraku("launch", "play.py", "--args").stdout
    assert shown.startswith("Count.\n")
    assert "respawn" in shown


def test_a_path_too_long_for_a_socket_is_refused(play, monkeypatch, tmp_path, bunraku):
    deep = tmp_path / ("x" * 90)
    deep.mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(deep))
    done = bunraku("launch", "play.py")
    assert done.returncode == 2
    assert re.match(r"bunraku launch: .*longer than 107 bytes: set XDG_RUNTIME_DIR", done.stderr)
    assert len(done.stderr.splitlines()) == 1
