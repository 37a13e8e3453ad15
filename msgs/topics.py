"""The one table of topics: type, and how each is kept."""

import re
from dataclasses import dataclass
from typing import Any

from bunraku.msgs.base import Message
from bunraku.msgs.control import Camera, Command, Target
from bunraku.msgs.course import Course
from bunraku.msgs.figure import Motion, Pose, SkeletonMessage
from bunraku.msgs.input import Device, Event, Hands, Pad, Pen, Touch
from bunraku.msgs.overlay import Overlay
from bunraku.msgs.system import Clock, Journal, Log, Params

NAME = re.compile(r"[a-z0-9_]+(/[a-z0-9_]+)*")


@dataclass(frozen=True)
class TopicKind:
    """How the messages of a topic are typed and kept."""

    type: Any
    """A `Message` class or a union of them."""
    latched: bool = False
    """The last message is sent again to each new subscriber."""
    newest: bool = False
    """Readers keep only the newest message instead of every one."""
    rate: float | None = None
    """Messages a second that are meant, where the project sets it."""


TOPICS: dict[str, TopicKind] = {
    "touch": TopicKind(Touch),
    "pen": TopicKind(Pen),
    "hands": TopicKind(Hands),
    "pad": TopicKind(Pad),
    "web/events": TopicKind(Event),
    "target": TopicKind(Target),
    "command": TopicKind(Command),
    "camera": TopicKind(Camera, latched=True, newest=True),
    "motion": TopicKind(Motion, newest=True, rate=60.0),
    "pose": TopicKind(Pose, newest=True, rate=60.0),
    "skeleton": TopicKind(SkeletonMessage, latched=True),
    "overlay/*": TopicKind(Overlay, newest=True),
    "course": TopicKind(Course),
    "device/*": TopicKind(Device, latched=True),
    "params/*": TopicKind(Params, latched=True),
    "log/*": TopicKind(Log),
    "journal/*": TopicKind(Journal),
    "clock": TopicKind(Clock, newest=True),
}
"""By the last part of the name; any namespace may stand before it."""


def kind_of(topic: str) -> TopicKind | None:
    """The table's entry for a topic, its namespace aside; None where the table has none."""
    parts = topic.split("/")
    if len(parts) >= 2:
        pair = "/".join(parts[-2:])
        if pair in TOPICS:
            return TOPICS[pair]
        family = TOPICS.get(f"{parts[-2]}/*")
        if family is not None:
            return family
    return TOPICS.get(parts[-1])


__all__ = ["NAME", "TOPICS", "Message", "TopicKind", "kind_of"]
