"""A touch table before a figure at rest: fake fingers, fake poses, virtual time."""

import numpy as np

from bunraku.figure.camera import orbit_from, project
from bunraku.figure.default import default_figure
from bunraku.figure.fk import fk
from bunraku.figure.wire import to_message
from bunraku.msgs import Camera, Contact, Contacts, Pose, Target, Touch
from bunraku.nodes.interpreter.node import Interpreter
from bunraku.runtime.memory import MemoryStage

FIGURE = default_figure()
HZ = 60.0
NAMES = ("pelvis", "left_hand", "right_hand", "left_foot", "right_foot", "trunk", "head", "yaw",
         "left_elbow", "right_elbow", "left_knee", "right_knee")  # fmt: skip
ROLES = {"pelvis": "hips", "left_hand": "leftHand", "right_hand": "rightHand", "left_foot": "leftFoot",
         "right_foot": "rightFoot", "trunk": "chest", "head": "head"}  # fmt: skip
JOINTS = {**ROLES, "left_elbow": "leftLowerArm", "right_elbow": "rightLowerArm", "left_knee": "leftLowerLeg",
          "right_knee": "rightLowerLeg"}  # fmt: skip


class Table:
    """A stage with a figure at rest and fingers on its picture."""

    def __init__(self, device: str = "test", **params: object) -> None:
        self.stage = MemoryStage()
        self.node = self.stage.add(Interpreter, **params)
        self.root, self.rotations = FIGURE.rest_pose()
        self.device = device
        self.fingers: dict[int, tuple[float, float]] = {}
        self.stage.publish("skeleton", to_message(FIGURE))
        self.pose()

    def pose(self, root: np.ndarray | None = None) -> None:
        if root is not None:
            self.root = np.array(root, dtype=float)
        self.stage.publish(
            "pose",
            Pose(
                skeleton=FIGURE.hash,
                root=self.root,
                rotations=self.rotations,
                contacts=Contacts(left_foot=True, right_foot=True),
            ),
        )

    def look_from(self, eye: tuple[float, float, float]) -> None:
        """Look at the middle of the figure from a place, m, once it is seen from there."""
        self.node.viewer.orbit = orbit_from(eye, (0, 0.9, 0), 0.576, 16 / 9)
        self.stage.advance(0.05)

    @property
    def camera(self) -> Camera:
        camera: Camera = self.stage.last("camera")
        return camera

    @property
    def target(self) -> Target:
        target: Target = self.stage.last("target")
        return target

    def held(self) -> set[str]:
        return {name for name in NAMES if getattr(self.target, name) is not None}

    def place(self, part: str) -> tuple[float, float]:
        """Where the middle of a part appears."""
        joint = FIGURE.role(JOINTS[part])
        positions, _ = fk(FIGURE, self.root, self.rotations)
        middle = positions[joint] + (FIGURE.box_centers[joint] if part in ROLES else 0.0)
        x, y = project(self.camera, middle)
        return float(x), float(y)

    def send(self, *contacts: Contact, device: str | None = None) -> None:
        self.stage.publish("touch", Touch(device=device or self.device, contacts=list(contacts)))

    def frame(self, phase: dict[int, str] | None = None) -> None:
        self.send(*[
            Contact(id=key, phase=(phase or {}).get(key, "move"), x=x, y=y)  # type: ignore[arg-type]
            for key, (x, y) in self.fingers.items()
        ])  # fmt: skip

    def down(self, key: int, place: tuple[float, float]) -> None:
        self.fingers[key] = place
        self.frame({key: "down"})

    def drag(self, key: int, to: tuple[float, float], seconds: float) -> None:
        start = np.array(self.fingers[key])
        steps = max(1, round(seconds * HZ))
        for k in range(1, steps + 1):
            self.stage.advance(1.0 / HZ)
            self.pose()
            x, y = start + (np.array(to) - start) * k / steps
            self.fingers[key] = (float(x), float(y))
            self.frame()

    def up(self, key: int) -> None:
        self.frame({key: "up"})
        del self.fingers[key]
