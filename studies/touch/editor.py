"""The baseline: a joint-handle editor as animation programs have it, under the same motor model.

One handle at a time: an end (pelvis, hand, foot) has an arrow along each axis of the world, a joint a ring about each
of its axes; a pointer takes a handle, an arrow or ring, and drags. Its user sees the picture as the touch user does
(`Sight`): from the front what is off to the side and in height, from the side what is off to front and back. Limbs
follow their ends by the same inverse kinematics as in the touch interface, so that only the interfaces differ; nothing
hides a handle, nothing sinks, nothing steps.
"""

import contextlib
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.camera import Orbit, metres_per_height, project
from bunraku.figure.default import default_figure
from bunraku.figure.pointpose import analyse, reconstruct
from bunraku.figure.quat import exp, mul
from bunraku.msgs import Camera
from bunraku.nodes.controller.node import Controller
from bunraku.runtime.memory import MemoryStage

from .motor import Motor
from .poses import Ghost
from .sight import Sight
from .user import GIVE_UP, REACHED, TURNED, Done, Score

Array = NDArray[np.float64]
ARROW = 0.03  # picture heights, a handle's size on the picture
ARM = 0.10  # from a handle's middle to its arrows and ring
CLOSE = 0.030  # m along an axis that a user lets pass as being in place
CLOSE_TURN = 0.10  # rad
VIEWS = {"front": (0.0, 0.10), "side": (0.5 * np.pi, 0.10)}  # azimuth and elevation, rad
ARROWS = {"front": (0, 1), "side": (2, 1)}
"""The world's axes whose arrows a view shows at their length."""
ENDS = ("hips", "leftHand", "rightHand", "leftFoot", "rightFoot")
FEET = ("left", "right")


