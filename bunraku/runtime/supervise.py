"""Processes: started together, watched, restarted where that is wanted, and ended in order.

Each task runs in a process group of its own, so that a Ctrl-C in the terminal reaches the launcher alone,
which then ends the tasks: INT, after their time TERM, then KILL, always the whole group. A pipe whose write
end only the launcher holds tells the tasks that it is gone, however it went (environment BUNRAKU_LAUNCHER_FD
names the read end): no orphan even after a kill -9.
"""

import contextlib
import os
import selectors
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import IO, Any, Literal, TextIO

LAUNCHER_FD = "BUNRAKU_LAUNCHER_FD"


@dataclass(frozen=True)
class Backoff:
    """When a task is started again."""

    first: float = 0.1
    """s before the first restart; each further one waits twice as long."""
    longest: float = 5.0
    """s"""
    limit: int = 5
    """Restarts in a row; the task has failed when it ends once more."""
    calm: float = 10.0
    """s that a task must have run for its restarts to be forgotten."""

    def delay(self, restarts: int) -> float:
        """s to wait after this many restarts in a row."""
        return float(min(self.longest, self.first * 2.0**restarts))


@dataclass(frozen=True)
class Task:
    """A process to run."""

    name: str
    argv: Sequence[str]
    env: Mapping[str, str] = field(default_factory=dict)
    """What its environment has besides the launcher's own."""
    respawn: bool = False
    required: bool = False
    stop: float = 5.0
    """s that it may take to end after INT."""


@dataclass(eq=False)
class _Child:
    task: Task
    color: str
    phase: Literal["waiting", "up", "ended"] = "waiting"
    process: subprocess.Popen[bytes] | None = None
    started: float = 0.0
    due: float = 0.0
    """When it is (re)started."""
    restarts: int = 0
    ready: bool = False
    pressed: int = 0
    """While ending: 1 after TERM, 2 after KILL."""
    tail: deque[str] = field(default_factory=lambda: deque(maxlen=20))
    partial: dict[int, bytes] = field(default_factory=dict)
    crash: tuple[str, list[str]] | None = None
    """How it failed last, and its last lines then."""


COLORS = ("36", "33", "35", "32", "34", "96", "93", "95", "92", "94")
TERM_AFTER = 2.0
"""s from TERM to KILL."""
LONGEST_LINE = 1 << 16


