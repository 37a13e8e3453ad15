"""`bunraku study`: the list, its own arguments, and one simulated user at the easiest pose."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bunraku.cli import main
from bunraku.cli.study import load, studies
from bunraku.figure.camera import Orbit
from bunraku.figure.default import default_figure
from bunraku.figure.fk import fk


def test_the_studies_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study"]) == 0
    listed = {line.split()[0] for line in capsys.readouterr().out.splitlines()}
    assert {"touch", "gait"} <= listed


@pytest.mark.parametrize("name", studies())
def test_every_study_can_be_asked_what_it_takes(name: str) -> None:
    asked = [sys.executable, "-m", "bunraku.cli", "study", name, "--help"]
    done = subprocess.run(asked, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert f"bunraku study {name}" in done.stdout


def test_an_unknown_study_is_refused_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study", "tuch"]) == 2
    said = capsys.readouterr().err
    assert "did you mean 'touch'" in said
    assert said.count("\n") == 1
    assert main(["study", "touch", "--seeds", "0"]) == 2


def test_fitts_law_and_the_scatter_of_movements() -> None:
    load("touch", studies()["touch"])
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
    assert {path.name for path in tmp_path.iterdir()} == {
        "table.md", "runs.json", "poses.png", "reached.png", "times.png",
    }  # fmt: skip


def test_users_see_no_depth_but_foreshortening_headings_and_leans() -> None:
    load("touch", studies()["touch"])
    import importlib

    sight = importlib.import_module("bunraku_study_touch.sight").Sight
    figure = default_figure()
    camera = Orbit(azimuth=0.3, elevation=0.1).camera()
    standing = figure.rest_positions
    eye = np.array(camera.position)
    farther = eye + (standing - eye) * np.linspace(0.7, 1.4, len(standing))[:, None]  # each along its own ray
    look = sight.at(figure, camera, standing, farther)
    assert look.goal == pytest.approx(look.now, abs=1e-9)
    assert (look.azimuth, look.elevation) == pytest.approx((0.3, 0.1))
    scale = 0.1  # picture heights a metre: every arm in a T-pose is longer than that on the picture
    assert not look.deep(scale)
    assert sight.at(figure, Orbit(azimuth=1.5, elevation=0.0).camera(), standing, standing).deep(1.0 / 2.73)
    # A figure turned by 0.5 rad to its left, seen from the front; its neck 0.1 m to the picture's right of its hips.
    front = Orbit(azimuth=0.0, elevation=0.1).camera()
    c, s = np.cos(0.5), np.sin(0.5)
    turned = standing @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
    leant = turned + np.outer(np.arange(len(standing)) == figure.role("neck"), [0.1, 0.0, 0.0])
    look = sight.at(figure, front, standing, leant)
    assert look.heading(look.goal, look.hips()) == pytest.approx(0.5, abs=0.04)
    assert look.wrong("trunk") == pytest.approx(0.1 / 2.73, rel=0.05)
    assert look.wrong("pelvis") < 1e-9


def test_an_editor_s_user_takes_a_turned_pose() -> None:
    load("touch", studies()["touch"])
    import importlib

    poses, editor, motor = (
        importlib.import_module(f"bunraku_study_touch.{name}") for name in ("poses", "editor", "motor")
    )
    target = poses.ghost(next(goal for goal in poses.GOALS if goal.yaw))
    user = editor.EditorUser(target, motor.POINTER, 12)
    score = user.run()
    assert score.reached
    root, rotations = user.taken()
    assert np.linalg.norm(fk(figure := default_figure(), root, rotations)[0] - target.positions, axis=1).max() < 0.10
    assert len(rotations) == len(figure)
    # Each arrow and ring costs a decision and a movement: no pose is to be had for less than a second a stroke.
    assert score.seconds > 1.0 * score.strokes
