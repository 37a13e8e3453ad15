"""The posing study: how long simulated users take to pose the figure by touch, and by a joint-handle editor.

    bunraku study touch [--seeds 20] [-o FOLDER]

Five target poses; a pose is done when every joint is within 10 cm of its target's. Both kinds of users have the
same motor model (Fitts's law, a mental act for each decision, scattered end points); no person took part. Writes
the tables (table.md), every run (runs.json) and pictures (poses.png, reached.png, times.png) into the folder.
"""

import argparse
import contextlib
import json
import multiprocessing
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bunraku.cli.progress import Progress

from .editor import EditorUser
from .motor import FINGER, POINTER, Motor
from .poses import GOALS, Ghost, ghost
from .user import GIVE_UP, Score, TouchUser

Array = NDArray[np.float64]
PAPER = {"1": (27.4, 8.6), "2": (33.2, 9.9), "3": (34.7, 11.9), "4": (76.2, 25.6), "5": (132.5, 40.1)}
"""Seconds of seven people, mouse and touch, at poses of the same rank (Oshita 2013, table 1); not the same poses."""
TOOLS: dict[str, tuple[type[TouchUser] | type[EditorUser], Motor]] = {
    "touch": (TouchUser, FINGER),
    "handles": (EditorUser, POINTER),
}
CHANGES: dict[str, Callable[[Motor], Motor]] = {
    "decisions in half the time": lambda m: replace(m, think=m.think / 2),
    "decisions in twice the time": lambda m: replace(m, think=m.think * 2),
    "movements in half the time per bit": lambda m: replace(m, reach_b=m.reach_b / 2, drag_b=m.drag_b / 2),
    "movements in twice the time per bit": lambda m: replace(m, reach_b=m.reach_b * 2, drag_b=m.drag_b * 2),
    "half the scatter": lambda m: replace(m, noise=m.noise / 2, tremor=m.tremor / 2, hidden=m.hidden / 2),
    "twice the scatter": lambda m: replace(m, noise=m.noise * 2, tremor=m.tremor * 2, hidden=m.hidden * 2),
}


Job = tuple[str, str, Ghost, int]
"""Motor model, tool, target, seed."""


@dataclass(frozen=True, eq=False)
class Run:
    """One simulated user at one pose."""

    tool: str
    pose: str
    seed: int
    score: Score
    pose_root: Array
    """(3) m, of the pose at the end."""
    pose_rotations: Array  # (J, 4)


def perform(tool: str, target: Ghost, seed: int, change: Callable[[Motor], Motor] | None = None) -> Run:
    """Let one simulated user pose the figure."""
    user, motor = TOOLS[tool]
    one = user(target, change(motor) if change else motor, seed)
    score = one.run()
    return Run(tool, target.goal.name, seed, score, *one.taken())


def row(runs: Sequence[Run]) -> dict[str, float]:
    """Medians of some runs; times and strokes of those that reached the pose."""
    done = [run.score for run in runs if run.score.reached]
    if not done:
        return {"reached": 0.0, "seconds": GIVE_UP, "low": GIVE_UP, "high": GIVE_UP, "strokes": 0.0, "views": 0.0}
    seconds = np.array([one.seconds for one in done])
    return {
        "reached": len(done) / len(runs),
        "seconds": float(np.median(seconds)),
        "low": float(np.quantile(seconds, 0.1)),
        "high": float(np.quantile(seconds, 0.9)),
        "strokes": float(np.median([one.strokes for one in done])),
        "views": float(np.median([one.views for one in done])),
    }


