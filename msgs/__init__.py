"""The messages that flow between the nodes; README.md beside this file is the wire format in words."""

from bunraku.msgs.base import InvalidMessage, Message, decode, schema
from bunraku.msgs.control import (
    Action,
    Camera,
    Command,
    CommandBase,
    HandPose,
    Jump,
    Locomotion,
    PathPoint,
    Stand,
    Step,
    Target,
    Turn,
    WalkGesture,
)
from bunraku.msgs.course import Course
from bunraku.msgs.figure import Contacts, Motion, Pose, SkeletonMessage
from bunraku.msgs.input import Contact, Device, Event, Hand, Hands, Pad, Pen, PenSample, Touch
from bunraku.msgs.overlay import Overlay, Primitive
from bunraku.msgs.system import Clock, Journal, Log, Parameter, Params
from bunraku.msgs.topics import TOPICS, TopicKind, kind_of

__all__ = [
    "TOPICS",
    "Action",
    "Camera",
    "Clock",
    "Command",
    "CommandBase",
    "Contact",
    "Contacts",
    "Course",
    "Device",
    "Event",
    "Hand",
    "HandPose",
    "Hands",
    "InvalidMessage",
    "Journal",
    "Jump",
    "Locomotion",
    "Log",
    "Message",
    "Motion",
    "Overlay",
    "Pad",
    "Parameter",
    "Params",
    "PathPoint",
    "Pen",
    "PenSample",
    "Pose",
    "Primitive",
    "SkeletonMessage",
    "Stand",
    "Step",
    "Target",
    "TopicKind",
    "Touch",
    "Turn",
    "WalkGesture",
    "decode",
    "kind_of",
    "schema",
]
