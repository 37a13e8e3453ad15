"""The nodes: one folder each, whose node.py wires topics to a core that runs without any process."""

NODES: dict[str, str] = {
    "bridge": "bunraku.nodes.bridge.node:Bridge",
    "controller": "bunraku.nodes.controller.node:Controller",
    "input_touch": "bunraku.nodes.input_touch.node:InputTouch",
    "recorder": "bunraku.nodes.recorder.node:Recorder",
}
"""Name -> 'module:Class'; a class is imported only when its node is asked for."""
