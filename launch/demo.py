"""The demonstration: written performances of fingers and a pen through the real processes, recorded."""

from pathlib import Path

from bunraku.launch import mixed, touch
from bunraku.runtime.launch import NodeSpec, node

OWN = Path(__file__).parent


def launch(script: str = "", record: str = "demo/bunraku.mcap") -> list[NodeSpec]:
    """Play the demonstration into a bag; ends when it is over.

    script:= is another performance of fingers alone (.touch).
    """
    recorder = node("recorder", params={"output": record, "overwrite": True}, stop=20.0)
    if script:
        return [recorder, *touch.launch(source="script", script=script, window="off")]
    fingers, pen = (str(OWN / f"demo.{way}") for way in ("touch", "pen"))
    return [recorder, *mixed.launch(source="script", touch=fingers, pen=pen, window="off")]
