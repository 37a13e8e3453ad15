"""A node as a process: signals, the launcher's pipe, the control socket and the state file around one loop."""

import contextlib
import ctypes
import json
import logging
import os
import signal
import sys
import traceback
from pathlib import Path
from typing import Any

import msgpack
import zmq

from bunraku.runtime.lock import Lock, Taken
from bunraku.runtime.names import RECORDERS, endpoint, file_of, make_run_folder, run_folder
from bunraku.runtime.node import Node, close_log
from bunraku.runtime.params import ParamProblem
from bunraku.runtime.state import StateFile
from bunraku.runtime.topics import TopicTaken, can_receive
from bunraku.runtime.zmqstage import ZmqStage

LAUNCHER_FD = "BUNRAKU_LAUNCHER_FD"
"""Environment: the read end of a pipe whose end of file means that the launcher is gone."""
RECORDER_PATIENCE = (20.0, 1.0)
"""s that a node waits for a recorder when it begins, and when it takes up after a crash."""
SLOW = 5_000_000_000
"""ns between two full reports of an error that repeats."""


class NodeTaken(RuntimeError):
    """A node of this name runs on this stage already; one line."""


def run_node(
    node_class: type[Node],
    *,
    name: str | None = None,
    namespace: str = "",
    remap: dict[str, str] | None = None,
    params: dict[str, Any] | None = None,
    folder: Path | None = None,
    bag_clock: bool = False,
) -> int:
    """Run a node until it is told to end; gives its exit status."""
    folder = make_run_folder(folder or run_folder())
    _return_large_blocks()
    try:
        stage = ZmqStage(folder, bag_clock=bag_clock)
        try:
            return _run(stage, node_class, name, namespace, remap or {}, params or {})
        finally:
            stage.close()
    except (ParamProblem, TopicTaken, NodeTaken) as error:
        print(f"bunraku: {error}", file=sys.stderr)
        return 2
    finally:
        with contextlib.suppress(OSError):
            folder.rmdir()  # the last one out; not empty otherwise


def _run(
    stage: ZmqStage,
    node_class: type[Node],
    name: str | None,
    namespace: str,
    remap: dict[str, str],
    params: dict[str, Any],
) -> int:
    node_name = name or node_class.name
    full = f"{namespace}/{node_name}" if namespace else node_name
    control = file_of(stage.folder, full, ".ctl")
    try:
        lock = _first_lock(file_of(stage.folder, full, ".ctl.lock"))
    except Taken:
        raise NodeTaken(f"a node {full!r} runs on this stage already: end it or give this one --ns") from None
    state = StateFile(file_of(stage.folder, full, ".state"))
    socket: zmq.Socket[bytes] | None = None
    try:
        with _signals(stage):
            node = node_class(stage, name=name, namespace=namespace, remap=remap, params=params)
            _log_to_terminal(node)
            errors = _Errors(node)
            stage.on_error = errors
            stage.on_step = lambda: state.write(node.save())
            _watch_launcher(stage)
            before = state.read()
            _await_recorders(stage, node, RECORDER_PATIENCE[before is not None])
            try:
                node.start(before)
                socket = _open_control(stage, node, control, errors)  # that it is there says: set up
                if before is not None:
                    node.log.info("took up from where it was")
                while stage.status is None:
                    stage.turn(node)
            except ValueError as error:
                node.log.error("%s", error)
                stage.stop(2 if isinstance(error, ParamProblem) else 1)
            except Exception as error:
                errors(error)
                stage.stop(1)
            finally:
                try:
                    node.finish()
                finally:
                    close_log(node)
    finally:
        if socket is not None:
            socket.close()
        control.unlink(missing_ok=True)
        if stage.status in (0, None):
            state.remove()
        lock.release()
    return stage.status or 0


def _first_lock(path: Path) -> Lock:
    """Lock a file; the folder is made again if another node, ending, removed it just now."""
    while True:
        try:
            return Lock(path)
        except FileNotFoundError:
            make_run_folder(path.parent)


