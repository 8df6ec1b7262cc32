"""Watchdog: time for which the arm moves while its motion is not attended."""

from __future__ import annotations

WATCHDOG = 0.2
"""So long the arm may move without a sign of whoever commands it, s: four ticks. A jog and a motion that was
handed over brake by themselves before."""


class Watchdog:
    """Timer that a holder of the lease restarts when it looks after its motion."""

    def __init__(self) -> None:
        self.attended = False
        """Whether the holder has given a sign since the last tick."""
        self._alone = 0.0

    def expired(self, tick: float, moving: bool) -> bool:
        """Count a tick of `tick` s, and return whether the arm has moved unattended for too long."""
        self._alone = 0.0 if self.attended or not moving else self._alone + tick
        self.attended = False
        return self._alone > WATCHDOG

    def restart(self) -> float:
        """Set the timer to zero, and return the time that it had counted, s."""
        alone, self._alone = self._alone, 0.0
        return alone
