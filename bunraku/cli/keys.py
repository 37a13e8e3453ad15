"""Write the keys that join two machines by the bridge.

  bunraku keys stage_keys               a pair for the side that listens, a pair for the side that connects
  bunraku keys stage_keys --name bob    one more pair, for one more machine that connects

Copy connect.key_secret and listen.key (nothing else) to the machine that connects.
"""

import argparse
from pathlib import Path

from bunraku.cli import USAGE, Problem
from bunraku.cli.output import add_json, print_json


def add(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("folder", metavar="DIR")
    parser.add_argument("--name", default="", help="write one more peer's pair alone")
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Write the files, mode 0600."""
    import zmq

    from bunraku.nodes.bridge.keys import CONNECT, LISTEN, KeyProblem, write_pair

    if not zmq.has("curve"):
        raise Problem("this pyzmq was built without CURVE: pip install --force-reinstall pyzmq")
    folder = Path(args.folder).expanduser()
    try:
        written = [
            path for name in ([args.name] if args.name else [LISTEN, CONNECT]) for path in write_pair(folder, name)
        ]
    except KeyProblem as error:
        raise Problem(str(error), USAGE) from None
    except NotADirectoryError:
        raise Problem(f"{folder}: not a folder; choose another", USAGE) from None
    peer = args.name or CONNECT
    if args.json:
        print_json({"files": [str(path) for path in written]})
        return 0
    for path in written:
        print(path)
    print(f"this machine:  bunraku run bridge --set listen:=0.0.0.0:7447 --set keys:={folder}")
    print(f"the other one: copy {peer}.key_secret and {LISTEN}.key there, then")
    print("               bunraku run bridge --set connect:=THIS_HOST:7447 --set keys:=DIR")
    return 0
