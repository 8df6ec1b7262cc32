"""The feed of a cell to which nothing is brought."""

from __future__ import annotations

from .protocols import FeedSignals
from .values import ObjectId

NOTHING = FeedSignals()


class NoFeed:
    """`protocols.Feed`: nobody is there to hear."""

    def ready(self) -> None: ...

    def exchange(self, bin_id: ObjectId) -> None: ...

    def read(self) -> FeedSignals:
        return NOTHING
