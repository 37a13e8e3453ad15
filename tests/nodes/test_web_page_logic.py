"""The page's own logic: its modules run under node's test runner on bytes that the server made; types are checked."""

import json
import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import javascript
import numpy as np
import pytest

from bunraku.figure.camera import default_camera, project
from bunraku.figure.capsules import capsules
from bunraku.figure.default import default_figure
from bunraku.figure.fk import fk
from bunraku.figure.mannequin import MEDIUM, build
from bunraku.msgs import Overlay, Pose, Primitive
from bunraku.msgs.figure import Contacts
from bunraku.nodes.web.mesh import pack_mesh
from bunraku.nodes.web.protocol import (
    CAMERA,
    OVERLAY,
    POSE,
    pack_bundle,
    pack_camera,
    pack_overlay,
    pack_pose,
    with_echo,
)
from bunraku.nodes.web.takes import read_track
from bunraku.runtime.bag import BagWriter, Channel

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "nodes" / "web" / "page"


def write_sample(folder: Path) -> None:
    """Bytes as the page gets them, and in words what is in them."""
    rng = np.random.default_rng(5)
    figure = default_figure()
    rotations = rng.normal(size=(len(figure), 4))
    rotations /= np.linalg.norm(rotations, axis=1, keepdims=True)
    root = np.array([0.25, 1.0, -0.5])
    pose = Pose(
        skeleton=figure.hash, root=root, rotations=rotations, seq=12, stamp=1_700_000_000_123_456_789,
        contacts=Contacts(right_foot=True),
    )  # fmt: skip
    camera = default_camera(1.5)
    overlay = Overlay(
        primitives=[
            Primitive(kind="circle", space="screen", points=[(0.5, 0.5)], label="finger ä"),
            Primitive(kind="line", points=[(1, 2, 3), (4, 5, 6)]),
            Primitive(kind="text", space="panel", points=[], label="none"),
        ]
    )
    parts = [
        (POSE, 0, with_echo(pack_pose(pose), 4321.25)),
        (CAMERA, 0, pack_camera(camera)),
        (OVERLAY, 0, pack_overlay("overlay/test", overlay)),
        (POSE, 1, pack_pose(pose)),
    ]
    (folder / "bundle.bin").write_bytes(pack_bundle(7, parts))
    (folder / "mesh.bin").write_bytes(pack_mesh(figure))
    mesh = build(figure, MEDIUM)
    places, _ = fk(figure, root, rotations)
    vertices = [0, 1, 2, 1000, len(mesh.positions) - 1]
    points = [[0.0, 1.0, 0.0], [1.0, 0.2, -0.6], [-0.8, 2.0, 1.0]]
    bag = folder / "take-20260101-120000.mcap"
    writer = BagWriter(bag)
    writer.add_channel(Channel("pose", "Pose"))
    for k in range(10):
        said = Pose(
            skeleton=figure.hash,
            root=root + np.array([0.1 * k, 0, 0]),
            rotations=rotations,
            stamp=10**18 + k * 20_000_000,
        )
        writer.write("pose", 10**18 + k * 20_000_000, said.encode())
    writer.close()
    (folder / "track.bin").write_bytes(read_track(bag, "pose").body)
    told: dict[str, Any] = {
        "number": 7,
        "pose": {
            "seq": 12, "feet": 2, "stamp": pose.stamp / 1e6, "echo": 4321.25, "root": root.tolist(),
            "rotations": rotations.ravel().tolist(),
        },
        "camera": {
            "position": camera.position, "rotation": camera.rotation, "yfov": camera.yfov, "aspect": camera.aspect,
        },
        "overlay": [["circle", "finger ä", 1], ["line", "", 2], ["text", "none", 0]],
        "mesh": {
            "counts": [len(mesh.positions), len(mesh.indices), len(capsules(figure).joints)],
            "vertices": [[i, mesh.local[i].tolist(), int(mesh.joints[i])] for i in vertices],
            "triangles": [[i, mesh.indices[i].tolist()] for i in (0, 1, 5000, len(mesh.indices) - 1)],
            "colors": [[i, (mesh.colors[i] * 255).tolist()] for i in vertices],
            "normals": [[i, mesh.normals[i].tolist()] for i in vertices],
        },
        "fk": {
            "parents": figure.parents.tolist(), "offsets": figure.offsets.ravel().tolist(), "root": root.tolist(),
            "rotations": rotations.ravel().tolist(), "positions": np.asarray(places).ravel().tolist(),
        },
        "projected": [[point, share.tolist()] for point, share in zip(points, project(camera, points), strict=True)],
        "track": {
            "counts": [10, len(figure)], "length": 180.0, "at": 90.0,
            "root": [0.7, 1.0, -0.5],
        },
    }  # fmt: skip
    (folder / "told.json").write_text(json.dumps(told))


def test_the_page_reads_what_the_server_writes_and_its_logic_holds(tmp_path: Path) -> None:
    words = javascript.node()
    if words is None:
        pytest.skip("needs node (18 or later): ./install test")
    write_sample(tmp_path)
    run = subprocess.run(
        [*words, "--test", "--test-reporter=tap", *map(str, sorted((ROOT / "tests" / "page").glob("*.test.mjs")))],
        env={**os.environ, "BUNRAKU_PAGE_SAMPLE": str(tmp_path)}, capture_output=True, text=True, timeout=120,
        check=False,
    )  # fmt: skip
    assert run.returncode == 0, run.stdout[-6000:]
    assert "# skipped 0" in run.stdout
    passed = re.search(r"^# pass (\d+)$", run.stdout, re.M)
    assert passed is not None
    assert int(passed[1]) >= 30


def check_types(folder: Path) -> subprocess.CompletedProcess[str]:
    command = javascript.typescript()
    if isinstance(command, str):
        pytest.skip(command)
    return subprocess.run(
        [*command, "-p", str(folder / "jsconfig.json")], env=javascript.environment(), capture_output=True, text=True,
        timeout=150, check=False,
    )  # fmt: skip


def test_the_page_s_types_hold() -> None:
    run = check_types(PAGE)
    assert run.returncode == 0, run.stdout


def test_a_wrong_type_would_be_found(tmp_path: Path) -> None:
    page = Path(shutil.copytree(PAGE, tmp_path / "page"))
    outbox = page / "outbox.js"
    text = outbox.read_text()
    assert "contacts.frame(" in text
    outbox.write_text(text.replace("contacts.frame(", "contacts.frames("))
    run = check_types(page)
    assert run.returncode != 0
    assert "outbox.js" in run.stdout


def test_comments_are_left_out_of_what_is_served_and_code_is_not() -> None:
    from bunraku.nodes.web.files import without_comments

    text = "/**\n * doc\n */\n  /** @type {X} */ (y).z();\n/** line */\nconst a = 1; // gone\n  // gone\nb('//c');\n"
    assert without_comments(text) == "\n\n\n(y).z();\n\nconst a = 1;\n\nb('//c');\n"


def test_what_is_served_is_still_code(tmp_path: Path) -> None:
    from bunraku.nodes.web.files import load_page

    words = javascript.node()
    if words is None:
        pytest.skip("needs node (18 or later): ./install test")
    for path, file in load_page().items():
        if path.endswith(".js"):
            served = tmp_path / path[1:].replace(".js", ".mjs")
            served.write_bytes(file.body)
            assert len(file.body.splitlines()) == len((PAGE / path[1:]).read_bytes().splitlines())
            run = subprocess.run([*words, "--check", str(served)], capture_output=True, text=True, check=False)
            assert run.returncode == 0, run.stderr
