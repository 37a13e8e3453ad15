"""What is there: topics and nodes of a stage, read from its run folder, and the tidying of what the dead left."""

import contextlib
import hashlib
import json
import os
import socket
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bunraku.runtime.control import NoAnswer, ask
from bunraku.runtime.lock import Lock, Taken, is_taken
from bunraku.runtime.names import STACK, file_of
from bunraku.runtime.topics import cards

CONTROL = ".ctl"
SUFFIXES = (".lock", ".json")
STATE = ".state"


@dataclass(frozen=True)
class Topic:
    """A topic that somebody says now."""

    name: str
    type: str
    node: str
    pid: int
    latched: bool
    rate: float | None
    schema: dict[str, Any]

    def as_dict(self) -> dict[str, Any]:
        """Plain values, the schema left out."""
        return {
            "topic": self.name,
            "type": self.type,
            "node": self.node,
            "pid": self.pid,
            "latched": self.latched,
            "rate": self.rate,
        }


def topics(folder: Path) -> list[Topic]:
    """All topics with a living publisher, by name."""
    found = []
    for name, card in cards(folder).items():
        if is_taken(file_of(folder, name, ".lock")):
            found.append(
                Topic(
                    name,
                    str(card["type"]),
                    str(card["node"]),
                    int(card["pid"]),
                    bool(card.get("latched")),
                    card.get("rate"),
                    dict(card.get("schema") or {}),
                )
            )
    return found


def nodes(folder: Path) -> list[str]:
    """The full names of all living nodes, sorted."""
    try:
        entries = sorted(entry.name for entry in os.scandir(folder) if entry.name.endswith(CONTROL))
    except OSError:
        return []
    alive = (entry for entry in entries if is_taken(folder / f"{entry}.lock"))
    return [entry[: -len(CONTROL)].replace(".", "/") for entry in alive]


def is_up(folder: Path, node: str) -> bool:
    """Whether a node has set up: its control socket is there from then on."""
    return file_of(folder, node, CONTROL).exists()


def stack_is_up(folder: Path) -> bool:
    """Whether all nodes that this process was launched together with have set up; true outside of a launch."""
    try:
        names = json.loads(os.environ.get(STACK) or "[]")
    except ValueError:
        return True
    return all(is_up(folder, str(name)) for name in names)


def info(folder: Path, node: str, seconds: float = 2.0) -> dict[str, Any]:
    """What a node says of itself; raises `NoAnswer`."""
    return dict(ask(folder, node, "info", seconds=seconds)["info"])


def infos(folder: Path, seconds: float = 1.0) -> list[dict[str, Any]]:
    """What every living node says of itself; one that does not answer has its name alone."""
    found = []
    for name in nodes(folder):
        try:
            found.append(info(folder, name, seconds))
        except (NoAnswer, ValueError) as error:
            found.append({"name": name, "says": [], "hears": [], "error": str(error)})
    return found


def sweep(folder: Path, *, pid: int | None = None, states: bool = False) -> list[str]:
    """Remove the files of publishers and nodes that live no more; gives the names of what it removed.

    Args:
        folder: the run folder.
        pid: only the topics of this process (else of all dead ones).
        states: also the state files, which let a node that starts again take up from where it was.
    """
    try:
        names = sorted(entry.name for entry in os.scandir(folder))
    except OSError:
        return []
    mine = {name: str(card["node"]) for name, card in cards(folder).items() if card["pid"] == pid}
    owned = {name.replace("/", ".") for name in mine} | {f"{n.replace('/', '.')}{CONTROL}" for n in mine.values()}
    removed = []
    for base in sorted({_base(name) for name in names if not name.endswith(STATE)}):
        if pid is not None and base not in owned:
            continue
        removed += _remove(folder, base)
    if states:
        for name in names:
            if name.endswith(STATE) and not is_taken(folder / f"{name[: -len(STATE)]}{CONTROL}.lock"):
                (folder / name).unlink(missing_ok=True)
                removed.append(name)
    return removed


def _base(name: str) -> str:
    """The topic's or node's socket that a file belongs to."""
    stem, _, draft = name.rpartition(".")
    if draft.isdigit() and stem.endswith(".json"):
        name = stem
    for suffix in SUFFIXES:
        name = name.removesuffix(suffix)
    return name


def _remove(folder: Path, base: str) -> list[str]:
    try:
        lock = Lock(folder / f"{base}.lock")
    except (Taken, OSError):
        return []
    removed = []
    for path in (folder / base, folder / f"{base}.json", *folder.glob(f"{base}.json.*")):
        with contextlib.suppress(OSError):
            path.unlink()
            removed.append(path.name)
    lock.release()
    return removed


class StageTaken(RuntimeError):
    """Another launch plays on the stage; one line."""


class StageLock:
    """The right to launch on a stage: a name of the kernel's, which leaves no file however the holder ends."""

    def __init__(self, folder: Path) -> None:
        digest = hashlib.sha256(os.fsencode(folder.absolute())).hexdigest()[:32]
        address = f"\0bunraku-launch-{os.getuid()}-{digest}"
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._socket.bind(address)
            self._socket.listen(4)
        except OSError:
            self._socket.close()
            holder = _holder(address)
            who = f" (process {holder})" if holder else ""
            raise StageTaken(
                f"stage {folder.name!r} is played on by another launch{who}: end that one, or add --stage NAME"
            ) from None

    def release(self) -> None:
        """Let others launch."""
        self._socket.close()


def _holder(address: str) -> int:
    """The process that listens at an address, 0 where it cannot be told."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as one, contextlib.suppress(OSError):
        one.settimeout(0.5)
        one.connect(address)
        size = struct.calcsize("3i")
        return int(struct.unpack("3i", one.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, size))[0])
    return 0
