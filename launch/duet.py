"""Duet: two figures under two pens, on one stage."""

from typing import Literal

from bunraku.launch.pen import MOTION_AS_POSE
from bunraku.runtime.launch import LaunchError, NodeSpec, group, node

NAMES = ("alice", "bob")


def launch(
    source: Literal["web", "hid", "evdev", "script"] = "web",
    alice: str = "",
    bob: str = "",
    apart: float = 2.0,
    natural: bool = False,
    scale: float = 16.0,
    lan: bool = False,
    window: Literal["auto", "on", "off"] = "auto",
    record: str = "",
    film: str = "",
) -> list[NodeSpec]:
    """Two figures, alice and bob, each walked by a pen of its own.

    source:=web prints the page's link: a page plays the figure that is chosen on it; alice:= and bob:= are two
    tablets (source:=hid, evdev: a path each) or two performances (source:=script); apart:= is how far (m) they stand
    from each other at first; record:= and film:= name the bag and the mp4 to write.
    """
    given = {"alice": alice, "bob": bob}
    if source != "web" and not (alice and bob):
        what = "performance (.pen)" if source == "script" else "tablet's path"
        raise LaunchError(f"duet: source: {source} needs a {what} for each: alice:=... bob:=...")
    view = {
        "azimuth": 0.0,
        "elevation": 0.42,
        "distance": 7.5,
        "pen_scale": scale,
        "pen_natural": natural,
        "pen_plays": ["tablet"] if source != "web" else ["web-*=picture", "tablet"],
    }
    specs: list[NodeSpec] = []
    for name, side in zip(NAMES, (-0.5, 0.5), strict=True):
        pen: dict[str, object] = {"drivers": [source]}
        if given[name]:
            pen[source if source != "web" else "script"] = given[name]
        parts = [
            node("input_pen", params=pen, respawn=source != "script", required=source == "script" and name == "bob"),
            node("interpreter", params=dict(view), respawn=True),
            node("blender", params={"skeleton": True, "x": side * apart}, remap=MOTION_AS_POSE, respawn=True),
        ]
        specs += group(name, parts)
    if source == "web":
        specs.append(node("web", params={"lan": lan, "figures": list(NAMES)}, respawn=True))
    if film or window != "off":
        shots = {"output": film, "window": window, "fps": 60, "figures": list(NAMES)}
        specs.append(node("renderer", params=shots, stop=60.0))
    if record or source == "web":  # the page asks it for takes
        specs.insert(0, node("recorder", params={"output": record}, respawn=True, stop=20.0))
    return specs
