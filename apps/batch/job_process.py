"""Process of one attempt at a job, isolated from the next job.

The process is forked from a worker that has loaded everything, which costs milliseconds where a fresh one
would cost seconds. Whatever a job changes in its process ends with it: working directory, environment,
locale, random numbers, globals, memory, threads. It has a separate session, so that no Ctrl-C reaches it. It
prints into a file, and its temporary files are in a folder that is deleted with it. Processes that it leaves
behind are ended."""

from __future__ import annotations

import ctypes
import os
import re
import resource
import select
import shutil
import signal
import sys
import tempfile
import time
import traceback
from contextlib import suppress
from importlib import import_module
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from pickle import UnpicklingError
from typing import NoReturn

from picktree.files import PicktreeError, file_system

from . import job_output
from .executor import Event, JobFailed, JobFinished, JobOrder, JobStopped

_PR_SET_PDEATHSIG = 1
_PR_SET_CHILD_SUBREAPER = 36
_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")
_MAX_END_ROUNDS = 100
"""Maximum number of rounds of ending children, each of which may leave children."""


def die_with_parent(number: signal.Signals) -> None:
    """Make this process receive the signal when its parent ends, in whatever way."""
    _prctl(_PR_SET_PDEATHSIG, number)


def adopt_orphans() -> None:
    """Adopt orphaned descendants as children of this process, which can then end them."""
    _prctl(_PR_SET_CHILD_SUBREAPER, 1)


def children(pid: int) -> list[int]:
    found: list[int] = []
    with suppress(OSError):
        for thread in Path(f"/proc/{pid}/task").iterdir():
            with suppress(OSError):
                found += map(int, (thread / "children").read_text().split())
    return found


def resident(pid: int) -> int:
    """Return the resident memory of a process and its descendants, bytes; 0 after its end."""
    try:
        own = int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * _PAGE_BYTES
    except (OSError, IndexError, ValueError):
        return 0
    return own + sum(resident(child) for child in children(pid))


def end_children(expected: int) -> int:
    """End every child of this process with its descendants; return their number besides the expected."""
    count = 0
    for _ in range(_MAX_END_ROUNDS):
        found = children(os.getpid())
        if not found:
            break
        for child in found:
            with suppress(OSError):
                os.kill(child, signal.SIGKILL)
            with suppress(OSError):
                os.waitpid(child, 0)
            count += child != expected
    return count


def exit_code_words(code: int) -> str:
    """Return the end in words for an exit code of `subprocess` or `multiprocessing`: `was ended by
    SIGSEGV`."""
    if code >= 0:
        return f"ended with exit code {code}"
    try:
        return f"was ended by {signal.Signals(-code).name}"
    except ValueError:
        return f"was ended by signal {-code}"


def _prctl(option: int, value: int) -> None:
    ctypes.CDLL(None).prctl(option, value)


def run_attempt(order: JobOrder) -> Event:
    """Run the attempt and write the result's rows. Never raises for a run."""
    try:
        order.folder.mkdir(parents=True, exist_ok=True)
        result = _program_result(order) if order.program else _mission_result(order)
        if result is None:
            return JobStopped(order)
        _write_whole(order, result)
    except KeyboardInterrupt:
        return JobStopped(order)
    except SystemExit as end:
        return JobFailed(order, f"it called sys.exit({end.code!r})")
    except PicktreeError as error:
        print(error, file=sys.stderr)
        return JobFailed(order, _one_line(str(error)))
    except BaseException as error:  # noqa: BLE001 - one job's fault must not cost another
        traceback.print_exc(file=sys.stderr)
        said = _one_line(str(error))
        place = job_output.place_of(error)
        return JobFailed(order, f"{type(error).__name__}{f': {said}' if said else ''}, at {place}")
    return JobFinished(order)


def _mission_result(order: JobOrder) -> bytes | None:
    """Run the recipe as a mission and return the rows of the result; None when it was interrupted."""
    from picktree.session import Session, run_recipe

    from .run_rows import collect_run_rows

    with run_recipe.RecipeFile(order.recipe) as kept:
        session = Session(kept.recipe(order.seed), record=run_recipe.Recording(order.folder))
        result = session.run()
        if result.status == "interrupted":
            return None
        return collect_run_rows(session.execution, result.folder, order.attempt).to_json()


def _program_result(order: JobOrder) -> bytes:
    """Return what the program's function `attempt` makes of the order."""
    program = file_system.ROOT / order.program
    sys.path.insert(0, str(program.parent))
    return import_module(program.stem).attempt(order)


def _one_line(text: str) -> str:
    """Return the first line of a text, without the temporary folder of the unpacked recipe."""
    unpacked = rf"{re.escape(tempfile.gettempdir())}/picktree-[^/]+/"
    return re.sub(unpacked, "", text.strip().partition("\n")[0])


