"""Messages between a batch and its driver, the process that communicates with Ray."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, TypeAlias

from ..workers.executor import Event, JobOrder
from .installation import Installation


@dataclass(frozen=True, slots=True)
class ClusterSettings:
    """First message of the batch."""

    address: str | None
    """Address of a running cluster; None: start one on this machine, and stop it at the end."""
    workers: int | None
    """Maximum number of concurrent workers; None: one for each CPU of the cluster."""
    folder: Path
    """Folder for this process alone."""
    output: Path
    """File with the output of this process."""
    here: Installation
    """Installation of the batch's machine."""


@dataclass(frozen=True, slots=True)
class Task:
    """Order for the driver."""

    order: JobOrder
    token: str
    """Content of the file `TOKEN` in the order's folder."""


@dataclass(frozen=True, slots=True)
class WorkerCount:
    """Present number of workers, with those that are about to start."""

    count: int


@dataclass(frozen=True, slots=True)
class ClusterRefusal:
    """Reason why the cluster cannot be used; the batch ends."""

    reason: str


STOP: Final = "stop"
"""Message to break off all running orders."""
TOKEN: Final = ".from-the-batch"
"""File in an order's folder: a worker that can remove it shares the folder with the batch."""
Said: TypeAlias = Task | Literal["stop"]
"""Message of the batch after its settings; the end of the connection shows that the batch is gone."""
News: TypeAlias = WorkerCount | ClusterRefusal | Event
"""Message to the batch."""
