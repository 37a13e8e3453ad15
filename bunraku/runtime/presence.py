"""Whether those who said something are still there: what a node draws for others goes when they go."""

from pathlib import Path

from bunraku.runtime.lock import is_taken
from bunraku.runtime.names import file_of
from bunraku.runtime.topics import read_card

UNKNOWN = 0


class Presence:
    """Notices that the publisher of a topic has ended, or that another has taken its place and is silent.

    A publisher is known by its process; one that begins anew counts its messages from the beginning.
    """

    def __init__(self, folder: Path | None) -> None:
        """``folder``: the stage's run folder; without one nobody ever goes."""
        self.folder = folder
        self._pids: dict[str, int] = {}
        self._seqs: dict[str, int] = {}

    def heard(self, topic: str, seq: int) -> None:
        """A message came."""
        if topic not in self._pids or seq <= self._seqs[topic]:
            self._pids[topic] = UNKNOWN
        self._seqs[topic] = seq

    def gone(self) -> list[str]:
        """The topics that were heard and whose publisher is there no more; each is told once."""
        if self.folder is None:
            return []
        left = []
        for topic, known in list(self._pids.items()):
            pid = self._publisher(self.folder, topic)
            if pid == UNKNOWN or known not in (UNKNOWN, pid):
                left.append(topic)
                del self._pids[topic], self._seqs[topic]
            else:
                self._pids[topic] = pid
        return left

    @staticmethod
    def _publisher(folder: Path, topic: str) -> int:
        pid = int(read_card(folder, topic).get("pid", UNKNOWN))
        return pid if pid != UNKNOWN and is_taken(file_of(folder, topic, ".lock")) else UNKNOWN
