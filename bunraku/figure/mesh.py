"""A figure's surface whose every vertex follows one joint."""

import json
import struct
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Single = NDArray[np.float32]


def matrices(rotations: Array) -> Array:
    """(J, 3, 3) from unit quaternions (J, 4) xyzw."""
    x, y, z, w = np.asarray(rotations, dtype=np.float64).T
    return np.stack(
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
         2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
         2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1,
    ).reshape(-1, 3, 3)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Mesh:
    """The figure's surface at rest. Vertices are in the order of their joints."""

    positions: Single  # (V, 3) m, world at rest
    normals: Single  # (V, 3) unit
    colors: Single  # (V, 3) 0..1, sRGB
    joints: NDArray[np.uint16]  # (V,)
    indices: NDArray[np.uint32]  # (T, 3), counter-clockwise from outside
    rest: Single  # (J, 3) m, the joints at rest

    def skin(self, positions_ws: Array, rotations_ws: Array, out: Single | None = None) -> Single:
        """Vertices (V, 3) and normals (V, 3), side by side in the first six columns of ``out``.

        Args:
            positions_ws: (J, 3) m. rotations_ws: (J, 4) xyzw.
            out: (V, >=6) float32 to write into; a new (V, 6) one when None.
        """
        if out is None:
            out = np.empty((len(self.positions), 6), dtype=np.float32)
        turns = matrices(rotations_ws).astype(np.float32)
        moves = np.asarray(positions_ws, dtype=np.float32)
        for joint, start, stop in self.spans:
            turn = turns[joint].T
            np.matmul(self.local[start:stop], turn, out=out[start:stop, :3])
            out[start:stop, :3] += moves[joint]
            np.matmul(self.normals[start:stop], turn, out=out[start:stop, 3:6])
        return out

    @cached_property
    def spans(self) -> tuple[tuple[int, int, int], ...]:
        """(joint, first vertex, end) of each run of one joint's vertices."""
        edges = np.flatnonzero(np.diff(self.joints.astype(np.int64))) + 1
        bounds = [0, *edges.tolist(), len(self.joints)]
        return tuple((int(self.joints[start]), start, stop) for start, stop in pairwise(bounds))

    @cached_property
    def local(self) -> Single:
        """(V, 3) m, in the frame of its joint."""
        out: Single = self.positions - self.rest[self.joints]
        return out

    def pack(self, capsules: list[list[float]] | None = None) -> bytes:
        """The mesh as a small file for a browser (12 bytes a vertex, 6 a triangle; little-endian).

        ``BMSH``, the header's length as u32, a JSON header padded with blanks to 4 bytes, then the arrays, each
        at a multiple of 4 from the header's end. The header holds ``vertices``, ``triangles``, ``scale`` (a
        position is int16 * scale metres, in its joint's frame), ``arrays``: name to {``offset``, ``type``,
        ``size``}, and ``capsules`` (`Capsules.rows`) where given.
        Arrays: ``positions`` int16 (V, 3) with the joint as the fourth, ``normals`` int8 (V, 4) of 127,
        ``colors`` uint8 (V, 4), ``indices`` uint16 (T, 3) (uint32 above 65,535 vertices).
        """
        scale = float(np.abs(self.local).max()) / 32767.0
        positions = np.empty((len(self.local), 4), dtype="<i2")
        positions[:, :3] = np.round(self.local / scale)
        positions[:, 3] = self.joints
        normals = np.zeros((len(self.local), 4), dtype=np.int8)
        normals[:, :3] = np.round(self.normals * 127.0)
        colors = np.full((len(self.local), 4), 255, dtype=np.uint8)
        colors[:, :3] = np.round(self.colors * 255.0)
        wide = len(self.local) > 65535
        indices = self.indices.astype("<u4" if wide else "<u2")
        blob = bytearray()
        arrays = {}
        for name, kind, array in (
            ("positions", "int16", positions), ("normals", "int8", normals), ("colors", "uint8", colors),
            ("indices", "uint32" if wide else "uint16", indices),
        ):  # fmt: skip
            blob.extend(b"\0" * (-len(blob) % 4))
            arrays[name] = {"offset": len(blob), "type": kind, "size": array.size}
            blob.extend(array.tobytes())
        header: dict[str, object] = {
            "vertices": len(self.local), "triangles": len(self.indices), "scale": scale, "arrays": arrays,
        }  # fmt: skip
        if capsules is not None:
            header["capsules"] = capsules
        text = json.dumps(header, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        return b"BMSH" + struct.pack("<I", len(text)) + text + bytes(blob)
