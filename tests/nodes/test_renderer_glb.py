import json
import os
import shutil
import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest

from bunraku.figure.default import default_figure
from bunraku.figure.fk import fk
from bunraku.figure.mannequin import LOW
from bunraku.figure.mesh import matrices
from bunraku.nodes.renderer.glb import glb, save_glb

FIGURE = default_figure()


def motion(frames=30, seed=3):
    random = np.random.default_rng(seed)
    axes = random.normal(size=(len(FIGURE), 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    angle = np.sin(np.linspace(0, 2 * np.pi, frames))[:, None] * random.uniform(0.1, 1.0, len(FIGURE))
    rotations = np.concatenate([axes * np.sin(angle / 2)[..., None], np.cos(angle / 2)[..., None]], axis=-1)
    rotations[::3] *= -1.0  # the same rotations
    roots = np.column_stack([np.linspace(0, 1, frames), np.full(frames, 0.95), np.zeros(frames)])
    return roots, rotations


def parse(body):
    magic, version, length = struct.unpack_from("<4sII", body)
    assert (magic, version, length) == (b"glTF", 2, len(body))
    size, kind = struct.unpack_from("<I4s", body, 12)
    assert kind == b"JSON"
    document = json.loads(body[20 : 20 + size])
    more, kind = struct.unpack_from("<I4s", body, 20 + size)
    assert kind == b"BIN\0"
    data = body[28 + size : 28 + size + more]
    types = {5126: "<f4", 5123: "<u2", 5125: "<u4", 5121: "u1"}
    widths = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}

    def read(index):
        accessor = document["accessors"][index]
        view = document["bufferViews"][accessor["bufferView"]]
        width = widths[accessor["type"]]
        kind = types[accessor["componentType"]]
        flat = np.frombuffer(data, kind, accessor["count"] * width, view["byteOffset"])
        return flat.reshape(accessor["count"], width)

    return document, read


def played(document, read, frame):
    """World matrices (J, 4, 4) of the skin's joints at a frame, by glTF's rules alone."""
    local = {}
    for index, node in enumerate(document["nodes"]):
        local[index] = {
            "translation": np.array(node.get("translation", (0, 0, 0))),
            "rotation": np.array((0, 0, 0, 1.0)),
        }
    animation = document["animations"][0]
    for channel in animation["channels"]:
        sampler = animation["samplers"][channel["sampler"]]
        local[channel["target"]["node"]][channel["target"]["path"]] = read(sampler["output"])[frame].astype(float)
    world = {}

    def place(index, above):
        here = np.eye(4)
        here[:3, :3] = matrices(local[index]["rotation"][None])[0]
        here[:3, 3] = local[index]["translation"]
        world[index] = above @ here
        for child in document["nodes"][index].get("children", ()):
            place(child, world[index])

    for index in document["scenes"][0]["nodes"]:
        place(index, np.eye(4))
    return np.array([world[j] for j in document["skins"][0]["joints"]])


def test_a_player_sees_the_joints_where_the_kinematics_puts_them():
    roots, rotations = motion()
    document, read = parse(glb(FIGURE, roots, rotations, 30.0, LOW))
    positions, _ = fk(FIGURE, roots, rotations)
    for frame in (0, 7, 29):
        world = played(document, read, frame)
        np.testing.assert_allclose(world[:, :3, 3], positions[frame], atol=2e-6)


def test_the_skin_moves_the_vertices_as_the_renderer_does():
    from bunraku.figure.mannequin import build

    roots, rotations = motion()
    document, read = parse(glb(FIGURE, roots, rotations, 30.0, LOW))
    attributes = document["meshes"][0]["primitives"][0]["attributes"]
    vertices = read(attributes["POSITION"]).astype(float)
    joints, weights = read(attributes["JOINTS_0"]), read(attributes["WEIGHTS_0"])
    binds = read(document["skins"][0]["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
    assert (weights[:, 0] == 1.0).all()
    skin = (played(document, read, 11) @ binds)[joints[:, 0]]
    moved = np.einsum("nij,nj->ni", skin[:, :3, :3], vertices) + skin[:, :3, 3]
    expected = build(FIGURE, LOW).skin(*fk(FIGURE, roots[11], rotations[11]))[:, :3]
    np.testing.assert_allclose(moved, expected, atol=1e-5)


def test_time_and_signs_run_smoothly():
    roots, rotations = motion()
    document, read = parse(glb(FIGURE, roots, rotations, 24.0, LOW))
    samplers = document["animations"][0]["samplers"]
    np.testing.assert_allclose(read(samplers[0]["input"])[:, 0], np.arange(30) / 24.0, atol=1e-6)
    for sampler in samplers[1:]:
        turns = read(sampler["output"])
        assert (np.sum(turns[1:] * turns[:-1], axis=1) > 0.0).all()


def test_shapes_that_do_not_fit_are_refused():
    roots, rotations = motion(4)
    with pytest.raises(ValueError, match="expected roots"):
        glb(FIGURE, roots[:3], rotations, 30.0)
    with pytest.raises(ValueError, match="expected roots"):
        glb(FIGURE, roots[:0], rotations[:0], 30.0)
    with pytest.raises(ValueError, match="fps"):
        glb(FIGURE, roots, rotations, 0.0)


VALIDATE = """
const validator = require("gltf-validator"), fs = require("fs");
validator.validateBytes(new Uint8Array(fs.readFileSync(process.argv[2])))
  .then(report => console.log(JSON.stringify(report.issues)));
"""


@pytest.mark.peer
def test_the_khronos_validator_finds_nothing(tmp_path):
    """`npm install gltf-validator` in the folder BUNRAKU_NODE_MODULES, or a download into the temporary one."""
    if shutil.which("node") is None or shutil.which("npm") is None:
        pytest.skip("needs node and npm")
    home = Path(os.environ.get("BUNRAKU_NODE_MODULES", tmp_path))
    if not (home / "node_modules" / "gltf-validator").exists():
        done = subprocess.run(
            ["npm", "install", "--no-audit", "--no-fund", "gltf-validator@2.0.0-dev.3.10"],
            cwd=home,
            capture_output=True,
        )
        if done.returncode:
            pytest.skip("npm cannot install gltf-validator here")
    path = tmp_path / "motion.glb"
    save_glb(path, FIGURE, *motion(), 30.0)
    script = home / "validate.cjs"
    script.write_text(VALIDATE)
    out = subprocess.run(["node", str(script), str(path)], capture_output=True, text=True, check=True, cwd=home)
    issues = json.loads(out.stdout)
    assert issues["numErrors"] == 0, issues["messages"]
    assert issues["numWarnings"] == 0, issues["messages"]
