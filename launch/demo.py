"""The demonstration: a written performance through the real processes, recorded."""

from bunraku.runtime.launch import NodeSpec, node


def launch(script: str = "examples/wave.touch", record: str = "demo/bunraku.mcap") -> list[NodeSpec]:
    """Play a written performance into a bag; ends when it is over."""
    return [
        node("recorder", params={"output": record, "overwrite": True}, stop=20.0),
        node("input_touch", params={"drivers": ["script"], "script": script}, required=True),
        node("interpreter"),
        node("controller"),
    ]
