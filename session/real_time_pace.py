"""Pace of a run against the wall clock."""

from __future__ import annotations

import time
from collections.abc import Callable

from ..trees.running.runner import TickReport
from .observer import Observer

_MAX_CATCH_UP = 0.5
"""Maximum delay that is caught up after a slow tick, wall s; the rest of a longer one is not caught up."""


class WallClockPacer(Observer):
    """Observer that limits simulated time to `factor` times the wall clock by waiting after each tick.

    The run itself is not affected.
    """

    def __init__(
        self,
        factor: float,
        *,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """`factor` is above 0: simulated seconds per wall second."""
        self._factor = factor
        self._clock, self._sleep = clock, sleep
        self._due: float | None = None
        self._before = 0.0

    def ticked(self, now: float, report: TickReport, items_done: int, items_total: int) -> None:
        wall = self._clock()
        if self._due is None:
            self._due, self._before = wall, now
        self._due = max(self._due + (now - self._before) / self._factor, wall - _MAX_CATCH_UP)
        self._before = now
        if self._due > wall:
            self._sleep(self._due - wall)
