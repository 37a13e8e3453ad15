"""The animated mannequin as one binary glTF 2.0 file: a skinned mesh, its joints and their motion.

Rest pose, units and axes are the project's own (T-pose, metres, +Y up, facing +Z), which are glTF's too.
"""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bunraku.figure.mannequin import MEDIUM, Detail, build
from bunraku.figure.skeleton import Skeleton

FLOAT, USHORT, UINT, UBYTE = 5126, 5123, 5125, 5121
VERTICES, INDICES = 34962, 34963
"""Numbers that glTF (as OpenGL) gives to component types and buffer targets."""


class _Buffer:
    """Grows the binary chunk and the tables that describe it."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(
        self, array: NDArray[Any], component: int, kind: str, target: int | None = None, *,
        bounds: bool = False, normalized: bool = False,
    ) -> int:  # fmt: skip
        """Append an array of one element a row; gives its accessor."""
        self.data.extend(b"\0" * (-len(self.data) % 4))
        view: dict[str, Any] = {"buffer": 0, "byteOffset": len(self.data), "byteLength": array.nbytes}
        if target is not None:
            view["target"] = target
        self.data.extend(np.ascontiguousarray(array).tobytes())
        self.views.append(view)
        accessor: dict[str, Any] = {
            "bufferView": len(self.views) - 1, "componentType": component, "count": len(array), "type": kind,
        }  # fmt: skip
        if normalized:
            accessor["normalized"] = True
        if bounds:
            columns = array.reshape(len(array), -1)
            accessor["min"], accessor["max"] = columns.min(axis=0).tolist(), columns.max(axis=0).tolist()
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def glb(skeleton: Skeleton, roots: ArrayLike, rotations: ArrayLike, fps: float, detail: Detail = MEDIUM) -> bytes:
    """A motion as binary glTF.

    Args:
        roots: (n, 3) m, world position of the root joint. rotations: (n, J, 4) xyzw, local. One row a frame.
        fps: frames a second.

    Raises:
        ValueError: shapes that do not fit, or no frame. SkeletonError: no humanoid.
    """
    places = np.asarray(roots, dtype="<f4")
    turns = np.array(rotations, dtype="<f4")
    joints = len(skeleton)
    if places.ndim != 2 or not len(places) or places.shape[1] != 3 or turns.shape != (len(places), joints, 4):
        raise ValueError(f"expected roots (n, 3) and rotations (n, {joints}, 4), got {places.shape}, {turns.shape}")
    if not fps > 0.0:
        raise ValueError(f"fps: {fps} is not positive")
    turns /= np.linalg.norm(turns, axis=-1, keepdims=True)
    for k in range(1, len(turns)):  # neighbours on one side, so that players that do not look take the short way
        turns[k] *= np.where(np.sum(turns[k] * turns[k - 1], axis=-1, keepdims=True) < 0.0, -1.0, 1.0)
    mesh = build(skeleton, detail)
    buffer = _Buffer()
    count = len(mesh.positions)
    bones = np.zeros((count, 4), dtype="<u2")
    bones[:, 0] = mesh.joints
    weights = np.zeros((count, 4), dtype="<f4")
    weights[:, 0] = 1.0
    # sRGB to linear, as glTF's vertex colours are
    linear = np.where(mesh.colors <= 0.04045, mesh.colors / 12.92, ((mesh.colors + 0.055) / 1.055) ** 2.4)
    colors = np.full((count, 4), 65535, dtype="<u2")
    colors[:, :3] = np.round(linear * 65535.0)
    attributes = {
        "POSITION": buffer.add(mesh.positions.astype("<f4"), FLOAT, "VEC3", VERTICES, bounds=True),
        "NORMAL": buffer.add(_unit(mesh.normals), FLOAT, "VEC3", VERTICES),
        "COLOR_0": buffer.add(colors, USHORT, "VEC4", VERTICES, normalized=True),
        "JOINTS_0": buffer.add(bones, USHORT, "VEC4", VERTICES),
        "WEIGHTS_0": buffer.add(weights, FLOAT, "VEC4", VERTICES),
    }
    wide = count > 65535
    indices = buffer.add(
        mesh.indices.astype("<u4" if wide else "<u2").ravel(), UINT if wide else USHORT, "SCALAR", INDICES
    )
    inverse = np.tile(np.eye(4, dtype="<f4"), (joints, 1, 1))
    inverse[:, 3, :3] = -skeleton.rest_positions  # columns first
    binds = buffer.add(inverse.reshape(joints, 16), FLOAT, "MAT4")
    nodes: list[dict[str, Any]] = []
    for joint, name in enumerate(skeleton.names):
        node: dict[str, Any] = {"name": name, "translation": skeleton.offsets[joint].tolist()}
        children = np.flatnonzero(skeleton.parents == joint).tolist()
        if children:
            node["children"] = children
        nodes.append(node)
    nodes.append({"name": "mannequin", "mesh": 0, "skin": 0})
    times = buffer.add((np.arange(len(places)) / fps).astype("<f4"), FLOAT, "SCALAR", bounds=True)
    samplers: list[dict[str, Any]] = []
    channels: list[dict[str, Any]] = []
    for joint in range(-1, joints):
        moved = places if joint < 0 else turns[:, joint]
        output = buffer.add(moved.astype("<f4"), FLOAT, "VEC3" if joint < 0 else "VEC4")
        path = "translation" if joint < 0 else "rotation"
        channels.append({"sampler": len(samplers), "target": {"node": max(joint, 0), "path": path}})
        samplers.append({"input": times, "output": output, "interpolation": "LINEAR"})
    buffer.data.extend(b"\0" * (-len(buffer.data) % 4))
    document = {
        "asset": {"version": "2.0", "generator": "bunraku"},
        "scene": 0,
        "scenes": [{"nodes": [0, joints]}],
        "nodes": nodes,
        "meshes": [
            {"name": "mannequin", "primitives": [{"attributes": attributes, "indices": indices, "material": 0}]}
        ],
        "materials": [{"name": "figure", "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.55}}],
        "skins": [{"joints": list(range(joints)), "inverseBindMatrices": binds, "skeleton": 0}],
        "animations": [{"name": "motion", "samplers": samplers, "channels": channels}],
        "bufferViews": buffer.views,
        "accessors": buffer.accessors,
        "buffers": [{"byteLength": len(buffer.data)}],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    length = 12 + 8 + len(text) + 8 + len(buffer.data)
    return b"".join([
        struct.pack("<4sII", b"glTF", 2, length),
        struct.pack("<I4s", len(text), b"JSON"), text,
        struct.pack("<I4s", len(buffer.data), b"BIN\0"), bytes(buffer.data),
    ])  # fmt: skip


def save_glb(
    path: str | Path, skeleton: Skeleton, roots: ArrayLike, rotations: ArrayLike, fps: float, detail: Detail = MEDIUM
) -> None:
    """Write what `glb` gives."""
    body = glb(skeleton, roots, rotations, fps, detail)
    target = Path(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_bytes(body)


def _unit(normals: NDArray[np.float32]) -> NDArray[np.float32]:
    wide = normals.astype(np.float64)
    out: NDArray[np.float32] = (wide / np.linalg.norm(wide, axis=1, keepdims=True)).astype("<f4")
    return out
