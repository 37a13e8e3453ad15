"""`bag record`: the recorder node in the foreground."""

import argparse
import os
import sys
from pathlib import Path
from typing import Any

from bunraku.cli import USAGE, Problem
from bunraku.cli.output import print_json
from bunraku.cli.progress import Progress
from bunraku.nodes.recorder.node import Recorder
from bunraku.runtime.bag.info import size
from bunraku.runtime.loop import run_node
from bunraku.runtime.names import PATTERN
from bunraku.runtime.node import timer

NS = 1_000_000_000


def record(args: argparse.Namespace, folder: Path) -> int:
    """Record until Ctrl-C or for the asked time; gives the exit status."""
    for topic in args.topics:
        if not PATTERN.fullmatch(topic):
            raise Problem(f"topic {topic!r}: use a-z, 0-9, '_' and '/' between the parts, '*' for any text", USAGE)
    output = Path(args.output)
    if output.exists() and not args.overwrite:
        raise Problem(f"{output} exists already: choose another name, or --overwrite", USAGE)
    if not output.parent.is_dir() or not os.access(output.parent, os.W_OK):
        raise Problem(f"{output}: {output.parent} is no folder that can be written to", USAGE)
    end: dict[str, Any] = {}
    progress = Progress("recording")
    duration = None if args.duration is None else round(args.duration * NS)

    class Shown(Recorder):
        """The recorder, with a line that tells how far it is."""

        begun = 0

        def setup(self) -> None:
            super().setup()
            self.begun = self.now

        @timer(hz=4)
        def show(self) -> None:
            seconds = (self.now - self.begun) / NS
            if self.writer is not None:
                told = self.status()
                much = f"{told['messages']} messages on {told['topics']} topics, {size(told['bytes'])}"
                lost = f"{told['gaps']} missing" if told["gaps"] else "none missing"
                progress.line(f"recording {told['file']}: {seconds:.0f} s, {much}, {lost} (Ctrl-C ends)")
            if duration is not None and self.now - self.begun >= duration:
                self.stop()

        def teardown(self) -> None:
            progress.clear()
            super().teardown()
            end.update(self.last)

    status = run_node(
        Shown,
        name=args.name,
        params={
            "output": str(output),
            "topics": args.topics or ["*"],
            "overwrite": args.overwrite,
            "compression": args.compression,
        },
        folder=folder,
    )
    progress.clear()
    if args.json and end:
        print_json(end)
        sys.stdout.flush()
    return status
