"""Tables that the motion benchmark prints, and how it measures: CPU time, medians, rates with intervals."""

from __future__ import annotations

import textwrap
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from _campaign import wilson

import numpy as np

Value = str | int | float | None


@dataclass(frozen=True)
class Column:
    """A name and how its numbers are written (a format specification)."""

    name: str
    form: str = ""


@dataclass(frozen=True)
class Table:
    title: str
    columns: tuple[Column, ...]
    rows: list[tuple[Value, ...]]
    notes: tuple[str, ...] = field(default=())
    """What the columns mean and what was compared: a paragraph each, below the table."""

    def text(self) -> str:
        head = [column.name for column in self.columns]
        cells = [
            [_written(value, column.form) for value, column in zip(row, self.columns, strict=True)]
            for row in self.rows
        ]
        widths = [max(len(line[k]) for line in [head, *cells]) for k in range(len(head))]
        left = [
            all(isinstance(row[k], str) for row in self.rows) and k == 0 for k in range(len(self.columns))
        ]

        def line(of: Sequence[str]) -> str:
            sided = zip(of, widths, left, strict=True)
            return "  " + "  ".join(c.ljust(w) if at_left else c.rjust(w) for c, w, at_left in sided).rstrip()

        lines = [self.title, line(head), "  " + "  ".join("-" * w for w in widths)]
        lines += [line(row) for row in cells]
        for note in self.notes:
            lines += textwrap.wrap(
                " ".join(note.split()),
                100,
                break_on_hyphens=False,
                initial_indent="  ",
                subsequent_indent="  ",
            )
        return "\n".join(lines)

    def to_json(self) -> dict[str, object]:
        names = [column.name for column in self.columns]
        return {
            "title": self.title,
            "columns": names,
            "rows": [list(row) for row in self.rows],
            "notes": [" ".join(note.split()) for note in self.notes],
        }


@dataclass(frozen=True)
class Part:
    """One subject of the benchmark."""

    name: str
    about: str
    unit: str
    """What `--runs` counts."""
    runs: int
    cost: float
    """CPU seconds of one run, about."""
    measure: Callable[[int, int], list[Table]]
    """From how many runs and the first seed."""

    def forecast(self, runs: int) -> str:
        return f"{self.name:10} {runs:6} {self.unit:42} about {max(1.0, runs * self.cost):5.0f} s CPU"


def cpu(work: Callable[[], object]) -> float:
    """CPU seconds of one call."""
    begun = time.process_time()
    work()
    return time.process_time() - begun


def share(hits: int, total: int) -> str:
    """A rate with its N and 95 % interval (Wilson)."""
    low, high = wilson(hits, total)
    return f"{hits} of {total} ({100 * low:.2f} … {100 * high:.2f} %)"


def median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if len(values) else None


def p95(values: Sequence[float]) -> float | None:
    return float(np.percentile(values, 95)) if len(values) else None


def _written(value: Value, form: str) -> str:
    if value is None:
        return "-"
    return value if isinstance(value, str) else format(value, form)
