"""What is said of a batch under way: on a terminal, wide and narrow, and in lines."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import pytest
from rich.console import Console

from picktree.apps.batch import Job, JobRow, RecordedJob
from picktree.apps.batch.plan import Variant
from picktree.apps.cli.batch_progress import BatchCount, Lines, LiveTable, span

NOON = datetime(2026, 3, 4, 12, 0).timestamp()
REACHED = JobRow(
    status="success",
    message="",
    digest="d",
    attempts=1,
    items_total=1,
    items_sorted=1,
    items_misplaced=0,
    items_left=0,
    picks_tried=1,
    picks_held=1,
    sim_seconds=9.0,
    cpu_seconds=1.0,
    wall_seconds=1.0,
    last_tick=180,
)
MISSED = replace(REACHED, status="failure", root_cause="grasp.slipped")


def job(seed: int) -> Job:
    return Job(f"job{seed}", seed, Variant(Path("sort.yaml"), None, None, {}, "sort"), seed, "recipe")


def ended(seed: int, row: JobRow) -> RecordedJob:
    return RecordedJob(job(seed), row, (row.root_cause,) if row.root_cause else ())


class Clock:
    now = NOON

    def __call__(self) -> float:
        return self.now


def test_the_end_is_told_from_the_pace_since_the_batch_was_gone_on_with() -> None:
    clock = Clock()
    count = BatchCount(clock)
    count.start(100, [REACHED] * 40)
    assert str(count) == "40 of 100 jobs, goal reached 40 of 40 (100.0 %, 91.2 … 100.0 %)"
    clock.now += 60
    count.end(REACHED)
    clock.now += 60
    count.end(MISSED)
    assert str(count) == (
        "42 of 100 jobs, goal reached 41 of 42 (97.6 %, 87.7 … 99.6 %), 60 jobs an hour, "
        "done in 58 min, at 13:00"
    )
    clock.now += 30  # the end draws nearer while nothing ends, and is not put off
    assert count.end_in_words() == "in 58 min, at 13:00"
    clock.now += 12 * 3600
    assert count.end_in_words() == "in 0 s, at 00:02"


@pytest.mark.parametrize(
    ("left", "words"),
    [
        (3, "in 3 h 00 min, at 15:00"),
        (20, "in 20 h 00 min, Thu at 08:00"),
        (200, "in 200 h 00 min, on 12 Mar"),
    ],
)
def test_the_clock_time_of_the_end_says_the_day_when_it_is_another(left: int, words: str) -> None:
    clock = Clock()
    count = BatchCount(clock)
    clock.now -= 3600
    count.start(left + 1, [])
    clock.now += 3600
    count.end(REACHED)
    assert count.end_in_words() == words


@pytest.mark.parametrize(
    ("seconds", "words"), [(0, "0 s"), (59, "59 s"), (60, "1 min"), (7500, "2 h 05 min")]
)
def test_spans_are_as_exact_as_it_matters(seconds: float, words: str) -> None:
    assert span(seconds) == words


def test_piped_progress_is_lines() -> None:
    stream = io.StringIO()
    lines = Lines(Console(file=stream), Path("runs/night"))
    lines.started(40, [REACHED] * 2, 2)
    lines.tried_again(job(3), "its process was ended by SIGSEGV, at mine.py:7 in run")
    lines.ended(ended(3, MISSED))
    lines.stopping(1)
    assert stream.getvalue().splitlines() == [
        "40 jobs, 2 done before, 2 workers; in runs/night",
        "seed 3: its process was ended by SIGSEGV, at mine.py:7 in run; it is tried once more (sort)",
        "seed 3: failure, grasp.slipped (sort)",
        "stopping: 1 job under way; Ctrl-C again breaks off",
    ]


def test_the_live_table_fits_a_narrow_terminal() -> None:
    stream = io.StringIO()
    console = Console(file=stream, force_terminal=True, width=40, color_system=None, legacy_windows=False)
    table = LiveTable(console, Path("runs/night"))
    with table:
        table.started(4, [REACHED], 2)
        table.tried_again(job(3), "its process was ended by SIGSEGV, at mine.py:7 in run")
        table.ended(ended(3, MISSED))
        stream.seek(0)
        stream.truncate()
        table.stopping(2)
        told = re.sub(r"\x1b\[\w*|\r", "", stream.getvalue()).splitlines()
    told = [line for line in told if line and not line.startswith(("pace", "done"))]
    assert told == [
        "━━━━━━━━━━━━━━━━┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄  50.0 %",
        "jobs  2 of 4, 2 workers",
        "goal  1 of 2 (50.0 %, 9.5 … 90.5 %)",
        "stopping: 2 jobs under way; Ctrl-C again",
        "breaks off",
        "seed 3: its process was ended by ",
        "SIGSEGV, at mine.py:7 in run; it is ",
        "tried once more (sort)",
        "seed 3: failure, grasp.slipped (sort)",
    ]
