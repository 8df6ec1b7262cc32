"""Why a run ended as it did, from its log alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .explanation import Explanation
from .failures import failures_of
from .family import Family
from .items import items_of
from .outcome import outcome_of

if TYPE_CHECKING:
    from ..run import Run


def explain(run: Run) -> Explanation:
    """Raises PicktreeError where the log is damaged."""
    family = Family(run.visits)
    failures = failures_of(run, family)
    return Explanation(
        outcome=outcome_of(run, run.visits),
        failures=failures,
        root_causes=(),
        items=items_of(run, failures),
        look_at=(),
    )
