"""Nobody but the stage's own user reaches its sockets."""

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from bunraku.msgs import Target, TopicKind
from bunraku.runtime.names import NameProblem, file_of, make_run_folder
from bunraku.runtime.zmqstage import ZmqStage

CONNECT = """
import os, socket, sys
os.setgroups([]); os.setgid(65534); os.setuid(65534)
try:
    socket.socket(socket.AF_UNIX).connect(sys.argv[1])
except PermissionError:
    sys.exit(13)
"""


class Someone:
    """What a stage asks of a node that only advertises."""

    full_name = "someone"


@pytest.mark.skipif(os.getuid() != 0, reason="only root can act as another user")
def test_another_user_cannot_open_the_sockets(tmp_path: Path) -> None:
    outer = Path("/tmp") / f"bunraku-security-{os.getpid()}"
    outer.mkdir(mode=0o755)
    folder = make_run_folder(outer / "b" / "stage")
    stage = ZmqStage(folder)
    try:
        stage.advertise(Someone(), "pose", TopicKind(Target))  # type: ignore[arg-type]
        path = str(file_of(folder, "pose"))
        socket.socket(socket.AF_UNIX).connect(path)  # its own user can
        assert subprocess.run([sys.executable, "-c", CONNECT, path], check=False).returncode == 13
    finally:
        stage.close()
        folder.rmdir()
        folder.parent.rmdir()
        outer.rmdir()


@pytest.mark.skipif(os.getuid() != 0, reason="only root can make another user's folder")
def test_a_folder_of_another_user_is_refused(tmp_path: Path) -> None:
    (tmp_path / "b" / "stage").mkdir(parents=True)
    os.chown(tmp_path / "b" / "stage", 65534, 65534)
    with pytest.raises(NameProblem, match="is not this user's own folder"):
        make_run_folder(tmp_path / "b" / "stage")


def test_a_link_in_the_folders_place_is_refused(tmp_path: Path) -> None:
    (tmp_path / "b").mkdir()
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "b" / "stage").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(NameProblem):
        make_run_folder(tmp_path / "b" / "stage")


def test_an_open_folder_is_closed(tmp_path: Path) -> None:
    (tmp_path / "b" / "stage").mkdir(parents=True, mode=0o777)
    (tmp_path / "b" / "stage").chmod(0o777)
    assert make_run_folder(tmp_path / "b" / "stage").stat().st_mode & 0o077 == 0
