"""What verbs share: the stage they speak of, tables, and JSON."""

import argparse
import json
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any


def add_stage(parser: argparse.ArgumentParser) -> None:
    """Declare ``--stage``."""
    parser.add_argument("--stage", metavar="NAME", help="the stage (default: $BUNRAKU_STAGE, else 'default')")


def add_json(parser: argparse.ArgumentParser) -> None:
    """Declare ``--json``."""
    parser.add_argument("--json", action="store_true", help="print JSON")


def folder_of(args: argparse.Namespace) -> Path:
    """The run folder that a command speaks of; everything that it starts is on the same stage."""
    from bunraku.runtime.names import run_folder

    if args.stage is not None:
        folder = run_folder(args.stage)
        os.environ["BUNRAKU_STAGE"] = args.stage
        return folder
    return run_folder()


def print_json(value: object) -> None:
    """One line of JSON."""
    print(json.dumps(value, ensure_ascii=False, default=str), flush=True)


def table(rows: Sequence[Sequence[object]], head: Sequence[str]) -> str:
    """Columns under their heads."""
    cells = [list(map(str, row)) for row in rows]
    widths = [max(len(row[k]) for row in [list(head), *cells]) for k in range(len(head))]
    lines = ["  ".join(f"{cell:{width}}" for cell, width in zip(row, widths, strict=True)) for row in [head, *cells]]
    return "\n".join(line.rstrip() for line in lines)


def print_rows(rows: Sequence[Mapping[str, Any]], keys: Sequence[str], args: argparse.Namespace, none: str) -> None:
    """A list of maps as JSON or as a table of these keys; ``none`` is said where it is empty."""
    if args.json:
        print_json(list(rows))
    elif rows:
        print(table([[_cell(row.get(key)) for key in keys] for row in rows], keys))
    else:
        print(none, file=sys.stderr)


def _cell(value: object) -> str:
    if value is None or value == "":
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (list, tuple)):
        return " ".join(map(str, value)) or "-"
    return f"{value:g}" if isinstance(value, float) else str(value)
