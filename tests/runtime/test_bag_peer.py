"""A bag read by an independent reader in another language: @mcap/core under Node.js."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import pytest

from bunraku.msgs import Camera, Target
from bunraku.runtime.bag import BagWriter
from bunraku.runtime.bag.recover import recover

pytestmark = pytest.mark.peer
T0 = 1_700_000_000_000_000_000
PACKAGES = ["@mcap/core@2", "fzstd@0.1", "@msgpack/msgpack@3"]
READ = """
import { McapIndexedReader } from "@mcap/core";
import { decompress } from "fzstd";
import { decode } from "@msgpack/msgpack";
import { open } from "node:fs/promises";

const file = await open(process.argv[2]);
const readable = {
  size: async () => BigInt((await file.stat()).size),
  read: async (offset, length) => {
    const bytes = new Uint8Array(Number(length));
    await file.read(bytes, 0, bytes.length, Number(offset));
    return bytes;
  },
};
const zstd = (data, size) => decompress(data, new Uint8Array(Number(size)));
const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers: { zstd } });
const told = { profile: reader.header.profile, topics: {}, metadata: [] };
told.count = Number(reader.statistics.messageCount);
for await (const message of reader.readMessages()) {
  const channel = reader.channelsById.get(message.channelId);
  const schema = reader.schemasById.get(channel.schemaId);
  const topic = (told.topics[channel.topic] ??= {
    encoding: channel.messageEncoding,
    latched: channel.metadata.get("latched"),
    schema: schema && [schema.name, schema.encoding, Object.keys(JSON.parse(new TextDecoder().decode(schema.data)))],
    seen: [],
  });
  topic.seen.push([decode(message.data).seq, message.sequence, String(message.logTime), String(message.publishTime)]);
}
for await (const metadata of reader.readMetadata()) told.metadata.push(metadata.name);
console.log(JSON.stringify(told));
"""


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("node")
    npm = shutil.which("npm")
    if npm is None or shutil.which("node") is None:
        pytest.skip("Node.js and npm are not installed")
    words = [npm, "install", "--silent", "--no-audit", "--no-fund", "--prefix", str(folder), *PACKAGES]
    try:
        done = subprocess.run(words, capture_output=True, text=True, timeout=90, cwd=folder)
    except subprocess.TimeoutExpired:
        pytest.skip("npm install took too long")
    if done.returncode:
        pytest.skip(f"npm install failed: {done.stderr.strip()[-200:]}")
    (folder / "read.mjs").write_text(READ)
    return folder / "read.mjs"


def read(reader: Path, bag: Path) -> dict:
    done = subprocess.run(["node", str(reader), str(bag)], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize("compression", ["zstd", "none"])
def test_another_language_reads_all_of_a_bag(reader: Path, tmp_path: Path, compression: str) -> None:
    path = tmp_path / "a.mcap"
    with BagWriter(path, compression=compression) as writer:
        view = Camera(stamp=T0, position=(0, 1, 3), rotation=(0, 0, 0, 1), yfov=0.9, aspect=1.5)
        writer.write("camera", T0 + 1, view.encode())
        for seq in range(3000):
            body = Target(stamp=T0 + seq * 1000, seq=seq, pelvis=(0.0, seq / 7, 1.0)).encode()
            writer.write("target", T0 + seq * 1000 + 5, body)
    told = read(reader, path)
    assert (told["profile"], told["count"]) == ("bunraku", 3001)
    assert told["metadata"] == ["bunraku.session", "bunraku.statistics"]
    target, camera = told["topics"]["target"], told["topics"]["camera"]
    assert (target["encoding"], target["latched"], camera["latched"]) == ("msgpack", "false", "true")
    assert target["schema"][:2] == ["Target", "jsonschema"]
    assert "$defs" in target["schema"][2]
    expected = [[seq, seq, str(T0 + seq * 1000 + 5), str(T0 + seq * 1000)] for seq in range(3000)]
    assert target["seen"] == expected


def test_another_language_reads_a_mended_bag(reader: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    writer = BagWriter(path)
    for seq in range(1000):
        writer.write("target", T0 + seq, Target(stamp=T0, seq=seq).encode())
    writer.flush()
    shutil.copy(path, tmp_path / "killed.mcap")
    writer.close()
    with (tmp_path / "killed.mcap").open("ab") as file:
        file.write(os.urandom(100))
    recover(tmp_path / "killed.mcap", tmp_path / "b.mcap")
    told = read(reader, tmp_path / "b.mcap")
    assert [row[0] for row in told["topics"]["target"]["seen"]] == list(range(1000))
