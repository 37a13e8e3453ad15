"""The blender node: `command` in; `motion` (or `pose` and `skeleton`) and an overlay out, 60 times a second."""

from collections.abc import Sequence
from pathlib import Path as File
from typing import Any

import numpy as np

from bunraku.figure.wire import to_message
from bunraku.motion.figures import DEFAULT, figure_named
from bunraku.motion.ground import GroundHeight, Heightfield
from bunraku.motion.motionset import MotionSet
from bunraku.motion.player import PACE, Pace, Transition
from bunraku.motion.rotation import heading as heading_of
from bunraku.motion.synth import builtin_set
from bunraku.msgs import Command, Contacts, Motion, Overlay, Pose, SkeletonMessage
from bunraku.nodes.blender.core import BlenderCore
from bunraku.runtime.node import Node, ParamProblem, Publisher, param, request, subscribe, timer

DRIVE_EVERY = 100_000_000
"""ns between two looks at the drive parameters."""
OVERLAY_EVERY = 66_000_000
"""ns between two overlays."""


def ground_of(path: str) -> GroundHeight | None:
    """The ground of an ``.npz`` file with ``heights`` (n, m; m), ``cell`` (m) and optional ``x``, ``z``; None for ''.

    Raises ValueError with one line.
    """
    if not path:
        return None
    try:
        with np.load(File(path), allow_pickle=False) as data:
            x, z = (float(data[key]) if key in data else 0.0 for key in ("x", "z"))
            return Heightfield(data["heights"], float(data["cell"]), x, z)
    except (OSError, KeyError, ValueError, TypeError) as error:
        raise ValueError(f"cannot use ground {path}: {error}; needs an .npz with heights and cell") from None


