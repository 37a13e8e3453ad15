"""`topic pub`: this process is the publisher of a topic."""

import contextlib
import json
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import zmq

from bunraku.cli import USAGE, Problem
from bunraku.cli.plain import message_of
from bunraku.msgs import Message, kind_of
from bunraku.runtime.names import make_run_folder
from bunraku.runtime.topics import TopicTaken, TopicWriter

PATIENCE = 2.0
"""s of waiting for a subscriber before it is said."""


def publish(folder: Path, topic: str, text: str, rate: float | None, count: int | None, *, wait: bool = True) -> int:
    """Publish a message so often; ``text`` is its JSON, or '-' for one a line on standard input."""
    first = None if text == "-" else _message(topic, text)
    kind = kind_of(topic)
    if kind is None:
        raise Problem(f"topic {topic!r} has no type", USAGE)
    make_run_folder(folder)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    context: zmq.Context[Any] = zmq.Context()
    try:
        try:
            writer = TopicWriter(context, folder, topic, kind, "topic_pub")
        except TopicTaken as error:
            raise Problem(str(error)) from None
        try:
            if wait:
                _await_subscriber(writer, topic)
            _say(writer, topic, _messages(topic, first, rate, count), rate)
        except KeyboardInterrupt:
            return 0
        finally:
            writer.close()
    finally:
        context.destroy(linger=200)
        with contextlib.suppress(OSError):
            folder.rmdir()
    return 0


def _message(topic: str, text: str) -> Message:
    try:
        value = json.loads(text)
    except ValueError as error:
        raise Problem(f"{topic}: {text[:60]!r} is no JSON: {error}", USAGE) from None
    return message_of(topic, value)


def _messages(topic: str, first: Message | None, rate: float | None, count: int | None) -> Iterator[Message]:
    if first is None:
        for number, line in enumerate(filter(str.strip, sys.stdin), 1):
            yield _message(topic, line)
            if number == count:
                return
        return
    left = count if count is not None else 1 if rate is None else -1
    while left:
        yield first
        left -= 1


def _await_subscriber(writer: TopicWriter, topic: str) -> None:
    begun, said = time.monotonic(), False
    while not writer.subscribers:
        writer.socket.poll(200)
        writer.attend()
        if not said and time.monotonic() - begun > PATIENCE:
            said = True
            print(f"waiting for a subscriber of {topic!r} (--no-wait: do not)", file=sys.stderr, flush=True)


def _say(writer: TopicWriter, topic: str, messages: Iterator[Message], rate: float | None) -> None:
    due = time.monotonic()
    for seq, message in enumerate(messages):
        if rate is not None:
            while (rest := due - time.monotonic()) > 0:
                if writer.socket.poll(int(rest * 1000)):
                    writer.attend()
                elif rest < 0.001:
                    time.sleep(rest)
            due += 1.0 / rate
        message.seq = seq
        message.stamp = time.time_ns()
        message.origin = message.stamp
        writer.attend()
        writer.send(message.encode())
