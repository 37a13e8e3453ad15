"""`bag play`: a bag's topics on the stage again, with keys where there is a terminal."""

import argparse
import contextlib
import os
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from bunraku.cli import FAILURE, USAGE, Problem
from bunraku.cli.bag import chosen
from bunraku.cli.output import print_json
from bunraku.cli.progress import Progress
from bunraku.cli.run import pairs
from bunraku.runtime.bag import Bag
from bunraku.runtime.bag.broadcast import Broadcast
from bunraku.runtime.bag.format import NS, kind_for
from bunraku.runtime.bag.player import Player
from bunraku.runtime.loop import LAUNCHER_FD
from bunraku.runtime.names import NameProblem, check_topic
from bunraku.runtime.plan import OWN, expected_subscribers
from bunraku.runtime.topics import TopicTaken

LOOK_EVERY = 0.1
"""s between two looks at the keys and the line on the terminal."""
FASTER = 2**0.25
"""The rate's change at a key."""


def play(args: argparse.Namespace, folder: Path) -> int:
    """Play to the end, or until told to stop; gives the exit status."""
    with Bag(args.file) as bag:
        channels = bag.channels
        speaking = {topic for topic in channels if topic.split("/")[-2:-1] and topic.split("/")[-2] in OWN}
        topics = sorted(channels.keys() - speaking) if args.topics is None else chosen(channels, args.topics, args.file)
        if not topics:
            raise Problem(f"{args.file}: no topics to play; see bunraku bag info {args.file}", USAGE)
        names = _names(topics, pairs(args.remap, "--remap"), args.file)
        kinds = {names[topic]: kind_for(channels[topic]) for topic in topics}
        status = 0
        latched = [topic for topic in topics if channels[topic].latched]
        try:
            with Broadcast(folder, kinds, "bag_play") as broadcast, _ending():
                player = Player(
                    bag,
                    lambda topic, body: broadcast.send(names[topic], body),
                    rate=args.rate,
                    start=args.start,
                    loop=args.loop,
                    topics=set(topics),
                    latched=latched,
                )
                status = _play(args, player, broadcast)
        except TopicTaken as error:
            raise Problem(f"{error} (or choose others with --topics)", FAILURE) from None
        if args.json:
            print_json({"file": args.file, "messages": player.sent, "topics": len(topics), "rounds": player.rounds})
        return status


def _names(topics: list[str], remap: dict[str, str], where: str) -> dict[str, str]:
    """Topic of the bag -> name that it is said under."""
    for one in remap:
        if one not in topics:
            raise Problem(f"--remap {one}: no such topic is played from {where}", USAGE)
    names = {topic: remap.get(topic, topic).removeprefix("/") for topic in topics}
    for topic, name in names.items():
        try:
            check_topic(name)
        except NameProblem as error:
            raise Problem(f"{topic}: {error}", USAGE) from None
    if len(set(names.values())) < len(names):
        twice = next(name for name in names.values() if list(names.values()).count(name) > 1)
        raise Problem(f"--remap: two topics would be said as {twice!r}", USAGE)
    return names


def _play(args: argparse.Namespace, player: Player, broadcast: Broadcast) -> int:
    expected = {topic: count for topic in broadcast.writers if (count := expected_subscribers(topic))}
    if args.wait_for:
        wanted = chosen(broadcast.writers, args.wait_for, f"what is played from {args.file}")
        expected = {topic: max(1, expected.get(topic, 0)) for topic in wanted}
    with Progress("playing") as progress, _Keys(broadcast) as keys:
        progress.line("waiting for subscribers …")
        lacking = broadcast.await_subscribers(expected, args.wait) if args.wait else {}
        progress.clear()
        if args.wait_for and lacking:
            raise Problem(f"nobody listens to {', '.join(sorted(lacking))} after {args.wait:g} s", FAILURE)
        if lacking:
            who = ", ".join(sorted(lacking)) if "" not in lacking else "any of its topics"
            print(f"bunraku bag: nobody listens to {who} yet: playing all the same", file=sys.stderr)
        base = time.time_ns() - time.monotonic_ns()  # no jump of the machine's time moves a deadline
        player.start(base + time.monotonic_ns())
        if args.paused:
            player.pause(base + time.monotonic_ns())
        look = 0.0
        while True:
            player.play(base + time.monotonic_ns())
            if player.done:
                return 0
            due = player.due()
            wait = LOOK_EVERY if due is None else min(max((due - (base + time.monotonic_ns())) / NS, 0.0), LOOK_EVERY)
            if broadcast.wait(wait) and not keys.serve(player, base + time.monotonic_ns()):
                return 0
            if time.monotonic() >= look:
                look = time.monotonic() + LOOK_EVERY
                progress.line(_line(player, base + time.monotonic_ns(), keys.active))


def _line(player: Player, now: int, keys: bool) -> str:
    at, length = (player.position(now) - player.bag.start) / NS, (player.end - player.bag.start) / NS  # type: ignore[operator]
    state = "paused " if player.paused_at is not None else "playing"
    hint = "  (space s + - q)" if keys else ""
    return f"{state} {at:7.2f} of {length:.2f} s  x{player.rate:.2f}  {player.sent} messages{hint}"


class _Keys(contextlib.AbstractContextManager["_Keys"]):
    """Single keys from the terminal, and the launcher's pipe, whose end means that the launcher is gone."""

    def __init__(self, broadcast: Broadcast) -> None:
        self.broadcast = broadcast
        self.active = sys.stdin is not None and sys.stdin.isatty() and sys.stderr.isatty()
        text = os.environ.get(LAUNCHER_FD, "")
        self.launcher = int(text) if text.isdigit() else None

    def __enter__(self) -> "_Keys":
        if self.launcher is not None:
            try:
                os.fstat(self.launcher)
                self.broadcast.watch(self.launcher)
            except OSError:
                self.launcher = None
        if self.active:
            import termios
            import tty

            self._before = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
            self.broadcast.watch(sys.stdin.fileno())
        return self

    def __exit__(self, *failure: object) -> None:
        if self.active:
            import termios

            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)

    def serve(self, player: Player, now: int) -> bool:
        """Act on what was pressed; False to end."""
        if self.launcher is not None and _ready(self.launcher) and not os.read(self.launcher, 1):
            return False
        if self.active and _ready(sys.stdin.fileno()):
            pressed = os.read(sys.stdin.fileno(), 64)
            if not pressed:
                self.broadcast.unwatch(sys.stdin.fileno())
            for key in pressed.decode("latin-1"):
                if key == "q":
                    return False
                if key == " " and player.paused_at is None:
                    player.pause(now)
                elif key == " ":
                    player.resume(now)
                elif key == "s":
                    player.step(now)
                elif key in "+=":
                    player.set_rate(player.rate * FASTER, now)
                elif key == "-":
                    player.set_rate(player.rate / FASTER, now)
        return True


def _ready(descriptor: int) -> bool:
    import select

    return bool(select.select([descriptor], [], [], 0)[0])


@contextlib.contextmanager
def _ending() -> Iterator[None]:
    """INT and TERM end the playing in order."""

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    except KeyboardInterrupt:
        pass
    finally:
        signal.signal(signal.SIGTERM, before)
