"""The node: judges each pose by the game's rules, and says the course as an overlay and the record as `course`."""

from math import hypot
from typing import Any

import msgspec
import numpy as np

from bunraku.figure.capsules import Capsules, capsules
from bunraku.figure.default import default_figure
from bunraku.figure.fk import fk
from bunraku.figure.skeleton import Skeleton, SkeletonError
from bunraku.figure.wire import from_message
from bunraku.msgs import Course, Overlay, Pose, SkeletonMessage
from bunraku.nodes.course.drawing import drawn
from bunraku.nodes.course.game import Game, Score, Seen
from bunraku.nodes.course.stages import Place, stages
from bunraku.runtime.node import Node, Publisher, param, request, subscribe, timer

SECOND = 1_000_000_000
SAY_EVERY = SECOND // 10
"""ns between two records while nothing but the time changes."""
PUT = 1.0
"""m from one pose to the next that nobody walks: the figure was put there."""


class CourseGame(Node):
    """A course to walk: tiles, moving obstacles, time, course-outs, collisions."""

    name = "course"
    overlay: Publisher[Overlay] = Publisher("overlay/course", Overlay)
    record: Publisher[Course] = Publisher("course", Course)

    stage_number: int = param(1, low=1, high=4, doc="1 the straight, 2 corners, 3 the winding way, 4 islands")
    obstacles: bool = param(True, doc="things that go to and fro and must not be touched")
    again: float = param(8.0, low=0.0, high=600.0, doc="s after the goal until the next run is laid out; 0 for never")

    def setup(self) -> None:
        self.runs = 0
        self.place: Place = (0.0, 0.0)
        self.last: Place = (0.0, 0.0)
        self.finished_at = 0
        self.said_at = 0
        self.said: Course | None = None
        self.zero = self.now
        self.wire_hash = ""
        self.posed = False
        self._take(default_figure())
        self._lay()

    def on_param(self, name: str) -> None:
        if name in ("stage_number", "obstacles"):
            self._lay()

    @request("reset")
    def reset(self) -> dict[str, Any]:
        """Begin again: the start lies where the figure is now."""
        self._lay()
        return {}

    @subscribe("skeleton", SkeletonMessage, trigger=False)
    def on_skeleton(self, msg: SkeletonMessage) -> None:
        """The figure on stage."""
        try:
            skeleton = from_message(msg)
            if skeleton.hash != self.wire_hash:
                self._take(skeleton)
        except SkeletonError as error:
            self.log.warning("skeleton left out: %s", error)
            return
        self.wire_hash = skeleton.hash

    @subscribe("pose", Pose)
    def on_pose(self, msg: Pose) -> None:
        """Judge a pose."""
        if len(msg.rotations) != len(self.skeleton):
            return
        seen = self._seen(msg)
        there = (seen.hips[0] + self.place[0], seen.hips[1] + self.place[1])
        if not self.posed or hypot(there[0] - self.last[0], there[1] - self.last[1]) > PUT:
            self.posed, self.last = True, there  # the first pose, or the figure was put somewhere else
            self._lay()
            seen = self._seen(msg)
        before = self.game.phase
        self.game.update(self._time(), seen)
        self.last = there
        if before != "finished" and self.game.phase == "finished":
            self.runs += 1
            self.finished_at = self.now
            score = self.game.score
            self.log.info(
                "stage %d: %.2f s, %d course-outs, %d collisions, %.2f points",
                self.stage_number, score.seconds, score.outs, score.hits, score.points(),
            )  # fmt: skip

    @timer(hz=30)
    def show(self) -> None:
        """Say the course and the record; lay the next run."""
        if self.game.phase == "finished" and self.again and self.now - self.finished_at >= self.again * SECOND:
            self._lay()
        self.overlay.publish(Overlay(primitives=drawn(self.game, self._time(), self.stage_number, self.place)))
        self._say()

    def save(self) -> bytes | None:
        game = self.game
        return msgspec.msgpack.encode(
            {
                "zero": self.zero, "origin": self.place, "last": self.last, "runs": self.runs, "phase": game.phase,
                "began": game.began, "laid": game.laid, "score": [game.score.seconds, game.score.outs, game.score.hits],
                "off": game.off, "stage": self.stage_number, "finished": self.finished_at,
            }
        )  # fmt: skip

    def restore(self, state: bytes) -> None:
        kept = msgspec.msgpack.decode(state)
        self.runs = int(kept["runs"])
        if kept["stage"] != self.stage_number:
            return
        self.posed = True
        self.zero, self.finished_at = int(kept["zero"]), int(kept["finished"])
        self.place = (float(kept["origin"][0]), float(kept["origin"][1]))
        self.last = (float(kept["last"][0]), float(kept["last"][1]))
        game = self.game
        game.phase, game.began, game.laid = kept["phase"], float(kept["began"]), kept["laid"]
        seconds, outs, hits = kept["score"]
        game.score = Score(float(seconds), int(outs), int(hits))
        game.off = bool(kept["off"])

    # Inside

    def _take(self, skeleton: Skeleton) -> None:
        self.skeleton = skeleton
        self.cones: Capsules = capsules(skeleton)
        roles = skeleton.roles
        self.feet = [
            [roles[side + "Foot"], roles.get(side + "Toes", roles[side + "Foot"])] for side in ("left", "right")
        ]
        self.hips = roles["hips"]

    def _lay(self) -> None:
        self.place = self.last
        self.game = Game(stages()[self.stage_number - 1], self.obstacles)
        self.game.since(self._time())
        self.finished_at = 0

    def _time(self) -> float:
        """s on the game's clock."""
        return (self.now - self.zero) / SECOND

    def _seen(self, pose: Pose) -> Seen:
        root = pose.root.astype(np.float64) - [self.place[0], 0.0, self.place[1]]
        positions, turns = fk(self.skeleton, root, pose.rotations.astype(np.float64))
        starts, ends = self.cones.placed(positions, turns)
        x, _, z = (float(v) for v in positions[self.hips])
        feet = np.array([positions[pair].mean(axis=0)[[0, 2]] for pair in self.feet])
        return Seen(
            hips=(x, z), feet=feet, standing=(pose.contacts.left_foot, pose.contacts.right_foot),
            starts=starts, ends=ends, radii=self.cones.radii,
        )  # fmt: skip

    def _say(self) -> None:
        game, score = self.game, self.game.score
        news = Course(
            stage=self.stage_number, obstacles=self.obstacles, phase=game.phase, seconds=score.seconds,
            course_outs=score.outs, collisions=score.hits, points=score.points(game.rules), off=game.off,
            touched=any(game.touched), runs=self.runs,
        )  # fmt: skip
        said = self.said
        same = said is not None and all(
            getattr(said, key) == getattr(news, key)
            for key in ("stage", "obstacles", "phase", "course_outs", "collisions", "off", "touched", "runs")
        )
        if same and self.now - self.said_at < (SAY_EVERY if game.phase == "running" else SECOND):
            return
        self.said, self.said_at = news, self.now
        self.record.publish(news)
