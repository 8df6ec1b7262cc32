"""Jobs: commands of picktree as processes of their own, started, watched and stopped from the page.

A process has a session of its own and writes into files, so that it needs neither the page nor the server. A
server that starts takes over the jobs of one that was killed, by their records.
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
from pathlib import Path
from typing import Final

from ...files.errors import PicktreeError
from .calls import JsonValue, call, watch
from .job_process import SHORTENED
from .job_records import Job, JobRecords, mark_of
from .workspace import Workspace

MAX_JOBS: Final = 4
"""Number of jobs that may run at once."""
MIN_FREE: Final = 500_000_000
"""Free space on the disk below which no job is started, bytes."""
MAX_KEPT: Final = 100
"""Number of jobs that are listed; beyond it the oldest that ended is forgotten."""
STATUS_VARIABLE: Final = "PICKTREE_STATUS"
"""Environment variable that makes commands write their status line where stderr is no terminal."""
_JOB_MODULE: Final = f"{__package__}.job_process"
_GRACE: Final = 20.0
"""Time for a stopped job to end by itself, wall s."""
_OUTPUT_SHOWN: Final = 20_000
_PERIOD: Final = 0.25
_CONTROL: Final = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


def job_json(job: Job) -> dict[str, JsonValue]:
    """Return a job as the page has it."""
    return {
        "number": job.number,
        "title": job.title,
        "command": " ".join(["picktree", *job.command]),
        "result": job.result,
        "began": job.began,
        "ended": job.ended,
        "outcome": job.outcome,
        "progress": last_line(job.output),
    }


def job_text(job: Job) -> str:
    """Return the end of what a job wrote, without control characters of terminals."""
    with suppress(OSError):
        return _plain(_tail(job.output, _OUTPUT_SHOWN))
    return ""


def shown_output(job: Job) -> str:
    """Return the end of what a job wrote, below a line that says so when there was more."""
    text = job_text(job)
    with suppress(OSError), job.output.open("rb") as opened:
        size = os.fstat(opened.fileno()).st_size
        if size > _OUTPUT_SHOWN:
            first = opened.readline(200).decode("utf-8", "replace")
            shorter = first if first.startswith(SHORTENED) else ""
            return f"{shorter}[the end of {size / 1000:.0f} kB]\n{text}"
    return text


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
        self.finishers: dict[str, Callable[[Job], None]] = {}
        """Functions by the names that jobs have in `finish`: each completes the result at a job's end."""
        self._workspace = workspace
        self._jobs: dict[int, Job] = {}
        self._children: dict[int, subprocess.Popen[bytes]] = {}
        """Processes that this server has started, by job."""
        self._changed = asyncio.Event()
        self._waiting: set[asyncio.Task[None]] = set()
        self._records = JobRecords(workspace.state.place / "jobs")
        self._server = mark_of(os.getpid())

    async def take_over(self) -> list[Job]:
        """List the jobs of servers that have ended, and watch those that still run; return these."""
        taken: list[Job] = []
        for job in await asyncio.to_thread(lambda: list(self._records.read())):
            other = job.server is not None and job.server != self._server and job.server.alive
            if other or job.number in self._jobs:
                continue
            job.server = self._server
            self._jobs[job.number] = job
            if job.ended is None:
                self._records.write(job)
                self._watch(job)
                taken.append(job)
        self._forget_old()
        self._tell()
        return taken

    def start(
        self,
        title: str,
        command: Sequence[str],
        *,
        result: str = "",
        keeps_on: bool = False,
        finish: str = "",
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
        number = self._records.new_number(max(self._jobs, default=0))
        job = Job(
            number,
            title,
            tuple(command),
            self._records.output(number),
            server=self._server,
            result=result,
            finish=finish,
            keeps_on=keeps_on,
        )
        with job.output.open("ab") as opened:
            process = subprocess.Popen(
                # -P: nothing is imported from the folder, whatever it holds.
                [sys.executable, "-P", "-m", _JOB_MODULE, str(self._records.code_file(number)), *command],
                cwd=self._workspace.root,
                stdin=subprocess.DEVNULL,
                stdout=opened,
                stderr=opened,
                start_new_session=True,
                env={**os.environ, STATUS_VARIABLE: "1", "PYTHONSAFEPATH": "1"},
            )
        job.process = mark_of(process.pid)
        self._children[number] = process
        self._jobs[number] = job
        self._records.write(job)
        self._forget_old()
        self._watch(job)
        self._tell()
        return job

    def write(self, job: Job) -> None:
        """Keep what was changed of a job, for a later server."""
        self._records.write(job)

    def _watch(self, job: Job) -> None:
        task = asyncio.get_running_loop().create_task(self._wait(job))
        self._waiting.add(task)
        task.add_done_callback(self._waiting.discard)

    async def ended(self, job: Job) -> Job:
        """Wait for the end of a job."""
        while job.ended is None:
            await asyncio.sleep(0.05)
        return job

    async def _wait(self, job: Job) -> None:
        while self._runs(job):
            await asyncio.sleep(0.1)
        code = self._records.exit_code(job.number)
        if job.outcome == "running":
            job.outcome = "done" if code == 0 else "no" if code == 1 else "failed"
        if job.finish in self.finishers:
            self.finishers[job.finish](job)
        job.ended = time.time()
        self._records.write(job)
        self._tell()

    def _runs(self, job: Job) -> bool:
        child = self._children.get(job.number)
        if child is not None:
            return child.poll() is None
        return job.process is not None and job.process.alive

    def _tell(self) -> None:
        self._changed.set()
        self._changed = asyncio.Event()

    def _forget_old(self) -> None:
        over = len(self._jobs) - MAX_KEPT
        for number, job in list(self._jobs.items()):
            if over > 0 and job.ended is not None:
                del self._jobs[number]
                self._records.delete(number)
                over -= 1

    def _job(self, number: int) -> Job:
        if number not in self._jobs:
            raise PicktreeError(f"there is no job {number}")
        return self._jobs[number]

    @call("jobs.stop")
    async def stop(self, number: int) -> None:
        """Interrupt a job as Ctrl-C does; when it does not end, kill it and its children."""
        job = self._job(number)
        if job.ended is not None or not self._runs(job):
            return
        job.outcome = "stopped"
        self._records.write(job)
        _signal(job, signal.SIGINT)
        end = time.monotonic() + _GRACE
        while self._runs(job) and time.monotonic() < end:
            await asyncio.sleep(0.05)
        if self._runs(job):
            _signal(job, signal.SIGKILL)

    @call("jobs.output")
    async def output(self, number: int) -> str:
        """Return the end of what a job wrote."""
        return await asyncio.to_thread(shown_output, self._job(number))

    @watch("jobs.watch")
    async def jobs(self) -> AsyncIterator[JsonValue]:
        """Yield all jobs, newest first, whenever one of them changes."""
        before: list[JsonValue] | None = None
        while True:
            changed = self._changed
            now: list[JsonValue] = [job_json(job) for job in reversed(self._jobs.values())]
            if now != before:
                yield now
                before = now
            running = any(job.ended is None for job in self._jobs.values())
            with suppress(TimeoutError):
                await asyncio.wait_for(changed.wait(), _PERIOD if running else None)

    async def close(self) -> None:
        """End the jobs that do not go on without the server."""
        for job in list(self._jobs.values()):
            if job.ended is None and not job.keeps_on and self._runs(job):
                job.outcome = "stopped"
                self._records.write(job)
                _signal(job, signal.SIGTERM)
        for task in list(self._waiting):
            task.cancel()


def _signal(job: Job, number: signal.Signals) -> None:
    """Send a signal to a job's process and its children. The process must have been seen to run."""
    if job.process is not None:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(job.process.number, number)
