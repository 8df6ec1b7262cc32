"""Account of a run: its visits, what became of each failure, and the episodes, from one pass over its log."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from ..world.journal import JournalEvent
from .episodes.episode import CureNames, Episode, Planted
from .episodes.episode_counts import CauseCount, CureCount, by_cause, counted
from .episodes.episode_tracker import EpisodeTracker
from .failure_courses import FailureCourse, FailureCourses, VisitTree
from .run_log import RunLog, Stamped
from .visits import Visit, VisitBuilder, ticks_with_trees, under_way


@dataclass(frozen=True)
class Episodes:
    """Episodes of a run and its injected faults, in order of time.

    Of a log that continues from a checkpoint: from there on.
    """

    episodes: tuple[Episode, ...]
    planted: tuple[Planted, ...]

    @cached_property
    def cures(self) -> tuple[CureCount, ...]:
        return counted(self.episodes)

    @property
    def causes(self) -> tuple[CauseCount, ...]:
        """Counts by cause, with the most time lost first."""
        return by_cause(self.cures)


@dataclass(frozen=True)
class Failure:
    """Failure with a cause: the visit that failed by itself, and what became of the failure."""

    source: Visit
    course: FailureCourse


@dataclass(frozen=True)
class RunAccount:
    """Account of a run: visits, failures with their handlings, episodes with cures and time lost."""

    visits: tuple[Visit, ...]
    """Activations of nodes; of a log of format 1 derived from the statuses after each tick."""
    tree: VisitTree
    """Visits by parent."""
    failures: tuple[Failure, ...]
    """Failures with a cause, in order of time. A false condition is none."""
    recovery: Episodes


def account_of(
    log: RunLog, events: Sequence[Stamped[JournalEvent]], *, derived: bool | None = None
) -> RunAccount:
    """Return the account of a run from its log and its events; `derived` as for `ticks_with_trees`.

    Raises PicktreeError when the log is damaged.
    """
    builder, episodes, planted = VisitBuilder(), list[Episode](), list[Planted]()
    tracker = EpisodeTracker(episodes.append, planted.append)
    coming, last = deque(events), 0.0
    for number, (at, trees) in enumerate(ticks_with_trees(log, derived=derived)):
        for tree in trees:
            builder.follow(tree)
            tracker.follow(tree.nodes)
        told: list[JournalEvent] = []
        while coming and coming[0].time <= at.time + 1e-9:
            told.append(coming.popleft().record)
        if at.record is None:
            builder.skip(at.time)
        else:
            if number == 0:
                tracker.begun(at.time, under_way(at.record))
            builder.take(at.time, at.record)
        tracker.take(at.time, () if at.record is None else at.record.transitions, told)
        last = at.time
    tracker.finish(log.end)
    visits = VisitTree(builder.finish())
    names = CureNames(node for at in log.trees() for node in at.record.nodes)
    courses = FailureCourses(visits, events, last, names)
    return RunAccount(
        visits.visits,
        visits,
        tuple(Failure(source, courses.of(source)) for source in visits.sources()),
        Episodes(
            tuple(sorted(episodes, key=lambda e: (e.time, e.node))),
            tuple(sorted(planted, key=lambda p: p.time)),
        ),
    )
