"""`bunraku launch` with real processes: what it prints, how it ends, and that nothing is left."""

import json
import os
import re
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

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


class Command:
    """A running `bunraku` whose lines one can wait for."""

    def __init__(self, *words: str, **env: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "bunraku.cli", *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            text=True,
            env={**os.environ, **env},
            start_new_session=True,
        )
        self.lines: list[str] = []
        self.news = threading.Condition()
        self.reader = threading.Thread(target=self._read, daemon=True)
        self.reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            with self.news:
                self.lines.append(line.rstrip("\n"))
                self.news.notify_all()

    @property
    def text(self) -> str:
        return "\n".join(self.lines)

    def wait_for(self, pattern: str, seconds: float = 60.0) -> re.Match[str]:
        with self.news:
            assert self.news.wait_for(lambda: re.search(pattern, self.text), seconds), self.text
        found = re.search(pattern, self.text)
        assert found is not None
        return found

    def end(self, seconds: float = 60.0) -> int:
        status = self.process.wait(seconds)
        self.reader.join(seconds)
        return status

    def interrupt(self) -> None:
        self.process.send_signal(signal.SIGINT)


@pytest.fixture
def stage(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty stage, the test nodes importable, and a launch file play.py in the working folder."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path_factory.mktemp("r")))
    monkeypatch.setenv("BUNRAKU_STAGE", "t")
    monkeypatch.setenv("PYTHONPATH", str(NODES))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "play.py").write_text(FILE)
    return Path(os.environ["XDG_RUNTIME_DIR"]) / "bunraku" / "t"


@pytest.fixture
def start() -> Iterator[Callable[..., Command]]:
    running: list[Command] = []

    def begin(*words: str, **env: str) -> Command:
        running.append(Command(*words, **env))
        return running[-1]

    yield begin
    for one in running:
        if one.process.poll() is None:
            one.process.kill()
        one.end()
        assert one.process.stdout is not None
        one.process.stdout.close()


def left(stage: Path) -> list[str]:
    return sorted(path.name for path in stage.glob("*"))


def pids(stage: Path) -> dict[str, int]:
    return {topic.node: topic.pid for topic in graph.topics(stage)}


def until(condition: Callable[[], Any], seconds: float = 60.0) -> Any:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if found := condition():
            return found
        time.sleep(0.02)
    raise AssertionError("it did not come")


def test_it_runs_to_its_end_and_nothing_is_left(stage, start):
    one = start("launch", "play.py")
    assert one.end() == 0
    assert re.search(r"^launch +\| play: 2 nodes up in [\d.]+ s on stage 't'; Ctrl-C ends$", one.text, re.M)
    # the source waited for the counter, so that its very first message was heard
    assert re.search(r"^counter +\| first is 1$", one.text, re.M), one.text
    assert "source is required: ending the others" in one.text
    assert not left(stage)
    assert "\x1b" not in one.text


def test_ctrl_c_ends_all(stage, start):
    one = start("launch", "play.py", "stay:=true")
    one.wait_for("2 nodes up")
    assert set(pids(stage)) == {"source", "counter"}
    one.interrupt()
    assert one.end() == 0
    assert not left(stage)


def test_kill_9_of_the_launcher_leaves_nothing(stage, start):
    one = start("launch", "play.py", "stay:=true")
    one.wait_for("2 nodes up")
    watched = [os.pidfd_open(pid) for pid in pids(stage).values()]
    assert len(watched) == 2
    one.process.kill()
    for number in watched:
        assert select.select([number], [], [], 30.0)[0], "a node outlived its launcher"
        os.close(number)
    assert not left(stage)


def test_kill_9_of_a_node_that_is_restarted(stage, start):
    one = start("launch", "play.py", "count:=100000", "respawn:=true")
    one.wait_for("first is 1")
    before = pids(stage)["counter"]
    os.kill(before, signal.SIGKILL)
    one.wait_for(r"counter +\| killed by SIGKILL; starting again in 0\.1 s \(1 of 5\)")
    one.wait_for(r"counter +\| took up from where it was")
    assert until(lambda: pids(stage).get("counter")) != before
    one.interrupt()
    assert one.end() == 0
    assert not left(stage)


def test_the_status_is_the_failing_node_s_and_its_last_lines_are_repeated(stage, start):
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
    assert not left(stage)


def test_kill_9_of_a_required_node_ends_the_stack(stage, start):
    one = start("launch", "play.py", "stay:=true")
    one.wait_for("2 nodes up")
    os.kill(pids(stage)["source"], signal.SIGKILL)
    assert one.end() == 128 + signal.SIGKILL
    assert not left(stage)


def test_a_second_launch_on_the_stage_is_refused(stage, start):
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
    assert set(pids(stage)) == {"source", "counter"}
    one.interrupt()
    assert one.end() == 0


def test_a_topic_that_another_process_says_is_refused(stage, start):
    pub = start("topic", "pub", "target", "{}", "--no-wait", "--rate", "5")
    until(lambda: pids(stage))
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
    assert not left(stage)


def test_what_a_dead_stack_left_is_swept(stage, start):
    one = start("launch", "play.py", "stay:=true")
    one.wait_for("2 nodes up")
    killed = list(pids(stage).values())
    one.process.send_signal(signal.SIGSTOP)
    for pid in killed:
        os.kill(pid, signal.SIGKILL)
    one.process.kill()
    one.end()
    assert until(lambda: not graph.topics(stage))
    assert left(stage)
    two = start("launch", "play.py")
    assert two.end() == 0
    assert "took up" not in two.text
    assert not left(stage)


def test_a_terminal_gets_colours(stage):
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


def bunraku(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "bunraku.cli", *words],
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        timeout=60,
    )


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
def test_it_is_refused_before_anything_starts(stage, change, words, says):
    Path("play.py").write_text(FILE.replace(*change) if change[0] else FILE)
    done = bunraku("launch", "play.py", *words)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"bunraku launch: {says}")
    assert not stage.exists()


def test_show_starts_nothing(stage):
    done = bunraku("launch", "play.py", "--show", "count:=3")
    assert done.returncode == 0
    assert re.search(
        r"^source +launch_nodes:Source +count=3 stay=false wait_for=1 +- +target +required$", done.stdout, re.M
    )
    shown = json.loads(bunraku("launch", "play.py", "--show", "--json").stdout)
    assert [one["path"] for one in shown] == ["source", "counter"]
    assert shown[1]["hears"] == ["target"]
    assert not stage.exists()


def test_the_arguments_are_listed(stage):
    rows = json.loads(bunraku("launch", "play.py", "--args", "--json").stdout)
    assert rows[0] == {"argument": "count", "type": "int", "default": 50}
    assert "respawn" in bunraku("launch", "play.py", "--args").stdout


def test_a_path_too_long_for_a_socket_is_refused(stage, monkeypatch, tmp_path):
    deep = tmp_path / ("x" * 90)
    deep.mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(deep))
    done = bunraku("launch", "play.py")
    assert done.returncode == 2
    assert re.match(r"bunraku launch: .*longer than 107 bytes: set XDG_RUNTIME_DIR", done.stderr)
    assert len(done.stderr.splitlines()) == 1
