"""Jobs: commands of picktree as processes of their own, started, watched and stopped from the page.

A process has a session of its own and writes into files, so that it needs neither the page nor the server.
"""

from __future__ import annotations

import asyncio
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Literal, TypeAlias

from ..errors import PicktreeError
from .calls import JsonValue, call, watch
from .workspace import Workspace

MAX_JOBS: Final = 4
"""Number of jobs that may run at once."""
MIN_FREE: Final = 500_000_000
"""Free space on the disk below which no job is started, bytes."""
MAX_KEPT: Final = 100
"""Number of jobs that are listed; beyond it the oldest that ended is forgotten."""
STATUS_VARIABLE: Final = "PICKTREE_STATUS"
"""Environment variable that makes commands write their status line where stderr is no terminal."""
_GRACE: Final = 20.0
"""Time for a stopped job to end by itself, wall s."""
_OUTPUT_SHOWN: Final = 20_000
_PERIOD: Final = 0.25
_CONTROL: Final = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")

Outcome: TypeAlias = Literal["running", "done", "no", "failed", "stopped"]
"""`no`: exit code 1, which is the answer no; `failed`: bad input or a fault."""


@dataclass
class Job:
    """One command that runs or has run."""

    number: int
    title: str
    command: tuple[str, ...]
    """Words after `picktree`."""
    output: Path
    """File with what it wrote on stdout and stderr."""
    result: str = ""
    """Address in the page of what it makes, as `#/run/…` or `/files/…`; empty: none is known."""
    began: float = field(default_factory=time.time)
    ended: float | None = None
    outcome: Outcome = "running"
    keeps_on: bool = False
    """Whether it goes on when the server ends."""
    finish: Callable[[Job], None] | None = None
    """Called when it has ended, as to find its result."""
    process: subprocess.Popen[bytes] | None = None

    def to_json(self) -> dict[str, JsonValue]:
        return {
            "number": self.number,
            "title": self.title,
            "command": " ".join(["picktree", *self.command]),
            "result": self.result,
            "began": self.began,
            "ended": self.ended,
            "outcome": self.outcome,
            "progress": last_line(self.output),
        }

    def text(self) -> str:
        """Return the end of what it wrote, without control characters of terminals."""
        with suppress(OSError):
            return _plain(_tail(self.output, _OUTPUT_SHOWN))
        return ""


def last_line(file: Path) -> str:
    """Return the last line of an output that is not empty, such as a status line that was written over."""
    with suppress(OSError):
        lines = [line.strip() for line in _plain(_tail(file, 4000)).splitlines()]
        return next((line for line in reversed(lines) if line), "")[:300]
    return ""


def _tail(file: Path, size: int) -> str:
    with file.open("rb") as opened:
        opened.seek(max(0, os.fstat(opened.fileno()).st_size - size))
        return opened.read().decode("utf-8", "replace")


def _plain(text: str) -> str:
    """Return an output as a terminal shows it in the end: of a line that was written over, the last state.

    >>> _plain("\\r\\x1b[2Kframe 1 of 2\\r\\x1b[2Kframe 2 of 2\\r\\x1b[2Kfilm.mp4: 2 frames\\n")
    'film.mp4: 2 frames\\n'
    """
    lines = _CONTROL.sub("", text).split("\n")
    return "\n".join(line.rsplit("\r", 1)[-1] for line in lines)


