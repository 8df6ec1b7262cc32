"""What happens while a case is rehearsed, in order."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TypeAlias

from ....trees.blackboard import BlackboardWrite
from ....trees.status import NodeStatus
from ....world.causes import FailureReport
from ....world.journal import JournalEvent, Plain


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
class LeafStarted:
    """A leaf starts."""

    tick: int
    run: LeafRun


@dataclass(frozen=True, slots=True)
class LeafEnded:
    """A leaf ends, or is halted."""

    tick: int
    run: LeafRun


@dataclass(frozen=True, slots=True)
class ConditionAnswered:
    """A precondition answers for a node, which does not start; or a condition of the language says something
    else than the last time."""

    tick: int
    path: str
    status: NodeStatus


@dataclass(frozen=True, slots=True)
class KeyWritten:
    """A value is written to the blackboard."""

    tick: int
    path: str
    key: str
    value: Plain


@dataclass(frozen=True, slots=True)
class ControlFailed:
    """A control node fails for a cause of its own."""

    tick: int
    path: str
    cause: str
    message: str


@dataclass(frozen=True, slots=True)
class FailureHandled:
    """A failure that went no further: `by` took it up, with its handler `handler` where it names them."""

    tick: int
    cause: str
    failed: str
    by: str
    handler: str = ""


@dataclass(frozen=True, slots=True)
class NoteTaken:
    """A node tells the record something."""

    tick: int
    path: str
    kind: str
    message: str


Event: TypeAlias = (
    LeafStarted | LeafEnded | ConditionAnswered | KeyWritten | ControlFailed | FailureHandled | NoteTaken
)


MAX_EVENTS = 20_000
"""Of one case; more would only be scrolled over."""


class Trace:
    """Collects the events of one case; nodes and stand-ins tell it what they do."""

    def __init__(self, played: Iterable[str]) -> None:
        self.tick = 1
        """The present one, from 1."""
        self._played = frozenset(played)
        self._open: dict[str, LeafRun] = {}
        self._handlers: dict[str, str] = {}
        self._said: dict[str, NodeStatus] = {}
        self.writes: Callable[[], tuple[BlackboardWrite, ...]] = tuple
        self.events: list[Event] = []
        self.runs: list[LeafRun] = []
        self._begun: dict[str, int] = {}
        self.started: dict[str, int] = {}
        """Every node that has started, and the tick in which it did so first."""
        self.handled: list[FailureHandled] = []
        self.faults: list[str] = []
        """What is a fault of the program: internal.error."""
        self.raised: set[tuple[str, str]] = set()
        """Path and cause of every failure, where it began."""

    # What the tree tells.

    def begun(self, path: str) -> None:
        """A node starts."""
        self.flush()
        self._begun[path] = self.tick
        self.started.setdefault(path, self.tick)
        if path in self._played:
            run = LeafRun(self.tick, path)
            self._open[path] = run
            self.runs.append(run)
            self._add(LeafStarted(run.tick, run))

    def stepped(self, path: str, before: NodeStatus, status: NodeStatus) -> None:
        """A node was ticked. That it did not start although it was not RUNNING was a precondition's doing."""
        self.flush()
        if before is not NodeStatus.RUNNING and self._begun.get(path) != self.tick:
            self._add(ConditionAnswered(self.tick, path, status))

    def ended(self, path: str, status: NodeStatus, failure: FailureReport | None) -> None:
        """A stand-in is no longer RUNNING."""
        if failure is not None:
            self.raised.add((path, failure.cause.name))
        if path in self._open:
            self._end(self._open[path], status.value, failure)

    def halted(self, path: str) -> None:
        """A stand-in is stopped while it runs."""
        self.flush()
        run = self._open.get(path)
        if run is not None:
            self._end(run, "HALTED", None)

    def says(self, path: str, status: NodeStatus) -> None:
        """A condition of the language has answered; worth a line when it is another answer than before."""
        if self._said.get(path) is not status:
            self._said[path] = status
            self._add(ConditionAnswered(self.tick, path, status))

    def failed(self, report: FailureReport) -> None:
        """A control node failed for a cause of its own."""
        self.flush()
        self.raised.add((report.node, report.cause.name))
        self._add(ControlFailed(self.tick, report.node, report.cause.name, report.message))

    def took_up(self, by: str, report: FailureReport, *, by_handlers: bool) -> None:
        """`by` did not fail although what stands below it did; `by_handlers`: only if it says with which."""
        self.flush()
        handler = self._handlers.pop(by, "")
        if by_handlers and not handler:
            return
        handled = FailureHandled(self.tick, report.cause.name, report.node, by, handler)
        self.handled.append(handled)
        self._add(handled)

    def noted(self, entry: JournalEvent) -> None:
        self.flush()
        handler = entry.data.get("handler")
        if isinstance(handler, str):
            self._handlers[entry.node] = handler
        if entry.kind == "internal_error":
            self.faults.append(entry.message)
        if entry.kind not in ("recovery", "handled"):
            self._add(NoteTaken(self.tick, entry.node, entry.kind, entry.message))

    def flush(self, also: tuple[BlackboardWrite, ...] = ()) -> None:
        """Take over what was written to the blackboard by now, and what was taken from there before."""
        for write in (*also, *self.writes()):
            self._add(KeyWritten(self.tick, write.node, write.key, write.value))

    def _end(self, run: LeafRun, outcome: str, failure: FailureReport | None) -> None:
        del self._open[run.path]
        run.last, run.outcome = self.tick, outcome
        if failure is not None:
            run.cause, run.message = failure.cause.name, failure.message
        self._add(LeafEnded(run.last, run))

    def _add(self, event: Event) -> None:
        if len(self.events) < MAX_EVENTS:
            self.events.append(event)
