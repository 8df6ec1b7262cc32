"""Running tests on mutants: a process with all libraries loaded forks a child for each mutant.

A child, and each process that its tests start, imports one module from the mutated text instead of its file.
That text exists in a temporary folder only. The child ends at the first red test, or when a test takes
several times the CPU or the wall time of its record.
"""

from __future__ import annotations

import gc
import importlib
import json
import math
import os
import resource
import shutil
import signal
import sys
import tempfile
import threading
import time
import types
from collections.abc import Generator, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from _mutant_coverage import PYTEST, SITE, Selection
from _mutant_operators import Mutant
from mutant_site.sitecustomize import MUTATED, mutate, write_mutated
from picktree.files import pin

import pytest

LIBRARIES = (
    "numpy", "scipy.optimize", "scipy.spatial.transform", "scipy.interpolate", "scipy.ndimage", "pybullet",
    "pinocchio", "coal", "ompl", "ompl.base", "ompl.geometric", "fcl", "trimesh", "toppra", "cv2", "yaml",
    "orjson", "mcap.reader", "mcap.writer", "google.protobuf", "py_trees", "pydantic", "typer", "rich",
    "rich.progress", "rich.table", "hypothesis.strategies", "_pytest.assertion.rewrite",
)  # fmt: skip
"""What tests load sooner or later; loading it takes 2 s."""
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables that keep these libraries from starting threads."""
CPU_SPARE, CPU_TIMES = 5.0, 5.0
"""A test may take this many CPU s, and this many times what it took while it was recorded."""
WALL_SPARE, WALL_TIMES = 60.0, 20.0
"""The same of wall time: other programs may have the processors, too."""
FILES_AT_A_TIME = 10
"""Files of tests that are loaded before the first of their tests runs."""
LOADING = 5.0
"""CPU s that it takes to load some files of tests, at most."""
MEMORY = 4 << 30
"""Data that a process may allocate, bytes."""

Verdict: TypeAlias = Literal["killed", "timed out", "survived"]


@dataclass(frozen=True, slots=True)
class Job:
    """Tests to run, on a mutant or, for comparison, on none."""

    mutant: Mutant | None
    selection: Selection


@dataclass(frozen=True, slots=True)
class Outcome:
    """How the tests of a job ended."""

    verdict: Verdict
    test: str
    """The first test that was red, or that took too long."""
    message: str
    """Why it was."""
    cpu: float
    """Of the child and all that it waited for, s."""
    red: tuple[str, ...] = ()
    """All tests that were red: more than one in a job without a mutant."""
    ended: frozenset[str] = frozenset()
    """Tests that ran to their end."""


class Runner:
    """Runs jobs, some at a time."""

    def __init__(self, root: Path, workers: int) -> None:
        self._root, self._workers = root, workers
        pin()  # before numpy, as in every process that simulates
        with _silence():  # pybullet says when it was built, at each import
            for name in LIBRARIES:
                with suppress(ImportError):
                    importlib.import_module(name)
        if threading.active_count() > 1 or _threads() > 1:
            raise RuntimeError("a library has started a thread: a process with threads cannot be forked")

    def run(self, jobs: Iterable[Job]) -> Iterator[tuple[Job, Outcome]]:
        """Each job with its outcome, as they end. The children end with the loop that asks for outcomes."""
        waiting, running = iter(jobs), list[_Child]()
        gc.freeze()  # a child's collector would copy all pages that it marks
        try:
            while True:
                while len(running) < self._workers and (job := next(waiting, None)) is not None:
                    running.append(_Child(job, self._root))
                if not running:
                    return
                time.sleep(0.02)
                for child in [child for child in running if child.ended()]:
                    running.remove(child)
                    yield child.job, child.outcome()
        finally:
            for child in running:
                child.kill()
            gc.unfreeze()


class _Child:
    """A process that runs one job."""

    def __init__(self, job: Job, root: Path) -> None:
        self.job = job
        self._folder = Path(tempfile.mkdtemp(prefix="picktree-mutant-"))
        self._late = False
        self._status, self._cpu = 0, 0.0
        if job.mutant is not None:
            path = root / job.mutant.file
            text = job.mutant.source(path.read_text(encoding="utf-8"))
            write_mutated(self._folder / "mutated.json", job.mutant.module, path, text)
        sys.stdout.flush()
        sys.stderr.flush()
        self._pid = os.fork()
        if self._pid == 0:
            try:
                _be_child(job, root, self._folder)
            finally:
                os._exit(70)  # only if it has not ended by itself

    def ended(self) -> bool:
        pid, status, usage = os.wait4(self._pid, os.WNOHANG)
        if pid == 0:
            if self._overdue():
                self._late = True
                os.kill(self._pid, signal.SIGKILL)
            return False
        self._status, self._cpu = status, usage.ru_utime + usage.ru_stime
        return True

    def _overdue(self) -> bool:
        with suppress(OSError, ValueError):
            progress = self._folder / "progress"
            limit, _ = progress.read_text().split("\n", 1)
            return time.time() - progress.stat().st_mtime > float(limit)
        return False

    def kill(self) -> None:
        os.kill(self._pid, signal.SIGKILL)
        os.wait4(self._pid, 0)
        self._clear_away()

    def _clear_away(self) -> None:
        """What a test has started and left, and what it has written."""
        mark = str(self._folder).encode()
        for entry in Path("/proc").glob("[0-9]*/environ"):
            with suppress(OSError):
                if mark in entry.read_bytes():
                    os.kill(int(entry.parent.name), signal.SIGKILL)
        shutil.rmtree(self._folder, ignore_errors=True)

    def outcome(self) -> Outcome:
        """How it ended. Raises RuntimeError when pytest itself could not do its work."""
        red = [json.loads(line) for line in self._written("red")]
        ended = frozenset(self._written("ended"))
        test = ""
        with suppress(OSError, ValueError):
            _, test = (self._folder / "progress").read_text().split("\n", 1)
        output = (self._folder / "output").read_text(errors="replace")[-4000:]
        self._clear_away()
        names = tuple(each["test"] for each in red)
        code = os.waitstatus_to_exitcode(self._status)
        if self._late:
            return Outcome("timed out", test, "it hangs", self._cpu, (*names, test), ended)
        if code == -signal.SIGXCPU:
            return Outcome("timed out", test, "it computes without end", self._cpu, (*names, test), ended)
        if code < 0:
            died = f"the process died of {signal.Signals(-code).name}"
            return Outcome("killed", test, died, self._cpu, (*names, test), ended)
        if red:
            return Outcome("killed", red[0]["test"], red[0]["message"], self._cpu, names, ended)
        if code == pytest.ExitCode.OK:
            return Outcome("survived", "", "", self._cpu, (), ended)
        raise RuntimeError(f"pytest ended with {code} and no red test, for {self.job.mutant}:\n{output}")

    def _written(self, name: str) -> list[str]:
        """Lines that the child has written."""
        path = self._folder / name
        return path.read_text(encoding="utf-8").splitlines() if path.exists() else []


def _be_child(job: Job, root: Path, folder: Path) -> None:
    """Run the tests of a job in this process, which was forked for it, and end."""
    os.setsid()
    os.chdir(root)
    _redirect(folder / "output")
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
    temporary = folder / "tmp"
    temporary.mkdir()
    tempfile.tempdir = None
    os.environ |= {"TMPDIR": str(temporary), "PYTHONPATH": str(SITE)}
    os.environ["HYPOTHESIS_STORAGE_DIRECTORY"] = str(folder / "hypothesis")
    if job.mutant is not None:
        os.environ[MUTATED] = str(folder / "mutated.json")
        mutate()
    # As in `python -m pytest`: a process that a test spawns must not begin with this program.
    sys.argv, sys.path[0] = ["pytest"], str(root)
    sys.modules["__main__"] = types.ModuleType("__main__")
    first = ["-x"] if job.mutant is not None else []
    code = 0
    for part in parts(job.selection):
        files = dict.fromkeys(test.file for test in part.tests)
        code = pytest.main(
            [*PYTEST, *first, "-p", "no:xdist", "--tb=line", *files], plugins=[_Watch(part, folder)]
        )
        if code != pytest.ExitCode.OK and first:
            break
    sys.stdout.flush()
    os._exit(code)


def parts(selection: Selection) -> Iterator[Selection]:
    """The tests by and by: pytest loads all files before it runs any test, and the first may be red."""
    tests = list(zip(selection.tests, selection.costs, strict=True))
    while tests:
        files: set[str] = set()
        count = 0
        for test, _ in tests:
            files.add(test.file)
            if len(files) > FILES_AT_A_TIME:
                break
            count += 1
        some, tests = tests[:count], tests[count:]
        yield Selection(tuple(test for test, _ in some), tuple(cost for _, cost in some), 0)


def _redirect(output: Path) -> None:
    """Standard input from nothing, both outputs into a file."""
    nothing = os.open(os.devnull, os.O_RDONLY)
    written = os.open(output, os.O_WRONLY | os.O_CREAT, 0o600)
    os.dup2(nothing, 0)
    os.dup2(written, 1)
    os.dup2(written, 2)


class _Watch:
    """A plug-in of pytest in a child: runs the selected tests in their order, within bounds, and writes down
    which are red."""

    def __init__(self, selection: Selection, folder: Path) -> None:
        self._folder = folder
        self._costs = dict(zip((test.id for test in selection.tests), selection.costs, strict=True))
        self._bound(selection.tests[0].id, LOADING)

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        found = {item.nodeid: item for item in items}
        missing = [name for name in self._costs if name not in found]
        if missing:
            raise pytest.UsageError(f"{len(missing)} recorded tests are not there, such as {missing[0]}")
        items[:] = [found[name] for name in self._costs]

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        self._bound(item.nodeid, self._costs[item.nodeid])
        try:
            return (yield)
        finally:
            with (self._folder / "ended").open("a", encoding="utf-8") as file:
                file.write(f"{item.nodeid}\n")

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        if report.failed:
            of_it = (name for name in self._costs if name.startswith(f"{report.nodeid}::"))
            self._red(next(of_it, report.nodeid), str(report.longrepr).strip().splitlines()[-1])

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            crash = getattr(report.longrepr, "reprcrash", None)
            self._red(report.nodeid, str(report.longrepr) if crash is None else crash.message)

    def _bound(self, name: str, cost: float) -> None:
        """Time from now on, of this process and of each that it starts."""
        until = math.ceil(time.process_time() + CPU_SPARE + CPU_TIMES * cost)
        resource.setrlimit(resource.RLIMIT_CPU, (until, resource.RLIM_INFINITY))
        (self._folder / "progress").write_text(f"{WALL_SPARE + WALL_TIMES * cost}\n{name}")

    def _red(self, name: str, message: str) -> None:
        lines = [line for line in message.splitlines() if line.strip()]
        with (self._folder / "red").open("a", encoding="utf-8") as file:
            file.write(json.dumps({"test": name, "message": lines[0][:200] if lines else ""}) + "\n")


@contextmanager
def _silence() -> Generator[None]:
    """Let nothing reach standard error, from C either."""
    kept, nothing = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nothing)


def _threads() -> int:
    """Threads of this process, those of libraries included."""
    return len(list(Path("/proc/self/task").iterdir()))
