"""Launch files: arguments from the signature, includes, groups, and what is refused."""

from pathlib import Path

import pytest

from bunraku.runtime import launch
from bunraku.runtime.launch import LaunchError, LaunchFile, group, node

HEAD = "from typing import Literal\nfrom bunraku.runtime.launch import NodeSpec, group, include, node\n"


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Write a launch file into the working folder and read it."""
    monkeypatch.chdir(tmp_path)

    def write(text: str, name: str = "play.py") -> LaunchFile:
        Path(name).write_text(HEAD + text)
        return LaunchFile.find(name)

    return write


TYPED = '''
def launch(
    source: Literal["web", "tuio"] = "web", record: bool = False, count: int = 1, size: float = 0.5,
    name: str = "a", figures: list[str] = ["alice"],
) -> list[NodeSpec]:
    """Play.

    More words.
    """
    return [node("x", params=dict(source=source, record=record, count=count, size=size, name=name, figures=figures))]
'''


def test_arguments_are_typed_by_the_signature(write):
    file = write(TYPED)
    assert file.doc == "Play."
    words = ["source:=tuio", "record:=yes", "count:=3", "size:=2", "name:=b:=c", "figures:=alice, bob"]
    params = file.specs(file.parse(words))[0].params
    assert params == {
        "source": "tuio",
        "record": True,
        "count": 3,
        "size": 2.0,
        "name": "b:=c",
        "figures": ["alice", "bob"],
    }
    assert isinstance(params["size"], float)
    assert file.specs({})[0].params["source"] == "web"


@pytest.mark.parametrize(
    ("word", "says"),
    [
        ("source:=wob", "play.py: source: 'wob' is none of web, tuio; did you mean web?"),
        ("record:=maybe", "play.py: record: 'maybe' is neither true nor false"),
        ("count:=1.5", "play.py: count: '1.5' is no whole number"),
        ("size:=nan", "play.py: size: nan is not finite"),
        ("size:=big", "play.py: size: 'big' is no number"),
        ("surce:=web", "play.py: surce: no such argument, did you mean 'source'?"),
        ("source=web", "play.py: 'source=web' is no argument; write name:=value"),
    ],
)
def test_a_wrong_argument_names_file_and_key(write, word, says):
    with pytest.raises(LaunchError) as error:
        write(TYPED).parse([word])
    assert error.value.faults[0].startswith(says)
    assert len(error.value.faults) == 1


def test_every_wrong_argument_has_its_line(write):
    with pytest.raises(LaunchError) as error:
        write(TYPED).parse(["count:=x", "size:=y"])
    assert len(error.value.faults) == 2


def test_an_argument_without_default_must_be_given(write):
    file = write("def launch(bag: str) -> list[NodeSpec]:\n    return []\n")
    with pytest.raises(LaunchError, match=r"play.py: bag: missing; give bag:=VALUE \(str\)"):
        file.specs({})
    assert file.specs({"bag": "x"}) == []


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("x = 1\n", "play.py: launch: missing"),
        ("def launch(a) -> list[NodeSpec]:\n    return []\n", "play.py: launch: a: needs a type"),
        (
            "def launch(a: dict[str, int] = {}) -> list[NodeSpec]:\n    return []\n",
            "play.py: launch: a: needs a type",
        ),
        ("def launch(*a: int) -> list[NodeSpec]:\n    return []\n", "play.py: launch: a: arguments are named"),
        ("def launch(a: int = 'x') -> list[NodeSpec]:\n    return []\n", "play.py: launch: a: default 'x' is not"),
        ("def launch(a: Missing) -> list[NodeSpec]:\n    return []\n", "play.py: line 3: NameError: name 'Missing'"),
        ("import not_there_at_all\n", "play.py: line 3: ModuleNotFoundError: No module named"),
        ("def launch(:\n", "play.py: line 3: SyntaxError"),
    ],
)
def test_a_file_that_cannot_be_read_is_refused_in_one_line(write, text, says):
    with pytest.raises(LaunchError) as error:
        write(text)
    assert str(error.value).startswith(says)
    assert "\n" not in str(error.value)


def test_an_error_in_the_function_names_its_line(write):
    file = write("def launch() -> list[NodeSpec]:\n    return [node('x', params={'a': 1 / 0})]\n")
    with pytest.raises(LaunchError, match=r"^play.py: line 4: ZeroDivisionError"):
        file.specs({})


def test_the_result_must_be_a_list_of_specs(write):
    with pytest.raises(LaunchError, match=r"play.py: launch: must return a list"):
        write("def launch() -> list[NodeSpec]:\n    return node('x')\n").specs({})


def test_include_passes_arguments_and_names_the_file_of_each_node(write):
    write("def launch(n: int = 1) -> list[NodeSpec]:\n    return [node(f'x{k}') for k in range(n)]\n", "inner.py")
    outer = write("def launch() -> list[NodeSpec]:\n    return [node('y'), *group('bob', include('inner.py', n=2))]\n")
    specs = outer.specs({})
    assert [(s.path, s.file) for s in specs] == [("y", "play.py"), ("bob/x0", "inner.py"), ("bob/x1", "inner.py")]


def test_an_included_path_counts_from_the_including_file(write, tmp_path, monkeypatch):
    (tmp_path / "deep").mkdir()
    write("def launch() -> list[NodeSpec]:\n    return [node('x')]\n", "deep/inner.py")
    write("def launch() -> list[NodeSpec]:\n    return include('inner.py')\n", "deep/outer.py")
    monkeypatch.chdir("/")
    assert LaunchFile.find(str(tmp_path / "deep" / "outer.py")).specs({})[0].kind == "x"


def test_a_wrong_argument_of_an_include_is_refused(write):
    write("def launch(n: int = 1) -> list[NodeSpec]:\n    return []\n", "inner.py")
    with pytest.raises(LaunchError, match=r"^inner.py: n: 'two' is not a whole number$"):
        write("def launch() -> list[NodeSpec]:\n    return include('inner.py', n='two')\n").specs({})
    with pytest.raises(LaunchError, match=r"^inner.py: nn: no such argument, did you mean 'n'\? \(has: n\)$"):
        write("def launch() -> list[NodeSpec]:\n    return include('inner.py', nn=1)\n").specs({})


def test_a_cycle_of_includes_is_refused_and_shown(write):
    write("def launch() -> list[NodeSpec]:\n    return include('b.py')\n", "a.py")
    write("def launch() -> list[NodeSpec]:\n    return include('a.py')\n", "b.py")
    with pytest.raises(LaunchError, match=r"^b.py: include: a cycle: a.py -> b.py -> a.py$"):
        LaunchFile.find("a.py").specs({})
    # and the next one is read afresh
    assert write("def launch() -> list[NodeSpec]:\n    return [node('x')]\n").specs({})[0].path == "x"


def test_an_unknown_launch_file_is_refused(write):
    with pytest.raises(LaunchError, match=r"gone.py: no such launch file"):
        LaunchFile.find("gone.py")
    with pytest.raises(LaunchError, match=r"tuch: no such launch file, did you mean 'touch'\?"):
        LaunchFile.find("tuch")


def test_groups_nest():
    specs = group("stage", group("alice", [node("x", ns="left"), node("y")]))
    assert [s.path for s in specs] == ["stage/alice/left/x", "stage/alice/y"]


def test_a_node_is_plain_data():
    spec = node("x", params={"a": 1}, env={"N": 2}, respawn=True)
    assert spec.as_dict()["env"] == {"N": "2"}
    assert spec.as_dict()["path"] == "x"
    assert launch.NodeSpec(**{k: v for k, v in spec.as_dict().items() if k != "path"}) == spec
