"""Mending a bag: what can be read of it, written as a complete file."""

import os
from dataclasses import dataclass
from pathlib import Path

from bunraku.runtime.bag.format import BagError
from bunraku.runtime.bag.reader import Bag, Progress
from bunraku.runtime.bag.writer import BagWriter


@dataclass(frozen=True)
class Recovered:
    """What a recovery kept."""

    messages: int
    topics: int
    damaged: int
    """Parts of the file that could not be unpacked."""
    was_complete: bool


def recover(
    source: str | Path, output: str | Path, *, overwrite: bool = False, progress: Progress | None = None
) -> Recovered:
    """Write every message that can be read of ``source`` into a new bag; raises `BagError`."""
    with Bag(source) as bag:
        if Path(output).exists() and os.path.samefile(source, output):
            raise BagError(f"{output} is the bag itself: give another name to the mended one")
        session = {**bag.session, "recovered_from": bag.path.name}
        with BagWriter(output, overwrite=overwrite, session=session) as writer:
            for channel in bag.channels.values():
                writer.add_channel(channel)
            for entry in bag.messages(progress=progress):
                writer.write(*entry)
        return Recovered(writer.count, len(writer.stats), bag.damaged, bag.complete)
