"""Parameters of running nodes.

bunraku param list controller
bunraku param set controller half_life 0.1
"""

import argparse
from pathlib import Path
from typing import Any

from bunraku.cli import USAGE, Problem, nearest
from bunraku.cli.output import add_json, add_stage, folder_of, print_json, print_rows


def add(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    whats = parser.add_subparsers()
    for name, text in (
        ("list", "the parameters of a node, or of all, with their limits"),
        ("get", "the value of a parameter"),
        ("set", "change a parameter while the node runs"),
    ):
        one = whats.add_parser(name, help=text, description=text)
        one.add_argument("node", metavar="NODE", nargs="?" if name == "list" else None)
        if name != "list":
            one.add_argument("key", metavar="KEY")
        if name == "set":
            one.add_argument("value", metavar="VALUE", help="as text, or JSON for a list")
        add_stage(one)
        add_json(one)


def run(args: argparse.Namespace) -> int:
    """Carry out the sub-command."""
    from bunraku.cli.answer import answering
    from bunraku.runtime import graph
    from bunraku.runtime.control import ask

    folder = folder_of(args)
    if args.what == "list":
        rows = []
        for node in [args.node] if args.node else graph.nodes(folder):
            with answering(folder, node):
                rows += _described(folder, node)
        keys = ["node", "key", "value", "type", "low", "high", "choices", "doc"]
        print_rows(rows, keys, args, f"no parameters on stage {folder.name!r}")
        return 0
    with answering(folder, args.node):
        if args.what == "set":
            values = ask(folder, args.node, "param.set", name=args.key, value=args.value)["params"]
        else:
            values = ask(folder, args.node, "param.get")["params"]
    if args.key not in values:
        has = ", ".join(values) or "none"
        raise Problem(f"{args.node}: no parameter {args.key!r}{nearest(args.key, values)} (has: {has})", USAGE)
    value = values[args.key]
    if args.json or isinstance(value, (list, dict, bool)) or value is None:
        print_json(value)
    else:
        print(value)
    return 0


def _described(folder: Path, node: str) -> list[dict[str, Any]]:
    """What the latched `params` topic of a node tells, a row a parameter."""
    import zmq

    from bunraku.msgs import InvalidMessage, Params, decode
    from bunraku.runtime.control import NoAnswer
    from bunraku.runtime.topics import TopicReader

    namespace, _, name = node.rpartition("/")
    context: zmq.Context[Any] = zmq.Context()
    reader = TopicReader(context, folder, f"{namespace}/params/{name}".removeprefix("/"))
    try:
        body = reader.receive() if reader.socket.poll(2000) else None
    finally:
        reader.close()
        context.term()
    if body is None:
        raise NoAnswer(f"node {node!r} did not tell its parameters within 2 s")
    try:
        message: Params = decode(Params, body)
    except InvalidMessage as error:
        raise NoAnswer(f"node {node!r} tells its parameters wrongly: {error}") from None
    return [
        {
            "node": node,
            "key": key,
            "value": one.value,
            "type": one.type,
            "low": one.low,
            "high": one.high,
            "choices": one.choices,
            "doc": one.doc,
        }
        for key, one in message.params.items()
    ]
