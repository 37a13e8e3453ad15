"""`bunraku study`: the list, its own arguments, and one simulated user at the easiest pose."""

import json
from pathlib import Path

import numpy as np
import pytest

from bunraku.cli import main
from bunraku.cli.study import load, studies


def test_the_studies_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study"]) == 0
    listed = {line.split()[0] for line in capsys.readouterr().out.splitlines()}
    assert {"touch", "gait"} <= listed


def test_an_unknown_study_is_refused_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study", "tuch"]) == 2
    said = capsys.readouterr().err
    assert "did you mean 'touch'" in said
    assert said.count("\n") == 1
    assert main(["study", "touch", "--seeds", "0"]) == 2


def test_fitts_law_and_the_scatter_of_movements() -> None:
    load("touch", studies()["touch"])
    import sys

    motor = sys.modules["bunraku_study_touch.motor"]
    one = motor.Motor(drag_a=0.1, drag_b=0.2, width=0.1, noise=0.1, tremor=0.0, hidden=0.0)
    # log2(0.3 / 0.1 + 1) = 2 bits
    assert one.drag(0.3) == pytest.approx(0.5)
    rng = np.random.default_rng(1)
    ends = np.array([one.land(rng, np.array([0.5, 0.0])) for _ in range(4000)])
    assert ends.mean(axis=0) == pytest.approx([0.5, 0.0], abs=0.005)
    assert ends.std(axis=0) == pytest.approx([0.05, 0.05], rel=0.06)
    assert [motor.minimum_jerk(s) for s in (-1.0, 0.0, 0.5, 1.0, 2.0)] == [0.0, 0.0, 0.5, 1.0, 1.0]


def test_one_user_takes_the_easiest_pose_by_touch_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status = main(["study", "touch", "--seeds", "1", "--poses", "1", "--json", "-o", str(tmp_path)])
    runs = json.loads(capsys.readouterr().out)
    assert status == 0
    assert {run["tool"] for run in runs} == {"touch", "handles"}
    for run in runs:
        assert run["reached"]
        assert run["error"] < 0.10
        assert 1.0 < run["seconds"] < 60.0
        assert run["strokes"] >= 1
    assert {path.name for path in tmp_path.iterdir()} == {"table.md", "runs.json", "poses.png", "times.png"}
