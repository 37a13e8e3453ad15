"""A simulated user who poses the figure by touch.

It sees the projected picture only (`Sight`): where the joints of the figure and of the ghost appear, and what the
overlay says that its fingers hold. Nobody tells it what a pose asks for. It acts only through touch messages, at most
three fingers at a time, with the times and the scatter of the motor model. What it does: from the front it puts right
what looks wrong, lower body first; for what a pose has toward the viewer, or when all looks right and is not, it goes
to the side; hands come last and stay held, since a released hand sinks.
"""

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.default import default_figure
from bunraku.figure.fk import fk
from bunraku.msgs import Contact, Touch
from bunraku.nodes.controller.node import Controller
from bunraku.nodes.interpreter.node import Interpreter
from bunraku.runtime.memory import MemoryStage

from .motor import Motor, minimum_jerk
from .poses import Ghost
from .sight import Sight, part_role

Array = NDArray[np.float64]
HZ = 60.0
REACHED = 0.10  # m: every joint within this of the ghost's
GIVE_UP = 240.0  # s
NEAR = 0.016  # picture heights: what a user lets pass as being in place
FINGERS = 3
VIEWS = {"front": (0.12, 0.10), "side": (1.00, 0.10)}
"""Azimuth and elevation (rad) that swipes go to: so far to the side that drags go to front and back, and no farther,
so that neither arm nor leg hides the body and the other foot."""
PART_WIDTH = {"pelvis": 0.08, "trunk": 0.10, "left_hand": 0.045, "right_hand": 0.045, "left_foot": 0.05,
              "right_foot": 0.05}  # fmt: skip
WRONG = 0.02  # picture heights: what looks wrong enough to take it up
TURNED = 0.3  # rad: likewise for where the hips face
LOWER, UPPER = ("left_foot", "right_foot", "pelvis"), ("trunk", "left_hand", "right_hand")
"""Parts that stay where they were let go, and parts that have to be held."""
SWIPE = np.pi  # rad for a picture height, as the user has learnt
ASTRAY = 0.08  # picture heights that both feet are off: the whole figure has to come back
EMPTY = np.array([0.16, 0.35])


@dataclass
class Score:
    """What one run took."""

    seconds: float = 0.0
    strokes: int = 0
    views: int = 0
    reached: bool = False
    error: float = 0.0
    """m, the joint that was farthest at the end."""
    fingers: int = 0
    """Most fingers at once."""
    track: list[tuple[float, float]] = field(default_factory=list)
    """(s, m) how far the farthest joint was."""


class Done(Exception):
    """The pose was reached, or the time is over."""


