"""Writing a bag: chunks that are closed by size and by time, so that a killed recorder loses little."""

import contextlib
import json
import os
from pathlib import Path
from typing import Any, Self

from mcap.writer import CompressionType, Writer

from bunraku.runtime.bag.format import (
    ENCODING,
    PROFILE,
    SCHEMA_ENCODING,
    SESSION,
    STATISTICS,
    BagError,
    Channel,
    TopicStats,
    channel_for,
    header,
    machine,
)

CHUNK_BYTES = 128 << 10
FLUSH_NS = 250_000_000
COMPRESSION = {"zstd": CompressionType.ZSTD, "lz4": CompressionType.LZ4, "none": CompressionType.NONE}


class BagWriter:
    """A bag being written.

    The open chunk is closed and handed to the system when it holds `CHUNK_BYTES` and when it is older than `FLUSH_NS`
    at the next `write` or `flush_due`: what was written then outlives the process.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        overwrite: bool = False,
        compression: str = "zstd",
        session: dict[str, str] | None = None,
    ) -> None:
        """Open the file; raises `BagError` where it exists already (unless `overwrite`) or cannot be made."""
        self.path = Path(path)
        self.stats: dict[str, TopicStats] = {}
        self.count = 0
        self.bytes = 0
        self._channels: dict[str, int] = {}
        self._schemas: dict[tuple[str, bytes], int] = {}
        self._unflushed_since: int | None = None
        self._closed = False
        try:
            self._file = self.path.open("wb" if overwrite else "xb")
        except FileExistsError:
            raise BagError(f"{self.path} exists already: choose another name, or allow it to be overwritten") from None
        except OSError as error:
            raise BagError(f"{self.path} cannot be written: {error.strerror}") from None
        self._writer: Any = Writer(  # its finish() and flush() have no types
            self._file, CHUNK_BYTES, COMPRESSION[compression], enable_data_crcs=True
        )
        self._begin(machine() if session is None else session)

    def _begin(self, session: dict[str, str]) -> None:
        try:
            self._writer.start(PROFILE, f"bunraku {machine()['bunraku']}")
            self._writer.add_metadata(SESSION, session)
            self._writer.flush()
        except OSError as error:
            raise self._failed(error) from None

    def add_channel(self, channel: Channel) -> None:
        """Declare a topic that is written with these properties; the first declaration of a topic stands."""
        if channel.topic in self._channels:
            return
        schema_id = 0
        if channel.type:
            key = (channel.type, channel.schema)
            schema_id = self._schemas.get(key, 0)
            if not schema_id:
                encoding = SCHEMA_ENCODING if channel.schema else ""
                schema_id = self._schemas[key] = self._writer.register_schema(channel.type, encoding, channel.schema)
        properties = {"latched": "true" if channel.latched else "false", "node": channel.node}
        self._channels[channel.topic] = self._writer.register_channel(channel.topic, ENCODING, schema_id, properties)
        self.stats[channel.topic] = TopicStats()

    def write(self, topic: str, received: int, body: bytes) -> None:
        """Add one message, received at `received` (ns); a topic not declared before is one of the table of topics."""
        channel = self._channels.get(topic)
        if channel is None:
            self.add_channel(channel_for(topic))
            channel = self._channels[topic]
        head = header(body)
        stamp, seq = head.stamp, head.seq
        published = stamp if stamp is not None and 0 <= stamp < 1 << 64 else received
        if seq is not None and seq < 0:
            seq = None
        try:
            self._writer.add_message(channel, received, body, published, (seq or 0) & 0xFFFFFFFF)
        except OSError as error:
            raise self._failed(error) from None
        self.stats[topic].add(received, len(body), seq)
        self.count += 1
        self.bytes += len(body)
        if self._unflushed_since is None:
            self._unflushed_since = received
        else:
            self.flush_due(received)

    def flush_due(self, now: int) -> bool:
        """Close the open chunk and hand it to the system if it is old enough at `now` (ns); tells whether it did."""
        if self._unflushed_since is None or 0 <= now - self._unflushed_since < FLUSH_NS:
            return False
        self.flush()
        return True

    def flush(self) -> None:
        """Close the open chunk and hand it to the system."""
        self._unflushed_since = None
        try:
            self._writer.flush()
        except OSError as error:
            raise self._failed(error) from None

    def close(self) -> None:
        """Write the statistics and the index; the file is complete then."""
        if self._closed:
            return
        self._closed = True
        try:
            statistics = {topic: json.dumps(stats.as_dict()) for topic, stats in self.stats.items()}
            self._writer.flush()
            self._writer.add_metadata(STATISTICS, statistics)
            self._writer.finish()
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise self._failed(error) from None
        finally:
            self._release()

    def _failed(self, error: OSError) -> BagError:
        self._closed = True
        self._release()
        return BagError(f"{self.path}: {error.strerror}; what was written before can be read")

    def _release(self) -> None:
        with contextlib.suppress(OSError):  # a full disk says it a second time for the bytes still buffered
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *failure: object) -> None:
        self.close()
