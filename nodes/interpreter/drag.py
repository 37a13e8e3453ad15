"""Dragging a point: the plane it moves on and what is added across the picture (Oshita 2013, 5.1).

The plane is chosen when the finger comes down and is carried by the figure's heading frame, so that it neither
flips in mid-drag nor stays behind when the figure walks.
"""

from dataclasses import dataclass
from math import atan2, cos, exp, pi, sin

import numpy as np

from bunraku.figure.camera import forward, on_plane, wrap
from bunraku.figure.quat import inv_rotate, rotate
from bunraku.nodes.interpreter.core import Array, Scene
from bunraku.nodes.interpreter.rules import RULES, TouchRules


def heading_of(turn: Array) -> float:
    """The heading (rad about +Y from +Z) of an orientation (4): the twist of its swing-twist parts."""
    return wrap(2.0 * atan2(float(turn[1]), float(turn[3])))


@dataclass(frozen=True)
class HeadingFrame:
    """A level frame at (x, z) m on the ground, turned by ``yaw``: where the figure stands and faces."""

    x: float
    z: float
    yaw: float

    def vector_to_world(self, v: Array) -> Array:
        """A direction (3) of this frame in the world."""
        c, s = cos(self.yaw), sin(self.yaw)
        return np.array([c * v[0] + s * v[2], v[1], -s * v[0] + c * v[2]])

    def vector_to_local(self, v: Array) -> Array:
        """A world direction (3) in this frame."""
        c, s = cos(self.yaw), sin(self.yaw)
        return np.array([c * v[0] - s * v[2], v[1], s * v[0] + c * v[2]])

    def to_world(self, p: Array) -> Array:
        """A point (3) of this frame in the world."""
        moved: Array = self.vector_to_world(p) + np.array([self.x, 0.0, self.z])
        return moved

    def to_local(self, p: Array) -> Array:
        """A world point (3) in this frame."""
        return self.vector_to_local(p - np.array([self.x, 0.0, self.z]))


class Carrier:
    """The heading frame that carries the drag planes.

    It stands between those feet that no finger holds: they tell a walk from a reach, which moves the pelvis only.
    A change of which feet count never moves it; its yaw is the pelvis's, low-passed.
    """

    def __init__(self, rules: TouchRules = RULES) -> None:
        self.rules = rules
        self.bias = np.zeros(2)
        self.feet: tuple[bool, bool] = (True, True)
        self.yaw: float | None = None
        self.place = np.zeros(2)

    def frame(self, scene: Scene, held_feet: tuple[bool, bool], dt: float) -> HeadingFrame:
        """The frame now; ``held_feet``: whether fingers hold the left and the right foot."""
        feet = (not held_feet[0], not held_feet[1])
        middle = self._middle(scene, feet)
        if self.yaw is None:
            self.bias = np.zeros(2)
            self.yaw = heading_of(scene.turns[0])
        else:
            if feet != self.feet:
                self.bias = self.place - middle
            turned = wrap(heading_of(scene.turns[0]) - self.yaw)
            self.yaw = wrap(self.yaw + turned * (1.0 - exp(-dt / self.rules.heading_lag)))
        self.feet = feet
        self.place = middle + self.bias
        return HeadingFrame(float(self.place[0]), float(self.place[1]), self.yaw)

    def reset(self) -> None:
        """Nothing is held: the next grab begins afresh."""
        self.yaw = None

    def _middle(self, scene: Scene, feet: tuple[bool, bool]) -> Array:
        joints = [int(scene.rig.limbs[2 + side, 2]) for side in range(2) if feet[side]] or [0]
        middle: Array = scene.positions[joints][:, [0, 2]].mean(axis=0)
        return middle


class DragPlane:
    """The plane that a touched point moves on (eqs. 7-8)."""

    def __init__(self, scene: Scene, frame: HeadingFrame, point: Array, rules: TouchRules = RULES) -> None:
        """Through the touched ``point`` (3), square to the heading axis that is most along the camera's view."""
        self.rules = rules
        self.axis = nearest_axis(frame, forward(scene.camera))
        self.origin = frame.to_local(point)
        self.last = self.origin
        self.shift = np.zeros(3)
        """From where the ray meets the plane to the dragged point, after the view was moved under the finger."""

    def view_moved(self, scene: Scene, frame: HeadingFrame, origin: Array, direction: Array) -> None:
        """Another finger moved the camera: the point stays, on the plane that the new view chooses."""
        self.axis = nearest_axis(frame, forward(scene.camera))
        self.origin, self.shift = self.last, np.zeros(3)
        point = self.last
        self.shift = point - self.crossing(frame, origin, direction)
        self.last = point

    def crossing(self, frame: HeadingFrame, origin: Array, direction: Array) -> Array:
        """Where a touch ray meets the plane, in the heading frame (3).

        A plane that the ray grazes is chosen anew through the last point; a ray that never meets it, or only far
        from the figure, gives the last point's direction at `TouchRules.far`.
        """
        o, d = frame.to_local(origin), frame.vector_to_local(direction)
        if abs(float(d[self.axis])) < self.rules.graze:
            self.axis = int(np.argmax(np.abs(d)))
            self.origin = self.last
        normal = np.zeros(3)
        normal[self.axis] = 1.0
        t = on_plane(o, d, self.origin, normal)
        if t is None:
            return self.last
        point = o + t * d + self.shift
        middle = np.array([0.0, 1.0, 0.0])
        away = float(np.linalg.norm(point - middle))
        if away > self.rules.far:
            point = middle + (point - middle) * (self.rules.far / away)
        self.last = point
        return point

    def normal(self, frame: HeadingFrame) -> Array:
        """Its unit normal in the world (3)."""
        axis = np.zeros(3)
        axis[self.axis] = 1.0
        return frame.vector_to_world(axis)


