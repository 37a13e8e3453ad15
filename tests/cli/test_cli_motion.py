"""bunraku motion: info, preview and build, as typed."""

import json

import numpy as np
import pytest
from PIL import Image

from bunraku.cli import main
from bunraku.figure.default import default_figure
from bunraku.motion import build_edit as edit
from bunraku.motion.bvh import write_bvh
from bunraku.motion.clip import Clip
from bunraku.motion.synth import builtin_set


@pytest.fixture(scope="module")
def captures(tmp_path_factory):
    base = tmp_path_factory.mktemp("captures")
    generated = builtin_set(default_figure())
    write_bvh(edit.repeated(generated.canonical["walk"].clip, 3), base / "walk.bvh")
    write_bvh(generated.canonical["jump_up"].clip, base / "jump.bvh")
    write_bvh(generated.module("stand").examples[0].clip, base / "stand.bvh")
    return base


def run(capsys, *words):
    status = main(["motion", *map(str, words)])
    out, err = capsys.readouterr()
    return status, out, err


def test_info_tells_what_a_walk_does(captures, capsys):
    status, out, _ = run(capsys, "info", captures / "walk.bvh")
    assert status == 0
    assert "unit 0.01 m" in out
    assert "cycle 1:" in out
    status, out, _ = run(capsys, "info", captures / "walk.bvh", "--json")
    told = json.loads(out)
    assert told["measures"]["speed"] == pytest.approx(1.3, abs=0.05)
    assert len(told["cycles"]) >= 1
    assert told["roles"]["hips"] == "hips"
    assert told["contacts"]["left_foot"]
    status, out, _ = run(capsys, "info", captures / "jump.bvh", "--json")
    assert len(json.loads(out)["jump"]) == 6


def test_build_writes_a_set_and_its_recipe_and_reads_it_again(captures, tmp_path, capsys):
    output = tmp_path / "new" / "set.npz"
    status, out, _ = run(capsys, "build", captures, "-o", output, "--json")
    assert status == 0
    told = json.loads(out)
    assert told["recipe"] == str(output.with_suffix(".toml"))
    assert told["modules"]["locomotion"] >= 5
    assert told["modules"]["jump_left"] >= 4
    assert told["made"] > told["captured"] > 0
    status, out, _ = run(
        capsys, "build", captures, "-o", tmp_path / "b.npz", "--recipe", told["recipe"], "--name", "two"
    )
    assert status == 0
    assert "jump_left" in out
    status, out, _ = run(capsys, "info", tmp_path / "b.npz", "--json")
    again = json.loads(out)
    assert again["name"] == "two"
    assert {m["name"]: len(m["examples"]) for m in again["modules"]} == told["modules"]
    status, out, _ = run(capsys, "info", tmp_path / "b.npz")
    assert "canonical clips" in out
    status, out, _ = run(
        capsys, "preview", tmp_path / "b.npz", "--example", "canonical/march", "-o", tmp_path / "m.png"
    )
    assert status == 0
    status, _, err = run(capsys, "preview", tmp_path / "b.npz", "--example", "nothing", "-o", tmp_path / "m.png")
    assert status == 2
    assert "locomotion/" in err


def test_preview_draws_poses_contacts_and_curves(captures, tmp_path, capsys):
    status, out, _ = run(capsys, "preview", captures / "walk.bvh", "-o", tmp_path / "walk.png", "--poses", 6)
    assert (status, out.strip()) == (0, str(tmp_path / "walk.png"))
    pixels = np.asarray(Image.open(tmp_path / "walk.png").convert("RGB")).astype(int)
    assert pixels.shape[1] == 1280
    red = (pixels[..., 0] > 180) & (pixels[..., 2] < 90)
    blue = (pixels[..., 2] > 150) & (pixels[..., 0] < 90)
    assert red[60:340].sum() > 500  # limbs
    assert blue[60:340].sum() > 500
    assert red[350:410].sum() > 2000  # contact bars
    single = Clip("one", default_figure(), 30.0, [default_figure().rest_pose()[0]], [default_figure().rest_pose()[1]])
    write_bvh(single, tmp_path / "one.bvh")
    assert run(capsys, "preview", tmp_path / "one.bvh", "-o", tmp_path / "one.png")[0] == 0


@pytest.mark.parametrize(("words", "said"), [
    (("info", "nowhere.bvh"), "nowhere.bvh"),
    (("info", "nowhere.npz"), "nowhere.npz"),
    (("info", "notes.txt"), "neither a .bvh nor an .amc"),
    (("info", "walk.bvh", "--up", "w"), "unknown 'w'"),
    (("info", "{walk}", "--unit", "-1"), "unit"),
    (("preview", "{walk}", "-o", "a.gif"), ".png or .jpg"),
    (("preview", "{walk}", "-o", "a.png", "--poses", "0"), "--poses 0"),
    (("build", "nowhere", "-o", "a.npz"), "no such folder"),
    (("build", "{folder}", "-o", "a.bvh"), "ends in .npz"),
    (("build", "{folder}", "-o", "a.npz", "--recipe", "nowhere.toml"), "nowhere.toml"),
    (("build", "{empty}", "-o", "a.npz"), "no .bvh or .amc"),
])  # fmt: skip
def test_what_cannot_be_done_is_one_line(captures, tmp_path, capsys, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    places = {"walk": captures / "walk.bvh", "folder": captures, "empty": tmp_path / "empty"}
    status, out, err = run(capsys, *(word.format(**places) for word in words))
    assert status == 2
    assert said in err
    assert len(err.strip().splitlines()) == 1
    assert out == ""
