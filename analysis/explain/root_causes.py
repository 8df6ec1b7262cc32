"""Root causes: what the failures, and the items that are not where they belong, ultimately came from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ...logs.run_log import Stamped
from ...logs.visits import covered_time
from ...world.events.run_events import FaultEvent
from .causes.contact_causes import pressed_from_below, touched
from .causes.item_whereabouts import camera_off, misjudged, through_the_camera, wrong_location_cause
from .causes.obstruction_causes import obstruction_cause
from .causes.run_endings import by_the_mission, run_ended
from .causes.slip_causes import grip_loss_cause, too_heavy
from .causes.unsorted_items import after_wrong_bin, placed_at, why_not_sorted
from .investigation.case import Finding, Investigation
from .investigation.explanation import ExplainedOutcome, FailureStory, RootCause
from .investigation.number_wording import seconds

DISPLACING = frozenset({"item.moved", "item.left_bin", "item.pushed_by_arm"})
PLACES = frozenset({"item.out_of_reach", "item.beside_bin", "item.crowded", "item.hemmed_in"})
"""Causes that an item has where it lies: what brought it there is the root of them."""
RUN = frozenset({"run.limit", "run.interrupted", "run.killed", "run.crashed", "tree.condition"})


@dataclass
class _Group:
    """All that came from one finding."""

    findings: list[Finding] = field(default_factory=list[Finding])
    failures: list[FailureStory] = field(default_factory=list[FailureStory])
    items: set[str] = field(default_factory=set[str])
    """True items that are not where they belong because of it."""


def root_causes_of(
    case: Investigation, outcome: ExplainedOutcome, planted: Sequence[Stamped[FaultEvent]]
) -> tuple[RootCause, ...]:
    """Those that ended the run, or cost it its goal, first; then by the time that they cost."""
    groups: dict[tuple[str, str], _Group] = {}
    by_failure = _of_failures(case)
    for failure in case.failures:
        finding = by_failure[failure.number]
        group = groups.setdefault((finding.cause, finding.about), _Group())
        group.findings.append(finding)
        group.failures.append(failure)
    for true in _unsorted(case) if outcome.status != "success" else ():
        names = case.believed.get(true, ())
        done = placed_at(case, true)
        if outcome.status not in ("success", "incomplete") and done is None and case.gone(true) is None:
            continue  # the run was over before its turn came
        to_blame = [
            by_failure[f.number]
            for f in case.failures
            if f.item in names and f.fate != "cured" and (done is None or f.time > done)
        ]
        if not to_blame:
            finding = why_not_sorted(case, true)
            to_blame = [] if finding is None else [finding]
            for each in to_blame:
                groups.setdefault((each.cause, each.about), _Group()).findings.append(each)
        for each in to_blame:
            groups[each.cause, each.about].items.add(true)
    ending = run_ended(case, outcome)
    if ending is not None:
        groups.setdefault((ending.cause, ending.about), _Group()).findings.append(ending)
    found = [_root(case, group, outcome, planted) for group in groups.values()]
    return tuple(sorted(found, key=_order))


def _of_failures(case: Investigation) -> Mapping[int, Finding]:
    """The finding for each failure; one that follows from another has that one's."""
    camera = camera_off(case) if case.failures else None
    found: dict[int, Finding] = {}
    displaced: dict[str, Finding] = {}
    """What brought a true item to where it lies now."""
    for failure in case.failures:
        if failure.because_of is not None:
            found[failure.number] = found[failure.because_of]
        else:
            found[failure.number] = (
                by_the_mission_first(case, failure)
                or wrong_location_cause(case, failure)
                or through_the_camera(camera, failure)
                or after_wrong_bin(case, failure)
                or too_heavy(case, failure)
                or (touched(case, failure) if pressed_from_below(failure) else None)
                or grip_loss_cause(case, failure)
                or obstruction_cause(case, failure)
                or misjudged(case, failure)
                or by_the_mission(case, failure)
                or touched(case, failure)
                or _as_it_says(failure)
            )
        finding, true = found[failure.number], case.pairs.get(failure.item, "")
        if finding.cause in DISPLACING:
            displaced[true] = finding
        elif finding.cause in PLACES and true in displaced and not _held_since(case, true, displaced[true]):
            found[failure.number] = displaced[true]
    return found


def _held_since(case: Investigation, true: str, displaced: Finding) -> bool:
    """Whether the robot had the item in its hand after it had been moved there."""
    names = case.believed.get(true, ())
    return any(p.held and p.object in names and p.time > (displaced.time or 0.0) for p in case.run.picks)


def by_the_mission_first(case: Investigation, failure: FailureStory) -> Finding | None:
    """Causes that say what is wrong by themselves."""
    return by_the_mission(case, failure) if failure.cause.startswith(("tree.", "internal.")) else None


def _as_it_says(failure: FailureStory) -> Finding:
    """Nothing else in the log tells more: the failure's own words."""
    about = failure.item or failure.node
    said = failure.message or failure.sentence
    of = f" of {failure.item}" if failure.item and failure.item not in said else ""
    title = f"{failure.name}{of} failed: {said}"
    reasons = ("nothing else in the log tells where it came from",)
    return Finding(failure.cause, about, title, reasons, failure.item, failure.time)


def _unsorted(case: Investigation) -> list[str]:
    """True items that do not lie where they belong at the end of the log."""
    return [true for true, judged in case.scores.items() if judged.verdict != "sorted"]


def _root(
    case: Investigation, group: _Group, outcome: ExplainedOutcome, planted: Sequence[Stamped[FaultEvent]]
) -> RootCause:
    first = group.findings[0]
    ended = first.cause in RUN or any(f.fate == "ended" for f in group.failures)
    missed = outcome.status == "incomplete" and bool(group.items)
    reasons = list(dict.fromkeys(first.reasons))
    others = sorted({f.item for f in group.findings if f.item and f.item != first.item})
    if others:
        reasons.append(f"so it was with {', '.join(others)}, too")
    return RootCause(
        cause=first.cause,
        title=first.title,
        failures=tuple(f.number for f in group.failures),
        ended_run=outcome.status != "success" and (ended or missed),
        reasons=tuple(reasons),
        item=first.item,
        time=first.time,
        seconds_lost=covered_time(f.undecided for f in group.failures),
        planted=tuple(_planted(case, group, planted)),
    )


def _planted(case: Investigation, group: _Group, planted: Sequence[Stamped[FaultEvent]]) -> list[str]:
    """Faults of the fault file that concern the same items, not later than the failures."""
    items = {case.pairs.get(f.item, f.item) for f in group.findings} | group.items
    items |= {case.pairs[f.item] for f in group.failures if f.item in case.pairs}
    last = max((f.time for f in group.failures), default=case.end)
    return [
        f"at {seconds(at.time)}: {at.record.message}"
        for at in planted
        if at.record.item in items and at.time <= last + 1e-6
    ]


def _order(root: RootCause) -> tuple[bool, bool, float, float]:
    return (not root.ended_run, root.cause not in RUN, -root.seconds_lost, root.time or 0.0)
