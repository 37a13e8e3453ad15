"""A bag as a film: what the renderer would have shown, frame by frame."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from bunraku.cli import USAGE, Problem

if TYPE_CHECKING:
    from bunraku.msgs import Message
    from bunraku.nodes.renderer.film import Shots
    from bunraku.runtime.bag import Bag

MOST_FPS = 240


def size_of(text: str) -> tuple[int, int]:
    """``WxH`` in pixels; raises `Problem`."""
    width, cross, height = text.partition("x")
    if not cross or not width.isdigit() or not height.isdigit():
        raise Problem(f"--size {text!r}: write it like 1280x720", USAGE)
    numbers = int(width), int(height)
    if not all(64 <= number <= 4096 and number % 2 == 0 for number in numbers):
        raise Problem(f"--size {text}: even numbers from 64 to 4096", USAGE)
    return numbers


def fps_of(value: float) -> int:
    """Whole frames a second; raises `Problem`."""
    if value != int(value) or not 1 <= value <= MOST_FPS:
        raise Problem(f"--fps {value:g}: a film has 1 to {MOST_FPS}, a whole number", USAGE)
    return int(value)


def figures_in(topics: Sequence[str]) -> list[str]:
    """The namespaces of the figures whose poses are among the topics."""
    return [topic.removesuffix("pose").rstrip("/") for topic in topics if topic.rpartition("/")[2] == "pose"]


def film(path: str | Path, shots: "Shots", engine: str, progress: Callable[[float, float], object]) -> int:
    """Film a bag; gives the number of frames. Raises `Problem` where there is nothing to film or nothing to draw with.

    ``progress`` is told the frames that are done and about how many there will be.
    """
    from bunraku.nodes.renderer.film import make_film, wanted
    from bunraku.nodes.renderer.opengl import NoOpenGL
    from bunraku.nodes.renderer.video import VideoError
    from bunraku.runtime.bag import Bag

    with Bag(path) as opened:
        start, end = opened.start, opened.end
        topics = wanted(list(opened.channels), shots.figures)
        if start is None or end is None or not topics:
            raise Problem(f"{path} holds nothing to film", USAGE)
        whole = max(1.0, (end - start) / 1e9 * shots.fps)
        try:
            made = make_film(
                _messages(opened, topics), shots, engine=engine, progress=lambda done: progress(done, whole)
            )
        except NoOpenGL as error:
            raise Problem(f"{error}; or film with --engine pillow") from None
        except VideoError as error:
            raise Problem(str(error)) from None
    if not made.frames:
        raise Problem(f"{path} shows no figure: it needs a pose and its skeleton", USAGE)
    return made.frames


def _messages(bag: "Bag", topics: list[str]) -> "Iterator[tuple[int, str, Message]]":
    from bunraku.msgs import InvalidMessage, decode
    from bunraku.runtime.bag.format import kind_for

    for entry in bag.messages(topics):
        try:
            yield entry.received, entry.topic, decode(kind_for(bag.channels[entry.topic]).type, entry.body)
        except InvalidMessage:
            continue
