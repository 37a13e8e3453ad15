"""The touch page: its tables are the code's, and its strips are there, small, one for each performance."""

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"


def script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"docs_{name}", DOCS / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_tables_are_those_of_the_code(capsys: pytest.CaptureFixture[str]) -> None:
    status = script("params").main(["--check"])
    assert status == 0, f"{capsys.readouterr().out.strip()}: run python docs/params.py"


def test_a_changed_default_is_noticed() -> None:
    params = script("params")
    page = (DOCS / "touch.md").read_text(encoding="utf-8")
    changed = page.replace("| `graze` | 0.3 |", "| `graze` | 0.4 |")
    assert changed != page
    assert params.rewritten(changed) == page


def test_every_performance_has_its_strip_and_all_are_small() -> None:
    page = (DOCS / "touch.md").read_text(encoding="utf-8")
    shown = set(re.findall(r"\]\((touch-[\w-]+\.\w+)\)", page))
    assert {f"touch-{one.stem}.webp" for one in (ROOT / "examples").glob("*.touch")} <= shown
    assert all((DOCS / name).is_file() for name in shown)
    assert sum((DOCS / name).stat().st_size for name in shown) < 1_500_000


def test_a_strip_shows_the_moments_that_tell_the_motion(tmp_path: Path) -> None:
    strips = script("strips")
    file = tmp_path / "lift.touch"
    file.write_text(
        '[[touch]]\non = "left_hand"\nstart = 0.5\ndrag = [[0.5, 0.4, 0.5], [1.5, 0.4, 0.5], [2.0, 0.0, 0.0]]\n'
    )
    seen = strips.play(file)
    assert seen[0][0] == pytest.approx(-strips.LEAD, abs=0.1)
    assert seen[-1][0] == pytest.approx(2.0 + strips.TAIL, abs=0.1)
    chosen = strips.moments([view for _, view in seen], 6)
    assert chosen == sorted(set(chosen))
    assert (chosen[0], chosen[-1]) == (0, len(seen) - 1)
    hand = [view.figures[0].positions_ws[view.figures[0].skeleton.role("leftHand"), 1] for _, view in seen]
    assert max(hand[k] for k in chosen) > max(hand) - 0.02  # the hand's highest moment is among them
