"""What a simulated user sees: where the joints of figure and ghost appear on the picture, and nothing else.

All lengths are picture heights. The user knows the figure's own proportions, as anyone does who has looked at it:
a limb or a pair of hips that appears shorter than it is points toward the viewer or away. What hides behind the
body is taken to be seen (the ghost is transparent); how far away anything is, is not.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.camera import axes, project
from bunraku.figure.skeleton import Skeleton
from bunraku.msgs import Camera

Array = NDArray[np.float64]
SHORTENED = 0.6
"""Share of its own length below which a part of an arm clearly points out of the picture."""
ARM = (("UpperArm", "LowerArm"), ("LowerArm", "Hand"))


def part_role(part: str) -> str:
    """The role of the joint whose place on the picture tells where a part is."""
    names = {"pelvis": "hips", "turn": "hips", "trunk": "neck", "head": "head"}
    side, _, end = part.partition("_")
    return names.get(part) or side + end.capitalize()


@dataclass(frozen=True, eq=False)
class Sight:
    """One look at the picture."""

    skeleton: Skeleton
    now: Array  # (J, 2) the figure
    goal: Array  # (J, 2) the ghost
    azimuth: float
    """rad about +Y from +Z to the viewer: as the floor's grid and the user's own swipes tell."""
    elevation: float  # rad

    @classmethod
    def at(cls, skeleton: Skeleton, camera: Camera, figure_ws: Array, ghost_ws: Array) -> "Sight":
        """The picture that ``camera`` takes of the joints (J, 3) of both."""
        tall = np.array([camera.aspect, 1.0])
        back = axes(camera)[2]
        return cls(
            skeleton, project(camera, figure_ws) * tall, project(camera, ghost_ws) * tall,
            float(np.arctan2(back[0], back[2])), float(np.arcsin(np.clip(back[1], -1.0, 1.0))),
        )  # fmt: skip

    def off(self, part: str) -> Array:
        """By how much a part is off (2), to the right and down."""
        joint = self.skeleton.role(part_role(part))
        away: Array = self.goal[joint] - self.now[joint]
        return away

    def wrong(self, part: str) -> float:
        """How wrong a part looks: its distance; for the trunk how differently it leans."""
        away = self.off(part)
        return float(np.linalg.norm(away - self.off("pelvis") if part == "trunk" else away))

    def heading(self, joints: Array, hips: float) -> float:
        """Where the figure or ghost (J, 2) faces, rad against the viewer, by how wide its hips look (``hips`` when
        they face the viewer) and to which side its toes point."""
        left, right = (joints[self.skeleton.role(side + "UpperLeg")] for side in ("left", "right"))
        toes = sum(float(joints[self.skeleton.role(side + "Toes")][0] - joints[self.skeleton.role(side + "Foot")][0])
                   for side in ("left", "right"))  # fmt: skip
        return float(np.sign(toes) * np.arccos(np.clip((left[0] - right[0]) / hips, -1.0, 1.0)))

    def hips(self) -> float:
        """How wide the figure's hips look."""
        return float(self.now[self.skeleton.role("leftUpperLeg"), 0] - self.now[self.skeleton.role("rightUpperLeg"), 0])

    def deep(self, scale: float) -> bool:
        """Whether the ghost has an arm that points toward the viewer or away; ``scale``: picture heights a metre."""
        for side in ("left", "right"):
            for above, below in ARM:
                a, b = self.skeleton.role(side + above), self.skeleton.role(side + below)
                whole = float(np.linalg.norm(self.skeleton.offsets[b])) * scale
                if float(np.linalg.norm(self.goal[a] - self.goal[b])) < SHORTENED * whole:
                    return True
        return False
