"""The mannequin as round cones: for shadows, and for drawing without OpenGL."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.mannequin import BODY, JOINT, SIDES, VISOR, Color, Measures, X, Y, Z, arm_frame
from bunraku.figure.mesh import matrices
from bunraku.figure.skeleton import Skeleton

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Capsules:
    """The figure as round cones, one joint each: for shadows, and for drawing without OpenGL."""

    joints: NDArray[np.int64]  # (C,)
    starts: Array  # (C, 3) m in the joint's frame
    ends: Array  # (C, 3)
    radii: Array  # (C, 2) m at start and end
    colors: Array  # (C, 3) 0..1, sRGB

    def placed(self, positions_ws: Array, rotations_ws: Array) -> tuple[Array, Array]:
        """World (C, 3) starts and ends for joint positions (J, 3) and orientations (J, 4)."""
        turns = matrices(rotations_ws)[self.joints]
        base = np.asarray(positions_ws, dtype=np.float64)[self.joints]
        return (
            np.einsum("nij,nj->ni", turns, self.starts) + base,
            np.einsum("nij,nj->ni", turns, self.ends) + base,
        )


def capsules(skeleton: Skeleton) -> Capsules:
    """The mannequin as some thirty round cones; raises `SkeletonError` as `build` does."""
    body = Measures.of(skeleton)
    g = body.girth
    rows: list[tuple[str, Array, float, Array, float, Color]] = []

    def add(role: str, a: Array, ra: float, b: Array, rb: float, color: Color) -> None:
        rows.append((role, a, ra * g, b, rb * g, color))

    hips, spine, breast, throat, head = (
        body.at("hips"),
        body.at("spine"),
        body.at(body.breast),
        body.throat,
        body.at("head"),
    )
    hip = (body.at("leftUpperLeg") + body.at("rightUpperLeg")) / 2.0
    wide = abs(body.at("leftUpperArm")[0] - body.at("rightUpperArm")[0]) / 2.0
    top = np.array([hips[0], max(hip[1] + 0.075 * g, hips[1] + 0.2 * (spine[1] - hips[1])), hips[2]])
    across = 0.042 * g * X
    add("hips", top - across, 0.088, top + across, 0.088, BODY)
    add("hips", top - 0.01 * g * Y, 0.088, hip - 0.005 * g * Y - 0.012 * g * Z, 0.070, BODY)
    low = breast + (0.045 * g if body.breast != "spine" else 0.12 * g) * Y
    middle = throat - 0.105 * g * Y
    add("spine", spine + 0.01 * g * Y, 0.086, low - 0.03 * g * Y, 0.080, JOINT)
    add(body.breast, low, 0.084, middle, 0.104, BODY)
    for x in (-1.0, 1.0):
        add(body.breast, low + x * 0.020 * g * X, 0.078, middle + x * (wide - 0.108 * g) * X, 0.088, BODY)
        add(
            body.breast,
            throat - 0.04 * g * Y,
            0.052,
            throat - 0.062 * g * Y + x * (wide - 0.065 * g) * X,
            0.046,
            BODY,
        )
    add("neck" if body.has("neck") else "head", throat - 0.01 * g * Y, 0.047, head + 0.02 * g * Y, 0.042, JOINT)
    at = head + 0.004 * g * Z
    add("head", at + np.array([0, 0.022, 0.030]) * g, 0.046, at + np.array([0, 0.122, 0.002]) * g, 0.082, BODY)
    add("head", at + np.array([0, 0.100, 0.012]) * g, 0.070, at + np.array([0, 0.125, -0.014]) * g, 0.080, BODY)
    brow = [at + np.array([x, 0.098, 0.077 - 11.0 * x * x]) * g for x in (-0.056, -0.028, 0.0, 0.028, 0.056)]
    for a, b in pairwise(brow):
        add("head", a, 0.0175, b, 0.0175, VISOR)
    for side, (_, accent) in SIDES.items():
        shoulder, elbow, wrist = (body.at(side + part) for part in ("UpperArm", "LowerArm", "Hand"))
        arm, fore = (
            (elbow - shoulder) / np.linalg.norm(elbow - shoulder),
            (wrist - elbow) / np.linalg.norm(wrist - elbow),
        )
        add(side + "UpperArm", shoulder, 0.056, shoulder, 0.056, accent)
        add(side + "UpperArm", shoulder + arm * 0.07 * g, 0.047, elbow - arm * 0.055 * g, 0.037, BODY)
        add(side + "LowerArm", elbow, 0.037, elbow, 0.037, JOINT)
        add(side + "LowerArm", elbow + fore * 0.055 * g, 0.040, wrist - fore * 0.038 * g, 0.027, BODY)
        add(side + "Hand", wrist, 0.026, wrist, 0.026, JOINT)
        up, ahead, _ = arm_frame(fore)
        for z in (-0.016, 0.016):
            add(
                side + "Hand",
                wrist + (fore * 0.045 + ahead * z) * g,
                0.023,
                wrist + (fore * 0.095 + ahead * z * 1.3) * g,
                0.021,
                accent,
            )
            add(
                side + "Hand",
                wrist + (fore * 0.10 + ahead * z * 1.2) * g,
                0.017,
                wrist + (fore * 0.165 + ahead * z * 1.3 - up * 0.02) * g,
                0.011,
                accent,
            )
        add(
            side + "Hand",
            wrist + (fore * 0.035 + ahead * 0.02) * g,
            0.014,
            wrist + (fore * 0.09 + ahead * 0.06 - up * 0.018) * g,
            0.010,
            accent,
        )
        top_leg, knee, ankle = (body.at(side + part) for part in ("UpperLeg", "LowerLeg", "Foot"))
        thigh, shin = (knee - top_leg) / np.linalg.norm(knee - top_leg), (ankle - knee) / np.linalg.norm(ankle - knee)
        add(side + "UpperLeg", top_leg, 0.080, top_leg, 0.080, accent)
        add(side + "UpperLeg", top_leg + thigh * 0.10 * g, 0.077, knee - thigh * 0.075 * g, 0.049, BODY)
        add(side + "LowerLeg", knee, 0.0485, knee, 0.0485, JOINT)
        add(side + "LowerLeg", knee + shin * 0.085 * g, 0.050, ankle - shin * 0.062 * g, 0.031, BODY)
        add(side + "Foot", ankle, 0.035, ankle, 0.035, JOINT)
        bend, ground = body.toes(side), body.sole(side)
        ahead = (bend - ankle) * [1.0, 0.0, 1.0]
        ahead = ahead / np.linalg.norm(ahead) if np.linalg.norm(ahead) > 1e-3 else Z
        floor = np.array([0.0, ground, 0.0])
        heel = ankle * [1, 0, 1] + floor + (0.036 * Y - 0.022 * ahead) * g
        add(side + "Foot", heel, 0.036, bend * [1, 0, 1] + floor + (0.026 * Y - 0.01 * ahead) * g, 0.026, accent)
        toe_role = side + "Toes" if body.has(side + "Toes") else side + "Foot"
        for x in (-0.017, 0.017):
            root = bend * [1, 0, 1] + floor + (0.024 * Y + x * np.cross(Y, ahead)) * g
            add(
                toe_role,
                root,
                0.023,
                root + (0.05 * ahead - 0.008 * Y - 0.3 * x * np.cross(Y, ahead)) * g,
                0.015,
                accent,
            )
    rest = skeleton.rest_positions
    joints = np.array([skeleton.role(row[0]) for row in rows], dtype=np.int64)
    return Capsules(
        joints,
        np.array([row[1] for row in rows]) - rest[joints],
        np.array([row[3] for row in rows]) - rest[joints],
        np.array([[row[2], row[4]] for row in rows]),
        np.array([row[5] for row in rows]),
    )
