"""Which part of the figure a touch starts on: the nearest box on its ray, or one within a finger's width of it."""

from dataclasses import dataclass
from math import tan
from typing import Literal

import numpy as np

from bunraku.figure.camera import Orbit, metres_per_height
from bunraku.figure.quat import inv_rotate, rotate
from bunraku.figure.skeleton import Skeleton
from bunraku.msgs import Camera
from bunraku.nodes.interpreter.core import Array, Scene

Kind = Literal["pelvis", "end", "middle", "trunk", "head"]


@dataclass(frozen=True)
class Part:
    """A part that can be grabbed: its name in the target message and the joint that the target moves."""

    name: str
    kind: Kind
    joint: int


@dataclass(frozen=True)
class Hit:
    """Where a touch met the figure."""

    part: Part
    point: Array  # (3) m, on the part's box
    distance: float  # m along the ray


_ENDS = {"Hand": "hand", "Foot": "foot"}
_LIMBS = (
    ("UpperArm", "LowerArm", "elbow", "hand", "trunk"),
    ("UpperLeg", "LowerLeg", "knee", "foot", "pelvis"),
)
_MIDDLES = {"LowerArm": "elbow", "LowerLeg": "knee"}


class PartTable:
    """Who owns which box of a skeleton.

    A limb's bones are shared out along their length: the half near a hand belongs to the hand, the ends near
    elbow and knee to those, the ends at the trunk to trunk and pelvis (`SHOULDER`, `ELBOW`: shares of the bone).
    A joint without a role (a finger, a twist bone) belongs to what it hangs from.
    """

    SHOULDER = 0.25
    ELBOW = 0.45

    def __init__(self, skeleton: Skeleton) -> None:
        roles = skeleton.roles
        top = int(skeleton.back[-1])
        self.parts: dict[str, Part] = {
            "pelvis": Part("pelvis", "pelvis", roles["hips"]),
            "trunk": Part("trunk", "trunk", top),
            "head": Part("head", "head", roles["head"]),
        }
        for side in ("left", "right"):
            for role, name in _ENDS.items():
                self.parts[f"{side}_{name}"] = Part(f"{side}_{name}", "end", roles[side + role])
            for role, name in _MIDDLES.items():
                self.parts[f"{side}_{name}"] = Part(f"{side}_{name}", "middle", roles[side + role])
        owner: dict[int, list[tuple[float, Part]]] = {
            roles["hips"]: [(np.inf, self.parts["pelvis"])],
            roles["head"]: [(np.inf, self.parts["head"])],
        }
        if "neck" in roles:
            owner[roles["neck"]] = [(np.inf, self.parts["head"])]
        for joint in skeleton.back:
            owner[int(joint)] = [(np.inf, self.parts["trunk"])]
        self.axis: dict[int, Array] = {}
        for side in ("left", "right"):
            for near, far, middle, end, body in _LIMBS:
                upper, lower, last = roles[side + near], roles[side + far], roles[f"{side}{end.capitalize()}"]
                owner[upper] = [(self.SHOULDER, self.parts[body]), (np.inf, self.parts[f"{side}_{middle}"])]
                owner[lower] = [(self.ELBOW, self.parts[f"{side}_{middle}"]), (np.inf, self.parts[f"{side}_{end}"])]
                owner[last] = [(np.inf, self.parts[f"{side}_{end}"])]
                self.axis[upper], self.axis[lower] = skeleton.offsets[lower], skeleton.offsets[last]
        self.owner = owner
        for joint in range(len(skeleton)):
            if joint not in owner:
                owner[joint] = owner.get(int(skeleton.parents[joint]), [(np.inf, self.parts["pelvis"])])[-1:]
        self.boxes = [joint for joint in range(len(skeleton)) if skeleton.box_sizes[joint].min() > 0.0]

    def part_at(self, joint: int, local: Array) -> Part:
        """Who owns a point (3) of a joint's box, in the joint's frame."""
        share = 0.0
        if joint in self.axis:
            axis = self.axis[joint]
            share = float(local @ axis) / max(float(axis @ axis), 1e-12)
        return next(part for limit, part in self.owner[joint] if share < limit)


def slab(origin: Array, direction: Array, half: Array) -> tuple[float, float] | None:
    """Where a ray enters and leaves a box around the origin, in ray lengths; None where it passes by."""
    enter, leave = -np.inf, np.inf
    for k in range(3):
        o, d, h = float(origin[k]), float(direction[k]), float(half[k])
        if abs(d) < 1e-12:
            if abs(o) > h:
                return None
            continue
        a, b = (-h - o) / d, (h - o) / d
        enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
    return (enter, leave) if enter <= leave and leave > 0.0 else None


def nearest_on_box(origin: Array, direction: Array, half: Array) -> tuple[Array, float]:
    """The box point (3) nearest to a ray, and the ray length there, by alternate projection."""
    t = max(0.0, -float(origin @ direction))
    point = np.clip(origin + t * direction, -half, half)
    for _ in range(12):
        nearer = max(0.0, float((point - origin) @ direction))
        if abs(nearer - t) < 1e-6:
            break
        t = nearer
        point = np.clip(origin + t * direction, -half, half)
    return point, t


def pick(table: PartTable, scene: Scene, origin: Array, direction: Array, finger: float) -> list[Hit]:
    """What a touch ray (origin, unit direction) may mean, the best first; empty for nothing.

    ``finger`` is the radius of a finger as a share of the picture's height; only where no box is hit does it
    reach for the box that is nearest on the picture.
    """
    hits: list[Hit] = []
    near: list[tuple[float, Hit]] = []
    local_o, local_d, world = np.empty(3), np.empty(3), np.empty(3)
    for joint in table.boxes:
        turn, center, half = scene.turns[joint], scene.rig.box_centers[joint], scene.rig.box_sizes[joint]
        inv_rotate(turn, origin - scene.positions[joint], local_o)
        inv_rotate(turn, direction, local_d)
        start = local_o - center
        crossing = slab(start, local_d, half)
        if crossing is not None:
            t = max(0.0, crossing[0])
            point = start + t * local_d + center
            hits.append(Hit(table.part_at(joint, point), origin + t * direction, t))
            continue
        if hits:
            continue
        spot, t = nearest_on_box(start, local_d, half)
        if t <= 0.0:
            continue
        gap = float(np.linalg.norm(start + t * local_d - spot))
        share = gap / span(scene.camera, origin + t * direction)
        if share <= finger:
            rotate(turn, spot + center, world)
            near.append((share, Hit(table.part_at(joint, spot + center), world + scene.positions[joint], t)))
    if hits:
        return sorted(hits, key=lambda hit: hit.distance)
    return [hit for _, hit in sorted(near, key=lambda one: one[0])]


def span(camera: Camera, point: Array) -> float:
    """Metres that the picture's height spans at a point; of the near distance for a point behind the camera."""
    metres = metres_per_height(camera, point)
    return max(metres, 0.1 * tan(0.5 * (camera.yfov or Orbit.yfov)))
