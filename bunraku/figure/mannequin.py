"""The mannequin: a mesh for any humanoid skeleton, generated from its bone lengths.

Every part is rigid and belongs to one joint: lofted segments of cream, slate balls at the joints, teal for
the figure's left and coral for its right, a dark visor that shows where it looks. Parts overlap at the
joints, so that nothing opens however they bend.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.mesh import Mesh
from bunraku.figure.skeleton import Skeleton
from bunraku.figure.solids import Rows, Solid, ellipsoid, loft, visor

Array = NDArray[np.float64]

Color = tuple[float, float, float]
BODY: Color = (0.885, 0.805, 0.705)
JOINT: Color = (0.19, 0.21, 0.26)
LEFT: Color = (0.11, 0.54, 0.58)
RIGHT: Color = (0.90, 0.42, 0.30)
VISOR: Color = (0.10, 0.12, 0.16)

HEIGHT = 1.405
"""m, the default figure's leg (hip to ankle) and trunk (hips to head joint) together: girth 1."""

X, Y, Z = np.eye(3)


@dataclass(frozen=True)
class Detail:
    """How finely the mannequin is cut."""

    around: int
    """Vertices around a limb."""
    along: int
    """Rings between two of a profile's rows."""


LOW = Detail(8, 1)
MEDIUM = Detail(12, 1)
HIGH = Detail(18, 2)


@dataclass(frozen=True, eq=False)
class Measures:
    """What the parts are measured by: the skeleton's joints at rest and the body's girth."""

    skeleton: Skeleton
    girth: float

    @classmethod
    def of(cls, skeleton: Skeleton) -> "Measures":
        """Measure a humanoid; raises `SkeletonError` where a required role is missing."""
        skeleton.check_humanoid()
        rest = skeleton.rest_positions

        def leg(side: str) -> float:
            hip, knee, ankle = (rest[skeleton.role(side + part)] for part in ("UpperLeg", "LowerLeg", "Foot"))
            return float(np.linalg.norm(knee - hip) + np.linalg.norm(ankle - knee))

        trunk = float(np.linalg.norm(rest[skeleton.role("head")] - rest[skeleton.role("hips")]))
        return cls(skeleton, max(((leg("left") + leg("right")) / 2.0 + trunk) / HEIGHT, 1e-3))

    def has(self, role: str) -> bool:
        """Whether a joint plays the role."""
        return role in self.skeleton.roles

    def at(self, role: str) -> Array:
        """(3) m, the role's joint at rest."""
        out: Array = self.skeleton.rest_positions[self.skeleton.role(role)]
        return out

    @property
    def breast(self) -> str:
        """The topmost back role, which carries the ribs."""
        return next(role for role in ("upperChest", "chest", "spine") if self.has(role))

    @property
    def throat(self) -> Array:
        """(3) m, where the neck begins."""
        if self.has("neck"):
            return self.at("neck")
        head, breast = self.at("head"), self.at(self.breast)
        return head + (breast - head) * 0.25

    def sole(self, side: str) -> float:
        """m, the height of the ground under a foot at rest."""
        ankle = self.at(side + "Foot")[1]
        if 0.3 < ankle / (0.085 * self.girth) < 2.5:  # the skeleton stands on the ground at rest
            return 0.0
        return float(ankle - 0.085 * self.girth)

    def toes(self, side: str) -> Array:
        """(3) m, where the toes bend."""
        if self.has(side + "Toes"):
            return self.at(side + "Toes")
        ankle = self.at(side + "Foot")
        return np.array([ankle[0], self.sole(side) + 0.03 * self.girth, ankle[2] + 0.135 * self.girth])


SIDES: Mapping[str, tuple[float, Color]] = {"left": (1.0, LEFT), "right": (-1.0, RIGHT)}


