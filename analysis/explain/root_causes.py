"""Root causes of failures, and of items that are not at their destination.

The search begins at the end: with each item that is not at its destination, and each failure that cost time.
For each it runs the same detectors in one order (`FAILURE_DETECTORS`); the first result is its finding. Equal
findings are one root cause, ranked by its cost: items first, then seconds.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, TypeAlias

from picktree.files import listed
from picktree.logs import Stamped
from picktree.world import event_types, world

from .case import Investigation
from .device_causes import device_findings
from .explanation import ExplainedOutcome, FailureStory, Finding, RootCause, seconds
from .held_items import explain_drop, explain_overweight, held_periods, pressed_from_below
from .item_causes import (
    explain_misjudged_place,
    explain_missing_item,
    explain_too_wide,
    explain_wrong_place,
    explain_wrong_size,
)
from .obstruction_causes import explain_contact, explain_obstruction
from .run_endings import (
    explain_missed_goal,
    explain_missing_grasp,
    explain_mission_error,
    explain_run_end,
    explain_unacknowledged_stop,
)
from .unsorted_items import (
    explain_crushed_item,
    explain_left_in_tote,
    explain_unsorted,
    explain_wrong_bin,
    placed_at,
)

DISPLACEMENT_CAUSES = frozenset(
    {"item.moved", "item.left_bin", "item.pushed_by_arm", "item.struck",
     "item.slipped", "item.slippery", "item.heavy", "grasp.weak", "gripper.weak", "grasp.not_felt"}
)  # fmt: skip
PLACE_CAUSES = frozenset({"item.out_of_reach", "item.beside_bin", "item.crowded", "item.hemmed_in"})
"""Causes due to an item's place: their root is the event that brought the item there."""
RUN_CAUSES = frozenset(
    {
        "run.interrupted",
        "run.stopped",
        "run.killed",
        "run.crashed",
        "run.going_on",
        "run.paused",
        "tree.condition",
    }
)
"""Causes that end a run by themselves."""
MIN_SHARE = 0.2
"""Least share of a timed-out run that the failures must have cost to be the reason of the timeout."""

FailureDetector: TypeAlias = Callable[[Investigation, FailureStory], Finding | None]


def explain_device_fault(case: Investigation, failure: FailureStory) -> Finding | None:
    """Return the finding about a faulty device that covers the failure: sensor, joint, fingers or planner."""
    return next(
        (
            found.finding
            for found in case.once(device_findings)
            if found.covers(failure, case.visit(failure).start)
        ),
        None,
    )


def explain_push_from_below(case: Investigation, failure: FailureStory) -> Finding | None:
    """Return the finding about the body that bore the weight of an item reported as slipped; else None."""
    return explain_contact(case, failure) if pressed_from_below(failure) else None


FAILURE_DETECTORS: Final[tuple[FailureDetector, ...]] = (
    # Device faults, which several failures may share, and failures whose own message names the cause.
    explain_device_fault,
    explain_left_in_tote,
    explain_mission_error,
    explain_missing_grasp,
    # True properties of the item, and its true existence.
    explain_wrong_size,
    explain_too_wide,
    explain_overweight,
    explain_missing_item,
    # Forces, and the loss of the item from the hand.
    explain_push_from_below,
    explain_drop,
    # True and believed place, obstructions, contacts.
    explain_wrong_place,
    explain_wrong_bin,
    explain_obstruction,
    explain_misjudged_place,
    explain_unacknowledged_stop,
    explain_contact,
)
"""Detectors of a failure's cause, in this order; the first finding counts."""


@dataclass
class _Group:
    """Failures and items with the same finding."""

    findings: list[Finding] = field(default_factory=list[Finding])
    failures: list[FailureStory] = field(default_factory=list[FailureStory])
    items: dict[str, None] = field(default_factory=dict[str, None])
    """True items that are not at their destination because of it."""


