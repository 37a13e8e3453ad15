"""Two stages on one machine, joined by two bridge processes over tcp."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from bunraku.cli import main
from bunraku.runtime import graph
from bunraku.runtime.control import NoAnswer, ask
from bunraku.runtime.names import run_folder

pytestmark = pytest.mark.stack
CAMERA = '{"position": [0, 1, 4], "rotation": [0, 0, 0, 1], "yfov": 0.8}'


@pytest.fixture
def folders(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Path]:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path_factory.mktemp("r")))
    return run_folder("here"), run_folder("there")


@pytest.fixture
def start() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    running: list[subprocess.Popen[str]] = []

    def begin(folder: Path, *words: str) -> subprocess.Popen[str]:
        running.append(
            subprocess.Popen(
                [sys.executable, "-m", "bunraku.cli", *words],
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                env={**os.environ, "BUNRAKU_STAGE": folder.name},
            )
        )
        return running[-1]

    yield begin
    for process in running:
        process.terminate()
    for process in running:
        process.communicate(timeout=30)


def until(condition: Callable[[], Any], seconds: float = 60.0) -> Any:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if found := condition():
            return found
        time.sleep(0.02)
    raise AssertionError("it did not come")


def status(folder: Path) -> dict[str, Any]:
    try:
        return ask(folder, "bridge", "status")
    except NoAnswer:
        return {}


def bridge(**params: str) -> list[str]:
    return ["run", "bridge", *(word for key, value in params.items() for word in ("--set", f"{key}:={value}"))]


def echo(folder: Path, topic: str, count: int = 1) -> list[dict[str, Any]]:
    done = subprocess.run(
        [sys.executable, "-m", "bunraku.cli", "topic", "echo", topic, "-n", str(count), "--timeout", "30"],
        capture_output=True,
        text=True,
        timeout=60,
        env={**os.environ, "BUNRAKU_STAGE": folder.name},
    )
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def joined(folders: tuple[Path, Path], start: Callable[..., Any], **keys: str) -> None:
    here, there = folders
    start(here, *bridge(listen="0", **({"keys": keys["here"]} if keys else {})))
    address = until(lambda: status(here).get("endpoint"))
    start(there, *bridge(connect=address, **({"keys": keys["there"]} if keys else {})))
    until(lambda: status(here).get("peers") and status(there).get("peers"))


def test_topics_go_both_ways_under_their_names(folders, start):
    here, there = folders
    joined(folders, start)
    start(here, "topic", "pub", "camera", CAMERA, "--rate", "0.1", "--no-wait")  # latched, and said once
    start(there, "topic", "pub", "alice/target", '{"yaw": 0.5}', "--rate", "100", "--no-wait")
    (camera,) = echo(there, "camera")
    assert camera["position"] == [0, 1, 4]
    told = echo(here, "alice/target", 5)
    assert all(one["yaw"] == 0.5 for one in told)
    # whoever comes later is given what is latched, on the other side too
    assert echo(there, "camera")[0]["stamp"] == camera["stamp"]
    # the bodies are those that were said, stamps and sequence included
    assert all(one["origin"] == one["stamp"] for one in told)
    said = {topic.name: topic.node for topic in graph.topics(there)}
    assert said["camera"] == "bridge"
    assert said["alice/target"] == "topic_pub"


def test_keys_join_and_an_unknown_key_is_refused(folders, start, tmp_path):
    here, there = folders
    one, two, mallory = (str(tmp_path / name) for name in ("one", "two", "mallory"))
    assert main(["keys", one]) == 0
    Path(two).mkdir(mode=0o700)
    for name in ("connect.key_secret", "listen.key"):
        (Path(two) / name).write_bytes((Path(one) / name).read_bytes())
        (Path(two) / name).chmod(0o600)
    assert main(["keys", mallory, "--name", "mallory"]) == 0
    (Path(mallory) / "listen.key").write_bytes((Path(one) / "listen.key").read_bytes())
    joined(folders, start, here=one, there=two)
    start(here, "topic", "pub", "camera", CAMERA, "--rate", "0.1", "--no-wait")
    assert echo(there, "camera")
    elsewhere = run_folder("elsewhere")
    start(elsewhere, *bridge(connect=status(here)["endpoint"], keys=mallory))
    until(lambda: status(here)["denied"])
    assert status(here)["peers"] == 1
    assert status(elsewhere)["topics"] == []


@pytest.mark.parametrize("side", ["listen", "connect"])
def test_tcp_without_keys_is_refused_away_from_this_machine(folders, start, side):
    process = start(folders[0], *bridge(**{side: "0.0.0.0:7447"}))
    _, err = process.communicate(timeout=60)
    assert process.returncode == 1
    (line,) = err.splitlines()
    assert f"{side}: 0.0.0.0:7447 without keys: anybody on the network could read and move the figure" in line
    assert "bunraku keys DIR" in line
    assert not list(folders[0].glob("*"))


def test_what_came_from_the_other_side_is_not_sent_back(folders, start):
    here, there = folders
    joined(folders, start)
    start(here, "topic", "pub", "target", '{"yaw": 1}', "--rate", "50", "--no-wait")
    until(lambda: "target" in {topic.name for topic in graph.topics(there)})
    start(there, "topic", "pub", "pad", '{"device": "p", "axes": [], "buttons": []}', "--rate", "50", "--no-wait")
    until(lambda: "pad" in {topic.name for topic in graph.topics(here)})
    assert status(here)["topics"] == ["pad"]
    assert status(there)["topics"] == ["target"]
