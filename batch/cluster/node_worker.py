"""The foreman: what stands on a node of the cluster, and has one local worker carry out order after order.

The run itself goes on in a process of its own below the foreman, as on the batch's machine: limits, breaking
off, and what is said of a worker that dies are those of `LocalExecutor`.
"""

from __future__ import annotations

import asyncio
import os
import shutil
import signal
import sys
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from ..workers.executor import Event, JobFailed, JobOrder, JobStopped
from ..workers.local_executor import LocalExecutor
from .installation import Installation, installed
from .messages import TOKEN, Task

_LOOK = 0.02
"""Wall s between two looks at the worker."""
_PREFIX: Final = "picktree-foreman-"


@dataclass(frozen=True, slots=True)
class ResultFile:
    """One that is to be brought to the batch's machine."""

    name: str
    """In the order's folder."""
    size: int


@dataclass(frozen=True, slots=True)
class TaskReport:
    """What came of a task."""

    event: Event
    files: tuple[ResultFile, ...]
    """Nothing when they are where they belong."""


class NodeWorker:
    """An actor of Ray: all methods are called from afar, one after the other but for `stop`."""

    def __init__(self) -> None:
        # What a process is spawned from is read again in it; that of Ray's workers would load Ray.
        vars(sys.modules["__main__"]).pop("__file__", None)
        _clear_after_the_dead()
        self._place = Path(tempfile.mkdtemp(prefix=f"{_PREFIX}{os.getpid()}-"))
        os.environ["TMPDIR"] = str(self._place)  # a worker that is killed leaves nothing elsewhere
        self._executor = LocalExecutor(1)
        self._stopped: set[Path] = set()

    async def installed(self) -> Installation:
        """What this machine has."""
        return installed()

    async def is_there(self) -> None:
        """It is, when this can be asked."""

    async def carry_out(self, task: Task, recipe: bytes) -> TaskReport:
        """In the order's folder when this machine sees that, else in one of its own."""
        order = task.order
        shared = _takes_token(task)
        try:
            own = order if shared else self._moved(order, recipe)
        except OSError as error:
            return TaskReport(
                JobFailed(order, f"its node cannot write to {self._place}: {error.strerror}"), ()
            )
        if order.folder in self._stopped:
            return TaskReport(JobStopped(order), ())
        with _no_signal_blocked():
            self._executor.submit(own)
        while not (events := self._executor.wait(0.0)):
            await asyncio.sleep(_LOOK)
        return TaskReport(replace(events[0], order=order), () if shared else _files(own.folder))

    async def stop(self, folder: Path) -> None:
        """Break off the order of that folder, which may still be on its way."""
        self._stopped.add(folder)
        self._executor.stop()

    async def piece(self, folder: str, name: str, offset: int, size: int) -> bytes:
        """Of a file in a folder of its own."""
        with (self._place / folder / name).open("rb") as file:
            file.seek(offset)
            return file.read(size)

    async def forget(self, folder: str) -> None:
        """Its files have arrived."""
        shutil.rmtree(self._place / folder, ignore_errors=True)

    async def close(self) -> None:
        """Let the worker go; nothing is left on this machine."""
        self._executor.close()
        shutil.rmtree(self._place, ignore_errors=True)

    def _moved(self, order: JobOrder, recipe: bytes) -> JobOrder:
        file = self._place / order.recipe.name
        if not file.is_file():
            file.write_bytes(recipe)
        folder = self._place / order.folder.name
        shutil.rmtree(folder, ignore_errors=True)
        return replace(order, recipe=file, folder=folder)


@contextmanager
def _no_signal_blocked() -> Generator[None]:
    """A process that is started meanwhile hears when it is to break off; Ray's threads hear nothing."""
    before = signal.pthread_sigmask(signal.SIG_SETMASK, ())
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _takes_token(task: Task) -> bool:
    """Whether the order's folder is the one that the batch made: then its token can be taken away."""
    token = task.order.folder / TOKEN
    try:
        if token.read_text() != task.token:
            return False
        token.unlink()
    except OSError:
        return False
    return True


def _files(folder: Path) -> tuple[ResultFile, ...]:
    return tuple(
        ResultFile(str(path.relative_to(folder)), path.stat().st_size)
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    )


def _clear_after_the_dead() -> None:
    """Folders of foremen that were killed."""
    for folder in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*"):
        pid = folder.name.removeprefix(_PREFIX).partition("-")[0]
        if not Path("/proc", pid).exists():
            shutil.rmtree(folder, ignore_errors=True)
