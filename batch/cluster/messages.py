"""What a batch and the process that speaks with Ray for it say to each other."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, TypeAlias

from ..workers.executor import Event, JobOrder
from .installation import Installation


@dataclass(frozen=True, slots=True)
class ClusterSettings:
    """The first word of the batch."""

    address: str | None
    """Of a running cluster; None: start one on this machine, and stop it in the end."""
    workers: int | None
    """At most so many at once; None: one for each CPU of the cluster."""
    folder: Path
    """Of this process alone."""
    output: Path
    """File with what this process prints."""
    here: Installation
    """What the batch's own machine has."""


@dataclass(frozen=True, slots=True)
class Task:
    """An order to be seen to."""

    order: JobOrder
    token: str
    """What stands in the file `TOKEN` of the order's folder."""


@dataclass(frozen=True, slots=True)
class WorkerCount:
    """How many there are now, with those that are about to be started."""

    count: int


@dataclass(frozen=True, slots=True)
class ClusterRefusal:
    """It cannot be, and why: the batch is over."""

    reason: str


STOP: Final = "stop"
"""Break off all that is under way."""
TOKEN: Final = ".from-the-batch"
"""A file in the folder of an order: a worker that can take it away sees the same folder as the batch."""
Said: TypeAlias = Task | Literal["stop"]
"""By the batch, after its settings; that it is gone is told by the end of the connection."""
News: TypeAlias = WorkerCount | ClusterRefusal | Event
"""For the batch."""
