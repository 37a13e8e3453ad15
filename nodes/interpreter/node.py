"""The node: hands each device's samples to the core that its play names, and says what all cores mean."""

from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Any

import msgspec

from bunraku.figure.camera import Orbit
from bunraku.figure.default import default_figure
from bunraku.figure.skeleton import SkeletonError
from bunraku.figure.wire import from_message
from bunraku.msgs import Camera, Command, Device, Overlay, Pad, Pen, Pose, SkeletonMessage, Target, Touch
from bunraku.nodes.interpreter.core import Core, Meaning, Scene
from bunraku.nodes.interpreter.obstacles import Heard, Obstacle, ObstacleError, Placed, load, shown
from bunraku.nodes.interpreter.pad import PadCore
from bunraku.nodes.interpreter.pen import FLOOR, PenCore
from bunraku.nodes.interpreter.pen_rules import PenRules
from bunraku.nodes.interpreter.rules import RULES, TouchRules
from bunraku.nodes.interpreter.touch import TouchCore
from bunraku.nodes.interpreter.viewer import Viewer, ViewRules
from bunraku.runtime.node import Node, ParamProblem, Publisher, param, request, subscribe, timer

SECOND = 1_000_000_000
RATE = 60.0
REMIND = SECOND
"""ns between two messages that say that nothing is held."""


@dataclass(frozen=True)
class Plays:
    """Which core plays which device: patterns of device names, the first that fits."""

    rules: tuple[tuple[str, str], ...]

    @classmethod
    def parse(cls, words: list[str], known: tuple[str, ...], name: str = "play") -> "Plays":
        """From words like ``figure`` (all devices) or ``tuio-*=camera``; raises `ParamProblem`."""
        rules = []
        for word in words:
            pattern, sign, play = word.partition("=")
            if not sign:
                pattern, play = "*", word
            if play not in known:
                raise ParamProblem(f"{name}: {play!r} is none of {', '.join(known)}; write PLAY or DEVICE=PLAY")
            rules.append((pattern, play))
        return cls((*[one for one in rules if one[0] != "*"], *[one for one in rules if one[0] == "*"]))

    def of(self, device: str) -> str | None:
        """The play of a device, or None."""
        return next((play for pattern, play in self.rules if fnmatchcase(device, pattern)), None)


TOUCH_PLAYS = ("figure", "camera")
TOUCH_PARAMS = ("speed_threshold", "speed_gain", "step_least", "step_most")
PEN_PLAYS = ("tablet", "picture")


