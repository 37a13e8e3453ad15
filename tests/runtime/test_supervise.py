"""Processes: exit statuses, restarts, the ordered end, and that nothing is left behind."""

import io
import os
import re
import select
import signal
import subprocess
import sys
import threading
import time

import pytest

from bunraku.runtime.supervise import Backoff, Supervisor, Task

pytestmark = pytest.mark.stack

QUICK = Backoff(first=0.01, longest=0.02, limit=3)


class Output(io.StringIO):
    """What the supervisor prints; one can wait for a line."""

    def __init__(self) -> None:
        super().__init__()
        self.news = threading.Condition()

    def write(self, text: str) -> int:
        with self.news:
            self.news.notify_all()
            return super().write(text)

    def wait_for(self, pattern: str, timeout: float = 30.0) -> None:
        with self.news:
            assert self.news.wait_for(lambda: re.search(pattern, self.getvalue()), timeout), self.getvalue()


def sh(name: str, script: str, **keys) -> Task:
    return Task(name, ["/bin/sh", "-c", script], **keys)


def run(*tasks: Task, when: str = "", then: tuple[int, ...] = (), **keys) -> tuple[int, str]:
    """Run the tasks; once a line matches ``when``, send ``then`` to this process, as a terminal would."""
    out = Output()
    supervisor = Supervisor(tasks, out=out, color=False, backoff=QUICK, **keys)

    def act() -> None:
        out.wait_for(when)
        for number in then:
            os.kill(os.getpid(), number)
            out.wait_for("ending")

    thread = threading.Thread(target=act)
    if when:
        thread.start()
    status = supervisor.run()
    if when:
        thread.join()
    return status, out.getvalue()


WAIT = "trap 'exit 0' INT TERM; echo ready; while :; do sleep 0.05; done"
DEAF = "trap '' INT TERM; echo ready; while :; do sleep 0.05; done"


def test_lines_are_prefixed_and_aligned():
    status, text = run(sh("a", "echo one; echo two >&2"), sh("longer", "printf 'no end'"))
    assert status == 0
    assert "a      | one\n" in text
    assert "a      | two\n" in text
    assert "longer | no end\n" in text
    assert "\x1b" not in text


def test_colours_differ_by_node():
    out = Output()
    Supervisor([sh("a", "echo x"), sh("b", "echo x")], out=out, color=True).run()
    colours = re.findall(r"\x1b\[(\d+)m[ab] +\| \x1b\[0mx", out.getvalue())
    assert len(set(colours)) == 2


def test_no_colour_away_from_a_terminal(monkeypatch):
    assert not Supervisor([], out=io.StringIO()).color


def test_the_exit_status_is_the_failing_node_s():
    status, text = run(sh("good", "exit 0"), sh("bad", "echo last words; exit 7"))
    assert status == 7
    assert text.splitlines()[-2:] == ["launch | bad ended with status 7; its last lines:", "bad    | last words"]
    assert text.count("last words") == 2


def test_a_required_node_that_ends_ends_the_others():
    status, text = run(sh("main", "exit 3", required=True), sh("other", WAIT))
    assert status == 3
    assert "main is required: ending the others" in text
    status, _ = run(sh("main", "exit 0", required=True), sh("other", WAIT))
    assert status == 0


def test_others_go_on_when_a_node_fails_that_is_not_required(tmp_path):
    done = tmp_path / "done"
    status, _ = run(
        sh("bad", "exit 4"),
        sh("other", f"while ! [ -e {done} ]; do sleep 0.02; done", required=True),
        on_end=lambda pid: done.touch(),
    )
    assert status == 4


def test_a_node_that_cannot_start_ends_the_others():
    status, text = run(sh("a", WAIT), sh("b", "echo no such file; exit 2"), is_up=lambda task, pid: task.name == "a")
    assert status == 2
    assert "b could not start: ending the others" in text


def test_restart_with_a_limit(tmp_path):
    count = tmp_path / "count"
    status, text = run(sh("x", f"echo . >> {count}; exit 9", respawn=True))
    assert status == 9
    assert count.read_text().count(".") == 1 + QUICK.limit
    assert "given up after 3 restarts" in text
    assert "starting again" in text


