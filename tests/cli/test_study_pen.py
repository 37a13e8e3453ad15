"""`bunraku study pen`: what its users see and how they move, and that they come to the goal by themselves."""

import json
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from bunraku.cli import main
from bunraku.cli.study import load, studies
from bunraku.figure.camera import Orbit, project
from bunraku.launch.course import VIEW
from bunraku.nodes.course.stages import stages


@pytest.fixture(scope="module")
def study() -> ModuleType:
    return load("pen", studies()["pen"])


def part(name: str) -> Any:
    return sys.modules[f"bunraku_study_pen.{name}"]


def test_the_ground_is_learnt_from_the_first_picture_only(study: ModuleType) -> None:
    sight = part("sight")
    view: dict[str, Any] = VIEW
    floor = sight.Floor.learnt(Orbit(**view).camera())
    # Later the picture has moved along the ground; distances and directions are still right.
    later = Orbit(center=(3.0, 0.9, 5.0), **view).camera()
    places = np.array([[3.0, 0.0, 5.0], [2.0, 0.0, 5.0], [3.0, 0.0, 8.0]])
    found = floor.at(project(later, places))
    # The picture looks along +Z: its right is -X, its ahead +Z.
    assert found[1] - found[0] == pytest.approx([1.0, 0.0], abs=1e-3)
    assert found[2] - found[0] == pytest.approx([0.0, 3.0], abs=1e-3)


def test_the_way_its_width_and_its_gaps(study: ModuleType) -> None:
    route_of = part("route").route_of
    way = route_of(stages()[0].tiles)
    assert way.end == pytest.approx(8.0)
    assert way.width(3.0) == pytest.approx(1.5, abs=0.01)
    assert way.gaps == ()
    assert way.turn(1.0, 2.0) == pytest.approx(0.0, abs=1e-6)
    islands = route_of(stages()[3].tiles)
    assert [gap.number for gap in islands.gaps] == [0, 1, 2, 3, 4]
    first = islands.gaps[0]
    # From 0.1 m, the start's middle: its edge 0.7 m ahead, less a foot; the first island's middle at 1.6 m.
    assert first.off == pytest.approx(0.7 - part("route").FOOT)
    assert first.on == pytest.approx(1.6, abs=0.03)
    corners = route_of(stages()[1].tiles)
    assert corners.turn(1.5, 1.5) > 60.0


def test_people_differ_and_are_the_same_with_either_device(study: ModuleType) -> None:
    person = part("person")
    a, b = person.someone(1), person.someone(2)
    assert a == person.someone(1)
    assert a.reaction != b.reaction
    many = [person.someone(seed).reaction for seed in range(400)]
    assert np.median(many) == pytest.approx(person.Person().reaction, rel=0.03)
    wander = person.Wander(np.random.default_rng(3), 2.0, 0.3)
    values = np.array([wander.step(1.0 / 60.0) for _ in range(60_000)])
    assert values.std() == pytest.approx(2.0, rel=0.06)
    assert np.corrcoef(values[:-18], values[18:])[0, 1] == pytest.approx(np.exp(-1.0), abs=0.05)


@pytest.mark.parametrize("device", ["pen", "pad"])
def test_a_user_finishes_the_first_stage(study: ModuleType, device: str) -> None:
    run = study.perform(device, 1, False, 3)
    assert run.reached
    assert 1.5 < run.seconds < 15.0
    assert run.hits == 0
    assert run.points == pytest.approx(run.seconds + 2.0 * run.outs)
    assert study.perform(device, 1, False, 3) == run, "the same user does the same"


def test_the_study_prints_a_row_a_stage(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study", "pen", "--seeds", "1", "--stage", "1", "--json", "-o", str(tmp_path)]) == 0
    runs = json.loads(capsys.readouterr().out)
    assert {(run["device"], run["obstacles"]) for run in runs} == {
        ("pen", False), ("pen", True), ("pad", False), ("pad", True)
    }  # fmt: skip
    assert all(run["reached"] for run in runs)
    text = (tmp_path / "table.md").read_text()
    assert "1 the straight, with obstacles" in text
    assert main(["study", "pen", "--seeds", "0"]) == 2


def test_a_signed_rank_test_compares_the_devices_in_the_same_hands(study: ModuleType) -> None:
    runs = [
        study.Run(device, 1, False, seed, True, 5.0 + seed * 0.1 + (device == "pad"), 0, 0, 5.0)
        for device in ("pen", "pad")
        for seed in range(10)
    ]
    assert study.differs(runs, "seconds") == pytest.approx(2.0 / 2**10), "all ten differences on one side: exact"
    assert study.differs(runs, "outs") == 1.0
