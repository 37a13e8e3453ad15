"""Mixed: fingers and a pen on one figure; touches, balance and collision avoidance are laid over the walk."""

from typing import Literal

from bunraku.runtime.launch import LaunchError, NodeSpec, node


def launch(
    source: Literal["web", "script"] = "web",
    touch: str = "",
    pen: str = "",
    motions: str = "",
    figure: str = "default",
    lan: bool = False,
    tls: bool = False,
    window: Literal["auto", "on", "off"] = "auto",
    record: str = "",
    film: str = "",
) -> list[NodeSpec]:
    """Walk the figure with a pen while a finger waves its arm.

    source:=web prints the page's link, lan:=true one with a token for the network's tablets, tls:=true over https;
    source:=script plays touch:= (.touch) and pen:= (.pen) at once and ends with the touches; motions:= is another
    motion set, figure:= another body (a .bvh, .amc or motion set file); record:= and film:= name the bag and the mp4
    to write.
    """
    live = source == "web"
    if not live and not (touch and pen):
        raise LaunchError("mixed: source: script plays two performances at once: touch:=FILE pen:=FILE")
    specs = [
        node("input_touch", params={"drivers": [source], "script": touch}, respawn=live, required=not live),
        node("input_pen", params={"drivers": [source], "script": pen}, respawn=live),
        node("interpreter", respawn=True),
        node("blender", params={"motions": motions, "figure": figure}, respawn=True),
        node("controller", params={"figure": figure}, respawn=True),
    ]
    if live:
        specs.append(node("web", params={"lan": lan, "tls": tls}, respawn=True))
    if film or window != "off":
        specs.append(node("renderer", params={"output": film, "window": window, "fps": 60}, stop=60.0))
    if record or live:  # the page asks it for takes
        specs.insert(0, node("recorder", params={"output": record}, respawn=live, stop=20.0))
    return specs
