"""The course study: simulated users walk four stages with a pen and with a gamepad; time, course-outs, collisions.

    bunraku study pen [--seeds 20] [--stage N] [--json] [-o FOLDER]
    bunraku study pen --play pad --seed 3          # one user plays the course that `launch course` runs now

Every simulated user plays every stage with both devices, without and with obstacles. It sees the picture only and acts
by device messages only; no person took part. Writes the tables (table.md) and every run (runs.json) into the folder.
"""

import argparse
import contextlib
import json
import multiprocessing
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from bunraku.cli.progress import Progress
from bunraku.launch.course import VIEW
from bunraku.nodes.blender.node import Blender
from bunraku.nodes.course.node import CourseGame
from bunraku.nodes.course.stages import stages
from bunraku.nodes.interpreter.node import Interpreter
from bunraku.runtime.memory import MemoryStage

from .pad_user import PadPlayer
from .pen_user import PenPlayer
from .person import Person, someone
from .player import Player

GIVE_UP = 120.0  # s
DEVICES: dict[str, type[Player]] = {"pen": PenPlayer, "pad": PadPlayer}
PAPER = {
    (1, False): ((0.50, None, 5.60), (0.89, None, 3.68)), (2, False): ((0.75, None, 7.94), (1.33, None, 8.87)),
    (3, False): ((2.25, None, 23.06), (2.42, None, 19.17)), (4, False): ((0.33, None, 11.93), (2.00, None, 11.93)),
    (1, True): ((0.50, 1.08, 6.85), (0.67, 0.83, 6.14)), (2, True): ((0.67, 0.67, 10.00), (1.42, 0.92, 9.68)),
    (3, True): ((2.17, 2.92, 17.75), (3.25, 2.33, 24.58)), (4, True): ((0.83, 2.17, 15.82), (2.35, 1.33, 16.29)),
}  # fmt: skip
"""Means of five people, course-outs, collisions and s with pen and gamepad (Oshita 2005, table 3); other stages."""
CHANGES: dict[str, Callable[[Person], Person]] = {
    "reactions and eyes in half the time": lambda p: replace(p, reaction=p.reaction / 2, delay=p.delay / 2),
    "reactions and eyes in twice the time": lambda p: replace(p, reaction=p.reaction * 2, delay=p.delay * 2),
    "half the motor noise": lambda p: replace(p, drift=p.drift / 2, thumb=p.thumb / 2, aim=p.aim / 2),
    "twice the motor noise": lambda p: replace(p, drift=p.drift * 2, thumb=p.thumb * 2, aim=p.aim * 2),
    "hands at 2/3 of the speed": lambda p: replace(p, hand=p.hand / 1.5, hurry=p.hurry / 1.5, slow=p.slow / 1.5),
    "hands at 3/2 of the speed": lambda p: replace(p, hand=p.hand * 1.5, hurry=p.hurry * 1.5, slow=p.slow * 1.5),
    "things expected half as exactly": lambda p: replace(p, timing=p.timing * 2),
    "the stick always pushed fully": lambda p: replace(p, slow=1.0, bend=360.0),
}


@dataclass(frozen=True)
class Run:
    """One simulated user, once over a stage."""

    device: str
    stage: int
    obstacles: bool
    seed: int
    reached: bool
    seconds: float
    outs: int
    hits: int
    points: float


def perform(
    device: str, stage: int, obstacles: bool, seed: int, change: Callable[[Person], Person] | None = None
) -> Run:
    """Let one simulated user play a stage in memory, on the virtual clock."""
    memory = MemoryStage()
    view: dict[str, Any] = dict(VIEW)
    memory.add(Interpreter, **view)
    memory.add(Blender, skeleton=True, remap={"motion": "pose"}, show_overlay=False)
    game = memory.add(CourseGame, stage_number=stage, obstacles=obstacles, again=0.0)
    player = memory.add(DEVICES[device], seed=seed)
    if change is not None:
        player.become(someone(seed, change(Person())))
    for _ in range(round(GIVE_UP * 4)):
        memory.advance(0.25)
        memory.bodies = {topic: said[-1:] for topic, said in memory.bodies.items()}
        if game.game.phase == "finished":
            break
    score = game.game.score
    reached = game.game.phase == "finished"
    return Run(device, stage, obstacles, seed, reached, round(score.seconds, 3), score.outs, score.hits,
               round(score.points(), 3))  # fmt: skip


