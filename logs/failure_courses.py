"""The course of a failure: whom it took along, who dealt with it and how, and what became of it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol, TypeAlias

from ..world.events.run_events import RecoveryEvent
from ..world.journal import JournalEvent
from .episodes.episode import CureNames
from .run_log import Stamped
from .visits import HALTED, Visit

Fate: TypeAlias = Literal["cured", "passed_over", "branched", "ended", "open"]
"""Outcome of a failure.

`cured`: recovery ran and what had failed then succeeded. `passed_over`: nothing cured it, and a loop went on
with the next item. `branched`: a Fallback or another node went another way, as its mission says. `ended`: it
reached the root, and the mission ended with it. `open`: the log ends before.
"""


@dataclass(frozen=True, slots=True)
class FailureLink:
    """A node that ended because of a failure, from where it came up towards the root."""

    path: str
    id: str
    time: float
    """Simulated s at which it ended."""
    outcome: str
    """FAILURE; or what the node made of it: SUCCESS, RUNNING when it went on."""


@dataclass(frozen=True, slots=True)
class CureAttempt:
    """One try to cure a failure."""

    node: str
    """Path of the node that recovers, such as a `Recover`."""
    handler: str
    """The pattern of `when`, `otherwise`, or what the node calls it."""
    time: float
    """Simulated s at which it began."""
    attempt: int
    """The run of the branch that had failed: 1 for the first."""
    ended: str
    """How the handler's own branch ended: SUCCESS, FAILURE, SKIPPED, HALTED, RUNNING."""
    seconds: float
    """Simulated s that it took."""
    ran: str = ""
    """Name of the handler for a reader: its sub-tree, or the nodes of its list."""


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
        """The visits around it, the nearest first."""
        parent = self.parent(visit)
        while parent is not None:
            yield parent
            parent = self.parent(parent)

    def within(self, visit: Visit, other: Visit) -> bool:
        """Whether `visit` took place within `other`, or is it."""
        return visit.number == other.number or any(v.number == other.number for v in self.above(visit))

    def came_from(self, visit: Visit) -> Visit | None:
        """The child from which a failure came up; None when it came from the visit itself.

        The last one counts: a node that tries again fails with its last failure.
        """
        return next((child for child in reversed(self.children(visit)) if _same(child, visit)), None)

    def sources(self) -> Iterator[Visit]:
        """The visits in which failures came up, in the order in which they ended."""
        failed = (v for v in self.visits if v.outcome == "FAILURE" and v.cause)
        found = (v for v in failed if self.came_from(v) is None)
        yield from sorted(found, key=lambda v: (v.last, v.number))

    def after(self, visit: Visit) -> Sequence[Visit]:
        """Those of the same parent that began when it had ended."""
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


BRANCHING = frozenset(
    {
        "Fallback", "ReactiveFallback", "Parallel", "IfThenElse", "WhileDoElse", "Switch", "Inverter",
        "ForceSuccess", "RoundRobin", "PipelineSequence",
    }
)  # fmt: skip
"""Nodes that answer a failure of a child by going another way, and never by running it again."""
AGAIN = "again"
"""Handler of a node that just runs its child again."""
GIVE_UP = "give_up"
"""Slot of the child that a node runs before it fails for good."""


@dataclass(frozen=True, slots=True)
class FailureCourse:
    """Course of a failure up the tree: the nodes that it ended, what was tried, and the decision."""

    chain: tuple[FailureLink, ...]
    handled_by: tuple[CureAttempt, ...]
    fate: Fate
    fate_by: str
    fate_at: float | None