def _write_whole(order: JobOrder, data: bytes) -> None:
    beside = order.result.with_suffix(".part")
    try:
        with beside.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(order.result)
    except OSError as error:
        raise PicktreeError(f"{order.result}: the result cannot be written: {error.strerror}") from None


_RESOURCE_CHECK_PERIOD = 0.2
"""Interval between checks of the process's resources, wall s."""
_TRACEBACK_TIME_LIMIT = 2.0
"""Time limit for the traceback of a process that is ended, wall s."""
_TEMPORARY = "tmp"


class JobProcess:
    """Running attempt in a process forked from this one. `end` may be called at any time."""

    def __init__(self, order: JobOrder) -> None:
        self._order = order
        self._began = time.monotonic()
        self._heard, tell = Pipe(duplex=False)
        job_output.flush()
        parent = os.getpid()
        self._pid = os.fork()
        if self._pid == 0:
            _live(order, tell, parent)
        tell.close()
        self._descriptor = os.pidfd_open(self._pid)

    def event(self) -> Event:
        """Wait for the end, within the limits, and return the result."""
        reason = ""
        while not reason and not self._over(_RESOURCE_CHECK_PERIOD):
            reason = self._over_its_limits()
        if reason:
            self._kill(job_output.TRACEBACK_SIGNAL)
            if not self._over(_TRACEBACK_TIME_LIMIT):
                self._kill(signal.SIGKILL)
        how = self._how()
        self._clear()  # before listening: what is left holds the other end, too
        said = self._said()
        if said is not None:
            return said
        place = job_output.last_place(self._order.folder)
        return JobFailed(self._order, f"{reason or how}, at {place}" if place else reason or how)

    def end(self) -> None:
        """Kill the process with everything that it left."""
        self._kill(signal.SIGKILL)
        self._clear()
        folder = self._order.folder
        shutil.rmtree(folder / _TEMPORARY, ignore_errors=True)
        with suppress(OSError):
            if not (folder / job_output.OUTPUT_FILE).stat().st_size:
                (folder / job_output.OUTPUT_FILE).unlink()
        os.close(self._descriptor)
        self._heard.close()

    def _said(self) -> Event | None:
        with suppress(EOFError, OSError, UnpicklingError):
            if self._heard.poll():
                return self._heard.recv()
        return None

    def _how(self) -> str:
        status = os.waitid(os.P_PID, self._pid, os.WEXITED | os.WNOWAIT)
        assert status is not None
        killed = status.si_code in (os.CLD_KILLED, os.CLD_DUMPED)
        words = f"its process {exit_code_words(-status.si_status if killed else status.si_status)}"
        if killed and status.si_status == signal.SIGKILL:
            return f"{words}, which came from outside: by hand, or for want of memory on the machine"
        return words

    def _kill(self, number: signal.Signals) -> None:
        with suppress(ProcessLookupError):
            signal.pidfd_send_signal(self._descriptor, number)

    def _clear(self) -> None:
        left = end_children(self._pid)
        if left:
            job_output.add(self._order.folder, f"{left} processes that the job left behind were ended")

    def _over(self, seconds: float) -> bool:
        waiting = select.poll()
        waiting.register(self._descriptor, select.POLLIN)
        return bool(waiting.poll(1000 * seconds))

    def _over_its_limits(self) -> str:
        order = self._order
        if time.monotonic() - self._began > order.wall:
            return f"it took more than {order.wall:g} s of wall time"
        if resident(self._pid) > order.memory:
            return f"it took more than {order.memory / 1e6:.0f} MB of memory"
        if _written_bytes(order.folder) > order.disk:
            return f"it wrote more than {order.disk / 1e6:.0f} MB to the disk"
        return ""


def _live(order: JobOrder, tell: Connection, parent: int) -> NoReturn:
    """Run the job in its process, from start to exit."""
    code = 1
    try:
        try:
            _settle_in(order, parent)
            event = run_attempt(order)
        except OSError as error:
            event = JobFailed(order, f"{order.folder}: nothing can be written there: {error.strerror}")
        job_output.flush()
        tell.send(event)
        code = 0
    finally:
        # Threads that a job left are not awaited, and the worker's cleanup does not run twice.
        os._exit(code)


def _settle_in(order: JobOrder, parent: int) -> None:
    import numpy

    os.setsid()
    die_with_parent(signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
    temporary = order.folder / _TEMPORARY
    temporary.mkdir(parents=True, exist_ok=True)
    os.environ["TMPDIR"], tempfile.tempdir = str(temporary), None
    job_output.print_into(order.folder)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    largest = 2 * order.disk  # of a file elsewhere, which nobody watches
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest, largest))
    with suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("1000")  # it goes before the batch does
    numpy.random.seed()  # as in a fresh process; no skill of ours draws from it


def _written_bytes(folder: Path) -> int:
    """Return the number of bytes in the files of a folder."""
    total = 0
    for place, _, files in os.walk(folder):
        for name in files:
            with suppress(OSError):
                total += os.lstat(os.path.join(place, name)).st_size
    return total
