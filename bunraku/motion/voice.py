"""A module's examples ready to be played: weights of its parameters, and the table that is blended."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bunraku.motion.blend import BlendTable, blend_table
from bunraku.motion.motionset import Example, MotionSet
from bunraku.motion.weights import Weights

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Voice:
    """A module (or one canonical clip) ready to be played."""

    name: str
    parameters: tuple[str, ...]
    weights: Weights
    table: BlendTable


def voice_of(name: str, parameters: tuple[str, ...], examples: tuple[Example, ...]) -> Voice:
    """Examples as a voice; their values must have one column a parameter."""
    values = np.stack([example.values for example in examples])
    return Voice(name, parameters, Weights(parameters, values), blend_table(examples))


def voices(motion_set: MotionSet) -> dict[str, Voice]:
    """All modules by their names; canonical clips as ``canonical/<name>``."""
    out = {name: voice_of(name, m.parameters, m.examples) for name, m in motion_set.modules.items()}
    for name, example in motion_set.canonical.items():
        parameters = ("speed", "turn", "tilt", "bend", "duck") if example.cycle else ("distance", "height")
        out[f"canonical/{name}"] = voice_of(name, parameters[: len(example.values)], (example,))
    return out


def reach_of(found: dict[str, Voice]) -> dict[str, tuple[float, float]]:
    """Smallest and largest measured value of each module's distance or height, m, or angle, rad."""
    out = {}
    for name, voice in found.items():
        table = voice.weights.table
        points = table.points / np.where(table.scale > 0, table.scale, 1.0) + table.center
        if voice.parameters == ("angle", "distance"):
            d = np.hypot(points[:, 0], points[:, 1])
            out[name] = (float(d.min()), float(d.max()))
        elif len(voice.parameters) == 1:
            out[name] = (float(points.min()), float(points.max()))
    return out


def posed(weights: Weights, at: Array, posture: Array) -> Array:
    """Parameters whose tilt, bend and duck are what is usual there and the wanted posture (3) on top."""
    goal = weights.neutral(at)
    for k, name in enumerate(weights.parameters):
        if name == "tilt":
            goal[k] += posture[0]
        elif name == "bend":
            goal[k] += posture[1]
        elif name == "duck":
            goal[k] += posture[2] * max(1.0 - goal[k], 0.0)
    return goal
