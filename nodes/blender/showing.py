"""What is drawn of a blended motion: the rest of the path, the last footprints, and what uneven ground is like."""

from math import cos, sin

import numpy as np

from bunraku.motion.player import Player
from bunraku.msgs import Overlay, Primitive
from bunraku.nodes.blender.relief import relief

PRINTS = 10
"""Footprints drawn."""
PATH_COLOR = (0.95, 0.65, 0.10, 0.9)
LEFT_COLOR = (0.11, 0.54, 0.58, 0.55)
RIGHT_COLOR = (0.90, 0.42, 0.30, 0.55)

Print = tuple[int, list[float]]
"""Left 0 or right 1; x, y, z m of the flat ankle on the ground; yaw; slope (rad)."""


def overlay(player: Player, prints: list[Print]) -> Overlay:
    """The picture of a player's path and of footprints, on the ground."""
    here, ground = player.place, player.ground
    drawn = [] if ground is None else relief(ground, here.x, here.z)
    for side, (x, y, z, yaw, _slope) in prints:
        _, heel, ball = (float(v) for v in player.feet.soles[side])
        tip = ball + 0.55 * (ball - heel)
        wide = 0.21 * (ball - heel)
        corners = (
            (-0.7 * wide, heel),
            (0.7 * wide, heel),
            (wide, ball),
            (0.6 * wide, tip),
            (-0.6 * wide, tip),
            (-wide, ball),
        )
        c, s = cos(yaw), sin(yaw)
        points: list[tuple[float, ...]] = [(x + a * c + b * s, y + 0.004, z - a * s + b * c) for a, b in corners]
        drawn.append(Primitive(kind="polygon", points=points, color=LEFT_COLOR if side == 0 else RIGHT_COLOR))
    path = player.path
    if path is not None:
        at = np.linspace(player.s, path.end, min(max(2, int((path.end - player.s) / 0.08)), 240))
        line: list[tuple[float, ...]] = []
        for one in at:
            px, pz, _ = path.at(float(one))
            height = 0.0 if player.ground is None else player.ground(px, pz)
            line.append((px, height + 0.006, pz))
        drawn.append(Primitive(kind="line", points=line, color=PATH_COLOR, size=0.02))
    return Overlay(primitives=drawn)
