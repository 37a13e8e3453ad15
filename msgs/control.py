"""What was meant: targets, commands and the camera."""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from bunraku.msgs.base import Message, Metres, Name, Number, Quat, Radians, Signed, Unit, Vec2, Vec3


class Camera(Message, kw_only=True):
    """Where the picture is taken from; looks along its own -Z with +Y up, as in glTF; latched."""

    position: Vec3
    rotation: Quat
    yfov: Annotated[float, Meta(gt=0.0, lt=3.1416, description="rad")] | None = None
    ortho_height: Annotated[float, Meta(gt=0.0, le=1e3, description="m")] | None = None
    """An orthographic view where set."""
    aspect: Annotated[float, Meta(gt=0.01, lt=100.0)] = 16 / 9
    """Width by height of the picture that touches refer to."""

    def __post_init__(self) -> None:
        if (self.yfov is None) == (self.ortho_height is None):
            raise ValueError("give either yfov or ortho_height")


class Target(Message, kw_only=True):
    """All that is held now, whole, every time; world coordinates."""

    pelvis: Vec3 | None = None
    left_hand: Vec3 | None = None
    right_hand: Vec3 | None = None
    left_foot: Vec3 | None = None
    right_foot: Vec3 | None = None
    trunk: Quat | None = None
    head: Quat | None = None
    yaw: Radians | None = None
    """Heading of the body, rad about +Y from +Z."""
    left_elbow: Vec3 | None = None
    right_elbow: Vec3 | None = None
    left_knee: Vec3 | None = None
    right_knee: Vec3 | None = None


Body = Literal["whole", "upper", "lower", "left_arm", "right_arm", "left_leg", "right_leg", "trunk", "head"]


class PathPoint(msgspec.Struct, kw_only=True):
    """A point of a path on the ground with what the figure does there."""

    x: Metres
    z: Metres
    speed: Annotated[float, Meta(ge=0.0, le=20.0, description="m/s")] | None = None
    tilt: Radians = 0.0
    """Lean to the left, rad."""
    bend: Radians = 0.0
    """Bend forward, rad."""
    duck: Unit = 0.0


class CommandBase(Message, tag_field="kind", kw_only=True):
    """A command is whole and idempotent: hearing it twice or after a restart does no harm."""

    id: Annotated[int, Meta(ge=0, le=2**53)]
    body: list[Body] = msgspec.field(default_factory=lambda: list[Body](["whole"]))
    """The parts it moves."""


class Locomotion(CommandBase, tag="locomotion", kw_only=True):
    """Follow the remaining path on the ground; grows while the stroke goes on."""

    path: Annotated[list[PathPoint], Meta(max_length=4096)]
    start: Annotated[float, Meta(ge=0.0, le=1e6)] = 0.0
    """Arc length at the first point, m, counted from the stroke's beginning: says what was already cut off."""
    complete: bool = False
    """The path will not grow any more."""
    heading: Radians | None = None


class Stand(CommandBase, tag="stand", kw_only=True):
    """Stand and take a posture."""

    tilt: Radians = 0.0
    bend: Radians = 0.0
    duck: Unit = 0.0
    heading: Radians | None = None


class Step(CommandBase, tag="step", kw_only=True):
    """One step to a place without turning."""

    goal: Vec3
    """World position of the pelvis's projection on the ground after the step."""
    heading: Radians | None = None


class Jump(CommandBase, tag="jump", kw_only=True):
    """A jump to a place on the ground, or straight up."""

    goal: Vec3 | None = None
    height: Annotated[float, Meta(ge=0.0, le=5.0, description="m")] | None = None
    heading: Radians | None = None


class Turn(CommandBase, tag="turn", kw_only=True):
    """Turn on the spot to a heading."""

    heading: Radians


class HandPose(CommandBase, tag="hand_pose", kw_only=True):
    """Weights of a pose's principal components (the open hand in pose control)."""

    weights: Annotated[list[Signed], Meta(max_length=16)]


class Action(CommandBase, tag="action", kw_only=True):
    """A parametrised action at a moment of its own time."""

    model: Name
    weights: Annotated[list[Signed], Meta(max_length=16)] = []
    time: Signed = -1.0
    """-1..0 not performing; 0..1 share of the action."""


class WalkGesture(CommandBase, tag="walk_gesture", kw_only=True):
    """A recognised finger walk: a type of walking along a path."""

    gait: Literal["walk", "jog", "run", "sneak", "march", "jump_up", "short_jump", "long_jump"]
    path: Annotated[list[Vec2], Meta(max_length=4096)]
    """(x, z) m on the ground."""
    complete: bool = False


Command = Locomotion | Stand | Step | Jump | Turn | HandPose | Action | WalkGesture

__all__ = [
    "Action", "Body", "Camera", "Command", "CommandBase", "HandPose", "Jump", "Locomotion", "Number", "PathPoint",
    "Stand", "Step", "Target", "Turn", "WalkGesture",
]  # fmt: skip
