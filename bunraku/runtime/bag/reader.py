"""Reading a bag: a complete one by its index, and what a killed recorder left behind as it is."""

import bisect
import io
import json
import struct
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import FOOTER_SIZE, SeekingReader
from mcap.records import Channel as ChannelRecord
from mcap.records import Chunk, Header, Message, Metadata, Schema
from mcap.stream_reader import MAGIC_SIZE, StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC

from bunraku.msgs.topics import kind_of
from bunraku.runtime.bag.format import SESSION, STATISTICS, BagError, Channel, Entry, TopicStats, header

LARGEST_CHUNK = 1 << 30
"""Bytes: a chunk that says it unpacks to more is taken for damaged."""
DAMAGE = (McapError, OSError, ValueError, KeyError, EOFError, struct.error, RuntimeError, OverflowError, MemoryError)
"""What the libraries raise on bytes that are no bag; the errors of the unpackers are added at their first use."""

RECORD = struct.Struct("<BQ")
"""What each record begins with: opcode and length."""
KEPT = (Opcode.MESSAGE, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA)

Progress = Callable[[int, int], None]
"""Called with bytes read and bytes in all."""


@dataclass(frozen=True)
class _Part:
    """One chunk of the file, or one run of messages outside of chunks."""

    offset: int
    start: int
    end: int
    loose: tuple[Message, ...] = ()


