"""The nodes that run on the stage: bunraku node list, bunraku node info controller."""

import argparse

from bunraku.cli.output import add_json, add_stage, folder_of, print_json, print_rows


def add(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    whats = parser.add_subparsers()
    for name, text in (("list", "all nodes that run"), ("info", "what a node says, hears and has seen")):
        one = whats.add_parser(name, help=text, description=text)
        if name == "info":
            one.add_argument("node", metavar="NODE")
        add_stage(one)
        add_json(one)


def run(args: argparse.Namespace) -> int:
    """Carry out the sub-command."""
    from bunraku.cli.answer import answering
    from bunraku.runtime import graph

    folder = folder_of(args)
    if args.what == "list":
        rows = graph.infos(folder)
        for row in rows:
            row["class"] = str(row.get("class", "")).rpartition(":")[2]
            if not args.json:
                own = [f"{kind}/" for kind in ("log", "params", "journal")]
                row["says"] = [topic for topic in row["says"] if not any(f"/{each}" in f"/{topic}" for each in own)]
        keys = ["name", "class", "steps", "says", "hears"]
        print_rows(rows, keys, args, f"no nodes on stage {folder.name!r}: start a launch (bunraku launch --list)")
        return 0
    with answering(folder, args.node):
        info = graph.info(folder, args.node)
    if args.json:
        print_json(info)
        return 0
    for key, value in info.items():
        if isinstance(value, list):
            value = " ".join(map(str, value)) or "-"
        elif isinstance(value, dict):
            value = " ".join(f"{topic}={number}" for topic, number in value.items()) or "none"
        print(f"{key}: {value}")
    return 0
