"""Every threshold of the pen's interpretation, in figure metres, seconds and radians."""

from dataclasses import dataclass


@dataclass(frozen=True)
class PenRules:
    """How strokes are told apart and what pressure and tilt mean.

    The four kinds of points (moving, stop, jump landing, reset) and what follows from each are those of
    Oshita 2005, section 5.1 and figure 10; the numbers are chosen here.
    """

    scale: float = 16.0
    """Figure metres for each metre of a tablet: a tablet 25 cm wide shows 4 m."""
    tablet_width: float = 0.25
    """m, assumed for a tablet that does not tell its size."""
    still: float = 0.03
    """m: a pen that stays within this is still."""
    tremble: float = 0.006
    """m within which a still pen has not begun to move: its stroke begins when it leaves this."""
    least_move: float = 0.0075
    """m between two points of a stroke at least."""
    oldest_sample: float = 0.5
    """s: a device's own time that lies farther back is not believed."""
    settle_time: float = 2.0
    """s without a stroke after which the next one begins where the figure stands."""
    arrived: float = 0.12
    """m of path left with which it has been walked."""
    end_way: float = 0.10
    """m before a path's end from which its last direction is taken."""
    look_on: float = 1.5
    """m of path ahead of the figure's last place in which it is looked for."""
    look_near: float = 0.25
    """m of distance that each m ahead counts as: on a path that comes back over itself the first part is taken."""
    lag_about: float = 0.5
    """m of path about the figure whose times say how far it is behind the pen."""
    average: float = 0.15
    """m about a place from whose samples its speed and posture are averaged."""
    bend_about: float = 0.15
    """m about a place over which the bend of a natural path is averaged."""
    stop_time: float = 0.22
    """s that a pen is still, or away, before its stroke has ended."""
    least_step: float = 0.10
    """m: a shorter stroke is no step."""
    longest_step: float = 0.62
    """m: a longer stroke is locomotion; one step goes so far in every direction."""
    resume: float = 1.5
    """s from a path's end to a landing elsewhere with which the path goes on, where the figure has arrived already."""
    resume_aside: float = 1.3
    """rad off the path's end within which a stroke goes on with it then, however short; else it is a new one."""
    early_ahead: float = 0.35
    """rad off the figure's front within which a stroke starts early (an option): a step there is a short walk too."""
    early_least: float = 0.12
    """m after which it does."""
    early_step: float = 0.50
    """m after which another unambiguous stroke starts early."""
    early_speed: float = 1.2
    """m/s of the pen that makes it unambiguous."""
    early_time: float = 0.12
    """s of such speed before it does."""
    early_share: float = 0.95
    """Of its greatest speed, under which a stroke slows down and is ambiguous: a step's stroke slows to its end."""
    early_lag: float = 0.02
    """s, low-pass of the speed that is compared."""
    bounce_time: float = 0.025
    """s: a shorter loss of contact is none."""
    jump_time: float = 0.70
    """s between lift and landing at most; generous, because timing was the pen's weakness in the paper's test."""
    jump_range: float = 1.60
    """m from lift to landing at most, straight ahead; farther is a reset."""
    jump_back: float = 0.80
    """m at most to the sides and back: people jump less far there, and figures no farther than is drawn."""
    jump_same: float = 0.18
    """m within which a landing is a vertical jump."""
    fling_speed: float = 6.0
    """m/s: a gap that is crossed faster than this in less than `fling_time` is fast motion, no jump."""
    fling_time: float = 0.08
    """s."""
    jump_low: float = 0.10
    """m of height at the lightest pressure before the lift."""
    jump_high: float = 0.50
    """m at the strongest."""
    press_window: float = 0.15
    """s before the lift whose strongest pressure counts."""
    slowest: float = 0.45
    """m/s: locomotion is never slower while there is path left."""
    fastest: float = 3.6
    """m/s: the running limit."""
    speed_lag: float = 0.12
    """s over which the pen's speed is averaged along its path."""
    usual_lag: float = 1.1
    """s that a figure is behind a pen that draws on: the stroke's first part, and getting going."""
    hurry: float = 0.6
    """1/s: how much faster than the pen was a figure walks for each second that it lags more than that."""
    most_hurry: float = 2.5
    """Times the pen's speed at most: a slow path stays a slow one."""
    say_again: float = 0.2
    """s between two messages of a path that does not grow, while the figure lags or something is in its way."""
    natural_width: float = 0.70
    """m over which a path is smoothed where it is walked as people do (an option)."""
    natural_most: float = 0.80
    """m that a natural path leaves the drawn one at most."""
    sideways: float = 2.5
    """m/s² that people accelerate sideways at most, on a natural path."""
    settled: float = 0.35
    """m of path before the figure that are not changed any more."""
    join: float = 0.80
    """m over which a changed path passes over from what is settled."""
    say_every: float = 0.012
    """s between two messages of a path that grows: a pen may send more often than figures step."""
    spacing: float = 0.05
    """m between the points of a path."""
    rejoin: float = 0.30
    """m of path left with which a pen that moves on lengthens the same path instead of beginning a new one."""
    behind: float = 1.0
    """m of path kept behind the figure."""
    press_light: float = 0.45
    """Pressure up to which the figure stands upright (writing pressure)."""
    press_full: float = 0.95
    """Pressure at which it ducks wholly."""
    tilt_dead: float = 0.26
    """rad off upright that mean nothing: nobody holds a pen quite upright."""
    tilt_full: float = 0.95
    """rad off upright for the full lean."""
    lean: float = 0.80
    """rad of the full lean."""
    posture_lag: float = 0.06
    """s, low-pass of pressure and tilt."""
    posture_step: float = 0.01
    """rad, or share of duck: smaller changes of posture are not said."""
    twist_dead: float = 0.20
    """rad of pen twist before the body turns with it."""
