"""The look into the run folder while other nodes come and go."""

import os
import socket
from pathlib import Path

from bunraku.runtime.zmqstage import _topic_of


def test_files_that_vanish_while_the_folder_is_read_are_no_topics(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as one, socket.socket(socket.AF_UNIX) as two:
        one.bind(str(tmp_path / "device.pad"))
        two.bind(str(tmp_path / "device.gone"))
        (tmp_path / "log.renderer.json.123").write_text("{}")
        (tmp_path / "pose.json").write_text("{}")
        with os.scandir(tmp_path) as folder:
            entries = list(folder)
        (tmp_path / "device.gone").unlink()
        (tmp_path / "log.renderer.json.123").unlink()
        assert sorted(filter(None, map(_topic_of, entries))) == ["device/pad", "pose"]
