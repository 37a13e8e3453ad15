"""The course in real processes: a written stroke walks it, and the record tells."""

from collections.abc import Callable
from pathlib import Path

import pytest
from launched import Stack, read, until

pytestmark = [pytest.mark.stack, pytest.mark.timeout(600)]
STROKE = Path(__file__).parents[2] / "examples" / "course.pen"


def test_a_written_stroke_reaches_the_goal_and_the_record_is_said(launch: Callable[..., Stack]) -> None:
    stack = launch("course", "stage:=2", "obstacles:=false", "source:=script", f"script:={STROKE}", "window:=off")
    record = stack.reader("course", newest=False)
    heard = [read(record)]

    def finished() -> bool:
        heard.append(read(record))
        return bool(heard[-1]["phase"] == "finished")

    until(finished, "the goal is reached")
    last = heard[-1]
    assert [one for one in ("ready", "running", "finished") if any(h["phase"] == one for h in heard)] == [
        "ready", "running", "finished",
    ]  # fmt: skip
    assert (last["stage"], last["collisions"], last["runs"]) == (2, 0, 1)
    assert last["course_outs"] <= 1, "drawn along the middle of the way"
    assert 6.0 < last["seconds"] < 20.0