def build(skeleton: Skeleton, detail: Detail = MEDIUM) -> Mesh:
    """The mannequin of a humanoid skeleton; raises `SkeletonError` where a required role is missing."""
    body = Measures.of(skeleton)
    parts: list[tuple[int, Solid, Color]] = []
    for role, solid, color in (*_trunk(body, detail), *_head(body, detail)):
        parts.append((skeleton.role(role), solid, color))
    for side in SIDES:
        for role, solid, color in (*_arm(body, side, detail), *_hand(body, side, detail), *_leg(body, side, detail)):
            parts.append((skeleton.role(role), solid, color))
    parts.sort(key=lambda part: part[0])
    starts = np.cumsum([0, *(len(solid.positions) for _, solid, _ in parts)])
    return Mesh(
        positions=np.concatenate([solid.positions for _, solid, _ in parts]).astype(np.float32),
        normals=np.concatenate([solid.normals() for _, solid, _ in parts]).astype(np.float32),
        colors=np.concatenate([np.outer(solid.shade, color) for _, solid, color in parts]).astype(np.float32),
        joints=np.concatenate([np.full(len(solid.positions), joint) for joint, solid, _ in parts]).astype(np.uint16),
        indices=np.concatenate(
            [solid.faces + start for (_, solid, _), start in zip(parts, starts[:-1], strict=True)]
        ).astype(np.uint32),
        rest=skeleton.rest_positions.astype(np.float32),
    )


Part = tuple[str, Solid, Color]