class FailureCourses:
    """Follows failures upwards through the visits of a run."""

    def __init__(
        self, family: VisitTree, events: Sequence[Stamped[JournalEvent]], end: float, names: CureNames
    ) -> None:
        """`end`: time of the log's last tick, s; `names` says what a cure is called."""
        self._family = family
        self._recoveries = [
            Stamped(at.time, at.record) for at in events if isinstance(at.record, RecoveryEvent)
        ]
        self._end = end
        self._names = names

    def of(self, source: Visit) -> FailureCourse:
        chain: list[FailureLink] = []
        handlings: list[CureAttempt] = []
        failing, visit, parent = source, source, self._family.parent(source)
        while parent is not None:
            goes_up = _ended_by(parent, failing, self._family.came_from(parent), visit)
            if goes_up:
                handlings += self._given_up(parent, visit)
                chain.append(FailureLink(parent.path, parent.id, parent.end, parent.outcome))
                visit, parent = parent, self._family.parent(parent)
                continue
            answered = "RUNNING" if parent.last > visit.last else parent.outcome
            chain.append(FailureLink(parent.path, parent.id, visit.end, answered))
            if parent.id in BRANCHING and parent.outcome != "FAILURE":
                return FailureCourse(tuple(chain), tuple(handlings), "branched", parent.path, visit.end)
            if parent.id == "ForEach":
                return FailureCourse(tuple(chain), tuple(handlings), "passed_over", parent.path, visit.end)
            handling = self._handling(parent, visit)
            handlings += [handling] if handling is not None else []
            runs = [v for v in self._family.after(visit) if v.path == visit.path]
            if runs and parent.outcome in ("SUCCESS", "RUNNING") and runs[-1].outcome == "SUCCESS":
                return FailureCourse(tuple(chain), tuple(handlings), "cured", parent.path, runs[-1].end)
            if parent.outcome == "FAILURE":
                # It was answered, and the node failed after all: with a later failure, or the answer's.
                if answered != "FAILURE":
                    chain.append(FailureLink(parent.path, parent.id, parent.end, "FAILURE"))
                failing = visit = parent
                parent = self._family.parent(parent)
                continue
            if parent.outcome == HALTED:
                return self._halted(parent, chain, handlings)
            if parent.outcome == "RUNNING":
                return FailureCourse(tuple(chain), tuple(handlings), "open", "", None)
            return FailureCourse(tuple(chain), tuple(handlings), "branched", parent.path, visit.end)
        if visit.outcome != "FAILURE":
            return FailureCourse(tuple(chain), tuple(handlings), "open", "", None)
        return FailureCourse(tuple(chain), tuple(handlings), "ended", visit.path, visit.end)

    def _halted(self, halted: Visit, chain: list[FailureLink], handlings: list[CureAttempt]) -> FailureCourse:
        """It was being dealt with when somebody above stopped that: who, and whether he failed, decides."""
        for above in self._family.above(halted):
            if above.outcome == HALTED:
                continue
            if above.outcome == "RUNNING" and above.parent is None and self._end <= halted.end + 1e-6:
                break
            fate: Fate = "branched"
            if above.outcome == "FAILURE" and above.last == halted.last:
                upper = self.of(above)
                chain.append(FailureLink(above.path, above.id, above.end, "FAILURE"))
                chain += upper.chain
                return FailureCourse(
                    tuple(chain),
                    (*handlings, *upper.handled_by),
                    upper.fate,
                    upper.fate_by,
                    upper.fate_at,
                )
            chain.append(FailureLink(above.path, above.id, halted.end, above.outcome))
            return FailureCourse(tuple(chain), tuple(handlings), fate, above.path, halted.end)
        return FailureCourse(tuple(chain), tuple(handlings), "open", "", None)

    def _handling(self, parent: Visit, failed: Visit) -> CureAttempt | None:
        """How the parent answered a failure of its child by something that may cure it."""
        noted = next((at for at in self._recoveries if _answers(at, parent, failed)), None)
        attempt = 1 + sum(
            v.path == failed.path and v.number < failed.number for v in self._family.children(parent)
        )
        following = self._family.after(failed)
        if noted is None:
            if not any(v.path == failed.path for v in following):
                return None
            return CureAttempt(parent.path, AGAIN, failed.end, attempt, "SUCCESS", 0.0)
        cure = next((v for v in following if v.path != failed.path), None)
        label = noted.record.handler
        if cure is None:
            return CureAttempt(parent.path, label, noted.time, attempt, "RUNNING", self._end - noted.time)
        ran = self._names.of(cure.path)
        return CureAttempt(parent.path, label, cure.start, attempt, cure.outcome, cure.duration, ran)

    def _given_up(self, parent: Visit, failed: Visit) -> list[CureAttempt]:
        """Return the last run that the parent still made after the failure with which it then failed."""
        if parent.last == failed.last and parent.id not in ("Recover", "RecoveryNode"):
            return []
        noted = next((at for at in self._recoveries if _answers(at, parent, failed)), None)
        attempt = 1 + sum(
            v.path == failed.path and v.number < failed.number for v in self._family.children(parent)
        )
        last = next((v for v in self._family.after(failed) if v.path != failed.path), None)
        if last is None:
            return []
        label = GIVE_UP if noted is None else noted.record.handler
        ran = self._names.of(last.path)
        return [CureAttempt(parent.path, label, last.start, attempt, last.outcome, last.duration, ran)]


class DecidedFailure(Protocol):
    """Failure with the time of the decision about it."""

    @property
    def time(self) -> float:
        """Time of the failure, simulated s."""
        ...

    @property
    def fate_at(self) -> float | None:
        """Time of the decision, simulated s; None when the log ends before."""
        ...


def time_lost(failures: Iterable[DecidedFailure]) -> float:
    """Simulated s during which at least one of them was undecided; those that the log leaves open count
    nothing."""
    lost = until = 0.0
    for story in sorted(failures, key=lambda story: story.time):
        if story.fate_at is not None and story.fate_at > until:
            lost += story.fate_at - max(story.time, until)
            until = story.fate_at
    return lost


def _ended_by(parent: Visit, failing: Visit, came_from: Visit | None, visit: Visit) -> bool:
    """Whether the parent ended with this very failure, which came up from `visit`."""
    return (
        parent.outcome == "FAILURE"
        and parent.cause == failing.cause
        and parent.origin == failing.origin
        and came_from is not None
        and came_from.number == visit.number
    )


def _answers(at: Stamped[RecoveryEvent], parent: Visit, failed: Visit) -> bool:
    return at.record.node == parent.path and abs(at.time - failed.end) < 1e-6
