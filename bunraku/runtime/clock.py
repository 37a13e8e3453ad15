"""Time in ns since the Unix epoch: the machine's, or one that is told."""

import time
from typing import Protocol


class Clock(Protocol):
    """What tells a node the time."""

    def now(self) -> int:
        """ns since the Unix epoch, never less than before."""
        ...


class RealClock:
    """The machine's time, which here never goes back."""

    def __init__(self) -> None:
        self._last = 0

    def now(self) -> int:
        self._last = max(self._last + 1, time.time_ns())
        return self._last


class ToldClock:
    """Stands still until it is told: the clock of unit tests and of replay."""

    def __init__(self, now: int = 1_700_000_000_000_000_000) -> None:
        self._now = now

    def now(self) -> int:
        return self._now

    def tell(self, now: int) -> None:
        """Set the time; an earlier one than before is ignored."""
        self._now = max(self._now, now)
