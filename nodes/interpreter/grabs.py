"""What a finger on a part of the figure means: a point, a turn, or the pelvis with its steps (Oshita 2013, 5)."""

from dataclasses import dataclass
from math import atan2, exp, sqrt

import numpy as np

from bunraku.figure.camera import wrap
from bunraku.figure.quat import between, from_axis_angle, inv_mul, mul, rotate, swing_twist_y
from bunraku.figure.quat import log as quat_log
from bunraku.figure.quat import scale as quat_scale
from bunraku.figure.support import closest_point, margin_in_hull, support_polygon
from bunraku.msgs import Step
from bunraku.nodes.interpreter.core import Array, Scene
from bunraku.nodes.interpreter.drag import (
    DragPlane,
    GripOffset,
    HeadingFrame,
    SpeedOffset,
    clearance_offset,
    heading_of,
    reach_room,
    unwrapped,
)
from bunraku.nodes.interpreter.picking import Hit, Part
from bunraku.nodes.interpreter.rules import RULES, TouchRules


@dataclass(frozen=True, eq=False)
class Ray:
    """A touch line."""

    origin: Array  # (3) m
    direction: Array  # (3) unit


def body_joints(scene: Scene, part: str) -> list[int]:
    """The boxes that a dragged hand or foot keeps clear of: the body's, for a foot also the other leg's."""
    roles = scene.skeleton.roles
    names = ["hips", "spine", "chest", "upperChest", "neck", "head"]
    if part.endswith("_foot"):
        other = "right" if part.startswith("left") else "left"
        names = ["hips", f"{other}UpperLeg", f"{other}LowerLeg", f"{other}Foot"]
    return [roles[name] for name in names if name in roles and scene.rig.box_sizes[roles[name]].min() > 0.0]


class PointGrab:
    """A hand or foot, or an elbow or knee, dragged on its plane (5.1, eqs. 7-11)."""

    def __init__(self, scene: Scene, frame: HeadingFrame, hit: Hit, rules: TouchRules = RULES) -> None:
        self.rules = rules
        self.part = hit.part
        joint = hit.part.joint
        self.plane = DragPlane(scene, frame, hit.point, rules)
        self.start = self.plane.origin
        self.offset = GripOffset(scene.turns[joint], scene.positions[joint], hit.point, rules)
        self.speed = SpeedOffset(rules)
        self.clear = 0.0
        self.dragged = 0.0
        self.end = hit.part.kind == "end"
        if self.end:
            limb = next(n for n in range(4) if int(scene.rig.limbs[n, 2]) == joint)
            self.arm = limb < 2
            self.root = int(scene.rig.limbs[limb, 0])
            self.reach = float(scene.rig.lengths[limb].sum())
            self.body = body_joints(scene, hit.part.name)
        self.value: tuple[float, ...] = ()

    def update(self, scene: Scene, frame: HeadingFrame, ray: Ray, dt: float) -> tuple[float, ...]:
        """The joint's target, world m."""
        rules = self.rules
        local = self.plane.crossing(frame, ray.origin, ray.direction)
        point = frame.to_world(local) + self.offset.update(scene.turns[self.part.joint], dt)
        if self.end:
            self.dragged = max(self.dragged, float(np.linalg.norm(local - self.start)))
            root = scene.positions[self.root]
            room = reach_room(root, point, self.speed.direction, self.reach * rules.overreach)
            point = point + self.speed.update(frame, local, ray.direction, room, dt)
            wanted = 0.0
            if self.speed.forward:
                ramp = min(1.0, self.dragged / rules.clear_ramp)
                way = self.speed.direction
                beside = rules.clear_margin if self.arm else rules.clear_legs
                wanted = clearance_offset(scene, self.body, point, way, beside, rules)
                wanted *= ramp * ramp * (3.0 - 2.0 * ramp)
            self.clear += (wanted - self.clear) * (1.0 - exp(-dt / rules.clear_lag))
            point = point + self.speed.direction * self.clear
        self.value = (float(point[0]), float(point[1]), float(point[2]))
        return self.value