def _return_large_blocks() -> None:
    """Keep glibc from holding on to the memory of one oversized body for ever (M_MMAP_THRESHOLD 1 MiB)."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).mallopt(-3, 1 << 20)


class _Errors:
    """Reports what a handler raised: whole at first, in a line a second when it repeats."""

    def __init__(self, node: Node) -> None:
        self.node = node
        self._seen: dict[str, int] = {}

    def __call__(self, error: BaseException) -> None:
        where = traceback.extract_tb(error.__traceback__)
        place = f"{Path(where[-1].filename).name}:{where[-1].lineno}" if where else "?"
        now = self.node.stage.clock.now()
        if now - self._seen.get(place, 0) < SLOW:
            return
        self._seen[place] = now
        traceback.print_exception(error)
        self.node.log.error("%s at %s: %s", type(error).__name__, place, error)


class _signals(contextlib.AbstractContextManager[None]):
    """INT and TERM end the node; a wake-up descriptor makes the poller notice at once."""

    def __init__(self, stage: ZmqStage) -> None:
        self.stage = stage
        self._before: dict[int, Any] = {}
        self._wakeup = -1

    def __enter__(self) -> None:
        try:
            for number in (signal.SIGINT, signal.SIGTERM):
                self._before[number] = signal.signal(number, lambda *_: self.stage.stop(0))
            self._wakeup = signal.set_wakeup_fd(self.stage.wake_descriptor, warn_on_full_buffer=False)
        except ValueError:
            pass  # not the main thread: whoever started it ends it with stage.stop

    def __exit__(self, *_: object) -> None:
        if self._before:
            signal.set_wakeup_fd(self._wakeup)
        for number, handler in self._before.items():
            signal.signal(number, handler)


def _open_control(stage: ZmqStage, node: Node, path: Path, errors: _Errors) -> "zmq.Socket[bytes]":
    socket: zmq.Socket[bytes] = stage.context.socket(zmq.ROUTER)
    socket.setsockopt(zmq.LINGER, 200)
    socket.setsockopt(zmq.MAXMSGSIZE, 1 << 20)
    path.unlink(missing_ok=True)
    socket.bind(endpoint(path))

    def answer() -> None:
        while can_receive(socket):
            *envelope, body = socket.recv_multipart()
            try:
                wanted = msgpack.unpackb(body)
                if not isinstance(wanted, dict):
                    raise ValueError("not a map")
            except Exception as error:
                reply = {"ok": False, "error": f"a request is a MessagePack map with an 'op' ({error})"}
            else:
                try:
                    reply = node.carry_out(stage.clock.now(), {str(key): value for key, value in wanted.items()})
                except Exception as error:
                    errors(error)
                    reply = {"ok": False, "error": f"{type(error).__name__}: {error}"}
                stage.on_step()
            socket.send_multipart([*envelope, msgpack.packb(reply, default=str)])

    stage.watch(socket, answer)
    return socket


def _watch_launcher(stage: ZmqStage) -> None:
    text = os.environ.get(LAUNCHER_FD, "")
    if not text.isdigit():
        return
    descriptor = int(text)

    def notice() -> None:
        if not os.read(descriptor, 1):
            stage.unwatch(descriptor)
            stage.stop(0)

    try:
        os.fstat(descriptor)
    except OSError:
        return
    stage.watch(descriptor, notice)


def _await_recorders(stage: ZmqStage, node: Node, seconds: float) -> None:
    try:
        recorders = json.loads(os.environ.get(RECORDERS) or "{}")
    except ValueError:
        return
    recorders.pop(node.full_name, None)
    if recorders and not stage.await_ears(recorders, seconds) and stage.status is None:
        node.log.warning("begins before %s: its first messages are not recorded", ", ".join(recorders))


def _log_to_terminal(node: Node) -> None:
    handler = logging.StreamHandler(sys.stderr)
    prefix = "" if os.environ.get(LAUNCHER_FD) else f"[{node.full_name}] "
    handler.setFormatter(_LineFormat(prefix))
    node.log.addHandler(handler)
    node.log.propagate = False


class _LineFormat(logging.Formatter):
    def __init__(self, prefix: str) -> None:
        super().__init__()
        self.prefix = prefix

    def format(self, record: logging.LogRecord) -> str:
        level = "" if record.levelno <= logging.INFO else f"{record.levelname.lower()}: "
        return f"{self.prefix}{level}{record.getMessage()}"
