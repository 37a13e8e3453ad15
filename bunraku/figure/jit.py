"""One source, compiled or not: ``@kernel`` is ``numba.njit`` where compiling pays, else nothing.

A process that computes poses at rate compiles (0.4 s of start with a warm cache, then about 100 times
faster); one that computes a single pose a frame runs the same source as plain Python and never imports
numba. ``BUNRAKU_JIT=0`` or numba's own ``NUMBA_DISABLE_JIT=1`` choose the latter.

A cache folder is named by a hash of the kernel sources, because numba's own staleness check looks only at the
file of the outer function and would keep an outdated inlined one.
"""

import hashlib
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

F = TypeVar("F", bound=Callable[..., Any])

COMPILED = os.environ.get("BUNRAKU_JIT", "1") != "0" and os.environ.get("NUMBA_DISABLE_JIT", "0") in ("", "0")


PACKAGE = Path(__file__).resolve().parent.parent
BELOW = {"figure": ("figure",), "motion": ("figure", "motion"), "blender": ("figure", "motion", "blender")}
"""Folders whose kernels those of a folder may call; any other folder calls its own and the figure's."""


@cache
def cache_folder(name: str = "motion") -> Path:
    """Where the compiled kernels of one folder ('figure', 'motion', 'controller') are kept; it need not exist yet.

    Named by all kernel sources that it may call, so that a change recompiles what it can reach and nothing else.
    """
    digest = hashlib.sha256()
    for part in BELOW.get(name, ("figure", name)):
        folder = PACKAGE / part if part in ("figure", "motion") else PACKAGE / "nodes" / part
        for source in sorted(folder.glob("*.py")):
            text = source.read_bytes()
            if b"@kernel" in text:
                digest.update(text)
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return root / "bunraku" / "kernels" / f"{name}-{digest.hexdigest()[:16]}"


bare: Any
"""In a kernel: the same array as one that nobody owns. Its views are handed on without atomic reference counts, which
cost more than the arithmetic of a small kernel. Only for arrays that the caller's caller keeps."""

if COMPILED:
    import numba
    import numba.extending

    _OWN = "NUMBA_CACHE_DIR" not in os.environ

    def _compiled(function: F, inline: bool) -> F:
        if _OWN:
            numba.config.CACHE_DIR = str(cache_folder(Path(function.__code__.co_filename).parent.name))  # type: ignore[attr-defined]
        return cast(F, numba.njit(cache=True, error_model="numpy", forceinline=inline)(function))

    def kernel(function: F) -> F:
        """Compile ``function`` (no Python objects inside), cached on disk."""
        return _compiled(function, inline=False)

    def kernel_inline(function: F) -> F:
        """`kernel` for a small one that takes whole records: part of its callers, since handing over a hundred
        arrays costs more than what it does."""
        return _compiled(function, inline=True)

    def _unowned(typing: Any, array: Any) -> Any:
        def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            seen = context.make_array(signature.args[0])(context, builder, arguments[0])
            seen.meminfo = seen.meminfo.type(None)
            return seen._getvalue()

        return array(array), code

    bare = numba.extending.intrinsic(_unowned)

else:

    def _itself(array: Any) -> Any:
        return array

    bare = _itself

    def kernel(function: F) -> F:
        """Leave ``function`` as it is."""
        return function

    kernel_inline = kernel
