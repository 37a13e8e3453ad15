"""What the page and the server say to each other: JSON up, JSON and binary bundles down.

A page sends text frames of JSON, one object each, told apart by ``t`` (`Hello`, `Input`, `Call`, `Ping`), and binary
frames of 4 bytes that acknowledge a bundle. The server sends JSON for what must arrive and binary bundles for what
only counts while it is new (poses, camera, overlays). All binary is little-endian.

A bundle is ``u32 number`` and parts, each ``u8 kind, u8 figure, u16 0, u32 length`` and its payload, padded to a
multiple of 4 bytes:

* pose (1): ``f64 stamp ms, f64 echo ms, u32 seq, u16 joints, u16 feet, f32[3] root``, then ``i16[joints, 4]``: local
  rotations xyzw, unit 1/32767. ``echo`` is the page's own time of the input that the pose stems from, NaN for none;
  ``feet`` has bit 0 for a planted left foot and bit 1 for the right.
* camera (2): ``f64 stamp ms, f32[3] position, f32[4] rotation, f32 yfov, f32 ortho_height, f32 aspect``, zero for
  not set.
* overlay (3): ``u32 length`` of a JSON head ``{topic, primitives: [{kind, space, color, size, label, count, dim}]}``,
  the head padded to 4 bytes, then ``f32[sum of count x dim]`` points.
"""

import math
import struct
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from bunraku.msgs import Camera, Contact, Event, Hand, Overlay, PenSample, Pose
from bunraku.msgs.base import InvalidMessage, Number, Signed
from bunraku.msgs.input import Surface

VERSION = 1
MAX_TEXT = 64 << 10
"""Bytes: a longer frame from a page ends its connection."""

POSE, CAMERA, OVERLAY = 1, 2, 3
ECHO_AT = 8
"""Where the echo stands in a pose payload."""

PageId = Annotated[str, Meta(pattern="^[a-z0-9]{4,16}$")]
FigureName = Annotated[str, Meta(max_length=64, pattern="^[a-z0-9_/]*$")]

_POSE_HEAD = struct.Struct("<ddIHH3f")
_CAMERA = struct.Struct("<d10f")
_PART = struct.Struct("<BBHI")


class Hello(msgspec.Struct, tag_field="t", tag="hello", forbid_unknown_fields=True):
    """The first message of a page."""

    page: PageId
    """Its own name, kept over reloads: the device is ``web-<page>``."""
    token: Annotated[str, Meta(max_length=128)] = ""
    role: Literal["auto", "play", "watch"] = "auto"
    figure: FigureName = ""
    version: int = VERSION


class Input(msgspec.Struct, tag_field="t", tag="input", forbid_unknown_fields=True):
    """What the hands did in one animation frame; see `bunraku.msgs.Event`."""

    kind: Literal["touch", "pen", "hands", "pad"]
    time: Number = 0.0
    size_m: Surface | None = None
    contacts: Annotated[list[Contact], Meta(max_length=64)] = []
    pen: Annotated[list[PenSample], Meta(max_length=256)] = []
    left: Hand | None = None
    right: Hand | None = None
    axes: Annotated[list[Signed], Meta(max_length=32)] = []
    buttons: Annotated[list[bool], Meta(max_length=64)] = []

    def event(self, device: str) -> Event:
        """The message that the device nodes read."""
        return Event(
            device=device, kind=self.kind, size_m=self.size_m, time=self.time, contacts=self.contacts, pen=self.pen,
            left=self.left, right=self.right, axes=self.axes, buttons=self.buttons,
        )  # fmt: skip


class Call(msgspec.Struct, tag_field="t", tag="call", forbid_unknown_fields=True):
    """Something to be done, answered by a ``reply`` with the same id."""

    id: Annotated[int, Meta(ge=0, le=2**53)]
    verb: Annotated[str, Meta(max_length=32)]
    args: dict[Annotated[str, Meta(max_length=64)], Any] = {}


class Ping(msgspec.Struct, tag_field="t", tag="ping", forbid_unknown_fields=True):
    """Answered by a ``pong`` with the same time."""

    time: Number


_upward = msgspec.json.Decoder(Hello | Input | Call | Ping)
_json = msgspec.json.Encoder()


def decode_text(text: str | bytes) -> Hello | Input | Call | Ping:
    """Read and validate a text frame of a page; raises `InvalidMessage`."""
    try:
        message: Hello | Input | Call | Ping = _upward.decode(text)
        return message
    except (msgspec.MsgspecError, ValueError, RecursionError) as error:
        raise InvalidMessage(str(error)) from None


def encode_text(kind: str, **fields: Any) -> str:
    """A text frame for a page."""
    return _json.encode({"t": kind, **fields}).decode()


def pack_pose(pose: Pose) -> bytes:
    """The payload of a pose part; its echo is NaN until `with_echo`."""
    rotations: NDArray[np.int16] = np.rint(np.clip(pose.rotations, -1.0, 1.0) * 32767.0).astype("<i2")
    feet = int(pose.contacts.left_foot) | int(pose.contacts.right_foot) << 1
    x, y, z = (float(v) for v in pose.root)
    head = _POSE_HEAD.pack(pose.stamp / 1e6, math.nan, pose.seq & 0xFFFFFFFF, len(rotations), feet, x, y, z)
    return head + rotations.tobytes()


def with_echo(payload: bytes, echo: float) -> bytes:
    """A pose payload with the page's own time of the input that it stems from, ms."""
    return payload[:ECHO_AT] + struct.pack("<d", echo) + payload[ECHO_AT + 8 :]


def pack_camera(camera: Camera) -> bytes:
    """The payload of a camera part."""
    return _CAMERA.pack(
        camera.stamp / 1e6, *camera.position, *camera.rotation, camera.yfov or 0.0, camera.ortho_height or 0.0,
        camera.aspect,
    )  # fmt: skip


def pack_overlay(topic: str, overlay: Overlay) -> bytes:
    """The payload of an overlay part."""
    heads: list[dict[str, Any]] = []
    numbers: list[float] = []
    for primitive in overlay.primitives:
        dim = 2 if primitive.space != "world" else 3
        points = [p[:dim] for p in primitive.points if len(p) >= dim]
        numbers.extend(value for point in points for value in point)
        heads.append(
            {
                "kind": primitive.kind, "space": primitive.space, "color": primitive.color, "size": primitive.size,
                "label": primitive.label, "count": len(points), "dim": dim,
            }
        )  # fmt: skip
    head = _json.encode({"topic": topic, "primitives": heads})
    return struct.pack("<I", len(head)) + _padded(head) + np.array(numbers, dtype="<f4").tobytes()


def pack_bundle(number: int, parts: list[tuple[int, int, bytes]]) -> bytes:
    """A binary frame of parts, each (kind, figure, payload)."""
    out = [struct.pack("<I", number & 0xFFFFFFFF)]
    for kind, figure, payload in parts:
        out.append(_PART.pack(kind, figure, 0, len(payload)))
        out.append(_padded(payload))
    return b"".join(out)


def _padded(data: bytes) -> bytes:
    return data + bytes(-len(data) % 4)
