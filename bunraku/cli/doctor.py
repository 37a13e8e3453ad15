"""What is missing on this machine, and the command that mends it.

The exit status is 1 where something is missing that bunraku cannot do without.
"""

import argparse
import ctypes
import glob
import os
import sys
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

from bunraku.cli.output import add_json, add_stage, folder_of, print_json

OPENGL = "sudo apt-get install libegl1 libgl1 libxrender1"
HIDRAW_RULE = (
    """echo 'KERNEL=="hidraw*", SUBSYSTEM=="hidraw", TAG+="uaccess"' | sudo tee /etc/udev/rules.d/70-bunraku.rules """
    "&& sudo udevadm control --reload && sudo udevadm trigger"
)
INPUT_GROUP = 'sudo usermod -aG input "$USER" (then log in again)'


@dataclass(frozen=True)
class Finding:
    """What one look found."""

    name: str
    state: Literal["ok", "note", "missing"]
    """``note``: something will not work or work slower; ``missing``: bunraku cannot do without."""
    text: str
    mend: str = ""
    """The command or step that mends it."""


def add(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("--warm", action="store_true", help="compile the kernels now, if they are not")
    add_stage(parser)
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Look at everything and tell."""
    folder = folder_of(args)
    if args.warm:
        _warm()
    looks: list[Callable[[], Finding]] = [
        look_python,
        look_packages,
        look_zmq,
        lambda: look_run_folder(folder),
        look_cache,
        look_kernels,
        look_opengl,
        look_display,
        lambda: look_devices("touch screens and pens (evdev)", glob.glob("/dev/input/event*"), INPUT_GROUP),
        lambda: look_devices("pens and gloves (hidraw)", glob.glob("/dev/hidraw*"), HIDRAW_RULE),
    ]
    findings = [look() for look in looks]
    missing = sum(one.state == "missing" for one in findings)
    if args.json:
        print_json([asdict(one) for one in findings])
    else:
        width = max(len(one.name) for one in findings)
        for one in findings:
            print(f"{one.state:7}  {one.name:{width}}  {one.text}")
            if one.mend:
                print(f"{'':7}  {'':{width}}  mend: {one.mend}")
        print(f"{missing} missing" if missing else "nothing is missing that bunraku needs")
    return 1 if missing else 0


def look_python(version: tuple[int, ...] = sys.version_info[:3]) -> Finding:
    """Python itself."""
    text = ".".join(map(str, version))
    if version < (3, 11):
        return Finding("python", "missing", f"{text}, needs 3.11 or later", "sudo apt-get install python3.11")
    return Finding("python", "ok", text)


def look_packages(requirements: Iterable[str] | None = None) -> Finding:
    """Every package that bunraku declares."""
    import importlib.metadata
    import re

    if requirements is None:
        try:
            requirements = importlib.metadata.requires("bunraku") or []
        except importlib.metadata.PackageNotFoundError:
            return Finding("packages", "missing", "bunraku itself is not installed", "pip install -e .")
    lacking, count = [], 0
    for line in requirements:
        if "extra ==" in line:
            continue
        count += 1
        name = re.split(r"[^A-Za-z0-9._-]", line, maxsplit=1)[0]
        try:
            importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            lacking.append(name)
    if lacking:
        return Finding(
            "packages", "missing", f"not installed: {', '.join(lacking)}", f"pip install {' '.join(lacking)}"
        )
    return Finding("packages", "ok", f"all {count} are installed")


def look_zmq(has: Callable[[str], bool] | None = None) -> Finding:
    """ZeroMQ with what the runtime and the bridge use."""
    mend = "pip install --force-reinstall --only-binary :all: pyzmq"
    try:
        import zmq
    except ImportError as error:
        return Finding("zeromq", "missing", f"pyzmq does not load: {error}", mend)
    has = has or zmq.has
    if not has("ipc"):
        return Finding("zeromq", "missing", "built without ipc: no topic can be said", mend)
    if not has("curve"):
        return Finding("zeromq", "note", "built without CURVE: no bridge between machines", mend)
    return Finding("zeromq", "ok", f"{zmq.zmq_version()} with ipc and CURVE, pyzmq {zmq.__version__}")


def look_run_folder(folder: Path) -> Finding:
    """Where the sockets lie: the length of their paths, and the right to make them."""
    from bunraku.runtime.names import IPC_PATH_MAX

    # the longest names that the project's own nodes make, in one namespace
    longest = len(os.fsencode(folder)) + 1 + len("performer.overlay.interpreter")
    if longest > IPC_PATH_MAX:
        text = f"{folder} is too long for sockets ({longest} of {IPC_PATH_MAX} bytes with a topic's name)"
        return Finding(
            "run folder", "missing", text, "export XDG_RUNTIME_DIR=/tmp/bunraku-run (make it with mode 0700)"
        )
    parent = folder
    while not parent.exists():
        parent = parent.parent
    if not os.access(parent, os.W_OK | os.X_OK):
        mend = 'export XDG_RUNTIME_DIR="$(mktemp -d)"'
        return Finding("run folder", "missing", f"{parent} cannot be written", mend)
    return Finding("run folder", "ok", f"{folder} ({longest} of {IPC_PATH_MAX} bytes with a topic's name)")


def look_cache(folder: Path | None = None) -> Finding:
    """Where compiled kernels are kept."""
    if folder is None:
        os.environ["BUNRAKU_JIT"] = "0"
        from bunraku.cli import kernels

        folder = kernels.folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        text = f"{folder} cannot be written ({error.strerror}): kernels are compiled at every start"
        return Finding("kernel cache", "missing", text, 'export XDG_CACHE_HOME="$HOME/.cache" (a folder of your own)')
    return Finding("kernel cache", "ok", str(folder))


def look_kernels() -> Finding:
    """Whether the kernels are compiled already."""
    os.environ["BUNRAKU_JIT"] = "0"
    from bunraku.cli import kernels

    cold = kernels.missing(_computing())
    if cold:
        text = "not compiled yet: the first launch takes some tens of seconds longer"
        return Finding("kernels", "note", text, "bunraku doctor --warm")
    return Finding("kernels", "ok", "compiled")


def look_opengl(load: Callable[[str], object] = ctypes.CDLL) -> Finding:
    """The libraries that draw films and pictures."""
    lacking = []
    for library in ("libEGL.so.1", "libGL.so.1"):
        try:
            load(library)
        except OSError:
            lacking.append(library)
    if lacking:
        return Finding("opengl", "note", f"no {', '.join(lacking)}: no film and window, pictures are plain", OPENGL)
    return Finding("opengl", "ok", "libEGL and libGL load")


def look_display() -> Finding:
    """Whether a window can open."""
    for key in ("DISPLAY", "WAYLAND_DISPLAY"):
        if os.environ.get(key):
            return Finding("display", "ok", f"{key}={os.environ[key]}")
    text = "none: no window opens; films, pictures and the stage page work"
    return Finding("display", "note", text, "start it in a desktop session, or use the page in a browser")


def look_devices(name: str, paths: Iterable[str], mend: str) -> Finding:
    """Whether the devices that are there can be read."""
    found = sorted(paths)
    closed = [path for path in found if not os.access(path, os.R_OK)]
    if not found:
        return Finding(name, "note", "none on this machine; TUIO, the page and scripts work")
    if closed:
        return Finding(name, "note", f"{len(closed)} of {len(found)} cannot be read, as {closed[0]}", mend)
    return Finding(name, "ok", f"all {len(found)} can be read")


def _computing() -> list[str]:
    """The nodes that compile kernels, as 'module:Class'."""
    from bunraku.runtime import plan

    found = []
    for kind, path in sorted(plan.table().items()):
        try:
            if plan.load(kind).jit:
                found.append(path)
        except plan.UnknownNode:
            continue
    return found


def _warm() -> None:
    os.environ["BUNRAKU_JIT"] = "0"
    from bunraku.cli import kernels

    kernels.compile_missing(_computing())
