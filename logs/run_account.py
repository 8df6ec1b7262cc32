"""Account of a run: its visits, the outcome of each failure, and the episodes, from one pass over its log."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass

from picktree.world import JournalEvent, event_types

from .episode_counts import CauseCount, CureCount, by_cause, counted
from .item_episodes import AGAIN, CureNames, Decision, EpisodeTracker
from .node_visits import HALTED, Visit, VisitBuilder, VisitTree, ticks_with_trees, under_way
from .operator_figures import CellMotion, FigureCounter, FigureCounts
from .run_log import RunLog, Stamped

ANSWERING = frozenset({"Recover", "RecoveryNode"})
"""Nodes that announce the handler that they run."""
OPEN = event_types.FailureDecidedEvent("", cause="", time=0.0, fate="open", by="")
GIVE_UP = "give_up"
"""Slot of the child that a node runs before it fails for good."""


@dataclass(frozen=True, slots=True)
class Episodes:
    """Episodes of a run and its injected faults, in order of time.

    A log that continues from a checkpoint has only the later ones.
    """

    episodes: tuple[event_types.EpisodeEvent, ...]
    planted: tuple[event_types.FaultOutcomeEvent, ...]

    @property
    def cures(self) -> tuple[CureCount, ...]:
        return counted(self.episodes)

    @property
    def causes(self) -> tuple[CauseCount, ...]:
        """Counts by cause, with the most time lost first."""
        return by_cause(self.cures)

    def of_failure(self, cause: str, time: float, node: str) -> int | None:
        """Return the index of the episode with a failure of this cause at a time (s), preferably at this
        node."""
        found = [
            n
            for n, episode in enumerate(self.episodes)
            if episode.cause == cause and any(abs(at - time) < 1e-6 for at in episode.times)
        ]
        same = [n for n in found if self.episodes[n].node == node]
        return (same or found or [None])[0]


@dataclass(frozen=True, slots=True)
class FailureLink:
    """Node that a failure has ended, on the path from its source to the root."""

    path: str
    id: str
    time: float
    """End of the node, simulated s."""
    outcome: str
    """FAILURE, or the node's own outcome: SUCCESS, or RUNNING when it continued."""


@dataclass(frozen=True, slots=True)
class CureAttempt:
    """Attempt to cure a failure."""

    node: str
    """Path of the node that recovers, such as a `Recover`."""
    handler: str
    """Name of the handler: the pattern of `when`, `otherwise`, or the node's own name for it."""
    time: float
    """Start, simulated s."""
    attempt: int
    """Number of the failed run of the branch, 1 for the first."""
    ended: str
    """Outcome of the handler's own branch: SUCCESS, FAILURE, SKIPPED, HALTED or RUNNING."""
    seconds: float
    """Duration, simulated s."""
    ran: str = ""
    """Name of the handler for a reader: its sub-tree, or the nodes of its list."""
    instead: bool = False
    """Whether the handler takes the place of the branch, as one of `instead` does."""


@dataclass(frozen=True)
class Failure:
    """Failure with a cause, its course up the tree, and the decision about it."""

    source: Visit
    """Visit that failed by itself."""
    chain: tuple[FailureLink, ...]
    """Nodes that ended with the failure, from the parent upwards."""
    handled_by: tuple[CureAttempt, ...]
    decided: event_types.FailureDecidedEvent
    decided_at: float | None
    """Time of the decision, simulated s; None when open."""


@dataclass(frozen=True)
class RunAccount:
    """Account of a run: visits, failures with their handlings, episodes with cures and time lost."""

    visits: tuple[Visit, ...]
    """Activations of nodes."""
    tree: VisitTree
    """Visits by parent."""
    failures: tuple[Failure, ...]
    """Failures with a cause, in order of time, without false conditions."""
    recovery: Episodes


