"""What the robot has heard of its feed and taken notice of. Part of the checkpoint."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ..protocols import FeedSignals
from ..values import ObjectId


@dataclass(frozen=True, slots=True)
class NoticedState:
    """See `Noticed`."""

    deliveries: int = 0
    exchanges: Mapping[ObjectId, int] = field(default_factory=dict[ObjectId, int])


class Noticed:
    """Counts of the feed's lines up to which the belief has followed them: whatever came since is news."""

    def __init__(self) -> None:
        self.deliveries = 0
        """Of these it is known that they came: somebody has looked, or waits for no more."""
        self._exchanges: dict[ObjectId, int] = {}

    def exchanged(self, signals: FeedSignals) -> tuple[ObjectId, ...]:
        """Bins that were exchanged since this was asked last."""
        counts = signals.exchanges
        found = tuple(bin_id for bin_id, n in counts.items() if n > self._exchanges.get(bin_id, 0))
        self._exchanges.update((bin_id, counts[bin_id]) for bin_id in found)
        return found

    def state(self) -> NoticedState:
        return NoticedState(self.deliveries, dict(self._exchanges))

    def restore(self, state: NoticedState) -> None:
        self.deliveries = state.deliveries
        self._exchanges = dict(state.exchanges)
