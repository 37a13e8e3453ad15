"""A film made live on a thread of its own: messages and ticks go in, in order, and never wait."""

import contextlib
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from bunraku.msgs import Message
from bunraku.nodes.renderer.film import SECOND, Film, Shots
from bunraku.nodes.renderer.scene import Scene, paint
from bunraku.nodes.renderer.sheet import save_picture
from bunraku.nodes.renderer.video import VideoError
from bunraku.nodes.renderer.view import Engine

LATE = SECOND // 2
"""ns that the film may lag behind the clock. For each of them more, one frame fewer is drawn of those that are
written: the film keeps its length, and the lag settles where the machine keeps up."""


@dataclass
class _Job:
    """A picture that was asked for."""

    path: Path
    now: int
    done: threading.Event = field(default_factory=threading.Event)
    error: str = ""


class Worker:
    """Draws one film after another as the stage's clock goes by.

    Args:
        open_engine: called on the thread when the first picture is due.
        failed: told one line when nothing more can be drawn.
    """

    def __init__(self, shots: Shots, open_engine: Callable[[], Engine], failed: Callable[[str], object]) -> None:
        self._open, self._failed = open_engine, failed
        self._queue: SimpleQueue[Any] = SimpleQueue()
        self._shots = shots
        self._film: Film | None = None
        self._heard: dict[str, tuple[int, Message]] = {}
        self._engine: Engine | None = None
        self.frames = self.repeated = 0
        """Frames written so far, and how many of them are the picture before."""
        self.written: list[Path] = []
        self._ticked = 0
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="film", daemon=True)
        self._thread.start()

    def feed(self, now: int, topic: str, message: Message) -> None:
        """A message was heard at ``now`` (ns)."""
        self._queue.put((now, topic, message))

    def tick(self, now: int) -> None:
        """The clock stands at ``now`` (ns): frames before it are due."""
        self._ticked = now
        self._queue.put(now)

    def change(self, shots: Shots) -> None:
        """End the film and begin another of the same performance."""
        self._queue.put(shots)

    def picture(self, path: str | Path, now: int, timeout: float = 20.0) -> None:
        """Write a picture of this moment; raises ValueError with one line where that fails."""
        job = _Job(Path(path), now)
        self._queue.put(job)
        if not job.done.wait(timeout):
            raise ValueError(f"no picture within {timeout:.0f} s")
        if job.error:
            raise ValueError(job.error)

    def close(self, timeout: float = 60.0) -> list[Path]:
        """Finish all files; says which were written."""
        self._queue.put(None)
        self._thread.join(timeout)
        return self.written

    # On the thread

    def _run(self) -> None:
        try:
            if self._films:
                self._opened()  # ready before the first picture is due
        except Exception as error:
            self._fail(error)
        while True:
            item = self._queue.get()
            try:
                if item is None:
                    break
                self._take(item)
            except Exception as error:
                if isinstance(item, _Job):
                    item.error = _line(error)
                    item.done.set()
                else:
                    self._fail(error)
        try:
            self._end()
        except Exception as error:
            self._fail(error)
        if self._engine is not None:
            with contextlib.suppress(Exception):
                self._engine.close()

    def _fail(self, error: Exception) -> None:
        """Finish what can be finished, and say once what is wrong."""
        film, self._film = self._film, None
        if film is not None:
            with contextlib.suppress(Exception):
                self.written += film.close()
        if not self._ended:
            self._ended = True
            self._failed(_line(error))

    def _take(self, item: Any) -> None:
        if isinstance(item, int):
            if self._ended:
                return
            film = self._current(item)
            if film is not None:
                due = film.due(item)
                stride = min(1 + (self._ticked - item) // LATE, self._shots.fps)
                draw = film.frames % stride == 0 or due > stride
                film.advance(item, draw=draw)
                self.frames += due
                self.repeated += due if self._shots.output and not draw else 0
        elif isinstance(item, Shots):
            self._end()
            self._shots, self._ended = item, False
        elif isinstance(item, _Job):
            self._snap(item)
        else:
            now, topic, message = item
            self._heard[topic] = (now, message)
            if self._film is not None:
                self._film.hear(topic, message)

    def _current(self, now: int) -> Film | None:
        """The film, begun as soon as there is a figure to be seen."""
        if self._film is None and self._films:
            film = Film(self._shots, self._opened())
            self._film = film
            for topic, (_, message) in self._heard.items():
                film.hear(topic, message)
        if self._film is not None and self._film.start is None and self._film.scene.ready:
            self._film.start = now
        return self._film

    @property
    def _films(self) -> bool:
        return bool(self._shots.output or self._shots.sheet or self._shots.picture)

    def _opened(self) -> Engine:
        if self._engine is None:
            self._engine = self._open()
        return self._engine

    def _snap(self, job: _Job) -> None:
        scene = Scene(self._shots.figures)
        for topic, (_, message) in self._heard.items():
            scene.hear(topic, message)
        view = scene.view(job.now)
        save_picture(paint(self._opened(), view, self._shots.width, self._shots.height), job.path)
        job.done.set()

    def _end(self) -> None:
        film, self._film = self._film, None
        if film is not None:
            self.written += film.close()


def _line(error: Exception) -> str:
    text = " ".join(str(error).split())
    return text if isinstance(error, (VideoError, ValueError, RuntimeError, OSError)) and text else repr(error)
