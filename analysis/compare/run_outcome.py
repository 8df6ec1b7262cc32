"""What one run came to, for a table of two; of a killed run, what its log tells."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ...logs.visits_format_1 import derived_visits
from ..run import Run

KILLED = "killed"
"""Status of a run whose log has no result."""


@dataclass(frozen=True, slots=True)
class RunOutcome:
    log: Path
    recovered: str
    """A sentence when the file had not been finished; else empty."""
    status: str
    message: str
    """Why the tree failed; else empty."""
    end: float
    """Simulated s."""
    items_total: int | None
    """By the scorer; None when the run was killed."""
    items_sorted: int | None
    items_done: int
    """As the robot believes: how often it said that an item is where it belongs."""
    picks_tried: int
    picks_held: int
    failures: Mapping[str, int]
    """How often a node failed by itself, by cause."""
    recoveries: int
    """How often recovery was tried."""
    digest: str
    """Empty when the run was killed."""


def outcome_of(run: Run) -> RunOutcome:
    result = run.result
    failures = Counter(visit.cause for visit in run.visits or derived_visits(run.log) if visit.failed_itself)
    kinds = Counter(at.record.kind for at in run.events)
    return RunOutcome(
        log=run.path,
        recovered=run.recovered,
        status=KILLED if result is None else result.status,
        message="" if result is None else result.message,
        end=run.ticks.times[-1] if run.ticks.times else 0.0,
        items_total=None if result is None else result.items.total,
        items_sorted=None if result is None else result.items.sorted,
        items_done=kinds["item_done"],
        picks_tried=len(run.picks),
        picks_held=sum(pick.held for pick in run.picks),
        failures=dict(sorted(failures.items())),
        recoveries=kinds["recovery"],
        digest="" if result is None else result.digest,
    )
