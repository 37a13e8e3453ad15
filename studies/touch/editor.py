"""The baseline: a joint-handle editor as animation programs have it, under the same motor model.

One handle at a time: an end (pelvis, hand, foot) has an arrow along each axis of the world, a joint a ring about each
of its axes; a pointer takes a handle, an arrow or ring, and drags exactly. Limbs follow their ends by the same
inverse kinematics as in the touch interface, so that only the interfaces differ; nothing sinks, nothing steps.
"""

import contextlib

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.camera import Orbit, forward, metres_per_height, project
from bunraku.figure.default import default_figure
from bunraku.figure.pointpose import analyse, reconstruct
from bunraku.figure.quat import exp, log, mul, mul_inv
from bunraku.nodes.controller.node import Controller
from bunraku.runtime.memory import MemoryStage

from .motor import Motor
from .poses import Ghost
from .user import GIVE_UP, REACHED, VIEWS, Done, Score

Array = NDArray[np.float64]
ARROW = 0.03  # picture heights, a handle's size on the picture
ARM = 0.10  # from a handle's middle to its arrows and ring
SEEN = 0.35  # |sine| between an axis and the view below which its arrow cannot be dragged
CLOSE = 0.030  # m along an axis that a user lets pass as being in place
CLOSE_TURN = 0.07  # rad
RINGS = ("chest", "head", "leftFoot", "rightFoot")


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
        self.wanted, _ = analyse(self.skeleton, goal.root, goal.rotations)
        self.positions = core.positions_ws.copy()
        self.azimuth, self.elevation = VIEWS["front"]
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

    def round(self) -> None:
        """Every handle that is off, from the ground up."""
        for row in (0, 3, 4):
            self.end(row)
        for row in (2, 3, 0, 1):
            self.turn(row)
        for row in (1, 2):
            self.end(row)

    def spend(self, seconds: float) -> None:
        """Time goes on."""
        self.time += seconds
        if self.time > GIVE_UP:
            raise Done

    def show(self) -> None:
        """The figure after a change; the task ends as soon as the pose is reached."""
        _, self.positions = reconstruct(self.skeleton, self.pose, self.base)
        error = self.error()
        self.score.track.append((self.time, error))
        if error < REACHED:
            raise Done

    def point_at(self, place: Array, width: float) -> None:
        """Move the pointer to a place (shares) and press."""
        tall = np.array([16.0 / 9.0, 1.0])
        self.spend(self.motor.reach(float(np.linalg.norm((place - self.pointer) * tall)), width))
        self.pointer = place

    def camera(self) -> Orbit:
        """The view now."""
        return Orbit(azimuth=self.azimuth, elevation=self.elevation)

    def see(self, axis: Array) -> bool:
        """Turn the view where an axis (3) points at the viewer; whether it was turned."""
        view = forward(self.camera().camera())
        if float(np.linalg.norm(np.cross(view, axis))) >= SEEN:
            return False
        name = "side" if self.azimuth < 0.8 else "front"
        self.spend(self.motor.decide(self.rng) + self.motor.switch)
        self.point_at(np.array([0.3, 0.4]), 0.3)
        self.spend(self.motor.drag(0.4) + self.motor.glance)
        self.azimuth, self.elevation = VIEWS[name]
        self.score.views += 1
        return True

    def end(self, row: int) -> None:
        """Drag the arrows of an end's handle, each along its axis."""
        selected = False
        for k in range(3):
            for _ in range(3):
                left = float(self.wanted.points[row, k] - self.pose.points[row, k])
                if abs(left) < CLOSE:
                    break
                axis = np.zeros(3)
                axis[k] = 1.0
                self.see(axis)
                camera = self.camera().camera()
                place = project(camera, self.pose.points[row])
                if not selected:
                    self.spend(self.motor.decide(self.rng))
                    self.point_at(place, ARROW)
                    selected = True
                self.spend(self.motor.decide(self.rng) if k else 0.0)
                self.point_at(place + np.array([ARM * 9 / 16, 0.0]), ARROW)
                tall = metres_per_height(camera, self.pose.points[row])
                moved = self.motor.land(self.rng, np.array([abs(left) / tall, 0.0]))[0] * tall
                self.pose.points[row, k] += float(np.sign(left)) * moved
                self.spend(self.motor.drag(abs(left) / tall) + self.motor.glance)
                self.score.strokes += 1
                self.show()

    def turn(self, row: int) -> None:
        """Drag the rings of trunk (0), head (1) or a foot (2, 3), each about its axis; a foot's about Y only."""
        selected = False
        now, wanted = (self.pose.turns, self.wanted.turns) if row < 2 else (self.pose.feet, self.wanted.feet)
        part_row = row % 2
        for k in (1, 0, 2) if row < 2 else (1,):
            for _ in range(3):
                rest, vector = np.empty(4), np.empty(3)
                mul_inv(wanted[part_row], now[part_row], rest)
                log(rest, vector)
                left = float(vector[k])
                if abs(left) < CLOSE_TURN:
                    break
                joint = self.skeleton.role(RINGS[row])
                place = project(self.camera().camera(), self.positions[joint])
                if not selected:
                    self.spend(self.motor.decide(self.rng))
                    self.point_at(place, ARROW)
                    selected = True
                self.spend(self.motor.decide(self.rng))
                self.point_at(place + np.array([ARM * 9 / 16, 0.0]), ARROW)
                angle = left * (1.0 + float(self.rng.normal(0.0, self.motor.noise)))
                change, part = np.zeros(3), np.empty(4)
                change[k] = angle
                exp(change, part)
                out = np.empty(4)
                mul(part, now[part_row], out)
                now[part_row] = out
                self.spend(self.motor.drag(abs(left) * ARM) + self.motor.glance)
                self.score.strokes += 1
                self.show()