def root_causes_of(
    case: Investigation, outcome: ExplainedOutcome, planted: Sequence[Stamped[event_types.FaultEvent]]
) -> tuple[RootCause, ...]:
    """Return the root causes, those that cost most first.

    A failure is no root cause when the mission lists an action for it under `instead`.
    """
    groups: dict[tuple[str, str], _Group] = {}

    def group(finding: Finding) -> _Group:
        found = groups.setdefault((finding.cause, finding.about), _Group())
        found.findings.append(finding)
        return found

    by_failure = _findings_by_failure(case)
    for failure in case.failures:
        if failure.number not in case.once(_answered_instead):
            group(by_failure[failure.number]).failures.append(failure)
    for true in _unsorted(case, outcome):
        finding = _why_unsorted(case, true, by_failure)
        if finding is not None:
            group(finding).items[true] = None
    ending = explain_run_end(case, outcome) or (explain_missed_goal(case, outcome) if not groups else None)
    if ending is not None:
        group(ending)
    costs = _costs(case, by_failure)
    roots = [_root(case, each, outcome, planted, costs) for each in groups.values()]
    spent = sum(root.seconds_lost for root in roots)
    to_blame = outcome.status == "timeout" and spent > MIN_SHARE * outcome.end
    roots.sort(key=lambda root: _order(root, ended_late=to_blame))
    return (replace(roots[0], ended_run=True), *roots[1:]) if to_blame else tuple(roots)


def _findings_by_failure(case: Investigation) -> Mapping[int, Finding]:
    """The finding for each failure; one that follows from another has that one's, or its own after one
    that was `_answered_instead`."""
    found: dict[int, Finding] = {}
    displaced: dict[str, Finding] = {}
    """Finding about the last displacement of each true item."""
    for failure in case.failures:
        if failure.because_of is not None and failure.because_of not in case.once(_answered_instead):
            finding = found[failure.because_of]
        else:
            answers = (detect(case, failure) for detect in FAILURE_DETECTORS)
            finding = next(
                (answer for answer in answers if answer is not None), _failure_message_finding(case, failure)
            )
        true = case.pairs.get(failure.item, "")
        before = displaced.get(true)
        if finding.cause == "item.moved" and before is not None and _kept_moving(case, true, before, finding):
            finding = before
        elif finding.cause in DISPLACEMENT_CAUSES:
            displaced[true] = finding
        elif finding.cause in PLACE_CAUSES and before is not None:
            held = (p for p in case.once(held_periods) if p.true == true)
            if not any(period.start > (before.time or 0.0) for period in held):
                finding = before
        found[failure.number] = finding
    return found


def _answered_instead(case: Investigation) -> frozenset[int]:
    """Return the numbers of the failures that a handler of `instead` took over, even in vain."""
    followed = {failure.because_of for failure in case.failures}
    return frozenset(
        failure.number
        for failure in case.failures
        if failure.done_instead
        or (failure.number in followed and any(each.instead for each in failure.handled_by))
    )


def _kept_moving(case: Investigation, true: str, before: Finding, after: Finding) -> bool:
    """Whether an item has not come to rest between its displacement and its next motion."""
    bodies = [body for _, body in case.truth.tracks[true].since(before.time or 0.0, after.time or 0.0)]
    steps = itertools.pairwise(bodies)
    return all(math.dist(a.pose.position, b.pose.position) > MIN_STEP for a, b in steps)


MIN_STEP = 1e-3
"""Displacement between two samples of the truth below which an item rests, m."""


def _failure_message_finding(case: Investigation, failure: FailureStory) -> Finding:
    """Return the failure's own message as finding, for a log without evidence of a cause."""
    about = failure.item or failure.node
    if failure.cause == world.UNKNOWN_OBJECT.name and failure.item and failure.item not in case.belief.tracks:
        title = f"the mission names the object {failure.item!r}, which was never in the belief"
        known = listed(list(case.belief.tracks), 5) or "nothing"
        reasons = (
            f"the belief had {known}",
            f'a key of the blackboard needs braces, as "{{{failure.item}}}"',
        )
        return Finding(failure.cause, about, title, reasons, failure.item, failure.time)
    message = failure.message or failure.sentence
    of = f" of {failure.item}" if failure.item and failure.item not in message else ""
    title = f"{failure.name}{of} failed: {message}"
    reasons = ("nothing else in the log shows the cause",)
    return Finding(failure.cause, about, title, reasons, failure.item, failure.time, "the log does not tell")