class Supervisor:
    """Runs tasks until they have ended, one of the required has, or a signal says so."""

    def __init__(
        self,
        tasks: Sequence[Task],
        *,
        out: TextIO | None = None,
        color: bool | None = None,
        backoff: Backoff | None = None,
        is_up: Callable[[Task, int], bool] | None = None,
        on_up: Callable[[float], None] | None = None,
        on_end: Callable[[int], None] | None = None,
    ) -> None:
        """``is_up(task, pid)`` is asked until all are; then ``on_up(seconds)``. ``on_end(pid)``: a process ended."""
        self.out = sys.stderr if out is None else out
        if color is None:
            color = self.out.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
        self.color = color
        self.backoff = backoff or Backoff()
        self.is_up, self.on_up, self.on_end = is_up, on_up, on_end
        self.children = [_Child(task, COLORS[k % len(COLORS)]) for k, task in enumerate(tasks)]
        self.width = max(len("launch"), *(len(task.name) for task in tasks)) if tasks else 0
        self.failure = 0
        self.stopping = 0.0
        """When the end began; 0 while running."""
        self._announced = is_up is None
        self._begun = 0.0
        self._selector = selectors.DefaultSelector()
        self._alive_read = self._alive_write = self._wake_read = self._wake_write = -1

    def run(self) -> int:
        """Start, watch and end all; the exit status is that of the first task that failed, else 0."""
        with self._pipes(), self._signals():
            self._begun = time.monotonic()
            try:
                while any(child.phase != "ended" for child in self.children):
                    self._start_due()
                    self._look_up()
                    self._press()
                    for key, _ in self._selector.select(self._patience()):
                        if key.data is None:
                            self._signalled(os.read(self._wake_read, 4096))
                        else:
                            self._read(*key.data)
                    self._reap()
            finally:
                for child in self.children:
                    if child.process is not None and child.phase == "up":
                        self._kill(child, signal.SIGKILL)
                        child.process.wait()
                        self._ended(child)
        self._report()
        return self.failure

    def stop(self) -> None:
        """Begin the end: INT to all, later TERM, then KILL."""
        if self.stopping:
            return
        self.stopping = time.monotonic()
        for child in self.children:
            if child.phase == "up":
                self._kill(child, signal.SIGINT)
            elif child.phase == "waiting":
                child.phase = "ended"

    def say(self, text: str, child: _Child | None = None) -> None:
        """Print a line: the launcher's own, or a task's with its prefix."""
        name = child.task.name if child else "launch"
        prefix = f"{name:{self.width}} | "
        if self.color:
            prefix = f"\x1b[{child.color if child else '1'}m{prefix}\x1b[0m"
        with contextlib.suppress(OSError, ValueError):  # a closed terminal is no reason to leave the nodes alone
            self.out.write(f"{prefix}{text}\n")
            self.out.flush()

    def _start_due(self) -> None:
        now = time.monotonic()
        for child in self.children:
            if child.phase == "waiting" and child.due <= now:
                self._start(child)

    def _start(self, child: _Child) -> None:
        environment = {**os.environ, "PYTHONUNBUFFERED": "1", **child.task.env, LAUNCHER_FD: str(self._alive_read)}
        try:
            child.process = subprocess.Popen(
                list(child.task.argv),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                env=environment,
                pass_fds=[self._alive_read],
                start_new_session=True,
                bufsize=0,
            )
        except OSError as error:
            child.phase = "ended"
            self._fail(child, f"cannot be started: {error}", 127)
            return
        child.phase, child.started = "up", time.monotonic()
        child.tail.clear()
        for stream in (child.process.stdout, child.process.stderr):
            assert stream is not None
            os.set_blocking(stream.fileno(), False)
            child.partial[stream.fileno()] = b""
            self._selector.register(stream, selectors.EVENT_READ, (child, stream))

    def _look_up(self) -> None:
        if self._announced or self.is_up is None or self.stopping:
            return
        for child in self.children:
            if child.phase == "up" and not child.ready and child.process is not None:
                child.ready = self.is_up(child.task, child.process.pid)
        waiting = [child for child in self.children if not child.ready and child.phase != "ended"]
        if not waiting and any(child.ready for child in self.children):
            self._announced = True
            if self.on_up is not None:
                self.on_up(time.monotonic() - self._begun)

    def _press(self) -> None:
        """While ending: TERM and KILL for those that take too long."""
        if not self.stopping:
            return
        waited = time.monotonic() - self.stopping
        for child in self.children:
            if child.phase != "up":
                continue
            if waited > child.task.stop + TERM_AFTER and child.pressed < 2:
                child.pressed = 2
                self._fail(child, f"did not end within {child.task.stop + TERM_AFTER:g} s and was killed", 137)
                self._kill(child, signal.SIGKILL)
            elif waited > child.task.stop and child.pressed < 1:
                child.pressed = 1
                self._kill(child, signal.SIGTERM)

    def _patience(self) -> float | None:
        now = time.monotonic()
        moments = [child.due - now for child in self.children if child.phase == "waiting"]
        if self.stopping:
            moments.append(0.1)
        if not self._announced and not self.stopping:
            moments.append(0.03)
        return max(0.0, min(moments)) if moments else None

    def _signalled(self, numbers: bytes) -> None:
        for number in numbers:
            if number == signal.SIGCHLD:
                continue
            if not self.stopping:
                self.say("ending (once more Ctrl-C: at once)" if number == signal.SIGINT else "ending")
                self.stop()
            elif number == signal.SIGINT:
                for child in self.children:
                    if child.phase == "up":
                        self._kill(child, signal.SIGKILL)

    def _reap(self) -> None:
        for child in self.children:
            if child.phase != "up" or child.process is None:
                continue
            # look without reaping: until then its process group's number cannot be another's
            if os.waitid(os.P_PID, child.process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None:
                continue
            self._kill(child, signal.SIGKILL)
            child.process.wait()
            self._ended(child)
            self._judge(child, child.process.returncode)

    def _ended(self, child: _Child) -> None:
        assert child.process is not None
        child.phase = "ended"
        for stream in (child.process.stdout, child.process.stderr):
            assert stream is not None
            self._read(child, stream)
            rest = child.partial.pop(stream.fileno(), b"")
            if rest:
                self._line(child, rest)
            with contextlib.suppress(KeyError):
                self._selector.unregister(stream)
            stream.close()
        if self.on_end is not None:
            self.on_end(child.process.pid)

    def _judge(self, child: _Child, code: int) -> None:
        """What follows from a task's end."""
        status = code if code >= 0 else 128 - code
        how = f"killed by {signal.Signals(-code).name}" if code < 0 else f"ended with status {code}"
        if self.stopping:
            if status not in (0, 128 + signal.SIGINT, 128 + signal.SIGTERM, 128 + signal.SIGKILL):
                self._fail(child, how, status)
            return
        again = child.task.respawn and status != 0
        if again:
            if time.monotonic() - child.started > self.backoff.calm:
                child.restarts = 0
            if child.restarts < self.backoff.limit:
                delay = self.backoff.delay(child.restarts)
                child.restarts += 1
                child.due = time.monotonic() + delay
                child.phase = "waiting"
                child.crash = (how, list(child.tail))
                limit = self.backoff.limit
                self.say(f"{how}; starting again in {delay:.1f} s ({child.restarts} of {limit})", child)
                return
            how += f"; given up after {self.backoff.limit} restarts"
        if status != 0:
            self._fail(child, how, status)
        self.say(how, child)
        unmade = status != 0 and not self._announced and not child.ready  # others may wait for it
        if (child.task.required or unmade) and any(other.phase != "ended" for other in self.children):
            why = "could not start" if unmade else "is required"
            self.say(f"{child.task.name} {why}: ending the others")
            self.stop()

    def _fail(self, child: _Child, how: str, status: int) -> None:
        child.crash = (how, list(child.tail))
        self.failure = self.failure or status

    def _report(self) -> None:
        """Repeat the last lines of what crashed."""
        for child in self.children:
            if child.crash is None:
                continue
            how, lines = child.crash
            self.say(f"{child.task.name} {how}" + ("; its last lines:" if lines else ""))
            for line in lines:
                self.say(line, child)

    def _read(self, child: _Child, stream: IO[bytes]) -> None:
        number = stream.fileno()
        while True:
            try:
                data = os.read(number, 1 << 16)
            except BlockingIOError:
                return
            if not data:
                with contextlib.suppress(KeyError):
                    self._selector.unregister(stream)
                return
            *lines, rest = (child.partial.get(number, b"") + data).split(b"\n")
            if len(rest) > LONGEST_LINE:
                lines.append(rest)
                rest = b""
            child.partial[number] = rest
            for line in lines:
                self._line(child, line)

    def _line(self, child: _Child, line: bytes) -> None:
        text = line.decode(errors="replace").rstrip("\r")
        child.tail.append(text)
        self.say(text, child)

    @staticmethod
    def _kill(child: _Child, number: signal.Signals) -> None:
        assert child.process is not None
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(child.process.pid, number)

    @contextlib.contextmanager
    def _pipes(self) -> Iterator[None]:
        self._alive_read, self._alive_write = os.pipe()
        self._wake_read, self._wake_write = os.pipe()
        os.set_blocking(self._wake_write, False)
        self._selector.register(self._wake_read, selectors.EVENT_READ, None)
        try:
            yield
        finally:
            self._selector.close()
            for number in (self._alive_read, self._alive_write, self._wake_read, self._wake_write):
                os.close(number)

    @contextlib.contextmanager
    def _signals(self) -> Iterator[None]:
        """Signals only write into the wake-up pipe."""
        wanted = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGCHLD)
        before: dict[signal.Signals, Any] = {one: signal.signal(one, lambda *_: None) for one in wanted}
        wake = signal.set_wakeup_fd(self._wake_write, warn_on_full_buffer=False)
        try:
            yield
        finally:
            signal.set_wakeup_fd(wake)
            for one, handler in before.items():
                signal.signal(one, handler)
