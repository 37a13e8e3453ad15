"""From a plan of pelvis, feet, trunk and arms to the frames of a figure: what every generated motion shares.

A plan says where the pelvis and the ankles are, how the feet are pitched and turned, and how trunk and arms are bent,
frame by frame; the legs follow by inverse kinematics. Angles are anatomical: flexion forward, lean and turn to
the left, in radians. Lengths are in metres of the skeleton that the plan is for.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.quat import mul as mul_into
from bunraku.figure.rig import Rig, rig_of
from bunraku.figure.skeleton import Skeleton
from bunraku.motion import rotation as rot
from bunraku.motion.clip import Clip, local
from bunraku.motion.ground import Sole, sole_of
from bunraku.motion.leg import bend_leg
from bunraku.motion.synth_bounds import arms_in_body, eased

Array = NDArray[np.float64]

FPS = 60.0
LEFT, RIGHT = 0, 1
SIDES = ("left", "right")
SIGN = (1.0, -1.0)  # +X is the figure's left
GRAVITY = 9.81  # m/s²
REFERENCE_LEG = 0.83  # m, thigh and shin of the figure that lengths and times were written for
ARM_TRIES = 8
"""How often arms are lifted aside until they are clear."""
ARM_DONE = 0.005  # rad, which is left as it is
KNEE_TURN = np.radians(52.0)
"""What a knee turns toward its foot at most, softly: the rest of a foot's turn is left to the ankle."""
MOST_REACH = 0.9985  # of the leg's length: the knee keeps 6 degrees


@dataclass(frozen=True)
class Frame:
    """The measures of one skeleton that plans need."""

    skeleton: Skeleton

    @cached_property
    def rig(self) -> Rig:
        return rig_of(self.skeleton)

    @cached_property
    def soles(self) -> tuple[Sole, Sole]:
        return sole_of(self.skeleton, "left"), sole_of(self.skeleton, "right")

    @property
    def leg(self) -> float:
        """Thigh and shin, m."""
        return float(self.rig.leg_length)

    @property
    def length(self) -> float:
        """Size against the reference figure; what is written in metres is multiplied by it."""
        return self.leg / REFERENCE_LEG

    @property
    def time(self) -> float:
        """Slowness against the reference figure (equal Froude numbers: the root of the size)."""
        return float(np.sqrt(self.length))

    @cached_property
    def hip_offsets(self) -> Array:
        """(2, 3) m from the root joint to the left and right hip joint at rest."""
        rest = self.skeleton.rest_positions
        return np.stack([rest[self.skeleton.role(s + "UpperLeg")] - rest[0] for s in SIDES])

    @property
    def standing(self) -> float:
        """Height of the root joint with straight legs on flat soles, m."""
        return float(self.soles[0].height + self.leg - self.hip_offsets[0, 1])

    @property
    def width(self) -> float:
        """From the midline to the ankle when the legs hang straight, m."""
        return float(abs(self.hip_offsets[0, 0]))


def zeros(frames: int) -> Array:
    return np.zeros(frames)


@dataclass
class Plan:
    """One motion, F frames. World: the figure starts near the origin and faces +Z."""

    root: Array  # (F, 3) m
    heading: Array  # (F,) rad, of the whole figure
    ankles: Array  # (2, F, 3) m
    foot_yaw: Array  # (2, F) rad in the world
    foot_pitch: Array  # (2, F) rad, toes up positive
    contacts: NDArray[np.bool_]  # (F, 2)
    pelvis: Array = field(default_factory=lambda: np.zeros((0, 3)))  # (F, 3) forward tilt, turn, lean against heading
    trunk: Array = field(default_factory=lambda: np.zeros((0, 3)))  # (F, 3) of the chest against heading
    gaze: Array = field(default_factory=lambda: np.zeros((0, 3)))  # (F, 3) of the head against heading
    toe_bend: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (2, F)
    shoulder: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (2, F) upper arm forward of hanging
    abduct: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (2, F) upper arm out from hanging
    inward: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (2, F) upper arm rolled inward
    elbow: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (2, F)
    knee_out: float = 0.05  # rad: knees point this much outside of the feet

    def __post_init__(self) -> None:
        frames = len(self.root)
        for key in ("pelvis", "trunk", "gaze"):
            if getattr(self, key).shape != (frames, 3):
                setattr(self, key, np.zeros((frames, 3)))
        for key in ("toe_bend", "shoulder", "abduct", "inward", "elbow"):
            if getattr(self, key).shape != (2, frames):
                setattr(self, key, np.zeros((2, frames)))


def turned(tilts: Array) -> Array:
    """(F, 4) of (F, 3): turned about +Y, then leaned to the left, then tilted forward, all in the heading's frame."""
    forward = rot.axis_angle(np.array([1.0, 0.0, 0.0]), tilts[:, 0])
    lean = rot.axis_angle(np.array([0.0, 0.0, 1.0]), -tilts[:, 2])
    return rot.mul(lean, rot.mul(forward, rot.yaw(tilts[:, 1])))


def assemble(name: str, frame: Frame, plan: Plan, closed: bool = False) -> Clip:
    """The frames of a plan on its skeleton, 60 a second; ``closed`` where the last one is the first again.

    Arms that would hang in trunk or legs are lifted aside (``plan.abduct``).
    """
    clip = posed(name, frame, plan)
    for _ in range(ARM_TRIES):
        lack = arms_in_body(clip)
        if lack.max() < ARM_DONE:
            break
        plan.abduct += np.stack([eased(1.3 * row, 6, closed) for row in lack])
        clip = posed(name, frame, plan)
    return clip


