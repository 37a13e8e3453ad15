"""Where elbows and knees stand out by default: radial basis functions over authored examples.

Oshita 2013 eqs 5-6 with the Gaussians normalised and without the cut-off at the radius, which as printed
makes the swivel jump. An example is the end's place, in limb lengths from the limb's root in the frame of
the limb's parent, and the direction in which the joint stands out there; angles are worked out from these,
so the same examples serve every skeleton.
"""

from math import exp

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.jit import kernel
from bunraku.figure.limb import swivel_of

Array = NDArray[np.float64]
Vec = tuple[float, float, float]

# The left side; x is outward. (end, direction of elbow or knee, radius)
ARM_EXAMPLES: tuple[tuple[Vec, Vec, float], ...] = (
    ((0.10, -0.95, 0.08), (0.45, 0.00, -0.90), 0.50),  # hanging
    ((0.00, 0.00, 0.95), (0.55, -0.85, 0.00), 0.50),  # straight ahead
    ((0.95, 0.00, 0.00), (0.00, -0.65, -0.75), 0.50),  # to the side
    ((0.10, 0.95, 0.05), (0.95, 0.00, 0.15), 0.50),  # overhead
    ((-0.10, -0.15, 0.45), (0.75, -0.65, -0.20), 0.40),  # guard before the chest
    ((-0.05, -0.60, 0.35), (0.75, 0.00, -0.65), 0.45),  # before the hip
    ((-0.60, -0.10, 0.60), (0.65, -0.70, 0.25), 0.45),  # across the chest
    ((-0.20, 0.45, 0.30), (0.90, -0.30, 0.25), 0.45),  # at the head
    ((-0.05, -0.70, -0.35), (0.80, 0.05, -0.60), 0.45),  # behind the back
    ((0.65, 0.65, 0.10), (0.35, -0.60, -0.60), 0.50),  # up and to the side
    ((0.60, -0.60, 0.35), (0.15, -0.35, -0.90), 0.50),  # down and to the side
    ((0.10, 0.65, 0.65), (0.80, -0.55, 0.30), 0.50),  # up and ahead
)
LEG_EXAMPLES: tuple[tuple[Vec, Vec, float], ...] = (
    ((0.00, -0.99, 0.00), (0.08, 0.00, 1.00), 0.50),  # standing
    ((0.00, -0.60, 0.35), (0.12, 0.55, 0.85), 0.45),  # knee raised
    ((0.00, 0.00, 0.95), (0.15, 1.00, 0.00), 0.50),  # kick ahead
    ((0.80, -0.40, 0.05), (0.20, 0.45, 0.90), 0.50),  # kick to the side
    ((0.00, -0.75, -0.50), (0.12, -0.50, 0.85), 0.50),  # leg behind
    ((0.05, -0.50, 0.00), (0.35, 0.00, 1.00), 0.40),  # squat
    ((-0.40, -0.85, 0.10), (0.00, 0.00, 1.00), 0.45),  # crossed
    ((0.50, -0.80, 0.00), (0.30, 0.00, 0.95), 0.45),  # astride
    ((0.45, -0.10, 0.75), (0.25, 0.90, 0.20), 0.50),  # high and outward
    ((0.00, -0.45, -0.40), (0.10, -0.75, 0.60), 0.40),  # heel to the seat
)
ARM_REFERENCE: tuple[Vec, Vec] = ((0.50, -0.35, 0.79), (0.50, -0.60, -0.55))
"""The direction at which the arm's swivel zero is defined (the opposite lies behind the back) and that zero."""
LEG_REFERENCE: tuple[Vec, Vec] = ((0.10, -0.85, 0.50), (0.10, 0.00, 1.00))


def reference_frame(directions: tuple[Vec, Vec], side: float) -> tuple[Array, Array]:
    """Unit reference and unit zero square to it, mirrored for the right side (``side`` -1)."""
    mirror = np.array([side, 1.0, 1.0])
    reference = np.array(directions[0]) * mirror
    reference /= np.linalg.norm(reference)
    zero = np.array(directions[1]) * mirror
    zero -= (zero @ reference) * reference
    return reference, zero / np.linalg.norm(zero)


def example_arrays(
    examples: tuple[tuple[Vec, Vec, float], ...], side: float, reference: Array, zero: Array
) -> tuple[Array, Array, Array]:
    """Places (E, 3), swivel angles (E) and radii (E) of authored examples for one side."""
    mirror = np.array([side, 1.0, 1.0])
    places = np.array([example[0] for example in examples]) * mirror
    angles = np.empty(len(examples))
    for n, (_, pole, _) in enumerate(examples):
        axis = places[n] / np.linalg.norm(places[n])
        angles[n] = swivel_of(axis, np.array(pole) * mirror, reference, zero)
    return places, angles, np.array([example[2] for example in examples])


@kernel
def blend_swivel(place: Array, places: Array, angles: Array, radii: Array) -> float:
    """The swivel (rad) at ``place`` (3, limb lengths): normalised Gaussians over the examples.

    Far from every example the nearest one wins; never undefined (the largest exponent is taken out).
    """
    largest = -1e300
    for n in range(angles.shape[0]):
        d2 = 0.0
        for k in range(3):
            d = place[k] - places[n, k]
            d2 += d * d
        largest = max(largest, -d2 / (radii[n] * radii[n]))
    total, value = 0.0, 0.0
    for n in range(angles.shape[0]):
        d2 = 0.0
        for k in range(3):
            d = place[k] - places[n, k]
            d2 += d * d
        f = exp(-d2 / (radii[n] * radii[n]) - largest)
        total += f
        value += f * angles[n]
    return value / total
