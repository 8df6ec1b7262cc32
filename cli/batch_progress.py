"""What is shown while a batch runs: a live table on a terminal, lines elsewhere, events as JSON."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, Self, TextIO

from ..batch.statistics import rate

if TYPE_CHECKING:
    from rich.console import Console

    from ..batch.batch import Ended
    from ..batch.job import Job
    from ..batch.rows import JobRow
    from ..batch.summary import BatchSummary

_PERIOD = 0.5
"""Wall s between two pictures of the live table."""
_SHOWN = 8
"""Last failures that the live table shows."""


class Progress(Protocol):
    """An onlooker of a batch that holds the terminal while it is entered."""

    def __enter__(self) -> Self: ...
    def __exit__(self, *_: object) -> None: ...
    def started(self, total: int, done: Sequence[JobRow], workers: int) -> None: ...
    def ended(self, ended: Ended) -> None: ...
    def tried_again(self, job: Job, reason: str) -> None: ...
    def stopping(self, under_way: int) -> None: ...
    def waiting(self) -> None: ...


class Count:
    """Where a batch stands."""

    def __init__(self) -> None:
        self.total = self.before = self.done = self.reached = 0
        self._began = time.monotonic()

    def start(self, total: int, done: Sequence[JobRow]) -> None:
        self.total, self.before, self.done = total, len(done), len(done)
        self.reached = sum(row.status == "success" for row in done)
        self._began = time.monotonic()

    def end(self, row: JobRow) -> None:
        self.done += 1
        self.reached += row.status == "success"

    def __str__(self) -> str:
        elapsed = time.monotonic() - self._began
        fresh = self.done - self.before
        words = f"{self.done} of {self.total} jobs, goal reached {rate(self.reached, self.done)}"
        if not fresh or not elapsed:
            return words
        left = (self.total - self.done) * elapsed / fresh
        return f"{words}, {3600 * fresh / elapsed:.0f} jobs an hour, {_span(left)} left"


class Lines:
    """A line for each job that failed and, now and then, for the whole."""

    def __init__(self, console: Console, folder: Path) -> None:
        self._console, self._folder = console, folder
        self._count = Count()
        self._said = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None: ...

    def started(self, total: int, done: Sequence[JobRow], workers: int) -> None:
        self._count.start(total, done)
        self._line(f"{total} jobs, {len(done)} done before, {workers} workers; recording to {self._folder}")

    def ended(self, ended: Ended) -> None:
        self._count.end(ended.row)
        if ended.row.status != "success":
            self._line(_failure(ended))
        if self._count.done >= self._said + max(1, self._count.total // 20):
            self._said = self._count.done
            self._line(str(self._count))

    def tried_again(self, job: Job, reason: str) -> None:
        self._line(f"seed {job.seed}, {job.variant.label}: {reason}; it is tried once more")

    def stopping(self, under_way: int) -> None:
        self._line(f"stopping: {under_way} jobs under way; Ctrl-C again stops them at once")

    def waiting(self) -> None: ...

    def _line(self, text: str) -> None:
        self._console.print(text, markup=False, soft_wrap=True)


class LiveTable(Lines):
    """The count and the last failures, redrawn in place."""

    def __init__(self, console: Console, folder: Path) -> None:
        from rich.live import Live

        super().__init__(console, folder)
        self._live = Live(console=console, auto_refresh=False, transient=True)
        self._news: list[str] = []
        self._drawn = 0.0

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def ended(self, ended: Ended) -> None:
        self._count.end(ended.row)
        if ended.row.status != "success":
            self._line(_failure(ended))
        self._draw()

    def waiting(self) -> None:
        if time.monotonic() - self._drawn >= _PERIOD:
            self._draw()

    def _line(self, text: str) -> None:
        self._news = [*self._news, text][-_SHOWN:]
        self._draw()

    def _draw(self) -> None:
        from rich.text import Text

        self._drawn = time.monotonic()
        share = self._count.done / self._count.total if self._count.total else 0.0
        width = max(self._console.width - 8, 10)
        bar = "━" * round(width * share) + "┄" * (width - round(width * share))
        lines = [f"{bar} {100 * share:5.1f} %", str(self._count), "", *self._news]
        self._live.update(Text("\n".join(lines), overflow="ellipsis", no_wrap=True), refresh=True)


class EventLines:
    """One JSON object a line: started, ended, tried_again, stopping, summary."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None: ...

    def started(self, total: int, done: Sequence[JobRow], workers: int) -> None:
        self._say("started", total=total, done=len(done), workers=workers)

    def ended(self, ended: Ended) -> None:
        row = ended.row
        self._say(
            "ended",
            job=ended.job.id,
            seed=ended.job.seed,
            recipe=ended.job.variant.label,
            status=row.status,
            digest=row.digest,
            causes=list(ended.causes),
            message=row.message,
            sim_seconds=row.sim_seconds,
        )

    def tried_again(self, job: Job, reason: str) -> None:
        self._say("tried_again", job=job.id, seed=job.seed, recipe=job.variant.label, reason=reason)

    def stopping(self, under_way: int) -> None:
        self._say("stopping", under_way=under_way)

    def waiting(self) -> None: ...

    def summary(self, summary: BatchSummary) -> None:
        self._say("summary", **summary.to_json())

    def _say(self, event: str, **data: Any) -> None:
        self._stream.write(json.dumps({"event": event, **data}, ensure_ascii=False) + "\n")
        self._stream.flush()


def progress(folder: Path) -> Progress:
    """A live table on a terminal, lines elsewhere."""
    from rich.console import Console

    console = Console(highlight=False)
    return LiveTable(console, folder) if console.is_terminal else Lines(console, folder)


def _failure(ended: Ended) -> str:
    row = ended.row
    why = row.root_cause or ", ".join(ended.causes) or row.message
    return f"seed {ended.job.seed}, {ended.job.variant.label}: {row.status}" + (f": {why}" if why else "")


def _span(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02} min" if hours else f"{minutes} min {rest:02} s"
