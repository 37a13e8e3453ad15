"""`bunraku demo` as a newcomer runs it, and its files as other programs read them."""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import av
import numpy as np
import pytest
from mcap.reader import make_reader

from bunraku.figure.default import default_figure
from bunraku.figure.fk import fk
from bunraku.figure.metrics import foot_drift
from bunraku.msgs import Motion, Pose, Touch, decode
from bunraku.runtime.bag import Bag

pytestmark = [pytest.mark.peer, pytest.mark.timeout(900)]

FPS = 8


@pytest.fixture(scope="module")
def show(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the demonstration wrote."""
    out = tmp_path_factory.mktemp("show")
    with tempfile.TemporaryDirectory(prefix="bunraku-demo-") as run:
        done = subprocess.run(
            [sys.executable, "-m", "bunraku.cli", "demo", "--out", str(out), "--size", "320x180", "--fps", str(FPS)],
            env={**os.environ, "XDG_RUNTIME_DIR": run}, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            timeout=800, check=False,
        )  # fmt: skip
    assert done.returncode == 0, done.stdout
    return out


@pytest.fixture(scope="module")
def bag(show: Path) -> Iterator[Bag]:
    with Bag(show / "bunraku.mcap") as opened:
        yield opened


def heard(bag: Bag, topic: str, kind: type) -> tuple[np.ndarray, list]:
    """Times (s since the first touch) and messages of a topic."""
    first = next(iter(bag.messages(["touch"]))).received
    found = [(entry.received, decode(kind, entry.body)) for entry in bag.messages([topic])]
    return np.array([(at - first) / 1e9 for at, _ in found]), [message for _, message in found]


def places(messages: list) -> np.ndarray:
    """World positions (frames, joints, 3) of poses."""
    skeleton = default_figure()
    return np.array(
        [fk(skeleton, np.asarray(one.root, dtype=float), np.asarray(one.rotations, dtype=float))[0] for one in messages]
    )


def test_the_bag_is_read_by_the_format_s_own_library(show: Path) -> None:
    with (show / "bunraku.mcap").open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        topics = {channel.topic for channel in summary.channels.values()}
    assert {"touch", "pen", "target", "command", "motion", "pose", "skeleton", "camera"} <= topics


def test_nothing_was_lost_and_today_s_code_says_the_same(show: Path) -> None:
    file = str(show / "bunraku.mcap")
    said = subprocess.run(
        [sys.executable, "-m", "bunraku.cli", "bag", "check", file, "--json"], stdout=subprocess.PIPE, check=False
    )
    assert said.returncode == 0, said.stdout
    nodes = {one["node"]: one for one in json.loads(said.stdout)["nodes"]}
    for name in ("interpreter", "blender", "controller"):
        assert nodes[name]["compared"] > 300


def test_a_finger_leads_the_hand_while_the_pen_walks_the_figure(bag: Bag) -> None:
    times, poses = heard(bag, "pose", Pose)
    at = places(poses)
    left = default_figure().names.index("left_hand")
    led = (times > 18.0) & (times < 21.0)
    assert (at[led, left, 1] > 1.25).all()
    ways = np.linalg.norm(np.diff(at[led, 0][:, [0, 2]], axis=0), axis=1).sum()
    assert ways > 1.0


def test_the_figure_ducks_and_jumps_under_the_pen(bag: Bag) -> None:
    times, poses = heard(bag, "pose", Pose)
    hips = places(poses)[:, 0, 1]
    assert hips[(times > 26.0) & (times < 31.0)].min() < 0.80
    assert hips[(times > 32.0) & (times < 36.0)].max() > 1.15


def test_it_jumps_with_both_hands_up_and_bows(bag: Bag) -> None:
    times, poses = heard(bag, "pose", Pose)
    at = places(poses)
    names = default_figure().names
    hands = at[:, [names.index("left_hand"), names.index("right_hand")], 1]
    jumping = (times > 37.5) & (times < 41.0)
    top = np.flatnonzero(jumping)[at[jumping, 0, 1].argmax()]
    assert at[top, 0, 1] > 1.05
    assert (hands[top] > at[top, names.index("left_upper_arm"), 1]).all()
    bowing = (times > 41.0) & (times < 44.0)
    assert at[bowing, names.index("neck"), 1].min() < at[times < 0.5, names.index("neck"), 1].min() - 0.06


def test_what_nobody_holds_moves_as_the_motion_does(bag: Bag) -> None:
    when, motions = heard(bag, "motion", Motion)
    times, poses = heard(bag, "pose", Pose)
    free = np.flatnonzero((times > 26.0) & (times < 36.0))[::5]
    at = places([poses[k] for k in free])
    newest = np.searchsorted(when, times[free], side="right")
    # The recorder may hear a pose before the motion that made it, or the next motion before the pose.
    beside = [places([motions[k] for k in np.clip(newest + shift, 0, len(motions) - 1)]) for shift in (-2, -1, 0)]
    apart = np.min([np.linalg.norm(at - moved, axis=2).max(axis=1) for moved in beside], axis=0)
    assert np.median(apart) < 0.002
    assert np.quantile(apart, 0.95) < 0.03


def test_planted_feet_stay_while_fingers_play(bag: Bag) -> None:
    times, poses = heard(bag, "pose", Pose)
    poses = [pose for at, pose in zip(times, poses, strict=True) if at < 15.0]
    at = places(poses)
    names = default_figure().names
    for side in ("left", "right"):
        planted = np.array([getattr(one.contacts, f"{side}_foot") for one in poses])
        foot = at[:, names.index(f"{side}_foot")]
        assert foot_drift(foot[:, None], planted[:, None]) < 0.002


def test_every_touch_message_is_whole(bag: Bag) -> None:
    _, touches = heard(bag, "touch", Touch)
    assert [one.seq for one in touches] == list(range(len(touches)))


def test_the_film_is_bright_and_moves(show: Path) -> None:
    with av.open(str(show / "bunraku.mp4")) as film:
        frames = [frame.to_ndarray(format="gray").astype(float) for frame in film.decode(video=0)]
    assert len(frames) == pytest.approx(44 * FPS, abs=8 * FPS)
    assert min(frame.mean() for frame in frames) > 100.0
    moved = [float(np.abs(b - a).mean()) for a, b in zip(frames[::FPS], frames[FPS::FPS], strict=False)]
    assert sum(one > 0.3 for one in moved) > 20


def test_the_motion_file_and_the_sheet_are_there(show: Path) -> None:
    lines = (show / "bunraku.bvh").read_text().splitlines()
    assert lines[0] == "HIERARCHY"
    count = next(int(line.split()[1]) for line in lines if line.startswith("Frames:"))
    assert count > 44 * 55
    assert (show / "bunraku.png").stat().st_size > 50_000
