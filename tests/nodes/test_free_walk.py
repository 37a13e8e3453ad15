"""A pen that wanders about for a quarter of a minute: the figure stays on its line, its feet hold, nothing jerks."""

import importlib.util
import sys
from pathlib import Path
from typing import Any

import pytest

from bunraku.motion.synth import builtin_set

STUDIES = Path(__file__).resolve().parents[2] / "studies"


@pytest.fixture
def study(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(STUDIES))
    spec = importlib.util.spec_from_file_location("bunraku_study_pen_walk", STUDIES / "pen_walk.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "bunraku_study_pen_walk", module)
    spec.loader.exec_module(module)
    return module


def test_a_free_walk_is_on_its_line_with_feet_that_hold(study: Any) -> None:
    quality = study.free_walk(15.0, (0.4, 0.4), 0)
    examples = [one for module in builtin_set().modules.values() for one in module.examples]
    sources = max(float(study.velocity_steps(one.clip).max()) for one in examples)
    assert quality.length > 12.0
    assert quality.drift < 2e-3
    assert quality.path_rms < 0.01
    assert quality.beyond < 1e-3
    assert quality.step_most <= sources
    assert quality.speed_error < 0.02
    assert quality.behind < 2.0


def test_an_early_start_is_wrong_more_often_where_a_stroke_does_not_slow_down(study: Any) -> None:
    rates = [study.early_errors(shape, study.RULES.early_step, 60) for shape in study.SHAPES.values()]
    slowing, least_jerk, even, flick = rates
    assert max(slowing, least_jerk) <= 6
    assert min(even, flick) > 8
    none = study.early_errors(next(iter(study.SHAPES.values())), 0.2, 60)
    assert none <= slowing + 2
