"""Watchdog: time for which the arm moves while its motion is not attended."""

from __future__ import annotations

MAX_UNATTENDED_MOTION = 0.2
"""Longest motion without attention of its holder, s: four ticks. A jog and a motion that was handed over
brake by themselves before."""


class Watchdog:
    """Timer of the motion without attention. The holder of the lease restarts it in each tick."""

    def __init__(self) -> None:
        self.attended = False
        """Whether the holder has attended to its motion since the last tick."""
        self._alone = 0.0

    def expired(self, tick: float, moving: bool) -> bool:
        """Count a tick of `tick` s, and return whether the arm has moved unattended for too long."""
        self._alone = 0.0 if self.attended or not moving else self._alone + tick
        self.attended = False
        return self._alone > MAX_UNATTENDED_MOTION

    def restart(self) -> float:
        """Set the timer to zero, and return the time that it had counted, s."""
        alone, self._alone = self._alone, 0.0
        return alone
