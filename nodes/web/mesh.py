"""The figure's mesh in few bytes: what neighbours differ by, in planes of bytes, which is what gzip packs best.

All little-endian: ``BKM1``, u32 vertices, triangles, colours, capsules, f32 step; f32[capsules, 9] of joint, start
(3) m, radius, end (3), radius in the joint's frame; u8[colours, 3] sRGB; then columns of numbers. A column is told by
the differences of its numbers in zigzag (2n, or -2n-1 below zero), as planes of bytes, the lowest first: positions x,
y, z in steps (2 planes each), normals x, y, z of 127 (2), colour (2), joint (2), triangles' corners a, b, c (3).
"""

import struct

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.capsules import capsules
from bunraku.figure.mannequin import MEDIUM, Detail, build
from bunraku.figure.skeleton import Skeleton

STEP = 1e-4  # m
Integers = NDArray[np.int64]


def pack_mesh(skeleton: Skeleton, detail: Detail = MEDIUM) -> bytes:
    """The mannequin of a skeleton as the page reads it; raises `SkeletonError` where a required role is missing."""
    mesh = build(skeleton, detail)
    cones = capsules(skeleton)
    table = np.hstack([cones.joints[:, None], cones.starts, cones.radii[:, :1], cones.ends, cones.radii[:, 1:]])
    palette, color = np.unique(np.rint(mesh.colors * 255.0).astype(np.int64), axis=0, return_inverse=True)
    local, normals = np.rint(mesh.local / STEP).astype(np.int64), np.rint(mesh.normals * 127.0).astype(np.int64)
    head = struct.pack(
        "<4s4If", b"BKM1", len(mesh.positions), len(mesh.indices), len(palette), len(table), STEP
    )  # fmt: skip
    columns = [
        *((column, 2) for column in local.T),
        *((column, 2) for column in normals.T),
        (color.ravel().astype(np.int64), 2),
        (mesh.joints.astype(np.int64), 2),
        *((column, 3) for column in mesh.indices.astype(np.int64).T),
    ]
    return b"".join(
        [head, table.astype("<f4").tobytes(), palette.astype(np.uint8).tobytes()]
        + [planes(column, count) for column, count in columns]
    )


def planes(numbers: Integers, count: int) -> bytes:
    """Differences of neighbours, in zigzag, as ``count`` planes of bytes."""
    steps = np.diff(numbers, prepend=0)
    zigzag = np.where(steps < 0, -2 * steps - 1, 2 * steps)
    return b"".join(((zigzag >> 8 * k) & 255).astype(np.uint8).tobytes() for k in range(count))
