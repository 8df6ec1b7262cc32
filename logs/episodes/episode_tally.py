"""Episodes counted while a run goes on, and in a checkpoint."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from .episode_counts import Counts, CureCount, PlantedCount
from .episode_tracker import Changed, Following, FollowingState, Node, Told


@dataclass(frozen=True, slots=True)
class EpisodesState:
    """For a checkpoint; the logs of older versions have none."""

    cures: tuple[CureCount, ...] = ()
    planted: tuple[PlantedCount, ...] = ()
    following: FollowingState = field(default_factory=FollowingState)


class EpisodeTally:
    """Counts what is decided and follows what is not; of hours of running it keeps no more than that."""

    def __init__(self, state: EpisodesState | None = None) -> None:
        state = state or EpisodesState()
        self._counts = Counts(state.cures, state.planted)
        self._following = Following(self._counts.add, self._counts.add_planted, state.following)

    def follow(self, nodes: Iterable[Node]) -> None:
        """From the next tick on it is this tree that is ticked."""
        self._following.follow(nodes)

    def take(self, time: float, changes: Iterable[Changed], events: Sequence[Told]) -> None:
        """What one tick brought."""
        self._following.take(time, changes, events)

    def state(self) -> EpisodesState:
        return EpisodesState(self._counts.cures, self._counts.planted, self._following.state())

    def so_far(self, time: float) -> Counts:
        """All that was seen until now, what is not decided as open. Nothing changes by this."""
        counts = Counts(self._counts.cures, self._counts.planted)
        self._following.copied(counts.add, counts.add_planted).finish(time)
        return counts
