"""A batch that somebody stops as people do: Ctrl-C, kill, a terminal that is closed, a pipe nobody reads."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

from picktree.apps.batch import RESULTS_FILE, Store

from ..batch.processes import alive
from ..commands import PATIENCE, Command, Streams, Terminal, until

PLUGIN = """\
import os, time
from pathlib import Path

from picktree.trees import Skill, Steps
from picktree.robot import World


class Work(Skill):
    \"\"\"Go on until somebody says that it is done.\"\"\"

    def run(self, world: World) -> Steps:
        yield
        (Path({here!r}) / "job").write_text(str(os.getpid()))
        while not (Path({here!r}) / "done").exists():
            time.sleep(0.02)


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


def batch(folder: Path) -> list[str]:
    """Words of a batch of three jobs on one worker, each of which ends when the file `done` is there."""
    (folder / "work.py").write_text(PLUGIN.format(here=str(folder)))
    (folder / "mission.yaml").write_text(MISSION)
    options = ["--mission", str(folder / "mission.yaml"), "--seeds", "0:3", "--backend", "kinematic"]
    return ["batch", "run", *options, "--workers", "1", "--out", str(folder / "batch")]


def job(folder: Path) -> int:
    """Process of the job that runs; 0 before there is one."""
    file = folder / "job"
    return int((file.read_text() if file.exists() else "") or 0)


def counts(folder: Path) -> tuple[tuple[object, ...], ...]:
    with Store(folder / "batch" / RESULTS_FILE) as store:
        return store.query("SELECT status, count(*) FROM jobs GROUP BY status ORDER BY status").rows


def left(folder: Path) -> list[Path]:
    return list((folder / "batch/jobs").iterdir())


def test_ctrl_c_finishes_what_runs(tmp_path: Path) -> None:
    terminal = Terminal(batch(tmp_path))
    terminal.wait(lambda: job(tmp_path) > 0, "a job")
    terminal.press(b"\x03")
    terminal.until("stopping")
    (tmp_path / "done").touch()
    assert terminal.end() == 130
    assert "stopping: 1 job under way; Ctrl-C again breaks off" in terminal.shown
    assert "1 of 3 jobs run" in terminal.shown
    assert "go on         picktree batch run --resume " in terminal.shown
    assert counts(tmp_path) == (("success", 1), ("waiting", 2))
    assert left(tmp_path) == []


def test_ctrl_c_twice_stops_at_once(tmp_path: Path) -> None:
    terminal = Terminal(batch(tmp_path))
    terminal.wait(lambda: job(tmp_path) > 0, "a job")
    terminal.press(b"\x03")
    terminal.until("stopping")
    terminal.press(b"\x03")
    assert terminal.end() == 130
    assert counts(tmp_path) == (("waiting", 3),)
    assert not alive({job(tmp_path)})
    assert left(tmp_path) == []


def test_a_terminal_that_is_closed_lets_finish_what_runs(tmp_path: Path) -> None:
    terminal = Terminal(batch(tmp_path))
    terminal.wait(lambda: job(tmp_path) > 0, "a job")
    terminal.close()
    (tmp_path / "done").touch()
    assert terminal.end_after_closing() == 130
    assert counts(tmp_path) == (("success", 1), ("waiting", 2))
    assert left(tmp_path) == []


def test_a_batch_that_is_terminated_takes_its_jobs_with_it(tmp_path: Path) -> None:
    command = Command(batch(tmp_path), Streams(0, 1, 2))
    until(lambda: job(tmp_path) > 0, "a job")
    os.kill(command.pid, signal.SIGTERM)
    assert command.end() == 130
    assert counts(tmp_path) == (("waiting", 3),)
    until(lambda: not alive({job(tmp_path)}), "the end of the job")


def test_a_batch_that_is_killed_takes_its_jobs_with_it(tmp_path: Path) -> None:
    """As a shell starts it: an interpreter for the batch, and one for its worker."""
    process = subprocess.Popen(
        [sys.executable, "-m", "picktree", *batch(tmp_path)], stdout=subprocess.DEVNULL
    )
    until(lambda: job(tmp_path) > 0, "a job")
    process.kill()
    assert process.wait(PATIENCE) == -signal.SIGKILL
    assert counts(tmp_path) == (("waiting", 3),)
    until(lambda: not alive({job(tmp_path)}), "the end of the job")


def test_a_reader_who_leaves_does_not_end_the_batch(tmp_path: Path) -> None:
    (tmp_path / "done").touch()
    reading, writing = os.pipe()
    with tempfile.TemporaryFile() as errors, open(reading) as told:
        streams = Streams(0, writing, errors.fileno(), closed=(reading,))
        command = Command(batch(tmp_path), streams)
        os.close(writing)
        assert told.readline() == f"3 jobs, 1 worker; in {tmp_path}/batch\n"
        told.close()
        assert command.end() == 0
        errors.seek(0)
        assert errors.read() == b"the reader is gone; the batch continues, and Ctrl-C stops it\n"
    assert counts(tmp_path) == (("success", 3),)