class TurnGrab:
    """Trunk or head: the touched surface point is dragged, and the turn that carries it is meant (5.2, eq. 12)."""

    def __init__(self, scene: Scene, frame: HeadingFrame, hit: Hit, rules: TouchRules = RULES) -> None:
        self.rules = rules
        self.part = hit.part
        self.upright = hit.part.kind == "trunk"
        self.pivot = int(scene.skeleton.back[0]) if self.upright else int(scene.rig.neck[0])
        self.plane = DragPlane(scene, frame, hit.point, rules)
        self.begin = self.plane.origin
        joint = hit.part.joint
        self.arm = frame.vector_to_local(hit.point - scene.positions[self.pivot])
        self.grip = GripOffset(scene.turns[joint], scene.positions[joint], hit.point, rules).local
        heading = np.empty(4)
        from_axis_angle(0.0, 1.0, 0.0, self._heading(scene), heading)
        self.start = np.empty(4)
        inv_mul(heading, scene.turns[joint], self.start)
        if self.upright:
            # Without its turn about Y: planted legs do not twist, and the heading comes from the feet alone.
            swing_twist_y(self.start, self.start, np.empty(4))
        self.aim = np.zeros(3)
        self.change = np.array([0.0, 0.0, 0.0, 1.0])
        self.value: tuple[float, ...] = ()

    def update(self, scene: Scene, frame: HeadingFrame, ray: Ray, dt: float) -> tuple[float, ...]:
        """The part's orientation wanted, world xyzw."""
        rules = self.rules
        way = self.plane.crossing(frame, ray.origin, ray.direction) - self.begin
        counts = straight_parts(way, rules)
        local = self.begin + counts * way
        arm = local - frame.to_local(scene.positions[self.pivot])
        self._correct(scene, frame, ray, local, arm, counts, dt)
        arm = arm + self.aim
        if float(arm @ arm) > 1e-6:
            between(self.arm, arm, self.change)
            if self.upright:
                swing_twist_y(self.change, self.change, np.empty(4))
            vector = np.empty(3)
            quat_log(self.change, vector)
            angle = float(np.linalg.norm(vector))
            if angle > rules.widest_turn:
                quat_scale(rules.widest_turn / angle, self.change, self.change)
        heading, out = np.empty(4), np.empty(4)
        from_axis_angle(0.0, 1.0, 0.0, self._heading(scene), heading)
        mul(self.change, self.start, out)
        mul(heading, out, out)
        out /= np.linalg.norm(out)
        self.value = (float(out[0]), float(out[1]), float(out[2]), float(out[3]))
        return self.value

    def _heading(self, scene: Scene) -> float:
        """The heading that carries it: the pelvis's; of a trunk, that the pelvis turns along with, the feet's."""
        if not self.upright:
            return heading_of(scene.turns[0])
        left, right = (heading_of(scene.turns[int(scene.rig.limbs[2 + side, 2])]) for side in range(2))
        return left + 0.5 * wrap(right - left)

    def _correct(
        self, scene: Scene, frame: HeadingFrame, ray: Ray, wanted: Array, arm: Array, counts: Array, dt: float
    ) -> None:
        """Work off what still lies between the touched point and the finger, as far as turning can."""
        joint = self.part.joint
        place = np.empty(3)
        rotate(scene.turns[joint], self.grip, place)
        # `grip` leads from the touched point to the joint.
        error = wanted - frame.to_local(scene.positions[joint] - place)
        way = frame.vector_to_local(ray.direction)
        error = error - way * float(error @ way)
        length = float(arm @ arm)
        if length > 1e-6:
            error = error - arm * (float(error @ arm) / length)
        counts = counts.copy()
        counts[self.plane.axis] = 0.0  # on the plane only: depth cannot be seen to be off
        self.aim = self.aim + counts * error * (1.0 - exp(-dt * self.rules.aim_gain))
        size = float(np.linalg.norm(self.aim))
        if size > self.rules.aim_limit:
            self.aim *= self.rules.aim_limit / size


def straight_parts(way: Array, rules: TouchRules = RULES) -> Array:
    """What counts of a drag (3, heading frame), 0..1 for each axis: all, or little of what is beside a way that goes
    nearly level, or nearly up or down.

    The touched point is on the body's front, a hand's breadth before what it turns about: the centimetre by which a
    trunk that leans to a side sinks away from a level finger would bend it backward by five degrees, which can hardly
    be seen from there.
    """
    across, up = sqrt(float(way[0]) ** 2 + float(way[2]) ** 2), abs(float(way[1]))
    ratio = min(across, up) / max(across, up, 1e-9)
    share = min(1.0, max(0.0, (ratio - rules.straight) / (rules.slanting - rules.straight)))
    keep = share * share * (3.0 - 2.0 * share)
    return np.array([keep, 1.0, keep]) if up > across else np.array([1.0, keep, 1.0])


