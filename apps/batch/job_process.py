"""Process of one attempt at a job, isolated from the next job, with its output and the place of its end.

The process is forked from a worker that has loaded everything, which costs milliseconds where a fresh one
would cost seconds. Changes that a job makes in its process end with it: working directory, environment,
locale, random numbers, globals, memory, threads. It has a separate session, so that no Ctrl-C reaches it. It
prints into a file, and its temporary files are in a folder that is deleted with it. Processes that it leaves
behind are ended."""

from __future__ import annotations

import ctypes
import faulthandler
import os
import re
import resource
import select
import shutil
import signal
import sys
import sysconfig
import tempfile
import time
import traceback
from collections.abc import Generator
from contextlib import contextmanager, suppress
from importlib import import_module
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from pickle import UnpicklingError
from typing import NoReturn

from picktree.files import PicktreeError, file_system

from .executor import Event, JobFailed, JobFinished, JobOrder, JobStopped

OUTPUT_FILE = "output.txt"
"""File in the folder of an attempt; missing when nothing was printed."""
TRACEBACK_SIGNAL = signal.SIGABRT
"""Signal on which a process prints its traceback and ends."""
_TRACEBACK_BYTES = 65536
"""Size of the output's end in which a traceback is searched, bytes."""
_FRAME = re.compile(r'^  File "(?P<file>.*)", line (?P<line>\d+) in (?P<name>.*)$', re.MULTILINE)
_LIBRARIES = (sysconfig.get_path("stdlib"), sysconfig.get_path("purelib"), "<")


def print_into(folder: Path) -> None:
    """Redirect all output of this process and its children there, also that of C and C++.

    The traceback at a crash or at SIGABRT is written there, too.
    """
    file = os.open(folder / OUTPUT_FILE, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.dup2(file, 1)
    os.dup2(file, 2)
    os.close(nothing)
    faulthandler.enable(file=file, all_threads=False)  # of its own: a job may close the others


@contextmanager
def silence() -> Generator[None]:
    """Suppress all output in the block, also that of C and C++."""
    flush_output()
    kept = os.dup(1), os.dup(2)
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 1)
    os.dup2(nothing, 2)
    try:
        yield
    finally:
        flush_output()
        for number, before in enumerate(kept, 1):
            os.dup2(before, number)
            os.close(before)
        os.close(nothing)


def flush_output() -> None:
    """Write out the buffers of Python and C."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    ctypes.CDLL(None).fflush(None)


def append_output(folder: Path, line: str) -> None:
    """Append a line of the worker to the output."""
    with suppress(OSError), (folder / OUTPUT_FILE).open("a", encoding="utf-8") as file:
        file.write(f"{line}\n")


def last_place(folder: Path) -> str:
    """Return the place at which a process was ended, as `trouble.py:7 in run`; empty when unknown.

    Lines of libraries are skipped in favour of their callers.
    """
    try:
        with (folder / OUTPUT_FILE).open("rb") as file:
            file.seek(0, os.SEEK_END)
            file.seek(max(0, file.tell() - _TRACEBACK_BYTES))
            text = file.read().decode(errors="replace")
    except OSError:
        return ""
    _, fault, report = text.rpartition("Fatal Python error: ")
    frames = list(_FRAME.finditer(report)) if fault else []
    if not frames:
        return ""
    return _named([(frame["file"], frame["line"], frame["name"]) for frame in frames])


def place_of(error: BaseException) -> str:
    """Return the place at which an exception was raised, in the same form."""
    frames = traceback.extract_tb(error.__traceback__)
    return _named([(frame.filename, frame.lineno, frame.name) for frame in reversed(frames)])


def _named(frames: list[tuple[str, object, str]]) -> str:
    """Return the place of the innermost frame outside of libraries; the innermost is the first."""
    file, line, name = next((f for f in frames if not f[0].startswith(_LIBRARIES)), frames[0])
    return f"{Path(file).name}:{line} in {name}"


_PR_SET_PDEATHSIG = 1
_PR_SET_CHILD_SUBREAPER = 36
_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")
_MAX_END_ROUNDS = 100
"""Maximum number of rounds of ending children, each of which may leave children."""


def die_with_parent(number: signal.Signals) -> None:
    """Make this process receive the signal at any end of its parent."""
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
        message = _one_line(str(error))
        place = place_of(error)
        return JobFailed(order, f"{type(error).__name__}{f': {message}' if message else ''}, at {place}")
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
    """Return the result of the program's function `attempt` for the order."""
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
        flush_output()
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
            self._kill(TRACEBACK_SIGNAL)
            if not self._over(_TRACEBACK_TIME_LIMIT):
                self._kill(signal.SIGKILL)
        how = self._how()
        self._clear()  # before listening: what is left holds the other end, too
        message = self._received_message()
        if message is not None:
            return message
        place = last_place(self._order.folder)
        return JobFailed(self._order, f"{reason or how}, at {place}" if place else reason or how)

    def end(self) -> None:
        """Kill the process and delete its remains."""
        self._kill(signal.SIGKILL)
        self._clear()
        folder = self._order.folder
        shutil.rmtree(folder / _TEMPORARY, ignore_errors=True)
        with suppress(OSError):
            if not (folder / OUTPUT_FILE).stat().st_size:
                (folder / OUTPUT_FILE).unlink()
        os.close(self._descriptor)
        self._heard.close()

    def _received_message(self) -> Event | None:
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
            return (
                f"{words}; the signal came from outside: a person sent it, or the machine ran out of memory"
            )
        return words

    def _kill(self, number: signal.Signals) -> None:
        with suppress(ProcessLookupError):
            signal.pidfd_send_signal(self._descriptor, number)

    def _clear(self) -> None:
        left = end_children(self._pid)
        if left:
            append_output(self._order.folder, f"{left} processes that the job left behind were ended")

    def _over(self, seconds: float) -> bool:
        waiting = select.poll()
        waiting.register(self._descriptor, select.POLLIN)
        return bool(waiting.poll(1000 * seconds))

    def _over_its_limits(self) -> str:
        order = self._order
        if time.monotonic() - self._began > order.wall:
            return f"the job took more than {order.wall:g} s of wall time"
        if resident(self._pid) > order.memory:
            return f"the job took more than {order.memory / 1e6:.0f} MB of memory"
        if _written_bytes(order.folder) > order.disk:
            return f"the job wrote more than {order.disk / 1e6:.0f} MB to the disk"
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
        flush_output()
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
    print_into(order.folder)
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
