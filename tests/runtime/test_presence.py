"""Who said something is there, ends, dies or makes room for another."""

import json
from pathlib import Path

from bunraku.runtime.lock import Lock
from bunraku.runtime.names import file_of
from bunraku.runtime.presence import Presence

TOPIC = "alice/overlay/interpreter"


class Speaker:
    """What a publisher lays into the run folder."""

    def __init__(self, folder: Path, pid: int) -> None:
        self.card = file_of(folder, TOPIC, ".json")
        self.lock = Lock(file_of(folder, TOPIC, ".lock"))
        self.card.write_text(json.dumps({"pid": pid}))

    def die(self) -> None:
        """As a process that is killed: its card stays."""
        self.lock.release()

    def end(self) -> None:
        self.card.unlink()
        self.die()


def test_who_ended_is_told_once(tmp_path: Path) -> None:
    presence, speaker = Presence(tmp_path), Speaker(tmp_path, 7)
    presence.heard(TOPIC, 1)
    assert presence.gone() == []
    presence.heard(TOPIC, 2)
    assert presence.gone() == []
    speaker.end()
    assert presence.gone() == [TOPIC]
    assert presence.gone() == []


def test_who_was_killed_is_gone_though_its_card_is_there(tmp_path: Path) -> None:
    presence, speaker = Presence(tmp_path), Speaker(tmp_path, 7)
    presence.heard(TOPIC, 1)
    speaker.die()
    assert presence.gone() == [TOPIC]


def begun_anew(folder: Path) -> Presence:
    """Someone spoke, died, and is there again as another process that has said nothing."""
    presence, speaker = Presence(folder), Speaker(folder, 7)
    presence.heard(TOPIC, 40)
    assert presence.gone() == []
    speaker.die()
    Speaker(folder, 8)
    return presence


def test_who_died_and_began_anew_is_gone_until_it_says_something(tmp_path: Path) -> None:
    presence = begun_anew(tmp_path)
    assert presence.gone() == [TOPIC]
    presence.heard(TOPIC, 1)
    assert presence.gone() == []


def test_who_began_anew_and_spoke_at_once_is_there(tmp_path: Path) -> None:
    presence = begun_anew(tmp_path)
    presence.heard(TOPIC, 1)
    assert presence.gone() == []


def test_without_a_run_folder_nobody_goes() -> None:
    presence = Presence(None)
    presence.heard(TOPIC, 1)
    assert presence.gone() == []
