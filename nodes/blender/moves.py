"""Steps, turns and jumps toward what commands ask for, from the modules of the motion set."""

from collections.abc import Callable
from math import atan2, cos, hypot, pi, sin

import numpy as np

from bunraku.motion.constraint import Ground, wrapped
from bunraku.motion.player import Player
from bunraku.msgs import Jump, Step, WalkGesture

NEAR = 0.03
"""m: a goal that the figure has reached."""
FACED = 0.03
"""rad: a heading that it has."""


class Moves:
    """Begins moves of a player.

    Args:
        say: told one line about what the motion set cannot do.
    """

    def __init__(self, player: Player, say: Callable[[str], None]) -> None:
        self.player, self.say = player, say
        self.reach = player.reach
        self.odd = False
        """Whether the left foot goes first straight ahead or back, because it went second before."""

    def turn(self, heading: float) -> bool:
        """Turn toward a heading; True where more than one turn is needed."""
        here = self.player.place
        angle = wrapped(heading - here.heading)
        name = "turn_left" if angle > 0 else "turn_right"
        if abs(angle) < FACED or name not in self.player.voices:
            return False
        most = max(abs(v) for v in self.reach[name])
        # Large turns are made in equal parts.
        parts = max(1, int(np.ceil((abs(angle) - 0.02) / (1.08 * most))))
        part = angle / parts
        self.player.move(name, [part], Ground(here.x, here.z, here.heading + part))
        return parts > 1

    def left_of(self, command: Step) -> float:
        """How far (m) a step's goal is."""
        here = self.player.place
        return hypot(command.goal[0] - here.x, command.goal[2] - here.z)

    def step(self, command: Step) -> bool:
        """Step toward a goal; True where more than one step is needed."""
        here = self.player.place
        left, ahead = here.seen(command.goal[0], command.goal[2])
        distance, angle = hypot(left, ahead), atan2(left, ahead)
        if distance < NEAR:
            return False
        # Straight ahead or back the foot goes first that went second before.
        side = "left" if (left > 0.12 * distance or (abs(left) <= 0.12 * distance and self.odd)) else "right"
        name = f"step_{side}"
        if name not in self.player.voices:
            self.say(f"the motion set has no module {name}: step {command.id} is not made")
            return False
        self.odd = side == "right"
        most = self._farthest(name, angle)
        parts = max(1, int(np.ceil((distance - 0.02) / most)))
        part = distance / parts
        end = here.after(part * sin(angle), part * cos(angle), 0.0)
        self.player.move(name, [angle, part], end)
        return parts > 1

    def _farthest(self, name: str, angle: float) -> float:
        """The longest way that a module covers in a direction, m."""
        weights = self.player.voices[name].weights
        low, high = 0.0, 1.2 * self.reach[name][1]
        if weights.within([angle, high]):
            return high
        for _ in range(12):
            middle = 0.5 * (low + high)
            if weights.within([angle, middle]):
                low = middle
            else:
                high = middle
        return max(low, 0.15)

    def jump(self, command: Jump) -> None:
        """Jump to a goal, or straight up where there is none."""
        player, here = self.player, self.player.place
        heading = here.heading if command.heading is None else command.heading
        if command.goal is None or hypot(command.goal[0] - here.x, command.goal[2] - here.z) < NEAR:
            self._jump_up(0.35 * player.scale if command.height is None else command.height, heading)
            return
        left, ahead = here.seen(command.goal[0], command.goal[2])
        distance, angle = hypot(left, ahead), atan2(left, ahead)
        quarter = ("jump_forward", "jump_left", "jump_back", "jump_right")[round(angle / (0.5 * pi)) % 4]
        if quarter not in player.voices:
            quarter = "jump_forward" if "jump_forward" in player.voices else ""
        if not quarter:
            self.say(f"the motion set has no directional jump: jump {command.id} is not made")
            return
        far = self._farthest(quarter, angle)
        if distance > 1.5 * far:
            self.say(f"jump {command.id} asks for {distance:.2f} m, {1.5 * far:.2f} m is the most: it falls short")
            distance = 1.5 * far
        end = here.after(distance * sin(angle), distance * cos(angle), wrapped(heading - here.heading))
        player.move(quarter, [angle, min(distance, far)], end)

    def _jump_up(self, height: float, heading: float) -> None:
        player, here = self.player, self.player.place
        if "jump_up" in player.voices:
            player.move("jump_up", [height], Ground(here.x, here.z, heading))

    def gesture(self, command: WalkGesture) -> None:
        """Play a canonical jump."""
        name = f"canonical/{command.gait}"
        here = self.player.place
        voice = self.player.voices.get(name)
        if voice is None:
            self.say(f"the motion set has no canonical clip {command.gait!r}: gesture {command.id} is not made")
            return
        end = here
        if command.gait != "jump_up" and len(command.path) > 1:
            x, z = command.path[-1]
            end = Ground(x, z, atan2(x - here.x, z - here.z) if hypot(x - here.x, z - here.z) > 0.1 else here.heading)
            if abs(wrapped(end.heading - here.heading)) > 0.6:
                end = Ground(x, z, here.heading)
        elif command.gait != "jump_up":
            end = here.after(0.0, float(voice.weights.table.center[0]), 0.0)
        self.player.move(name, voice.weights.table.center, end)
