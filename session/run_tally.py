"""Counters of a run, fed from the journal and the ticks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from ..logs.episodes.episode import EpisodeTrackerState, NodeLike, TransitionLike
from ..logs.episodes.episode_counts import CureCount, EpisodeCounts, PlantedCount
from ..logs.episodes.episode_tracker import EpisodeTracker
from ..world.events.run_events import (
    BeltStopsEvent,
    BinExchangedEvent,
    CuredEvent,
    DeliveryEvent,
    RecoveryEvent,
)
from ..world.events.skill_events import BinEmptiedEvent, ItemDoneEvent, PickEvent, SetAsideEvent
from ..world.journal import Entry, JournalEvent


@dataclass(frozen=True, slots=True)
class EpisodeCountersState:
    """State of the episode counters in a checkpoint; older logs have none."""

    cures: tuple[CureCount, ...] = ()
    planted: tuple[PlantedCount, ...] = ()
    following: EpisodeTrackerState = field(default_factory=EpisodeTrackerState)


class EpisodeCounters:
    """Counters of decided episodes, and trackers of open ones; memory does not grow with the run's length."""

    def __init__(self, state: EpisodeCountersState | None = None) -> None:
        state = state or EpisodeCountersState()
        self._counts = EpisodeCounts(state.cures, state.planted)
        self._following = EpisodeTracker(self._counts.add, self._counts.add_planted, state.following)

    def follow(self, nodes: Iterable[NodeLike]) -> None:
        """Use another tree from the next tick on."""
        self._following.follow(nodes)

    def take(self, time: float, changes: Iterable[TransitionLike], events: Sequence[JournalEvent]) -> None:
        """Count the transitions and events of one tick."""
        self._following.take(time, changes, events)

    def state(self) -> EpisodeCountersState:
        return EpisodeCountersState(self._counts.cures, self._counts.planted, self._following.state())

    def so_far(self, time: float) -> EpisodeCounts:
        """Return the counts up to `time`, simulated s, undecided episodes as open. Changes nothing."""
        counts = EpisodeCounts(self._counts.cures, self._counts.planted)
        self._following.copied(counts.add, counts.add_planted).finish(time)
        return counts


class CountedNode(Protocol):
    """Node status after a tick, as far as the counters need it."""

    @property
    def path(self) -> str: ...
    @property
    def status(self) -> str: ...
    @property
    def ticked(self) -> bool: ...
    @property
    def cause(self) -> str | None: ...


@dataclass(frozen=True, slots=True)
class RunCountersState:
    """State of `RunCounters` in a checkpoint."""

    tried: int
    held: int
    objects: tuple[str, ...]
    first_try: tuple[str, ...]
    done: int
    failures: dict[str, int]
    recovered: dict[str, int]
    cured: dict[str, int]
    gone: int = 0
    gone_first_try: int = 0
    deliveries: int = 0
    exchanges: int = 0
    set_aside: int = 0
    episodes: EpisodeCountersState = field(default_factory=EpisodeCountersState)


@dataclass
class RunCounters:
    """Counters of one run, from the robot's belief and sensors only. The scorer decides whether an item is
    sorted."""

    tried: int = 0
    """Number of times that the fingers closed on an object."""
    held: int = 0
    objects: set[str] = field(default_factory=set[str])
    """Ids of the objects that were tried and are still in the cell."""
    first_try: set[str] = field(default_factory=set[str])
    """Ids of the objects that were held when the fingers first closed on them."""
    gone: int = 0
    """Number of objects that were tried and have left with their bins; their ids are no longer needed."""
    gone_first_try: int = 0
    """Number of objects in `gone` that were held when the fingers first closed on them."""
    deliveries: int = 0
    """Number of loads that the feed has brought."""
    exchanges: int = 0
    """Number of bins that were exchanged for empty ones."""
    set_aside: int = 0
    """Number of items that were given up at their place."""
    done: int = 0
    """Number of items placed, as the robot believes."""
    failures: Counter[str] = field(default_factory=Counter[str])
    """Number of failures of leaves by cause, and of branches that were stopped at their limit of time."""
    recovered: Counter[str] = field(default_factory=Counter[str])
    """Number of handler runs by cause."""
    cured: Counter[str] = field(default_factory=Counter[str])
    """Number of successful branches after a handler, by cause."""
    episodes: EpisodeCounters = field(default_factory=EpisodeCounters)
    """Counters of episodes."""

    def state(self) -> RunCountersState:
        return RunCountersState(
            self.tried,
            self.held,
            tuple(sorted(self.objects)),
            tuple(sorted(self.first_try)),
            self.done,
            dict(self.failures),
            dict(self.recovered),
            dict(self.cured),
            self.gone,
            self.gone_first_try,
            self.deliveries,
            self.exchanges,
            self.set_aside,
            self.episodes.state(),
        )

    @classmethod
    def resumed(cls, state: RunCountersState) -> RunCounters:
        """Return counters that continue from a checkpoint."""
        return cls(
            tried=state.tried,
            held=state.held,
            objects=set(state.objects),
            first_try=set(state.first_try),
            gone=state.gone,
            gone_first_try=state.gone_first_try,
            deliveries=state.deliveries,
            exchanges=state.exchanges,
            set_aside=state.set_aside,
            done=state.done,
            failures=Counter(state.failures),
            recovered=Counter(state.recovered),
            cured=Counter(state.cured),
            episodes=EpisodeCounters(state.episodes),
        )

    @property
    def tried_objects(self) -> int:
        """Number of different objects on which the fingers closed."""
        return self.gone + len(self.objects)

    @property
    def held_first_try(self) -> int:
        return self.gone_first_try + len(self.first_try)

    def _forget(self, objects: Iterable[str]) -> None:
        gone = self.objects.intersection(objects)
        self.gone += len(gone)
        self.gone_first_try += len(gone & self.first_try)
        self.objects -= gone
        self.first_try -= gone

    def follow(self, nodes: Iterable[NodeLike]) -> None:
        """Use another tree from the next tick on."""
        self.episodes.follow(nodes)

    def take(
        self,
        time: float,
        entries: Iterable[Entry],
        nodes: Iterable[CountedNode],
        leaves: frozenset[str],
        changes: Iterable[TransitionLike],
    ) -> None:
        """Count the results of one tick.

        `leaves` are the paths of the nodes without children. `changes` are the starts and ends of nodes, in
        order.
        """
        events = [entry for entry in entries if isinstance(entry, JournalEvent)]
        for event in events:
            self._happened(event)
        self.episodes.take(time, changes, events)
        for change in changes:
            own = change.path in leaves or (change.cause == "tree.timeout" and change.origin == change.path)
            if change.status == "FAILURE" and change.cause and own:
                self.failures[change.cause] += 1

    def _happened(self, event: JournalEvent) -> None:
        match event:
            case PickEvent(object=subject, held=held):
                self.tried += 1
                self.held += held
                if subject not in self.objects and held:
                    self.first_try.add(subject)
                self.objects.add(subject)
            case ItemDoneEvent():
                self.done += 1
            case DeliveryEvent() | BeltStopsEvent():
                self.deliveries += 1
            case BinExchangedEvent():
                self.exchanges += 1
            case SetAsideEvent():
                self.set_aside += 1
            case BinEmptiedEvent(objects=objects):
                self._forget(objects)
            case RecoveryEvent(cause=cause):
                self.recovered[cause] += 1
            case CuredEvent(cause=cause):
                self.cured[cause] += 1
            case _:
                pass
