"""Start the nodes of a launch file and keep them together; Ctrl-C ends all.

bunraku launch --list
bunraku launch touch --args
bunraku launch touch source:=tuio record:=true
bunraku launch touch --replay show.mcap --replace input_touch
"""

import argparse
import contextlib
import os
import signal
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from bunraku.cli import USAGE, Problem
from bunraku.cli.output import add_json, add_stage, folder_of, print_json, print_rows, table

if TYPE_CHECKING:
    from bunraku.runtime.plan import Planned
    from bunraku.runtime.supervise import Task

WAIT = "60"
"""s that a recording waits for the stack."""
PATIENCE = 3.0
"""s that the nodes of a launch that was killed may take to be gone."""


def add(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("words", metavar="NAME|FILE.py [arg:=value ...]", nargs="*")
    parser.add_argument("--list", action="store_true", help="list the launch files")
    parser.add_argument("--args", action="store_true", help="list the arguments of the launch file")
    parser.add_argument("--show", action="store_true", help="print what would start, and start nothing")
    parser.add_argument("--only", action="append", default=[], metavar="NODE", help="start this node alone (repeat)")
    parser.add_argument("--without", action="append", default=[], metavar="NODE", help="leave this node out (repeat)")
    parser.add_argument("--replay", metavar="BAG", help="play a recording in the place of the --replace node")
    parser.add_argument("--replace", metavar="NODE", help="the node whose place the recording takes")
    add_stage(parser)
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Read, check, show or start."""
    jit = _set_jit_aside()
    from bunraku.runtime.launch import LaunchFile

    if args.list:
        return _list(args)
    if not args.words:
        raise Problem("name a launch file; bunraku launch --list shows all", USAGE)
    file = LaunchFile.find(args.words[0])
    if args.args:
        rows = [
            {"argument": one.name, "type": one.describe(), "default": "" if one.required else one.default}
            for one in file.arguments.values()
        ]
        if not args.json and file.help:
            print(f"{file.help}\n", flush=True)
        print_rows(rows, ["argument", "type", "default"], args, f"{file.shown} takes no arguments")
        return 0
    if bool(args.replay) != bool(args.replace):
        raise Problem("--replay BAG and --replace NODE go together", USAGE)
    from bunraku.runtime import plan

    specs = file.specs(file.parse(args.words[1:]))
    planned = plan.choose(plan.check(specs), args.only, args.without)
    if args.replay:
        planned = _replay(planned, args.replay, args.replace)
    planned = plan.with_listeners(planned)
    if args.show:
        return _show(planned, args)
    if not planned:
        raise Problem(f"{file.shown}: nothing to start", USAGE)
    return start(planned, folder_of(args), Path(args.words[0]).stem, jit=jit)


def _set_jit_aside() -> bool:
    """Whether nodes may compile kernels; this process imports their classes but computes nothing."""
    from bunraku.cli.kernels import compiling

    jit = compiling()
    os.environ["BUNRAKU_JIT"] = "0"
    return jit


def _list(args: argparse.Namespace) -> int:
    from bunraku.runtime import launch

    rows = [{"name": name, "doc": launch.LaunchFile.find(name).doc} for name in launch.names()]
    print_rows(rows, ["name", "doc"], args, "no launch files")
    return 0


def _show(planned: "Sequence[Planned]", args: argparse.Namespace) -> int:
    from bunraku.runtime import plan

    if args.json:
        shown = [
            {**one.spec.as_dict(), "says": sorted(one.says), "hears": list(one.hears), "run": plan.command(one)}
            for one in planned
        ]
        print_json(shown)
        return 0
    rows = []
    for one in planned:
        marks = [word for word in ("respawn", "required") if getattr(one.spec, word)]
        params = " ".join(f"{key}={plan.as_word(value)}" for key, value in one.params.items())
        heard = " ".join(sorted(one.hears))
        words = " ".join(one.spec.command) or one.spec.kind
        rows.append([one.spec.path, words, params or "-", heard or "-", " ".join(one.outputs) or "-", *_or(marks)])
    print(table(rows, ["node", "runs", "params", "hears", "says", "marks"]))
    return 0


def _or(marks: Sequence[str]) -> list[str]:
    return [" ".join(marks) or "-"]


def _replay(planned: "Sequence[Planned]", bag: str, word: str) -> "list[Planned]":
    from bunraku.runtime import plan
    from bunraku.runtime.bag import Bag, BagError

    one = plan.find(planned, word)
    try:
        with Bag(bag) as opened:
            channels = opened.channels
    except (BagError, OSError) as error:
        raise Problem(f"--replay {bag}: {error}", USAGE) from None
    own = {topic for topic, channel in channels.items() if channel.node == one.spec.path}
    topics = sorted(topic for topic in own | set(one.outputs) if topic in channels and not _of_itself(topic))
    if not topics:
        said = ", ".join(one.outputs) or "nothing"
        raise Problem(f"--replay {bag}: holds nothing that {word} says ({said}); see bunraku bag info {bag}", USAGE)
    return plan.substitute(planned, word, ["bag", "play", bag, "--wait", WAIT, "--topics", *topics], topics)


def _of_itself(topic: str) -> bool:
    """Whether a node speaks of itself in a topic, its namespace aside."""
    return bool({"log", "params", "journal"} & set(topic.split("/")[:-1]))


def start(planned: "Sequence[Planned]", folder: Path, name: str, *, jit: bool = True) -> int:
    """Run the nodes on a stage until they end; the exit status is honest."""
    from bunraku.runtime import graph, plan
    from bunraku.runtime.names import endpoint, file_of, make_run_folder
    from bunraku.runtime.supervise import Supervisor

    for one in planned:
        for topic in one.says:
            endpoint(file_of(folder, topic))
    make_run_folder(folder)
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.default_int_handler)  # until the supervisor listens
    try:
        lock = graph.StageLock(folder)
    except graph.StageTaken as error:
        raise Problem(str(error), USAGE) from None
    try:
        graph.sweep(folder, states=True)
        _await_free(planned, folder)
        if jit:
            _warm(planned)
        supervised = {one.spec.path for one in planned if not one.spec.command}

        def is_up(task: "Task", pid: int) -> bool:
            return task.name not in supervised or graph.is_up(folder, task.name)

        def on_up(seconds: float) -> None:
            count = f"{len(planned)} nodes" if len(planned) > 1 else "1 node"
            supervisor.say(f"{name}: {count} up in {seconds:.1f} s on stage {folder.name!r}; Ctrl-C ends")

        def on_end(pid: int) -> None:
            graph.sweep(folder, pid=pid)

        supervisor = Supervisor(
            plan.tasks(planned, jit=jit, env={"BUNRAKU_STAGE": folder.name}),
            is_up=is_up,
            on_up=on_up,
            on_end=on_end,
        )
        return supervisor.run()
    finally:
        graph.sweep(folder, states=True)
        lock.release()
        with contextlib.suppress(OSError):
            folder.rmdir()


def _await_free(planned: "Sequence[Planned]", folder: Path) -> None:
    """Wait for the last nodes of a launch that was killed; refuse where a topic stays taken."""
    from bunraku.runtime import graph

    wanted = {topic: one for one in planned for topic in one.says}
    end = time.monotonic() + PATIENCE
    while True:
        taken = [topic for topic in graph.topics(folder) if topic.name in wanted]
        if not taken:
            return
        if time.monotonic() > end:
            lines = [
                wanted[topic.name].spec.fault(
                    "topic",
                    f"{topic.name!r} is said by {topic.node} (process {topic.pid}) already; "
                    f"end that one, or add --without {wanted[topic.name].spec.path} or --stage NAME",
                )
                for topic in taken
                if not _of_itself(topic.name)
            ]
            raise Problem("\n".join(lines) or f"{taken[0].node} runs on this stage already: end it", USAGE)
        time.sleep(0.05)


def _warm(planned: "Sequence[Planned]") -> None:
    """Compile the kernels once, before anything is live."""
    from bunraku.cli import kernels

    kernels.compile_missing(
        sorted({f"{one.node.__module__}:{one.node.__qualname__}" for one in planned if one.node.jit})
    )
