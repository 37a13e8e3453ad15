"""Recording without loss, what a killed recorder costs, and how evenly a bag is played; real processes.

    python benchmarks/bag.py [--rate 20000] [--seconds 5] [--kills 5]

Prints: the writer alone; the recorder node hearing ten topics at the asked rate and as fast as one publisher can;
the time lost by kill -9; how late `bag play` sends its messages.
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import zmq

from bunraku.msgs import Pose, TopicKind
from bunraku.runtime.bag import Bag, BagWriter
from bunraku.runtime.control import NoAnswer, ask
from bunraku.runtime.names import make_run_folder, run_folder
from bunraku.runtime.topics import TopicReader, TopicWriter

TOPICS = 10
POSES = 2000


def poses() -> list[bytes]:
    """Bodies of a moving figure of 21 joints."""
    random = np.random.default_rng(1)
    turns = np.cumsum(random.normal(0, 0.003, (POSES, 21, 4)), axis=0) + np.array([0, 0, 0, 1])
    turns /= np.linalg.norm(turns, axis=-1, keepdims=True)
    return [
        Pose(stamp=1, seq=k, skeleton="s" * 16, root=turns[k, 0, :3], rotations=turns[k]).encode() for k in range(POSES)
    ]


def body(seq: int, filler: bytes) -> bytes:
    """A message of about 420 bytes as cheap to make as can be."""
    return msgpack.packb({"stamp": time.time_ns(), "origin": None, "seq": seq, "fill": filler})


def writer_alone(folder: Path, count: int = 60_000) -> None:
    """The writer in this process."""
    bodies = poses()
    size = sum(map(len, bodies)) / len(bodies)
    print(f"writer alone, {count} poses of {size:.0f} bytes:")
    for compression in ("zstd", "lz4", "none"):
        path = folder / f"{compression}.mcap"
        worst = 0.0
        begin = time.perf_counter()
        with BagWriter(path, compression=compression) as writer:
            for number in range(count):
                before = time.perf_counter()
                writer.write("pose", number * 1_000_000, bodies[number % POSES])
                worst = max(worst, time.perf_counter() - before)
        rate = count / (time.perf_counter() - begin)
        with Bag(path) as bag:
            begin = time.perf_counter()
            read = sum(1 for _ in bag.messages())
            read_rate = read / (time.perf_counter() - begin)
        share = path.stat().st_size / (size * count)
        print(
            f"  {compression:4}  {rate:9.0f} messages/s  worst {worst * 1e3:5.2f} ms  size {share:.2f}  "
            f"read {read_rate:9.0f}/s"
        )


@contextmanager
def recorder(path: Path) -> Iterator["subprocess.Popen[bytes]"]:
    """`bunraku bag record` as a process."""
    words = [sys.executable, "-m", "bunraku.cli", "bag", "record", "-o", str(path), "--overwrite"]
    process = subprocess.Popen(words, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.wait()


def publish(rate: float, seconds: float) -> None:
    """The publisher's process: says ten topics, prints how many it said and how long it took."""
    context: zmq.Context[Any] = zmq.Context()
    folder = make_run_folder(run_folder())
    writers = [TopicWriter(context, folder, f"t{k}", TopicKind(Pose), "benchmark") for k in range(TOPICS)]
    while any(writer.subscribers == 0 for writer in writers):
        for writer in writers:
            writer.attend()
        time.sleep(0.01)
    filler = os.urandom(370)
    sent = 0
    begin = time.monotonic()
    while (elapsed := time.monotonic() - begin) < seconds:
        wanted = int(elapsed * rate) if rate else sent + 200
        for number in range(sent, wanted):
            writers[number % TOPICS].send(body(number // TOPICS, filler))
        sent = wanted
        if rate:
            time.sleep(0.001)
    print(sent, time.monotonic() - begin, flush=True)
    sys.stdin.read()  # until everything has arrived
    for writer in writers:
        writer.close()
    context.destroy(linger=0)


def publisher(rate: float, seconds: float) -> "subprocess.Popen[str]":
    """Start the publisher's process."""
    words = [sys.executable, __file__, "--publish", "--rate", str(rate), "--seconds", str(seconds)]
    return subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def arrived(folder: Path) -> int:
    """What the recorder has written so far."""
    try:
        return int(ask(folder, "recorder", "status", seconds=5.0).get("messages", 0))
    except (NoAnswer, ValueError):
        return -1


def without_loss(folder: Path, path: Path, rate: float, seconds: float) -> None:
    """Record a flood and count what is missing."""
    with recorder(path) as process:
        speaker = publisher(rate, seconds)
        assert speaker.stdout is not None
        sent, took = (float(word) for word in speaker.stdout.readline().split())
        begin = time.monotonic()
        last, since = -1, time.monotonic()
        while time.monotonic() - since < 3.0:
            if (now := arrived(folder)) != last:
                last, since = now, time.monotonic()
            elif now >= sent:
                break
            time.sleep(0.02)
        behind = since - begin
        cpu = sum(float(word) for word in Path(f"/proc/{process.pid}/stat").read_text().split()[13:15]) / os.sysconf(
            "SC_CLK_TCK"
        )
        process.send_signal(signal.SIGINT)
        process.wait()
        speaker.communicate("")
    with Bag(path) as bag:
        statistics = bag.statistics()
        got = sum(stats.count for topic, stats in statistics.items() if topic in {f"t{k}" for k in range(TOPICS)})
        gaps = sum(stats.gaps for stats in statistics.values())
    share, lost = cpu / (took + max(behind, 0.0)), int(sent) - got
    print(f"recorder, {sent / took:.0f} messages/s for {took:.1f} s on {TOPICS} topics:")
    print(f"  {int(sent)} sent, {got} recorded, lost {lost}, gaps by seq {gaps}; {share:.0%} of a core", end="")
    print(f"; {max(behind, 0.0):.2f} s behind at the end ({got / (took + max(behind, 0.0)):.0f} messages/s written)")


def killed(path: Path, times: int) -> None:
    """kill -9 while 1200 messages/s come; how much time is missing at the end."""
    lost = []
    for _ in range(times):
        with recorder(path) as process:
            speaker = publisher(1200.0, 3.0 + np.random.default_rng().random())
            assert speaker.stdout is not None
            speaker.stdout.readline()  # while it still waits for its end the last messages are fresh
            process.kill()
            at = time.time_ns()
            process.wait()
            speaker.communicate("")
        with Bag(path) as bag:
            lost.append((at - max(entry.received for entry in bag.messages({"t0", "t1"}))) / 1e9)
    print(f"kill -9, {times} times at 1200 messages/s: the last {max(lost):.3f} s missing at most", end="")
    print(f", {np.mean(lost):.3f} s on average")


def played(folder: Path, path: Path, seconds: float = 5.0) -> None:
    """Play 500 messages a second and see how late each comes after its moment."""
    count = int(500 * seconds)
    with BagWriter(path, overwrite=True) as writer:
        for number in range(count):
            at = 1_700_000_000_000_000_000 + number * 2_000_000
            writer.write("t0", at, msgpack.packb({"stamp": at, "origin": at, "seq": number}))
    context: zmq.Context[Any] = zmq.Context()
    reader = TopicReader(context, folder, "t0")
    process = subprocess.Popen([sys.executable, "-m", "bunraku.cli", "bag", "play", str(path)])
    late, first, last = [], 0, 0
    while len(late) < count and reader.socket.poll(20_000):
        while (data := reader.receive()) is not None:
            now = time.time_ns()
            late.append((now - msgpack.unpackb(data)["stamp"]) / 1e3)
            first, last = first or now, now
    process.wait()
    reader.close()
    context.destroy(linger=0)
    p50, p99, most = np.percentile(late, [50, 99, 100])
    drift = (last - first) / 1e6 - (count - 1) * 2.0
    print(
        f"bag play, 500 messages/s for {seconds:.0f} s: {len(late)} of {count} came, after their moment by "
        f"{p50:.0f} µs (median), {p99:.0f} (p99), {most:.0f} (most); drift over all {drift:+.2f} ms"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rate", type=float, default=20_000.0)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--kills", type=int, default=5)
    parser.add_argument("--publish", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.publish:
        publish(args.rate, args.seconds)
        return
    with tempfile.TemporaryDirectory() as temporary:
        os.environ["XDG_RUNTIME_DIR"] = temporary
        os.environ["BUNRAKU_STAGE"] = "b"
        folder = make_run_folder(run_folder())
        bag = Path(temporary) / "bag.mcap"
        writer_alone(Path(temporary))
        without_loss(folder, bag, args.rate, args.seconds)
        without_loss(folder, bag, 0.0, args.seconds)
        make_run_folder(run_folder())
        killed(bag, args.kills)
        make_run_folder(run_folder())
        played(folder, bag)


if __name__ == "__main__":
    main()
