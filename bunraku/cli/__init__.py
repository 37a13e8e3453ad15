"""The `bunraku` command: one module a verb, imported only when that verb is asked for.

A verb's module has ``add(parser)``, which declares its arguments, and ``run(args) -> int``, which returns the
exit status: 0, 1 for a failure, 2 for bad usage or input. Whatever goes wrong on the user's side is raised as
`Problem` (or as `ValueError`/`OSError`) and printed as one line: what, where, what to do.
"""

import argparse
import difflib
import importlib
import os
import re
import sys
from collections.abc import Iterable, Sequence
from typing import Any, NoReturn

from bunraku import __version__

VERBS: dict[str, str] = {
    "demo": "a scripted performer plays through the real processes; writes a bag, a film, a BVH and a picture",
    "launch": "start the nodes of a launch file: bunraku launch touch source:=tuio",
    "run": "run one node",
    "topic": "list, info, echo, hz, bw, delay, pub: what flows",
    "node": "list, info: the nodes that run",
    "param": "list, get, set: parameters of running nodes",
    "bag": "record, play, info, check, recover, export",
    "figure": "show or export the figure",
    "motion": "build and look at motion sets",
    "study": "scored tasks",
    "doctor": "what is missing on this machine, and the command that mends it",
    "keys": "write the keys that join two machines",
}
"""Verb: one line of help. The module of a verb is ``bunraku.cli.<verb>``; one without its module is not shown."""

USAGE, FAILURE, INTERRUPTED = 2, 1, 130


class Problem(Exception):
    """What the user should read: one line that says what, where and what to do."""

    def __init__(self, message: str, status: int = FAILURE) -> None:
        super().__init__(message)
        self.status = status


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line and whose options may stand anywhere."""

    intermixed = True

    def add_subparsers(self, **options: Any) -> Any:
        """As in argparse; a choice is asked for, and options then stand after it."""
        self.intermixed = False
        options.setdefault("required", True)
        options.setdefault("dest", "what")
        options.setdefault("metavar", "WHAT")
        return super().add_subparsers(**options)

    def error(self, message: str) -> NoReturn:
        """Leave with one line instead of the whole usage."""
        found = re.search(r"invalid choice: '?([^' ]*)'? \(choose from (.*)\)", message)
        if found:
            word, choices = found[1], re.findall(r"[\w:-]+", found[2])
            message = f"unknown {word!r}{nearest(word, choices)} (there is: {', '.join(choices)})"
        self.exit(USAGE, f"{self.prog}: {message}; see {self.prog} --help\n")


def nearest(word: str, choices: Iterable[str]) -> str:
    """The text that proposes the nearest of the choices, or nothing."""
    close = difflib.get_close_matches(word, list(choices), n=1, cutoff=0.5)
    return f", did you mean {close[0]!r}?" if close else ""


def verbs() -> dict[str, str]:
    """The verbs that are there."""
    there = {entry.name for entry in os.scandir(os.path.dirname(__file__))}
    return {verb: line for verb, line in VERBS.items() if f"{verb}.py" in there}


def top_help() -> str:
    """The table of verbs."""
    table = verbs()
    width = max(map(len, table))
    rows = "\n".join(f"  {verb:{width}}  {line}" for verb, line in table.items())
    return (
        "usage: bunraku VERB ... | --help | --version\n\n"
        "Move a full-body figure live with your hands.\n\n"
        f"{rows}\n\n"
        "bunraku VERB --help says more. The environment BUNRAKU_STAGE names the stage (default: default).\n"
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    words = list(sys.argv[1:] if argv is None else argv)
    try:
        status = _main(words)
        sys.stdout.flush()
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        # the reader (head, less) has gone: nothing more to say, not even at the interpreter's end
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        return FAILURE
    return status


def _main(words: list[str]) -> int:
    if not words:
        sys.stderr.write(top_help())
        return USAGE
    verb, rest = words[0], words[1:]
    if verb in ("-h", "--help", "help") and not rest:
        sys.stdout.write(top_help())
        return 0
    if verb == "help":
        verb, rest = rest[0], ["--help"]
    if verb in ("-V", "--version"):
        print(f"bunraku {__version__}")
        return 0
    if verb not in VERBS or verb not in verbs():
        print(f"bunraku: unknown verb {verb!r}{nearest(verb, verbs())}; see bunraku --help", file=sys.stderr)
        return USAGE
    module = importlib.import_module(f"bunraku.cli.{verb}")
    parser = Parser(prog=f"bunraku {verb}", description=module.__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    module.add(parser)
    try:
        args = parser.parse_intermixed_args(rest) if parser.intermixed else parser.parse_args(rest)
    except SystemExit as exit_:
        return exit_.code if isinstance(exit_.code, int) else USAGE
    args.given = rest
    try:
        return int(module.run(args) or 0)
    except SystemExit as exit_:
        return exit_.code if isinstance(exit_.code, int) else FAILURE
    except BrokenPipeError:
        raise
    except Problem as problem:
        return _say(verb, str(problem), problem.status)
    except FileNotFoundError as error:
        where = error.filename if error.filename is not None else str(error)
        return _say(verb, f"{where}: no such file; check the path", USAGE)
    except (ValueError, OSError) as error:
        if os.environ.get("BUNRAKU_TRACE"):
            raise
        status = USAGE if isinstance(error, ValueError) else FAILURE
        return _say(verb, str(error) or type(error).__name__, status)


def _say(verb: str, text: str, status: int) -> int:
    sys.stdout.flush()
    lines = [line.strip() for line in text.splitlines() if line.strip()] or ["failed"]
    for line in lines:
        print(f"bunraku {verb}: {line}", file=sys.stderr)
    return status