def posed(name: str, frame: Frame, plan: Plan) -> Clip:
    """The frames of a plan as they are."""
    skeleton, rig = frame.skeleton, frame.rig
    frames = len(plan.root)
    world = np.zeros((frames, len(skeleton), 4))
    world[..., 3] = 1.0
    facing = rot.yaw(plan.heading)
    pelvis, chest = turned(plan.pelvis), turned(plan.trunk)
    head = turned(plan.gaze)
    done = {0}
    world[:, 0] = rot.mul(facing, pelvis)
    back = [int(j) for j in rig.back]
    for n, joint in enumerate(back):
        world[:, joint] = rot.mul(facing, rot.slerp(pelvis, chest, np.full(frames, (n + 1.0) / len(back))))
        done.add(joint)
    for n, joint in enumerate(rig.neck):
        world[:, joint] = rot.mul(facing, rot.slerp(chest, head, np.full(frames, (n + 1.0) / len(rig.neck))))
        done.add(int(joint))
    arms: dict[int, Array] = {}
    for side, (name_of_side, sign) in enumerate(zip(SIDES, SIGN, strict=True)):
        arms.update(_arm(skeleton, plan, side, name_of_side, sign))
        _leg(frame, plan, world, side)
    for side_name in SIDES:
        for part in ("UpperLeg", "LowerLeg", "Foot", "Toes"):
            if side_name + part in skeleton.roles:
                done.add(skeleton.roles[side_name + part])
    # Joints that no part of the plan speaks of keep their rest orientation against their parent.
    for joint in range(1, len(skeleton)):
        if joint in done:
            continue
        above = world[:, skeleton.parents[joint]]
        world[:, joint] = rot.mul(above, arms[joint]) if joint in arms else above
    return Clip(name, skeleton, FPS, plan.root, local(skeleton, world))


def _arm(skeleton: Skeleton, plan: Plan, side: int, name: str, sign: float) -> dict[int, Array]:
    """Local rotations of upper and lower arm (and a relaxed wrist) from shoulder and elbow angles."""
    x, y, z = np.eye(3)
    hang = rot.axis_angle(z, -sign * (0.5 * np.pi - plan.abduct[side]))
    swing = rot.axis_angle(x, -plan.shoulder[side])
    roll = rot.axis_angle(x, plan.inward[side])
    upper = rot.mul(swing, rot.mul(hang, roll))
    lower = rot.axis_angle(y, -sign * plan.elbow[side])
    wrist = rot.mul(
        rot.axis_angle(z, np.full(len(plan.root), -sign * 0.12)),
        rot.axis_angle(y, np.full(len(plan.root), -sign * 0.1)),
    )
    shoulder = skeleton.roles.get(name + "Shoulder", -1)
    out = {
        skeleton.role(name + "UpperArm"): upper,
        skeleton.role(name + "LowerArm"): lower,
        skeleton.role(name + "Hand"): wrist,
    }
    if shoulder >= 0:  # the girdle goes along with the arm a little
        out[shoulder] = rot.axis_angle(y, -sign * 0.10 * plan.shoulder[side])
    return out


def _leg(frame: Frame, plan: Plan, world: Array, side: int) -> None:
    """World orientations of thigh, shin, foot and toes by inverse kinematics, in place."""
    skeleton, rig = frame.skeleton, frame.rig
    limb = 2 + side
    upper_joint, lower_joint, foot_joint = (int(j) for j in rig.limbs[limb])
    upper, lower = (float(v) for v in rig.lengths[limb])
    hips = plan.root + rot.rotate(world[:, 0], frame.hip_offsets[side])
    x = np.array([1.0, 0.0, 0.0])
    foot_yaw = rot.yaw(plan.foot_yaw[side])
    pitch = rot.axis_angle(x, -plan.foot_pitch[side])
    world[:, foot_joint] = rot.mul(foot_yaw, pitch)
    # The knee points between pelvis and foot, a little outward.
    turn = plan.heading + 0.4 * plan.pelvis[:, 1]
    apart = _wrap(plan.foot_yaw[side] - turn)
    toward = turn + KNEE_TURN * np.tanh(0.65 * apart / KNEE_TURN) + SIGN[side] * plan.knee_out
    poles = np.stack([np.sin(toward), 0.1 * np.ones(len(toward)), np.cos(toward)], axis=-1)
    thigh, shin = np.empty(4), np.empty(4)
    for f in range(len(plan.root)):
        bend_leg(hips[f], plan.ankles[side, f], poles[f], upper, lower, MOST_REACH * (upper + lower), thigh, shin)
        mul_into(thigh, rig.rolls[limb, 0], world[f, upper_joint])
        mul_into(shin, rig.rolls[limb, 1], world[f, lower_joint])
    toes = skeleton.roles.get(SIDES[side] + "Toes", -1)
    if toes >= 0:
        bend = rot.axis_angle(x, -plan.toe_bend[side])
        world[:, toes] = rot.mul(world[:, foot_joint], bend)


def _wrap(angle: Array) -> Array:
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi, dtype=np.float64)
