"""Asking a node something: the other end of its control socket."""

from pathlib import Path
from typing import Any

import msgpack
import zmq

from bunraku.runtime.names import endpoint, file_of


class NoAnswer(RuntimeError):
    """The node is not there or did not answer; one line."""


def ask(folder: Path, node: str, operation: str, *, seconds: float = 2.0, **arguments: Any) -> dict[str, Any]:
    """Send one control request and wait for the reply.

    Raises `NoAnswer` when there is none in time and ValueError when the node refuses.
    """
    path = file_of(folder, node, ".ctl")
    if not path.exists():
        raise NoAnswer(f"no node {node!r} on this stage ({folder}): see `bunraku node list`")
    context: zmq.Context[Any] = zmq.Context()
    socket: zmq.Socket[bytes] = context.socket(zmq.DEALER)
    socket.setsockopt(zmq.LINGER, 0)
    try:
        socket.connect(endpoint(path))
        socket.send(msgpack.packb({"op": operation, **arguments}))
        if not socket.poll(round(seconds * 1000)):
            raise NoAnswer(f"node {node!r} did not answer within {seconds:g} s")
        reply = msgpack.unpackb(socket.recv())
    finally:
        socket.close()
        context.term()
    if not reply.get("ok"):
        raise ValueError(reply.get("error", "refused"))
    return dict(reply)
