"""Jobs: commands of picktree as processes of their own, started, watched and stopped from the page, with
records on the disk.
"""

from __future__ import annotations

import asyncio
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final, Literal, TypeAlias, cast

from picktree.files import PicktreeError

from .calls import JsonValue, call, watch
from .job_process import SHORTENED
from .workspace import Workspace

Outcome: TypeAlias = Literal["running", "done", "no", "failed", "stopped"]
"""Outcome of a job. `no`: exit code 1, which is the answer no; `failed`: bad input or a fault."""
_OUTCOMES: Final = frozenset({"running", "done", "no", "failed", "stopped"})


@dataclass(frozen=True, slots=True)
class ProcessMark:
    """Identity of a process of this machine, distinct from a later one with the same number."""

    number: int
    began: str
    """Start of the process since the boot, in ticks of the kernel, and the id of the boot."""

    @property
    def alive(self) -> bool:
        """Whether it runs; not when it has ended and nobody has asked for its exit code."""
        return self == mark_of(self.number)


def mark_of(number: int) -> ProcessMark | None:
    """Return the mark of a running process; None without a process of that number."""
    try:
        # After the name, which may hold blanks and brackets: the state, and as the 20th word the start.
        words = Path(f"/proc/{number}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="utf-8").strip()
    except (OSError, ValueError):
        return None
    return None if words[0] in "ZX" else ProcessMark(number, f"{words[19]} {boot}")


@dataclass(slots=True)
class Job:
    """Job: a command that runs or has run, as in its record."""

    number: int
    title: str
    command: tuple[str, ...]
    """Words after `picktree`."""
    output: Path
    """File with its stdout and stderr."""
    began: float = field(default_factory=time.time)
    """Unix time, s."""
    process: ProcessMark | None = None
    """Process of the command, which leads a session of its own; None: it ended at its start."""
    server: ProcessMark | None = None
    result: str = ""
    """Address of its result in the page, as `#/run/…` or `/files/…`; empty: unknown."""
    finish: str = ""
    """Name of the function that completes the result at the end; empty: none."""
    keeps_on: bool = False
    """Whether it keeps running when the server ends by itself."""
    ended: float | None = None
    """Unix time, s."""
    outcome: Outcome = "running"


class JobRecords:
    """Folder of records: `N.json`, with the output `N.txt` and the exit code `N.code` beside it."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def new_number(self, known: int) -> int:
        """Return a number above `known` that no other server has, and keep it."""
        self._folder.mkdir(exist_ok=True, mode=0o700)
        number = max([known, *self._numbers()]) + 1
        while True:
            with suppress(FileExistsError):
                os.close(os.open(self.output(number), os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600))
                return number
            number += 1

    def output(self, number: int) -> Path:
        return self._folder / f"{number}.txt"

    def code_file(self, number: int) -> Path:
        return self._folder / f"{number}.code"

    def exit_code(self, number: int) -> int | None:
        """Return the exit code of a job; None when its process was killed before it had one."""
        with suppress(OSError, ValueError):
            return int(self.code_file(number).read_text(encoding="utf-8"))
        return None

    def write(self, job: Job) -> None:
        """Keep the record of a job. A disk that refuses costs only that another server finds the job."""
        file = self._folder / f"{job.number}.json"
        with suppress(OSError):
            beside = file.with_suffix(".new")
            beside.write_text(json.dumps(asdict(job), default=str), encoding="utf-8")
            beside.replace(file)

    def read(self) -> Iterator[Job]:
        """Yield the records, the oldest first. A record that cannot be read is left out."""
        for number in self._numbers():
            with suppress(OSError, ValueError, TypeError, KeyError):
                found: object = json.loads((self._folder / f"{number}.json").read_text(encoding="utf-8"))
                yield _parsed(cast("dict[str, Any]", found))

    def delete(self, number: int) -> None:
        for suffix in ("json", "txt", "code"):
            with suppress(OSError):
                (self._folder / f"{number}.{suffix}").unlink(missing_ok=True)

    def _numbers(self) -> list[int]:
        with suppress(OSError):
            return sorted({int(file.stem) for file in self._folder.iterdir() if file.stem.isdecimal()})
        return []


def _parsed(found: dict[str, Any]) -> Job:
    values = dict(found)
    for name in ("process", "server"):
        values[name] = found[name] and ProcessMark(**found[name])
    values.update(command=tuple(found["command"]), output=Path(found["output"]))
    job = Job(**values)
    if job.outcome not in _OUTCOMES:
        raise ValueError(job.outcome)
    return job


async def command_answer(
    words: Sequence[str],
    patience: float,
    *,
    text: str = "",
    folder: Path | None = None,
    codes: tuple[int, ...] = (0,),
) -> bytes:
    """Run `picktree WORDS` and return what it prints. Cancelling kills its process group.

    patience: s. text: its standard input. folder: where it runs. codes: exit codes of success. Raises
    PicktreeError with what the command said when it failed, or when it takes longer than `patience`.
    """
    name = " ".join(words[:2])
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-P", "-m", "picktree", *words,
        cwd=folder,
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        start_new_session=True,
        env={**os.environ, "PYTHONSAFEPATH": "1"},
    )  # fmt: skip
    try:
        out, errors = await asyncio.wait_for(process.communicate(text.encode()), patience)
    except TimeoutError:
        raise PicktreeError(f"{name} took longer than {patience:.0f} s") from None
    finally:
        if process.returncode is None:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            await process.wait()
    if process.returncode not in codes:
        message = errors.decode("utf-8", "replace").strip()[-2000:]
        raise PicktreeError(message or f"picktree {name} failed")
    return out


MAX_JOBS: Final = 4
"""Number of jobs that may run at once."""
MIN_FREE: Final = 500_000_000
"""Free space on the disk below which no job is started, bytes."""
MAX_KEPT: Final = 100
"""Number of jobs that are listed; beyond it the oldest that ended is forgotten."""
STATUS_VARIABLE: Final = "PICKTREE_STATUS"
"""Environment variable that makes commands write their status line where stderr is no terminal."""
_JOB_MODULE: Final = f"{__package__}.job_process"
_STOP_TIMEOUT: Final = 20.0
"""Time for a stopped job to end by itself, wall s."""
_OUTPUT_SHOWN: Final = 20_000
_PERIOD: Final = 0.25
_CONTROL: Final = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


def job_json(job: Job) -> dict[str, JsonValue]:
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
    """Return the end of a job's output, without control characters of terminals."""
    with suppress(OSError):
        return _plain(_tail(job.output, _OUTPUT_SHOWN))
    return ""


def shown_output(job: Job) -> str:
    """Return the end of a job's output, below a note when the beginning is left out."""
    text = job_text(job)
    with suppress(OSError), job.output.open("rb") as opened:
        size = os.fstat(opened.fileno()).st_size
        if size > _OUTPUT_SHOWN:
            first = opened.readline(200).decode("utf-8", "replace")
            shorter = first if first.startswith(SHORTENED) else ""
            return f"{shorter}[the end of {size / 1000:.0f} kB]\n{text}"
    return text


def last_line(file: Path) -> str:
    """Return the last non-empty line of an output, such as an overwritten status line."""
    with suppress(OSError):
        lines = [line.strip() for line in _plain(_tail(file, 4000)).splitlines()]
        return next((line for line in reversed(lines) if line), "")[:300]
    return ""


def _tail(file: Path, size: int) -> str:
    with file.open("rb") as opened:
        opened.seek(max(0, os.fstat(opened.fileno()).st_size - size))
        return opened.read().decode("utf-8", "replace")


def _plain(text: str) -> str:
    """Return the final output on a terminal: of an overwritten line only the last state.

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
        """Keep the changes of a job, for a later server."""
        self._records.write(job)

    def _watch(self, job: Job) -> None:
        task = asyncio.get_running_loop().create_task(self._wait(job))
        self._waiting.add(task)
        task.add_done_callback(self._waiting.discard)

    async def ended(self, job: Job) -> Job:
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
        end = time.monotonic() + _STOP_TIMEOUT
        while self._runs(job) and time.monotonic() < end:
            await asyncio.sleep(0.05)
        if self._runs(job):
            _signal(job, signal.SIGKILL)

    @call("jobs.output")
    async def output(self, number: int) -> str:
        """Return the end of a job's output."""
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
        """End the jobs that do not keep running without the server."""
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
