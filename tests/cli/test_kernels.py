"""Kernels are compiled once, before a stack starts, and that is remembered."""

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
