import os
import shutil
import signal
import struct
import subprocess
import sys
import time

import av
import numpy as np
import pytest

from bunraku.nodes.renderer import window

XVFB = shutil.which("Xvfb")


@pytest.fixture
def screen(tmp_path):
    """A virtual X display of 1000x700 and a function that reads its pixels (h, w, 3)."""
    if XVFB is None:
        pytest.skip("needs Xvfb: apt-get install xvfb")
    read, write = os.pipe()
    server = subprocess.Popen(
        [XVFB, "-displayfd", str(write), "-screen", "0", "1000x700x24", "-fbdir", str(tmp_path), "-nolisten", "tcp"],
        pass_fds=[write], stderr=subprocess.DEVNULL,
    )  # fmt: skip
    os.close(write)
    with os.fdopen(read) as answer:
        number = answer.readline().strip()
    assert number, "Xvfb did not start"

    def pixels():
        dump = (tmp_path / "Xvfb_screen0").read_bytes()
        header = struct.unpack(">25I", dump[:100])
        size, width, height, stride, colors = header[0], header[4], header[5], header[12], header[19]
        rows = np.frombuffer(dump, np.uint8, stride * height, size + 12 * colors).reshape(height, stride)
        return rows[:, : width * 4].reshape(height, width, 4)[..., 2::-1]

    yield f":{number}", pixels
    server.terminate()
    server.wait()


PERFORMER = """
from bunraku.figure.default import default_figure
from bunraku.figure.wire import to_message
from bunraku.msgs import Pose, SkeletonMessage
from bunraku.runtime.loop import run_node
from bunraku.runtime.node import Node, Publisher, timer

class Performer(Node):
    name = "performer"
    pose = Publisher("pose", Pose)
    skeleton = Publisher("skeleton", SkeletonMessage)
    def setup(self):
        self.skeleton.publish(to_message(default_figure()))
    @timer(hz=60)
    def tick(self):
        figure = default_figure()
        self.pose.publish(Pose(skeleton=figure.hash, root=figure.offsets[0], rotations=figure.rest_pose()[1]))

run_node(Performer)
"""


@pytest.mark.peer
@pytest.mark.parametrize("engine", ["gl", "pillow"])
def test_the_window_shows_the_figure_while_it_is_filmed(screen, tmp_path, engine):
    display, pixels = screen
    environment = {
        **os.environ, "XDG_RUNTIME_DIR": str(tmp_path), "BUNRAKU_STAGE": "window", "BUNRAKU_JIT": "0",
        "DISPLAY": display,
    }  # fmt: skip
    environment.pop("PYOPENGL_PLATFORM", None)
    path = tmp_path / "window.mp4"
    command = [sys.executable, "-m", "bunraku.cli", "run", "renderer", "--set", f"output:={path}"]
    for text in ("size:=640x360", "fps:=30", "window:=on", f"engine:={engine}"):
        command += ["--set", text]
    performer = subprocess.Popen([sys.executable, "-c", PERFORMER], env=environment, stdout=subprocess.DEVNULL)
    node = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
    try:
        deadline = time.monotonic() + 90
        while time.monotonic() < deadline:
            assert node.poll() is None, node.stderr.read()
            shown = pixels().astype(int)
            teal = (shown[..., 1] - shown[..., 0] > 40) & (shown[..., 2] - shown[..., 0] > 40)
            coral = (shown[..., 0] - shown[..., 1] > 60) & (shown[..., 0] - shown[..., 2] > 60)
            if teal.sum() > 50 and coral.sum() > 50 and path.exists() and path.stat().st_size > 4000:
                break
            time.sleep(0.1)
        else:
            pytest.fail("no figure on the display")
        keep = os.environ.get("BUNRAKU_KEEP_PICTURES")
        if keep:
            from PIL import Image

            Image.fromarray(shown.astype(np.uint8)).save(os.path.join(keep, f"window-{engine}.png"))
        # upright, and not mirrored: the figure looks at us, its left (teal) is on our right
        assert np.nonzero(teal)[1].mean() > np.nonzero(coral)[1].mean()
        rows = np.nonzero((shown > 150).all(axis=2).any(axis=1))[0]
        inside = np.nonzero(teal | coral)[0]
        assert inside.max() - rows.min() > 0.7 * 360  # the feet are below
        node.send_signal(signal.SIGTERM)
        _, said = node.communicate(timeout=30)
    finally:
        performer.kill()
        performer.wait()
        node.kill()
    assert node.returncode == 0, said
    with av.open(str(path)) as file:
        assert sum(1 for _ in file.decode(video=0)) > 5


def test_without_a_display_there_is_no_window(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setattr(window.sys, "platform", "linux")
    with pytest.raises(window.NoWindow, match="DISPLAY"):
        window.Window(64, 36)
