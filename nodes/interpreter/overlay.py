"""What is drawn of the touches: circles with trails, the drag plane, the goal of a step."""

from collections import deque

import numpy as np

from bunraku.msgs import Primitive
from bunraku.nodes.interpreter.core import Array

TOUCH = (0.88, 0.20, 0.18, 0.60)
CAMERA = (0.30, 0.42, 0.60, 0.45)
PLANE = (0.25, 0.45, 0.75, 0.16)
GOAL = (0.20, 0.55, 0.35, 0.70)
RADIUS = 0.022  # of the picture's height
TRAIL = 0.40  # s
PLANE_SIZE = 0.14  # m, half


class Trail:
    """Where a finger has been lately."""

    def __init__(self) -> None:
        self.points: deque[tuple[float, float, float]] = deque(maxlen=256)

    def add(self, now: float, x: float, y: float) -> None:
        """The finger is at (x, y) shares of the picture."""
        if not self.points or (x, y) != self.points[-1][1:]:
            self.points.append((now, x, y))

    def lately(self, now: float) -> list[tuple[float, float]]:
        """The points of the last `TRAIL` s."""
        while self.points and self.points[0][0] < now - TRAIL:
            self.points.popleft()
        return [(x, y) for _, x, y in self.points]


def finger(x: float, y: float, trail: list[tuple[float, float]], *, camera: bool, label: str) -> list[Primitive]:
    """A finger's circle and its trail."""
    color = CAMERA if camera else TOUCH
    drawn = []
    if len(trail) > 1:
        faint = (*color[:3], 0.5 * color[3])
        drawn.append(Primitive(kind="line", space="screen", points=[*trail, (x, y)], color=faint, size=0.006))
    drawn.append(Primitive(kind="circle", space="screen", points=[(x, y)], color=color, size=RADIUS, label=label))
    return drawn


def plane(point: Array, normal: Array) -> Primitive:
    """A small square of the drag plane around a point (3), square to ``normal`` (3)."""
    up = np.array([0.0, 1.0, 0.0]) if abs(normal[1]) < 0.9 else np.array([0.0, 0.0, 1.0])
    u = np.cross(up, normal)
    u /= np.linalg.norm(u)
    v = np.cross(normal, u)
    points: list[tuple[float, ...]] = []
    for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
        corner = point + PLANE_SIZE * (a * u + b * v)
        points.append((float(corner[0]), float(corner[1]), float(corner[2])))
    return Primitive(kind="polygon", points=points, color=PLANE, size=0.004)


def step_goal(goal: Array) -> Primitive:
    """A ring on the ground where a step goes, (x, z) m."""
    turn = np.linspace(0.0, 2.0 * np.pi, 33)
    x, z = float(goal[0]), float(goal[1])
    ring: list[tuple[float, ...]] = [(x + 0.16 * float(np.cos(a)), 0.004, z + 0.16 * float(np.sin(a))) for a in turn]
    return Primitive(kind="line", points=ring, color=GOAL, size=0.012)
