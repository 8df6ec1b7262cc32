"""Displays of a running batch: a live table on a terminal, lines elsewhere, events as JSON."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, Self, TextIO

from picktree.logs import Rate, rate

if TYPE_CHECKING:
    from rich.console import Console

    from picktree.apps.batch import BatchSummary, Job, JobRow, RecordedJob


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
        """Return the expected end, as `in 18 min, at 23:14`; empty before the first and after the last."""
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


_REDRAW_PERIOD = 1.0
"""Interval between redraws of the live table, wall s."""
_MAX_SHOWN_FAILURES = 8
"""Number of recent failures in the live table."""


class BatchDisplay(Protocol):
    """Observer of a batch that holds the terminal while it is entered."""

    def __enter__(self) -> Self: ...
    def __exit__(self, *_: object) -> None: ...
    def started(self, total: int, done: Sequence[JobRow], workers: int) -> None: ...
    def ended(self, ended: RecordedJob) -> None: ...
    def tried_again(self, job: Job, reason: str) -> None: ...
    def stopping(self, under_way: int) -> None: ...
    def waiting(self) -> None: ...


class Lines:
    """Display with a line for each failed job and, now and then, for the whole batch."""

    def __init__(self, console: Console, folder: Path) -> None:
        self._console, self._folder = console, folder
        self._count = BatchCount()
        self._said = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None: ...

    def started(self, total: int, done: Sequence[JobRow], workers: int) -> None:
        self._count.start(total, done)
        self._said = len(done)
        before = f", {len(done)} done before" if done else ""
        self._line(f"{_counted(total, 'job')}{before}, {_counted(workers, 'worker')}; in {self._folder}")

    def ended(self, ended: RecordedJob) -> None:
        self._count.end(ended.row)
        if ended.row.status != "success":
            self._line(_failure(ended))
        if self._count.done >= self._said + max(1, self._count.total // 20):
            self._said = self._count.done
            self._line(str(self._count))

    def tried_again(self, job: Job, reason: str) -> None:
        self._line(_again(job, reason))

    def stopping(self, under_way: int) -> None:
        self._line(_stopping(under_way))

    def waiting(self) -> None: ...

    def _line(self, text: str) -> None:
        self._console.print(text, markup=False, soft_wrap=True)


class LiveTable:
    """Display with the count and the last failures, redrawn in place."""

    def __init__(self, console: Console, folder: Path) -> None:
        from rich.live import Live

        self._console, self._folder = console, folder
        self._live = Live(console=console, auto_refresh=False, transient=True)
        self._count = BatchCount()
        self._workers = 0
        self._stopping = ""
        self._news: list[str] = []
        self._drawn = 0.0

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def started(self, total: int, done: Sequence[JobRow], workers: int) -> None:
        self._count.start(total, done)
        self._workers = workers
        self._draw()

    def ended(self, ended: RecordedJob) -> None:
        self._count.end(ended.row)
        if ended.row.status != "success":
            self._news = [*self._news, _failure(ended)][-_MAX_SHOWN_FAILURES:]

    def tried_again(self, job: Job, reason: str) -> None:
        self._news = [*self._news, _again(job, reason)][-_MAX_SHOWN_FAILURES:]

    def stopping(self, under_way: int) -> None:
        self._stopping = _stopping(under_way)
        self._draw()

    def waiting(self) -> None:
        if time.monotonic() - self._drawn >= _REDRAW_PERIOD:
            self._draw()

    def _draw(self) -> None:
        from rich.text import Text

        self._drawn = time.monotonic()
        self._live.update(Text("\n".join(self._lines())), refresh=True)

    def _lines(self) -> list[str]:
        count = self._count
        width = max(self._console.width - 8, 10)
        filled = round(width * count.share)
        speed, end = count.speed(), count.end_in_words()
        return [
            f"{'━' * filled}{'┄' * (width - filled)} {100 * count.share:5.1f} %",
            f"jobs  {count.done} of {count.total}, {_counted(self._workers, 'worker')}",
            f"goal  {count.success}",
            *([f"pace  {speed}"] if speed else []),
            *([f"done  {end}"] if end else []),
            *([self._stopping] if self._stopping else []),
            *(["", *self._news] if self._news else []),
        ]


class EventLines:
    """Display with one JSON object per line: started, ended, tried_again, stopping, summary."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None: ...

    def started(self, total: int, done: Sequence[JobRow], workers: int) -> None:
        self._say("started", total=total, done=len(done), workers=workers)

    def ended(self, ended: RecordedJob) -> None:
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


class UnlessPipeClosed:
    """Wrapper of a display that goes silent when its reader closes the pipe, so that the batch continues."""

    def __init__(self, inner: BatchDisplay, stream: TextIO) -> None:
        self._inner, self._stream = inner, stream
        self._read = True

    def __enter__(self) -> Self:
        self._say(self._inner.__enter__)
        return self

    def __exit__(self, *_: object) -> None:
        self._say(self._inner.__exit__)

    def started(self, total: int, done: Sequence[JobRow], workers: int) -> None:
        self._say(self._inner.started, total, done, workers)

    def ended(self, ended: RecordedJob) -> None:
        self._say(self._inner.ended, ended)

    def tried_again(self, job: Job, reason: str) -> None:
        self._say(self._inner.tried_again, job, reason)

    def stopping(self, under_way: int) -> None:
        self._say(self._inner.stopping, under_way)

    def waiting(self) -> None:
        self._say(self._inner.waiting)

    def _say(self, what: Any, *words: object) -> None:
        if not self._read:
            return
        try:
            what(*words)
        except OSError:  # a pipe that was closed, a terminal that is gone
            self._read = False
            discard(self._stream)
            with suppress(OSError):
                print(
                    "the reader is gone; the batch continues, and Ctrl-C stops it",
                    file=sys.stderr,
                    flush=True,
                )


def discard(stream: TextIO) -> None:
    """Discard everything that is or will be written to the stream."""
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, stream.fileno())
    os.close(nothing)


def progress(folder: Path, answer: TextIO | None) -> BatchDisplay:
    """Return a live table on a terminal, lines elsewhere; events where there is an `answer`."""
    if answer is not None:
        return UnlessPipeClosed(EventLines(answer), answer)
    from rich.console import Console

    class Plain(Console):
        def on_broken_pipe(self) -> None:
            """Prevent rich from ending the program."""
            raise

    console = Plain(highlight=False)
    shown = LiveTable(console, folder) if console.is_terminal else Lines(console, folder)
    return UnlessPipeClosed(shown, sys.stdout)


def _failure(ended: RecordedJob) -> str:
    row, job = ended.row, ended.job
    why = row.root_cause or ", ".join(ended.causes) or row.message
    return f"seed {job.seed}: {row.status}" + (f", {why}" if why else "") + f" ({job.variant.label})"


def _again(job: Job, reason: str) -> str:
    return f"seed {job.seed}: {reason}; it is tried once more ({job.variant.label})"


def _stopping(under_way: int) -> str:
    if not under_way:
        return "stopping"
    return f"stopping: {_counted(under_way, 'job')} under way; Ctrl-C again breaks off"


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
