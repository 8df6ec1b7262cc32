"""Time that computing costs: wall seconds by part of the work, and simulated seconds owed to the clock."""

from __future__ import annotations

import time
from collections.abc import Generator, Mapping
from contextlib import contextmanager


class Stopwatch:
    """Adds up wall seconds by name. Parts may nest: the inner one's time is not counted for the outer."""

    def __init__(self) -> None:
        self._seconds: dict[str, float] = {}
        self._running: list[str] = []
        self._since = 0.0

    @contextmanager
    def measure(self, part: str) -> Generator[None]:
        """Count the time in here for `part`."""
        self._switch()
        self._running.append(part)
        try:
            yield
        finally:
            self._switch()
            self._running.pop()

    def reassign(self, seconds: float, part: str) -> None:
        """Count that many seconds of the part now measured for `part` instead. This suits short and
        frequent work, such as a physics step."""
        self._seconds[part] = self._seconds.get(part, 0.0) + seconds
        if self._running:
            self._since += seconds

    def seconds(self) -> Mapping[str, float]:
        """Return a copy of the wall seconds so far, by part."""
        return dict(self._seconds)

    def _switch(self) -> None:
        now = time.perf_counter()
        if self._running:
            part = self._running[-1]
            self._seconds[part] = self._seconds.get(part, 0.0) + now - self._since
        self._since = now


class ComputeTimeAccount:
    """Simulated seconds of computing that are owed to the clock, paid in whole ticks.

    The remainder below one tick is carried over, so that many short computations are charged as much as one
    long one. It is state: it belongs into a checkpoint.
    """

    def __init__(self, tick: float) -> None:
        """`tick`: length of a tick, simulated s."""
        self.tick = tick
        self.owed = 0.0
        self.total = 0.0

    def spend(self, seconds: float) -> None:
        """Owe `seconds` more."""
        self.owed += seconds
        self.total += seconds

    def add_unowed(self, seconds: float) -> None:
        """Count computing for which no skill waits, so that nothing is owed."""
        self.total += seconds

    def charge(self) -> Generator[None, None, None]:
        """Let the whole ticks that are owed pass."""
        while self.owed >= self.tick:
            self.owed -= self.tick
            yield
