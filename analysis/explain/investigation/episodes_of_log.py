"""The episodes of a run from its log."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from ....logs.episodes.episode import Episode, Planted
from ....logs.episodes.episode_counts import CauseCount, CureCount, by_cause, counted
from ....logs.episodes.episode_tracker import EpisodeTracker
from ....logs.run_log import Stamped
from ....logs.visits import under_way, with_transitions
from ....world.events.run_events import FaultEvent, RecoveryEvent
from ....world.events.skill_events import SetAsideEvent
from ....world.journal import JournalEvent

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ....logs.run_record import RunRecord
    from ....logs.schema.records import Tick


@dataclass(frozen=True)
class Episodes:
    """In the order in which they began. Of a log that goes on from a checkpoint: from there on."""

    episodes: tuple[Episode, ...]
    planted: tuple[Planted, ...]

    @cached_property
    def cures(self) -> tuple[CureCount, ...]:
        return counted(self.episodes)

    @property
    def causes(self) -> tuple[CauseCount, ...]:
        """What cost the most time first."""
        return by_cause(self.cures)


def episodes_of(run: RunRecord) -> Episodes:
    """Of an older log as far as its events go. Raises PicktreeError where the log is damaged."""
    episodes: list[Episode] = []
    planted: list[Planted] = []
    following = EpisodeTracker(episodes.append, planted.append)
    trees = list(run.trees)
    events = [at for at in run.events if isinstance(at.record, RecoveryEvent | SetAsideEvent | FaultEvent)]
    first = True
    for at in _ticks(run):
        while trees and (first or trees[0].time <= at.time):
            following.follow(trees.pop(0).record.nodes)
            if first:
                break
        if first and at.record is not None:
            following.begun(at.time, under_way(at.record))
        first = False
        told: list[JournalEvent] = []
        while events and events[0].time <= at.time + 1e-9:
            told.append(events.pop(0).record)
        following.take(at.time, at.record.transitions if at.record is not None else (), told)
    following.finish(run.end)
    return Episodes(
        tuple(sorted(episodes, key=lambda e: (e.time, e.node))), tuple(sorted(planted, key=lambda p: p.time))
    )


def _ticks(run: RunRecord) -> Iterator[Stamped[Tick | None]]:
    if run.log.format >= 2:
        yield from run.log.busy_ticks()
        return
    for at in with_transitions(run.log.ticks()):
        yield Stamped(at.time, at.record)
