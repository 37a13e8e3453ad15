"""Writes what flows on the stage into a bag."""

import json
from fnmatch import fnmatchcase
from typing import Any

from bunraku.runtime.bag import BagError, BagWriter, Channel
from bunraku.runtime.bag.format import channel_for
from bunraku.runtime.bag.info import size
from bunraku.runtime.names import resolve
from bunraku.runtime.node import Node, param, request, subscribe_raw, timer
from bunraku.runtime.topics import read_card

LAST_MESSAGES = 1.0
"""s, at most, for messages that wait unread when the recording is ended."""


class Recorder(Node):
    """Records any topics into a bag (MCAP), every message as it came."""

    name = "recorder"
    journal = False  # it hears the journals: one of its own would feed itself

    output: str = param("", doc="the bag to write; empty: wait for the request `start`")
    topics: list[str] = param(["*"], doc="names or patterns of topics to record")
    overwrite: bool = param(False, doc="replace a bag that exists")
    compression: str = param("zstd", choices=["zstd", "lz4", "none"], doc="of the bag's chunks")

    writer: BagWriter | None = None
    last: dict[str, Any] = {}
    """What was told of the bag ended last."""

    def setup(self) -> None:
        """Begin where an output is given."""
        self._latched: dict[str, bytes] = {}
        self._channels: dict[str, Channel] = {}
        self._chosen_before: dict[str, bool] = {}
        if self.output:
            self._begin(self.output, self.overwrite)

    def teardown(self) -> None:
        """Take what waits unread, and complete the bag."""
        if self.writer is not None:
            drain = getattr(self.stage, "drain", None)
            if drain is not None:
                drain(self, LAST_MESSAGES)
            self._end()

    def on_param(self, name: str) -> None:
        """A new `output` ends the bag being written and begins another."""
        self._chosen_before.clear()
        if name == "output":
            if self.writer is not None:
                self._end()
            if self.output:
                self._begin(self.output, self.overwrite)

    @classmethod
    def would_hear(cls, params: dict[str, Any], namespace: str, topic: str) -> bool:
        """Whether a recorder that starts with these parameters records a topic from the beginning."""
        patterns = (resolve(wanted, namespace) for wanted in params["topics"])
        return bool(params["output"]) and any(fnmatchcase(topic, pattern) for pattern in patterns)

    def wants(self, topic: str) -> bool:
        """Whether a topic is one of those to record."""
        return self.writer is not None and self._chosen(topic)

    @subscribe_raw("/*")
    def on_body(self, topic: str, body: bytes) -> None:
        """Write one message."""
        channel = self._channels.get(topic)
        if channel is None:
            channel = self._channels[topic] = self._channel(topic)
        if channel.latched:
            self._latched[topic] = body
        if self.writer is not None and self._chosen(topic):
            self._write(channel, body)

    @timer(hz=4)
    def flush(self) -> None:
        """Hand what was written to the system, so that it outlives this process."""
        if self.writer is not None:
            try:
                self.writer.flush_due(self.now)
            except BagError as error:
                self._fail(error)

    @request("start")
    def start_recording(self, output: str = "", overwrite: bool = False) -> dict[str, Any]:
        """Begin a bag; refused while one is being written."""
        if self.writer is not None:
            raise ValueError(f"{self.writer.path} is being written: ask for `stop` first")
        if not output:
            raise ValueError("give the file: output=...")
        self._begin(output, overwrite)
        return self.status()

    @request("stop")
    def stop_recording(self) -> dict[str, Any]:
        """Complete the bag."""
        if self.writer is None:
            raise ValueError("nothing is being recorded: ask for `start` first")
        return self._end()

    @request("status")
    def status(self) -> dict[str, Any]:
        """What is being written, and how much so far."""
        if self.writer is None:
            return {"recording": False}
        stats = self.writer.stats.values()
        return {
            "recording": True,
            "file": str(self.writer.path),
            "messages": self.writer.count,
            "bytes": self.writer.bytes,
            "topics": sum(one.count > 0 for one in stats),
            "gaps": sum(one.gaps for one in stats),
        }

    def _chosen(self, topic: str) -> bool:
        known = self._chosen_before.get(topic)
        if known is None:
            known = any(fnmatchcase(topic, resolve(wanted, self.namespace)) for wanted in self.topics)
            self._chosen_before[topic] = known
        return known

    def _channel(self, topic: str) -> Channel:
        """The topic's properties: as its publisher's card has them, else by the table of topics."""
        folder = getattr(self.stage, "folder", None)
        card = read_card(folder, topic) if folder is not None else {}
        if not card.get("type"):
            return channel_for(topic, str(card.get("node", "")))
        schema = json.dumps(card["schema"]).encode() if card.get("schema") else b""
        return Channel(topic, str(card["type"]), schema, bool(card.get("latched")), str(card.get("node", "")))

    def _begin(self, output: str, overwrite: bool) -> None:
        try:
            self.writer = BagWriter(output, overwrite=overwrite, compression=self.compression)
        except BagError as error:
            raise ValueError(str(error)) from None
        self.log.info("recording to %s", self.writer.path)
        for topic, body in self._latched.items():
            if self._chosen(topic):
                self._write(self._channels[topic], body)

    def _write(self, channel: Channel, body: bytes) -> None:
        assert self.writer is not None
        try:
            if channel.topic not in self.writer.stats:
                self.writer.add_channel(channel)
            self.writer.write(channel.topic, self.now, body)
        except BagError as error:
            self._fail(error)

    def _end(self) -> dict[str, Any]:
        assert self.writer is not None
        told = {**self.status(), "recording": False}
        try:
            self.writer.close()
        except BagError as error:
            self._fail(error)
            return told
        self.writer = None
        self.last = told
        self.log.info(
            "recorded %d messages (%s) on %d topics to %s, %d missing by seq",
            told["messages"],
            size(told["bytes"]),
            told["topics"],
            told["file"],
            told["gaps"],
        )
        return told

    def _fail(self, error: BagError) -> None:
        self.writer = None
        self.log.error("%s", error)
        self.stop(1)
