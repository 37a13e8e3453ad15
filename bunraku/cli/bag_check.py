"""`bag check`: each node stepped in a process that computes as the recorded one did, compiled or not."""

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from bunraku.cli import FAILURE, USAGE, Problem, nearest
from bunraku.cli.output import print_json
from bunraku.cli.progress import Progress


def check(args: argparse.Namespace) -> int:
    """Compare and tell; status 1 where something differs or cannot be followed."""
    chosen_jit = "BUNRAKU_JIT" in os.environ or os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")
    if not chosen_jit:
        os.environ["BUNRAKU_JIT"] = "0"  # until it is known who computes compiled
    from bunraku.runtime.bag import Bag
    from bunraku.runtime.bag import check as checking

    with Bag(args.file) as bag:
        with Progress("reading") as progress:
            journals = checking.Journals(bag, progress)
        nodes = _nodes(sorted(journals.topics), args.node, args.file)
        allowed = checking.tolerance(bag) if args.tolerance is None else args.tolerance
        compiled = [] if chosen_jit else [node for node in nodes if journals.compiled(node)]
        plain = [node for node in nodes if node not in compiled]
        with Progress("stepping") as progress:
            results = [
                asdict(one) | {"passed": one.passed}
                for one in checking.check(
                    journals, plain, allowed, progress=lambda node, done, whole: progress(done, whole, node)
                )
            ]
        results += _elsewhere(args, compiled, allowed)
        results.sort(key=lambda one: str(one["node"]))
        here = checking.tolerance(bag) == 0.0
    passed = all(one["passed"] for one in results) and any(one["compared"] for one in results)
    told = {"file": args.file, "passed": passed, "tolerance": allowed, "recorded_here": here, "nodes": results}
    if args.json:
        print_json(told)
    else:
        _print(told)
    return 0 if passed else FAILURE


def _nodes(known: Sequence[str], wanted: Sequence[str] | None, where: str) -> list[str]:
    if not known:
        raise Problem(f"{where} holds no journal: record all topics to be able to check", USAGE)
    for node in wanted or ():
        if node not in known:
            raise Problem(
                f"no journal of node {node!r}{nearest(node, known)} in {where} (there is: {', '.join(known)})", USAGE
            )
    return list(dict.fromkeys(wanted)) if wanted else list(known)


def _elsewhere(args: argparse.Namespace, nodes: Sequence[str], allowed: float) -> list[dict[str, Any]]:
    """Check some nodes in a process that compiles the kernels."""
    if not nodes:
        return []
    words = [sys.executable, "-m", "bunraku.cli", "bag", "check", args.file, "--json", "--tolerance", repr(allowed)]
    for node in nodes:
        words += ["--node", node]
    environment = {**os.environ, "BUNRAKU_JIT": "1"}
    done = subprocess.run(words, env=environment, stdout=subprocess.PIPE, text=True, check=False)
    try:
        return list(json.loads(done.stdout)["nodes"])
    except (ValueError, KeyError):
        raise Problem(f"the check of {', '.join(nodes)} ended with status {done.returncode}", FAILURE) from None


def _print(told: dict[str, Any]) -> None:
    exact = told["tolerance"] == 0.0
    for one in told["nodes"]:
        head = f"{one['node']}: "
        if one["skipped"]:
            print(f"{head}not stepped: {one['skipped']}")
            continue
        starts = f" in {one['starts']} lives" if one["starts"] > 1 else ""
        text = f"{head}{one['steps']} steps{starts}, {one['compared']} messages compared: "
        if one["problem"]:
            print(f"{text}cannot be followed {one['problem']}")
        if one["first"] is not None:
            first = one["first"]
            field = f" {first['field']}" if first["field"] else ""
            verdict = "different" if one["beyond"] else "equal within the tolerance"
            print(
                f"{text}{verdict}: {one['beyond'] or one['different']} messages, first at {first['time']:.3f} s: "
                f"{first['topic']} seq {first['seq']}{field} {first['text']}; largest difference {one['largest']:.3g}"
            )
        elif not one["problem"]:
            print(f"{text}equal to the last bit" if one["compared"] else f"{text}nothing that it says was recorded")
        if one["unrecorded"]:
            print(f"{'':{len(head)}}{one['unrecorded']} of its messages are not in the bag")
    if not exact:
        why = "recorded on another processor or build" if not told["recorded_here"] else "as asked"
        print(f"tolerance {told['tolerance']:g}: {why}")
    if not any(one["compared"] for one in told["nodes"]):
        print("nothing was compared: record a node that can be stepped, and what it says")
    print("the same" if told["passed"] else "NOT the same")
