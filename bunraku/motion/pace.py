"""How fast a figure is led, and how soon it follows."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Pace:
    """How the player leads a figure; lengths and speeds for a leg of 0.83 m."""

    usual: float = 1.3  # m/s, where a path asks for none
    most: float = 4.0  # m/s
    brake: float = 1.7  # m/s², toward a path's end
    start: float = 1.7  # m/s², from a stand; more when it runs
    slow: float = 5.0  # m/s² at most, where less speed is asked for; people stop from a run by 4 to 6
    hurry: float = 0.14  # s, half-life of a change of speed
    bearing: float = 0.20  # s, half-life of finding back to a path
    posture: float = 0.12  # s, half-life of a change of posture
    turning: float = 3.0  # rad/s at most along a path
    slow_in: float = 2.4  # m/s², toward its bends
    aside: float = 0.9  # rad: a standing figure that has to start farther off its heading than this turns first
    switch: float = 0.11  # s, half-life of a transition
    fade: float = 0.25  # s, of a transition by the (n+1)-th example


PACE = Pace()
