"""Every threshold of the touch interpretation, with its unit and where it stems from."""

from dataclasses import dataclass

from bunraku.figure.rig import DEEPEST_CROUCH


@dataclass(frozen=True)
class TouchRules:
    """Constants of picking, dragging, turning and stepping."""

    finger: float = 0.022
    """Radius of a finger, share of the picture's height, for picking beside a box."""
    graze: float = 0.3
    """|normal · ray| below which a drag plane is chosen anew."""
    far: float = 3.0
    """m from the figure beyond which a drag is not followed."""
    offset_lag: float = 0.03
    """s, time constant with which the grabbed point's place on its part follows the part's turning."""
    forward_cos: float = 0.7071067811865476
    """cos 45°: the largest angle between the figure's heading and the touch ray for the speed offset (eq. 9)."""
    speed_threshold: float = 1.0
    """v_th of eq. 10, m/s on the drag plane."""
    speed_gain: float = 0.2
    """v_s of eq. 10, read as a gain in s: m of offset for each m/s above the threshold."""
    speed_lag: float = 0.03
    """s, low-pass of the drag speed."""
    speed_attack: float = 0.02
    """s, time constant with which the speed offset grows."""
    speed_rise: float = 6.0
    """m/s at most with which it grows: a fist's speed, so that the figure can keep up."""
    speed_release: float = 0.25
    """s, time constant with which it goes back."""
    speed_ease: float = 0.10
    """s, time constant with which it takes up its way back."""
    overreach: float = 1.08
    """Times a limb's length that the speed offset may carry its end from its root."""
    clear_lag: float = 0.05
    """s, time constant of the offset of eq. 11."""
    clear: float = 0.03
    """m that a dragged hand or foot keeps from the body (eq. 11)."""
    hand_radius: float = 0.06
    """m, the ball that stands for a hand or foot in eq. 11."""
    clear_margin: float = 0.10
    """m beside a body part over which the offset of eq. 11 fades in."""
    clear_legs: float = 0.04
    """m beside the other leg over which it fades in for a foot: feet stand near each other."""
    clear_ramp: float = 0.15
    """m of drag over which it fades in after the grab, so that grabbing moves nothing."""
    widest_turn: float = 1.75
    """rad that a trunk or head may be asked to turn from where it was grabbed."""
    straight: float = 0.2
    """A drag of trunk or head whose lesser part, level or upright, is below this share of the other is straight."""
    slanting: float = 0.5
    """The share from which on both parts count whole."""
    aim_gain: float = 14.0
    """1/s: how fast a grabbed point's remaining distance from the finger is worked off."""
    aim_limit: float = 0.30
    """m of that correction at most."""
    step_margin: float = 0.12
    """m outside the support polygon at which a pelvis drag becomes a step."""
    step_rise: float = 0.10
    """m above or below the pelvis's range of heights at which it becomes a step."""
    step_level: float = 0.03
    """m that a drag may be above a standing pelvis, or below a ducking one, without being a step away or near."""
    step_least: float = 0.5
    """m, shortest step (5.3)."""
    step_most: float = 0.8
    """m, longest step (5.3)."""
    step_again: float = 0.32
    """m of way that a further step must have, so that the shortest step does not bring one back."""
    step_wait: float = 0.35
    """s after a step's command before its end is looked for."""
    step_done: float = 0.12
    """m from the goal at which a step counts as done, both feet standing."""
    step_patience: float = 2.5
    """s after which a step that never ended is given up."""
    support_inset: float = 0.01
    """m inside the support polygon's edge that a dragged pelvis stays."""
    duck: float = DEEPEST_CROUCH
    """Shortest hip to ankle of a ducking pelvis, share of the leg (5.3, minimum duck height)."""
    upright: float = 0.06
    """m below straight legs up to which a dragged pelvis is drawn to them."""
    landing: float = 0.08
    """m above the ground up to which a free foot counts as about to stand."""
    stretch: float = 0.998
    """Share of a leg's length that a dragged pelvis may stretch it to."""
    settle: float = 0.12
    """s, time constant with which a pelvis drag resumes after a step."""
    twist_reach: float = 0.25
    """Picture heights around a finger on the pelvis within which a second one twists."""
    twist_least: float = 0.015
    """Picture heights: nearer fingers give no angle."""
    heading_lag: float = 0.12
    """s, low-pass of the heading that carries the drag planes (a walking pelvis sways)."""


RULES = TouchRules()
