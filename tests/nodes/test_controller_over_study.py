"""Every part held over every motion: under the finger, without a jump, and all the rest as the motion has it."""

import importlib.util
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

STUDY = Path(__file__).resolve().parents[2] / "studies" / "over.py"
_spec = importlib.util.spec_from_file_location("bunraku_study_over", STUDY)
assert _spec is not None
assert _spec.loader is not None
over = sys.modules["bunraku_study_over"] = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(over)

HELD = slice(round(over.GRAB * over.HZ), round(over.RELEASE * over.HZ))
motions = pytest.mark.parametrize("motion", over.MOTIONS)


@cache
def played(motion: str) -> tuple[Any, ...]:
    """All touches over a motion."""
    return tuple(over.play(motion, touch) for touch in over.TOUCHES)


def ends(one: Any) -> list[int]:
    """The hands and feet that no finger holds, nor an elbow or knee of."""
    side, _, part = one.touch.part.partition("_")
    kind = {"elbow": "hand", "knee": "foot"}.get(part, part)
    return [
        joint for name, joint in over.JOINTS.items() if name.endswith(("hand", "foot")) and name != f"{side}_{kind}"
    ]


@motions
def test_held_parts_are_under_their_fingers(motion: str) -> None:
    for one in played(motion):
        missed = over.misses(one)
        if missed.size == 0:
            continue
        if over.kind(one.touch) == "elbow, knee":
            # Where joints end, and arms lie on the body; a jump leaves the finger below.
            assert np.median(missed) < 0.06, one.touch
            assert missed.max() < (0.18 if motion == "jump" else 0.14), one.touch
            continue
        assert np.median(missed) < 0.005, one.touch
        # While it jumps, the finger stays below it.
        assert missed.max() < (0.30 if motion == "jump" else 0.02), one.touch


@motions
def test_no_joint_jumps(motion: str) -> None:
    for one in played(motion):
        # A spring that comes back over 0.7 m goes at up to 3 m/s.
        most = 0.075 if one.touch.free else 0.09
        assert over.leaps(one).max() < most, one.touch
        steps, own = (float(np.degrees(one.max())) for one in over.kinks(one))
        assert steps < own + 1600.0, one.touch


@motions
def test_the_rest_stays_with_the_motion(motion: str) -> None:
    for one in played(motion):
        off = np.linalg.norm(one.posed - one.moved, axis=2)
        if one.touch.part == "head":
            arms = [joint for joint, name in enumerate(over.FIGURE.names) if name.endswith(("arm", "hand"))]
            assert np.delete(off, [over.JOINTS["head"], *arms], axis=1).max() < 0.005
            # (What the motion takes into the body, an arm keeps out of it.)
            assert off[:, arms].max() < 0.03
            continue
        if one.touch.part != "pelvis":
            assert off[HELD, 0].max() < 0.16, one.touch
        if one.touch.part.endswith(("hand", "elbow")):
            feet = [joint for joint in ends(one) if joint in (over.JOINTS["left_foot"], over.JOINTS["right_foot"])]
            assert off[HELD][:, feet].max() < 0.02, one.touch
        assert off[round((over.RELEASE + 1.0) * over.HZ) :].max() < 0.03, one.touch


def test_a_way_that_nothing_explains_is_found() -> None:
    one = over.play("walk", over.TOUCHES[0])
    one.posed[120, 3] += [0.0, 0.30, 0.0]
    assert over.leaps(one).max() > 0.2