def account_of(log: RunLog, events: Sequence[Stamped[JournalEvent]]) -> RunAccount:
    """Return the account of a run from its log and its events.

    Outcomes were decided and recorded during the run. The same tracker decides from the ticks the outcomes
    that the log lacks: all of them in format 2, those that are open at its end, and those in a gap. Raises
    PicktreeError when the log is damaged.
    """
    builder, tracker = VisitBuilder(), EpisodeTracker()
    derived: list[Decision] = []
    coming, last = deque(events), 0.0
    for number, (at, trees) in enumerate(ticks_with_trees(log)):
        for tree in trees:
            builder.follow(tree)
            tracker.follow(tree.nodes)
        builder.take(at.time, at.record)
        last = at.time
        records: list[JournalEvent] = []
        while coming and coming[0].time <= at.time + 1e-9:
            records.append(coming.popleft().record)
        if number == 0:
            tracker.begun(at.time, under_way(at.record))
        derived += tracker.take(at.time, at.record.edges, records)
    derived += tracker.finish(log.end)
    decisions = _completed([at.record for at in events if isinstance(at.record, Decision)], derived)
    decided = {
        (each.node, each.time, each.cause): each
        for each in decisions
        if isinstance(each, event_types.FailureDecidedEvent)
    }
    episodes = [each for each in decisions if isinstance(each, event_types.EpisodeEvent)]
    planted = [each for each in decisions if isinstance(each, event_types.FaultOutcomeEvent)]
    visits = VisitTree(builder.finish())
    names = CureNames(node for at in log.trees() for node in at.record.nodes)
    recoveries = {
        (at.record.node, round(at.time, 6)): at.record
        for at in reversed(events)
        if isinstance(at.record, event_types.RecoveryEvent)
    }
    courses = _Courses(visits, recoveries, last, names)
    return RunAccount(
        visits.visits,
        visits,
        tuple(
            courses.of(source, decided.get((source.path, source.end, source.cause), OPEN))
            for source in visits.sources()
        ),
        Episodes(
            tuple(sorted(episodes, key=lambda e: (e.time, e.node))),
            tuple(sorted(planted, key=lambda p: p.time)),
        ),
    )


def motions_of(
    log: RunLog, arm: Container[str], start: float | None = None, end: float | None = None
) -> Mapping[float, CellMotion]:
    """Return the motion of arm and fingers by the time of the tick, simulated s; empty in older logs.

    `arm`: names of the arm's joints; the others are those of the fingers.
    """
    controllers = {at.time: at.record.controller for at in log.controls(start, end)}
    return {
        at.time: CellMotion(
            controllers[at.time],
            math.fsum(
                position
                for name, position in zip(at.record.names, at.record.position, strict=True)
                if name not in arm
            ),
        )
        for at in (log.joints(start, end) if controllers else ())
        if at.time in controllers
    }


def fixed_of(log: RunLog) -> frozenset[str]:
    """Return the ids of the fixtures, bins and totes in the belief."""
    first = next(log.beliefs(), None)
    return frozenset(part.id.partition("/")[0] for part in first.record.fixed) if first else frozenset()


def figures_during(
    log: RunLog,
    events: Sequence[Stamped[JournalEvent]],
    motions: Mapping[float, CellMotion],
    moments: Sequence[float] = (),
) -> tuple[FigureCounts, ...]:
    """Return the counts of the operators' figures up to each of the moments, simulated s, and up to the end.

    They are the robot's: the scorer's units and misplaced items, and pauses, are not in the ticks.
    """
    counter, tracker = FigureCounter(), EpisodeTracker()
    counter.fixed = fixed_of(log)
    coming, left, found = deque(events), deque(sorted(moments)), list[FigureCounts]()
    for number, (at, trees) in enumerate(ticks_with_trees(log)):
        while left and at.time > left[0]:
            found.append(counter.counts(left.popleft()))
        for tree in trees:
            tracker.follow(tree.nodes)
            counter.follow(tree.nodes)
        records: list[JournalEvent] = []
        while coming and coming[0].time <= at.time + 1e-9:
            records.append(coming.popleft().record)
        if number == 0:
            tracker.begun(at.time, under_way(at.record))
        edges = at.record.edges
        decisions = tracker.take(at.time, edges, records)
        counter.take(at.time, records, decisions, edges, motions.get(at.time))
    found += [counter.counts(moment) for moment in left]
    return (*found, counter.counts(log.end))


def _completed(recorded: Sequence[Decision], derived: Sequence[Decision]) -> list[Decision]:
    """Return the recorded decisions, and the derived ones for subjects without a recorded decision."""
    known = {about for each in recorded for about in _subjects(each)}
    return [*recorded, *(each for each in derived if known.isdisjoint(_subjects(each)))]


