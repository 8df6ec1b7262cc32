"""Visits: activations of nodes from start to end, derived from the ticks of a log."""

from __future__ import annotations

import bisect
import math
from collections import Counter, defaultdict, deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Final, TypeAlias

from picktree.world import (
    BlackboardWrite,
    JournalEvent,
    Tick,
    Transition,
    Tree,
    Values,
    event_types,
)

from .run_log import RunLog, Stamped


@dataclass(frozen=True, slots=True)
class Pick:
    """Closing of the fingers on an object, as the robot measured it."""

    time: float
    """Time of the closing, simulated s."""
    object: str
    """Id of the believed object."""
    held: bool
    node: str
    """Path of the node that closed the fingers."""
    candidate: str = ""
    """Name of the chosen grasp."""
    width: float = float("nan")
    """Opening after closing, m; NaN: not recorded."""
    load: float = float("nan")
    """Weight at the wrist after lifting, N; NaN: not recorded."""


def picks_of(events: Iterable[Stamped[JournalEvent]]) -> tuple[Pick, ...]:
    """Return the picks among the events of a run."""
    picks = ((at.time, at.record) for at in events if isinstance(at.record, event_types.PickEvent))
    return tuple(
        Pick(
            time,
            pick.object,
            pick.held,
            pick.node,
            pick.candidate,
            math.nan if pick.width is None else pick.width,
            math.nan if pick.load is None else pick.load,
        )
        for time, pick in picks
    )


HALTED: Final = "HALTED"
_TIME_TOLERANCE: Final = 1e-6
Key: TypeAlias = tuple[str, str, int]
"""Key of a visit in two runs: (item, node path, attempt)."""


def _no_values() -> Values:
    return {}


@dataclass(frozen=True, slots=True)
class Visit:
    """Visit: one activation of a node, from the tick of its start to the tick of its end."""

    number: Annotated[int, "number of the visit, in order of the starts"]
    path: Annotated[str, "path of the node"]
    id: Annotated[str, "registered name of the node, such as `Grasp`"]
    parent: Annotated[int | None, "number of the parent's visit that contains this visit; empty for the root"]
    item: Annotated[str, "object that the visit concerns; empty without an object"]
    """Subject of the visit, or of the nearest visit around it. An iteration's element counts as a subject."""
    attempt: Annotated[int, "number of visits of the node for this item so far, this one included"]
    start: Annotated[float, "start, simulated", "s"]
    end: Annotated[float, "end of the visit, or of the log when the visit had not ended, simulated", "s"]
    first: Annotated[int, "number of the first tick, 0 for the first of the log"]
    last: Annotated[int, "number of the last tick"]
    outcome: Annotated[str, "SUCCESS, FAILURE, SKIPPED or HALTED; RUNNING when the log ends first"]
    inputs: Annotated[Values, "values read through references at the start, by port"] = field(
        default_factory=_no_values
    )
    cause: Annotated[str, "cause of a failure, such as `grasp.missed`; empty for a false condition"] = ""
    origin: Annotated[str, "path of the node from which the failure came; empty without a failure"] = ""
    message: Annotated[str, "message of the node"] = ""
    evidence: Annotated[Values, "evidence of the failure"] = field(default_factory=_no_values)

    @property
    def name(self) -> str:
        """Name of the node: the last part of its path."""
        return self.path.rsplit("/", 1)[-1]

    @property
    def name_and_item(self) -> str:
        """Name of the node and the item that it is about, as in `Grasp of block_1`."""
        return f"{self.name} of {self.item}" if self.item else self.name

    @property
    def about(self) -> str:
        """Item and number of the attempt, as in ` (block_1, attempt 2)`; empty without both."""
        known = [self.item] if self.item else []
        known += [f"attempt {self.attempt}"] if self.attempt > 1 else []
        return f" ({', '.join(known)})" if known else ""

    @property
    def key(self) -> Key:
        return (self.item, self.path, self.attempt)

    @property
    def duration(self) -> float:
        """Duration, simulated s."""
        return self.end - self.start

    @property
    def failed_itself(self) -> bool:
        """Whether the visit ended in a failure that came from this very node, not from one below it."""
        return self.outcome == "FAILURE" and bool(self.cause) and self.origin == self.path