def cell(runs: Sequence[Run], key: str) -> str:
    """Mean and standard deviation of a measure."""
    values = np.array([getattr(run, key) for run in runs], dtype=np.float64)
    return f"{values.mean():.2f} ± {values.std(ddof=1) if len(values) > 1 else 0.0:.2f}"


def differs(runs: Sequence[Run], key: str) -> float:
    """p of Wilcoxon's two-sided signed-rank test between pen and gamepad in the same hands; 1 where all are even."""
    pens = {(run.stage, run.obstacles, run.seed): getattr(run, key) for run in runs if run.device == "pen"}
    pads = {(run.stage, run.obstacles, run.seed): getattr(run, key) for run in runs if run.device == "pad"}
    gaps = np.array([pens[one] - pads[one] for one in sorted(pens) if one in pads], dtype=np.float64)
    if not np.abs(gaps).any():
        return 1.0
    from scipy.stats import wilcoxon

    return float(wilcoxon(gaps, zero_method="wilcox", method="auto").pvalue)


def shown(p: float) -> str:
    """A p value for a table."""
    return "< 0.001" if p < 0.001 else f"{p:.3f}"


def table(runs: Sequence[Run], seeds: int) -> list[str]:
    """The main table, in Markdown."""
    lines = [
        f"{seeds} simulated users, each once over every stage with both devices: mean ± standard deviation, p of the",
        "signed-rank test between the devices in the same hands. Points: s, and 2 for a course-out, 3 for a collision.",
        "",
        "| stage | course-outs: pen | gamepad | p | collisions: pen | gamepad | p | goal time s: pen | gamepad | p "
        "| points: pen | gamepad | p | reached |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for obstacles in (False, True):
        for stage in sorted({run.stage for run in runs}):
            some = [run for run in runs if run.stage == stage and run.obstacles == obstacles]
            if not some:
                continue
            pens, pads = ([run for run in some if run.device == device] for device in DEVICES)
            words = [f"{stage} {stages()[stage - 1].name}, {'with' if obstacles else 'no'} obstacles"]
            for key in ("outs", "hits", "seconds", "points"):
                if key == "hits" and not obstacles:
                    words += ["–", "–", "–"]
                else:
                    words += [cell(pens, key), cell(pads, key), shown(differs(some, key))]
            words.append(f"{sum(run.reached for run in some)} of {len(some)}")
            lines.append("| " + " | ".join(words) + " |")
    return lines


def paper_table() -> list[str]:
    """What people did, on the paper's own stages."""
    lines = [
        "Five people on the paper's own stages (Oshita 2005, table 3; means, no test given):",
        "",
        "| stage | course-outs: pen | gamepad | collisions: pen | gamepad | goal time s: pen | gamepad |",
        "|---|---|---|---|---|---|---|",
    ]
    for (stage, obstacles), (pen, pad) in PAPER.items():
        words = [f"{stage}, {'with' if obstacles else 'no'} obstacles"]
        for k in range(3):
            words += ["–" if one[k] is None else f"{one[k]:.2f}" for one in (pen, pad)]
        lines.append("| " + " | ".join(words) + " |")
    return lines


def sensitivity_table(results: dict[str, list[Run]], seeds: int) -> list[str]:
    """Sums over the four stages with obstacles, by the users' constants."""
    lines = [
        f"Sensitivity: sums of the four stages' means, with obstacles ({seeds} users a cell).",
        "",
        "| users | course-outs: pen | gamepad | collisions: pen | gamepad | s: pen | gamepad | points: pen | gamepad "
        "| reached |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name, runs in results.items():
        words = [name]
        for key in ("outs", "hits", "seconds", "points"):
            for device in DEVICES:
                values = [getattr(run, key) for run in runs if run.device == device]
                total = len({run.stage for run in runs}) * float(np.mean(values))
                words.append(f"{total:.1f}" if key in ("seconds", "points") else f"{total:.2f}")
        words.append(f"{sum(run.reached for run in runs)} of {len(runs)}")
        lines.append("| " + " | ".join(words) + " |")
    return lines


Job = tuple[str, str, int, bool, int]
"""Name of the users' change, device, stage, obstacles, seed."""


def _job(job: Job) -> Run:
    name, device, stage, obstacles, seed = job
    return perform(device, stage, obstacles, seed, CHANGES.get(name))


def play(device: str, seed: int) -> int:
    """One user at the course that a launch file runs now, in the place of the device node."""
    from bunraku.runtime.loop import run_node

    return run_node(DEVICES[device], params={"seed": seed, "leave": True})


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study."""
    parser = argparse.ArgumentParser(prog="bunraku study pen", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--seeds", type=int, default=20, help="simulated users (default 20)")
    parser.add_argument("--stage", type=int, choices=(1, 2, 3, 4), help="one stage only")
    parser.add_argument("--sensitivity", type=int, default=4, help="users a cell of the other table, 0 for none")
    parser.add_argument("--jobs", type=int, default=1, help="processes that share the work (default 1)")
    parser.add_argument("-o", "--output", type=Path, default=Path("study-pen"), help="folder to write (study-pen)")
    parser.add_argument("--json", action="store_true", help="print every run instead of the tables")
    parser.add_argument("--play", choices=tuple(DEVICES), help="play the running course with this device, in its place")
    parser.add_argument("--seed", type=int, default=0, help="which user plays (default 0)")
    args = parser.parse_args(argv)
    if args.play:
        return play(args.play, args.seed)
    if args.seeds < 1 or args.sensitivity < 0 or args.jobs < 1:
        print(
            "bunraku study pen: --seeds counts users (at least 1), --sensitivity too (0 for none), --jobs processes",
            file=sys.stderr,
        )
        return 2
    numbers = [args.stage] if args.stage else [1, 2, 3, 4]
    names = list(CHANGES) if args.sensitivity and not args.stage else []
    jobs: list[Job] = [("as stated", device, stage, obstacles, seed) for stage in numbers for obstacles in (False, True)
            for device in DEVICES for seed in range(args.seeds)]  # fmt: skip
    jobs += [(name, device, stage, True, seed) for name in names for stage in numbers for device in DEVICES
             for seed in range(args.sensitivity)]  # fmt: skip
    results: dict[str, list[Run]] = {"as stated": []}
    begun = time.monotonic()
    with Progress("walking") as progress, contextlib.ExitStack() as stack:
        done: Iterable[Run] = map(_job, jobs)
        if args.jobs > 1:
            done = stack.enter_context(multiprocessing.get_context("fork").Pool(args.jobs)).imap(_job, jobs)
        for number, (job, run) in enumerate(zip(jobs, done, strict=True)):
            progress(number, len(jobs), f"{run.device}, stage {run.stage}")
            results.setdefault(job[0], []).append(run)
    minutes = (time.monotonic() - begun) / 60.0
    runs = results["as stated"]
    lines = table(runs, args.seeds)
    if names:
        few = [run for run in runs if run.seed < args.sensitivity and run.obstacles]
        lines += ["", *sensitivity_table({"as stated": few, **{n: results[n] for n in names}}, args.sensitivity)]
    lines += ["", *paper_table(), "", f"{len(jobs)} runs in {minutes:.1f} minutes."]
    args.output.mkdir(parents=True, exist_ok=True)
    (args.output / "table.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    listed: list[dict[str, Any]] = [{"users": name, **asdict(run)} for name, some in results.items() for run in some]
    (args.output / "runs.json").write_text(json.dumps(listed), encoding="utf-8")
    print(json.dumps(listed) if args.json else "\n".join(lines))
    print(f"written to {args.output}: table.md runs.json", file=sys.stderr)
    return 0 if all(run.reached for run in runs) else 1
