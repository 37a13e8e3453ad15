"""Pen: the figure walks, runs, steps, jumps, ducks and leans under a pen."""

from typing import Literal

from bunraku.runtime.launch import LaunchError, NodeSpec, node

MOTION_AS_POSE = {"motion": "pose"}
"""Where no controller runs, the blender's motion is the pose."""


def launch(
    source: Literal["web", "hid", "evdev", "script"] = "web",
    device: Literal["pen", "pad"] = "pen",
    script: str = "",
    path: str = "",
    early: bool = False,
    natural: bool = False,
    scale: float = 16.0,
    obstacles: str = "",
    ground: str = "",
    motions: str = "",
    figure: str = "default",
    page: bool = False,
    lan: bool = False,
    tls: bool = False,
    window: Literal["auto", "on", "off"] = "auto",
    record: str = "",
    film: str = "",
    sheet: str = "",
) -> list[NodeSpec]:
    """Play the figure with a pen, or a gamepad beside it: on the page, a tablet, or by a written performance.

    source:=web prints the page's link; hid and evdev (Linux) read a tablet, path:= says which (/dev/hidraw3,
    /dev/input/event5; else the first that is found); device:=pad takes a gamepad in the pen's place (web, evdev,
    script); script:= is a performance (.pen, .pad); scale:= is how many metres of the ground a metre of a tablet is;
    early:=true begins to walk before a stroke is a step long; natural:=true walks as people do instead of exactly as
    the hand drew; obstacles:= is a file of what is walked round (.toml); ground:= is a file of uneven ground,
    motions:= another motion set, figure:= another body (a .bvh, .amc or motion set file); page:=true serves the page
    beside another source, lan:=true to the network's tablets by a link with a token, tls:=true over https; record:=,
    film:= and sheet:= name the bag, the mp4 and the sheet of pictures to write.
    """
    if source == "hid" and device == "pad":
        raise LaunchError("pen: source: hid reads pens; play a gamepad by web, evdev or script")
    web = page or source == "web"
    pen: dict[str, object] = {"drivers": [source, "web"] if web and source != "web" else [source]}
    if script:
        pen["script"] = script
    if path:
        pen[source if source in ("hid", "evdev") else "evdev"] = path
    blender: dict[str, object] = {"skeleton": True, "ground": ground, "motions": motions, "figure": figure}
    # From above, so that the ground is wide; pen up is away from the viewer.
    view = {
        "azimuth": 0.0,
        "elevation": 0.42,
        "distance": 6.5,
        "pen_early": early,
        "pen_natural": natural,
        "pen_scale": scale,
        "obstacles": obstacles,
    }
    specs = [
        node(f"input_{device}", params=pen, respawn=source != "script", required=source == "script"),
        node("interpreter", params=view, respawn=True),
        node("blender", params=blender, remap=MOTION_AS_POSE, respawn=True),
    ]
    if web:
        specs.append(node("web", params={"lan": lan, "tls": tls}, respawn=True))
    if film or sheet or window != "off":
        shots = {"output": film, "sheet": sheet, "window": window, "fps": 60}
        specs.append(node("renderer", params=shots, stop=60.0))
    if record or web:  # the page asks it for takes
        specs.insert(0, node("recorder", params={"output": record}, respawn=True, stop=20.0))
    return specs
