"""Why a run ended as it did, from its log alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .case import Case
from .explanation import Explanation
from .failures import failures_of
from .family import Family
from .items import items_of
from .outcome import outcome_of
from .roots import root_causes_of

if TYPE_CHECKING:
    from ..run import Run


def explain(run: Run, *, faults: bool = True) -> Explanation:
    """`faults`: quote faults that were planted, where they concern the same items; the causes that are named
    follow from the rest of the log, with and without.

    Raises PicktreeError where the log is damaged.
    """
    family = Family(run.visits)
    failures = failures_of(run, family)
    outcome = outcome_of(run, run.visits)
    case = Case(run, family, failures)
    planted = case.events("fault") if faults else []
    return Explanation(
        outcome=outcome,
        failures=failures,
        root_causes=root_causes_of(case, outcome, planted),
        items=items_of(run, failures),
        look_at=(),
    )
