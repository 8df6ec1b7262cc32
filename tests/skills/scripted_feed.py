"""A feed that does as a test tells it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from picktree.world import Clock, FeedSignals, ObjectId


@dataclass
class ScriptedFeed:
    """`protocols.Feed`: a load `delay` s after `ready`, an empty bin `delay` s after it was asked for, both
    only while nothing is in the way. `loads`: how many there are; `delay` of None: nobody ever comes."""

    clock: Clock
    loads: int = 0
    delay: float | None = 1.0
    obstructed_until: float = 0.0
    """Until then the arm is in the way of whoever comes."""
    deliveries: int = 0
    exchanges: dict[ObjectId, int] = field(default_factory=dict[ObjectId, int])
    heard: list[str] = field(default_factory=list[str])
    _due: float | None = None
    _asked: dict[ObjectId, float] = field(default_factory=dict[ObjectId, float])

    def ready(self) -> None:
        self.heard.append("ready")
        if self.loads and self._due is None and self.delay is not None:
            self._due = self.clock.now + self.delay

    def exchange(self, bin_id: ObjectId) -> None:
        self.heard.append(f"exchange {bin_id}")
        if self.delay is not None:
            self._asked.setdefault(bin_id, self.clock.now + self.delay)

    def read(self) -> FeedSignals:
        now = self.clock.now
        clear = now >= self.obstructed_until
        if self._due is not None and now >= self._due and clear:
            self.deliveries, self.loads, self._due = self.deliveries + 1, self.loads - 1, None
        for bin_id in [b for b, due in self._asked.items() if now >= due and clear]:
            self.exchanges[bin_id] = self.exchanges.get(bin_id, 0) + 1
            del self._asked[bin_id]
        waits = self._due is not None or bool(self._asked)
        signals = FeedSignals(self.loads == 0, waits, waits and not clear, self.deliveries)
        return replace(signals, exchanges=dict(self.exchanges))
