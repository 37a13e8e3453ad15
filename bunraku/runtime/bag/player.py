"""Playing a bag against a clock: what is due when, without sockets or terminals."""

from collections.abc import Callable, Collection, Iterator
from itertools import chain

from bunraku.runtime.bag.format import NS, Entry, shifted
from bunraku.runtime.bag.reader import Bag

Send = Callable[[str, bytes], None]
MOST_AT_ONCE = 1000
"""Messages sent in one call of `play`, so that keys are heard in between."""

SHORTEST_ROUND = NS // 100
"""ns: a loop lasts at least so long, also over a single message."""


class Player:
    """Sends messages at the moments at which they were received, counted from one fixed moment.

    So it never drifts. `stamp` and `origin` move by the same offset to the present, so that latencies stay what they
    were; `seq` stays. All times are ns of one clock that the caller reads (a test tells it).
    """

    def __init__(
        self,
        bag: Bag,
        send: Send,
        *,
        rate: float = 1.0,
        start: float = 0.0,
        loop: bool = False,
        topics: Collection[str] | None = None,
        latched: Collection[str] = (),
    ) -> None:
        """Play from ``start`` s after the beginning; of ``latched`` topics what was said before that is sent first.

        Raises ValueError for a rate that is not above 0 and a start that is not in the bag.
        """
        if not 0.01 <= rate <= 100:
            raise ValueError(f"rate {rate:g}: use 0.01 to 100")
        if bag.start is None or bag.end is None:
            raise ValueError(f"{bag.path} holds no messages")
        length = (bag.end - bag.start) / NS
        if not 0 <= start <= length:
            raise ValueError(f"start {start:g} s is not in the bag, which lasts {length:.2f} s")
        self.bag, self.send, self.rate, self.loop = bag, send, rate, loop
        self.begin, self.end = bag.start + round(start * NS), bag.end
        self.topics = topics
        self.latched = [topic for topic in latched if topics is None or topic in topics]
        self.sent = 0
        self.rounds = 0
        """How often the end was reached."""
        self.paused_at: int | None = None
        self._anchor_bag = self.begin
        self._anchor_now = 0
        self._entries: Iterator[Entry] = iter(())
        self._next: Entry | None = None

    def start(self, now: int) -> None:
        """Begin at this moment."""
        self._rewind()
        self._anchor_now = now

    def due(self) -> int | None:
        """When the next message is to be sent; None when paused or at the end."""
        if self._next is None or self.paused_at is not None:
            return None
        return self._moment(self._next.received)

    @property
    def done(self) -> bool:
        """Whether all has been sent."""
        return self._next is None

    def play(self, now: int) -> int:
        """Send what is due; tells how many messages that were."""
        count = 0
        while count < MOST_AT_ONCE and (due := self.due()) is not None and due <= now:
            self._send_next(due)
            count += 1
        return count

    def step(self, now: int) -> Entry | None:
        """While paused: send the next message at once. Tells which."""
        entry = self._next
        if entry is None:
            return None
        if self.paused_at is None:
            self.pause(now)
        self._anchor_bag, self._anchor_now = entry.received, now
        self.paused_at = now
        self._send_next(now)
        return entry

    def pause(self, now: int) -> None:
        """Hold; the time until the next message stands still."""
        if self.paused_at is None:
            self.paused_at = now

    def resume(self, now: int) -> None:
        """Go on: what was due in a moment is due in that moment from now, without a jump."""
        if self.paused_at is not None:
            self._anchor_now += now - self.paused_at
            self.paused_at = None

    def set_rate(self, rate: float, now: int) -> None:
        """Play faster or slower from here."""
        at = self.paused_at if self.paused_at is not None else now
        here = self.position(at)
        self._anchor_bag, self._anchor_now = here, at
        self.rate = min(max(rate, 0.01), 100.0)

    def position(self, now: int) -> int:
        """The moment of the bag (ns) that is played at this moment."""
        at = self.paused_at if self.paused_at is not None else now
        here = self._anchor_bag + round((at - self._anchor_now) * self.rate)
        return min(max(here, self.begin), self.end)

    def _moment(self, received: int) -> int:
        return self._anchor_now + round((received - self._anchor_bag) / self.rate)

    def _send_next(self, at: int) -> None:
        entry = self._next
        assert entry is not None
        self.send(entry.topic, shifted(entry.body, at - entry.received))
        self.sent += 1
        self._next = next(self._entries, None)
        if self._next is None:
            self.rounds += 1
            if self.loop and self.sent:
                self._anchor_now = self._moment(max(self.end, self.begin + SHORTEST_ROUND))
                self._rewind()

    def _rewind(self) -> None:
        before = self._before_start()
        self._entries = chain(before, self.bag.messages(self.topics, start=self.begin))
        self._next = next(self._entries, None)
        self._anchor_bag = self.begin

    def _before_start(self) -> list[Entry]:
        """The newest message of each latched topic from before the start, as if received at the start."""
        if self.begin == self.bag.start or not self.latched:
            return []
        newest = {entry.topic: entry for entry in self.bag.messages(set(self.latched), end=self.begin)}
        return [entry._replace(received=self.begin) for entry in newest.values()]