def _ball(center: Array, radius: float, d: Detail) -> Solid:
    return ellipsoid(center, radius, around=d.around + 2, along=d.around // 2 + 1)


def _trunk(body: Measures, d: Detail) -> list[Part]:
    g = body.girth
    hips, spine, breast = body.at("hips"), body.at("spine"), body.at(body.breast)
    spread = abs(body.at("leftUpperLeg")[0] - body.at("rightUpperLeg")[0]) / 0.19 / g
    wide = abs(body.at("leftUpperArm")[0] - body.at("rightUpperArm")[0]) / 0.36 / g
    joint = (body.at("leftUpperLeg") + body.at("rightUpperLeg")) / 2.0
    out: list[Part] = []
    pelvis = Rows.of(
        (0.00, 0.050 * spread, 0.060, 0, -0.004), (0.22, 0.074 * spread, 0.080, 0, -0.008),
        (0.50, 0.108 * spread, 0.094, 0, -0.010), (0.76, 0.134 * spread, 0.096, 0, -0.005),
        (1.00, 0.124 * spread, 0.088, 0, 0.000), girth=g,
    )  # fmt: skip
    top = max(hips[1] + 0.35 * (spine[1] - hips[1]), joint[1] + 0.05 * g)
    out.append(("hips", loft(
        np.array([hips[0], joint[1] - 0.062 * g, joint[2]]), np.array([spine[0], top + 0.005 * g, spine[2]]), pelvis,
        around=d.around + 8, along=d.along, power=2.35, ends=(0.016 * g, 0.034 * g), blunt=(2.2, 2.3),
        dark=(0.25, 0.40)), BODY))  # fmt: skip
    # the belly: a ball for every joint below the ribs, the lowest carrying the large one
    lower = [role for role in ("spine", "chest") if body.has(role) and role != body.breast] or ["spine"]
    ribs_low = breast + (0.02 if body.breast != "spine" else 0.10) * g * Y
    for k, role in enumerate(lower):
        level = (k + 0.5) / len(lower)
        start = np.array([spine[0], top, spine[2]])
        center = start + (ribs_low - start) * level
        height = max(0.55 * float(np.linalg.norm(ribs_low - start)) / len(lower) + 0.022 * g, 0.06 * g)
        out.append((role, ellipsoid(
            center, (0.099 * g, height, 0.078 * g), around=d.around + 6,
            along=d.around // 2 + 2), JOINT))  # fmt: skip
    throat = body.throat
    ribs = Rows.of(
        (0.00, 0.094, 0.074, 0, 0.002), (0.26, 0.124, 0.096, 0, 0.008), (0.54, 0.150 * wide, 0.109, 0, 0.010),
        (0.74, 0.156 * wide, 0.102, 0, 0.004), (0.90, 0.126 * wide, 0.079, 0, -0.006),
        (1.00, 0.078 * wide, 0.056, 0, -0.010), girth=g,
    )  # fmt: skip
    out.append((body.breast, loft(
        ribs_low - 0.060 * g * Y, throat + 0.005 * g * Y, ribs, around=d.around + 8, along=d.along, power=2.3,
        ends=(0.026 * g, 0.014 * g), blunt=(2.4, 2.2), dark=(0.40, 0.15)), BODY))  # fmt: skip
    return out


def _head(body: Measures, d: Detail) -> list[Part]:
    g = body.girth
    head, throat = body.at("head"), body.throat
    neck = Rows.of((0.0, 0.054, 0.056, 0, -0.004), (0.35, 0.043, 0.045), (1.0, 0.041, 0.046, 0, 0.004), girth=g)
    role = "neck" if body.has("neck") else "head"
    out: list[Part] = [(role, loft(
        throat - 0.035 * g * Y, head + np.array([0.0, 0.035, 0.004]) * g, neck,
        around=d.around + 2, along=d.along, ends=(0.01 * g, 0.01 * g)), JOINT)]  # fmt: skip
    bottom, crown = head + np.array([0.0, -0.030, 0.012]) * g, head + np.array([0.0, 0.214, 0.012]) * g
    skull = Rows.of(
        (0.00, 0.027, 0.031, 0, 0.042), (0.08, 0.043, 0.051, 0, 0.032), (0.22, 0.059, 0.074, 0, 0.018),
        (0.40, 0.0705, 0.091, 0, 0.006), (0.58, 0.077, 0.0985, 0, 0.000), (0.72, 0.0765, 0.0985, 0, -0.003),
        (0.84, 0.0675, 0.087, 0, -0.005), (0.93, 0.050, 0.064, 0, -0.006), (0.98, 0.0285, 0.0365, 0, -0.006), girth=g,
    )  # fmt: skip
    out.append(("head", loft(
        bottom, crown, skull, around=d.around + 8, along=d.along + 1, power=2.08,
        ends=(0.012 * g, 0.0055 * g), blunt=(2.0, 2.0)), BODY))  # fmt: skip
    out.append(("head", visor(
        bottom, crown, skull, span=(0.44, 0.64), reach=1.25, lift=0.007 * g, across_n=d.around + 1,
        along_n=4 + 2 * d.along), VISOR))  # fmt: skip
    return out


def _arm(body: Measures, side: str, d: Detail) -> list[Part]:
    g = body.girth
    _, accent = SIDES[side]
    shoulder, elbow, wrist = (body.at(side + part) for part in ("UpperArm", "LowerArm", "Hand"))
    out: list[Part] = []
    if body.has(side + "Shoulder"):
        collar = body.at(side + "Shoulder")
        rows = Rows.of(
            (0.0, 0.046, 0.058, -0.004, -0.004), (0.55, 0.045, 0.056, 0, -0.002), (1.0, 0.042, 0.048), girth=g
        )
        reach = shoulder - collar
        out.append((side + "Shoulder", loft(
            collar + reach * 0.02, shoulder - reach / np.linalg.norm(reach) * 0.034 * g, rows, around=d.around,
            along=d.along, across=Y, power=2.1, ends=(0.03 * g, 0.010 * g), blunt=(2.0, 2.8),
            dark=(0.0, 0.25)), BODY))  # fmt: skip
    out.append((side + "UpperArm", _ball(shoulder, 0.056 * g, d), accent))
    bone = (elbow - shoulder) / np.linalg.norm(elbow - shoulder)
    upper = Rows.of(
        (0.00, 0.045, 0.050, 0.001, 0.000), (0.30, 0.046, 0.051, -0.003, 0.002), (0.62, 0.040, 0.046, -0.002, 0.003),
        (1.00, 0.034, 0.039), girth=g,
    )  # fmt: skip
    out.append((side + "UpperArm", loft(
        shoulder + bone * 0.046 * g, elbow - bone * 0.030 * g, upper, around=d.around, along=d.along, across=Y,
        power=2.1, ends=(0.010 * g, 0.010 * g), dark=(0.30, 0.30)), BODY))  # fmt: skip
    out.append((side + "LowerArm", _ball(elbow, 0.0365 * g, d), JOINT))
    bone = (wrist - elbow) / np.linalg.norm(wrist - elbow)
    lower = Rows.of(
        (0.00, 0.036, 0.038), (0.24, 0.040, 0.044, 0.001, 0.002), (0.62, 0.031, 0.037, 0, 0.001),
        (1.00, 0.023, 0.030), girth=g,
    )  # fmt: skip
    out.append((side + "LowerArm", loft(
        elbow + bone * 0.028 * g, wrist - bone * 0.020 * g, lower, around=d.around, along=d.along, across=Y,
        power=2.1, ends=(0.010 * g, 0.008 * g), dark=(0.30, 0.25)), BODY))  # fmt: skip
    return out


def _hand(body: Measures, side: str, d: Detail) -> list[Part]:
    """A palm, four fingers in a relaxed curl and a thumb, all carried by the hand joint; the palm looks down."""
    g = body.girth
    _, accent = SIDES[side]
    role = side + "Hand"
    wrist, elbow = body.at(role), body.at(side + "LowerArm")
    size = g * float(np.clip(np.linalg.norm(wrist - elbow) / (0.25 * g), 0.75, 1.35))
    bone = (wrist - elbow) / np.linalg.norm(wrist - elbow)
    up, ahead, bone = arm_frame(bone)
    slim = max(6, d.around // 2 + 1)
    out: list[Part] = [(role, _ball(wrist, 0.0255 * g, d), JOINT)]

    def place(x: float, y: float, z: float) -> Array:
        return wrist + (bone * x + up * y + ahead * z) * size

    palm = Rows.of(
        (0.00, 0.0165, 0.024), (0.40, 0.0175, 0.038, 0, 0.002), (1.00, 0.0135, 0.041, -0.002, 0.000), girth=size
    )
    out.append((role, loft(
        place(0.022, 0.0, 0.0), place(0.096, -0.003, 0.002), palm, around=d.around, along=d.along, across=up,
        front=ahead, power=2.6, ends=(0.010 * size, 0.008 * size), dark=(0.30, 0.0)), accent))  # fmt: skip
    # finger: where it leaves the palm, its length and its thickness (index to little)
    for z, x, length, thick in (
        (0.031, 0.094, 0.078, 0.0098), (0.0105, 0.099, 0.086, 0.0102),
        (-0.0105, 0.097, 0.080, 0.0097), (-0.030, 0.090, 0.064, 0.0088),
    ):  # fmt: skip
        curl = Rows.of(
            (0.0, 1.0, 1.0, 0.0, 0.0), (0.35, 0.98, 0.98, -0.35, 0.0), (0.7, 0.92, 0.92, -1.35, 0.0),
            (1.0, 0.74, 0.74, -2.9, 0.0), girth=thick * size,
        )  # fmt: skip
        out.append((role, loft(
            place(x - 0.012, -0.004, z), place(x + length * 0.90, -0.006, z * 1.16), curl, around=slim,
            along=d.along, across=up, front=ahead, ends=(0.004 * size, thick * 0.7 * size), blunt=(2.0, 2.0),
            dark=(0.35, 0.0)), accent))  # fmt: skip
    thumb = Rows.of(
        (0.0, 0.0125, 0.0135), (0.4, 0.0120, 0.0125, -0.001, 0.002), (0.75, 0.0108, 0.0115, -0.002, 0.000),
        (1.0, 0.0085, 0.009, -0.004, -0.004), girth=size,
    )  # fmt: skip
    out.append((role, loft(
        place(0.030, -0.006, 0.022), place(0.094, -0.020, 0.064), thumb, around=slim, along=d.along, across=up,
        front=ahead, ends=(0.008 * size, 0.007 * size), blunt=(2.0, 2.0), dark=(0.3, 0.0)), accent))  # fmt: skip
    return out


def arm_frame(bone: Array) -> tuple[Array, Array, Array]:
    """Unit (up, ahead, along) of an arm's bone, square to each other."""
    ahead = Z - bone * (Z @ bone)
    if np.linalg.norm(ahead) < 1e-3:
        ahead = np.cross(bone, Y)
    ahead = ahead / np.linalg.norm(ahead)
    up = np.cross(ahead, bone)
    return (up if up[1] >= 0.0 else -up), ahead, bone


def _leg(body: Measures, side: str, d: Detail) -> list[Part]:
    g = body.girth
    sign, accent = SIDES[side]
    hip, knee, ankle = (body.at(side + part) for part in ("UpperLeg", "LowerLeg", "Foot"))
    across = sign * X
    out: list[Part] = [(side + "UpperLeg", _ball(hip, 0.080 * g, d), accent)]
    bone = (knee - hip) / np.linalg.norm(knee - hip)
    thigh = Rows.of(
        (0.00, 0.074, 0.081, 0.002, 0.000), (0.30, 0.073, 0.081, 0.002, 0.005), (0.65, 0.059, 0.067, 0.000, 0.005),
        (1.00, 0.046, 0.052, 0.000, 0.001), girth=g,
    )  # fmt: skip
    out.append((side + "UpperLeg", loft(
        hip + bone * 0.050 * g, knee - bone * 0.040 * g, thigh, around=d.around + 2, along=d.along, across=across,
        power=2.1, ends=(0.014 * g, 0.012 * g), dark=(0.35, 0.30)), BODY))  # fmt: skip
    out.append((side + "LowerLeg", _ball(knee, 0.0485 * g, d), JOINT))
    bone = (ankle - knee) / np.linalg.norm(ankle - knee)
    shin = Rows.of(
        (0.00, 0.046, 0.049, 0, 0.000), (0.28, 0.049, 0.058, 0.001, -0.012), (0.62, 0.037, 0.044, 0, -0.008),
        (1.00, 0.028, 0.033, 0, -0.001), girth=g,
    )  # fmt: skip
    out.append((side + "LowerLeg", loft(
        knee + bone * 0.038 * g, ankle - bone * 0.030 * g, shin, around=d.around + 2, along=d.along, across=across,
        power=2.1, ends=(0.012 * g, 0.008 * g), dark=(0.30, 0.25)), BODY))  # fmt: skip
    out.append((side + "Foot", _ball(ankle, 0.0345 * g, d), JOINT))
    out += _foot(body, side, d)
    return out


def _foot(body: Measures, side: str, d: Detail) -> list[Part]:
    """Heel and instep on the foot joint, the toes on theirs where there is one; both with a flat sole."""
    g = body.girth
    sign, accent = SIDES[side]
    ankle, bend, ground = body.at(side + "Foot"), body.toes(side), body.sole(side)
    ahead = (bend - ankle) * [1.0, 0.0, 1.0]
    reach = float(np.linalg.norm(ahead))
    ahead = ahead / reach if reach > 1e-3 else Z
    size = g * float(np.clip(reach / (0.135 * g), 0.7, 1.4))
    level = np.array([0.0, ground, 0.0])
    across = np.cross(Y, ahead) * sign

    def place(base: Array, forward: float, height: float) -> Array:
        out: Array = base * [1.0, 0.0, 1.0] + ahead * forward * size + level + Y * height * g
        return out

    instep = Rows.of(
        (0.00, 0.026, 0.030, 0.000, 0.032), (0.12, 0.033, 0.038, 0.000, 0.036), (0.32, 0.036, 0.044, 0.000, 0.042),
        (0.50, 0.038, 0.040, 0.001, 0.036), (0.75, 0.043, 0.030, 0.002, 0.025), (1.00, 0.046, 0.022, 0.002, 0.019),
        girth=g,
    )  # fmt: skip
    heel, ball = place(ankle, -0.046, 0.0), place(bend, -0.004, 0.0)
    foot = loft(
        heel, ball, instep, around=d.around + 2, along=d.along, across=across, front=Y, power=2.4,
        ends=(0.016 * g, 0.014 * g), blunt=(2.2, 2.2))  # fmt: skip
    tip = Rows.of(
        (0.00, 0.0455, 0.0215, 0.002, 0.0185), (0.40, 0.046, 0.019, 0.000, 0.0165),
        (0.75, 0.040, 0.0155, -0.004, 0.0135),
        (1.00, 0.027, 0.012, -0.008, 0.0105), girth=g,
    )  # fmt: skip
    toes = loft(
        place(bend, 0.006, 0.0), place(bend, 0.070, 0.0), tip, around=d.around + 2, along=d.along, across=across,
        front=Y, power=2.3, ends=(0.012 * g, 0.012 * g), blunt=(2.2, 2.2), dark=(0.40, 0.0))  # fmt: skip
    role = side + "Toes" if body.has(side + "Toes") else side + "Foot"
    return [(side + "Foot", _flat(foot, ground + 0.001 * g), accent), (role, _flat(toes, ground + 0.001 * g), accent)]


def _flat(solid: Solid, ground: float) -> Solid:
    """The solid pressed flat from below at the height ``ground``."""
    positions = solid.positions.copy()
    low = positions[:, 1] < ground
    # keep the pressed vertices apart, so that no face loses its area
    positions[low, 1] = ground + 0.02 * (positions[low, 1] - ground)
    return Solid(positions, solid.faces, np.where(low, 0.6, solid.shade))
