"""Counters of a run, fed from the journal and the ticks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from copy import copy, deepcopy
from dataclasses import dataclass, field, fields
from typing import Any, Literal, TypeAlias

from picktree.logs import CellMotion, FigureCounter, OperatorFigures, episode_counts, item_episodes
from picktree.world import Entry, JournalEvent, event_types

Place: TypeAlias = Literal["bin", "elsewhere", "aside"]
"""Kinds of places where a mission leaves an item: a bin or hole, another place, where it was."""


@dataclass(frozen=True, slots=True)
class EpisodeCountersState:
    """State of the counters of episodes in a checkpoint; older logs have none."""

    cures: tuple[episode_counts.CureCount, ...] = ()
    planted: tuple[episode_counts.PlantedCount, ...] = ()
    following: item_episodes.EpisodeTrackerState = field(default_factory=item_episodes.EpisodeTrackerState)


@dataclass
class RunCounters:
    """Counters of one run, from the robot's belief and sensors only, and their state in a checkpoint. The
    scorer decides whether an item is sorted.

    Open episodes are tracked. Memory grows by one number for each item that is done.
    """

    tried: int = 0
    """Number of times that the fingers closed on an object."""
    held: int = 0
    objects: set[str] = field(default_factory=set[str])
    """Ids of the objects that were tried and are still in the cell."""
    first_try: set[str] = field(default_factory=set[str])
    """Ids of the objects that were held when the fingers first closed on them."""
    done: int = 0
    """Number of times that an item was placed, as the robot believes."""
    failures: Counter[str] = field(default_factory=Counter[str])
    """Number of failures of leaves by cause, and of branches that were stopped at their limit of time."""
    recovered: Counter[str] = field(default_factory=Counter[str])
    """Number of handler runs by cause."""
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
    places: dict[str, Place] = field(default_factory=dict[str, "Place"])
    """Believed place of each item that the mission has finished."""
    emptied: int = 0
    """Number of items in bins that were exchanged; their ids are no longer needed."""
    episodes: EpisodeCountersState = field(default_factory=EpisodeCountersState)
    """Episodes at the start of the count."""
    figures: FigureCounter = field(default_factory=FigureCounter)
    """Counter of the operators' figures."""

    def __post_init__(self) -> None:
        self._counts = episode_counts.EpisodeCounts(self.episodes.cures, self.episodes.planted)
        self._tracker = item_episodes.EpisodeTracker(self.episodes.following)

    def state(self) -> RunCounters:
        """Return a copy for a checkpoint, from which the count may continue."""
        values: dict[str, Any] = {each.name: copy(getattr(self, each.name)) for each in fields(self)}
        counts, following = self._counts, self._tracker.state()
        values["episodes"] = EpisodeCountersState(counts.cures, counts.planted, following)
        values["figures"] = deepcopy(self.figures)
        return RunCounters(**values)

    @classmethod
    def resumed(cls, state: RunCounters) -> RunCounters:
        """Return counters that continue from a checkpoint."""
        made = state.state()
        if not (made.places or made.emptied):  # a checkpoint of an older log
            made.emptied = made.done
        return made

    @property
    def cures(self) -> tuple[episode_counts.CureCount, ...]:
        """Decided episodes, counted by cause and last cure."""
        return self._counts.cures

    @property
    def planted(self) -> tuple[episode_counts.PlantedCount, ...]:
        """Injected faults of which the outcome is known, counted by kind and first cause."""
        return self._counts.planted

    def finish(self, time: float) -> None:
        """End the count at `time`, simulated s: count what is undecided as open."""
        self._counted(self._tracker.copied().finish(time))

    def _counted(self, decisions: tuple[item_episodes.Decision, ...]) -> tuple[item_episodes.Decision, ...]:
        for decision in decisions:
            self._counts.add(decision)
        return decisions

    @property
    def tried_objects(self) -> int:
        """Number of different objects on which the fingers closed."""
        return self.gone + len(self.objects)

    @property
    def held_first_try(self) -> int:
        return self.gone_first_try + len(self.first_try)

    def count(self, place: Place) -> int:
        """Return the number of items at places of a kind, as the robot believes."""
        there = sum(each == place for each in self.places.values())
        return there + self.emptied if place == "bin" else there

    def progress(self, total: int) -> str:
        """Return the progress as text: `5 of 8 items done, 2 put elsewhere, 1 set aside`."""
        others = ((self.count("elsewhere"), "put elsewhere"), (self.count("aside"), "set aside"))
        parts = [f"{self.count('bin')} of {total} items done"]
        return ", ".join([*parts, *(f"{number} {words}" for number, words in others if number)])

    def operator_figures(self, now: float) -> OperatorFigures:
        """Return the operators' figures up to `now`, simulated s, as the robot believes."""
        return OperatorFigures((self.figures.counts(now),))

    def _forget(self, objects: Iterable[str]) -> None:
        objects = set(objects)
        self.emptied += sum(self.places.pop(each, "") == "bin" for each in objects)
        gone = self.objects.intersection(objects)
        self.gone += len(gone)
        self.gone_first_try += len(gone & self.first_try)
        self.objects -= gone
        self.first_try -= gone

    def follow(self, nodes: Iterable[item_episodes.NodeLike]) -> None:
        """Use another tree from the next tick on."""
        nodes = tuple(nodes)
        self._tracker.follow(nodes)
        self.figures.follow(nodes)

    def take(
        self,
        time: float,
        entries: Iterable[Entry],
        leaves: frozenset[str],
        changes: Iterable[item_episodes.TransitionLike],
        motion: CellMotion | None = None,
    ) -> tuple[item_episodes.Decision, ...]:
        """Count the results of one tick, and return the decisions about failures of it.

        `leaves` are the paths of the nodes without children. `changes` are the starts and ends of nodes, in
        order. `motion` is that of arm and fingers after the tick; None: unknown.
        """
        changes = tuple(changes)
        events = [entry for entry in entries if isinstance(entry, JournalEvent)]
        for event in events:
            self._happened(event)
        for change in changes:
            own = change.path in leaves or (change.cause == "tree.timeout" and change.origin == change.path)
            if change.status == "FAILURE" and change.cause and own:
                self.failures[change.cause] += 1
        decisions = self._counted(self._tracker.take(time, changes, events))
        self.figures.take(time, events, decisions, changes, motion)
        return decisions

    def _happened(self, event: JournalEvent) -> None:
        match event:
            case event_types.PickEvent(object=subject, held=held):
                self.tried += 1
                self.held += held
                if subject not in self.objects and held:
                    self.first_try.add(subject)
                self.objects.add(subject)
            case event_types.ItemDoneEvent(object=subject, into=into):
                self.done += 1
                self.places[subject] = "bin" if into else "elsewhere"
            case event_types.TookStockEvent(done=done):
                self.places |= dict.fromkeys(done or (), "bin")
            case event_types.DeliveryEvent() | event_types.BeltStopsEvent():
                self.deliveries += 1
            case event_types.BinExchangedEvent():
                self.exchanges += 1
            case event_types.SetAsideEvent(object=subject):
                self.set_aside += 1
                self.places[subject] = "aside"
            case event_types.BinEmptiedEvent(objects=objects):
                self._forget(objects)
            case event_types.RecoveryEvent(cause=cause):
                self.recovered[cause] += 1
            case _:
                pass
