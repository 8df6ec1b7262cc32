"""Who carries jobs out: a small interface, so that a batch does not know where its workers are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeAlias


@dataclass(frozen=True, slots=True)
class JobOrder:
    """One try at a job, as it is sent to a worker."""

    job: str
    """Its id."""
    attempt: int
    """1 for the first."""
    recipe: Path
    """File with all that it runs but the seed; see `logs.resimulation.recipe_file`."""
    seed: int
    folder: Path
    """Of this try alone; the run's folder is made in it."""
    wall: float
    """Wall s that it may take."""
    memory: int
    """Bytes of resident memory that it may take, with the processes that it starts."""
    disk: int = 10 * 10**9
    """Bytes that it may write."""

    @property
    def result(self) -> Path:
        """Where the worker puts the rows that it found: whole, or not at all."""
        return self.folder / "rows.json"


@dataclass(frozen=True, slots=True)
class JobFinished:
    """The worker wrote the try's result."""

    order: JobOrder


@dataclass(frozen=True, slots=True)
class JobFailed:
    """There is no result, and why: an exception, a lost worker, a limit."""

    order: JobOrder
    reason: str


@dataclass(frozen=True, slots=True)
class JobStopped:
    """The try was broken off because the batch was told to stop."""

    order: JobOrder


Event: TypeAlias = JobFinished | JobFailed | JobStopped


class Executor(Protocol):
    """Carries orders out, each in a process that does nothing else meanwhile."""

    @property
    def slots(self) -> int:
        """How many orders can be under way at once."""
        ...

    def submit(self, order: JobOrder) -> None:
        """Begin with it; only while fewer than `slots` are under way."""
        ...

    def wait(self, seconds: float) -> Sequence[Event]:
        """What happened, after at most `seconds` of wall time. Each order gets one event."""
        ...

    def stop(self) -> None:
        """Break off all that is under way."""
        ...

    def close(self) -> None:
        """Let all workers go."""
        ...