def _subjects(decision: Decision) -> set[tuple[str, ...]]:
    """Return the subjects of a decision: a failure, the failures of an episode, or an injected fault."""
    match decision:
        case event_types.FailureDecidedEvent():
            return {("failure", decision.cause, decision.node, f"{decision.time:.6f}")}
        case event_types.EpisodeEvent():
            return {("episode", decision.cause, decision.node, f"{time:.6f}") for time in decision.times}
        case event_types.FaultOutcomeEvent():
            return {("fault", decision.fault, decision.item, f"{decision.time:.6f}")}


@dataclass(frozen=True, slots=True)
class _Courses:
    """Paths of failures through the visits of a run, with the decision about each."""

    tree: VisitTree
    recoveries: Mapping[tuple[str, float], event_types.RecoveryEvent]
    """Announcement of a handler, by the path of the node and the time."""
    end: float
    """Time of the log's last tick, simulated s."""
    names: CureNames

    def of(self, source: Visit, decided: event_types.FailureDecidedEvent) -> Failure:
        chain: list[FailureLink] = []
        handlings: list[CureAttempt] = []
        at: float | None = None
        failing = visit = source
        above = self.tree.above(source)
        for parent in above:
            if _ended_by(parent, failing, self.tree.came_from(parent), visit):
                handlings += self._handling(parent, visit, given_up=True)
            else:
                answered = "RUNNING" if parent.last > visit.last else parent.outcome
                chain.append(FailureLink(parent.path, parent.id, visit.end, answered))
                at = visit.end
                if parent.path == decided.by and decided.fate in ("branched", "passed_over"):
                    break
                handlings += self._handling(parent, visit, given_up=False)
                if parent.path == decided.by:
                    runs = (v.end for v in self.tree.after(visit) if v.path == visit.path)
                    at = max(runs, default=parent.end)
                    break
                if parent.outcome == HALTED:
                    at = parent.end
                    parent = next((v for v in above if v.outcome != HALTED), parent)
                    if decided.by and parent.outcome != "FAILURE":
                        chain.append(FailureLink(parent.path, parent.id, at, parent.outcome))
                if parent.outcome != "FAILURE":
                    break
                failing = parent
                # It was answered, and the node failed after all: with a later failure, or the answer's.
            if chain[-1:] != [FailureLink(parent.path, parent.id, parent.end, "FAILURE")]:
                chain.append(FailureLink(parent.path, parent.id, parent.end, "FAILURE"))
            visit, at = parent, parent.end
        return Failure(
            source, tuple(chain), tuple(handlings), decided, None if decided.fate == "open" else at
        )

    def _handling(self, parent: Visit, failed: Visit, *, given_up: bool) -> list[CureAttempt]:
        """Return the handler that the parent ran after its child's failure.

        `given_up`: it then failed with this very failure.
        """
        if given_up and parent.last == failed.last and parent.id not in ANSWERING:
            return []
        announced = self.recoveries.get((parent.path, round(failed.end, 6)))
        label = None if announced is None else announced.handler
        instead = announced is not None and announced.ends
        runs = [v for v in self.tree.children(parent) if v.path == failed.path]
        attempt = 1 + sum(v.number < failed.number for v in runs)
        after = self.tree.after(failed)
        cure = next((v for v in after if v.path != failed.path), None)
        if label is None and not given_up:
            again = any(v.path == failed.path for v in after)
            return [CureAttempt(parent.path, AGAIN, failed.end, attempt, "SUCCESS", 0.0)] if again else []
        if cure is not None:
            ran = self.names.of(cure.path)
            handler = GIVE_UP if label is None else label
            ended = (cure.outcome, cure.duration)
            return [CureAttempt(parent.path, handler, cure.start, attempt, *ended, ran, instead)]
        if given_up or label is None:
            return []
        left = self.end - failed.end
        return [CureAttempt(parent.path, label, failed.end, attempt, "RUNNING", left, instead=instead)]


def _ended_by(parent: Visit, failing: Visit, came_from: Visit | None, visit: Visit) -> bool:
    """Whether the parent ended with this very failure, which came up from `visit`."""
    return (
        parent.outcome == "FAILURE"
        and parent.cause == failing.cause
        and parent.origin == failing.origin
        and came_from is not None
        and came_from.number == visit.number
    )
