"""What every message is: a MessagePack map with a header, validated on arrival.

A type is a `msgspec.Struct`; every float has bounds, which is what rejects NaN and infinity. Fields of
type `numpy.ndarray` travel as MessagePack ``bin``: little-endian float32, row-major; the class attribute
``shapes`` gives their shapes (-1: any number, the same for all fields of one message).
"""

from typing import Annotated, Any, ClassVar, Self

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

Number = Annotated[float, Meta(ge=-1e9, le=1e9)]
Metres = Annotated[float, Meta(ge=-1e6, le=1e6, description="m")]
Size = Annotated[float, Meta(ge=0.0, le=1e3, description="m")]
Radians = Annotated[float, Meta(ge=-1e4, le=1e4, description="rad")]
Unit = Annotated[float, Meta(ge=0.0, le=1.0)]
Signed = Annotated[float, Meta(ge=-1.0, le=1.0)]
Share = Annotated[float, Meta(ge=-4.0, le=5.0, description="of the surface, 0..1 from the top-left")]
Vec2 = tuple[Number, Number]
Vec3 = tuple[Metres, Metres, Metres]
QuatPart = Annotated[float, Meta(ge=-1.001, le=1.001)]
Quat = Annotated[tuple[QuatPart, QuatPart, QuatPart, QuatPart], Meta(description="xyzw, unit length")]
Text = Annotated[str, Meta(max_length=4096)]
Name = Annotated[str, Meta(max_length=128)]
Nanoseconds = Annotated[int, Meta(ge=0, le=2**63 - 1, description="ns since the Unix epoch")]
Sequence = Annotated[int, Meta(ge=0, le=2**63 - 1)]
Array = NDArray[np.float32]

MAX_BODY = 4 << 20
"""Bytes: a longer body is refused unread."""
MAX_ROWS = 1024
"""Rows of an array field."""


class InvalidMessage(ValueError):
    """A body that is no message of its topic's type; says which field and why."""


class Message(msgspec.Struct, kw_only=True):
    """The header of every body."""

    shapes: ClassVar[dict[str, tuple[int, ...]]] = {}

    stamp: Nanoseconds = 0
    """When it was sent."""
    origin: Nanoseconds | None = None
    """The device sample it stems from; None on a pure tick."""
    seq: Sequence = 0
    """Counts a publisher's messages; a lower one is a restart."""

    def __post_init__(self) -> None:
        rows: int | None = None
        for key, shape in self.shapes.items():
            array = np.asarray(getattr(self, key), dtype="<f4")
            try:
                array = array.reshape(shape)
            except ValueError:
                raise ValueError(f"{array.size} numbers do not make shape {shape} - at `$.{key}`") from None
            if not np.isfinite(array).all():
                raise ValueError(f"values that are not finite - at `$.{key}`")
            if shape[0] == -1:
                if array.shape[0] > MAX_ROWS:
                    raise ValueError(f"{array.shape[0]} rows, at most {MAX_ROWS} - at `$.{key}`")
                if rows not in (None, array.shape[0]):
                    raise ValueError(f"{array.shape[0]} rows where other fields have {rows} - at `$.{key}`")
                rows = array.shape[0]
            setattr(self, key, array)

    def encode(self) -> bytes:
        """The body as it travels."""
        return _encoder.encode(self)

    @classmethod
    def decode(cls, body: bytes) -> Self:
        """Read and validate a body; raises `InvalidMessage`."""
        message: Self = decode(cls, body)
        return message


def decode(type_: Any, body: bytes) -> Any:
    """Read and validate a body as a message type or a union of them; raises `InvalidMessage`."""
    if len(body) > MAX_BODY:
        raise InvalidMessage(f"{len(body)} bytes, at most {MAX_BODY}")
    decoder = _decoders.get(type_)
    if decoder is None:
        decoder = _decoders[type_] = msgspec.msgpack.Decoder(type_, dec_hook=_array_from_bin)
    try:
        return decoder.decode(body)
    except (msgspec.MsgspecError, ValueError, RecursionError) as error:
        raise InvalidMessage(str(error)) from None


def schema(type_: Any) -> dict[str, Any]:
    """The JSON Schema of a message type or union (array fields as strings with a note on their bytes)."""
    return msgspec.json.schema(type_, schema_hook=_array_schema)


def _array_to_bin(value: object) -> bytes:
    if isinstance(value, np.ndarray):
        return np.ascontiguousarray(value, dtype="<f4").tobytes()
    if isinstance(value, np.generic):
        return value.item()  # type: ignore[no-any-return]
    raise NotImplementedError(f"{type(value).__name__} cannot travel")


def _array_from_bin(type_: type, value: object) -> object:
    if type_ is np.ndarray or getattr(type_, "__origin__", None) is np.ndarray:
        if not isinstance(value, bytes) or len(value) % 4:
            raise ValueError("expected `bin` of little-endian float32")
        return np.frombuffer(value, "<f4")
    raise NotImplementedError(f"no message field has type {type_}")


def _array_schema(type_: type) -> dict[str, Any]:
    return {"type": "string", "contentEncoding": "base64", "description": "little-endian float32, row-major"}


_encoder = msgspec.msgpack.Encoder(enc_hook=_array_to_bin)
_decoders: dict[Any, msgspec.msgpack.Decoder[Any]] = {}
