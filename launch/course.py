"""Course: walk a figure to the goal with a pen or a gamepad, along tiles and past moving obstacles."""

from dataclasses import replace
from math import pi
from typing import Literal

from bunraku.launch.pen import launch as pen
from bunraku.runtime.launch import LaunchError, NodeSpec, node

VIEW = {"azimuth": pi - 1e-6, "elevation": 0.72, "distance": 9.0}
"""From behind and above: pen up is ahead, where the course leads."""


def launch(
    stage: int = 1,
    obstacles: bool = True,
    source: Literal["web", "script", "evdev"] = "web",
    device: Literal["pen", "pad"] = "pen",
    script: str = "",
    scale: float = 16.0,
    early: bool = False,
    lan: bool = False,
    window: Literal["auto", "on", "off"] = "auto",
    record: str = "",
    film: str = "",
    sheet: str = "",
) -> list[NodeSpec]:
    """Play the course game: to the blue tile, on the tiles, past what moves.

    stage:= is 1 the straight, 2 corners, 3 the winding way, 4 islands; obstacles:=false leaves them away; the rest is
    as in launch pen. The time, how often the figure left the course and how often it was hit stand in the picture.
    """
    if not 1 <= stage <= 4:
        raise LaunchError(f"course: stage: {stage} is none of 1, 2, 3, 4")
    specs = pen(
        source=source, device=device, script=script, scale=scale, early=early, lan=lan, window=window, record=record,
        film=film, sheet=sheet,
    )  # fmt: skip
    specs = [replace(one, params={**one.params, **VIEW}) if one.kind == "interpreter" else one for one in specs]
    game = node("course", params={"stage_number": stage, "obstacles": obstacles}, respawn=True)
    at = next(k for k, one in enumerate(specs) if one.kind == "blender")
    return [*specs[: at + 1], game, *specs[at + 1 :]]
