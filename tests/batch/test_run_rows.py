"""The line on what to look at in a job leads to its root cause, not to the first failure that was seen."""

from __future__ import annotations

from dataclasses import replace

from picktree.analysis.explain import ExplainedOutcome, Explanation, RootCause
from picktree.analysis.explain.explanation import KeyMoment
from picktree.apps.batch.run_rows import look_at, root_of
from picktree.logs import Episodes

SLIPPED = RootCause("item.slippery", "can_1 is slippery", (), ended_run=False, reasons=(), time=3.0)
MISTAKEN = RootCause(
    "perception.mistaken", "can_2 is green, not blue", (), ended_run=True, reasons=(), time=1.5
)
WHOLE = Explanation(
    outcome=ExplainedOutcome("incomplete", "1 of 2 items sorted", 9.0, 1, 2),
    failures=(),
    root_causes=(SLIPPED, MISTAKEN),
    items=(),
    look_at=(KeyMoment(3.0, "can_1: the item slides out of the fingers"),),
    recovery=Episodes((), ()),
)


def test_the_root_cause_that_cost_the_goal_is_looked_at() -> None:
    root = root_of(WHOLE)
    assert root == MISTAKEN
    assert look_at(WHOLE, root) == "1.50 s: can_2 is green, not blue"


def test_without_one_that_cost_the_goal_it_is_the_first() -> None:
    reached = replace(WHOLE, root_causes=(SLIPPED,))
    assert look_at(reached, root_of(reached)) == "3.00 s: can_1 is slippery"


def test_a_root_cause_without_a_time_is_told_all_the_same() -> None:
    timeless = replace(WHOLE, root_causes=(replace(MISTAKEN, time=None),))
    assert look_at(timeless, root_of(timeless)) == "can_2 is green, not blue"


def test_without_a_root_cause_it_is_the_first_moment_worth_a_look() -> None:
    unknown = replace(WHOLE, root_causes=())
    assert root_of(unknown) is None
    assert look_at(unknown, None) == "3.00 s: can_1: the item slides out of the fingers"
    assert look_at(replace(unknown, look_at=()), None) == ""
