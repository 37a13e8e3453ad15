"""Touch: fingers on the picture move the figure's parts and the camera (Oshita 2013, section 5)."""

from dataclasses import dataclass, field
from typing import Any

from bunraku.figure.camera import ray as touch_ray
from bunraku.msgs import Touch
from bunraku.nodes.interpreter import overlay
from bunraku.nodes.interpreter.contacts import Change, ContactTable, Key
from bunraku.nodes.interpreter.core import Meaning, Scene
from bunraku.nodes.interpreter.drag import Carrier, HeadingFrame
from bunraku.nodes.interpreter.grabs import Grab, PelvisGrab, PointGrab, Ray, TurnGrab, line_angle
from bunraku.nodes.interpreter.picking import Hit, PartTable, pick
from bunraku.nodes.interpreter.rules import RULES, TouchRules
from bunraku.nodes.interpreter.viewer import Viewer

LONGEST_STEP = 0.1
"""s: a longer pause counts as this much."""


@dataclass
class Finger:
    """What one contact does."""

    x: float
    y: float
    grab: Grab | None = None
    twists: PelvisGrab | None = None
    camera: bool = False
    before: tuple[float, float] = (0.0, 0.0)
    """Where it was at the last update."""
    trail: overlay.Trail = field(default_factory=overlay.Trail)


