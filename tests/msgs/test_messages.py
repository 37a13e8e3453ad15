"""The messages: validation, evolution, and the wire vectors that other languages test themselves against."""

import json
import math
import struct
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import bunraku.msgs
from bunraku.msgs import (
    TOPICS,
    Camera,
    Command,
    Contact,
    InvalidMessage,
    Locomotion,
    Message,
    Pose,
    SkeletonMessage,
    Step,
    Target,
    Touch,
    decode,
    kind_of,
    schema,
)

VECTORS = json.loads((Path(bunraku.msgs.__file__).parent / "vectors.json").read_text())
HEADER = {"stamp": 1_700_000_000_000_000_000, "origin": 1_699_999_999_990_000_000, "seq": 7}


def f32(*values: float) -> bytes:
    return struct.pack(f"<{len(values)}f", *values)


def pose(**changes: Any) -> dict[str, Any]:
    return {"skeleton": "a", "root": f32(0, 1, 0), "rotations": f32(0, 0, 0, 1, 0, 1, 0, 0), **changes}


def plain(value: Any) -> Any:
    """A decoded MessagePack body with `bin` as hex, as the vectors write it."""
    if isinstance(value, bytes):
        return {"bin": value.hex()}
    if isinstance(value, dict):
        return {key: plain(one) for key, one in value.items()}
    return [plain(one) for one in value] if isinstance(value, list) else value


@pytest.mark.parametrize("vector", VECTORS, ids=[one["topic"] + ": " + one["name"] for one in VECTORS])
def test_vectors(vector: dict[str, Any]) -> None:
    body = bytes.fromhex(vector["body"])
    assert plain(msgpack.unpackb(body)) == vector["map"]
    kind = kind_of(vector["topic"])
    assert kind is not None
    if vector["valid"]:
        message = decode(kind.type, body)
        again = plain(msgpack.unpackb(message.encode()))
        assert {key: again[key] for key in vector["map"] if key in again} == {
            key: value for key, value in vector["map"].items() if key in again
        }
    else:
        with pytest.raises(InvalidMessage, match=vector["why"]):
            decode(kind.type, body)


def test_every_topic_has_a_vector_and_a_schema() -> None:
    shown = {one["topic"] for one in VECTORS if one["valid"]}
    for topic, kind in TOPICS.items():
        assert any(kind_of(one) is kind for one in shown), f"no vector for {topic}"
        assert schema(kind.type)


def test_not_finite_is_refused_everywhere() -> None:
    for number in (math.nan, math.inf, -math.inf):
        for body in (
            {"pelvis": [0, number, 0]},
            {"yaw": number},
            {"trunk": [0, 0, 0, number]},
        ):
            with pytest.raises(InvalidMessage):
                Target.decode(msgpack.packb(body))
        with pytest.raises(InvalidMessage, match="not finite"):
            Pose.decode(msgpack.packb(pose(root=f32(0, number, 0))))
        with pytest.raises(InvalidMessage):
            Touch.decode(
                msgpack.packb({"device": "d", "contacts": [{"id": 1, "phase": "down", "x": number, "y": 0.5}]})
            )


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"root": f32(0, 1)}, "do not make shape"),
        ({"root": b"123"}, "little-endian float32"),
        ({"root": [0, 1, 0]}, "little-endian float32"),
        ({"rotations": f32(0, 0, 0, 2)}, "unit length"),
        ({"rotations": f32(*[0, 0, 0, 1] * 1025)}, "at most 1024"),
        ({"contacts": {"left_foot": 1}}, "Expected `bool`"),
        ({"stamp": -1}, ">= 0"),
        ({"seq": "x"}, "Expected `int`"),
    ],
)
def test_a_bad_pose_says_which_field_and_why(change: dict[str, Any], why: str) -> None:
    with pytest.raises(InvalidMessage, match=why):
        Pose.decode(msgpack.packb(pose(**change)))


