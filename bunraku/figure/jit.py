"""One source, compiled or not: ``@kernel`` is ``numba.njit`` where compiling pays, else nothing.

A process that computes poses at rate compiles (0.4 s of start with a warm cache, then about 100 times
faster); one that computes a single pose a frame runs the same source as plain Python and never imports
numba. ``BUNRAKU_JIT=0`` or numba's own ``NUMBA_DISABLE_JIT=1`` choose the latter.

The cache folder is named by a hash of every kernel source, because numba's own staleness check looks only
at the file of the outer function and would keep an outdated inlined one.
"""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

F = TypeVar("F", bound=Callable[..., Any])

COMPILED = os.environ.get("BUNRAKU_JIT", "1") != "0" and os.environ.get("NUMBA_DISABLE_JIT", "0") in ("", "0")


def cache_folder() -> Path:
    """Where the compiled kernels of exactly these sources are kept (it need not exist yet)."""
    digest = hashlib.sha256()
    package = Path(__file__).resolve().parent.parent
    for folder in (package / "figure", package / "motion", package / "nodes" / "controller"):
        for source in sorted(folder.glob("*.py")):
            digest.update(source.read_bytes())
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return root / "bunraku" / "kernels" / digest.hexdigest()[:16]


if COMPILED:
    if "NUMBA_CACHE_DIR" not in os.environ:
        os.environ["NUMBA_CACHE_DIR"] = str(cache_folder())
    import numba

    def kernel(function: F) -> F:
        """Compile ``function`` (no Python objects inside), cached on disk."""
        return cast(F, numba.njit(cache=True, error_model="numpy")(function))

else:

    def kernel(function: F) -> F:
        """Leave ``function`` as it is."""
        return function
