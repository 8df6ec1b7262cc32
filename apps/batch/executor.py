"""Interface of executors, so that a batch is independent of the place of its workers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeAlias


@dataclass(frozen=True, slots=True)
class JobOrder:
    """Order for one attempt at a job, sent to a worker."""

    job: str
    """Id of the job."""
    attempt: int
    """Number of the attempt, from 1."""
    recipe: Path
    """File with the recipe, without the seed."""
    seed: int
    folder: Path
    """Folder of this attempt alone; the run's folder is created in it."""
    wall: float
    """Wall time limit, s."""
    memory: int
    """Limit of resident memory with child processes, bytes."""
    disk: int = 10 * 10**9
    """Limit of written data, bytes."""
    program: str = ""
    """Python file whose function `attempt` makes the result of the order, relative to the checkout; empty:
    the recipe is run as a mission."""

    @property
    def result(self) -> Path:
        """File with the rows of the result, written whole or not at all."""
        return self.folder / "rows.json"

    @property
    def log(self) -> Path | None:
        """Log of the run; None without a log."""
        from picktree.logs import log_files  # slow to import, and an order has to be light

        return next(iter(sorted(self.folder.glob(f"*/{log_files.LOG_NAME}"))), None)


@dataclass(frozen=True, slots=True)
class JobFinished:
    """Event: the worker wrote the attempt's result."""

    order: JobOrder


@dataclass(frozen=True, slots=True)
class JobFailed:
    """Event: the attempt has no result, with the reason: an exception, a lost worker, a limit."""

    order: JobOrder
    reason: str


@dataclass(frozen=True, slots=True)
class JobStopped:
    """Event: a stop of the batch broke off the attempt."""

    order: JobOrder


Event: TypeAlias = JobFinished | JobFailed | JobStopped


class Executor(Protocol):
    """Executor of orders, each in a separate process."""

    @property
    def slots(self) -> int:
        """Maximum number of concurrent orders."""
        ...

    def submit(self, order: JobOrder) -> None:
        """Start an order; only while fewer than `slots` are running."""

    def wait(self, seconds: float) -> Sequence[Event]:
        """Return the events of at most `seconds` of wall time. Each order gets one event."""
        ...

    def stop(self) -> None:
        """Break off all running orders."""

    def close(self) -> None:
        """End all workers."""
