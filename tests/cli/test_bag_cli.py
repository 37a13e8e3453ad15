"""`bunraku bag` on files: info, recover, export, check, and what it refuses."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import msgpack
import numpy as np
import pytest

from bunraku.cli import main
from bunraku.figure.default import default_figure
from bunraku.figure.wire import to_message
from bunraku.msgs import Pose
from bunraku.nodes.recorder.node import Recorder
from bunraku.runtime.bag import Bag, BagWriter, Channel
from bunraku.runtime.memory import MemoryStage
from bunraku.runtime.node import Node, Publisher, param, timer

T0 = 1_700_000_000_000_000_000
MS = 1_000_000


class Wave(Node):
    """Says a pose 50 times a second."""

    name = "wave"
    pose = Publisher("pose", Pose)
    reach: float = param(0.5)

    def setup(self) -> None:
        self.figure = default_figure()
        self.count = 0

    @timer(hz=50)
    def tick(self) -> None:
        self.count += 1
        root, rotations = self.figure.rest_pose()
        root = np.array(root, "f4")
        root[0] = self.reach * np.sin(self.count / 20)
        self.pose.publish(Pose(skeleton=self.figure.hash, root=root, rotations=rotations))


@pytest.fixture
def take(tmp_path: Path) -> Path:
    stage = MemoryStage()
    recorder = stage.add(Recorder, output=str(tmp_path / "take.mcap"))
    stage.publish("skeleton", to_message(default_figure()))
    wave = stage.add(Wave)
    stage.advance(2.0)
    stage.remove(wave)
    stage.remove(recorder)
    return tmp_path / "take.mcap"


@pytest.fixture(autouse=True)
def _plain_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BUNRAKU_JIT", os.environ.get("BUNRAKU_JIT", "0"))


def line(capsys: pytest.CaptureFixture[str]) -> str:
    """The one line on standard error."""
    text = capsys.readouterr().err
    assert text.count("\n") == 1, text
    return text


def test_info(take: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bag", "info", str(take)]) == 0
    text = capsys.readouterr().out
    assert "complete" in text
    assert "skeleton (latched)" in text
    assert "50.0/s" in text
    assert main(["bag", "info", str(take), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["complete"]
    assert {one["topic"]: one["count"] for one in told["topics"]}["pose"] == 100
    assert told["gaps"] == 0


def test_a_killed_recording_is_told_and_mended(take: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(take.read_bytes()[: take.stat().st_size * 2 // 3])
    assert main(["bag", "info", str(cut), "--json"]) == 0
    before = json.loads(capsys.readouterr().out)
    assert not before["complete"]
    assert before["messages"] > 0
    assert main(["bag", "recover", str(cut), "-o", str(tmp_path / "mended.mcap"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["messages"] == before["messages"]
    assert main(["bag", "info", str(tmp_path / "mended.mcap"), "--json"]) == 0
    after = json.loads(capsys.readouterr().out)
    assert after["complete"]
    assert after["topics"] == before["topics"]
    assert main(["bag", "recover", str(cut), "-o", str(tmp_path / "mended.mcap")]) == 2
    assert "exists already" in line(capsys)


def test_export_json(take: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bag", "export", str(take), "--json", "--topic", "pose"]) == 0
    lines = [json.loads(text) for text in capsys.readouterr().out.splitlines()]
    assert len(lines) == 100
    assert (lines[0]["topic"], lines[0]["type"]) == ("pose", "Pose")
    assert np.shape(lines[0]["message"]["rotations"]) == (21, 4)
    with Bag(take) as bag:
        body = msgpack.unpackb(next(bag.messages({"pose"})).body)
    assert np.array_equal(np.array(lines[0]["message"]["root"], "<f4"), np.frombuffer(body["root"], "<f4"))
    out = tmp_path / "all.jsonl"
    assert main(["bag", "export", str(take), "--json", str(out)]) == 0
    with Bag(take) as bag:
        assert len(out.read_text().splitlines()) == len(list(bag.messages()))
    capsys.readouterr()
    assert main(["bag", "export", str(take), "--json", str(out)]) == 2
    assert "exists already" in line(capsys)


def test_export_json_of_remapped_and_broken_messages(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.mcap"
    with BagWriter(path) as writer:
        writer.add_channel(Channel("puppet", "Pose"))
        rest = Pose(skeleton="s", root=np.zeros(3), rotations=np.array([[0, 0, 0, 1.0]]))
        writer.write("puppet", T0, rest.encode())
        writer.write("own", T0 + 1, b"\xc1 no msgpack")
        writer.write("own", T0 + 2, msgpack.packb({"x": float("nan"), "b": b"\0", 5: None}))
    assert main(["bag", "export", str(path), "--json"]) == 0
    puppet, broken, odd = (json.loads(text)["message"] for text in capsys.readouterr().out.splitlines())
    assert puppet["rotations"] == [[0, 0, 0, 1]]
    assert "invalid" in broken
    assert odd == {"x": "nan", "b": {"base64": "AA=="}, "5": None}


def test_export_bvh(take: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from bunraku.motion.bvh import read_bvh

    out = tmp_path / "take.bvh"
    assert main(["bag", "export", str(take), "--bvh", str(out), "--fps", "50"]) == 0
    assert "100 frames" in capsys.readouterr().out
    clip = read_bvh(out)
    assert (len(clip), clip.fps) == (100, pytest.approx(50, rel=1e-3))
    expected = 0.5 * np.sin(np.arange(1, 101) / 20)
    assert np.abs(clip.roots[:, 0] - clip.roots[0, 0] - (expected - expected[0])).max() < 1e-4


def test_export_bvh_says_what_is_missing(take: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = str(tmp_path / "x.bvh")

    def refused(path: Path, *words: str) -> str:
        assert main(["bag", "export", str(path), "--bvh", out, *words]) == 2
        return line(capsys)

    def copy(name: str, keep) -> Path:
        with Bag(take) as bag, BagWriter(tmp_path / name) as writer:
            for entry in bag.messages():
                for topic in keep(entry.topic):
                    writer.write(topic, entry.received, entry.body)
        return tmp_path / name

    assert "no topic 'pole', did you mean 'pose'?" in refused(take, "--topic", "pole")
    assert "holds no poses" in refused(take, "--topic", "skeleton")
    no_skeleton = copy("b", lambda topic: [topic] if topic == "pose" else [])
    assert "skeleton of pose was not recorded" in refused(no_skeleton)
    assert "holds no poses" in refused(copy("c", lambda topic: [topic] if topic == "skeleton" else []))
    two = copy("d", lambda topic: [f"alice/{topic}", f"bob/{topic}"] if topic in ("pose", "skeleton") else [])
    assert "several figures" in refused(two)
    assert main(["bag", "export", str(two), "--bvh", out, "--topic", "bob/pose"]) == 0
    capsys.readouterr()
    assert "exists already" in refused(two, "--topic", "bob/pose")


def test_export_glb_is_read_by_another_reader(take: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import trimesh

    out = tmp_path / "take.glb"
    assert main(["bag", "export", str(take), "--glb", str(out), "--fps", "50"]) == 0
    assert "100 frames, 1.98 s of pose" in capsys.readouterr().out
    scene = trimesh.load(out)
    (mesh,) = scene.geometry.values()
    height = mesh.bounds[1][1] - mesh.bounds[0][1]
    assert len(mesh.faces) > 3000
    assert 1.6 < height < 1.9
    assert {"hips", "left_hand", "head"} <= set(scene.graph.nodes)
    assert mesh.visual.vertex_attributes["color"][:, :3].std() > 0.05 * mesh.visual.vertex_attributes["color"].max()
    document = json.loads(out.read_bytes()[20 : 20 + int.from_bytes(out.read_bytes()[12:16], "little")])
    (animation,) = document["animations"]
    times = document["accessors"][animation["samplers"][0]["input"]]
    assert (times["count"], times["max"][0]) == (100, pytest.approx(1.98))


def test_export_all_at_once_and_a_film_that_is_not_dark(
    take: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import av

    monkeypatch.setenv("BUNRAKU_PROGRESS", "lines")
    monkeypatch.setattr("bunraku.cli.progress.EVERY", 0.0)
    names = {form: str(tmp_path / f"take.{form}") for form in ("bvh", "glb", "mp4")}
    words = [word for form, name in names.items() for word in (f"--{form}", name)]
    words += ["--fps", "25", "--size", "320x240", "--engine", "pillow"]
    assert main(["bag", "export", str(take), *words]) == 0
    told = capsys.readouterr()
    assert all(name in told.out for name in names.values())
    shares = [int(share) for share in re.findall(r"^filming (\d+)%$", told.err, re.M)]
    assert shares == sorted(shares)
    assert shares[-1] >= 95
    with av.open(names["mp4"]) as film:
        frames = [frame.to_ndarray(format="rgb24").astype(float) for frame in film.decode(video=0)]
    assert len(frames) == pytest.approx(50, abs=2)
    assert frames[0].shape == (240, 320, 3)
    for frame in frames:
        assert frame.mean() > 100
        assert frame.std() > 10
    assert np.abs(frames[-1] - frames[0]).max() > 60  # the figure moves
    assert main(["bag", "export", str(take), *words]) == 2
    assert "exists already" in capsys.readouterr().err


def test_a_film_shows_every_figure_or_the_one_that_is_asked_for(
    take: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    two = tmp_path / "two.mcap"
    with Bag(take) as bag, BagWriter(two) as writer:
        for entry in bag.messages():
            if entry.topic in ("pose", "skeleton"):
                for figure in ("alice", "bob"):
                    writer.write(f"{figure}/{entry.topic}", entry.received, entry.body)
    words = ["--fps", "5", "--size", "128x96", "--engine", "pillow"]
    assert main(["bag", "export", str(two), "--mp4", str(tmp_path / "a.mp4"), *words]) == 0
    assert "of alice/pose, bob/pose" in capsys.readouterr().out
    assert main(["bag", "export", str(two), "--mp4", str(tmp_path / "b.mp4"), "--topic", "bob/pose", *words]) == 0
    assert "s of bob/pose" in capsys.readouterr().out
    bare = tmp_path / "bare.mcap"
    with Bag(take) as bag, BagWriter(bare) as writer:
        for entry in bag.messages({"pose"}):
            writer.write("pose", entry.received, entry.body)
    assert main(["bag", "export", str(bare), "--mp4", str(tmp_path / "c.mp4"), *words]) == 2
    assert "needs a pose and its skeleton" in line(capsys)
    assert not (tmp_path / "c.mp4").exists()


def test_check_of_the_same_code_passes_twice(take: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for _ in range(2):
        assert main(["bag", "check", str(take)]) == 0
        text = capsys.readouterr().out
        assert "wave: 101 steps, 100 messages compared: equal to the last bit" in text
    assert main(["bag", "check", str(take), "--node", "wave", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["passed"], told["tolerance"], told["nodes"][0]["compared"]) == (True, 0.0, 100)


def test_check_of_changed_code_fails(
    take: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import importlib

    module = importlib.import_module(Wave.__module__)
    monkeypatch.setattr(module.np, "sin", lambda x: np.cos(x - np.pi / 2) + 1e-5)
    assert main(["bag", "check", str(take)]) == 1
    text = capsys.readouterr().out
    assert "different: 100 messages, first at" in text
    assert "pose seq 0 root" in text
    assert "NOT the same" in text
    assert main(["bag", "check", str(take), "--tolerance", "1e-4", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["nodes"][0]["different"] == 100
    assert told["nodes"][0]["largest"] == pytest.approx(5e-6, rel=0.2)


def test_check_says_what_it_cannot_check(take: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bag", "check", str(take), "--node", "wove"]) == 2
    assert "did you mean 'wave'?" in line(capsys)
    with BagWriter(tmp_path / "b.mcap") as writer:
        writer.write("pose", T0, b"")
    assert main(["bag", "check", str(tmp_path / "b.mcap")]) == 2
    assert "holds no journal" in line(capsys)


@pytest.mark.parametrize("words", [["info"], ["recover", "-o", "out"], ["export", "--json"], ["check"], ["play"]])
def test_a_file_that_is_no_bag_is_one_line_and_status_2(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    Path("garbage").write_bytes(os.urandom(5000))
    for file, why in (("garbage", "is not a bag"), ("none", "does not exist")):
        assert main(["bag", words[0], file, *words[1:]]) == 2
        assert why in line(capsys)
    assert not Path("out").exists()


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["play", "take.mcap", "--rate", "0"], "give a number above 0"),
        (["play", "take.mcap", "--rate", "nan"], "no number"),
        (["play", "take.mcap", "--topics", "poze"], "no topic 'poze', did you mean 'pose'?"),
        (["play", "take.mcap", "--start", "99"], "start 99 s is not in the bag"),
        (["play", "take.mcap", "--remap", "pose"], "write name:=value"),
        (["play", "take.mcap", "--remap", "pose:=A b"], "topic name 'A b'"),
        (["play", "take.mcap", "--remap", "poze:=a"], "no such topic"),
        (["play", "take.mcap", "--remap", "pose:=skeleton"], "two topics"),
        (["play", "take.mcap", "--wait-for", "touch"], "no topic 'touch'"),
        (["record", "-o", "take.mcap"], "exists already"),
        (["record", "-o", "no/such/folder.mcap"], "no folder"),
        (["record", "-o", "new.mcap", "Bad Topic"], "topic 'Bad Topic'"),
        (["record"], "required: -o"),
        (["export", "take.mcap"], "at least one of --bvh, --glb, --mp4 and --json"),
        (["export", "take.mcap", "--glb", "no/such/a.glb"], "no folder no/such"),
        (["export", "take.mcap", "--mp4", "a.mp4", "--size", "big"], "write it like 1280x720"),
        (["export", "take.mcap", "--mp4", "a.mp4", "--size", "101x64"], "even numbers"),
        (["export", "take.mcap", "--mp4", "a.mp4", "--fps", "29.97"], "a whole number"),
        (["export", "take.mcap", "--mp4", "a.mp4", "--topic", "skeleton"], "holds no poses"),
        (["burn", "take.mcap"], "unknown 'burn'"),
    ],
)
def test_bad_usage_is_one_line_and_status_2(
    words: list[str], why: str, take: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(take.parent)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(take.parent))
    assert main(["bag", *words]) == 2
    assert why in line(capsys)
    assert not (take.parent / "bunraku").exists() or not list((take.parent / "bunraku").iterdir())


def test_help_does_not_import_what_is_heavy() -> None:
    code = (
        "import sys\nfrom bunraku.cli import main\nmain(['bag', 'play', '--help'])\n"
        "print([m for m in ('numpy', 'zmq', 'mcap', 'msgspec') if m in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.strip() == "[]"
    assert "--loop" in done.stdout


def test_check_steps_a_compiled_node_in_a_process_that_compiles(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a_compiled_node.py").write_text(
        "import os\n"
        "from bunraku.msgs import Target\n"
        "from bunraku.runtime.node import Node, Publisher, timer\n"
        "class Compiled(Node):\n"
        "    name = 'compiled'\n"
        "    jit = True\n"
        "    out = Publisher('target', Target)\n"
        "    @timer(hz=10)\n"
        "    def tick(self):\n"
        "        self.out.publish(Target(yaw=float(os.environ['BUNRAKU_JIT'])))\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setenv("BUNRAKU_JIT", "1")
    from a_compiled_node import Compiled  # type: ignore[import-not-found]

    stage = MemoryStage()
    recorder = stage.add(Recorder, output=str(tmp_path / "a.mcap"))
    stage.add(Compiled)
    stage.add(Wave)
    stage.advance(1.0)
    stage.remove(recorder)
    monkeypatch.delenv("BUNRAKU_JIT")
    monkeypatch.delenv("NUMBA_DISABLE_JIT", raising=False)
    assert main(["bag", "check", str(tmp_path / "a.mcap"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [(one["node"], one["compared"], one["different"]) for one in told["nodes"]] == [
        ("compiled", 10, 0),
        ("wave", 50, 0),
    ]
