"""When a node does not answer: the one line that says so and what there is instead."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

from bunraku.cli import FAILURE, USAGE, Problem, nearest
from bunraku.runtime import graph
from bunraku.runtime.control import NoAnswer


@contextlib.contextmanager
def answering(folder: Path, node: str) -> Iterator[None]:
    """Turn a missing answer or a refusal into a `Problem`."""
    alive = graph.nodes(folder)
    if node not in alive:
        has = f"there is: {', '.join(alive)}" if alive else f"no node runs on stage {folder.name!r}"
        raise Problem(f"node {node!r}: not there{nearest(node, alive)} ({has})", USAGE)
    try:
        yield
    except NoAnswer as error:
        raise Problem(str(error), FAILURE) from None
    except ValueError as error:
        raise Problem(f"{node}: {error}", USAGE) from None
