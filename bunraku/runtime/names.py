"""Names and places: a topic's name is its address in the stage's run folder."""

import os
import re
import stat
import tempfile
from pathlib import Path

NAME = re.compile(r"[a-z0-9_]+(/[a-z0-9_]+)*")
PATTERN = re.compile(r"[a-z0-9_*]+(/[a-z0-9_*]+)*")
IPC_PATH_MAX = 107
"""Bytes: the longest path of a Unix socket."""

RECORDERS = "BUNRAKU_RECORDERS"
"""Environment: JSON, recorder -> patterns of topics; a node begins when they hear it: its journal is then whole."""

STACK = "BUNRAKU_STACK"
"""Environment: JSON, the full names of all nodes that were launched together."""


class NameProblem(ValueError):
    """A name or path that cannot be used; one line with the remedy."""


def stage_name() -> str:
    """The stage this process belongs to (environment BUNRAKU_STAGE)."""
    return os.environ.get("BUNRAKU_STAGE") or "default"


def run_folder(stage: str | None = None) -> Path:
    """The stage's run folder (not made)."""
    stage = stage or stage_name()
    if not re.fullmatch(r"[A-Za-z0-9_.-]{1,64}", stage) or stage.startswith("."):
        raise NameProblem(f"stage name {stage!r}: use letters, digits, '_', '-' and '.', at most 64")
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    base = Path(runtime) / "bunraku" if runtime else Path(tempfile.gettempdir()) / f"bunraku-{os.getuid()}"
    return base / stage


def make_run_folder(folder: Path) -> Path:
    """Make the run folder for this user only (mode 0700); refuses one that others can reach."""
    folder.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    folder.mkdir(mode=0o700, exist_ok=True)
    for place in (folder.parent, folder):
        status = place.lstat()
        if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid():
            raise NameProblem(f"{place} is not this user's own folder: remove it or set XDG_RUNTIME_DIR")
        if status.st_mode & 0o077:
            place.chmod(0o700)
    return folder


def check_topic(name: str) -> str:
    """The name itself; raises `NameProblem` for one that is not [a-z0-9_/]."""
    if not NAME.fullmatch(name):
        raise NameProblem(f"topic name {name!r}: use a-z, 0-9, '_' and '/' between the parts")
    return name


def resolve(name: str, namespace: str = "", remap: dict[str, str] | None = None) -> str:
    """The topic that a node means by ``name``: remapped, then put into its namespace; '/x' is absolute."""
    name = (remap or {}).get(name, name)
    if name.startswith("/"):
        return name[1:]
    return f"{namespace}/{name}" if namespace else name


def file_of(folder: Path, name: str, suffix: str = "") -> Path:
    """The file of a topic or node in the run folder: 'alice/pose' is 'alice.pose'."""
    return folder / (name.replace("/", ".") + suffix)


def endpoint(path: Path) -> str:
    """The ZeroMQ address of a socket file; refuses a path that is too long for one."""
    if len(os.fsencode(path)) > IPC_PATH_MAX:
        raise NameProblem(
            f"{path} is longer than {IPC_PATH_MAX} bytes: set XDG_RUNTIME_DIR or BUNRAKU_STAGE to something shorter"
        )
    return f"ipc://{path}"
