"""Recordings of what flows on the stage.

bunraku bag record -o take.mcap              all topics, until Ctrl-C
bunraku bag play take.mcap --topics touch    space: pause, s: one message, + and -: rate, q: end
bunraku bag check take.mcap                  does today's code do the same?
"""

import argparse
import math
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from fnmatch import fnmatchcase

from bunraku.cli import USAGE, Problem, nearest
from bunraku.cli.output import add_json, add_stage, folder_of, print_json
from bunraku.cli.progress import Progress


def add(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    whats = parser.add_subparsers()

    def what(name: str, text: str, *, file: bool = True) -> argparse.ArgumentParser:
        one: argparse.ArgumentParser = whats.add_parser(name, help=text, description=text)
        if file:
            one.add_argument("file", metavar="FILE")
        if name != "export":
            add_json(one)
        return one

    record = what("record", "record topics into a bag until Ctrl-C", file=False)
    record.add_argument("topics", metavar="TOPIC", nargs="*", help="names or patterns such as 'alice/*' (default: all)")
    record.add_argument("-o", "--output", metavar="FILE", required=True, help="the bag to write")
    record.add_argument("--overwrite", action="store_true", help="replace a bag that exists")
    record.add_argument("--compression", choices=["zstd", "lz4", "none"], default="zstd", help="default: zstd")
    record.add_argument("--duration", type=above_zero, metavar="S", help="end after so many seconds")
    record.add_argument("--name", default="recorder", help="name of the node (default: recorder)")
    add_stage(record)

    play = what("play", "say a bag's topics again, at their moments")
    play.add_argument("--rate", type=above_zero, default=1.0, metavar="X", help="so many times as fast (default: 1)")
    play.add_argument("--start", type=float, default=0.0, metavar="S", help="begin so many seconds into the bag")
    play.add_argument("--loop", action="store_true", help="again and again")
    play.add_argument(
        "--topics",
        nargs="+",
        action="extend",
        metavar="TOPIC",
        help="names or patterns (default: all but journals, logs and parameters, which speak of processes)",
    )
    play.add_argument("--remap", nargs="+", action="extend", default=[], metavar="A:=B", help="say topic A as B")
    play.add_argument("--paused", action="store_true", help="begin paused")
    play.add_argument(
        "--wait",
        type=not_negative,
        default=5.0,
        metavar="S",
        help="wait so long for subscribers (default: 5; 0: do not)",
    )
    play.add_argument(
        "--wait-for", nargs="+", action="extend", default=[], metavar="TOPIC", help="wait for a subscriber of each"
    )
    add_stage(play)

    what("info", "duration, topics, counts, rates, gaps, size, and whether it is complete")

    recover = what("recover", "write what can be read of a broken bag as a complete one")
    recover.add_argument("-o", "--output", metavar="OUT", required=True, help="the bag to write")
    recover.add_argument("--overwrite", action="store_true", help="replace a bag that exists")

    export = what("export", "write the motion as BVH, glTF or a film, or messages as JSON lines")
    export.add_argument("--bvh", metavar="OUT", help="the figure's motion, for animation programs")
    export.add_argument("--glb", metavar="OUT", help="the moving figure with its mesh, as binary glTF 2.0")
    export.add_argument("--mp4", metavar="OUT", help="a film of what the renderer shows")
    export.add_argument(
        "--json", metavar="OUT", nargs="?", const="-", help="one JSON object a line and message (-: print)"
    )
    export.add_argument(
        "--topic", action="append", metavar="TOPIC", help="name or pattern (default: pose; film: every pose; JSON: all)"
    )
    export.add_argument("--fps", type=above_zero, default=60.0, metavar="N", help="frames a second (default: 60)")
    export.add_argument("--size", default="1280x720", metavar="WxH", help="of the film (default: 1280x720)")
    export.add_argument("--engine", choices=["auto", "gl", "pillow"], default="auto", help="what draws the film")
    export.add_argument("--overwrite", action="store_true", help="replace files that exist")

    check = what("check", "step today's code by the recorded journal and compare what it says")
    check.add_argument("--node", action="append", metavar="NODE", help="only this node (may be given again)")
    check.add_argument(
        "--tolerance",
        type=not_negative,
        metavar="X",
        help="allowed difference (default: 0 where it was recorded here, else 1e-6)",
    )


def run(args: argparse.Namespace) -> int:
    """Do what was asked."""
    from bunraku.runtime.bag import BagError

    try:
        return VERBS[args.what](args)
    except BagError as error:
        raise Problem(str(error), USAGE) from None


def above_zero(text: str) -> float:
    """A number above zero."""
    value = number(text)
    if value <= 0:
        raise argparse.ArgumentTypeError(f"{text}: give a number above 0")
    return value


def not_negative(text: str) -> float:
    """A number that is zero or more."""
    value = number(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"{text}: give 0 or more")
    return value


def number(text: str) -> float:
    """A finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} is no number")
    return value


def chosen(known: Iterable[str], wanted: Sequence[str] | None, where: str) -> list[str]:
    """Those of the known topics that the names and patterns choose (None: all); raises `Problem` where none is."""
    names = sorted(known)
    if wanted is None:
        return names
    found = [name for name in names if any(fnmatchcase(name, one) for one in wanted)]
    for one in wanted:
        if not any(fnmatchcase(name, one) for name in names):
            text = f"no topic {one!r}{nearest(one, names)} in {where}"
            if not found:
                raise Problem(f"{text} (there is: {', '.join(names) or 'nothing'})", USAGE)
            print(f"bunraku bag: {text}", file=sys.stderr)
    return found


def _info(args: argparse.Namespace) -> int:
    from bunraku.runtime.bag import Bag
    from bunraku.runtime.bag.info import describe, table

    with Bag(args.file) as bag, Progress("reading") as progress:
        info = describe(bag, progress)
    if args.json:
        print_json(info)
    else:
        print("\n".join(table(info)))
    return 0


def _recover(args: argparse.Namespace) -> int:
    from bunraku.runtime.bag.recover import recover

    with Progress("mending") as progress:
        found = recover(args.file, args.output, overwrite=args.overwrite, progress=progress)
    if args.json:
        print_json({"file": args.output, **asdict(found)})
    else:
        lost = f"; {found.damaged} damaged parts left out" if found.damaged else ""
        print(f"{args.output}: {found.messages} messages on {found.topics} topics{lost}")
    return 0


def _record(args: argparse.Namespace) -> int:
    from bunraku.cli.bag_record import record

    return record(args, folder_of(args))


def _play(args: argparse.Namespace) -> int:
    from bunraku.cli.bag_play import play

    return play(args, folder_of(args))


def _export(args: argparse.Namespace) -> int:
    from bunraku.cli.bag_export import export

    return export(args)


def _check(args: argparse.Namespace) -> int:
    from bunraku.cli.bag_check import check

    return check(args)


VERBS: dict[str, Callable[[argparse.Namespace], int]] = {
    "record": _record,
    "play": _play,
    "info": _info,
    "recover": _recover,
    "export": _export,
    "check": _check,
}
