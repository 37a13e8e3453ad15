"""A bar on the terminal for long work; nothing where standard error is no terminal.

With BUNRAKU_PROGRESS=lines in the environment a program that started the command reads lines like ``filming 42%``.
"""

import os
import sys
import time
from types import TracebackType
from typing import Self, TextIO

WIDTH = 28
EVERY = 0.1
"""s between two drawings."""
LINES = "BUNRAKU_PROGRESS"
"""Environment: ``lines`` for a program in a person's place."""


class Progress:
    """A context manager; call it with what is done and the whole."""

    def __init__(self, what: str, stream: TextIO | None = None) -> None:
        self.what = what
        self.stream = stream or sys.stderr
        self.lines = os.environ.get(LINES) == "lines"
        self.shown = self.stream.isatty() and not self.lines
        self._drawn = False
        self._next = time.monotonic() + 2 * EVERY  # what is quick shows no bar

    def __call__(self, done: float, whole: float, note: str = "") -> None:
        """Draw the bar, if it is time."""
        now = time.monotonic()
        if not (self.shown or self.lines) or now < self._next:
            return
        self._next = now + EVERY
        share = min(max(done / whole, 0.0), 1.0) if whole > 0 else 1.0
        if self.lines:
            print(f"{self.what} {share:.0%}", file=self.stream, flush=True)
            return
        bar = "#" * round(share * WIDTH)
        self._drawn = True
        print(f"\r\x1b[K{self.what} [{bar:{WIDTH}}] {share:4.0%} {note}", end="", file=self.stream, flush=True)

    def line(self, text: str) -> None:
        """Replace the bar by a line that stays until the next drawing."""
        if self.shown:
            self._drawn = True
            print(f"\r\x1b[K{text}", end="", file=self.stream, flush=True)

    def clear(self) -> None:
        """Remove the bar."""
        if self._drawn:
            self._drawn = False
            print("\r\x1b[K", end="", file=self.stream, flush=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.clear()
