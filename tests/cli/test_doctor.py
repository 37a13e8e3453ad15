"""What the doctor finds on a machine that lacks something."""

import json
import os

import pytest

from bunraku.cli import doctor, main


def test_python():
    assert doctor.look_python((3, 11, 0)).state == "ok"
    old = doctor.look_python((3, 10, 9))
    assert old.state == "missing"
    assert old.mend


def test_packages():
    assert doctor.look_packages(["msgpack>=1", 'pytest-nowhere; extra == "test"']).state == "ok"
    lacking = doctor.look_packages(["msgpack>=1", "no-such-package-at-all>=3"])
    assert (lacking.state, lacking.mend) == ("missing", "pip install no-such-package-at-all")


def test_zeromq():
    assert doctor.look_zmq().state == "ok"
    assert doctor.look_zmq(lambda what: what != "curve").state == "note"
    assert doctor.look_zmq(lambda what: False).state == "missing"


def test_run_folder(tmp_path):
    assert doctor.look_run_folder(tmp_path / "bunraku" / "x").state in ("ok", "missing")
    short = doctor.look_run_folder(tmp_path.__class__("/tmp/bunraku-0/default"))
    assert short.state == "ok"
    long = doctor.look_run_folder(tmp_path / ("y" * 90))
    assert long.state == "missing"
    assert "XDG_RUNTIME_DIR" in long.mend


@pytest.mark.skipif(os.getuid() == 0, reason="root may write everywhere")
def test_a_run_folder_that_cannot_be_written(tmp_path):
    tmp_path.chmod(0o500)
    assert doctor.look_run_folder(tmp_path / "s").state == "missing"


def test_cache(tmp_path):
    assert doctor.look_cache(tmp_path / "deep" / "cache").state == "ok"
    (tmp_path / "file").write_text("")
    closed = doctor.look_cache(tmp_path / "file" / "cache")
    assert closed.state == "missing"
    assert "XDG_CACHE_HOME" in closed.mend


def test_opengl():
    def load(name: str) -> None:
        raise OSError(name)

    found = doctor.look_opengl(load)
    assert (found.state, found.mend) == ("note", doctor.OPENGL)
    assert doctor.look_opengl(lambda name: None).state == "ok"


def test_display(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert doctor.look_display().state == "note"
    monkeypatch.setenv("WAYLAND_DISPLAY", "wayland-0")
    assert doctor.look_display().state == "ok"


def test_devices(tmp_path):
    assert doctor.look_devices("x", [], "mend").state == "note"
    (tmp_path / "event0").write_text("")
    assert doctor.look_devices("x", [str(tmp_path / "event0")], "mend").state == "ok"
    closed = doctor.look_devices("x", [str(tmp_path / "event0"), str(tmp_path / "gone")], "mend")
    assert (closed.state, closed.mend) == ("note", "mend")


def test_the_exit_status_says_whether_something_is_missing(monkeypatch, capsys):
    monkeypatch.setenv("XDG_RUNTIME_DIR", "/tmp")
    monkeypatch.setenv("BUNRAKU_JIT", "0")
    assert main(["doctor"]) == 0
    assert "nothing is missing that bunraku needs" in capsys.readouterr().out
    monkeypatch.setattr(doctor, "look_zmq", lambda: doctor.Finding("zeromq", "missing", "gone", "mend it"))
    assert main(["doctor", "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert {"name": "zeromq", "state": "missing", "text": "gone", "mend": "mend it"} in found
    assert main(["doctor"]) == 1
    shown = capsys.readouterr().out
    assert "mend: mend it" in shown
    assert shown.endswith("1 missing\n")