def _unsorted(case: Investigation, outcome: ExplainedOutcome) -> list[str]:
    """Return the true items that are not at their destination at the end, although their turn had come."""
    if outcome.status == "success":
        return []
    over = outcome.status in ("success", "incomplete")
    wrong = [true for true, judged in case.scores.items() if not judged.is_in_place]
    return [true for true in wrong if over or case.gone(true) is not None or _settled(case, true)]


def _settled(case: Investigation, true: str) -> bool:
    """Whether a truncated log has ground truth after the placement of an item."""
    done = placed_at(case, true)
    tried = any(f.item in case.believed.get(true, ()) and f.fate != "open" for f in case.failures)
    return tried if done is None else case.truth.tracks[true].times[-1] > done + SETTLING_TIME


SETTLING_TIME = 0.4
"""Time within which a released item comes to rest, s."""


def _why_unsorted(case: Investigation, true: str, by_failure: Mapping[int, Finding]) -> Finding | None:
    """Return the finding about an item that is not at its destination, by its last placement or failure."""
    if (broken := explain_crushed_item(case, true)) is not None:
        return _why_crushed(case, true, broken, by_failure)
    names = case.believed.get(true, ())
    done = placed_at(case, true)
    if done is not None and (answer := explain_unsorted(case, true)) is not None:
        after = [f for f in case.failures if f.item in names and f.fate != "cured" and f.time > done]
        if not after or answer.cause in ("mission.wrong_bin", "perception.mistaken"):
            return answer
    to_blame = [
        (by_failure[f.number], f.number in case.once(_answered_instead))
        for f in case.failures
        if f.item in names and f.fate != "cured" and (done is None or f.time > done)
    ]
    sure = [finding for finding, _ in to_blame if finding.confidence != "the log does not tell"]
    unsure = [finding for finding, answered in to_blame if not answered]
    answer = next(reversed(sure or unsure), None) or explain_unsorted(case, true)
    if answer is not None and answer.cause == "mission.not_tried":  # a stop may have taken its time
        stopped = [f for f in case.failures if f.cause == "tree.timeout" and f.fate != "cured"]
        return by_failure[stopped[-1].number] if stopped else explain_unsorted(case, true)
    return _unseen(case, answer) if answer is not None and answer.cause == "item.never_seen" else answer


CRUSH_CAUSES = (
    "camera.",
    "wrist.",
    "joint.",
    "arm.",
    "gripper.",
    "item.heavy",
    "item.larger",
    "perception.mistaken",
)
"""Causes, or their beginnings, of an excessive finger force on an item."""


def _why_crushed(
    case: Investigation, true: str, broken: Finding, by_failure: Mapping[int, Finding]
) -> Finding:
    """Return the finding about the failure in which an item was crushed, or else about the crushing
    itself."""
    time = broken.time or 0.0
    during = (f for f in case.failures if case.visit(f).start <= time <= f.time + 1e-6)
    origins = (by_failure[failure.number] for failure in during)
    return next((finding for finding in origins if finding.cause.startswith(CRUSH_CAUSES)), broken)


def _unseen(case: Investigation, answer: Finding) -> Finding:
    """Return the finding about a faulty camera that has not shown an item, or else the given finding."""
    cameras = (
        found.finding for found in case.once(device_findings) if found.finding.cause.startswith("camera.")
    )
    return next(cameras, answer)


def _costs(case: Investigation, by_failure: Mapping[int, Finding]) -> Mapping[tuple[str, str], float]:
    """Return the cost of each finding's episodes, simulated s. An episode counts once, for its first
    failure."""
    found: dict[tuple[str, str], float] = {}
    for failure in case.failures:
        finding = by_failure[failure.number]
        key = (finding.cause, finding.about)
        found[key] = found.get(key, 0.0) + failure.seconds_lost
    return found