def test_a_restarted_node_that_then_ends_well_is_no_failure(tmp_path):
    mark = tmp_path / "mark"
    status, text = run(sh("x", f"if [ -e {mark} ]; then exit 0; fi; touch {mark}; kill -9 $$", respawn=True))
    assert status == 0
    assert "killed by SIGKILL; starting again" in text


def test_back_off_doubles_up_to_its_longest():
    backoff = Backoff(first=0.1, longest=1.0)
    assert [backoff.delay(k) for k in range(5)] == pytest.approx([0.1, 0.2, 0.4, 0.8, 1.0])


def test_ctrl_c_ends_all_and_is_no_failure():
    status, text = run(sh("a", WAIT), sh("b", WAIT, respawn=True), when="ready", then=(signal.SIGINT,))
    assert status == 0
    assert "ending" in text


def test_sigterm_ends_all_too():
    status, _ = run(sh("a", WAIT), when="ready", then=(signal.SIGTERM,))
    assert status == 0


def test_a_failure_while_ending_is_told():
    script = "trap 'echo cannot save; exit 5' INT; echo ready; while :; do sleep 0.05; done"
    status, text = run(sh("a", script), when="ready", then=(signal.SIGINT,))
    assert status == 5
    assert text.count("cannot save") == 2


def test_a_deaf_node_is_killed_and_told(monkeypatch):
    monkeypatch.setattr("bunraku.runtime.supervise.TERM_AFTER", 0.2)
    status, text = run(sh("a", DEAF, stop=0.2), when="ready", then=(signal.SIGINT,))
    assert status == 137
    assert "a did not end within 0.4 s and was killed" in text


def test_a_second_ctrl_c_ends_at_once():
    begun = time.monotonic()
    run(sh("a", DEAF, stop=60.0), when="ready", then=(signal.SIGINT, signal.SIGINT))
    assert time.monotonic() - begun < 30.0


def test_a_program_that_is_not_there_is_told():
    status, text = run(Task("x", ["/no/such/program"]))
    assert status == 127
    assert "x cannot be started" in text


def test_a_child_of_a_node_does_not_outlive_it(tmp_path):
    held = tmp_path / "fifo"
    os.mkfifo(held)
    reader = os.open(held, os.O_RDONLY | os.O_NONBLOCK)
    run(sh("x", f"exec 3> {held}; sleep 1000 & exit 0"))
    # end of file: nobody holds the write end any more
    assert select.select([reader], [], [], 30.0)[0]
    assert os.read(reader, 1) == b""
    os.close(reader)


def test_all_up_is_announced_once():
    ups: list[float] = []
    status, _ = run(
        sh("a", WAIT),
        sh("b", WAIT),
        is_up=lambda task, pid: pid > 0,
        on_up=ups.append,
        when="b .*ready",
        then=(signal.SIGINT,),
    )
    assert status == 0
    assert len(ups) == 1


LAUNCHER = """
import sys
from bunraku.runtime.supervise import Supervisor, Task
code = '''
import os, select
print("node", os.getpid(), flush=True)
select.select([int(os.environ["BUNRAKU_LAUNCHER_FD"])], [], [])
'''
Supervisor([Task("n", [sys.executable, "-c", code]), Task("m", [sys.executable, "-c", code])], out=sys.stdout).run()
"""


def test_kill_9_of_the_launcher_leaves_no_node():
    launcher = subprocess.Popen([sys.executable, "-c", LAUNCHER], stdout=subprocess.PIPE, text=True)
    assert launcher.stdout is not None
    pids = [int(launcher.stdout.readline().split()[-1]) for _ in range(2)]
    watched = [os.pidfd_open(pid) for pid in pids]
    launcher.kill()
    launcher.wait()
    for descriptor in watched:
        assert select.select([descriptor], [], [], 30.0)[0], "a node outlived its launcher"
        os.close(descriptor)
    launcher.stdout.close()
