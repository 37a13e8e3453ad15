"""The frame of the command line: help, errors in one line, exit statuses, and that nothing heavy is imported."""

import ast
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

import bunraku.cli
from bunraku import __version__
from bunraku.cli import main, verbs

HEAVY = ("numpy", "scipy", "msgspec", "zmq", "numba", "msgpack", "mcap")


def test_help_lists_every_verb(capsys):
    assert main(["--help"]) == 0
    shown = capsys.readouterr().out
    for verb, line in verbs().items():
        assert re.search(rf"^  {verb} +{re.escape(line)}$", shown, re.M)


def test_without_a_verb_it_is_bad_usage(capsys):
    assert main([]) == 2
    assert "usage: bunraku VERB" in capsys.readouterr().err


def test_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"bunraku {__version__}\n"


def test_an_unknown_verb_proposes_the_nearest(capsys):
    assert main(["lanch"]) == 2
    assert capsys.readouterr().err == "bunraku: unknown verb 'lanch', did you mean 'launch'?; see bunraku --help\n"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["topic"], "bunraku topic: the following arguments are required: WHAT; see bunraku topic --help"),
        (["topic", "lst"], "bunraku topic: unknown 'lst', did you mean 'list'? (there is: list, info, echo"),
        (["topic", "hz"], "bunraku topic hz: the following arguments are required: TOPIC; see"),
        (
            ["topic", "hz", "pose", "--window", "-1"],
            "bunraku topic hz: argument --window: invalid seconds value: '-1'",
        ),
        (["topic", "echo", "Pose!"], "bunraku topic: topic name 'Pose!': use a-z"),
        (["topic", "list", "--stage", "a/b"], "bunraku topic: stage name 'a/b': use letters"),
        (["run"], "bunraku run: name a NODE; bunraku run --list shows all"),
        (["run", "controler"], "bunraku run: no node 'controler', did you mean 'controller'?"),
        (["run", "recorder", "--set", "x"], "bunraku run: --set 'x': write name:=value"),
        (["launch"], "bunraku launch: name a launch file; bunraku launch --list shows all"),
        (["launch", "gone.py"], "bunraku launch: gone.py: no such launch file"),
        (["figure", "-o", "x.obj"], "bunraku figure: x.obj: end the name in .bvh"),
        (["figure", "--odd"], "bunraku figure: unrecognized arguments: --odd"),
    ],
)
def test_bad_usage_is_one_line(words, says, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("BUNRAKU_JIT", "0")
    assert main(words) == 2
    err = capsys.readouterr().err
    assert err.startswith(says)
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("error", "status", "says"),
    [
        (ValueError("a: wrong"), 2, "bunraku keys: a: wrong\n"),
        (OSError(28, "No space left on device"), 1, "bunraku keys: [Errno 28] No space left on device\n"),
        (FileNotFoundError(2, "No such file", "x.bag"), 2, "bunraku keys: x.bag: no such file; check the path\n"),
        (bunraku.cli.Problem("one\ntwo"), 1, "bunraku keys: one\nbunraku keys: two\n"),
        (KeyboardInterrupt(), 130, ""),
    ],
)
def test_what_a_verb_raises_becomes_a_line_and_a_status(monkeypatch, capsys, error, status, says):
    import bunraku.cli.keys

    def fail(args):
        raise error

    monkeypatch.setattr(bunraku.cli.keys, "run", fail)
    assert main(["keys", "x"]) == status
    assert capsys.readouterr().err == says


def test_a_reader_that_leaves_is_no_traceback():
    command = f"{sys.executable} -m bunraku.cli figure --json | true"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=60)
    assert done.stderr == ""


def _imports_for(*words: str) -> set[str]:
    code = (
        "import sys, io\nfrom bunraku.cli import main\nsys.stdout = io.StringIO()\n"
        f"try:\n    main({list(words)!r})\nexcept SystemExit:\n    pass\n"
        "print(' '.join(m for m in sys.modules if '.' not in m), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    return set(done.stderr.split())


@pytest.mark.parametrize("verb", ["", *verbs()])
def test_help_imports_nothing_heavy(verb):
    loaded = _imports_for(*([verb] if verb else []), "--help")
    assert "argparse" in loaded
    assert not loaded & set(HEAVY)


def test_every_verb_has_a_module_with_add_and_run():
    folder = Path(bunraku.cli.__file__).parent
    for verb in verbs():
        tree = ast.parse((folder / f"{verb}.py").read_text())
        functions = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
        assert {"add", "run"} <= functions, verb


def test_run_lists_the_parameters_of_a_node(capsys, monkeypatch):
    monkeypatch.setenv("BUNRAKU_JIT", "0")
    assert main(["run", "recorder", "--params", "--json"]) == 0
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)}
    assert rows["compression"]["choices"] == ["zstd", "lz4", "none"]


def test_figure_as_json_and_as_bvh(tmp_path, capsys):
    assert main(["figure", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert len(told["joints"]) == 21
    assert told["joints"][0]["role"] == "hips"
    assert sum(joint["mass"] for joint in told["joints"]) == pytest.approx(told["mass"], abs=1e-3)
    path = tmp_path / "rest.bvh"
    assert main(["figure", "-o", str(path)]) == 0
    from bunraku.figure.default import default_figure
    from bunraku.motion.bvh import read_bvh

    clip, figure = read_bvh(path), default_figure()
    places = dict(zip(clip.skeleton.names, clip.world[0][0], strict=True))  # written depth first
    assert set(places) == set(figure.names)
    for name, place in zip(figure.names, figure.rest_positions, strict=True):
        assert places[name] == pytest.approx(place, abs=1e-4)
    assert main(["figure", "-o", str(tmp_path / "rest.glb")]) == 0
    assert (tmp_path / "rest.glb").read_bytes()[:4] == b"glTF"
    assert main(["figure", "-o", str(tmp_path / "no" / "x.bvh")]) == 2


def test_keys_are_written_once_and_for_the_owner(tmp_path, capsys):
    folder = tmp_path / "keys"
    assert main(["keys", str(folder), "--json"]) == 0
    files = [Path(name) for name in json.loads(capsys.readouterr().out)["files"]]
    assert {path.name for path in files} == {"listen.key", "listen.key_secret", "connect.key", "connect.key_secret"}
    assert all(path.stat().st_mode & 0o777 == 0o600 for path in files)
    assert main(["keys", str(folder)]) == 2
    assert "is there already" in capsys.readouterr().err
    assert main(["keys", str(folder), "--name", "bob"]) == 0
    assert (folder / "bob.key_secret").exists()
    assert main(["keys", str(folder / "listen.key")]) != 0