class Jobs:
    """Jobs of one server."""

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self._jobs: dict[int, Job] = {}
        self._changed = asyncio.Event()
        self._waiting: set[asyncio.Task[None]] = set()
        self._folder = workspace.state.place / "jobs"

    def start(
        self,
        title: str,
        command: Sequence[str],
        *,
        result: str = "",
        keeps_on: bool = False,
        finish: Callable[[Job], None] | None = None,
    ) -> Job:
        """Start a command in the folder. Paths in it are absolute, so that none is taken for an option.

        Raises PicktreeError when too many are running, or the disk is nearly full.
        """
        running = [job for job in self._jobs.values() if job.ended is None]
        if len(running) >= MAX_JOBS:
            raise PicktreeError(f"{MAX_JOBS} jobs are running; wait for one, or stop one")
        free = shutil.disk_usage(self._workspace.root).free
        if free < MIN_FREE:
            raise PicktreeError(f"the disk has {free / 1e6:.0f} MB left; make room before starting more")
        number = max(self._jobs, default=0) + 1
        self._folder.mkdir(exist_ok=True, mode=0o700)
        output = self._folder / f"{os.getpid()}-{number}.txt"
        job = Job(number, title, tuple(command), output, result, keeps_on=keeps_on, finish=finish)
        with output.open("wb") as opened:
            job.process = subprocess.Popen(
                # -P: nothing is imported from the folder, whatever it holds.
                [sys.executable, "-P", "-m", "picktree", *command],
                cwd=self._workspace.root,
                stdin=subprocess.DEVNULL,
                stdout=opened,
                stderr=opened,
                start_new_session=True,
                env={**os.environ, STATUS_VARIABLE: "1", "PYTHONSAFEPATH": "1"},
            )
        self._jobs[number] = job
        self._forget_old()
        task = asyncio.get_running_loop().create_task(self._wait(job))
        self._waiting.add(task)
        task.add_done_callback(self._waiting.discard)
        self._tell()
        return job

    async def ended(self, job: Job) -> Job:
        """Wait for the end of a job."""
        while job.ended is None:
            await asyncio.sleep(0.05)
        return job

    async def _wait(self, job: Job) -> None:
        process = job.process
        assert process is not None
        while process.poll() is None:
            await asyncio.sleep(0.1)
        code = process.returncode
        if job.outcome == "running":
            job.outcome = "done" if code == 0 else "no" if code == 1 else "failed"
        if job.finish is not None:
            job.finish(job)
        job.ended = time.time()
        self._tell()

    def _tell(self) -> None:
        self._changed.set()
        self._changed = asyncio.Event()

    def _forget_old(self) -> None:
        over = len(self._jobs) - MAX_KEPT
        for number, job in list(self._jobs.items()):
            if over > 0 and job.ended is not None:
                del self._jobs[number]
                job.output.unlink(missing_ok=True)
                over -= 1

    def _job(self, number: int) -> Job:
        if number not in self._jobs:
            raise PicktreeError(f"there is no job {number}")
        return self._jobs[number]

    @call("jobs.stop")
    async def stop(self, number: int) -> None:
        """Interrupt a job as Ctrl-C does; when it does not end, kill it and its children."""
        job = self._job(number)
        process = job.process
        if process is None or job.ended is not None:
            return
        job.outcome = "stopped"
        _signal(process, signal.SIGINT)
        end = time.monotonic() + _GRACE
        while process.poll() is None and time.monotonic() < end:
            await asyncio.sleep(0.05)
        if process.poll() is None:
            _signal(process, signal.SIGKILL)

    @call("jobs.output")
    async def output(self, number: int) -> str:
        """Return the end of what a job wrote."""
        return await asyncio.to_thread(self._job(number).text)

    @watch("jobs.watch")
    async def jobs(self) -> AsyncIterator[JsonValue]:
        """Yield all jobs, newest first, whenever one of them changes."""
        before: list[JsonValue] | None = None
        while True:
            changed = self._changed
            now: list[JsonValue] = [job.to_json() for job in reversed(self._jobs.values())]
            if now != before:
                yield now
                before = now
            running = any(job.ended is None for job in self._jobs.values())
            with suppress(TimeoutError):
                await asyncio.wait_for(changed.wait(), _PERIOD if running else None)

    async def close(self) -> None:
        """End the jobs that do not go on without the server."""
        for job in list(self._jobs.values()):
            if job.ended is None and not job.keeps_on and job.process is not None:
                job.outcome = "stopped"
                _signal(job.process, signal.SIGTERM)
        for task in list(self._waiting):
            task.cancel()


def _signal(process: subprocess.Popen[bytes], number: signal.Signals) -> None:
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, number)
