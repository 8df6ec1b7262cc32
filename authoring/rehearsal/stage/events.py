"""The events of a rehearsal: what leaves and control nodes do, in order."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from ....trees.status import NodeStatus
from ....world.journal import Plain


@dataclass(slots=True)
class LeafRun:
    """One run of a leaf, from its start to its end."""

    tick: int
    """In which it started, from 1."""
    path: str
    last: int | None = None
    """Tick in which it ended; None while it runs."""
    outcome: str = "RUNNING"
    """SUCCESS, FAILURE, SKIPPED, HALTED; RUNNING until it has ended."""
    cause: str = ""
    message: str = ""


@dataclass(frozen=True, slots=True)
class Started:
    """A leaf starts."""

    tick: int
    run: LeafRun


@dataclass(frozen=True, slots=True)
class Ended:
    """A leaf ends, or is halted."""

    tick: int
    run: LeafRun


@dataclass(frozen=True, slots=True)
class Settled:
    """A precondition answers for a node, which does not start; or a condition of the language says something
    else than the last time."""

    tick: int
    path: str
    status: NodeStatus


@dataclass(frozen=True, slots=True)
class Wrote:
    """A value is written to the blackboard."""

    tick: int
    path: str
    key: str
    value: Plain


@dataclass(frozen=True, slots=True)
class Failed:
    """A control node fails for a cause of its own."""

    tick: int
    path: str
    cause: str
    message: str


@dataclass(frozen=True, slots=True)
class Handled:
    """A failure that went no further: `by` took it up, with its handler `handler` where it names them."""

    tick: int
    cause: str
    failed: str
    by: str
    handler: str = ""


@dataclass(frozen=True, slots=True)
class Noted:
    """A node tells the record something."""

    tick: int
    path: str
    kind: str
    message: str


Event: TypeAlias = Started | Ended | Settled | Wrote | Failed | Handled | Noted
