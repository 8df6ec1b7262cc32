"""Trace of a rehearsed case: its events in order."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TypeAlias

from picktree.files import Location, node_matches
from picktree.trees import NodeStatus
from picktree.world import BlackboardWrite, FailureReport, JournalEvent, Plain, event_types

from .cases import LeafScript, PlacedAnswer


class ScriptedAnswers:
    """Answers by start count of each pattern; the first pattern that matches a node counts."""

    def __init__(self, scripts: Iterable[LeafScript]) -> None:
        self._scripts = tuple(scripts)
        self._starts = [0] * len(self._scripts)

    def answer(self, path: str) -> PlacedAnswer | None:
        """Return the next answer of the leaf at that path; None when the case gives none."""
        for index, script in enumerate(self._scripts):
            if node_matches(script.pattern, path):
                self._starts[index] += 1
                return script.answer(self._starts[index])
        return None

    def unused(self) -> tuple[Location, ...]:
        """Return the places of answers that no leaf has used."""
        return tuple(
            placed.loc
            for script, starts in zip(self._scripts, self._starts, strict=True)
            for placed in script.everything[starts:]
        )


@dataclass(slots=True)
class LeafRun:
    """One run of a leaf, from its start to its end."""

    tick: int
    path: str
    last: int | None = None
    """Tick of the end; None while the leaf runs."""
    outcome: str = "RUNNING"
    """SUCCESS, FAILURE, SKIPPED or HALTED; RUNNING before the end."""
    cause: str = ""
    message: str = ""


@dataclass(frozen=True, slots=True)
class LeafStarted:
    """Start of a leaf."""

    tick: int
    run: LeafRun


@dataclass(frozen=True, slots=True)
class LeafEnded:
    """End or halt of a leaf."""

    tick: int
    run: LeafRun


@dataclass(frozen=True, slots=True)
class ConditionAnswered:
    """Answer of a precondition for a node that does not start, or changed answer of a condition node."""

    tick: int
    path: str
    status: NodeStatus


@dataclass(frozen=True, slots=True)
class KeyWritten:
    """Write of a value to the blackboard."""

    tick: int
    path: str
    key: str
    value: Plain


@dataclass(frozen=True, slots=True)
class ControlFailed:
    """Failure of a control node with a cause of its own."""

    tick: int
    path: str
    cause: str
    message: str


@dataclass(frozen=True, slots=True)
class FailureHandled:
    """Failure that went no further: `by` handled it, with `handler` where handlers have names."""

    tick: int
    cause: str
    failed: str
    by: str
    handler: str = ""


@dataclass(frozen=True, slots=True)
class NoteTaken:
    """Event that a node adds to the journal."""

    tick: int
    path: str
    kind: str
    message: str


Event: TypeAlias = (
    LeafStarted | LeafEnded | ConditionAnswered | KeyWritten | ControlFailed | FailureHandled | NoteTaken
)
MAX_EVENTS = 20_000
"""Maximum number of events of one case: nobody reads more."""


class Trace:
    """Collector of the events of one case, called by nodes and stubs."""

    def __init__(self, played: Iterable[str]) -> None:
        self.tick = 1
        """Present tick, from 1."""
        self._played = frozenset(played)
        self._open: dict[str, LeafRun] = {}
        self._handlers: dict[str, str] = {}
        self._said: dict[str, NodeStatus] = {}
        self.writes: Callable[[], tuple[BlackboardWrite, ...]] = tuple
        self.events: list[Event] = []
        self.runs: list[LeafRun] = []
        self._begun: dict[str, int] = {}
        self.started: dict[str, int] = {}
        """Tick of the first start of every node that has started."""
        self.handled: list[FailureHandled] = []
        self.faults: list[str] = []
        """Program faults (internal.error)."""
        self.raised: set[tuple[str, str]] = set()
        """Path and cause of every failure, at its origin."""

    # Called by the tree.

    def begun(self, path: str) -> None:
        """Record the start of a node."""
        self.flush()
        self._begun[path] = self.tick
        self.started.setdefault(path, self.tick)
        if path in self._played:
            run = LeafRun(self.tick, path)
            self._open[path] = run
            self.runs.append(run)
            self._add(LeafStarted(run.tick, run))

    def stepped(self, path: str, before: NodeStatus, status: NodeStatus) -> None:
        """Record a tick. A node that was not RUNNING and did not start was stopped by a precondition."""
        self.flush()
        if before is not NodeStatus.RUNNING and self._begun.get(path) != self.tick:
            self._add(ConditionAnswered(self.tick, path, status))

    def ended(self, path: str, status: NodeStatus, failure: FailureReport | None) -> None:
        """Record the end of a stub."""
        if failure is not None:
            self.raised.add((path, failure.cause.name))
        if path in self._open:
            self._end(self._open[path], status.value, failure)

    def halted(self, path: str) -> None:
        """Record the halt of a running stub."""
        self.flush()
        run = self._open.get(path)
        if run is not None:
            self._end(run, "HALTED", None)

    def says(self, path: str, status: NodeStatus) -> None:
        """Record the answer of a condition node if it differs from the last."""
        if self._said.get(path) is not status:
            self._said[path] = status
            self._add(ConditionAnswered(self.tick, path, status))

    def failed(self, report: FailureReport) -> None:
        """Record the failure of a control node with a cause of its own."""
        self.flush()
        self.raised.add((report.node, report.cause.name))
        self._add(ControlFailed(self.tick, report.node, report.cause.name, report.message))

    def took_up(self, by: str, report: FailureReport, *, by_handlers: bool) -> None:
        """Record that `by` did not fail although a node below did; `by_handlers`: only with a handler."""
        self.flush()
        handler = self._handlers.pop(by, "")
        if by_handlers and not handler:
            return
        handled = FailureHandled(self.tick, report.cause.name, report.node, by, handler)
        self.handled.append(handled)
        self._add(handled)

    def noted(self, entry: JournalEvent) -> None:
        self.flush()
        if isinstance(entry, event_types.RecoveryEvent):
            self._handlers[entry.node] = entry.handler
        if isinstance(entry, event_types.InternalErrorEvent):
            self.faults.append(entry.message)
        if not isinstance(entry, event_types.RecoveryEvent | event_types.HandledEvent):
            self._add(NoteTaken(self.tick, entry.node, entry.kind, entry.message))

    def flush(self, also: tuple[BlackboardWrite, ...] = ()) -> None:
        """Record the blackboard writes up to now; `also` holds writes taken before."""
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
