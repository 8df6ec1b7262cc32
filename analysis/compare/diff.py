"""Difference of two whole runs: one value, which `diff_text` renders as text and JSON."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from ...logs.schema import topics
from ..run import Run
from .alignment import Alignment, align
from .divergence import MessageDifference, first_difference
from .run_outcome import (
    CountChange,
    EndingChange,
    ItemChange,
    RunOutcome,
    TimeSpent,
    cause_changes,
    ending_changes,
    item_changes,
    outcome_of,
    time_spent,
)
from .run_settings import SetupDiff, compare_settings

Verdict: TypeAlias = Literal["identical", "cut", "alike", "apart"]
"""Verdict: `identical`: every simulated message is the same. `cut`: they are, until one log ends.

`alike`: some values differ, but every node did the same at the same times. `apart`: the nodes did not.
"""


@dataclass(frozen=True, slots=True)
class RunDiff:
    """Differences of two runs; times are simulated s."""

    verdict: Verdict
    a: RunOutcome
    b: RunOutcome
    set_up: SetupDiff
    first: MessageDifference | None
    """First simulated value that differs. When the trees differ, messages about their nodes are ignored."""
    alignment: Alignment
    """Alignment of the runs, with their divergence."""
    time: TimeSpent
    causes: tuple[CountChange, ...]
    ways: tuple[EndingChange, ...]
    items: tuple[ItemChange, ...]

    @property
    def same(self) -> bool:
        return self.verdict == "identical"


def diff(a: Run, b: Run) -> RunDiff:
    """Compare two runs of any missions, finished or cut.

    The comparison begins at the first tick that both have, also for a run and its continuation from a
    checkpoint. Raises PicktreeError for a damaged log.
    """
    alignment = align(a, b)
    since = alignment.since or None
    first = first_difference(a, b, since=since)
    if first is not None and first.topic == topics.TREE.name:
        told = (topics.TREE.name, topics.TICK.name)
        first = first_difference(a, b, since=since, without=told) or first
    return RunDiff(
        _verdict(alignment, first),
        outcome_of(a),
        outcome_of(b),
        compare_settings(a, b),
        first,
        alignment,
        time_spent(alignment),
        cause_changes(alignment),
        ending_changes(alignment),
        item_changes(a, b, alignment),
    )


def _verdict(alignment: Alignment, first: MessageDifference | None) -> Verdict:
    if first is None:
        return "identical"
    if first.missing and first.ended:
        return "cut"
    return "alike" if alignment.pairs and alignment.parting is None else "apart"