class PelvisGrab:
    """The pelvis: moved where the feet allow it, else a step; turned by a second finger (5.3)."""

    def __init__(self, scene: Scene, frame: HeadingFrame, hit: Hit, rules: TouchRules = RULES) -> None:
        self.rules = rules
        self.part: Part = hit.part
        self.grab_again(scene, frame, hit.point)
        self.goal: Array | None = None
        self.since = 0.0
        self.repeated = False
        self.ease = np.zeros(3)
        self.standing: list[int] = []
        self.twist: tuple[float, float] | None = None  # the fingers' angle and the heading at its start
        self.kept = np.zeros(3)  # where the pelvis stays against the feet while it is twisted
        self.angle = 0.0
        self.value: tuple[float, ...] | None = None
        self.yaw: float | None = None

    def grab_again(self, scene: Scene, frame: HeadingFrame, touched: Array) -> None:
        """Hold the pelvis by another point (3) without moving it."""
        self.plane = DragPlane(scene, frame, touched, self.rules)
        self.offset = GripOffset(scene.turns[0], scene.positions[0], touched, self.rules)

    def start_twist(self, scene: Scene, frame: HeadingFrame, angle: float) -> None:
        """A second finger came; ``angle`` (rad, clockwise as seen) of the line from the first to it.

        As long as it is there the pelvis is only turned: two fingers never twist about a point that is quite still.
        """
        self.kept = frame.to_local(scene.positions[0])
        self.twist = (angle, heading_of(scene.turns[0]))
        self.angle = angle
        self.yaw = self.twist[1]

    def turn_to(self, angle: float) -> None:
        """The two fingers' line now has this angle: the figure turns with it, as seen from above."""
        if self.twist is None:
            return
        self.angle = unwrapped(angle, self.angle)
        self.yaw = self.twist[1] - (self.angle - self.twist[0])

    def end_twist(self) -> None:
        """One of the two fingers left."""
        self.twist = None
        self.yaw = None

    def update(
        self, scene: Scene, frame: HeadingFrame, ray: Ray, held_feet: tuple[bool, bool], dt: float
    ) -> tuple[tuple[float, ...] | None, Step | None]:
        """Where the pelvis shall be (world m; None while it steps), and a step to be made."""
        rules = self.rules
        offset = self.offset.update(scene.turns[0], dt)
        if self.twist is not None:
            point, _ = self._allowed(scene, frame.to_world(self.kept), held_feet)
            self.value = (float(point[0]), float(point[1]), float(point[2]))
            return self.value, None
        local = self.plane.crossing(frame, ray.origin, ray.direction)
        wanted = frame.to_world(local) + offset
        if self.goal is not None:
            if not self._arrived(scene):
                return None, None
            self.goal = None
            self.repeated = True
            # A step is made upright: the little that a level drag rose or sank on the way counts for nothing.
            sunk = float(scene.rig.rest_positions[0, 1]) - float(wanted[1])
            if abs(sunk) < rules.step_rise:
                self.plane.shift = self.plane.shift + np.array([0.0, sunk, 0.0])
                wanted = wanted + np.array([0.0, sunk, 0.0])
            self.ease = scene.positions[0] - self._allowed(scene, wanted, held_feet)[0]
        inside, beyond = self._allowed(scene, wanted, held_feet)
        standing = self._standing(scene, held_feet)
        if standing != self.standing and self.value is not None:
            # Another foot carries it: what is allowed now may be elsewhere, and is gone to, not jumped to.
            self.ease = np.array(self.value) - inside
        self.standing = standing
        if beyond:
            goal = self._step_goal(scene, ray, offset, float(wanted[1]))
            if goal is not None:
                self.goal = goal
                self.since = scene.now
                self.value = None
                return None, Step(id=0, goal=(float(goal[0]), 0.0, float(goal[1])))
        else:
            self.repeated = False
        self.ease = self.ease * exp(-dt / rules.settle)
        point = inside + self.ease
        self.value = (float(point[0]), float(point[1]), float(point[2]))
        return self.value, None

    def _arrived(self, scene: Scene) -> bool:
        assert self.goal is not None
        waited = scene.now - self.since
        if waited < self.rules.step_wait:
            return False
        away = float(np.linalg.norm(scene.positions[0][[0, 2]] - self.goal))
        return (all(scene.planted) and away < self.rules.step_done) or waited > self.rules.step_patience

    def _allowed(self, scene: Scene, wanted: Array, held_feet: tuple[bool, bool]) -> tuple[Array, bool]:
        """The nearest place (3) that feet and legs allow, and whether the wish is so far off that it is a step."""
        rules, rig = self.rules, scene.rig
        standing = self._standing(scene, held_feet)
        if not standing:
            return wanted, False
        soles, corner = [], np.empty(3)
        for side in standing:
            foot = int(rig.limbs[2 + side, 2])
            for n in range(4):
                rotate(scene.turns[foot], rig.soles[side, n], corner)
                soles.append((corner + scene.positions[foot])[[0, 2]])
        polygon = support_polygon(np.array(soles))
        x, z = closest_point(polygon, wanted[[0, 2]], rules.support_inset)
        out = -margin_in_hull(polygon, len(polygon), float(wanted[0]), float(wanted[2]))
        low, high = 0.0, np.inf
        hip = np.empty(3)
        for side in standing:
            upper, foot = int(rig.limbs[2 + side, 0]), int(rig.limbs[2 + side, 2])
            rotate(scene.turns[0], rig.offsets[upper], hip)
            dx = x + hip[0] - scene.positions[foot, 0]
            dz = z + hip[2] - scene.positions[foot, 2]
            leg = float(rig.lengths[2 + side].sum()) * rules.stretch
            room = sqrt(max(leg * leg - dx * dx - dz * dz, 0.0))
            high = min(high, float(scene.positions[foot, 1]) + room - hip[1])
            bent = float(rig.lengths[2 + side].sum()) * rules.duck
            low = max(low, float(scene.positions[foot, 1]) + sqrt(max(bent * bent - dx * dx - dz * dz, 0.0)) - hip[1])
        high = max(high, low)
        y = min(high, max(low, float(wanted[1])))
        beyond = out > rules.step_margin or abs(float(wanted[1]) - y) > rules.step_rise
        # Nearly upright is upright: three centimetres that a level drag loses would bend the knees by 30 degrees.
        low_by = min(1.0, (high - y) / rules.upright)
        y = high - (high - y) * low_by * low_by * (3.0 - 2.0 * low_by)
        # A step needs both feet: one that a finger holds, or that is in the air, rules it out.
        return np.array([x, y, z]), beyond and len(standing) == 2 and all(scene.planted)

    def _standing(self, scene: Scene, held_feet: tuple[bool, bool]) -> list[int]:
        """The feet that may carry the pelvis: those that stand, and free ones that are about to."""
        feet = []
        for side in range(2):
            height = float(scene.positions[int(scene.rig.limbs[2 + side, 2]), 1] - scene.rig.ankle_heights[side])
            if not held_feet[side] and (scene.planted[side] or height < self.rules.landing):
                feet.append(side)
        return feet

    def _step_goal(self, scene: Scene, ray: Ray, offset: Array, height: float) -> Array | None:
        """Where a step goes, (x, z): the view ray on the level of the pelvis, at a step's length (5.3).

        That level is the ``height`` (m) which the drag asks for, as far as a standing or ducking pelvis comes near it:
        a level view would take every centimetre by which the hips sink over one leg for a decimetre of depth.
        """
        rules = self.rules
        here = scene.positions[0]
        rest = float(scene.rig.rest_positions[0, 1])
        level = min(rest + rules.step_level, max(rules.duck * rest - rules.step_level, height)) - float(offset[1])
        drop = float(ray.direction[1])
        t = (level - float(ray.origin[1])) / drop if abs(drop) > 1e-9 else -1.0
        if t > 0.0:
            way = (ray.origin + t * ray.direction + offset - here)[[0, 2]]
        else:
            # The ray misses the level: it says a direction only, away from the viewer.
            way = ray.direction[[0, 2]] / max(float(np.linalg.norm(ray.direction[[0, 2]])), 1e-9) * rules.step_most
        length = float(np.linalg.norm(way))
        if length < (rules.step_again if self.repeated else 0.05):
            return None
        goal: Array = here[[0, 2]] + way * (min(rules.step_most, max(rules.step_least, length)) / length)
        return goal


Grab = PointGrab | TurnGrab | PelvisGrab


def line_angle(ax: float, ay: float, bx: float, by: float, aspect: float) -> tuple[float, float]:
    """The angle (rad, clockwise as seen) and length (picture heights) of the line from one touch to another."""
    dx, dy = (bx - ax) * aspect, by - ay
    return atan2(dy, dx), sqrt(dx * dx + dy * dy)
