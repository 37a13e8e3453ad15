"""A node's small state on disk, for taking up after a crash."""

import os
import struct
import zlib
from pathlib import Path

_HEADER = struct.Struct("<II")


class StateFile:
    """Written in one system call, so that a process killed at any moment leaves the old or the new."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._descriptor: int | None = None
        self._last: bytes | None = None

    def read(self) -> bytes | None:
        """What was written last, or None where nothing (whole) is there."""
        try:
            data = self.path.read_bytes()
        except OSError:
            return None
        if len(data) < _HEADER.size:
            return None
        length, checksum = _HEADER.unpack_from(data)
        state = data[_HEADER.size : _HEADER.size + length]
        return state if len(state) == length and zlib.crc32(state) == checksum else None

    def write(self, state: bytes | None) -> None:
        """Replace the state; the same one again costs nothing."""
        if state is None or state == self._last:
            return
        if self._descriptor is None:
            self._descriptor = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        os.pwrite(self._descriptor, _HEADER.pack(len(state), zlib.crc32(state)) + state, 0)
        self._last = state

    def remove(self) -> None:
        """Forget it: the node ended in order."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None
        self.path.unlink(missing_ok=True)
