"""Kernels are compiled once, before a stack starts, and that is remembered."""

import os
import select
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from bunraku.cli import Problem, kernels

COUNTER, BROKEN = "launch_nodes:Counter", "launch_nodes:Broken"


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("BUNRAKU_JIT", "0")
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent.parent / "runtime"))
    return tmp_path / "cache"


@pytest.mark.stack
def test_a_node_is_run_for_a_moment_and_marked(cache, capsys):
    assert kernels.missing([COUNTER]) == [COUNTER]
    kernels.compile_missing([COUNTER])
    assert "compiling the kernels, once" in capsys.readouterr().err
    assert kernels.missing([COUNTER]) == []
    kernels.compile_missing([COUNTER])
    assert capsys.readouterr().err == ""


@pytest.mark.stack
def test_a_node_that_fails_is_told_and_not_marked():
    with pytest.raises(Problem, match=r"compiling the kernels failed: .*port 3333 is taken"):
        kernels.compile_missing([BROKEN])
    assert kernels.missing([BROKEN]) == [BROKEN]


def test_the_environment_can_forbid_it(monkeypatch):
    assert not kernels.compiling()
    monkeypatch.delenv("BUNRAKU_JIT")
    assert kernels.compiling()
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    assert not kernels.compiling()


WALK = """
from bunraku.cli import kernels
from bunraku.msgs import Jump, Locomotion, PathPoint, Step, Turn
from bunraku.runtime.memory import MemoryStage
from bunraku.runtime.plan import load

kernels.warm(NODE)
def compiled():
    return {path for name in ("figure", "motion", "blender") for path in kernels.folder(name).rglob("*.nbc")}
before = compiled()
assert before
stage = MemoryStage()
stage.add(load(NODE))
stage.advance(1.0)
path = [PathPoint(x=x, z=z, duck=x / 4) for x, z in ((0.0, 0.0), (2.0, 0.0), (2.0, 3.0), (0.0, 3.0))]
for command in (
    Locomotion(id=11, path=path, complete=True), Turn(id=12, heading=-2.0), Step(id=13, goal=(0.5, 0.0, 3.0)),
    Jump(id=14, height=0.3), Jump(id=15, goal=(0.5, 0.0, 3.5)), Locomotion(id=16, path=path[::-1], complete=True),
):
    stage.publish("command", command)
    stage.advance(5.0)
print(*sorted(path.name for path in compiled() - before))
"""


@pytest.mark.stack
def test_nothing_is_left_to_compile_while_the_figure_moves(monkeypatch):
    """Compiling in the middle of a performance would hold the figure still for seconds."""
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.setenv("BUNRAKU_JIT", "1")
    code = WALK.replace("NODE", repr("bunraku.nodes.blender.node:Blender"))
    assert subprocess.run([sys.executable, "-c", code], check=True, text=True, stdout=subprocess.PIPE).stdout == "\n"


@pytest.mark.stack
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_launch_that_ends_while_kernels_compile_takes_the_compiler_along(tmp_path, monkeypatch, start, number):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.delenv("BUNRAKU_JIT")
    monkeypatch.chdir(tmp_path)
    os.mkfifo("held")
    Path("slow.py").write_text(SLOW)
    Path("play.py").write_text(PLAY)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    one = start("launch", "play.py")
    with open("held") as held:
        compiler = int(held.readline())
        watched = os.pidfd_open(compiler)
        one.process.send_signal(number)
        assert select.select([watched], [], [], 30.0)[0], "the compiler outlived the launch"
    os.close(watched)
    assert one.end() == (-number if number == signal.SIGKILL else 130)
    assert "Traceback" not in one.text


SLOW = """
import os, time
from bunraku.runtime.node import Node

class Slow(Node):
    name = "slow"
    jit = True

    def setup(self):
        self.held = open("held", "w")
        print(os.getpid(), file=self.held, flush=True)
        time.sleep(1000)
"""
PLAY = """
from bunraku.runtime.launch import NodeSpec, node

def launch() -> list[NodeSpec]:
    return [node("slow:Slow", name="slow")]
"""
