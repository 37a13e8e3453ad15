"""A game's record."""

from typing import Annotated, Literal

from msgspec import Meta

from bunraku.msgs.base import Message

Count = Annotated[int, Meta(ge=0, le=2**31)]
Seconds = Annotated[float, Meta(ge=0.0, le=1e7, description="s")]


class Course(Message, kw_only=True):
    """How a run over a course stands."""

    stage: Annotated[int, Meta(ge=1, le=99)]
    obstacles: bool = True
    """Whether obstacles move about."""
    phase: Literal["ready", "running", "finished"]
    seconds: Seconds = 0.0
    """Since the figure began to move; at the end the goal time."""
    course_outs: Count = 0
    """How often a standing foot left the course."""
    collisions: Count = 0
    """How often an obstacle hit the figure."""
    points: Seconds = 0.0
    """Time with penalties: the less the better."""
    off: bool = False
    """It is off the course now."""
    touched: bool = False
    """An obstacle touches it now."""
    runs: Count = 0
    """Runs that reached the goal since the node began."""


__all__ = ["Course"]
