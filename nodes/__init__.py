"""The nodes: one folder each, whose node.py wires topics to a core that runs without any process."""

NODES: dict[str, str] = {
    "blender": "bunraku.nodes.blender.node:Blender",
    "bridge": "bunraku.nodes.bridge.node:Bridge",
    "controller": "bunraku.nodes.controller.node:Controller",
    "course": "bunraku.nodes.course.node:CourseGame",
    "input_hand": "bunraku.nodes.input_hand.node:InputHand",
    "input_pad": "bunraku.nodes.input_pad.node:InputPad",
    "input_pen": "bunraku.nodes.input_pen.node:InputPen",
    "input_touch": "bunraku.nodes.input_touch.node:InputTouch",
    "interpreter": "bunraku.nodes.interpreter.node:Interpreter",
    "recorder": "bunraku.nodes.recorder.node:Recorder",
    "renderer": "bunraku.nodes.renderer.node:Renderer",
    "web": "bunraku.nodes.web.node:Web",
}
"""Name -> 'module:Class'; a class is imported only when its node is asked for."""