def table(runs: Sequence[Run], seeds: int) -> list[str]:
    """The main table, in Markdown."""
    lines = [
        f"Simulated users, {seeds} a pose and tool: median s (10 % to 90 %), strokes, camera moves, and the share",
        "that reached the pose (all joints within 10 cm; medians of those). Beside them the seconds of seven people at",
        "poses of the same rank (Oshita 2013, table 1).",
        "",
        "| pose | touch s | strokes | camera | reached | handles s | strokes | camera | reached | people |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for goal in GOALS:
        cells = [f"{goal.name} {goal.says}"]
        for tool in TOOLS:
            one = row([run for run in runs if run.tool == tool and run.pose == goal.name])
            cells.append(f"{one['seconds']:.1f} ({one['low']:.1f} to {one['high']:.1f})")
            cells += [f"{one['strokes']:.0f}", f"{one['views']:.0f}", f"{one['reached']:.0%}"]
        mouse, touch = PAPER[goal.name]
        lines.append("| " + " | ".join([*cells, f"touch {touch}, mouse {mouse}"]) + " |")
    return lines


def sensitivity_table(results: dict[str, list[Run]], seeds: int) -> list[str]:
    """How the medians change with the model's constants."""
    lines = [
        f"Sensitivity: sum of the five poses' median seconds ({seeds} users a cell), and the ratio.",
        "",
        "| motor model | touch | handles | handles / touch | touch reached |",
        "|---|---|---|---|---|",
    ]
    for name, runs in results.items():
        sums = {}
        for tool in TOOLS:
            sums[tool] = sum(
                row([run for run in runs if run.tool == tool and run.pose == goal.name])["seconds"] for goal in GOALS
            )
        reached = np.mean([run.score.reached for run in runs if run.tool == "touch"])
        ratio = sums["handles"] / sums["touch"]
        lines.append(f"| {name} | {sums['touch']:.0f} s | {sums['handles']:.0f} s | {ratio:.2f} | {reached:.0%} |")
    return lines


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study."""
    parser = argparse.ArgumentParser(prog="bunraku study touch", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--seeds", type=int, default=20, help="simulated users a pose and tool (default 20)")
    parser.add_argument("--sensitivity", type=int, default=5, help="users a cell of the other table, 0 for none")
    parser.add_argument("--jobs", type=int, default=1, help="processes that share the work (default 1)")
    parser.add_argument("--poses", default="12345", help="which poses, like 135 (default all)")
    parser.add_argument("-o", "--output", type=Path, default=Path("study-touch"), help="folder to write (study-touch)")
    parser.add_argument("--json", action="store_true", help="print every run instead of the tables")
    args = parser.parse_args(argv)
    goals = [goal for goal in GOALS if goal.name in args.poses]
    if args.seeds < 1 or args.sensitivity < 0 or args.jobs < 1 or not goals:
        print(
            "bunraku study touch: --seeds counts users (at least 1), --jobs processes, --poses names some of 12345",
            file=sys.stderr,
        )
        return 2
    ghosts = [ghost(goal) for goal in goals]
    jobs: list[Job] = [("as stated", tool, one, seed) for one in ghosts for tool in TOOLS for seed in range(args.seeds)]
    names = list(CHANGES) if args.sensitivity and len(goals) == len(GOALS) else []
    jobs += [
        (name, tool, one, seed)
        for name in names
        for one in ghosts
        for tool in TOOLS
        for seed in range(args.sensitivity)
    ]
    results: dict[str, list[Run]] = {"as stated": []}
    with Progress("posing") as progress, contextlib.ExitStack() as stack:
        done: Iterable[Run] = map(_job, jobs)
        if args.jobs > 1:
            done = stack.enter_context(multiprocessing.get_context("fork").Pool(args.jobs)).imap(_job, jobs)
        for number, (job, run) in enumerate(zip(jobs, done, strict=True)):
            progress(number, len(jobs), f"{run.tool}, pose {run.pose}")
            results.setdefault(job[0], []).append(run)
    runs = results["as stated"]
    lines = table(runs, args.seeds) if len(goals) == len(GOALS) else _short(runs)
    if names:
        few = {"as stated": [run for run in runs if run.seed < args.sensitivity]}
        lines += ["", *sensitivity_table({**few, **{name: results[name] for name in names}}, args.sensitivity)]
    args.output.mkdir(parents=True, exist_ok=True)
    (args.output / "table.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    listed: list[dict[str, Any]] = [
        {"motor": name, "tool": run.tool, "pose": run.pose, "seed": run.seed, **asdict(run.score)}
        for name, some in results.items() for run in some
    ]  # fmt: skip
    (args.output / "runs.json").write_text(json.dumps(listed), encoding="utf-8")
    from .pictures import draw_poses, draw_reached, draw_times

    draw_poses(ghosts, args.output / "poses.png")
    draw_reached(ghosts, runs, args.output / "reached.png")
    draw_times(runs, args.output / "times.png")
    print(json.dumps(listed) if args.json else "\n".join(lines))
    print(f"written to {args.output}: table.md runs.json poses.png reached.png times.png", file=sys.stderr)
    return 0 if all(row([run for run in runs if run.pose == goal.name and run.tool == "touch"])["reached"]
                    for goal in goals) else 1  # fmt: skip


def _job(job: Job) -> Run:
    name, tool, target, seed = job
    return perform(tool, target, seed, CHANGES.get(name))


def _short(runs: Sequence[Run]) -> list[str]:
    lines = []
    for pose in dict.fromkeys(run.pose for run in runs):
        for tool in TOOLS:
            one = row([run for run in runs if run.tool == tool and run.pose == pose])
            lines.append(f"pose {pose} {tool}: {one['seconds']:.1f} s, {one['strokes']:.0f} strokes, "
                         f"{one['views']:.0f} camera moves, reached {one['reached']:.0%}")  # fmt: skip
    return lines
