"""Uneven ground as a net of lines near the figure, so that one sees what its feet stand on."""

from math import floor

from bunraku.motion.ground import GroundHeight
from bunraku.msgs import Primitive

MESH = 0.5  # m between lines
REACH = 4
"""Meshes from the figure to each side."""
PARTS = 3
"""Pieces of a line from one crossing to the next."""
COLOR = (0.35, 0.40, 0.44, 0.55)


def relief(ground: GroundHeight, x: float, z: float) -> list[Primitive]:
    """Lines on the ground along x and z about a place (m), on a net that stays where it is."""
    first = [MESH * (floor(one / MESH) - REACH) for one in (x, z)]
    count = 2 * REACH + 2
    steps = (count - 1) * PARTS + 1
    out = []
    for line in range(count):
        for along in range(2):
            points: list[tuple[float, ...]] = []
            for k in range(steps):
                go, stay = first[along] + MESH * k / PARTS, first[1 - along] + MESH * line
                px, pz = (go, stay) if along == 0 else (stay, go)
                points.append((px, ground(px, pz) + 0.003, pz))
            out.append(Primitive(kind="line", points=points, color=COLOR, size=0.008))
    return out