class TouchUser:
    """One simulated person at one pose."""

    def __init__(self, goal: Ghost, motor: Motor, seed: int) -> None:
        self.goal = goal
        self.motor = motor
        self.rng = np.random.default_rng(seed)
        self.stage = MemoryStage()
        self.interpreter = self.stage.add(Interpreter, azimuth=VIEWS["front"][0], elevation=VIEWS["front"][1])
        self.controller = self.stage.add(Controller, show_overlay=False)
        self.figure = default_figure()
        self.fingers: dict[int, Array] = {}
        self.holding: dict[str, int] = {}
        self.rest = np.array([0.5, 0.9])  # where a free hand hovers, shares of the picture
        self.next_id = 0
        self.score = Score()
        self.stage.advance(0.5)
        self.began = self.stage.clock.now()
        self.seen: Callable[[], None] | None = None
        self.facing = 0.0
        """Heading that the views are meant from, rad: as the ghost was seen to face."""
        first = self.look()
        self.hips = first.hips()  # the figure faces the viewer at first: so wide are its hips
        self.scale = float(np.linalg.norm(first.now[self.figure.role("head")] - first.now[0])) / float(
            np.linalg.norm(self.figure.rest_positions[self.figure.role("head")] - self.figure.rest_positions[0])
        )  # picture heights a metre

    # What the task does

    def run(self) -> Score:
        """Pose until it is reached or the time is over."""
        with contextlib.suppress(Done):
            self.play()
        self.score.seconds = self.time
        self.score.error = self.error()
        self.score.reached = self.score.error < REACHED
        return self.score

    @property
    def time(self) -> float:
        """s since the ghost was shown."""
        return (self.stage.clock.now() - self.began) / 1e9

    def error(self) -> float:
        """m between the farthest joint and the ghost's: the task's own measure, which the user does not see."""
        away = np.linalg.norm(self.controller.core.positions_ws - self.goal.positions, axis=1)
        return float(away.max())

    def taken(self) -> tuple[Array, Array]:
        """The figure's pose now: its root (3) m and local rotations (J, 4)."""
        core = self.controller.core
        return core.positions_ws[0].copy(), core.rotations_ls.copy()

    def tick(self) -> None:
        """One 60th of a second; the task ends as soon as the pose is reached."""
        self.stage.advance(1.0 / HZ)
        if self.seen is not None:
            self.seen()
        error = self.error()
        if not self.score.track or self.time - self.score.track[-1][0] > 0.2:
            self.score.track.append((self.time, error))
        if error < REACHED or self.time > GIVE_UP:
            raise Done

    # What the user sees

    def look(self) -> Sight:
        """The picture now."""
        pose, camera = self.stage.last("pose"), self.stage.last("camera")
        positions, _ = fk(self.figure, pose.root.astype(float), pose.rotations.astype(float))
        return Sight.at(self.figure, camera, positions, self.goal.positions)

    def off(self, part: str) -> Array:
        """By how much a part is off on the picture (2), picture heights to the right and down."""
        return self.look().off(part)

    @property
    def tall(self) -> Array:
        """Shares of the picture to picture heights."""
        return np.array([16.0 / 9.0, 1.0])

    def grips(self, finger: int) -> str:
        """The part that the overlay says that a finger holds."""
        drawn = self.stage.last("overlay/interpreter")
        place = self.fingers[finger]
        for one in drawn.primitives if drawn is not None else []:
            if one.kind == "circle" and np.allclose(one.points[0], place, atol=1e-6):
                return str(one.label).replace(" ", "_")
        return ""

    # What the user does

    def send(self, phases: dict[int, str] | None = None) -> None:
        """Say where the fingers are."""
        contacts = [
            Contact(id=key, phase=(phases or {}).get(key, "move"), x=float(place[0]), y=float(place[1]))  # type: ignore[arg-type]
            for key, place in self.fingers.items()
        ]
        self.stage.publish("touch", Touch(device="user", contacts=contacts))
        if len(self.stage.bodies.get("pose", [])) > 600:
            self._forget()
        self.score.fingers = max(self.score.fingers, len(self.fingers))

    def _forget(self) -> None:
        """Keep the newest of each topic: a run is long."""
        self.stage.bodies = {topic: said[-1:] for topic, said in self.stage.bodies.items()}

    def wait(self, seconds: float) -> None:
        """Do nothing but hold."""
        for _ in range(max(1, round(seconds * HZ))):
            self.tick()

    def settle(self, most: float = 4.0) -> None:
        """Watch until the figure has come to rest on the picture."""
        end = self.time + most
        before = self.look().now
        while self.time < end:
            self.wait(self.motor.glance)
            now = self.look().now
            if float(np.nanmax(np.abs(now - before))) < 0.001:
                return
            before = now

    def press(self, place: Array, width: float) -> int:
        """Put a finger down near a place (shares); its id."""
        way = (place - self.rest) * self.tall
        self.wait(self.motor.reach(float(np.linalg.norm(way)), width))
        # The last bit of the way is seen: the scatter is that of a fifth of the movement.
        landed = place + (self.motor.land(self.rng, 0.2 * way) - 0.2 * way) / self.tall
        finger = self.next_id
        self.next_id += 1
        self.fingers[finger] = landed
        self.send({finger: "down"})
        self.score.strokes += 1
        return finger

    def lift(self, finger: int) -> None:
        """Take a finger away."""
        self.send({finger: "up"})
        self.rest = self.fingers.pop(finger)
        self.holding = {part: key for part, key in self.holding.items() if key != finger}

    def move(self, finger: int, way: Array, seconds: float) -> None:
        """Move a finger smoothly by ``way`` (shares)."""
        start = self.fingers[finger].copy()
        steps = max(1, round(seconds * HZ))
        for k in range(1, steps + 1):
            self.tick()
            self.fingers[finger] = np.clip(start + way * minimum_jerk(k / steps), 0.0, 1.0)
            self.send()

    def drag(self, finger: int, part: str, *, most: int = 4) -> None:
        """Drag a held part to where the ghost has it, with corrections."""
        for attempt in range(most):
            away = self.off(part)
            if float(np.linalg.norm(away)) < NEAR and attempt:
                return
            if part == "trunk":
                # To lean and to bend are two decisions; a bend takes a quarter of a lean's way, so one at a time.
                away = away * (np.abs(away) >= np.abs(away).max())
            landed = self.motor.land(self.rng, away)
            # Above the speed at which a drag is taken for a punch a careful user does not go.
            length = float(np.linalg.norm(landed))
            self.move(finger, landed / self.tall, max(self.motor.drag(length), 1.9 * length / 0.36))
            self.wait(self.motor.glance)

    def place(self, part: str, *, keep: bool) -> None:
        """Bring one part to where the ghost has it on this view."""
        if part in self.holding:
            self.wait(self.motor.decide(self.rng))
            self.drag(self.holding[part], part)
            return
        if self.look().wrong(part) < WRONG:
            return
        for _ in range(4):
            self.wait(self.motor.decide(self.rng))
            finger = self.press(self.spot(part), PART_WIDTH[part])
            if self.grips(finger) == part:
                self.holding[part] = finger
                self.drag(finger, part)
                if not keep:
                    self.lift(finger)
                    self.settle()
                return
            self.lift(finger)

    def spot(self, part: str) -> Array:
        """Where the user touches a part (shares): hands beyond the wrist, the trunk below the neck."""
        now = self.look().now
        joint = self.figure.role(part_role(part))
        place: Array = now[joint]
        if part.endswith("_hand"):
            place = place + 0.35 * (place - now[int(self.figure.parents[joint])])
        elif part == "trunk":
            place = 0.6 * place + 0.4 * now[self.figure.role("spine")]
        elif part.endswith("_foot"):
            place = 0.5 * (place + now[self.figure.role("leftToes" if part == "left_foot" else "rightToes")])
        return place / self.tall

    def view(self, name: str) -> None:
        """Swipe to another view on an empty place of the picture."""
        azimuth, elevation = VIEWS[name]
        azimuth += self.facing
        for _ in range(3):
            sight = self.look()
            left = (azimuth - sight.azimuth + np.pi) % (2 * np.pi) - np.pi
            way = np.array([-left / SWIPE, (elevation - sight.elevation) / SWIPE])
            if float(np.abs(way).max()) < 0.03:
                return
            self.wait(self.motor.decide(self.rng))
            if len(self.fingers) >= FINGERS:
                self.lift(max(self.holding.values()))  # it is put back where it belongs afterwards
            begin = EMPTY if way[0] > 0 else np.array([1.0 - EMPTY[0], EMPTY[1]])
            finger = self.press(begin, 0.2)
            self.score.strokes -= 1
            self.score.views += 1
            self.move(finger, self.motor.land(self.rng, way) / self.tall, self.motor.drag(float(np.linalg.norm(way))))
            self.lift(finger)
            self.wait(self.motor.glance)

    def turned(self) -> float:
        """By how much the ghost seems to be turned against the figure, rad."""
        sight = self.look()
        return sight.heading(sight.goal, self.hips) - sight.heading(sight.now, self.hips)

    def turn(self) -> None:
        """Twist two fingers on and beside the pelvis until the hips face as the ghost's do."""
        sight = self.look()
        self.facing = sight.azimuth + sight.heading(sight.goal, self.hips)
        self.wait(self.motor.decide(self.rng))
        first = self.press(self.spot("pelvis"), PART_WIDTH["pelvis"])
        if self.grips(first) != "pelvis":
            self.lift(first)
            return
        second = self.press(self.fingers[first] + np.array([0.20, 0.05]) / self.tall, 0.10)
        radius = (self.fingers[second] - self.fingers[first]) * self.tall
        angle = float(np.arctan2(radius[1], radius[0]))
        length = float(np.linalg.norm(radius))
        for _ in range(6):
            left = self.turned()
            if abs(left) < 0.06:
                break
            step = float(np.clip(left, -1.2, 1.2)) * (1.0 + self.rng.normal(0.0, self.motor.noise))
            frames = max(1, round(self.motor.drag(abs(step) * length) * HZ))
            for k in range(1, frames + 1):
                self.tick()
                at = angle - step * minimum_jerk(k / frames)
                self.fingers[second] = self.fingers[first] + length * np.array([np.cos(at), np.sin(at)]) / self.tall
                self.send()
            angle -= step
            self.wait(3.0 * self.motor.glance)
        self.lift(second)
        self.lift(first)

    def gather(self) -> None:
        """A figure that has stepped away from its ghost is brought back by its pelvis, sideways as seen."""
        for name in ("front", "side"):
            feet = 0.5 * (self.off("left_foot") + self.off("right_foot"))
            if abs(float(feet[0])) < ASTRAY and name == "front":
                continue
            self.view(name)
            feet = 0.5 * (self.off("left_foot") + self.off("right_foot"))
            if abs(float(feet[0])) < ASTRAY:
                continue
            self.wait(self.motor.decide(self.rng))
            finger = self.press(self.spot("pelvis"), PART_WIDTH["pelvis"])
            if self.grips(finger) == "pelvis":
                way = self.motor.land(self.rng, np.array([feet[0], 0.0]))
                self.move(finger, way / self.tall, self.motor.drag(float(np.linalg.norm(way))))
                self.wait(1.0)
            self.lift(finger)
            self.settle()

    def play(self) -> None:
        """The order of work that people were seen to take: lower body, view, upper body with several fingers."""
        for again in range(8):
            if again:
                self.gather()
                self.view("front")
            if abs(self.turned()) > TURNED and not self.holding:
                self.turn()
                self.view("front")
            self.lower()
            if again or self.look().deep(self.scale):
                self.view("side")
                self.lower()
                self.view("front")
            self.upper()
            self.wait(2.0 * self.motor.glance)
            # All looks right from here and is not.
            self.view("side")
            self.upper()
            self.view("front")
            self.upper()
            self.wait(2.0 * self.motor.glance)
            # Not reached: let go of all and look at the lower body again.
            for finger in list(self.fingers):
                self.lift(finger)

    def lower(self) -> None:
        """Place what stays where it is let go."""
        for part in LOWER:
            self.place(part, keep=False)

    def upper(self) -> None:
        """Place what has to be held."""
        for part in UPPER:
            self.place(part, keep=True)
