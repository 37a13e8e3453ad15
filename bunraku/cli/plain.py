"""Messages as plain JSON values and back: arrays as nested lists where the type is known."""

import base64
import math
from pathlib import Path
from typing import Any, get_args

import msgpack
import numpy as np

from bunraku.cli import USAGE, Problem
from bunraku.msgs import TOPICS, InvalidMessage, Message, decode, kind_of


class Plain:
    """Turns the bodies of one topic into values that JSON knows."""

    def __init__(self, folder: Path, topic: str) -> None:
        self.folder, self.topic = folder, topic
        kind = kind_of(topic)
        self.shapes = _shapes(kind.type) if kind else None

    def __call__(self, body: bytes) -> Any:
        """The value of a body; what is no MessagePack is told as {"invalid": why}."""
        try:
            value = msgpack.unpackb(body, strict_map_key=False)
        except (ValueError, msgpack.UnpackException) as error:
            return {"invalid": str(error) or type(error).__name__, "bytes": len(body)}
        if self.shapes is None:
            self.shapes = self._from_card()
        return _plain(value, self.shapes)

    def _from_card(self) -> dict[str, tuple[int, ...]] | None:
        """The shapes of a remapped topic, whose type only its card tells."""
        from bunraku.runtime.topics import read_card

        name = read_card(self.folder, self.topic).get("type")
        for kind in TOPICS.values():
            if name == getattr(kind.type, "__name__", ""):
                return _shapes(kind.type)
        return None


def _shapes(type_: Any) -> dict[str, tuple[int, ...]]:
    found: dict[str, tuple[int, ...]] = {}
    for one in get_args(type_) or (type_,):
        found.update(getattr(one, "shapes", {}))
    return found


def _plain(value: Any, shapes: dict[str, tuple[int, ...]] | None) -> Any:
    if isinstance(value, dict):
        return {str(key): _field(key, one, shapes or {}) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(one, None) for one in value]
    if isinstance(value, bytes):
        return {"base64": base64.b64encode(value).decode()}
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, (str, int, float, bool)) or value is None:
        return value
    return str(value)


def _field(key: object, value: Any, shapes: dict[str, tuple[int, ...]]) -> Any:
    if isinstance(value, bytes) and isinstance(key, str) and key in shapes:
        return _array(value, shapes[key])
    return _plain(value, None)


def _array(data: bytes, shape: tuple[int, ...]) -> Any:
    try:
        array = np.frombuffer(data, "<f4").reshape(shape)
    except ValueError:
        return {"base64": base64.b64encode(data).decode()}
    # the shortest decimal that is the same float32, not the long one of its double
    flat = [float(str(one)) if np.isfinite(one) else str(one) for one in array.ravel()]
    return np.array(flat, dtype=object).reshape(array.shape).tolist()


def message_of(topic: str, value: Any) -> Message:
    """A checked message from JSON values; raises `Problem` that names the field."""
    kind = kind_of(topic)
    if kind is None:
        raise Problem(f"topic {topic!r} is none that has a type (there is: {', '.join(TOPICS)})", USAGE)
    if not isinstance(value, dict):
        raise Problem(f"{topic}: a message is a JSON object, as {{}}", USAGE)
    packed = dict(value)
    for key in _shapes(kind.type):
        if isinstance(packed.get(key), list):
            try:
                packed[key] = np.array(packed[key], dtype="<f4").tobytes()
            except (ValueError, TypeError, OverflowError):
                raise Problem(f"{topic}: {key}: no array of numbers", USAGE) from None
    try:
        message: Message = decode(kind.type, msgpack.packb(packed))
    except (InvalidMessage, OverflowError, ValueError) as error:
        raise Problem(f"{topic}: {error}", USAGE) from None
    return message
