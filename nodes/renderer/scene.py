"""The newest of what flows on the stage, and the view that it makes: a pure function of the messages heard."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bunraku.figure.camera import Orbit, letterbox
from bunraku.figure.fk import fk
from bunraku.figure.skeleton import Skeleton, SkeletonError
from bunraku.figure.wire import from_message
from bunraku.msgs import Camera, Message, Overlay, Pose, SkeletonMessage
from bunraku.nodes.renderer.view import Engine, Figure, Layer, Pixels, View

SECOND = 1_000_000_000
FOLLOW = 0.35  # s, half-life with which the own camera follows the figures
BARS = (34, 38, 46)
"""Colour of what the camera's aspect leaves of the picture."""


class Scene:
    """Collects messages by topic; `view` is the picture that they make.

    Args:
        figures: namespaces of the figures that are shown; "" for the one without.
    """

    def __init__(self, figures: Sequence[str] = ("",)) -> None:
        self.figures = tuple(figures)
        self.camera: Camera | None = None
        self.refused: dict[str, str] = {}
        """Figure -> why its skeleton cannot be drawn."""
        self._orbit: Orbit | None = None
        self._moved = 0
        self._skeletons: dict[str, Skeleton] = {}
        self._poses: dict[str, Pose] = {}
        self._early: dict[str, Pose] = {}
        """Poses whose skeleton is still on its way."""
        self._placed: dict[str, tuple[Pose, Figure]] = {}
        self._overlays: dict[str, Overlay] = {}

    def topics(self) -> tuple[str, ...]:
        """Names and patterns of the topics that matter."""
        each = [f"{name}/" if name else "" for name in self.figures]
        parts = ("pose", "skeleton", "camera", "overlay/*")
        return tuple(dict.fromkeys([*(f"{one}{part}" for one in each for part in parts), "camera", "overlay/*"]))

    def hear(self, topic: str, message: Message) -> bool:
        """Take a message; False when it changes no picture."""
        name, _, rest = topic.rpartition("/")
        if name.endswith("overlay") and (name == "overlay" or name.endswith("/overlay")):
            owner = name.removesuffix("overlay").rstrip("/")
            if not isinstance(message, Overlay) or not (owner == "" or owner in self.figures):
                return False
            self._overlays[topic] = message
            return True
        if rest == "camera" and isinstance(message, Camera):
            # one camera for all: the one without a namespace, else the first figure's
            if name == "" or (name in self.figures and "" not in self.figures and name == self.figures[0]):
                self.camera = message
                return True
            return False
        if name not in self.figures:
            return False
        if rest == "pose" and isinstance(message, Pose):
            skeleton = self._skeletons.get(name)
            if skeleton is None or not _fits(message, skeleton):
                self._early[name] = message
                return False
            self._poses[name] = message
            return True
        if rest == "skeleton" and isinstance(message, SkeletonMessage):
            return self._take_skeleton(name, message)
        return False

    def _take_skeleton(self, name: str, message: SkeletonMessage) -> bool:
        try:
            skeleton = from_message(message)
            skeleton.check_humanoid()
        except SkeletonError as error:
            self.refused[name] = str(error)
            return False
        self.refused.pop(name, None)
        known = self._skeletons.get(name)
        if known is None or known.hash != skeleton.hash:
            self._skeletons[name] = skeleton
            self._placed.pop(name, None)
            self._poses.pop(name, None)
            early = self._early.pop(name, None)
            if early is not None and _fits(early, skeleton):
                self._poses[name] = early
        return True

    @property
    def ready(self) -> bool:
        """Whether a figure can be shown."""
        return any(self._figure(name) is not None for name in self.figures)

    def view(self, now: int) -> View:
        """The picture at the time ``now`` (ns); with no camera heard, an own one follows the figures."""
        figures = tuple(figure for name in self.figures if (figure := self._figure(name)) is not None)
        middle = (0.0, 0.0)
        if figures:
            roots = np.array([figure.positions_ws[0] for figure in figures])
            low, high = roots.min(axis=0), roots.max(axis=0)
            middle = (float(low[0] + high[0]) / 2.0, float(low[2] + high[2]) / 2.0)
        camera = self.camera or self._own_camera(now, figures, middle)
        layers = tuple(
            Layer(tuple(overlay.primitives), self._parents(topic)) for topic, overlay in self._overlays.items()
        )
        return View(camera, figures, layers, middle)

    def _figure(self, name: str) -> Figure | None:
        pose, skeleton = self._poses.get(name), self._skeletons.get(name)
        if pose is None or skeleton is None:
            return None
        kept = self._placed.get(name)
        if kept is not None and kept[0] is pose:
            return kept[1]
        figure = Figure(skeleton, *fk(skeleton, pose.root.astype(np.float64), pose.rotations.astype(np.float64)))
        self._placed[name] = (pose, figure)
        return figure

    def _parents(self, topic: str) -> tuple[int, ...]:
        owner = topic.rpartition("overlay/")[0].rstrip("/")
        skeleton = self._skeletons.get(owner) or next(iter(self._skeletons.values()), None)
        return () if skeleton is None else tuple(int(parent) for parent in skeleton.parents)

    def _own_camera(self, now: int, figures: tuple[Figure, ...], middle: tuple[float, float]) -> Camera:
        default = Orbit()
        if not figures:
            return default.camera()
        spots = np.concatenate([figure.positions_ws for figure in figures])
        spread = float(np.ptp(spots[:, [0, 2]], axis=0).max())
        tall = max(figure.skeleton.rest_positions[:, 1].max() for figure in figures) / 1.525
        distance = default.distance * max(tall, 0.1) + max(0.0, spread - 1.6 * tall)
        goal = (middle[0], default.center[1] * max(tall, 0.1), middle[1])
        if self._orbit is None:
            self._orbit = replace(default, center=goal, distance=distance)
        else:
            share = 1.0 - 0.5 ** (max(0, now - self._moved) / SECOND / FOLLOW)
            at = self._orbit.center
            center = tuple(a + (b - a) * share for a, b in zip(at, goal, strict=True))
            self._orbit = replace(
                self._orbit, center=center, distance=self._orbit.distance + (distance - self._orbit.distance) * share
            )
        self._moved = now
        return self._orbit.camera()


def _fits(pose: Pose, skeleton: Skeleton) -> bool:
    return len(pose.rotations) == len(skeleton) and pose.skeleton in ("", skeleton.hash)


def paint(engine: Engine, view: View, width: int, height: int, overlays: bool = True) -> Pixels:
    """The finished picture (height, width, 4) with its overlays, letterboxed to the camera's aspect.

    The array may be reused by the next call.
    """
    from bunraku.nodes.renderer import overlay

    left, top, inner, tall = (round(part) for part in letterbox(view.camera.aspect, width, height))
    pixels = engine.draw(view, max(inner, 2), max(tall, 2))
    if overlays:
        overlay.draw(pixels, view.camera, view.layers)
    if (inner, tall) == (width, height):
        return pixels
    frame = np.empty((height, width, 4), np.uint8)
    frame[...] = (*BARS, 255)
    frame[top : top + pixels.shape[0], left : left + pixels.shape[1]] = pixels[: height - top, : width - left]
    return frame