class Blender(Node):
    """Walks, runs, steps, turns and jumps on command, from blended examples."""

    name = "blender"
    jit = True

    motion: Publisher[Motion] = Publisher("motion", Motion)
    overlay: Publisher[Overlay] = Publisher("overlay/blender", Overlay)

    figure: str = param(DEFAULT, doc="of the built-in motions: default, or the file of one: .bvh, .amc or motion set")
    motions: str = param("", doc="file of a motion set; empty for the built-in one")
    skeleton: bool = param(False, doc="say `skeleton`: where no controller does (`motion` is then remapped to `pose`)")
    ground: str = param("", doc="file of uneven ground: .npz with heights (m), cell (m), x, z; empty for level ground")
    x: float = param(0.0, low=-1000.0, high=1000.0, doc="m, where it stands at the start")
    z: float = param(0.0, low=-1000.0, high=1000.0, doc="m, where it stands at the start")
    yaw: float = param(0.0, low=-7.0, high=7.0, doc="rad about +Y from +Z, where it faces at the start")
    usual_speed: float = param(PACE.usual, low=0.1, high=6.0, doc="m/s on a path that asks for none")
    most_speed: float = param(PACE.most, low=0.2, high=8.0, doc="m/s, the limit of running")
    brake: float = param(PACE.brake, low=0.2, high=10.0, doc="m/s², slowing down toward a path's end")
    start_up: float = param(PACE.start, low=0.2, high=10.0, doc="m/s², from a stand")
    transition: str = param(
        "inertialise", choices=["inertialise", "example"],
        doc="from one motion to the next: by decaying offsets, or the next one's first posture as one more example",
    )  # fmt: skip
    transition_half_life: float = param(PACE.switch, low=0.01, high=1.0, doc="s, of a transition")
    posture_half_life: float = param(PACE.posture, low=0.01, high=2.0, doc="s in which postures follow")
    foot_lock: bool = param(True, doc="hold planted feet by inverse kinematics")
    drive_speed: float = param(0.0, low=0.0, high=8.0, doc="m/s: walk by speed and turn instead of by commands")
    drive_turn: float = param(0.0, low=-3.0, high=3.0, doc="rad/s to the left, while drive_speed is not 0")
    drive_tilt: float = param(0.0, low=-1.0, high=1.0, doc="rad to the left, standing or driven")
    drive_bend: float = param(0.0, low=-1.0, high=1.6, doc="rad forward, standing or driven")
    drive_duck: float = param(0.0, low=0.0, high=1.0, doc="0..1, standing or driven")
    show_overlay: bool = param(True, doc="say path and footprints for the picture")

    @classmethod
    def further(cls, params: dict[str, Any]) -> tuple[Sequence[str], Sequence[str]]:
        """The skeleton, where it is said here."""
        return (["skeleton"] if params["skeleton"] else []), ()

    def setup(self) -> None:
        try:
            motion_set = MotionSet.load(File(self.motions)) if self.motions else builtin_set(figure_named(self.figure))
        except ValueError as error:
            raise ParamProblem(f"{'motions' if self.motions else 'figure'}: {error}") from None
        self.core = BlenderCore(
            motion_set, pace=self._pace(), transition=self._transition(), lock=self.foot_lock,
            ground=ground_of(self.ground), say=self.log.warning,
        )  # fmt: skip
        self.core.reset(self.x, self.z, self.yaw)
        self.placed = False
        self.before = self.now
        self.drawn_at = 0
        self.driven_at = 0
        if self.skeleton:
            self.advertise("skeleton", SkeletonMessage).publish(to_message(self.core.skeleton, self.figure))

    def _pace(self) -> Pace:
        return Pace(
            usual=self.usual_speed, most=self.most_speed, brake=self.brake, start=self.start_up,
            switch=self.transition_half_life, posture=self.posture_half_life,
        )  # fmt: skip

    def _transition(self) -> Transition:
        return "example" if self.transition == "example" else "inertialise"

    def on_param(self, name: str) -> None:
        player = self.core.player
        player.pace, player.stance.lock = self._pace(), self.foot_lock
        player.transition = self._transition()

    @subscribe("command", Command)
    def on_command(self, msg: Command) -> None:
        self.placed = True
        self.core.hear(msg)

    @subscribe("pose", Pose, trigger=False)
    def on_pose(self, msg: Pose) -> None:
        """Where nothing was saved, the figure goes on from where it is seen; afterwards poses are not needed."""
        if self.placed:
            return
        self.placed = True
        if msg.skeleton != self.core.skeleton.hash:
            return
        turn = float(heading_of(np.asarray(msg.rotations[0], dtype=np.float64)))
        self.core.reset(float(msg.root[0]), float(msg.root[2]), turn)

    @timer(hz=60)
    def tick(self) -> None:
        dt = (self.now - self.before) * 1e-9
        self.before = self.now
        if dt <= 0.0:
            return
        if self.now - self.driven_at >= DRIVE_EVERY:
            self.driven_at = self.now
            self.core.drive(self.drive_speed, self.drive_turn, self.drive_tilt, self.drive_bend, self.drive_duck)
        self.core.update(dt)
        player = self.core.player
        self.placed = True
        self.motion.publish(
            Motion(
                skeleton=self.core.skeleton.hash,
                root=player.root.astype(np.float32),
                rotations=player.rotations.astype(np.float32),
                contacts=Contacts(left_foot=bool(player.contacts[0] > 0.5), right_foot=bool(player.contacts[1] > 0.5)),
            )
        )
        if self.show_overlay and self.now - self.drawn_at >= OVERLAY_EVERY:
            self.drawn_at = self.now
            self.overlay.publish(self.core.overlay())

    @request("reset")
    def reset(self) -> dict[str, object]:
        """Stand at the start with nothing to do."""
        self.core.reset(self.x, self.z, self.yaw)
        return {}

    def save(self) -> bytes | None:
        return self.core.save()

    def restore(self, state: bytes) -> None:
        try:
            self.core.restore(state)
        except ValueError as error:
            self.log.warning("does not take up from its saved state: %s", error)
            self.core.reset(self.x, self.z, self.yaw)
            return
        self.placed = True
