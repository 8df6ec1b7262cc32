"""Progress of a batch in words: number of jobs, success, speed, expected end."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from datetime import datetime, timedelta
from typing import TYPE_CHECKING

from ...batch.statistics.rates import Rate, rate

if TYPE_CHECKING:
    from ...batch.results.tables import JobRow

_DAY = 86400.0


class BatchCount:
    """Counts of a batch's jobs. `clock`: wall time, s; replaceable in tests."""

    def __init__(self, clock: Callable[[], float] = time.time) -> None:
        self.total = self.done = self.failed = 0
        self.success: Rate = rate(0, 0)
        self._clock = clock
        self._before = 0
        self._began = self._last = clock()

    def start(self, total: int, done: Sequence[JobRow]) -> None:
        """Start counting. Jobs done before a resumption do not count for the present speed."""
        self.total, self.done, self._before = total, len(done), len(done)
        reached = sum(row.status == "success" for row in done)
        self.failed = self.done - reached
        self.success = rate(reached, self.done)
        self._began = self._last = self._clock()

    def end(self, row: JobRow) -> None:
        self.done += 1
        self.failed += row.status != "success"
        self.success = rate(self.done - self.failed, self.done)
        self._last = self._clock()

    @property
    def share(self) -> float:
        return self.done / self.total if self.total else 1.0

    @property
    def seconds_a_job(self) -> float | None:
        """Wall time per job with all workers, s; None before the first end."""
        fresh = self.done - self._before
        return (self._last - self._began) / fresh if fresh and self._last > self._began else None

    def speed(self) -> str:
        """Return the speed, as `412 jobs an hour`; empty before the first end."""
        each = self.seconds_a_job
        if each is None:
            return ""
        an_hour = 3600 / each
        return f"{an_hour:.0f} jobs an hour" if an_hour >= 10 else f"{an_hour:.1f} jobs an hour"

    def end_in_words(self) -> str:
        """Return the expected end, as `in 18 min, at 23:14`; empty before the first end and after the
        last."""
        each = self.seconds_a_job
        if each is None or self.done >= self.total:
            return ""
        now = self._clock()
        end = max(now, self._last + each * (self.total - self.done))
        return f"in {span(end - now)}, {_at(end, now)}"

    def __str__(self) -> str:
        words = [f"{self.done} of {self.total} jobs", f"goal reached {self.success}", self.speed()]
        end = self.end_in_words()
        return ", ".join([word for word in words if word] + ([f"done {end}"] if end else []))


def span(seconds: float) -> str:
    """Return a duration, rounded: `40 s`, `18 min`, `2 h 05 min`."""
    if seconds < 59.5:
        return f"{seconds:.0f} s"
    hours, minutes = divmod(round(seconds / 60), 60)
    return f"{hours} h {minutes:02} min" if hours else f"{minutes} min"


def _at(end: float, now: float) -> str:
    moment = datetime.fromtimestamp(end)
    days = (moment.date() - datetime.fromtimestamp(now).date()) // timedelta(days=1)
    return (
        f"at {moment:%H:%M}"
        if days == 0
        else f"{moment:%a} at {moment:%H:%M}"
        if days < 7
        else f"on {moment:%d %b}"
    )
