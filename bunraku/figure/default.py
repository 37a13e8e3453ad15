"""The default figure: a person of 1.75 m and 70 kg with two back joints, shoulders and toes.

Segment masses and centres of mass are de Leva's adjustments of Zatsiorsky's data (de Leva 1996, J.
Biomechanics 29(9), table 4, mean of women and men): share of the body's mass, and the centre's distance
from the proximal joint as a share of the segment's length.
"""

from functools import cache

import numpy as np

from bunraku.figure.skeleton import Skeleton

BODY_MASS = 70.0  # kg

# name, VRM role, parent, offset from the parent (m; T-pose, +X is the figure's left)
_CENTER: tuple[tuple[str, str, str | None, tuple[float, float, float]], ...] = (
    ("hips", "hips", None, (0.0, 0.950, 0.0)),
    ("spine", "spine", "hips", (0.0, 0.100, 0.0)),
    ("chest", "chest", "spine", (0.0, 0.140, 0.0)),
    ("neck", "neck", "chest", (0.0, 0.250, 0.0)),
    ("head", "head", "neck", (0.0, 0.085, 0.005)),
)
_SIDE: tuple[tuple[str, str, str, tuple[float, float, float]], ...] = (
    ("shoulder", "Shoulder", "chest", (0.035, 0.200, 0.0)),
    ("upper_arm", "UpperArm", "shoulder", (0.145, 0.0, 0.0)),
    ("lower_arm", "LowerArm", "upper_arm", (0.280, 0.0, 0.0)),
    ("hand", "Hand", "lower_arm", (0.250, 0.0, 0.0)),
    ("upper_leg", "UpperLeg", "hips", (0.095, -0.035, 0.0)),
    ("lower_leg", "LowerLeg", "upper_leg", (0.0, -0.420, 0.0)),
    ("foot", "Foot", "lower_leg", (0.0, -0.410, 0.0)),
    ("toes", "Toes", "foot", (0.0, -0.055, 0.135)),
)

# part: share of the body mass, centre of mass in the joint's frame (left side for the limbs)
_MASS: dict[str, tuple[float, tuple[float, float, float]]] = {
    "hips": (0.1182, (0.0, 0.020, 0.0)),
    "spine": (0.1549, (0.0, 0.065, 0.0)),
    "chest": (0.1570, (0.0, 0.105, 0.0)),
    "neck": (0.0125, (0.0, 0.040, 0.0)),
    "head": (0.0556, (0.0, 0.100, 0.010)),
    "upper_arm": (0.0263, (0.161, 0.0, 0.0)),
    "lower_arm": (0.0150, (0.114, 0.0, 0.0)),
    "hand": (0.0059, (0.075, 0.0, 0.0)),
    "upper_leg": (0.1447, (0.0, -0.162, 0.0)),
    "lower_leg": (0.0457, (0.0, -0.182, 0.0)),
    "foot": (0.0110, (0.0, -0.035, 0.060)),
    "toes": (0.0023, (0.0, -0.010, 0.030)),
}

# part: box centre and half extents in the joint's frame (left side for the limbs)
_BOX: dict[str, tuple[tuple[float, float, float], tuple[float, float, float]]] = {
    "hips": ((0.0, 0.010, 0.0), (0.155, 0.085, 0.100)),
    "spine": ((0.0, 0.070, 0.0), (0.125, 0.080, 0.090)),
    "chest": ((0.0, 0.110, 0.0), (0.155, 0.125, 0.110)),
    "neck": ((0.0, 0.040, 0.0), (0.045, 0.045, 0.045)),
    "head": ((0.0, 0.105, 0.010), (0.075, 0.110, 0.095)),
    "upper_arm": ((0.140, 0.0, 0.0), (0.140, 0.045, 0.045)),
    "lower_arm": ((0.125, 0.0, 0.0), (0.125, 0.035, 0.035)),
    "hand": ((0.090, 0.0, 0.005), (0.090, 0.020, 0.045)),
    "upper_leg": ((0.0, -0.210, 0.0), (0.070, 0.210, 0.070)),
    "lower_leg": ((0.0, -0.205, 0.0), (0.050, 0.205, 0.050)),
    "foot": ((0.0, -0.045, 0.045), (0.042, 0.040, 0.100)),
    "toes": ((0.0, -0.010, 0.035), (0.042, 0.020, 0.040)),
}


@cache
def default_figure() -> Skeleton:
    """The figure that everything starts with (21 joints); the same object every time."""
    names: list[str] = []
    parents: list[int] = []
    offsets: list[tuple[float, float, float]] = []
    roles: dict[str, int] = {}
    keys: list[str] = []
    signs: list[float] = []
    for name, role, parent, offset in _CENTER:
        roles[role] = len(names)
        parents.append(-1 if parent is None else names.index(parent))
        names.append(name)
        offsets.append(offset)
        keys.append(name)
        signs.append(1.0)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for part, role, parent, (x, y, z) in _SIDE:
            roles[side + role] = len(names)
            parents.append(names.index(parent if parent in names else f"{side}_{parent}"))
            names.append(f"{side}_{part}")
            offsets.append((sign * x, y, z))
            keys.append(part)
            signs.append(sign)
    count = len(names)
    masses, centers = np.zeros(count), np.zeros((count, 3))
    box_centers, box_sizes = np.zeros((count, 3)), np.zeros((count, 3))
    for joint, (key, sign) in enumerate(zip(keys, signs, strict=True)):
        mirror = np.array([sign, 1.0, 1.0])
        if key in _MASS:
            share, center = _MASS[key]
            masses[joint] = share * BODY_MASS
            centers[joint] = np.array(center) * mirror
        if key in _BOX:
            center, half = _BOX[key]
            box_centers[joint] = np.array(center) * mirror
            box_sizes[joint] = half
    return Skeleton(tuple(names), np.array(parents), np.array(offsets), roles, masses, centers, box_centers, box_sizes)
