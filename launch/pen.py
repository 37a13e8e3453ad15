"""Pen: the figure walks, runs, steps, jumps, ducks and leans under a pen."""

from typing import Literal

from bunraku.runtime.launch import LaunchError, NodeSpec, node

MOTION_AS_POSE = {"motion": "pose"}
"""Where no controller runs, the blender's motion is the pose."""


def launch(
    source: Literal["web", "script", "evdev"] = "web",
    device: Literal["pen", "pad"] = "pen",
    script: str = "",
    controller: bool = False,
    early: bool = False,
    scale: float = 16.0,
    ground: str = "",
    lan: bool = False,
    window: Literal["auto", "on", "off"] = "auto",
    record: str = "",
    film: str = "",
    sheet: str = "",
) -> list[NodeSpec]:
    """Play the figure with a pen, or a gamepad beside it: on the page, or by a written performance.

    source:=web prints the page's link; device:=pad takes a gamepad in the pen's place (source:=evdev: on Linux);
    script:= is a performance (.pen, .pad); scale:= is how many metres of the ground a
    metre of a tablet is; early:=true begins to walk before a stroke is a step long; controller:=true lays touches,
    balance and collision avoidance over the walk; ground:= is a file of uneven ground; record:=, film:= and sheet:=
    name the bag, the mp4 and the sheet of pictures to write.
    """
    if source == "evdev" and device == "pen":
        raise LaunchError("pen: source: evdev reads gamepads (device:=pad); play pens by the page or a script")
    pen: dict[str, object] = {"drivers": [source]}
    if script:
        pen["script"] = script
    blender: dict[str, object] = {"skeleton": not controller, "ground": ground}
    # From above, so that the ground is wide; pen up is away from the viewer.
    view = {"azimuth": 0.0, "elevation": 0.42, "distance": 6.5, "pen_early": early, "pen_scale": scale}
    specs = [
        node(f"input_{device}", params=pen, respawn=source != "script", required=source == "script"),
        node("interpreter", params=view, respawn=True),
        node("blender", params=blender, remap={} if controller else MOTION_AS_POSE, respawn=True),
    ]
    if controller:
        specs.append(node("controller", respawn=True))
    if source == "web":
        if controller:
            specs.insert(1, node("input_touch", params={"drivers": ["web"]}, respawn=True))
        specs.append(node("web", params={"lan": lan}, respawn=True))
    if film or sheet or window != "off":
        shots = {"output": film, "sheet": sheet, "window": window, "fps": 60}
        specs.append(node("renderer", params=shots, stop=60.0))
    if record:
        specs.insert(0, node("recorder", params={"output": record, "overwrite": True}, respawn=True, stop=20.0))
    return specs
