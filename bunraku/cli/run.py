"""Run one node in this process.

bunraku run controller --set half_life:=0.1 --remap pose:=puppet --ns alice
"""

import argparse
import os
import sys

from bunraku.cli import USAGE, Problem
from bunraku.cli.output import add_stage, folder_of


def add(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("node", metavar="NODE", nargs="?", help="its name (--list shows all) or module:Class")
    parser.add_argument("--set", action="append", default=[], metavar="KEY:=VALUE", help="a parameter")
    parser.add_argument("--remap", action="append", default=[], metavar="A:=B", help="say or hear topic A as B")
    parser.add_argument("--ns", default="", metavar="NAME", help="namespace of its topics")
    parser.add_argument("--name", help="name that it runs under")
    parser.add_argument("--list", action="store_true", help="list the nodes")
    parser.add_argument("--params", action="store_true", help="list the node's parameters")
    parser.add_argument("--json", action="store_true", help="print the lists as JSON")
    parser.add_argument("--clock", action="store_true", help="take the time from the `clock` topic of a replay")
    add_stage(parser)


def run(args: argparse.Namespace) -> int:
    """Run the node until it is told to end."""
    if args.list:
        return _list(args)
    if not args.node:
        raise Problem("name a NODE; bunraku run --list shows all", USAGE)
    folder = folder_of(args)
    chosen = "BUNRAKU_JIT" in os.environ or os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")
    if not chosen:
        os.environ["BUNRAKU_JIT"] = "0"  # until the class says that it computes poses at rate
    from bunraku.runtime import plan
    from bunraku.runtime.loop import run_node

    node = plan.load(args.node)
    if args.params:
        return _params(args)
    if not chosen and node.jit:
        os.environ["BUNRAKU_JIT"] = "1"
        os.execv(sys.executable, [sys.executable, "-m", "bunraku.cli", "run", *args.given])
    return run_node(
        node,
        name=args.name,
        namespace=args.ns,
        remap=pairs(args.remap, "--remap"),
        params=dict(pairs(args.set, "--set")),
        folder=folder,
        bag_clock=args.clock,
    )


def pairs(words: list[str], option: str) -> dict[str, str]:
    """``KEY:=VALUE`` words as a map."""
    found = {}
    for word in words:
        key, sign, value = word.partition(":=")
        if not sign or not key:
            raise Problem(f"{option} {word!r}: write name:=value", USAGE)
        found[key] = value
    return found


def _list(args: argparse.Namespace) -> int:
    os.environ.setdefault("BUNRAKU_JIT", "0")
    from bunraku.cli.output import print_rows
    from bunraku.runtime import plan

    rows = []
    for name, path in sorted(plan.table().items()):
        doc = (plan.load(name).__doc__ or "").strip().partition("\n")[0]
        rows.append({"node": name, "class": path, "doc": doc})
    print_rows(rows, ["node", "doc"], args, "no nodes")
    return 0


def _params(args: argparse.Namespace) -> int:
    from bunraku.cli.output import print_rows
    from bunraku.runtime import plan
    from bunraku.runtime.params import params_of

    rows = []
    for name, one in params_of(plan.load(args.node)).items():
        described = one.describe(one.default)
        limits = {"low": described.low, "high": described.high, "choices": described.choices}
        rows.append({"name": name, "type": described.type, "default": one.default, **limits, "doc": described.doc})
    print_rows(rows, ["name", "type", "default", "low", "high", "choices", "doc"], args, "no parameters")
    return 0