class Bag:
    """A recording, read by topic and time.

    `complete` is False for the remains of a killed recorder: all whole chunks are read. Damaged chunks are left
    out and counted in `damaged`. A context manager.
    """

    def __init__(self, path: str | Path) -> None:
        """Open the file; raises `BagError` where it cannot be read or is no bag."""
        self.path = Path(path)
        self.complete = False
        self._damaged: set[int] = set()
        self.metadata: dict[str, dict[str, str]] = {}
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, ChannelRecord] = {}
        self._parts: list[_Part] = []
        self._all_channels_known = False
        try:
            self._file = self.path.open("rb")
            self.size = self.path.stat().st_size
            if not self.path.is_file():
                raise BagError(f"{path} is not a file")
        except FileNotFoundError:
            raise BagError(f"{path} does not exist") from None
        except OSError as error:
            raise BagError(f"{path} cannot be read: {error.strerror}") from None
        try:
            self._open()
        except BaseException:
            self._file.close()
            raise

    def _open(self) -> None:
        if self.size == 0:
            raise BagError(f"{self.path} is empty: nothing was recorded")
        try:
            head = next(StreamReader(self._file, record_size_limit=self.size).records, None)
        except _damage():
            head = None
        if not isinstance(head, Header):
            raise BagError(f"{self.path} is not a bag (no MCAP file)")
        self.profile, self.library = head.profile, head.library
        try:
            found = self._read_index()
        except _damage():
            found = False
        if not found:
            self._scan()

    def _read_index(self) -> bool:
        """Take channels and chunks from the summary; False where the file has none that serves."""
        if self.size < FOOTER_SIZE + 2 * MAGIC_SIZE:
            return False
        self._file.seek(0)
        reader = SeekingReader(self._file, record_size_limit=self.size)
        summary = reader.get_summary()
        if summary is None or summary.statistics is None:
            return False
        if len(summary.chunk_indexes) != summary.statistics.chunk_count:
            return False
        if not summary.chunk_indexes and summary.statistics.message_count:
            return False
        if len(summary.channels) != summary.statistics.channel_count:
            return False
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
        self._schemas.update(summary.schemas)
        self._channels.update(summary.channels)
        self.metadata = metadata
        self._parts = [
            _Part(index.chunk_start_offset, index.message_start_time, index.message_end_time)
            for index in summary.chunk_indexes
        ]
        self.complete = self._all_channels_known = True
        return True

    def _scan(self) -> None:
        """Walk through all whole records; the end of what is readable is the end of the bag."""
        self._schemas.clear()
        self._channels.clear()
        self.metadata.clear()
        self._parts.clear()
        loose: list[Message] = []

        def close_run(offset: int) -> None:
            if loose:
                times = [message.log_time for message in loose]
                self._parts.append(_Part(offset, min(times), max(times), tuple(loose)))
                loose.clear()

        ended = False
        offset = MAGIC_SIZE
        while (record := self._record_at(offset)) is not None:
            opcode, length = record
            after = offset + RECORD.size + length
            try:
                if opcode == Opcode.CHUNK:
                    close_run(offset - 1)
                    start, end = struct.unpack("<QQ", self._file.read(16))
                    self._parts.append(_Part(offset, start, end))
                elif opcode in KEPT:
                    stream = ReadDataStream(io.BytesIO(self._file.read(length)))
                    if opcode == Opcode.MESSAGE:
                        loose.append(Message.read(stream, length))
                    elif opcode == Opcode.SCHEMA:
                        schema = Schema.read(stream)
                        self._schemas[schema.id] = schema
                    elif opcode == Opcode.CHANNEL:
                        channel = ChannelRecord.read(stream)
                        self._channels[channel.id] = channel
                    else:
                        metadata = Metadata.read(stream)
                        self.metadata[metadata.name] = metadata.metadata
            except _damage():
                self._damaged.add(offset)
            ended = ended or opcode == Opcode.DATA_END
            if opcode == Opcode.FOOTER:
                self._file.seek(after)
                self.complete = ended and self._file.read() == MCAP0_MAGIC
                break
            offset = after
        close_run(offset)

    def _record_at(self, offset: int) -> tuple[int, int] | None:
        """Opcode and length of the record that begins at an offset; None where no whole record does."""
        self._file.seek(offset)
        head = self._file.read(RECORD.size)
        if len(head) < RECORD.size:
            return None
        opcode, length = RECORD.unpack(head)
        if opcode == 0 or offset + RECORD.size + length > self.size:
            return None
        return opcode, length

    def messages(
        self,
        topics: Collection[str] | None = None,
        start: int | None = None,
        end: int | None = None,
        progress: Progress | None = None,
    ) -> Iterator[Entry]:
        """Messages in the order in which they were received; of equal times in the order of the file.

        `start` (included) and `end` (excluded) are ns since the Unix epoch.
        """
        pending: list[tuple[int, Entry]] = []
        for part in sorted(self._parts, key=lambda part: (part.start, part.offset)):
            if (start is not None and part.end < start) or (end is not None and part.start >= end):
                continue
            if pending and part.start < pending[-1][0]:
                ready = bisect.bisect_left(pending, part.start, key=_time)
            else:
                ready = len(pending)
            for _, entry in pending[:ready]:
                yield entry
            del pending[:ready]
            if progress is not None:
                progress(part.offset, self.size)
            pending.extend(
                (entry.received, entry)
                for entry in self._unpack(part)
                if (topics is None or entry.topic in topics)
                and (start is None or entry.received >= start)
                and (end is None or entry.received < end)
            )
            pending.sort(key=_time)
        for _, entry in pending:
            yield entry
        if progress is not None:
            progress(self.size, self.size)

    def _unpack(self, part: _Part) -> list[Entry]:
        """The messages of one part; none of it where it is damaged."""
        records: list[Any] | tuple[Message, ...]
        if part.loose:
            records = part.loose
        else:
            try:
                opcode, length = self._record_at(part.offset) or (0, 0)
                if opcode != Opcode.CHUNK:
                    raise ValueError("no chunk here")
                chunk = Chunk.read(ReadDataStream(io.BytesIO(self._file.read(length))))
                if chunk.uncompressed_size > LARGEST_CHUNK:
                    raise ValueError("too large a chunk")
                records = breakup_chunk(chunk, validate_crc=True)
            except _damage():
                self._damaged.add(part.offset)
                return []
        entries: list[Entry] = []
        for record in records:
            if isinstance(record, Message):
                channel = self._channels.get(record.channel_id)
                if channel is not None:
                    entries.append(Entry(channel.topic, record.log_time, record.data))
            elif isinstance(record, Schema):
                self._schemas.setdefault(record.id, record)
            elif isinstance(record, ChannelRecord):
                self._channels.setdefault(record.id, record)
        return entries

    @property
    def channels(self) -> dict[str, Channel]:
        """The topics, by name."""
        if not self._all_channels_known:
            for part in self._parts:
                self._unpack(part)
            self._all_channels_known = True
        found = {}
        for record in self._channels.values():
            schema = self._schemas.get(record.schema_id)
            found[record.topic] = Channel(
                record.topic,
                schema.name if schema else "",
                schema.data if schema else b"",
                record.metadata["latched"] == "true" if "latched" in record.metadata else _latched(record.topic),
                record.metadata.get("node", ""),
            )
        return dict(sorted(found.items()))

    @property
    def start(self) -> int | None:
        """ns, receive time of the first message."""
        return min((part.start for part in self._parts), default=None)

    @property
    def end(self) -> int | None:
        """ns, receive time of the last message."""
        return max((part.end for part in self._parts), default=None)

    @property
    def session(self) -> dict[str, str]:
        """The machine and the libraries of the recording; empty where the file does not say."""
        return self.metadata.get(SESSION, {})

    @property
    def chunks(self) -> int:
        """How many chunks the file has."""
        return sum(not part.loose for part in self._parts)

    @property
    def damaged(self) -> int:
        """Records met so far that could not be unpacked."""
        return len(self._damaged)

    def statistics(self, progress: Progress | None = None) -> dict[str, TopicStats]:
        """Counts by topic: as the recorder wrote them at the end, else counted now."""
        written = self.metadata.get(STATISTICS)
        if self.complete and written is not None:
            try:
                found = {topic: TopicStats.from_dict(json.loads(text)) for topic, text in written.items()}
                if found.keys() == self.channels.keys():
                    return dict(sorted(found.items()))
            except (ValueError, TypeError, AttributeError):
                pass
        counted = {topic: TopicStats() for topic in self.channels}
        for entry in self.messages(progress=progress):
            counted[entry.topic].add(entry.received, len(entry.body), header(entry.body).seq)
        return counted

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *failure: object) -> None:
        self.close()


def _latched(topic: str) -> bool:
    kind = kind_of(topic)
    return kind is not None and kind.latched


def _time(item: tuple[int, Entry]) -> int:
    return item[0]


def _damage() -> tuple[type[BaseException], ...]:
    """What reading damaged bytes can raise, the unpackers' own errors included."""
    found: tuple[type[BaseException], ...] = DAMAGE
    try:
        import zstandard

        found += (zstandard.ZstdError,)
    except ImportError:
        pass
    return found
