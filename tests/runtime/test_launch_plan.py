"""Checks before anything starts, the wiring, and the words that start each node."""

import sys
from pathlib import Path

import pytest

from bunraku.runtime import plan
from bunraku.runtime.launch import LaunchError, NodeSpec, group
from bunraku.runtime.launch import names as launch_names
from bunraku.runtime.launch import node as ask
from bunraku.runtime.memory import MemoryStage

SOURCE, COUNTER, CHOOSER = (f"launch_nodes:{name}" for name in ("Source", "Counter", "Chooser"))


@pytest.fixture(autouse=True)
def _nodes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parent))


def source(**keys) -> NodeSpec:
    return ask(SOURCE, **{"name": "source", **keys})


def counter(**keys) -> NodeSpec:
    return ask(COUNTER, **{"name": "counter", **keys})


def faults(*specs: NodeSpec) -> tuple[str, ...]:
    with pytest.raises(LaunchError) as error:
        plan.check(specs)
    assert all("\n" not in fault for fault in error.value.faults)
    return error.value.faults


@pytest.mark.parametrize(
    ("spec", "says"),
    [
        (ask("recoder"), "launch: recoder: node: no node 'recoder', did you mean 'recorder'?"),
        (ask("gone:Node", name="x"), "launch: x: node: node 'gone:Node': gone:Node cannot be loaded"),
        (ask("json:dumps", name="x"), "launch: x: node: node 'json:dumps': json:dumps is no node class"),
        (source(params={"coutn": 1}), "launch: source: params.coutn: no such parameter, did you mean 'count'?"),
        (source(params={"count": 0}), "launch: source: params.count: 0 is below its least, 1"),
        (source(params={"count": "many"}), "launch: source: params.count: Expected `int`"),
        (counter(params={"gain": 11.0}), "launch: counter: params.gain: 11.0 is above its most, 10.0"),
        (counter(params={"gain": float("nan")}), "launch: counter: params.gain: nan is not a finite number"),
        (counter(params={"mode": "odd"}), "launch: counter: params.mode: 'odd' is none of plain, fancy"),
        (counter(remap={"tarjet": "x"}), "launch: counter: remap.tarjet: no such topic, did you mean 'target'?"),
        (counter(remap={"target": "A b"}), "launch: counter: remap.target: 'A b': use a-z"),
        (source(name="Big One"), "launch: Big One: name: 'Big One': use a-z"),
        (source(ns="a//b"), "launch: a//b/source: name: 'a//b/source': use a-z"),
    ],
)
def test_a_fault_names_node_and_key(spec, says):
    (fault,) = faults(spec)
    assert fault.startswith(says)


def test_every_fault_has_its_line():
    found = faults(source(params={"count": 0, "coutn": 1}), ask("nothing"))
    assert len(found) == 3


def test_the_file_is_named(tmp_path, monkeypatch):
    from bunraku.runtime.launch import LaunchFile

    monkeypatch.chdir(tmp_path)
    Path("play.py").write_text(
        "from bunraku.runtime.launch import NodeSpec, node\n"
        "def launch() -> list[NodeSpec]:\n    return [node('controler')]\n"
    )
    (fault,) = faults(*LaunchFile.find("play.py").specs({}))
    assert fault.startswith("play.py: controler: node: no node 'controler'")


def test_two_nodes_of_one_name_are_refused():
    (fault,) = faults(source(), source())
    assert fault.startswith("launch: source: name: two nodes have it")


def test_a_topic_that_two_nodes_say_is_refused():
    (fault,) = faults(source(), source(name="other"))
    assert fault == ("launch: other: topic: 'target' is said by source (launch) too; remap one or use a namespace")
    planned = plan.check([source(), source(name="other", remap={"target": "aim"}), *group("alice", [source()])])
    assert [one.outputs for one in planned] == [["target"], ["aim"], ["alice/target"]]


def test_wiring_counts_who_hears():
    planned = plan.check([source(), counter(), counter(name="second", remap={"heard": "heard2"}),
                          *group("alice", [source(), counter()])])  # fmt: skip
    counts = plan.wiring(planned)
    assert counts["source"] == {"target": 2}
    assert counts["alice/source"] == {"alice/target": 1}
    assert counts["counter"] == {}


def test_wiring_asks_a_node_that_chooses():
    chooser = ask(CHOOSER, name="chooser")
    assert plan.wiring(plan.check([source(), chooser]))["source"] == {}
    chooser = ask(CHOOSER, name="chooser", params={"topics": ["target"]})
    assert plan.wiring(plan.check([source(), chooser]))["source"] == {"target": 1}


def test_a_recorder_is_waited_for_only_where_it_records():
    def waits(**params):
        recorder = ask("recorder", params=params)
        return plan.wiring(plan.check([source(), recorder]))["source"].get("target", 0)

    assert waits(output="x.mcap") == 1
    assert waits(output="x.mcap", topics=["pose", "tar*"]) == 1
    assert waits(output="x.mcap", topics=["pose"]) == 0
    assert waits() == 0


def test_a_source_is_told_how_many_listen():
    told = {one.spec.path: one.params.get("wait_for")
            for one in plan.with_listeners(plan.check([source(), counter()]))}  # fmt: skip
    assert told == {"source": "1", "counter": None}
    (alone,) = plan.with_listeners(plan.check([source()]))
    assert alone.params["wait_for"] == "0"
    (given,) = plan.with_listeners(plan.check([source(params={"wait_for": "7"})]))
    assert given.params["wait_for"] == "7"


