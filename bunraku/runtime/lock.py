"""File locks: a ZeroMQ bind silently takes an ipc path over, so the right to bind needs its own guard."""

import fcntl
import os
from pathlib import Path


class Taken(RuntimeError):
    """Somebody else holds it."""


class Lock:
    """Held while the process lives; a killed process's lock is free at once, whatever files it left."""

    def __init__(self, path: Path) -> None:
        self.path = path
        while True:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                os.close(descriptor)
                raise Taken(str(path)) from None
            try:
                same = os.stat(path).st_ino == os.fstat(descriptor).st_ino
            except FileNotFoundError:
                same = False
            if same:
                self._descriptor = descriptor
                return
            os.close(descriptor)  # its holder removed the file between our open and our lock

    def release(self) -> None:
        """Remove the file and let go."""
        self.path.unlink(missing_ok=True)
        os.close(self._descriptor)


def is_taken(path: Path) -> bool:
    """Whether a living process holds the lock."""
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(descriptor)
    return False
