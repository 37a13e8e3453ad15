"""Latency of a chain of node processes beside a chain of bare pyzmq processes of as many hops, in one run.

    python benchmarks/hops.py [--hops 3] [--hz 120] [--seconds 10]

Source -> `hops` relays -> sink; every relay publishes on receipt. The two chains run at the same time and the
source alternates between them, so that the machine's noise falls on both. Times are one way, source to sink.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from typing import Any

import msgpack
import numpy as np
import zmq

from bunraku.msgs import Target
from bunraku.runtime.names import endpoint, file_of, make_run_folder, run_folder
from bunraku.runtime.node import Node, Publisher, subscribe


class Relay(Node):
    """Says what it hears."""

    name = "relay"
    out = Publisher("said", Target)

    @subscribe("heard", Target)
    def on_heard(self, msg: Target) -> None:
        self.out.publish(Target(pelvis=msg.pelvis))


def run_relay(index: int) -> int:
    from bunraku.runtime.loop import run_node

    return run_node(Relay, name=f"relay{index}", remap={"heard": f"hop{index}", "said": f"hop{index + 1}"})


def run_bare(index: int) -> int:
    """The least that such a process can do: receive, decode, encode, send."""
    context: zmq.Context[Any] = zmq.Context()
    folder = run_folder()
    hear, say = context.socket(zmq.SUB), context.socket(zmq.PUB)
    hear.setsockopt(zmq.RECONNECT_IVL, 20)
    hear.subscribe(b"")
    say.bind(endpoint(file_of(folder, f"bare{index + 1}")))
    hear.connect(endpoint(file_of(folder, f"bare{index}")))
    while True:
        say.send(msgpack.packb(msgpack.unpackb(hear.recv())))


def measure(hops: int, hz: float, seconds: float) -> dict[str, list[float]]:
    """Latencies in µs of both chains."""
    folder = make_run_folder(run_folder())
    context: zmq.Context[Any] = zmq.Context()
    ends: dict[str, tuple[Any, Any]] = {}
    children = []
    for kind, topic in (("bare", "bare"), ("node", "hop")):
        say, hear = context.socket(zmq.XPUB), context.socket(zmq.SUB)
        hear.setsockopt(zmq.RECONNECT_IVL, 20)
        hear.subscribe(b"")
        say.bind(endpoint(file_of(folder, f"{topic}0")))
        hear.connect(endpoint(file_of(folder, f"{topic}{hops}")))
        ends[kind] = say, hear
        for index in range(hops):
            children.append(subprocess.Popen([sys.executable, __file__, f"--{kind}", str(index)]))
    latencies: dict[str, list[float]] = {"bare": [], "node": []}
    try:
        for say, hear in ends.values():  # until the first message comes through the whole chain
            while not hear.poll(20):
                say.send(Target(pelvis=(0.0, 1.0, 0.0)).encode())
            while hear.poll(200):
                hear.recv()
        due = time.perf_counter()
        for count in range(round(seconds * hz)):
            kind = ("bare", "node")[count % 2]
            say, hear = ends[kind]
            due += 1.0 / hz
            time.sleep(max(0.0, due - time.perf_counter()))
            start = time.perf_counter_ns()
            say.send(Target(pelvis=(0.0, 1.0, 0.0), origin=time.time_ns()).encode())
            if hear.poll(1000):
                hear.recv()
                latencies[kind].append((time.perf_counter_ns() - start) / 1e3)
    finally:
        for child in children:
            child.terminate()
        for child in children:
            child.wait()
        context.destroy(linger=0)
    return latencies


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hops", type=int, default=3)
    parser.add_argument("--hz", type=float, default=120.0)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--node", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--bare", type=int, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.node is not None:
        sys.exit(run_relay(args.node))
    if args.bare is not None:
        sys.exit(run_bare(args.bare))
    with tempfile.TemporaryDirectory() as place:
        os.environ |= {"XDG_RUNTIME_DIR": place, "BUNRAKU_STAGE": "b"}
        latencies = measure(args.hops, args.hz, args.seconds)
    print(f"{args.hops} relays, {args.hops + 1} hops, {args.hz:g} messages/s, µs one way")
    rows = {kind: np.percentile(values, [50, 90, 99]) for kind, values in latencies.items()}
    for kind, row in rows.items():
        print(
            f"  {kind}   p50 {row[0]:7.0f}   p90 {row[1]:7.0f}   p99 {row[2]:7.0f}   ({len(latencies[kind])} messages)"
        )
    ratio = rows["node"] / rows["bare"]
    print(f"  ratio  p50 {ratio[0]:7.2f}   p90 {ratio[1]:7.2f}   p99 {ratio[2]:7.2f}")


if __name__ == "__main__":
    main()
