"""Touch: fingers drag the figure's parts, and the whole body follows."""

from typing import Literal

from bunraku.runtime.launch import NodeSpec, node


def launch(
    source: Literal["web", "tuio", "evdev", "script"] = "web",
    script: str = "",
    port: int = 3333,
    figure: str = "default",
    page: bool = False,
    lan: bool = False,
    tls: bool = False,
    window: Literal["auto", "on", "off"] = "auto",
    record: str = "",
    film: str = "",
    sheet: str = "",
) -> list[NodeSpec]:
    """Touch and drag the figure: on the page, a TUIO table, a touch screen, or by a written performance.

    source:=web prints the page's link; lan:=true lets the network's tablets in by a link with a token, tls:=true over
    https; port:= is TUIO's; script:= is a performance (.touch); figure:= is another body: a .bvh, .amc or motion set
    file; page:=true serves the page beside another source; record:=, film:= and sheet:= name the bag, the mp4 and the
    sheet of pictures to write.
    """
    drivers = [source, "web"] if page and source != "web" else [source]
    touch: dict[str, object] = {"drivers": drivers, "port": port}
    if script:
        touch["script"] = script
    specs = [
        node("input_touch", params=touch, respawn=source != "script", required=source == "script"),
        node("interpreter", respawn=True),
        node("controller", params={"figure": figure}, respawn=True),
    ]
    if "web" in drivers:
        specs.append(node("web", params={"lan": lan, "tls": tls}, respawn=True))
    if film or sheet or window != "off":
        shots = {"output": film, "sheet": sheet, "window": window, "fps": 60}
        specs.append(node("renderer", params=shots, stop=60.0))
    if record or "web" in drivers:  # the page asks it for takes
        specs.insert(0, node("recorder", params={"output": record}, respawn=True, stop=20.0))
    return specs
