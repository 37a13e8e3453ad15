import os
import signal
import subprocess
import sys
import time

import av
import numpy as np
import pytest
from PIL import Image

from bunraku.figure.camera import look_at
from bunraku.figure.default import default_figure
from bunraku.figure.wire import to_message
from bunraku.msgs import Overlay, Pose, Primitive
from bunraku.nodes.renderer.film import SECOND, Film, Shots, make_film, wanted
from bunraku.nodes.renderer.video import Video, VideoError

FIGURE = default_figure()
START = 1_700_000_000 * SECOND


class Painter:
    """An engine whose picture tells where the first figure stands: grey 100 + 100 x."""

    name = "painter"

    def __init__(self):
        self.drawn = 0

    def draw(self, view, width, height):
        self.drawn += 1
        x = float(view.figures[0].positions_ws[0][0])
        pixels = np.zeros((height, width, 4), np.uint8)
        pixels[..., :3] = round(100 + 100 * x)
        return pixels

    def close(self):
        pass


def pose(x=0.0):
    return Pose(skeleton=FIGURE.hash, root=np.array([x, 0.95, 0.0]), rotations=FIGURE.rest_pose()[1])


def camera():
    return look_at((0.0, 1.0, 5.0), (0.0, 0.9, 0.0), yfov=0.6)


def recording(seconds, rate=60, speed=0.5):
    yield START, "skeleton", to_message(FIGURE)
    yield START, "camera", camera()
    for k in range(round(seconds * rate)):
        yield START + k * SECOND // rate, "pose", pose(speed * k / rate)


def frames(path):
    with av.open(str(path)) as file:
        return [frame.to_ndarray(format="rgb24") for frame in file.decode(video=0)]


def shots(tmp_path, **more):
    return Shots(**{"output": tmp_path / "film.mp4", "width": 64, "height": 36, "fps": 30, "overlays": False, **more})


def film_of(tmp_path, messages, **more):
    film = Film(shots(tmp_path, **more), Painter())
    last = None
    for last, topic, message in messages:
        film.feed(last, topic, message)
    film.close(last)
    return film


@pytest.mark.parametrize("fps", [24, 30, 60])
def test_each_frame_shows_the_newest_pose_of_its_moment(tmp_path, fps):
    film = film_of(tmp_path, recording(2.0, speed=0.5), fps=fps)
    grey = np.array([frame.mean() for frame in frames(tmp_path / "film.mp4")])
    assert len(grey) == film.frames
    assert abs(len(grey) - (2.0 - 1 / 60) * fps) <= 1.001
    expected = 100 + 100 * 0.5 * np.floor(np.arange(len(grey)) / fps * 60 + 1e-6) / 60
    np.testing.assert_allclose(grey, expected, atol=3.0)


def test_the_file_says_its_rate_and_length_and_begins_with_its_index(tmp_path):
    film_of(tmp_path, recording(2.0), fps=30)
    path = tmp_path / "film.mp4"
    with av.open(str(path)) as file:
        stream = file.streams.video[0]
        assert stream.average_rate == 30
        assert stream.codec_context.name == "h264"
        assert stream.codec_context.pix_fmt == "yuv420p"
        times = [float(frame.pts * frame.time_base) for frame in file.decode(video=0)]
        assert float(file.duration / av.time_base) == pytest.approx(len(times) / 30, abs=0.05)
    np.testing.assert_allclose(times, np.arange(len(times)) / 30, atol=1e-6)
    head = path.read_bytes()[:4096]
    assert b"moov" in head
    assert b"moof" not in path.read_bytes()
    assert list(tmp_path.iterdir()) == [path]


def test_a_gap_holds_the_picture_and_draws_nothing_twice(tmp_path):
    messages = [*recording(0.1), (START + 3 * SECOND, "pose", pose(1.0))]
    film = film_of(tmp_path, messages, fps=30)
    assert film.frames == pytest.approx(91, abs=1)
    assert film.drawn < 8
    grey = [frame.mean() for frame in frames(tmp_path / "film.mp4")]
    assert grey[-1] > grey[-2] + 50
    assert np.ptp(grey[5:-1]) < 4