def _root(
    case: Investigation,
    group: _Group,
    outcome: ExplainedOutcome,
    planted: Sequence[Stamped[event_types.FaultEvent]],
    costs: Mapping[tuple[str, str], float],
) -> RootCause:
    first = group.findings[0]
    ended = (
        first.cause in RUN_CAUSES
        or first.cause == "run.limit"
        or any(f.fate == "ended" for f in group.failures)
    )
    missed = outcome.status == "incomplete" and (bool(group.items) or first.cause.startswith("goal."))
    alike = [f for f in group.findings if f.item and f.item != first.item and f.item not in first.title]
    others = list(dict.fromkeys(f.item for f in alike))
    broken = (explain_crushed_item(case, true) for true in group.items if first.cause != "item.crushed")
    harm = [each.title for each in broken if each is not None]
    also = [f"the same happened to {', '.join(others)}"] if others else []
    return RootCause(
        cause=first.cause,
        title=first.title,
        failures=tuple(f.number for f in group.failures),
        ended_run=outcome.status != "success" and (ended or missed),
        reasons=(*dict.fromkeys(first.reasons), *harm, *also),
        item=first.item,
        time=first.time,
        seconds_lost=costs.get((first.cause, first.about), 0.0),
        planted=tuple(_injected_faults(case, group, planted)),
        confidence=first.confidence,
        against=first.against,
        items=tuple(case.name_of(true) for true in group.items),
    )


CAUSES_BY_FAULT: Final[Mapping[str, tuple[str, ...]]] = {
    "obstacle": ("contact.obstacle", "scene.unknown_obstacle", "scene.blocked"),
    "slip": ("item.slipped", "item.slippery"),
    "appear": ("item.appeared",),
    "gripper_jam": ("gripper.jammed",),
    "gripper_weak": ("gripper.weak", "grasp.weak"),
    "camera_drop": ("camera.silent",),
    "camera_shift": ("camera.off", "perception.misjudged"),
    "camera_noise": ("camera.noisy", "perception.phantom", "scene.unknown_obstacle"),
    "camera_mislabel": ("perception.mistaken",),
    "wrench_bias": ("wrist.biased",),
    "wrench_dead": ("wrist.silent", "safety.stale_sensor"),
    "joint_weak": ("joint.weak", "control.tracking"),
    "stall": ("arm.stalled", "control.tracking", "control.timeout"),
    "no_plan": ("planner.refuses", "planning.no_path"),
    "hang": ("skill.hangs", "tree.timeout", "run.limit"),
    "raise": ("internal.error",),
    "kill": ("run.killed",),
}
"""Root causes with which an injected fault of a kind is listed. A fault of an item is listed with the item's
causes, too."""


def _injected_faults(
    case: Investigation, group: _Group, planted: Sequence[Stamped[event_types.FaultEvent]]
) -> list[str]:
    """Return the injected faults that concern the same item or device, not later than the failures."""
    items = {case.pairs.get(f.item, f.item) for f in group.findings if f.item} | set(group.items)
    items |= {case.pairs[f.item] for f in group.failures if f.item in case.pairs}
    last = max((f.time for f in group.failures), default=case.end)
    cause = group.findings[0].cause
    return [
        f"at {seconds(at.time)}: {at.record.message}"
        for at in planted
        if (cause in CAUSES_BY_FAULT.get(at.record.fault, ()) or at.record.item in items)
        and at.record.struck
        and at.time <= last + 1e-6
    ]


def _order(root: RootCause, *, ended_late: bool) -> tuple[bool, bool, bool, int, float, float]:
    """Return the sort key of a root cause. `ended_late`: failures made the run reach its time limit."""
    limit = root.cause == "run.limit"
    return (
        root.cause not in RUN_CAUSES and not (limit and not ended_late),
        limit,
        not root.ended_run,
        -len(root.items),
        -root.seconds_lost,
        root.time or 0.0,
    )
