"""Motion: the blended motions by themselves, driven from the command line."""

from typing import Literal

from bunraku.runtime.launch import NodeSpec, node


def launch(
    motions: str = "",
    figure: str = "default",
    ground: str = "",
    speed: float = 0.0,
    turn: float = 0.0,
    tilt: float = 0.0,
    bend: float = 0.0,
    duck: float = 0.0,
    transition: Literal["inertialise", "example"] = "inertialise",
    page: bool = False,
    lan: bool = False,
    window: Literal["auto", "on", "off"] = "auto",
    record: str = "",
    film: str = "",
) -> list[NodeSpec]:
    """Walk, run, step, turn and jump: no device, no controller.

    speed:= (m/s), turn:= (rad/s), tilt:=, bend:= (rad) and duck:= (0..1) drive the figure and can be changed while it
    runs (bunraku param set blender drive_speed 2.5); anything else is commanded: bunraku topic pub command.
    transition:= is how it passes from motion to motion; motions:= is another motion set, figure:= another body for the
    built-in one (a .bvh, .amc or motion set file), ground:= uneven ground; page:=true serves the page; record:= and
    film:= name the bag and the mp4 to write.
    """
    blender: dict[str, object] = {
        "skeleton": True,
        "motions": motions,
        "figure": figure,
        "ground": ground,
        "drive_speed": speed,
        "drive_turn": turn,
        "drive_tilt": tilt,
        "drive_bend": bend,
        "drive_duck": duck,
        "transition": transition,
    }
    specs = [node("blender", params=blender, remap={"motion": "pose"}, respawn=True)]
    if page:
        specs.append(node("web", params={"lan": lan}, respawn=True))
    if film or window != "off":
        specs.append(node("renderer", params={"output": film, "window": window, "fps": 60}, stop=60.0))
    if record or page:  # the page asks it for takes
        specs.insert(0, node("recorder", params={"output": record}, respawn=True, stop=20.0))
    return specs
