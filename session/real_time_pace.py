"""Pace of a run against the wall clock."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from ..logs.run_result import RunResult
from ..trees.running.runner import NodeInfo, TickReport
from .observer import SessionWatcher

_MAX_CATCH_UP = 0.5
"""Maximum delay that is caught up after a slow tick, wall s; the rest of a longer one is not caught up."""


class WallClockPacer:
    """Watcher that limits simulated time to `factor` times the wall clock by waiting after each tick.

    It forwards all calls to the watcher that it wraps. The run itself is not affected.
    """

    def __init__(
        self,
        watcher: SessionWatcher,
        factor: float,
        *,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """Wrap `watcher`. `factor` is above 0: simulated seconds per wall second."""
        self._watcher = watcher
        self._factor = factor
        self._clock, self._sleep = clock, sleep
        self._due: float | None = None
        self._before = 0.0

    def ticked(self, now: float, report: TickReport, items_done: int, items_total: int) -> None:
        self._watcher.ticked(now, report, items_done, items_total)
        wall = self._clock()
        if self._due is None:
            self._due, self._before = wall, now
        self._due = max(self._due + (now - self._before) / self._factor, wall - _MAX_CATCH_UP)
        self._before = now
        if self._due > wall:
            self._sleep(self._due - wall)

    def started(self, structure: tuple[NodeInfo, ...], folder: Path) -> None:
        self._watcher.started(structure, folder)

    def edited(self, structure: tuple[NodeInfo, ...]) -> None:
        self._watcher.edited(structure)

    def told(self, now: float, text: str) -> None:
        self._watcher.told(now, text)

    def finished(self, result: RunResult) -> None:
        self._watcher.finished(result)