def test_a_film_begins_with_its_first_figure(tmp_path):
    late = [(START, "camera", camera()), (START + 5 * SECOND, "skeleton", to_message(FIGURE))]
    late += [(START + 6 * SECOND + k * SECOND // 60, "pose", pose()) for k in range(31)]
    film = film_of(tmp_path, late, fps=30)
    assert film.start == START + 6 * SECOND
    assert film.frames == pytest.approx(16, abs=1)


def test_nothing_heard_writes_nothing(tmp_path):
    film = film_of(tmp_path, [], sheet=tmp_path / "sheet.png", picture=tmp_path / "last.png")
    assert film.frames == 0
    assert not list(tmp_path.iterdir())


def test_a_single_pose_is_a_film_of_one_frame(tmp_path):
    film_of(tmp_path, recording(1 / 60))
    assert len(frames(tmp_path / "film.mp4")) == 1


def test_only_what_goes_into_a_file_is_drawn(tmp_path):
    film = film_of(tmp_path, recording(4.0, speed=0.2), output="", picture=tmp_path / "last.png")
    assert film.frames > 100
    assert film.drawn == 1
    last = np.asarray(Image.open(tmp_path / "last.png"))
    assert abs(last.mean() - (100 + 100 * 0.2 * (4.0 - 1 / 60))) < 2
    film = film_of(tmp_path, recording(8.0, speed=0.1), output="", sheet=tmp_path / "sheet.png")
    assert film.drawn < 0.8 * film.frames


def test_overlays_and_figures_are_on_the_film(tmp_path):
    red = Overlay(
        primitives=[Primitive(kind="circle", space="screen", points=[(0.2, 0.5)], size=0.1, color=(1.0, 0.0, 0.0, 1.0))]
    )
    messages = [*recording(0.2, speed=0.0), (START + SECOND // 5, "overlay/interpreter", red)]
    messages += [(START + SECOND // 2, "pose", pose())]
    said = []
    film = make_film(
        messages, Shots(tmp_path / "a.mp4", tmp_path / "a-sheet.png", tmp_path / "a.png", 320, 180, 30),
        engine="pillow", progress=said.append,
    )  # fmt: skip
    assert said == list(range(1, film.frames + 1))
    first, last = (frame.astype(int) for frame in (frames(tmp_path / "a.mp4")[k] for k in (0, -1)))
    place = (slice(90 - 18, 90 + 18), slice(64 - 18, 64 + 18))
    assert ((last[place][..., 0] - last[place][..., 1]) > 80).sum() > 60
    assert ((first[place][..., 0] - first[place][..., 1]) > 80).sum() == 0
    assert abs(first[:20, :20].mean() - 222) < 8
    assert (tmp_path / "a-sheet.png").exists()
    assert (tmp_path / "a.png").exists()


def test_colours_survive_the_codec(tmp_path):
    video = Video(tmp_path / "c.mp4", 64, 64, 30)
    for color in ((222, 80, 60), (30, 140, 150), (225, 205, 180)):
        pixels = np.full((64, 64, 4), 255, np.uint8)
        pixels[..., :3] = color
        video.write(pixels)
    video.close()
    for frame, color in zip(frames(tmp_path / "c.mp4"), ((222, 80, 60), (30, 140, 150), (225, 205, 180)), strict=True):
        np.testing.assert_allclose(frame.reshape(-1, 3).mean(axis=0), color, atol=8)


def test_a_film_that_cannot_be_written_says_why(tmp_path):
    with pytest.raises(VideoError, match=r"nowhere.*cannot be written"):
        Video("/proc/nowhere/film.mp4", 64, 36, 30)
    with pytest.raises(VideoError, match="even"):
        Video(tmp_path / "odd.mp4", 63, 36, 30)


def test_the_topics_of_a_film():
    there = ["pose", "camera", "skeleton", "overlay/a", "alice/pose", "alice/overlay/b", "touch", "log/x", "motion"]
    assert wanted(there, [""]) == ["pose", "camera", "skeleton", "overlay/a"]
    assert wanted(there, ["alice"]) == ["camera", "overlay/a", "alice/pose", "alice/overlay/b"]


WRITER = """
import sys, time, numpy as np
from bunraku.nodes.renderer.video import Video
video = Video(sys.argv[1], 64, 36, 30)
random = np.random.default_rng(1)
for k in range(100000):
    video.write(random.integers(0, 255, (36, 64, 4), dtype=np.uint8))
    if k == 150:
        print("ready", flush=True)
        time.sleep(60)
"""


def test_a_killed_process_leaves_a_film_that_plays(tmp_path):
    path = tmp_path / "killed.mp4"
    process = subprocess.Popen([sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE)
    try:
        assert process.stdout.readline() == b"ready\n"
    finally:
        process.kill()
        process.wait()
    assert len(frames(path)) >= 100


@pytest.mark.stack
def test_ctrl_c_finishes_the_film_of_a_real_node(tmp_path):
    """The node as a process, poses over real sockets, INT after a second of film."""
    environment = {
        **os.environ, "XDG_RUNTIME_DIR": str(tmp_path), "BUNRAKU_STAGE": "film", "BUNRAKU_JIT": "0", "DISPLAY": "",
    }  # fmt: skip
    path = tmp_path / "node.mp4"
    command = [sys.executable, "-m", "bunraku.cli", "run", "renderer", "--set", f"output:={path}"]
    for text in ("size:=160x90", "fps:=30", "engine:=pillow"):
        command += ["--set", text]
    performer = subprocess.Popen([sys.executable, "-c", PERFORMER], env=environment, stdout=subprocess.DEVNULL)
    node = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
    try:
        deadline = time.monotonic() + 60
        while not (path.exists() and path.stat().st_size > 4000) and time.monotonic() < deadline:
            assert node.poll() is None, node.stderr.read()
            time.sleep(0.05)
        node.send_signal(signal.SIGINT)
        _, said = node.communicate(timeout=30)
    finally:
        performer.kill()
        performer.wait()
        node.kill()
    assert node.returncode == 0, said
    assert f"wrote {path}" in said
    assert b"moof" not in path.read_bytes()
    seen = frames(path)
    assert len(seen) >= 20
    assert seen[0].std() > 5


PERFORMER = """
import time
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
        root, rotations = figure.rest_pose()
        root[0] = (self.now / 1e9) % 1.0
        self.pose.publish(Pose(skeleton=figure.hash, root=root, rotations=rotations))

run_node(Performer)
"""
