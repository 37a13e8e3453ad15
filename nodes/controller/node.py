"""The controller node: `target`, `command` and `motion` in; `pose`, `skeleton` and an overlay out."""

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.quat import rotate
from bunraku.figure.wire import to_message
from bunraku.motion.figures import DEFAULT, figure_named
from bunraku.msgs import Command, Contacts, Motion, Overlay, Pose, Primitive, SkeletonMessage, Step, Target
from bunraku.nodes.controller.core import HINGES, PARTS, Stack
from bunraku.nodes.controller.state import Gains
from bunraku.runtime.node import Node, ParamProblem, Publisher, param, request, subscribe, timer

PAUSE = 500_000_000
"""ns that a controller which was laid over a motion waits for it after it was started again."""
OVERLAY_EVERY = 33_000_000
"""ns between two overlays."""
VISIBLE = 0.002
"""m: a smaller change is not drawn."""
SUPPORT_COLOR = (0.20, 0.55, 0.90, 0.35)
BALANCED_COLOR = (0.20, 0.65, 0.30, 0.9)
UNBALANCED_COLOR = (0.90, 0.35, 0.15, 0.9)
FOOTPRINT_COLOR = (0.20, 0.35, 0.55, 0.6)
_GAINS = Gains()


class Controller(Node):
    """Moves the whole figure from a few held parts: reach, balance, relaxing, self-collision, steps."""

    name = "controller"
    jit = True

    pose: Publisher[Pose] = Publisher("pose", Pose)
    skeleton: Publisher[SkeletonMessage] = Publisher("skeleton", SkeletonMessage)
    overlay: Publisher[Overlay] = Publisher("overlay/controller", Overlay)

    figure: str = param(DEFAULT, doc="default, or the file of one: .bvh, .amc or motion set")
    x: float = param(0.0, low=-1000.0, high=1000.0, doc="m, where it stands at the start")
    z: float = param(0.0, low=-1000.0, high=1000.0, doc="m, where it stands at the start")
    yaw: float = param(0.0, low=-7.0, high=7.0, doc="rad about +Y from +Z, where it faces at the start")
    w_tracking: float = param(_GAINS.w_tracking, low=0.0, high=10.0, doc="weight of tracking (eq. 13)")
    w_balance: float = param(_GAINS.w_balance, low=0.0, high=10.0, doc="weight of balance; 0 switches it off")
    w_interaction: float = param(_GAINS.w_interaction, low=0.0, high=10.0, doc="weight of inter-body interaction")
    w_relaxing: float = param(_GAINS.w_relaxing, low=0.0, high=10.0, doc="weight of relaxing against interaction")
    w_collision: float = param(
        _GAINS.w_collision, low=0.0, high=1.0, doc="self-collision avoidance: 0 off, anything above wholly on"
    )
    ee_to_trunk: float = param(_GAINS.ee_to_trunk, low=0.0, high=20.0, doc="hands' and feet's influence on the trunk")
    trunk_to_ee: float = param(_GAINS.trunk_to_ee, low=0.0, high=5.0, doc="the trunk's influence on hands")
    pelvis_trunk: float = param(
        _GAINS.pelvis_trunk, low=0.0, high=1.0, doc="the pelvis's part of keeping balance; the trunk has the rest"
    )
    relax_trunk: float = param(_GAINS.relax_trunk, low=0.0, high=20.0, doc="rad/s at which the trunk comes upright")
    relax_ends: float = param(_GAINS.relax_ends, low=0.0, high=10.0, doc="m/s at which free hands sink")
    relax_reach: float = param(
        _GAINS.relax_reach, low=0.0, high=10.0, doc="m/s at which the pelvis comes back from a reach"
    )
    relax_time: float = param(_GAINS.relax_time, low=0.01, high=5.0, doc="s, time constant of relaxing's last bit")
    ease_time: float = param(
        _GAINS.ease_time, low=0.005, high=2.0, doc="s, time constant in which a relaxing part takes up its speed"
    )
    landing_half_life: float = param(
        _GAINS.landing_half_life, low=0.02, high=2.0, doc="s in which a free foot comes down to the floor"
    )
    relax_pelvis: float = param(
        _GAINS.relax_pelvis, low=0.0, high=10.0, doc="m/s at which a released pelvis comes back; 0 leaves it"
    )
    half_life: float = param(_GAINS.half_life, low=0.005, high=2.0, doc="s in which a grab or a jump evens out")
    swivel_half_life: float = param(
        _GAINS.swivel_half_life, low=0.005, high=2.0, doc="s in which elbows and knees follow"
    )
    input_speed: float = param(_GAINS.input_speed, low=0.1, high=100.0, doc="m/s; what is faster evens out")
    turn_speed: float = param(_GAINS.turn_speed, low=0.1, high=20.0, doc="rad/s at which the figure turns")
    margin: float = param(
        _GAINS.margin, low=0.0, high=0.1, doc="m that the centre of mass keeps inside the support polygon"
    )
    support_time: float = param(
        _GAINS.support_time, low=0.005, high=2.0, doc="s, half-life in which a lifted foot stops counting as support"
    )
    clearance: float = param(_GAINS.clearance, low=0.0, high=0.1, doc="m kept between parts of the body")
    duck: float = param(_GAINS.duck, low=0.35, high=0.95, doc="lowest crouch, as a share of the leg's length")
    step_lift: float = param(_GAINS.step_lift, low=0.0, high=0.5, doc="m by which a stepping foot is lifted")
    step_time: float = param(_GAINS.step_time, low=0.05, high=2.0, doc="s that each phase of a step takes at least")
    step_pace: float = param(_GAINS.step_pace, low=0.0, high=5.0, doc="s/m added for a step's length")
    motion_half_life: float = param(
        _GAINS.motion_half_life, low=0.02, high=2.0, doc="s in which what a touch left over a motion evens out"
    )
    show_overlay: bool = param(True, doc="say support polygon, centre of mass and footprints for the picture")

    def setup(self) -> None:
        place = np.array([self.x, 0.0, self.z])
        try:
            self.core = Stack(figure_named(self.figure), self.gains(), place, self.yaw)
        except ValueError as error:
            raise ParamProblem(f"figure: {error}") from None
        self.stepped_at = self.now
        self.wait_until = 0
        self.last_step = -1
        self.drawn: NDArray[np.float64] | None = None
        self.drawn_at = 0
        self.refused = ""
        self.skeleton.publish(to_message(self.core.skeleton, self.figure))
        self.say()

    def gains(self) -> Gains:
        """The parameters that are gains."""
        return Gains()._replace(
            **{key: float(value) for key, value in self.param_values.items() if key in Gains._fields}
        )

    def on_param(self, name: str) -> None:
        if name in Gains._fields:
            self.core.gains = self.gains()

    @subscribe("target", Target)
    def on_target(self, msg: Target) -> None:
        self.take(msg)
        self.advance()

    def take(self, msg: Target) -> None:
        """Hold what a target holds, whole."""
        for name in (*PARTS, *HINGES, "trunk", "head", "yaw"):
            self.core.hold(name, getattr(msg, name))

    @subscribe("command", Command)
    def on_command(self, msg: Command) -> None:
        if not isinstance(msg, Step) or msg.id == self.last_step or self.core.under.active[0] > 0.5:
            return
        self.last_step = msg.id
        self.core.ask_step(np.array(msg.goal), msg.heading, msg.id)

    @subscribe("motion", Motion)
    def on_motion(self, msg: Motion) -> None:
        skeleton = self.core.skeleton
        if msg.skeleton != skeleton.hash or len(msg.rotations) != len(skeleton):
            if self.refused != msg.skeleton:
                self.refused = msg.skeleton
                self.log.warning(
                    "motion is for skeleton %s, this figure has %s: give both nodes the same figure",
                    msg.skeleton, skeleton.hash,
                )  # fmt: skip
            return
        self.core.lie_over(
            np.asarray(msg.root, dtype=np.float64), np.asarray(msg.rotations, dtype=np.float64),
            (msg.contacts.left_foot, msg.contacts.right_foot),
        )  # fmt: skip
        self.wait_until = 0
        self.advance()

    @timer(hz=60, idle=True)
    def tick(self) -> None:
        self.advance()

    @request("reset")
    def reset(self) -> dict[str, object]:
        """Stand in the start pose."""
        self.core.reset()
        self.say()
        return {}

    def advance(self) -> None:
        """Move on to now and say the pose."""
        if self.now < self.wait_until:
            return
        self.core.step((self.now - self.stepped_at) / 1e9)
        self.stepped_at = self.now
        self.say()

    def say(self) -> None:
        """Publish the pose and, where it changed visibly, the overlay."""
        core = self.core
        planted = core.state.planted
        self.pose.publish(
            Pose(
                skeleton=core.skeleton.hash,
                root=core.positions_ws[0].astype(np.float32),
                rotations=core.rotations_ls.astype(np.float32),
                contacts=Contacts(left_foot=bool(planted[0] > 0.5), right_foot=bool(planted[1] > 0.5)),
            )
        )
        if self.now - self.drawn_at >= OVERLAY_EVERY or self.drawn is None:
            self.draw()

    def draw(self) -> None:
        """Publish the support polygon, the footprints and the centre of mass on the ground."""
        core = self.core
        corners = core.hull[: core.hull_size]
        shown = np.concatenate([core.state.points[3:].ravel(), core.center, np.zeros(32)])
        shown[9 : 9 + corners.size] = corners.ravel()[:32]
        if not self.show_overlay:
            shown[:] = 0.0
        if self.drawn is not None and np.abs(shown - self.drawn).max() < VISIBLE:
            return
        self.drawn, self.drawn_at = shown, self.now
        self.overlay.publish(Overlay(primitives=self.primitives() if self.show_overlay else []))

    def primitives(self) -> list[Primitive]:
        """What the overlay shows."""
        core = self.core
        drawn: list[Primitive] = []
        if core.hull_size >= 3:
            polygon = [(float(x), 0.004, float(z)) for x, z in core.hull[: core.hull_size]]
            drawn.append(Primitive(kind="polygon", points=list(polygon), color=SUPPORT_COLOR, size=0.006))
        sole = np.empty(3)
        for side in range(2):
            if core.state.planted[side] > 0.5:
                points: list[tuple[float, ...]] = []
                for corner in core.rig.soles[side]:
                    rotate(core.rotations_ws[core.rig.limbs[2 + side, 2]], corner, sole)
                    x, _, z = core.positions_ws[core.rig.limbs[2 + side, 2]] + sole
                    points.append((float(x), 0.006, float(z)))
                drawn.append(Primitive(kind="polygon", points=points, color=FOOTPRINT_COLOR, size=0.004))
        drawn.append(
            Primitive(
                kind="circle",
                points=[(float(core.center[0]), 0.008, float(core.center[2]))],
                color=BALANCED_COLOR if core.balanced() else UNBALANCED_COLOR,
                size=0.02,
            )
        )
        return drawn

    def save(self) -> bytes:
        return int(self.last_step + 1).to_bytes(8, "little") + self.core.save()

    def restore(self, state: bytes) -> None:
        try:
            self.core.restore(state[8:])
        except ValueError as error:
            self.log.warning("starts anew: %s", error)
            return
        self.last_step = int.from_bytes(state[:8], "little") - 1
        if self.core.state.mode[1] > 0.5:
            self.wait_until = self.now + PAUSE
        self.say()
