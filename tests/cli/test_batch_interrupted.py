"""A batch that somebody stops as people do: Ctrl-C, kill, a terminal that is closed, a pipe nobody reads."""

from __future__ import annotations

import os
import pty
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from picktree.batch.store import NAME, Store

PLUGIN = """\
import os, time
from pathlib import Path

from picktree.trees.skill import Skill, Steps
from picktree.world.world import World


class Work(Skill):
    \"\"\"Take a while, of the clock on the wall.\"\"\"

    def run(self, world: World) -> Steps:
        yield
        (Path({here!r}) / "job").write_text(str(os.getpid()))
        time.sleep({seconds})


NODES = (Work,)
"""
MISSION = """\
picktree: 1
kind: mission
name: work
scene: sort_small
goal: left >= 0
plugins: [work.py]
trees:
  Main: Work
"""


def command(folder: Path, seconds: float) -> list[str]:
    """A batch of three jobs that take that long, on one worker."""
    (folder / "work.py").write_text(PLUGIN.format(here=str(folder), seconds=seconds))
    (folder / "mission.yaml").write_text(MISSION)
    options = ["--mission", str(folder / "mission.yaml"), "--seeds", "0:3", "--backend", "kinematic"]
    out = ["--workers", "1", "--out", str(folder / "batch")]
    return [sys.executable, "-m", "picktree", "batch", "run", *options, *out]


class Terminal:
    """One with a program in it, 80 columns wide."""

    def __init__(self, arguments: list[str]) -> None:
        self.pid, self._master = pty.fork()
        if self.pid == 0:
            os.environ.update(TERM="xterm", COLUMNS="80", LINES="24")
            os.execv(arguments[0], arguments)
        os.set_blocking(self._master, False)
        self.shown = ""

    def type(self, keys: bytes) -> None:
        os.write(self._master, keys)

    def close(self) -> None:
        os.close(self._master)

    def until(self, happened: Callable[[], bool]) -> None:
        deadline = time.monotonic() + 60
        while not happened():
            self._read()
            assert time.monotonic() < deadline, self.shown
            time.sleep(0.02)

    def end(self) -> int:
        """The exit code."""
        found: list[int] = []

        def over() -> bool:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            found.append(status)
            return pid != 0

        self.until(over)
        self._read()
        return os.waitstatus_to_exitcode(found[-1])

    def _read(self) -> None:
        try:
            while data := os.read(self._master, 65536):
                self.shown += data.decode(errors="replace")
        except OSError:  # nothing to be read now, or the terminal is closed
            pass


def counts(folder: Path) -> tuple[tuple[object, ...], ...]:
    with Store(folder / "batch" / NAME) as store:
        return store.query("SELECT status, count(*) FROM jobs GROUP BY status ORDER BY status").rows


def ended(pid: int) -> bool:
    return not Path(f"/proc/{pid}").exists()


def left(folder: Path) -> list[Path]:
    return list((folder / "batch/jobs").iterdir())


def test_ctrl_c_finishes_what_runs(tmp_path: Path) -> None:
    terminal = Terminal(command(tmp_path, 1.5))
    terminal.until((tmp_path / "job").exists)
    terminal.type(b"\x03")
    assert terminal.end() == 130
    assert "stopping: 1 job under way; Ctrl-C again breaks off" in terminal.shown
    assert "1 of 3 jobs run" in terminal.shown
    assert f"go on         {shlex.quote(sys.executable)} -m picktree batch run --resume " in terminal.shown
    assert counts(tmp_path) == (("success", 1), ("waiting", 2))
    assert left(tmp_path) == []


def test_ctrl_c_twice_stops_at_once(tmp_path: Path) -> None:
    terminal = Terminal(command(tmp_path, 600))
    terminal.until((tmp_path / "job").exists)
    terminal.type(b"\x03")
    terminal.until(lambda: "stopping" in terminal.shown)
    terminal.type(b"\x03")
    assert terminal.end() == 130
    assert counts(tmp_path) == (("waiting", 3),)
    assert ended(int((tmp_path / "job").read_text()))
    assert left(tmp_path) == []


def test_a_terminal_that_is_closed_lets_finish_what_runs(tmp_path: Path) -> None:
    terminal = Terminal(command(tmp_path, 1.5))
    terminal.until((tmp_path / "job").exists)
    terminal.close()
    assert terminal.end() == 130
    assert counts(tmp_path) == (("success", 1), ("waiting", 2))
    assert left(tmp_path) == []


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_batch_that_is_killed_takes_its_jobs_with_it(tmp_path: Path, number: signal.Signals) -> None:
    process = subprocess.Popen(command(tmp_path, 600), stdout=subprocess.PIPE)
    deadline = time.monotonic() + 60
    while not (tmp_path / "job").exists():
        assert time.monotonic() < deadline
        time.sleep(0.02)
    process.send_signal(number)
    process.communicate(timeout=20)
    assert process.returncode == (130 if number == signal.SIGTERM else -signal.SIGKILL)
    assert counts(tmp_path) == (("waiting", 3),)
    job = int((tmp_path / "job").read_text())
    while not ended(job):
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_a_reader_who_leaves_does_not_end_the_batch(tmp_path: Path) -> None:
    line = f"{shlex.join(command(tmp_path, 0))} | head -1; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (0, f"3 jobs, 1 worker; in {tmp_path}/batch\n")
    assert done.stderr == "nobody reads on; the batch goes on, and Ctrl-C stops it\n"
    assert counts(tmp_path) == (("success", 3),)
