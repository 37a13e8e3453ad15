"""What the nodes say of themselves."""

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from bunraku.msgs.base import Message, Name, Nanoseconds, Sequence, Text


class Log(Message, kw_only=True):
    """One line of a node's log."""

    node: Name
    level: Literal["debug", "info", "warning", "error", "critical"]
    text: Text


class Parameter(msgspec.Struct, kw_only=True):
    """One parameter of a node with its documentation."""

    value: bool | int | float | str | list[Any] | None
    type: Name
    doc: Text = ""
    low: float | None = None
    high: float | None = None
    choices: list[str] | None = None


class Params(Message, kw_only=True):
    """All parameters of a node; latched."""

    node: Name
    params: dict[Name, Parameter]


class Journal(Message, kw_only=True):
    """One step of a node: what it saw. The node's state changes in steps only."""

    now: Nanoseconds
    inputs: dict[Name, Sequence] = {}
    """Topic to the `seq` of the one message of it that this step took."""
    request: dict[str, Any] | None = None
    """A control request that this step carried out."""
    start: dict[str, Any] | None = None
    """The first step: `params`, and the restored `state` (bin) if any."""
    device: bool = False
    """The node also reads a device, which the journal does not hold: it cannot be stepped again from a bag."""


class Clock(Message, kw_only=True):
    """The time, in replay only."""

    now: Nanoseconds


class Raw(Message, kw_only=True):
    """Any map: for topics that no type is known of."""


__all__ = ["Annotated", "Clock", "Journal", "Log", "Meta", "Parameter", "Params", "Raw"]
