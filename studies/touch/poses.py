"""Five target poses of rising difficulty, as the joints' places of poses that the figure can take.

What stood in the paper's figure 9 is not known in numbers; these are ours: one arm; both arms; a crouch with both
arms; turned with the hands near each other before the chest; a lunge with feet and hands to front, back and sides.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bunraku.msgs import Target
from bunraku.nodes.controller.node import Controller
from bunraku.runtime.memory import MemoryStage

Array = NDArray[np.float64]
Point = tuple[float, float, float]


@dataclass(frozen=True)
class Goal:
    """A target pose: what is held to take it."""

    name: str
    says: str
    held: dict[str, Point] = field(default_factory=dict)
    yaw: float | None = None
    lean: tuple[float, float] = (0.0, 0.0)  # rad forward, to the left
    feet: dict[str, Point] = field(default_factory=dict)


GOALS = (
    Goal("1", "one arm raised", held={"left_hand": (0.50, 1.72, 0.05)}),
    Goal("2", "both arms, leaning", lean=(0.0, -0.22),
         held={"left_hand": (0.44, 1.60, 0.05), "right_hand": (-0.60, 1.10, 0.05)}),
    Goal("3", "crouch with both arms",
         held={"pelvis": (0.03, 0.72, 0.0), "left_hand": (0.60, 1.05, 0.05), "right_hand": (-0.35, 1.55, 0.05)}),
    Goal("4", "turned, hands before the chest", yaw=0.70,
         held={"left_hand": (0.34, 1.28, 0.22), "right_hand": (0.14, 1.24, 0.33)}),
    Goal("5", "lunge, hands to front and side",
         feet={"left_foot": (0.20, 0.085, 0.16), "right_foot": (-0.17, 0.085, -0.10)},
         held={"pelvis": (0.02, 0.82, 0.03), "left_hand": (0.42, 1.32, 0.40), "right_hand": (-0.50, 1.25, -0.15)}),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Ghost:
    """The goal as it is shown to the user."""

    goal: Goal
    positions: Array  # (J, 3) m
    root: Array  # (3) m
    rotations: Array  # (J, 4)


def trunk_turn(forward: float, left: float, yaw: float) -> tuple[float, float, float, float]:
    """The trunk's orientation (xyzw): turned by ``yaw``, then leaning in the world's frame turned likewise."""
    angle = float(np.hypot(forward, left))
    half_y, half = 0.5 * yaw, 0.5 * angle
    if angle < 1e-9:
        return (0.0, float(np.sin(half_y)), 0.0, float(np.cos(half_y)))
    # Forward is a turn about the figure's +X, to its left about -Z.
    x, z = forward / angle, -left / angle
    c, s = np.cos(yaw), np.sin(yaw)
    axis = (c * x + s * z, -s * x + c * z)
    q = np.array([axis[0] * np.sin(half), 0.0, axis[1] * np.sin(half), np.cos(half)])
    t = np.array([0.0, np.sin(half_y), 0.0, np.cos(half_y)])
    out = (
        q[3] * t[0] + q[0] * t[3] + q[1] * t[2] - q[2] * t[1],
        q[3] * t[1] - q[0] * t[2] + q[1] * t[3] + q[2] * t[0],
        q[3] * t[2] + q[0] * t[1] - q[1] * t[0] + q[2] * t[3],
        q[3] * t[3] - q[0] * t[0] - q[1] * t[1] - q[2] * t[2],
    )
    return (float(out[0]), float(out[1]), float(out[2]), float(out[3]))


def ghost(goal: Goal) -> Ghost:
    """Let the controller take the goal's pose, and look at it."""
    stage = MemoryStage()
    node = stage.add(Controller)
    stage.advance(0.3)

    def hold(seconds: float, **values: object) -> None:
        for _ in range(round(seconds * 20)):
            stage.publish("target", Target(**values))  # type: ignore[arg-type]
            stage.advance(0.05)
        stage.clear()

    for name, place in goal.feet.items():
        # Lift, carry, set down: as a hand would do it.
        start = np.array(node.core.state.points[3 if name == "left_foot" else 4])
        for share in np.linspace(0.0, 1.0, 30):
            point = start + (np.array(place) - start) * share
            point[1] += 0.10 * np.sin(np.pi * share)
            hold(0.05, **{name: tuple(map(float, point))}, pelvis=goal.held.get("pelvis"))
        hold(0.5, pelvis=goal.held.get("pelvis"))
    values: dict[str, object] = dict(goal.held)
    if goal.yaw is not None:
        hold(3.0, yaw=goal.yaw)
        values["yaw"] = goal.yaw
    if goal.lean != (0.0, 0.0):
        values["trunk"] = trunk_turn(*goal.lean, goal.yaw or 0.0)
    hold(3.0, **values)
    core = node.core
    return Ghost(goal, core.positions_ws.copy(), core.positions_ws[0].copy(), core.rotations_ls.copy())
