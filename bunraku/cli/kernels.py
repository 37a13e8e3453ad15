"""The compiled kernels: whether they are there, and compiling them once for all.

``python -m bunraku.cli.kernels module:Class ...`` runs each node for a moment on an in-memory stage, so that
exactly what it calls is compiled, with the types that it calls it with, into the cache on disk. It ends early when
its standard input does.
"""

import hashlib
import os
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bunraku.cli import Problem

MARK = "warm"
MOMENT = 0.2
"""s of stage time that each node runs."""
LONGEST = 4.0
"""s of stage time that each command has, so that one motion goes over into the next."""


def folder(name: str = "motion") -> Path:
    """Where the compiled kernels of a folder of the package are kept."""
    from bunraku.figure.jit import cache_folder

    return Path(os.environ.get("NUMBA_CACHE_DIR") or cache_folder(name))


def mark(node: str) -> Path:
    """The file that says that a node's kernels are compiled ('module:Class')."""
    package = node.partition(":")[0].split(".")
    # numba keeps the kernels of two installations of the same sources apart
    place = hashlib.sha256(os.fsencode(Path(__file__).absolute())).hexdigest()[:8]
    return folder(package[-2] if len(package) > 1 else "motion") / f"{MARK}-{node.replace(':', '.')}-{place}"


def missing(nodes: Sequence[str]) -> list[str]:
    """Those of the nodes whose kernels are not compiled."""
    return [node for node in nodes if not mark(node).exists()]


def compiling() -> bool:
    """Whether the environment lets kernels be compiled at all."""
    return os.environ.get("BUNRAKU_JIT", "1") != "0" and os.environ.get("NUMBA_DISABLE_JIT", "0") in ("", "0")


def warm(node: str) -> None:
    """Run a node for a moment with everything that it hears."""
    from bunraku.runtime.declare import declaration
    from bunraku.runtime.memory import MemoryStage
    from bunraku.runtime.plan import load

    found = load(node)
    stage = MemoryStage()
    stage.add(found)
    hears = declaration(found).hears
    for topic, message in _samples():
        if topic in hears:
            stage.publish(topic, message)
            stage.advance(LONGEST if topic == "command" else MOMENT)
    stage.advance(MOMENT)
    mark(node).parent.mkdir(parents=True, exist_ok=True)
    mark(node).touch()


def compile_missing(nodes: Sequence[str]) -> None:
    """Compile what is not compiled, in a process of its own that says so; raises `Problem`."""
    cold = missing(nodes)
    if not cold:
        return
    print("compiling the kernels, once (some tens of seconds)", file=sys.stderr, flush=True)
    with subprocess.Popen(
        [sys.executable, "-m", "bunraku.cli.kernels", *cold],
        env={**os.environ, "BUNRAKU_JIT": "1"},
        stdin=subprocess.PIPE,  # held open: its end tells the compiler that nobody waits any more
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    ) as process:
        try:
            assert process.stderr is not None
            said = process.stderr.read().decode(errors="replace")
            process.wait()
        except BaseException:
            process.kill()
            raise
    if process.returncode:
        last = said.strip().rpartition("\n")[2]
        raise Problem(f"compiling the kernels failed: {last}; bunraku doctor looks at the cache")


def _end_with_the_caller() -> None:
    """Leave when standard input ends: whoever asked is gone, however it went."""
    while os.read(0, 1):
        pass
    os._exit(1)


def _samples() -> list[tuple[str, Any]]:
    """A message of each kind that moves a figure."""
    from bunraku.figure.default import default_figure
    from bunraku.msgs import Jump, Locomotion, Motion, PathPoint, Stand, Step, Target, Turn

    figure = default_figure()
    root, rotations = figure.rest_pose()
    place = {
        name: tuple(float(x) for x in figure.rest_positions[figure.role(role)])
        for name, role in (
            ("pelvis", "hips"),
            ("left_hand", "leftHand"),
            ("right_hand", "rightHand"),
            ("left_foot", "leftFoot"),
            ("right_foot", "rightFoot"),
            ("left_elbow", "leftLowerArm"),
            ("right_elbow", "rightLowerArm"),
            ("left_knee", "leftLowerLeg"),
            ("right_knee", "rightLowerLeg"),
        )
    }
    whole: dict[str, Any] = {**place, "trunk": (0.0, 0.0, 0.0, 1.0), "head": (0.0, 0.0, 0.0, 1.0), "yaw": 0.0}
    path = [PathPoint(x=x, z=z) for x, z in ((0.0, 0.0), (0.0, 1.0), (1.0, 2.0))]
    return [
        ("motion", Motion(skeleton=figure.hash, root=root, rotations=rotations)),
        ("target", Target(left_hand=whole["left_hand"])),
        ("target", Target(**whole)),
        ("command", Stand(id=1)),
        ("command", Locomotion(id=2, path=path, complete=True)),
        ("command", Turn(id=3, heading=2.0)),
        ("command", Step(id=4, goal=(1.5, 0.0, 2.0))),
        ("command", Jump(id=5, goal=(1.5, 0.0, 2.6))),
        ("command", Jump(id=6, height=0.4)),
        ("target", Target()),
    ]


if __name__ == "__main__":
    threading.Thread(target=_end_with_the_caller, daemon=True).start()
    for name in sys.argv[1:]:
        warm(name)
