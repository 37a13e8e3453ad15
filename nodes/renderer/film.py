"""A film of what flowed on the stage: frame k shows the newest of everything at start + k / fps."""

import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from bunraku.msgs import Message
from bunraku.nodes.renderer.engine import open_engine
from bunraku.nodes.renderer.scene import Scene, paint
from bunraku.nodes.renderer.sheet import Sheet, save_picture
from bunraku.nodes.renderer.video import Video
from bunraku.nodes.renderer.view import Engine, Pixels

SECOND = 1_000_000_000


@dataclass(frozen=True)
class Shots:
    """What is made of a performance; empty paths make nothing."""

    output: str | Path = ""
    """mp4."""
    sheet: str | Path = ""
    """Contact sheet, png."""
    picture: str | Path = ""
    """The last frame, png."""
    width: int = 1280
    height: int = 720
    fps: int = 60
    figures: tuple[str, ...] = ("",)
    overlays: bool = True


class Film:
    """Takes a time-ordered stream of (time, topic, message) and writes every frame that is due.

    The first frame is due when the first figure can be shown. Nothing is drawn twice: frames between which
    nothing was heard repeat the one before.

    Args:
        engine: draws the pictures; the film does not close it.
        progress: told the number of frames after each.
        shown: whether ``pixels`` is looked at between frames; else only what goes into a file is drawn.
    """

    def __init__(
        self, shots: Shots, engine: Engine, progress: Callable[[int], object] | None = None, shown: bool = False
    ) -> None:
        self.shots, self.engine = shots, engine
        self.scene = Scene(shots.figures)
        self.start: int | None = None
        self.frames = 0
        self.drawn = 0
        self.pixels: Pixels | None = None
        """The newest frame, (height, width, 4)."""
        self._progress = progress
        self._shown = shown
        self._video = Video(shots.output, shots.width, shots.height, shots.fps) if shots.output else None
        self._sheet = Sheet() if shots.sheet else None
        self._changed = True

    def feed(self, now: int, topic: str, message: Message) -> None:
        """A message was heard at ``now`` (ns); frames due before it are written first."""
        self.advance(now)
        self.hear(topic, message)
        if self.start is None and self.scene.ready:
            self.start = now

    def hear(self, topic: str, message: Message) -> None:
        """Take a message for the next frame; nothing is written."""
        if self.scene.hear(topic, message):
            self._changed = True

    def due(self, now: int) -> int:
        """Frames that are due before ``now`` (ns) and not yet written."""
        if self.start is None:
            return 0
        return max(0, -(-(now - self.start) * self.shots.fps // SECOND) - self.frames)

    def advance(self, now: int, draw: bool = True) -> None:
        """Write all frames that are due before ``now`` (ns); ``draw=False`` repeats the last picture for them."""
        for _ in range(self.due(now)):
            self.frame(draw)

    def frame(self, draw: bool = True) -> None:
        """Write the next frame."""
        if self.start is None:
            return
        kept = self._sheet is not None and self._sheet.wants
        fresh = False
        if self._video is not None or kept or self._shown:
            moving = self.scene.camera is None  # the own camera may still be on its way
            fresh = self.pixels is None or (draw and (self._changed or moving))
            if fresh:
                self._draw()
        if self._video is not None and self.pixels is not None:
            if fresh:
                self._video.write(self.pixels)
            else:
                self._video.repeat()
        if self._sheet is not None:
            if kept and self.pixels is not None:
                self._sheet.add(self.frames / self.shots.fps, self.pixels)
            else:
                self._sheet.skip()
        self.frames += 1
        if self._progress is not None:
            self._progress(self.frames)

    def _draw(self) -> None:
        now = (self.start or 0) + self.frames * SECOND // self.shots.fps
        view = self.scene.view(now)
        self.pixels = paint(self.engine, view, self.shots.width, self.shots.height, self.shots.overlays)
        self._changed = False
        self.drawn += 1

    def close(self, now: int | None = None) -> list[Path]:
        """Write the frames due until ``now`` (ns), finish all files, and say which there are."""
        if now is not None:
            self.advance(now + 1)
        if self.start is not None and self.frames == 0:
            self.frame()
        written: list[Path] = []
        if self._video is not None:
            self._video.close()
            if self._video.frames:
                written.append(self._video.path)
            self._video = None
        if self._sheet is not None and self._sheet.save(self.shots.sheet):
            written.append(Path(self.shots.sheet))
        if self.shots.picture and self.start is not None and (self._changed or self.pixels is None):
            self._draw()
        if self.shots.picture and self.pixels is not None:
            save_picture(self.pixels, self.shots.picture)
            written.append(Path(self.shots.picture))
        return written


def make_film(
    messages: Iterable[tuple[int, str, Message]],
    shots: Shots,
    *,
    engine: str = "auto",
    samples: int = 4,
    progress: Callable[[int], object] | None = None,
    say: Callable[[str], object] = lambda line: print(line, file=sys.stderr),
) -> Film:
    """Film a recording: time-ordered (time ns, topic, message). Nothing is dropped, however slow the machine.

    Returns:
        The closed film: ``frames``, ``drawn``.

    Raises:
        NoOpenGL, VideoError: one line each.
    """
    opened = open_engine(engine, samples, say)
    try:
        film = Film(shots, opened, progress)
        last: int | None = None
        for last, topic, message in messages:
            film.feed(last, topic, message)
        film.close(last)
        return film
    finally:
        opened.close()


def wanted(topics: Sequence[str], figures: Sequence[str]) -> list[str]:
    """Those of a recording's topics that a film of these figures shows."""
    from fnmatch import fnmatchcase

    patterns = Scene(figures).topics()
    return [topic for topic in topics if any(fnmatchcase(topic, pattern) for pattern in patterns)]