def nearest_axis(frame: HeadingFrame, view: Array) -> int:
    """The heading axis (0 X, 1 Y, 2 Z) with the largest |axis · view|."""
    return int(np.argmax(np.abs(frame.vector_to_local(view))))


class GripOffset:
    """From the touched point to the joint that follows it, turning with the part (low-passed, so that the loop
    through the pose settles)."""

    def __init__(self, turn: Array, joint: Array, touched: Array, rules: TouchRules = RULES) -> None:
        """``turn`` (4) and ``joint`` (3): the part's orientation and place; ``touched`` (3): the point on it."""
        self.rules = rules
        self.world = joint - touched
        self.local = np.empty(3)
        inv_rotate(turn, self.world, self.local)

    def update(self, turn: Array, dt: float) -> Array:
        """The offset now (3, world m)."""
        aim = np.empty(3)
        rotate(turn, self.local, aim)
        self.world = self.world + (aim - self.world) * (1.0 - exp(-dt / self.rules.offset_lag))
        return self.world


class SpeedOffset:
    """How far a quick drag carries a hand or foot forward (eqs. 9-10)."""

    def __init__(self, rules: TouchRules = RULES) -> None:
        self.rules = rules
        self.smooth: Array | None = None
        self.value = 0.0
        self.back = 0.0  # m/s at which it goes back
        self.direction = np.zeros(3)
        self.forward = False
        """Whether the view has a forward direction now (eq. 9)."""

    def update(self, frame: HeadingFrame, point: Array, ray: Array, room: float, dt: float) -> Array:
        """The offset now (3, world m).

        Args:
            point: (3) the dragged point in the heading frame.
            ray: (3) the touch ray's unit direction, world.
            room: m that the limb's reach leaves along the offset's direction.
        """
        rules = self.rules
        if self.smooth is None:
            self.smooth = point
        # The low-passed point lags by speed times lag: its distance is the speed, at any sample rate.
        self.smooth = self.smooth + (point - self.smooth) * (1.0 - exp(-dt / rules.speed_lag))
        speed = float(np.linalg.norm(point - self.smooth)) / rules.speed_lag
        way = forward_direction(frame, ray, rules.forward_cos)
        wanted = 0.0
        self.forward = way is not None
        if way is not None:
            self.direction = way
            wanted = min(max(0.0, speed - rules.speed_threshold) * rules.speed_gain, max(0.0, room))
        rest = wanted - self.value
        if rest > 0.0:
            self.back = 0.0
            self.value += min(rest * (1.0 - exp(-dt / rules.speed_attack)), rules.speed_rise * dt)
        else:
            # It goes back gently at first: a fist stays out for a moment.
            self.back += (-rest / rules.speed_release - self.back) * (1.0 - exp(-dt / rules.speed_ease))
            self.value = max(wanted, self.value - self.back * dt)
        self.value = min(self.value, max(self.value - 4.0 * dt, max(0.0, room)))
        return self.direction * self.value

    @property
    def moving(self) -> bool:
        """Whether time alone still changes it."""
        return self.value > 1e-4


def forward_direction(frame: HeadingFrame, ray: Array, least_cos: float) -> Array | None:
    """d_forward of eq. 9: along or against the ray, whichever is forward from the figure; None beyond 45°."""
    facing = float(ray[0]) * sin(frame.yaw) + float(ray[2]) * cos(frame.yaw)
    if facing > least_cos:
        return ray
    if facing < -least_cos:
        return -ray
    return None


def reach_room(root: Array, point: Array, direction: Array, reach: float) -> float:
    """m from ``point`` along a unit ``direction`` to the sphere of ``reach`` about ``root``; 0 from outside it."""
    offset = point - root
    b = float(offset @ direction)
    c = float(offset @ offset) - reach * reach
    if c >= 0.0:
        return 0.0
    return float(-b + (b * b - c) ** 0.5)


def clearance_offset(
    scene: Scene, joints: list[int], point: Array, way: Array, margin: float, rules: TouchRules = RULES
) -> float:
    """m that a point must go along the unit ``way`` to keep clear of the boxes of ``joints`` (eq. 11).

    Grows from nothing at ``margin`` (m) beside a box to the whole at its edge, so that it has no jump.
    """
    most = 0.0
    local = np.empty(3)
    for joint in joints:
        turn, half = scene.turns[joint], scene.rig.box_sizes[joint]
        inv_rotate(turn, point - scene.positions[joint], local)
        start = local - scene.rig.box_centers[joint]
        inv_rotate(turn, way, local)
        along = local
        radius = rules.hand_radius + rules.clear
        front = float(np.abs(along) @ half) + radius
        depth = front - float(start @ along)
        if depth <= 0.0:
            continue
        beside = gap_to_line(start, along, half) - rules.hand_radius
        if beside >= margin:
            continue
        share = 1.0 - max(0.0, beside) / margin
        most = max(most, depth * share * share * (3.0 - 2.0 * share))
    return most


def gap_to_line(start: Array, along: Array, half: Array) -> float:
    """The distance (m) of a box around the origin from a whole line, by alternate projection."""
    t = -float(start @ along)
    gap = 0.0
    for _ in range(10):
        on_line = start + t * along
        in_box = np.clip(on_line, -half, half)
        gap = float(np.linalg.norm(on_line - in_box))
        nearer = float((in_box - start) @ along)
        if gap < 1e-6 or abs(nearer - t) < 1e-5:
            break
        t = nearer
    return gap


def unwrapped(angle: float, near: float) -> float:
    """The angle plus full turns that is nearest to ``near``."""
    return near + (angle - near + pi) % (2.0 * pi) - pi
