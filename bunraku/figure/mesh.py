"""A figure's surface whose every vertex follows one joint."""

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