class TouchCore:
    """Touch messages in, targets, steps and the camera out."""

    def __init__(self, viewer: Viewer, *, rules: TouchRules = RULES, figure: bool = True, forget: float = 30.0) -> None:
        """``figure=False``: every finger drives the camera. ``forget``: s of silence after which a device's
        fingers are let go."""
        self.viewer = viewer
        self.rules = rules
        self.figure = figure
        self.forget = forget
        self.contacts = ContactTable()
        self.fingers: dict[Key, Finger] = {}
        self.carrier = Carrier(rules)
        self.table: PartTable | None = None
        self.skeleton: object = None
        self.last = 0.0
        self.view_moved = False

    @property
    def busy(self) -> bool:
        return bool(self.fingers)

    def hear(self, message: Touch, scene: Scene) -> None:
        self._look(scene)
        before = {key: (one.x, one.y) for key, one in self.fingers.items() if one.camera}
        self._apply(self.contacts.frame(message, scene.now), scene)
        self._view(message.device, before, scene.camera.aspect)

    def lose(self, device: str, scene: Scene) -> None:
        self._look(scene)
        self._apply(self.contacts.lose(device), scene)

    def let_go(self, scene: Scene) -> None:
        """Release everything: who said the touches began anew."""
        for device in sorted({key[0] for key in self.fingers}):
            self.lose(device, scene)

    def update(self, scene: Scene) -> Meaning:
        self._look(scene)
        dt = min(max(scene.now - self.last, 0.0), LONGEST_STEP)
        self.last = scene.now
        self._apply(self.contacts.forget(scene.now, self.forget), scene)
        meaning = Meaning()
        held = self.held
        if not any(one.grab for one in self.fingers.values()):
            self.carrier.reset()
        else:
            feet = ("left_foot" in held, "right_foot" in held)
            frame = self.carrier.frame(scene, feet, dt)
            if self.view_moved:
                self._hold_still(scene, frame)
            for key, one in self.fingers.items():
                grab = one.grab
                if grab is None:
                    continue
                if isinstance(grab, PelvisGrab):
                    value, step = grab.update(scene, frame, self._pelvis_ray(key, scene), feet, dt)
                    if value is not None:
                        meaning.target["pelvis"] = value
                    if grab.yaw is not None:
                        meaning.target["yaw"] = grab.yaw
                    if step is not None:
                        meaning.commands.append(step)
                else:
                    ray = Ray(*touch_ray(scene.camera, one.x, one.y))
                    meaning.target[grab.part.name] = grab.update(scene, frame, ray, dt)
                    if isinstance(grab, PointGrab):
                        point = frame.to_world(grab.plane.last)
                        meaning.overlay.append(overlay.plane(point, grab.plane.normal(frame)))
        self.view_moved = False
        for one in self.fingers.values():
            one.before = (one.x, one.y)
            one.trail.add(scene.now, one.x, one.y)
            label = one.grab.part.name.replace("_", " ") if one.grab else ""
            meaning.overlay += overlay.finger(one.x, one.y, one.trail.lately(scene.now), camera=one.camera, label=label)
            if isinstance(one.grab, PelvisGrab) and one.grab.goal is not None:
                meaning.overlay.append(overlay.step_goal(one.grab.goal))
        return meaning

    def save(self) -> dict[str, Any]:
        return {}

    def restore(self, state: dict[str, Any], scene: Scene) -> None:
        """Fingers that are still down are found again by their next frame."""

    @property
    def held(self) -> dict[str, Finger]:
        """The fingers that hold a part, by the part's name."""
        return {one.grab.part.name: one for one in self.fingers.values() if one.grab}

    @property
    def holds_pelvis(self) -> bool:
        """Whether a finger holds the pelvis (the camera then does not follow)."""
        return any(isinstance(one.grab, PelvisGrab) for one in self.fingers.values())

    # Inside

    def _look(self, scene: Scene) -> None:
        """Another figure came on stage: what was held of the old one is gone, its fingers do nothing."""
        if scene.skeleton is self.skeleton:
            return
        self.skeleton = scene.skeleton
        self.table = PartTable(scene.skeleton)
        self.carrier.reset()
        for one in self.fingers.values():
            one.grab = one.twists = None

    def _apply(self, changes: list[Change], scene: Scene) -> None:
        for change in changes:
            if change.kind == "up":
                self._up(change.key, scene)
            elif change.kind == "down":
                self._down(change, scene)
            elif change.key in self.fingers:
                one = self.fingers[change.key]
                one.x, one.y = change.x, change.y

    def _down(self, change: Change, scene: Scene) -> None:
        one = Finger(change.x, change.y, before=(change.x, change.y))
        hits: list[Hit] = []
        if self.figure and self.table is not None:
            origin, direction = touch_ray(scene.camera, change.x, change.y)
            hits = pick(self.table, scene, origin, direction, self.rules.finger)
        held = self.held
        twisted = self._twisted(change, hits, scene.camera.aspect)
        free = next((hit for hit in hits if hit.part.name not in held), None)
        if twisted is not None:
            one.twists = twisted
        elif free is not None:
            self._grab(one, free, scene)
        elif not hits:
            one.camera = True
        self.fingers[change.key] = one
        if twisted is not None:
            self._start_twist(change.key, twisted, scene)

    def _grab(self, one: Finger, hit: Hit, scene: Scene) -> None:
        feet = ("left_foot" in self.held, "right_foot" in self.held)
        frame = self.carrier.frame(scene, feet, 0.0)
        if hit.part.kind == "pelvis":
            one.grab = PelvisGrab(scene, frame, hit, self.rules)
        elif hit.part.kind in ("trunk", "head"):
            one.grab = TurnGrab(scene, frame, hit, self.rules)
        else:
            one.grab = PointGrab(scene, frame, hit, self.rules)

    def _twisted(self, change: Change, hits: list[Hit], aspect: float) -> PelvisGrab | None:
        """The held pelvis that a new finger of the same device turns, if it does."""
        if hits and hits[0].part.kind != "pelvis":
            return None
        for key, one in self.fingers.items():
            if isinstance(one.grab, PelvisGrab) and one.grab.twist is None and key[0] == change.key[0]:
                away = line_angle(one.x, one.y, change.x, change.y, aspect)[1]
                if self.rules.twist_least < away <= self.rules.twist_reach:
                    return one.grab
        return None

    def _start_twist(self, key: Key, grab: PelvisGrab, scene: Scene) -> None:
        one = self.fingers[key]
        first = next(other for other in self.fingers.values() if other.grab is grab)
        angle, _ = line_angle(first.x, first.y, one.x, one.y, scene.camera.aspect)
        feet = ("left_foot" in self.held, "right_foot" in self.held)
        grab.start_twist(scene, self.carrier.frame(scene, feet, 0.0), angle)

    def _regrip(self, grab: PelvisGrab, scene: Scene) -> None:
        """Hold the pelvis where its finger is now: nothing moves."""
        key = next(key for key, one in self.fingers.items() if one.grab is grab)
        ray = self._pelvis_ray(key, scene)
        feet = ("left_foot" in self.held, "right_foot" in self.held)
        frame = self.carrier.frame(scene, feet, 0.0)
        local = grab.plane.crossing(frame, ray.origin, ray.direction)
        grab.grab_again(scene, frame, frame.to_world(local))

    def _hold_still(self, scene: Scene, frame: HeadingFrame) -> None:
        """Fingers moved the camera: what the other fingers hold stays where it is, not where they now point."""
        scene.camera = self.viewer.camera()
        for one in self.fingers.values():
            if one.grab is not None:
                one.grab.plane.view_moved(scene, frame, *touch_ray(scene.camera, *one.before))

    def _pelvis_ray(self, key: Key, scene: Scene) -> Ray:
        one = self.fingers[key]
        grab = one.grab
        if isinstance(grab, PelvisGrab) and grab.twist is not None:
            for other in self.fingers.values():
                if other.twists is grab:
                    angle, length = line_angle(one.x, one.y, other.x, other.y, scene.camera.aspect)
                    if length > self.rules.twist_least:
                        grab.turn_to(angle)
        return Ray(*touch_ray(scene.camera, one.x, one.y))

    def _up(self, key: Key, scene: Scene) -> None:
        one = self.fingers.pop(key, None)
        if one is None:
            return
        if one.twists is not None:
            one.twists.end_twist()
            self._regrip(one.twists, scene)
        elif isinstance(one.grab, PelvisGrab):
            for other in self.fingers.values():
                if other.twists is one.grab:
                    # The second finger takes the pelvis over.
                    other.twists, other.grab = None, one.grab
                    one.grab.end_twist()
                    self._regrip(one.grab, scene)

    def _view(self, device: str, before: dict[Key, tuple[float, float]], aspect: float) -> None:
        """Fingers of one device that began on nothing: one swipes, two pinch."""
        kept = [key for key, one in self.fingers.items() if one.camera and key in before and key[0] == device]
        every = [key for key, one in self.fingers.items() if one.camera and key[0] == device]
        orbit = self.viewer.orbit
        if len(every) == 1 and kept:
            one, (x, y) = self.fingers[kept[0]], before[kept[0]]
            self.viewer.swipe(one.x - x, one.y - y)
        elif len(kept) >= 2:
            a, b = kept[0], kept[1]
            old = line_angle(*before[a], *before[b], aspect)[1]
            new = line_angle(self.fingers[a].x, self.fingers[a].y, self.fingers[b].x, self.fingers[b].y, aspect)[1]
            self.viewer.pinch(old, new)
        self.view_moved |= self.viewer.orbit != orbit