def test_unknown_keys_are_ignored_and_missing_optional_ones_take_defaults() -> None:
    message = Pose.decode(msgpack.packb(pose(colour="red", contacts={"tail": True})))
    assert message.contacts.left_foot is False
    assert message.origin is None
    assert message.rotations.shape == (2, 4)


def test_a_command_is_told_by_its_kind() -> None:
    command = decode(Command, msgpack.packb({"kind": "step", "id": 3, "goal": [0, 0, 1]}))
    assert isinstance(command, Step)
    assert command.body == ["whole"]
    with pytest.raises(InvalidMessage, match="Invalid value 'fly'"):
        decode(Command, msgpack.packb({"kind": "fly", "id": 3}))
    assert isinstance(decode(Command, Locomotion(id=1, path=[]).encode()), Locomotion)


def test_a_camera_is_perspective_or_orthographic() -> None:
    with pytest.raises(InvalidMessage, match="either"):
        Camera.decode(msgpack.packb({"position": [0, 0, 0], "rotation": [0, 0, 0, 1]}))


def test_a_skeleton_must_be_a_tree() -> None:
    def skeleton(**changes: Any) -> dict[str, Any]:
        arrays = {"offsets": 6, "masses": 2, "mass_centers": 6, "box_centers": 6, "box_sizes": 6}
        body = {"names": ["a", "b"], "parents": [-1, 0], "roles": {"hips": 0}}
        return {**body, **{key: bytes(4 * size) for key, size in arrays.items()}, **changes}

    assert SkeletonMessage.decode(msgpack.packb(skeleton())).roles == {"hips": 0}
    for change in ({"parents": [-1, 1]}, {"parents": [0, 0]}, {"roles": {"hips": 2}}, {"masses": bytes(12)}):
        with pytest.raises(InvalidMessage):
            SkeletonMessage.decode(msgpack.packb(skeleton(**change)))


@given(st.binary(max_size=200))
def test_random_bytes_never_do_more_than_be_invalid(body: bytes) -> None:
    for kind in TOPICS.values():
        try:
            decode(kind.type, body)
        except InvalidMessage as error:
            assert "\n" not in str(error)


unit = st.floats(0, 1)
contacts = st.builds(
    Contact,
    id=st.integers(0, 2**40),
    phase=st.sampled_from(["down", "move", "up", "cancel"]),
    x=unit,
    y=unit,
    major=st.none() | st.floats(0, 1),
    angle=st.none() | st.floats(-4, 4),
    pressure=st.none() | unit,
)


@given(st.lists(contacts, max_size=10), st.integers(0, 2**62))
def test_touch_survives_the_wire(held: list[Contact], stamp: int) -> None:
    message = Touch(device="pad", contacts=held, stamp=stamp, size_m=(0.3, 0.2))
    assert Touch.decode(message.encode()) == message
    assert msgpack.unpackb(message.encode())["contacts"] == [
        {key: getattr(one, key) for key in one.__struct_fields__} for one in held
    ]


def test_arrays_travel_as_little_endian_float32() -> None:
    message = Pose(skeleton="a", root=[1.5, -2.0, 0.25], rotations=np.array([[0, 0, 0, 1.0]]), **HEADER)
    wire = msgpack.unpackb(message.encode())
    assert wire["root"] == f32(1.5, -2.0, 0.25)
    assert {key: wire[key] for key in HEADER} == HEADER


@pytest.mark.parametrize(
    ("topic", "same"),
    [
        ("alice/pose", "pose"),
        ("overlay/blender", "overlay/*"),
        ("alice/overlay/x", "overlay/*"),
        ("top/camera", "camera"),
    ],
)
def test_a_namespace_changes_no_kind(topic: str, same: str) -> None:
    assert kind_of(topic) is TOPICS[same]


def test_an_unknown_topic_has_no_kind() -> None:
    assert kind_of("weather") is None
    assert isinstance(Message.decode(msgpack.packb({"stamp": 1, "wind": "x"})), Message)
