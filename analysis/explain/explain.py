"""Why a run ended as it did, from its log alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from ...logs.episodes.episode import Episode
from ...logs.run_log import At
from ...logs.schema.records import Event
from ...logs.visits_format_1 import derived_visits
from .failure_stories import failures_of
from .investigation.case import Case
from .investigation.episodes_of_log import Episodes, episodes_of
from .investigation.explanation import Explanation, FailureStory, RootCause
from .investigation.visit_tree import Family
from .item_stories import items_of
from .notable_moments import moments
from .observations import observed
from .root_causes import root_causes_of
from .run_ending import outcome_of

if TYPE_CHECKING:
    from ...logs.run_record import RunRecord


def explain(run: RunRecord, *, faults: bool = True, items: bool = True) -> Explanation:
    """`faults`: quote faults that were planted, where they concern the same items; the causes that are named
    follow from the rest of the log, with and without. `items`: tell each item's story.

    Raises PicktreeError where the log is damaged.
    """
    family = Family(run.visits or derived_visits(run.log))
    failures = failures_of(run, family)
    outcome = outcome_of(run, family.visits)
    case = Case(run, family, failures)
    planted = case.events("fault") if faults else []
    causes = root_causes_of(case, outcome, planted)
    recovery = episodes_of(run)
    return Explanation(
        outcome=outcome,
        failures=tuple(_told(case, failure, causes, planted, recovery) for failure in failures),
        root_causes=causes,
        items=items_of(case) if items else (),
        look_at=moments(causes, failures, outcome),
        recovery=recovery if faults else replace(recovery, planted=()),
    )


def _told(
    case: Case,
    failure: FailureStory,
    causes: Sequence[RootCause],
    planted: Sequence[At[Event]],
    recovery: Episodes,
) -> FailureStory:
    """The failure with what only the whole run tells."""
    names = case.believed.get(case.pairs.get(failure.item, ""), ())
    done = [
        at.time
        for at in case.events("item_done", start=failure.time)
        if at.record.data.get("object") in names
    ]
    return replace(
        failure,
        observed=observed(case, failure, planted),
        made_good_at=done[0] if done and failure.fate in ("passed_over", "branched") else None,
        root_cause=next((n for n, cause in enumerate(causes) if failure.number in cause.failures), None),
        episode=_episode(failure, recovery.episodes),
    )


def _episode(failure: FailureStory, episodes: Sequence[Episode]) -> int | None:
    """The episode that a failure belongs to: of the same cause, and with one of its failures then."""
    found = [
        n
        for n, episode in enumerate(episodes)
        if episode.cause == failure.cause and any(abs(at - failure.time) < 1e-6 for at in episode.times)
    ]
    same = [n for n in found if episodes[n].node == failure.node]
    return (same or found or [None])[0]
