"""Thinking takes time as on the robot: what computing costs is charged in simulated ticks."""

from __future__ import annotations

from collections.abc import Generator


class ComputeTimeAccount:
    """Simulated seconds of computing that are owed to the clock, paid in whole ticks.

    The remainder below one tick is carried over, so that many small thoughts are charged as much as one
    large one. It is state: it belongs into a checkpoint.
    """

    def __init__(self, tick: float) -> None:
        self._tick = tick
        self.owed = 0.0
        self.total = 0.0

    @property
    def tick(self) -> float:
        """s"""
        return self._tick

    def spend(self, seconds: float) -> None:
        """Owe `seconds` more."""
        self.owed += seconds
        self.total += seconds

    def beside(self, seconds: float) -> None:
        """Count what was thought beside that for which skills wait: no one owes it."""
        self.total += seconds

    def charge(self) -> Generator[None, None, None]:
        """Let the whole ticks that are owed pass."""
        while self.owed >= self._tick:
            self.owed -= self._tick
            yield