def test_expected_subscribers_come_with_the_environment(monkeypatch):
    monkeypatch.setenv(plan.SUBSCRIBERS, '{"target": 2}')
    assert (plan.expected_subscribers("target"), plan.expected_subscribers("pose")) == (2, 0)
    monkeypatch.setenv(plan.SUBSCRIBERS, "no json")
    assert plan.expected_subscribers("target") == 0
    monkeypatch.delenv(plan.SUBSCRIBERS)
    assert plan.expected_subscribers("target") == 0


def test_only_and_without():
    planned = plan.check([source(), counter(), *group("alice", [counter()])])
    assert [one.spec.path for one in plan.choose(planned, only=["counter"])] == ["counter", "alice/counter"]
    assert [one.spec.path for one in plan.choose(planned, without=["alice/counter"])] == ["source", "counter"]
    with pytest.raises(LaunchError, match=r"no node 'sorce' in this launch, did you mean 'source'\? \(has: source"):
        plan.choose(planned, without=["sorce"])


def test_a_recording_takes_a_nodes_place():
    planned = plan.check([source(respawn=True), counter()])
    replaced = plan.substitute(planned, "source", ["bag", "play", "x.mcap"], ["target"])
    assert plan.command(replaced[0]) == ["bag", "play", "x.mcap"]
    assert plan.wiring(replaced)["source"] == {"target": 1}
    assert replaced[0].spec.required
    assert not replaced[0].spec.respawn
    twins = plan.check([counter(), *group("alice", [counter()])])
    with pytest.raises(LaunchError, match="names 2 nodes: write counter or alice/counter"):
        plan.substitute(twins, "counter", [], [])


def test_the_words_that_start_a_node():
    (one,) = plan.check(group("alice", [counter(name="n", params={"gain": 2}, remap={"heard": "h"})]))
    words = ["run", COUNTER, "--name", "n", "--ns", "alice", "--set", "gain:=2.0", "--remap", "heard:=h"]
    assert plan.command(one) == words
    (task,) = plan.tasks([one], env={"BUNRAKU_STAGE": "t"})
    assert list(task.argv) == [sys.executable, "-m", "bunraku.cli", *words]
    assert task.env["BUNRAKU_JIT"] == "0"
    assert task.env["BUNRAKU_STAGE"] == "t"


@pytest.mark.parametrize("value", [True, 3, 0.1, "text", "12", ["a", "b"], []])
def test_a_value_survives_the_command_line(value):
    from bunraku.runtime.params import Param

    declared = Param(value, None, None, None, "")
    declared.__set_name__(type("Any", (), {"__annotations__": {}}), "x")
    assert declared.convert(plan.as_word(value)) == value


def test_every_node_of_the_table_loads():
    for name in plan.table():
        assert plan.load(name).name == name


def test_the_launch_file_in_the_documentation_can_be_launched(tmp_path, monkeypatch):
    from bunraku.runtime.launch import LaunchFile

    text = (Path(__file__).parents[2] / "docs" / "launch.md").read_text()
    (tmp_path / "show.py").write_text(text.split("```python\n")[1].split("```")[0])
    file = LaunchFile.find(str(tmp_path / "show.py"))
    planned = plan.check(file.specs(file.parse(["record:=x.mcap"])))
    assert {"alice/controller", "bob/controller", "recorder"} <= {one.spec.path for one in planned}


@pytest.mark.parametrize("name", launch_names())
def test_every_launch_file_passes_its_checks(name):
    from bunraku.runtime.launch import LaunchFile

    file = LaunchFile.find(name)
    assert file.doc
    assert plan.check(file.specs({}))


@pytest.mark.parametrize(
    ("kind", "params"),
    [
        ("input_touch", {"drivers": ["web"]}), ("input_pen", {"drivers": ["web"]}), ("input_pad", {"drivers": ["web"]}),
        ("input_hand", {"drivers": ["web"]}), ("web", {"port": 0, "figures": ["", "alice"]}), ("interpreter", {}),
        ("blender", {"skeleton": True}), ("blender", {}),
        ("renderer", {"figures": ["alice", "bob"], "window": "off"}), ("web", {"port": 0, "figures": ["alice"]}),
    ],
)  # fmt: skip
def test_the_graph_that_is_shown_is_the_one_that_runs(kind, params):
    (planned,) = plan.check([ask(kind, params=params)])
    stage = MemoryStage()
    running = stage.add(planned.node, **params)
    try:
        heard = {one.topic for one in running.subscriptions.values()}
        assert set(planned.hears) == heard
        assert set(planned.outputs) == {t for t in stage._owners if t.partition("/")[0] not in plan.OWN}
    finally:
        stage.remove(running)


def test_who_hears_the_page_is_counted_by_its_drivers():
    pen = ask("input_pen", params={"drivers": ["web", "script"]})
    planned = plan.check([pen, ask("input_hand", params={"drivers": ["script"]}), ask("web")])
    assert plan.wiring(planned)["web"]["web/events"] == 1
    assert [one.spec.path for one in planned if one.hears_topic("pose")] == ["web"]
