"""The line on what to look at in a job leads to its root cause, not to the first failure that was seen."""

from __future__ import annotations

from dataclasses import replace

import pytest

from picktree.analysis.explain import ExplainedOutcome, Explanation, RootCause
from picktree.analysis.explain.explanation import KeyMoment
from picktree.apps.batch.run_rows import look_at, root_of
from picktree.logs import Episodes

SLIPPED = RootCause("item.slippery", "can_1 is slippery", (), ended_run=False, reasons=(), time=3.0)
MISTAKEN = RootCause(
    "perception.mistaken", "can_2 is green, not blue", (), ended_run=True, reasons=(), time=1.5
)
TIMELESS = replace(MISTAKEN, time=None)
WHOLE = Explanation(
    outcome=ExplainedOutcome("incomplete", "1 of 2 items sorted", 9.0, 1, 2),
    failures=(),
    root_causes=(SLIPPED, MISTAKEN),
    items=(),
    look_at=(KeyMoment(3.0, "can_1: the item slides out of the fingers"),),
    recovery=Episodes((), ()),
)


@pytest.mark.parametrize(
    ("explained", "root", "line"),
    [
        (WHOLE, MISTAKEN, "1.50 s: can_2 is green, not blue"),  # it cost the goal
        (replace(WHOLE, root_causes=(SLIPPED,)), SLIPPED, "3.00 s: can_1 is slippery"),
        (replace(WHOLE, root_causes=(TIMELESS,)), TIMELESS, "can_2 is green, not blue"),
        (replace(WHOLE, root_causes=()), None, "3.00 s: can_1: the item slides out of the fingers"),
        (replace(WHOLE, root_causes=(), look_at=()), None, ""),
    ],
)
def test_the_root_cause_that_cost_the_goal_is_looked_at(
    explained: Explanation, root: RootCause | None, line: str
) -> None:
    assert root_of(explained) == root
    assert look_at(explained, root) == line
