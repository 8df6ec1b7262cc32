"""Cursor over a run: it is at one tick, and moves by ticks, changes, failures, nodes, items and times."""

from __future__ import annotations

import bisect
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeAlias, TypeVar

from picktree.files import PicktreeError, find_nodes
from picktree.logs import BeliefEvent, Stamped, log_records, node_visits, series
from picktree.world import BlackboardWrite, JournalEvent, Plan, Transition, Tree

from .run import Run


@dataclass(frozen=True, slots=True)
class NodeChange:
    """Start or end of a node in a tick."""

    tick: int
    time: float
    """Time of the tick, simulated s."""
    transition: Transition


@dataclass(frozen=True, slots=True)
class KeyChange:
    """Write to the blackboard in a tick."""

    tick: int
    time: float
    """Time of the tick, simulated s."""
    write: BlackboardWrite


@dataclass(frozen=True, slots=True)
class TickHistory:
    """Transitions and writes of a run, each in order of time."""

    moves: tuple[NodeChange, ...]
    writes: tuple[KeyChange, ...]


def tick_history(run: Run) -> TickHistory:
    moves: list[NodeChange] = []
    writes: list[KeyChange] = []
    for number, (at, _) in enumerate(node_visits.ticks_with_trees(run.log)):
        moves += [NodeChange(number, at.time, edge) for edge in at.record.edges]
        writes += [KeyChange(number, at.time, write) for write in at.record.writes]
    return TickHistory(tuple(moves), tuple(writes))


Edge: TypeAlias = Literal["begin", "end"]
R = TypeVar("R")

_TIME_TOLERANCE = 1e-6


@dataclass(frozen=True, slots=True)
class CursorChanges:
    """Changes after the tick `since`, up to and including the tick `to`, each in order."""

    since: int
    """Number of the tick before the first change; -1: from the beginning on."""
    to: int
    moves: tuple[NodeChange, ...]
    writes: tuple[KeyChange, ...]
    belief: tuple[Stamped[BeliefEvent], ...]
    """Events about changes of the belief."""
    events: tuple[Stamped[JournalEvent], ...]
    """All other events."""
    plans: tuple[Stamped[Plan], ...]