@dataclass(frozen=True, slots=True)
class SkillStep:
    """Step of a skill that has ended, such as the closing of the fingers within a grasp."""

    visit: Annotated[int, "number of the visit of the skill's node"]
    node: Annotated[str, "path of the node"]
    item: Annotated[str, "object that the visit concerns; empty without an object"]
    name: Annotated[str, "name of the step, such as `approach`, `close`, `lift`"]
    start: Annotated[float, "start of the step, simulated", "s"]
    end: Annotated[float, "end of the step, simulated", "s"]
    outcome: Annotated[str, "`success`, `failure` or `halted`"]
    cause: Annotated[str, "cause of a failure; else empty"]


def steps_of(events: Iterable[Stamped[JournalEvent]], visits: Iterable[Visit]) -> tuple[SkillStep, ...]:
    """Return the steps of skills in the order of their ends."""
    by_node: dict[str, list[Visit]] = defaultdict(list)
    for visit in visits:
        by_node[visit.path].append(visit)
    steps: list[SkillStep] = []
    for at in events:
        step = at.record
        if not isinstance(step, event_types.StepEvent):
            continue
        own = by_node[step.node]
        place = bisect.bisect_right(own, at.time + _TIME_TOLERANCE, key=lambda visit: visit.start) - 1
        # A visit may begin in the tick in which the one before has ended.
        while place > 0 and own[place].start > step.start + _TIME_TOLERANCE:
            place -= 1
        if place >= 0:
            visit = own[place]
            steps.append(
                SkillStep(
                    visit.number,
                    step.node,
                    visit.item,
                    step.step,
                    step.start,
                    at.time,
                    step.outcome,
                    step.cause,
                )
            )
    return tuple(steps)


class VisitTree:
    """Visits by number, their children in the order of their beginnings."""

    def __init__(self, visits: Sequence[Visit]) -> None:
        self.visits = tuple(visits)
        self._children: dict[int, list[Visit]] = defaultdict(list)
        for visit in self.visits:
            if visit.parent is not None:
                self._children[visit.parent].append(visit)

    def children(self, visit: Visit) -> Sequence[Visit]:
        return self._children.get(visit.number, ())

    def parent(self, visit: Visit) -> Visit | None:
        return None if visit.parent is None else self.visits[visit.parent]

    def above(self, visit: Visit) -> Iterator[Visit]:
        """Return the visits around it, the nearest first."""
        parent = self.parent(visit)
        while parent is not None:
            yield parent
            parent = self.parent(parent)

    def within(self, visit: Visit, other: Visit) -> bool:
        """Whether `visit` took place within `other`, or is it."""
        return visit.number == other.number or any(v.number == other.number for v in self.above(visit))

    def came_from(self, visit: Visit) -> Visit | None:
        """Return the child that passed up the failure; None when the visit failed by itself.

        The last one counts: a node that tries again fails with its last failure.
        """
        return next((child for child in reversed(self.children(visit)) if _same(child, visit)), None)

    def sources(self) -> Iterator[Visit]:
        """Return the visits in which failures began, in the order of their ends."""
        failed = (v for v in self.visits if v.outcome == "FAILURE" and v.cause)
        found = (v for v in failed if self.came_from(v) is None)
        yield from sorted(found, key=lambda v: (v.last, v.number))

    def after(self, visit: Visit) -> Sequence[Visit]:
        """Return the visits of the same parent that began after its end."""
        parent = self.parent(visit)
        if parent is None:
            return ()
        return [v for v in self.children(parent) if v.number > visit.number and v.first >= visit.last]


def _same(child: Visit, parent: Visit) -> bool:
    return (
        child.outcome == "FAILURE"
        and child.cause == parent.cause
        and child.origin == parent.origin
        and child.message == parent.message
    )


