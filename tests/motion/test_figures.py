"""Figures by name: another body in a file moves by touch and by the built-in motions."""

from pathlib import Path

import numpy as np
import pytest

from bunraku.figure.default import default_figure
from bunraku.figure.skeleton import Skeleton
from bunraku.motion.bvh import write_bvh
from bunraku.motion.clip import Clip
from bunraku.motion.figures import figure_named
from bunraku.motion.synth import builtin_set
from bunraku.msgs import Command, Locomotion, PathPoint, Target
from bunraku.nodes.blender.node import Blender
from bunraku.nodes.controller.node import Controller
from bunraku.runtime.memory import MemoryStage
from bunraku.runtime.node import ParamProblem

BASE = default_figure()
SCALE = 0.8


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """The default figure's bones at four fifths of their size, as a capture file."""
    skeleton = Skeleton(
        BASE.names, BASE.parents, SCALE * BASE.offsets, BASE.roles, BASE.masses,
        SCALE * BASE.mass_centers, SCALE * BASE.box_centers, SCALE * BASE.box_sizes,
    )  # fmt: skip
    root, rotations = skeleton.rest_pose()
    file = tmp_path / "small.bvh"
    write_bvh(Clip("small", skeleton, 60.0, root[None], rotations[None]), file)
    return file


def test_the_default_figure_has_a_name() -> None:
    assert figure_named("default") is BASE


def test_a_capture_s_body_has_its_bones_and_fitting_boxes(small: Path) -> None:
    figure = figure_named(str(small))
    for role, joint in BASE.roles.items():
        place = figure.rest_positions[figure.role(role)]
        np.testing.assert_allclose(place, SCALE * BASE.rest_positions[joint], atol=2e-4)
    np.testing.assert_allclose(figure.box_sizes.max(), SCALE * BASE.box_sizes.max(), rtol=0.02)
    assert figure.masses.sum() == pytest.approx(BASE.masses.sum(), rel=0.01)


def test_a_motion_set_s_figure_is_found(small: Path, tmp_path: Path) -> None:
    figure = figure_named(str(small))
    kept = tmp_path / "set.npz"
    builtin_set(figure).save(kept)
    np.testing.assert_allclose(figure_named(str(kept)).rest_positions, figure.rest_positions, atol=1e-5)


def test_another_body_reaches_under_touch(small: Path) -> None:
    stage = MemoryStage()
    node = stage.add(Controller, figure=str(small))
    said = stage.last("skeleton")
    assert said is not None
    hand = node.core.skeleton.role("leftHand")
    goal = SCALE * np.array([0.45, 1.30, 0.25])
    for _ in range(120):
        stage.publish("target", Target(left_hand=tuple(goal)))
        stage.advance(1 / 60)
    np.testing.assert_allclose(node.core.positions_ws[hand], goal, atol=1e-3)
    assert stage.last("pose").skeleton == node.core.skeleton.hash


def test_another_body_walks(small: Path) -> None:
    stage = MemoryStage()
    node = stage.add(Blender, figure=str(small), skeleton=True)
    walk: Command = Locomotion(id=1, path=[PathPoint(x=0.0, z=0.1 * k, speed=1.0) for k in range(31)], complete=True)
    stage.publish("command", walk)
    stage.advance(8.0)
    end = stage.last("motion")
    assert end.root[2] == pytest.approx(3.0, abs=0.05)
    assert end.root[1] == pytest.approx(SCALE * BASE.rest_positions[0, 1], abs=0.05)
    assert stage.last("skeleton") is not None
    assert node.core.skeleton.hash == end.skeleton


@pytest.mark.parametrize("node", [Controller, Blender])
@pytest.mark.parametrize(
    ("name", "line"),
    [("nobody", "no figure is named 'nobody'"), ("none.bvh", "none.bvh"), ("bad.bvh", "bad.bvh"),
     ("bad.npz", "not a motion set")],
)  # fmt: skip
def test_what_is_no_figure_is_refused_in_one_line(node: type, name: str, line: str, tmp_path: Path) -> None:
    for bad in ("bad.bvh", "bad.npz"):
        (tmp_path / bad).write_text("nothing of the kind\n")
    given = name if "." not in name else str(tmp_path / name)
    with pytest.raises(ParamProblem, match=line) as found:
        MemoryStage().add(node, figure=given)
    assert str(found.value).startswith("figure: ")
    assert "\n" not in str(found.value)