class Cursor:
    """Cursor at a tick of a run; it begins at the last tick at `at` (simulated s) or before.

    When there is nothing to go to, movements raise PicktreeError with a sentence and do not move the cursor.
    """

    def __init__(self, run: Run, at: float = 0.0) -> None:
        self.run = run
        self.number = run.ticks.number_at(at)

    # Position.

    def __len__(self) -> int:
        """Return the number of ticks."""
        return len(self.run.ticks)

    @property
    def time(self) -> float:
        """Time of the present tick, simulated s."""
        return self.run.ticks.times[self.number]

    @property
    def tick(self) -> series.TickAt:
        return self.run.ticks[self.number]

    @property
    def tree(self) -> Tree:
        """Tree that was ticked."""
        return self.run.tree_at(self.time)

    @cached_property
    def course(self) -> TickHistory:
        return tick_history(self.run)

    # Movements.

    def to_tick(self, number: int) -> None:
        if not 0 <= number < len(self):
            raise PicktreeError(f"there is no tick {number}: the log has ticks 0 to {len(self) - 1}")
        self.number = number

    def to_time(self, time: float) -> None:
        """Go to the last tick at `time` (simulated s) or before; for a time beyond an end of the log, to that
        end."""
        self.number = self.run.ticks.number_at(time)

    def step(self, ticks: int = 1) -> None:
        """Go forward by that number of ticks, back when negative; at most to the end of the log."""
        target = min(max(self.number + ticks, 0), len(self) - 1)
        if target == self.number and ticks:
            raise PicktreeError("this is the last tick" if ticks > 0 else "this is the first tick")
        self.number = target

    def next_change(self, *, back: bool = False) -> None:
        """Go to the next tick with the start or end of a node."""
        self._go([move.tick for move in self.course.moves], "change", back=back)

    def next_failure(self, *, back: bool = False) -> node_visits.Visit:
        """Go to the next tick in which a node itself failed, and return its visit."""
        self._go([visit.last for visit in self.failures], "failure", back=back)
        return next(visit for visit in self.failures if visit.last == self.number)

    def next_of(self, node: str, edge: Edge = "begin", *, back: bool = False) -> node_visits.Visit:
        """Go to the next tick with the start or end of a node, and return its visit.

        `node` is a path, the end of one, a type, or a pattern of paths with `*`; all matching nodes count.
        """
        paths = {one.path for one in find_nodes(node, self.run.nodes)}
        visits = [visit for visit in self.run.account.visits if visit.path in paths]
        if edge == "end":
            visits = [visit for visit in visits if visit.outcome != "RUNNING"]
        ticks = {visit.first if edge == "begin" else visit.last: visit for visit in reversed(visits)}
        self._go(sorted(ticks), f"{edge} of {node}", back=back)
        return ticks[self.number]

    def next_stop(self, stops: Collection[tuple[str, Edge]], *, back: bool = False) -> None:
        """Go to the next tick with the start or end of one of these nodes (by path)."""
        edges = [
            move.tick
            for move in self.course.moves
            if (move.transition.path, "begin" if move.transition.starts else "end") in stops
        ]
        self._go(edges, "breakpoint that is met", back=back)

    def next_item(self, item: str, *, back: bool = False) -> node_visits.Visit:
        """Go to the next tick in which a visit for this object began, and return it."""
        visits = [visit for visit in self.run.account.visits if visit.item == item]
        if not visits:
            raise PicktreeError(f"no node was about {item!r}")
        self._go([visit.first for visit in visits], f"node about {item}", back=back)
        return next(visit for visit in visits if visit.first == self.number)

    # State at the position.

    @cached_property
    def failures(self) -> tuple[node_visits.Visit, ...]:
        """Visits that failed by themselves, in the order of the failures; within a tick from below
        upwards."""
        failed = [visit for visit in self.run.account.visits if visit.failed_itself]
        return tuple(sorted(failed, key=lambda visit: (visit.last, -visit.path.count("/"))))

    @property
    def failure(self) -> node_visits.Visit | None:
        """Last failure at the cursor or before; of several in one tick the lowest. None when there is
        none."""
        before = [visit for visit in self.failures if visit.last <= self.number]
        return next((visit for visit in before if visit.last == before[-1].last), None)

    @property
    def visits(self) -> tuple[node_visits.Visit, ...]:
        """Visits that are open at the cursor, or begin or end there; the outermost first."""
        return tuple(
            visit
            for visit in self.run.account.visits
            if visit.first <= self.number and (self.number <= visit.last or visit.outcome == "RUNNING")
        )

    def last_visit(self, path: str) -> node_visits.Visit | None:
        """Return the last visit of a node that began at the cursor or before; None when there is none."""
        begun = [v for v in self.run.account.visits if v.path == path and v.first <= self.number]
        return begun[-1] if begun else None

    @property
    def blackboard(self) -> Mapping[str, object]:
        """All values by their full keys."""
        return self.run.blackboard_at(self.time)

    @property
    def belief(self) -> log_records.Scene | None:
        at = self.run.log.belief_at(self.time)
        return at.record if at else None

    @property
    def joints(self) -> log_records.Joints | None:
        return next((at.record for at in self.run.log.joints(self.time, self.time)), None)

    @property
    def wrench(self) -> log_records.WrenchReading | None:
        return next((at.record for at in self.run.log.wrenches(self.time, self.time)), None)

    @property
    def control(self) -> log_records.Control | None:
        """Set point of the servo; None in older logs."""
        return next((at.record for at in self.run.log.controls(self.time, self.time)), None)

    def changes(self, since: int | None = None) -> CursorChanges:
        """Return the changes since the tick of that number; by default, or for a later tick, those of this
        tick."""
        if since is None or since >= self.number:
            since = self.number - 1
        begin = self.run.ticks.times[since] if since >= 0 else -1.0
        span = (begin + _TIME_TOLERANCE, self.time + _TIME_TOLERANCE)
        events = _between(self.run.events, *span, lambda at: at.time)
        return CursorChanges(
            since,
            self.number,
            _between(self.course.moves, since, self.number, lambda move: move.tick),
            _between(self.course.writes, since, self.number, lambda write: write.tick),
            tuple(Stamped(at.time, at.record) for at in events if isinstance(at.record, BeliefEvent)),
            tuple(at for at in events if not isinstance(at.record, BeliefEvent)),
            _between(self.run.plans, *span, lambda at: at.time),
        )

    def _go(self, numbers: Sequence[int], what: str, *, back: bool) -> None:
        """Go to the nearest of these ticks (rising numbers) ahead, or behind."""
        if back:
            place = bisect.bisect_left(numbers, self.number) - 1
        else:
            place = bisect.bisect_right(numbers, self.number)
        if not 0 <= place < len(numbers):
            raise PicktreeError(f"there is no {what} {'before' if back else 'after'} {self.time:.2f} s")
        self.number = numbers[place]


def _between(records: Sequence[R], after: float, until: float, key: Callable[[R], float]) -> tuple[R, ...]:
    """Return the records after one time or tick, up to another."""
    first = bisect.bisect_right(records, after, key=key)
    return tuple(records[first : bisect.bisect_right(records, until, key=key)])