class EditorUser:
    """One simulated person at one pose, with a pointer."""

    def __init__(self, goal: Ghost, motor: Motor, seed: int) -> None:
        self.goal = goal
        self.motor = motor
        self.rng = np.random.default_rng(seed)
        self.skeleton = default_figure()
        stage = MemoryStage()
        start = stage.add(Controller)
        stage.advance(0.5)
        core = start.core
        self.pose, self.base = analyse(self.skeleton, core.positions_ws[0], core.rotations_ls)
        self.positions, self.rotations = core.positions_ws.copy(), core.rotations_ls.copy()
        self.view = "front"
        first = self.look()
        self.hips = first.hips()
        head, hips = self.skeleton.role("head"), 0
        self.scale = float(np.linalg.norm(first.now[head] - first.now[hips])) / float(
            np.linalg.norm(self.skeleton.rest_positions[head] - self.skeleton.rest_positions[hips])
        )  # picture heights a metre
        self.pointer = np.array([0.5, 0.5])
        self.score = Score(fingers=1)
        self.time = 0.0

    def run(self) -> Score:
        """Pose until it is reached or the time is over."""
        with contextlib.suppress(Done):
            for _ in range(8):
                self.round()
        self.score.seconds = self.time
        self.score.error = self.error()
        self.score.reached = self.score.error < REACHED
        return self.score

    def error(self) -> float:
        """m between the farthest joint and the ghost's."""
        return float(np.linalg.norm(self.positions - self.goal.positions, axis=1).max())

    def taken(self) -> tuple[Array, Array]:
        """The figure's pose now: its root (3) m and local rotations (J, 4)."""
        return self.positions[0].copy(), self.rotations.copy()

    def round(self) -> None:
        """Every handle that is off, from the front and then from the side, from the ground up."""
        for view in VIEWS:
            self.go(view)
            for row in (0, 3, 4):
                self.end(row)
            self.turns()
            for row in (1, 2):
                self.end(row)

    def spend(self, seconds: float) -> None:
        """Time goes on."""
        self.time += seconds
        if self.time > GIVE_UP:
            raise Done

    def show(self) -> None:
        """The figure after a change; the task ends as soon as the pose is reached."""
        self.rotations, self.positions = reconstruct(self.skeleton, self.pose, self.base)
        error = self.error()
        self.score.track.append((self.time, error))
        if error < REACHED:
            raise Done

    def point_at(self, place: Array, width: float) -> None:
        """Move the pointer to a place (shares) and press."""
        tall = np.array([16.0 / 9.0, 1.0])
        self.spend(self.motor.reach(float(np.linalg.norm((place - self.pointer) * tall)), width))
        self.pointer = place

    def camera(self) -> Camera:
        """The view now."""
        azimuth, elevation = VIEWS[self.view]
        return Orbit(azimuth=azimuth, elevation=elevation).camera()

    def look(self) -> Sight:
        """The picture now."""
        return Sight.at(self.skeleton, self.camera(), self.positions, self.goal.positions)

    def go(self, view: str) -> None:
        """Turn the view."""
        if view == self.view:
            return
        self.spend(self.motor.decide(self.rng) + self.motor.switch)
        self.point_at(np.array([0.3, 0.4]), 0.3)
        self.spend(self.motor.drag(0.4) + self.motor.glance)
        self.view = view
        self.score.views += 1

    def take(self, joint: int, *, selected: bool, again: bool) -> None:
        """Select a joint's handle, unless it is selected, and press its arrow or ring; ``again``: the same one."""
        place = project(self.camera(), self.positions[joint])
        if not selected:
            self.spend(self.motor.decide(self.rng))
            self.point_at(place, ARROW)
        if not again:
            self.spend(self.motor.decide(self.rng))
        self.point_at(place + np.array([ARM * 9 / 16, 0.0]), ARROW)

    def end(self, row: int) -> None:
        """Drag the arrows of an end's handle that this view shows, each along its axis."""
        selected = False
        joint = self.skeleton.role(ENDS[row])
        for k in ARROWS[self.view]:
            for attempt in range(3):
                camera = self.camera()
                axis = np.zeros(3)
                axis[k] = 1.0
                here = self.positions[joint]
                tall = np.array([camera.aspect, 1.0])
                arrow = (project(camera, here + 0.05 * axis) - project(camera, here - 0.05 * axis)) * tall / 0.1
                sight = self.look()
                left = float((sight.goal[joint] - sight.now[joint]) @ arrow) / float(arrow @ arrow)
                if abs(left) < CLOSE:
                    break
                self.take(joint, selected=selected, again=attempt > 0)
                selected = True
                metres = metres_per_height(camera, here)
                moved = self.motor.land(self.rng, np.array([abs(left) / metres, 0.0]))[0] * metres
                self.pose.points[row, k] += float(np.sign(left)) * moved
                self.spend(self.motor.drag(abs(left) / metres) + self.motor.glance)
                self.score.strokes += 1
                self.show()

    def turns(self) -> None:
        """Drag the rings that are off: the trunk's about Y, then its lean in this view, then the feet's about Y."""
        if self.view == "front":
            self.turn("chest", self.pose.turns[0], 1, self.turned)
            self.turn("chest", self.pose.turns[0], 2, self.leaning)
            for side, name in enumerate(FEET):
                self.turn(f"{name}Foot", self.pose.feet[side], 1, partial(self.foot_turned, name))
        else:
            self.turn("chest", self.pose.turns[0], 0, self.leaning)

    def turned(self) -> float:
        """By how much farther the ghost's hips seem to be turned, rad about Y (the figure's feet do not turn with its
        hips here, and tell nothing)."""
        sight = self.look()
        goal, now = sight.heading(sight.goal, self.hips), abs(sight.heading(sight.now, self.hips))
        left = float(np.sign(goal)) * (abs(goal) - now)
        return left if abs(left) > TURNED else 0.0

    def leaning(self) -> float:
        """By how much the ghost's trunk leans otherwise on this view, rad about the axis toward the viewer."""
        sight = self.look()
        neck = self.skeleton.role("neck")
        now, goal = (np.arctan2(one[neck, 0] - one[0, 0], one[0, 1] - one[neck, 1]) for one in (sight.now, sight.goal))
        return float(now - goal)

    def foot_turned(self, name: str) -> float:
        """By how much a foot of the ghost seems to be turned otherwise, rad about Y, by where its toes are."""
        sight = self.look()
        foot, toes = self.skeleton.role(f"{name}Foot"), self.skeleton.role(f"{name}Toes")
        long = abs(float(self.skeleton.offsets[toes][2])) * self.scale
        aside = [float(one[toes, 0] - one[foot, 0]) / long for one in (sight.now, sight.goal)]
        now, goal = np.arcsin(np.clip(aside, -1.0, 1.0))
        return float(goal - now)

    def turn(self, role: str, turned: Array, axis: int, seen: Callable[[], float]) -> None:
        """Drag a joint's ring about a world axis until what is ``seen`` to be left (rad) is little.

        Args:
            turned: (4) the orientation that the ring changes, in place.
        """
        for attempt in range(3):
            left = seen()
            if abs(left) < CLOSE_TURN:
                return
            self.take(self.skeleton.role(role), selected=attempt > 0, again=attempt > 0)
            angle, part, out = np.zeros(3), np.empty(4), np.empty(4)
            angle[axis] = left * (1.0 + float(self.rng.normal(0.0, self.motor.noise)))
            exp(angle, part)
            mul(part, turned, out)
            turned[:] = out
            self.spend(self.motor.drag(abs(left) * ARM) + self.motor.glance)
            self.score.strokes += 1
            self.show()
