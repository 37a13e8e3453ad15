"""What flows on the stage: topics, their messages, rates, sizes and delays.

bunraku topic list
bunraku topic hz pose
bunraku topic pub camera '{"position": [0, 1, 4], "rotation": [0, 0, 0, 1], "yfov": 0.8}'
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from bunraku.cli import USAGE, Problem, nearest
from bunraku.cli.output import add_json, add_stage, folder_of, print_json, print_rows


def add(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    whats = parser.add_subparsers()

    def what(name: str, text: str, *, topic: bool = True) -> argparse.ArgumentParser:
        one: argparse.ArgumentParser = whats.add_parser(name, help=text, description=text)
        if topic:
            one.add_argument("topic", metavar="TOPIC")
        add_stage(one)
        return one

    add_json(what("list", "all topics that somebody says now", topic=False))
    add_json(what("info", "who says a topic, who hears it, and its type"))
    echo = what("echo", "print the messages, one JSON object a line")
    _limits(echo, "messages")
    add_json(echo)
    for name, text in (
        ("hz", "messages a second over a sliding window, and gaps by sequence number"),
        ("bw", "bytes a second over a sliding window"),
        ("delay", "from the device's sample to the sending (stamp - origin)"),
    ):
        one = what(name, text)
        one.add_argument("--window", type=seconds, default=5.0, metavar="S", help="seconds (default 5)")
        one.add_argument("--every", type=seconds, default=1.0, metavar="S", help="seconds between lines (default 1)")
        _limits(one, "lines")
        add_json(one)
    pub = what("pub", "be the publisher of a topic")
    pub.add_argument("message", metavar="JSON", help="the message; '-' reads one a line from standard input")
    pub.add_argument("--rate", type=seconds, metavar="HZ", help="say it again and again")
    pub.add_argument("-n", type=count, dest="count", metavar="N", help="how often (default 1; with --rate no end)")
    pub.add_argument("--no-wait", action="store_true", help="do not wait for a subscriber")


def _limits(parser: argparse.ArgumentParser, what: str) -> None:
    parser.add_argument("-n", type=count, dest="count", metavar="N", help=f"end after N {what}")
    parser.add_argument("--timeout", type=seconds, metavar="S", help="fail when nothing comes for S seconds")


def seconds(word: str) -> float:
    """A positive number."""
    value = float(word)
    if not 0 < value < 1e9:
        raise ValueError(word)
    return value


def count(word: str) -> int:
    """A positive whole number."""
    value = int(word)
    if value < 1:
        raise ValueError(word)
    return value


def run(args: argparse.Namespace) -> int:
    """Carry out the sub-command."""
    folder = folder_of(args)
    if args.what == "list":
        return _list(folder, args)
    from bunraku.runtime.names import check_topic

    check_topic(args.topic)
    if args.what == "pub":
        from bunraku.cli.publish import publish

        return publish(folder, args.topic, args.message, args.rate, args.count, wait=not args.no_wait)
    doing: dict[str, Callable[[Path, argparse.Namespace], int]] = {
        "info": _info,
        "echo": _echo,
        "hz": _watch,
        "bw": _watch,
        "delay": _watch,
    }
    try:
        return doing[args.what](folder, args)
    except KeyboardInterrupt:
        return 0  # that is how one ends looking


def _list(folder: Path, args: argparse.Namespace) -> int:
    from bunraku.runtime import graph

    rows = [one.as_dict() for one in graph.topics(folder)]
    keys = ["topic", "type", "node", "latched", "rate"]
    print_rows(rows, keys, args, f"no topics on stage {folder.name!r}: start a launch (bunraku launch --list)")
    return 0


def _info(folder: Path, args: argparse.Namespace) -> int:
    from fnmatch import fnmatchcase

    from bunraku.runtime import graph

    found = {one.name: one for one in graph.topics(folder)}
    infos = graph.infos(folder)
    heard = sorted(one["name"] for one in infos if any(fnmatchcase(args.topic, each) for each in one["hears"]))
    topic = found.get(args.topic)
    if topic is None and not heard:
        raise Problem(
            f"topic {args.topic!r}: nobody says or hears it{nearest(args.topic, found)}; see bunraku topic list",
            USAGE,
        )
    told: dict[str, Any] = topic.as_dict() if topic else {"topic": args.topic, "node": None}
    told["hears"] = heard
    if topic:
        told["socket"] = str(folder / topic.name.replace("/", "."))
    if args.json:
        print_json({**told, "schema": topic.schema if topic else None})
        return 0
    names = {"node": "said by", "hears": "heard by"}
    for key, value in told.items():
        print(f"{names.get(key, key)}: {_shown(value)}")
    for key, text in _fields(topic.schema if topic else {}):
        print(f"  {key}: {text}")
    return 0


def _shown(value: object) -> str:
    if isinstance(value, list):
        return ", ".join(value) or "nobody"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return "-" if value is None else str(value)


def _fields(schema: dict[str, Any]) -> list[tuple[str, str]]:
    """The fields of a JSON Schema in words; those of every kind for a union."""
    definitions = schema.get("$defs", {})
    names = [schema["$ref"]] if "$ref" in schema else [one.get("$ref", "") for one in schema.get("anyOf", [])]
    rows = []
    for name in names:
        body = definitions.get(name.rpartition("/")[2], {})
        head = f"{body.get('title', '')}." if len(names) > 1 else ""
        for key, one in body.get("properties", {}).items():
            rows.append((head + key, _type(one)))
    return rows


def _type(one: dict[str, Any]) -> str:
    if "anyOf" in one:
        return " or ".join(_type(each) for each in one["anyOf"])
    if "$ref" in one:
        return str(one["$ref"]).rpartition("/")[2]
    if "enum" in one or "const" in one:
        return "|".join(map(str, one.get("enum", [one.get("const")])))
    note = f" ({one['description']})" if "description" in one else ""
    return f"{one.get('type', 'any')}{note}"


def _echo(folder: Path, args: argparse.Namespace) -> int:
    from bunraku.cli.listen import bodies
    from bunraku.cli.plain import Plain

    plain = Plain(folder, args.topic)
    for number, (_, body) in enumerate(bodies(folder, args.topic, timeout=args.timeout), 1):
        assert body is not None
        print_json(plain(body))
        if number == args.count:
            break
    return 0


def _watch(folder: Path, args: argparse.Namespace) -> int:
    from bunraku.cli.listen import Window, bodies

    window = Window(args.window)
    begun, lines = time.time_ns(), 0
    for now, body in bodies(folder, args.topic, period=args.every, timeout=args.timeout):
        if body is not None:
            window.add(now, body)
            continue
        window.trim(now)
        if not window.count:
            continue
        if args.what == "hz":
            told, line = window.hz(), HZ
        elif args.what == "bw":
            told, line = window.bandwidth(now, begun), BANDWIDTH
        else:
            told, line = window.delay(), DELAY
        if args.json:
            print_json({"topic": args.topic, **told})
        elif not told["messages"]:
            print(f"{args.topic}: nothing for {args.window:g} s", flush=True)
        elif args.what == "delay" and not told["with_origin"]:
            print(f"{args.topic}: no message stems from a device's sample ({told['messages']} without)", flush=True)
        else:
            shown = {key: "-" if value is None else _number(value) for key, value in told.items()}
            print(line.format(topic=args.topic, **shown), flush=True)
        lines += 1
        if lines == args.count:
            break
    return 0


HZ = (
    "{topic}: {hz} Hz, interval {min_ms}..{max_ms} ms, {messages} messages; lost {lost} of {total}, restarts {restarts}"
)
BANDWIDTH = "{topic}: {bytes_per_s} B/s, {mean_bytes} B a message ({min_bytes}..{max_bytes}), {messages} messages"
DELAY = (
    "{topic}: input -> {topic} p50 {p50_ms} ms, p99 {p99_ms} ms, max {max_ms} ms "
    "({with_origin} of {messages} messages); "
    "{topic} -> here p50 {travel_p50_ms} ms, p99 {travel_p99_ms} ms"
)


def _number(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:.2f}" if abs(value) < 1000 else f"{value:.0f}"