class Interpreter(Node):
    """What the hands mean: touches become targets, steps and the camera; pens become walks, steps and jumps."""

    name = "interpreter"
    target: Publisher[Target] = Publisher("target", Target)
    command: Publisher[Any] = Publisher("command", Command)
    camera: Publisher[Camera] = Publisher("camera", Camera)
    overlay: Publisher[Overlay] = Publisher("overlay/interpreter", Overlay)

    touch_plays: list[str] = param(
        ["figure"], doc="what touch devices play: figure or camera, for all or as DEVICE=PLAY (* in DEVICE matches)"
    )
    pen_plays: list[str] = param(
        ["web-*=picture", "tablet"],
        doc="where pens draw: tablet (a fixed scale) or picture (the ground under it), for all or as DEVICE=PLAY",
    )
    pen_scale: float = param(PenRules.scale, low=1.0, high=200.0, doc="figure metres for each metre of a tablet")
    pen_early: bool = param(False, doc="begin to walk as soon as a stroke can be nothing else, not at a step's length")
    pen_natural: bool = param(False, doc="walk as people do instead of exactly as the hand drew: corners are cut")
    obstacles: str = param("", doc="file of what figures under a pen go round (.toml); beside topic overlay/obstacles")
    aspect: float = param(16 / 9, low=0.1, high=10.0, doc="width by height of the picture that touches refer to")
    distance: float = param(Orbit.distance, low=0.8, high=20.0, doc="m of the camera from the figure at first")
    azimuth: float = param(Orbit.azimuth, low=-3.1416, high=3.1416, doc="rad about the figure at first")
    elevation: float = param(Orbit.elevation, low=-0.15, high=1.45, doc="rad above the horizon, of the camera at first")
    follow: bool = param(True, doc="the camera follows a figure that walks off")
    speed_threshold: float = param(
        RULES.speed_threshold,
        low=0.1,
        high=20.0,
        doc="m/s of a drag, above it is a punch or a kick (eq. 10, v_th)",
    )
    speed_gain: float = param(
        RULES.speed_gain, low=0.0, high=2.0, doc="s: m that a punch goes forward for each m/s above that (eq. 10, v_s)"
    )
    step_least: float = param(RULES.step_least, low=0.1, high=1.0, doc="m, the shortest step of a dragged pelvis (5.3)")
    step_most: float = param(RULES.step_most, low=0.3, high=1.2, doc="m, the longest (5.3)")
    forget: float = param(30.0, low=0.5, high=3600.0, doc="s of silence after which a device's fingers are let go")

    def setup(self) -> None:
        home = Orbit(azimuth=self.azimuth, elevation=self.elevation, distance=self.distance, aspect=self.aspect)
        self.viewer = Viewer(home, ViewRules())
        self.cores: dict[str, Core] = {
            "figure": TouchCore(self.viewer, rules=self._touch_rules(), forget=self.forget),
            "camera": TouchCore(self.viewer, figure=False, forget=self.forget),
        }
        rules = PenRules(scale=self.pen_scale)
        self.pens = {
            play: PenCore(rules, surface=play, early=self.pen_early, natural=self.pen_natural) for play in PEN_PLAYS
        }
        self.placed = self._obstacles()
        self.heard = Heard()
        self.cores.update(self.pens)
        self.cores["pad"] = PadCore()
        self.plays = Plays.parse(self.touch_plays, TOUCH_PLAYS, "touch_plays")
        self.pen_rules = Plays.parse(self.pen_plays, PEN_PLAYS, "pen_plays")
        self.scene = Scene.of(default_figure(), self.viewer.camera())
        self.wire_hash = ""
        self.newest: Pose | None = None
        self.last_seq: dict[str, int] = {}
        self.ids = 0
        self.held = False
        self.drawn = False
        self.said_at = 0
        self.followed = self.now
        news = self.viewer.news()
        if news is not None:
            self.camera.publish(news)

    def _touch_rules(self) -> TouchRules:
        return replace(RULES, **{name: self.param_values[name] for name in TOUCH_PARAMS})

    def on_param(self, name: str) -> None:
        if name == "touch_plays":
            self.plays = Plays.parse(self.touch_plays, TOUCH_PLAYS, name)
        elif name == "pen_plays":
            self.pen_rules = Plays.parse(self.pen_plays, PEN_PLAYS, name)
        elif name == "obstacles":
            self.placed = self._obstacles()
        elif name == "forget" or name in TOUCH_PARAMS:
            for core in self.cores.values():
                if isinstance(core, TouchCore):
                    core.forget, core.rules = self.forget, self._touch_rules()  # the next touches go by them
        elif name in ("pen_scale", "pen_early", "pen_natural"):
            for pen in self.pens.values():
                pen.rules = pen.track.rules = replace(pen.rules, scale=self.pen_scale)
                pen.early, pen.natural = self.pen_early, self.pen_natural
        elif name in ("aspect", "distance", "azimuth", "elevation"):
            self.viewer.home = self.viewer.orbit = Orbit(
                center=self.viewer.orbit.center, azimuth=self.azimuth, elevation=self.elevation,
                distance=self.distance, aspect=self.aspect,
            )  # fmt: skip
            self._say_camera()

    @request("reset")
    def reset(self) -> None:
        """Let go of everything and look from where the camera was first."""
        self._see()
        for core in self.cores.values():
            if isinstance(core, TouchCore):
                core.let_go(self.scene)
            elif isinstance(core, PenCore | PadCore):
                core.lose(core.device, self.scene)
        self.viewer.reset()
        self._say()

    @subscribe("skeleton", SkeletonMessage, trigger=False)
    def on_skeleton(self, msg: SkeletonMessage) -> None:
        """The figure on stage."""
        try:
            skeleton = from_message(msg)
            if skeleton.hash == self.scene.skeleton.hash and self.wire_hash == skeleton.hash:
                return
            self.scene = Scene.of(skeleton, self.scene.camera)
        except SkeletonError as error:
            self.log.warning("skeleton left out: %s", error)
            return
        self.wire_hash = skeleton.hash

    @subscribe("pose", Pose, trigger=False)
    def on_pose(self, msg: Pose) -> None:
        """The figure's newest pose."""
        self.newest = msg

    @subscribe("touch", Touch)
    def on_touch(self, msg: Touch) -> None:
        """A frame of a touch surface."""
        self._see()
        if msg.seq < self.last_seq.get("touch", 0):
            # Who said the touches began anew: fingers that it does not list now are gone.
            for core in self.cores.values():
                if isinstance(core, TouchCore):
                    core.let_go(self.scene)
        self.last_seq["touch"] = msg.seq
        play = self.plays.of(msg.device)
        if play is not None:
            self.cores[play].hear(msg, self.scene)
        self._say()

    @subscribe("pen", Pen)
    def on_pen(self, msg: Pen) -> None:
        """A sample of a pen."""
        self._see()
        play = self.pen_rules.of(msg.device)
        if play is not None:
            self.cores[play].hear(msg, self.scene)
        self._say()

    @subscribe("pad", Pad)
    def on_pad(self, msg: Pad) -> None:
        """A sample of a gamepad."""
        self._see()
        self.cores["pad"].hear(msg, self.scene)
        self._say()

    @subscribe("overlay/obstacles", Overlay, trigger=False)
    def on_obstacles(self, msg: Overlay) -> None:
        """What another node says is in the way: circles in the world."""
        self.heard.take(msg.primitives, self.now / SECOND)

    @subscribe("device/*", Device)
    def on_device(self, msg: Device, topic: str) -> None:
        """A device that went lets go of what it held."""
        if msg.connected:
            return
        self._see()
        for core in self.cores.values():
            core.lose(msg.device, self.scene)
        self._say()

    @timer(hz=RATE, idle=True)
    def idle(self) -> None:
        """Time alone goes on: a still finger on a moving figure, an offset that goes back, the camera's way."""
        self._see()
        if self.held or self.drawn or self.placed or any(core.busy for core in self.cores.values()):
            self._say()
        elif self.now - self.said_at >= REMIND:
            self.said_at = self.now
            self.target.publish(Target())
        self._say_camera()

    def save(self) -> bytes | None:
        orbit = self.viewer.orbit
        state = {
            "ids": self.ids,
            "orbit": [*orbit.center, orbit.azimuth, orbit.elevation, orbit.distance, orbit.yfov, orbit.aspect],
            "cores": {name: core.save() for name, core in self.cores.items()},
        }
        return msgspec.msgpack.encode(state)

    def restore(self, state: bytes) -> None:
        kept = msgspec.msgpack.decode(state)
        self.ids = int(kept["ids"])
        x, y, z, azimuth, elevation, distance, yfov, aspect = kept["orbit"]
        self.viewer.orbit = Orbit((x, y, z), azimuth, elevation, distance, yfov, aspect)
        self.scene.camera = self.viewer.camera()
        for name, core in self.cores.items():
            core.restore(kept["cores"].get(name, {}), self.scene)
        self._say_camera()

    # Inside

    def _obstacles(self) -> tuple[Placed, ...]:
        try:
            return load(self.obstacles) if self.obstacles else ()
        except ObstacleError as error:
            raise ParamProblem(str(error)) from None

    def _see(self) -> None:
        """Bring the scene to this step: time, obstacles, camera, the newest pose that fits the skeleton."""
        self.scene.now = self.now / SECOND
        standing: list[Obstacle] = [one.now(self.scene.now) for one in self.placed]
        for pen in self.pens.values():
            pen.obstacles = [*standing, *self.heard.obstacles]
        self.scene.camera = self.viewer.camera()
        pose = self.newest
        if pose is None or len(pose.rotations) != len(self.scene.skeleton):
            return
        self.newest = None
        self.scene.take(pose.root, pose.rotations, (pose.contacts.left_foot, pose.contacts.right_foot))

    def _say(self) -> None:
        """Publish what all cores mean now."""
        whole = Meaning()
        for core in self.cores.values():
            one = core.update(self.scene)
            whole.target.update(one.target)
            whole.commands += one.commands
            whole.overlay += one.overlay
        if whole.target or self.held or self.now - self.said_at >= REMIND:
            self.held = bool(whole.target)
            self.said_at = self.now
            self.target.publish(Target(**whole.target))  # type: ignore[arg-type]
        for command in whole.commands:
            if not command.id:
                # Above those of an earlier run, so that no listener takes it for one that it has had.
                self.ids = max(self.ids + 1, self.now // 1000)
                command.id = self.ids
            self.command.publish(command)
        whole.overlay += shown([one.now(self.scene.now) for one in self.placed], FLOOR)
        if whole.overlay or self.drawn:
            self.drawn = bool(whole.overlay)
            self.overlay.publish(Overlay(primitives=whole.overlay))
        self._say_camera()

    def _say_camera(self) -> None:
        dt = min(max((self.now - self.followed) / SECOND, 0.0), 0.1)
        self.followed = self.now
        touching = [core for core in self.cores.values() if isinstance(core, TouchCore) and core.held]
        if self.follow and not any(core.holds_pelvis for core in touching):
            if not any(pen.holds_picture for pen in self.pens.values()):
                root = self.scene.positions[0]
                self.viewer.follow(float(root[0]), float(root[2]), dt)
            for pen in self.pens.values():
                # A finger on the picture leads a part beside the figure: the figure then stays in its place.
                if pen.drawing is not None and not touching:
                    self.viewer.keep(*pen.drawing, dt, jump=not pen.holds_picture)
        news = self.viewer.news()
        if news is not None:
            self.scene.camera = news
            self.camera.publish(news)