class VisitBuilder:
    """Builder of visits from ticks, one tick at a time; a visit is open until its node ends."""

    def __init__(self) -> None:
        self._visits: list[Visit] = []
        self._open: dict[str, int] = {}
        self._counts: Counter[tuple[str, str]] = Counter()
        self._elements: dict[str, str] = {}
        """Present element of each iteration, by its node's path."""
        self._ids: dict[str, str] = {}
        self._parents: dict[str, str] = {}
        self._iterations: frozenset[str] = frozenset()
        self._number, self._time = -1, 0.0

    def follow(self, tree: Tree) -> None:
        """Use another tree from the next tick on."""
        self._ids = {node.path: node.id for node in tree.nodes}
        self._parents = {node.path: node.parent for node in tree.nodes}
        self._iterations = frozenset(node.path for node in tree.nodes if node.id == "ForEach")

    def take(self, time: float, tick: Tick) -> None:
        self._number += 1
        self._time = time
        if self._number == 0:
            for path in under_way(tick):
                self._begin(Transition(path, "RUNNING"))
        self._written(tick.writes)
        for transition in tick.edges:
            if transition.starts:
                self._begin(transition)
            else:
                self._end(transition)

    def finish(self) -> tuple[Visit, ...]:
        """Return all visits; open ones end with the last tick."""
        for number in self._open.values():
            visit = self._visits[number]
            self._visits[number] = replace(visit, end=self._time, last=max(self._number, visit.first))
        return tuple(self._visits)

    def _written(self, writes: Iterable[BlackboardWrite]) -> None:
        for write in writes:
            if write.node in self._iterations and isinstance(write.value, str):
                self._elements[write.node] = write.value

    def _begin(self, transition: Transition) -> None:
        path = transition.path
        if path in self._open:  # the log has no end of the visit before
            self._end(Transition(path, "IDLE"))
        item = transition.subject or self._item_around(path)
        self._counts[item, path] += 1
        number = len(self._visits)
        self._visits.append(
            Visit(
                number=number,
                path=path,
                id=self._ids.get(path, ""),
                parent=self._open.get(self._parents.get(path, "")),
                item=item,
                attempt=self._counts[item, path],
                start=self._time,
                end=self._time,
                first=self._number,
                last=self._number,
                outcome="RUNNING",
                inputs=transition.inputs,
            )
        )
        self._open[path] = number

    def _end(self, transition: Transition) -> None:
        number = self._open.pop(transition.path, None)
        self._elements.pop(transition.path, None)
        if number is None:
            return
        self._visits[number] = replace(
            self._visits[number],
            end=self._time,
            last=self._number,
            outcome=HALTED if transition.status == "IDLE" else transition.status,
            cause=transition.cause,
            origin=transition.origin,
            message=transition.message,
            evidence=transition.evidence,
        )

    def _item_around(self, path: str) -> str:
        above = self._parents.get(path, "")
        while above:
            if above in self._elements:
                return self._elements[above]
            number = self._open.get(above)
            if number is not None and self._visits[number].item:
                return self._visits[number].item
            above = self._parents.get(above, "")
        return ""


def covered_time(spans: Iterable[tuple[float, float]]) -> float:
    """Return the length of the union of some spans, each from a start to an end (s)."""
    covered, reached = 0.0, -math.inf
    for start, end in sorted(spans):
        covered += max(end - max(start, reached), 0.0)
        reached = max(reached, end)
    return covered


def under_way(first: Tick) -> tuple[str, ...]:
    """Return the nodes that were running before the first tick of a log, parents before their children.

    There are such nodes in a run that resumes from a checkpoint.
    """
    first_edge = {edge.path: edge for edge in reversed(first.edges)}
    return tuple(
        node.path
        for node in first.nodes
        if (first_edge[node.path].ends if node.path in first_edge else node.status == "RUNNING")
    )


def ticks_with_trees(log: RunLog) -> Iterator[tuple[Stamped[Tick], Sequence[Tree]]]:
    """Yield all ticks, each with the trees that are followed from it on."""
    coming = deque(log.trees())
    for number, at in enumerate(log.ticks()):
        due: list[Tree] = []
        while coming and (coming[0].time <= at.time or (number == 0 and not due)):
            due.append(coming.popleft().record)
        yield at, due
