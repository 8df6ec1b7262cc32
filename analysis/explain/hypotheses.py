"""Table of hypotheses about failures and unsorted items, and their ranking.

The search begins at the end: with each item that is not at its destination, and each failure that cost time.
All hypotheses of `HYPOTHESES` are tested on each failure. The first one has the strongest evidence,
explains most failures of the run, and contradicts least. The next one of another cause is its rival.
Equal findings are one root cause, ranked by its cost: items first, then seconds.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, TypeAlias

from picktree.files import listed
from picktree.logs import Stamped
from picktree.world import event_types, world

from . import held_items, item_causes, obstruction_causes, run_endings, unsorted_items
from .camera_causes import looks
from .case import Investigation
from .confidence import fitted_rate, stated
from .device_causes import device_findings, devices_behind
from .explanation import Confidence, ExplainedOutcome, Explanation, FailureStory, Finding, RootCause
from .held_items import held_periods, pressed_from_below
from .predictions import refutations
from .unsorted_items import explain_crushed_item, explain_unsorted, placed_at
from .wording import seconds

DISPLACEMENT_CAUSES = frozenset(
    {"item.moved", "item.left_bin", "item.pushed_by_arm", "item.struck",
     "item.slipped", "item.slippery", "item.heavy", "grasp.weak", "gripper.weak", "grasp.not_felt"}
)  # fmt: skip
PLACE_CAUSES = frozenset(
    {"item.out_of_reach", "item.beside_bin", "item.crowded", "item.hemmed_in", "item.fell_elsewhere"}
)
"""Causes due to an item's place: their root is the event that brought the item there."""
RUN_CAUSES = frozenset(
    {"run.interrupted", "run.stopped", "run.killed", "run.crashed", "run.going_on", "run.paused",
     "tree.condition"}
)  # fmt: skip
"""Causes that end a run by themselves."""
MIN_SHARE = 0.2
"""Least share of a timed-out run that the failures must have cost to be the reason of the timeout."""

FailureDetector: TypeAlias = Callable[[Investigation, FailureStory], Finding | None]


def explain_device_fault(case: Investigation, failure: FailureStory) -> Finding | None:
    """Return the finding about a faulty device that covers the failure: sensor, joint, fingers or planner."""
    devices = devices_behind(case, failure)
    return min(devices, key=lambda found: len(refutations(case, failure, found)), default=None)


def explain_push_from_below(case: Investigation, failure: FailureStory) -> Finding | None:
    """Return the finding about the body that bore the weight of an item reported as slipped; else None."""
    return obstruction_causes.explain_contact(case, failure) if pressed_from_below(failure) else None


HYPOTHESES: Final[tuple[tuple[FailureDetector, int], ...]] = (
    (explain_device_fault, 3),
    (unsorted_items.explain_left_in_tote, 3),
    (run_endings.explain_mission_error, 3),
    (run_endings.explain_missing_grasp, 3),
    (item_causes.explain_wrong_size, 2),
    (item_causes.explain_too_wide, 2),
    (held_items.explain_overweight, 2),
    (item_causes.explain_missing_item, 2),
    (explain_push_from_below, 1),
    (held_items.explain_drop, 1),
    (item_causes.explain_wrong_place, 1),
    (unsorted_items.explain_wrong_bin, 1),
    (obstruction_causes.explain_obstruction, 1),
    (item_causes.explain_misjudged_place, 0),
    (run_endings.explain_unacknowledged_stop, 0),
    (obstruction_causes.explain_contact, 0),
)
"""Hypotheses about a failure, each with the strength of its evidence; of equal ones the first counts.

3: the device itself, or the failure's message. 2: a measured property. 1: a place or an event in the cell.
0: a contact with a body that is near.
"""
EVIDENCE_WEIGHT, SHARE_WEIGHT, AGAINST_WEIGHT, DOUBT_WEIGHT = 1.0, 0.8, 0.7, 0.3
"""Weights: of a step of evidence, of the share of failures that are explained, of a piece of
counter-evidence, and of a doubtful finding."""
MIN_MARGIN = 0.25
"""Margin to the next hypothesis below which the first one is merely possible."""


def _ranked(case: Investigation) -> Mapping[int, Finding]:
    """Return the best finding for each failure, with its rival as counter-evidence."""
    found: dict[int, list[tuple[float, Finding]]] = {}
    for failure in case.failures:
        answers = ((evidence, _tested(case, failure, explain)) for explain, evidence in HYPOTHESES)
        found[failure.number] = [
            (_strength(evidence, answer), answer) for evidence, answer in answers if answer is not None
        ]
    explained = Counter(key for each in found.values() for key in {answer.key for _, answer in each})
    best: dict[int, Finding] = {}
    for number, answers in found.items():
        scored = [
            (strength + SHARE_WEIGHT * explained[answer.key] / len(found), -place, answer)
            for place, (strength, answer) in enumerate(answers)
        ]
        scored.sort(key=lambda each: each[:2], reverse=True)
        if scored:
            best[number] = _with_rival(scored)
    return best


def _tested(case: Investigation, failure: FailureStory, explain: FailureDetector) -> Finding | None:
    """Return the finding with the records that contradict its predictions; None without a finding."""
    found = explain(case, failure)
    against = () if found is None else refutations(case, failure, found)
    return found if found is None or not against else found.weakened(*against)


def _strength(evidence: int, finding: Finding) -> float:
    doubt = DOUBT_WEIGHT * (finding.confidence != "likely")
    return EVIDENCE_WEIGHT * evidence - AGAINST_WEIGHT * len(finding.against) - doubt


def _with_rival(scored: Sequence[tuple[float, int, Finding]]) -> Finding:
    """Return the first finding; the next one of another cause is evidence against it where both are near."""
    score, _, first = scored[0]
    rival = next(((s, f) for s, _, f in scored[1:] if f.cause != first.cause), None)
    if rival is None or score - rival[0] > RIVAL_MARGIN:
        return first
    fits = f"this fits, too: {rival[1].title}"
    if score - rival[0] < MIN_MARGIN:
        return first.weakened(fits)
    return replace(first, against=(*first.against, fits))


RIVAL_MARGIN = 0.75
"""Margin up to which the next hypothesis is named."""


@dataclass
class _Group:
    """Failures and items with the same finding."""

    findings: list[Finding] = field(default_factory=list[Finding])
    failures: list[FailureStory] = field(default_factory=list[FailureStory])
    items: dict[str, None] = field(default_factory=dict[str, None])
    """True items that are not at their destination because of it."""


def root_causes_of(
    case: Investigation,
    outcome: ExplainedOutcome,
    planted: Sequence[Stamped[event_types.FaultEvent]],
    earlier: Explanation | None = None,
) -> tuple[RootCause, ...]:
    """Return the root causes, those that cost most first. `earlier`: of the run that this one continues.

    A failure is no root cause when the mission lists an action for it under `instead`.
    """
    groups: dict[tuple[str, str], _Group] = {}

    def group(finding: Finding) -> _Group:
        found = groups.setdefault(finding.key, _Group())
        found.findings.append(finding)
        return found

    by_failure = _findings_by_failure(case)
    for failure in case.failures:
        if failure.number not in case.once(_answered_instead):
            group(by_failure[failure.number]).failures.append(failure)
    lost_before = {} if earlier is None or outcome.status == "success" else _lost_before(case, earlier)
    for true in _unsorted(case, outcome):
        finding = lost_before.pop(case.name_of(true), None) or _why_unsorted(case, true, by_failure)
        if finding is not None:
            group(finding).items[true] = None
    for item, finding in lost_before.items():
        if item not in case.pairs and finding.cause == "item.gone":  # the truth of this log lacks it
            group(finding).items[item] = None
    ending = run_endings.explain_run_end(case, outcome)
    if ending is None and not groups:
        ending = run_endings.explain_missed_goal(case, outcome)
    if ending is not None:
        group(ending)
    costs: dict[tuple[str, str], float] = defaultdict(float)
    for failure in case.failures:  # an episode counts once, for its first failure
        costs[by_failure[failure.number].key] += failure.seconds_lost
    ended = None if ending is None else ending.key
    roots = [
        _fitted(case, _root(case, each, outcome, planted, costs[key], at_the_end=key == ended))
        for key, each in groups.items()
    ]
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
            finding = case.once(_ranked).get(failure.number) or _failure_message_finding(case, failure)
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


def _lost_before(case: Investigation, earlier: Explanation) -> dict[str, Finding]:
    """Return the findings on items that were lost before the log begins, by their believed names."""
    begins = case.run.ticks.times[0] if case.run.ticks.times else 0.0
    touched = {failure.item for failure in case.failures}
    found: dict[str, Finding] = {}
    for root in earlier.root_causes:
        reasons = (f"this log begins later, at {seconds(begins)}", *root.reasons)
        sure: Confidence = "possible" if root.doubtful else "likely"
        for item in root.items if root.time is not None and root.time < begins else ():
            if item not in touched and placed_at(case, case.pairs.get(item, "")) is None:
                where = (root.cause, root.item, root.title, reasons, root.item, root.time)
                found[item] = Finding(*where, sure, root.against)
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
    bodies = [body for _, body in case.bodies.tracks[true].since(before.time or 0.0, after.time or 0.0)]
    steps = itertools.pairwise(bodies)
    return all(math.dist(a.pose.position, b.pose.position) > MIN_STEP for a, b in steps)


MIN_STEP = 1e-3
"""Displacement between two samples of the truth below which an item rests, m."""


def _failure_message_finding(case: Investigation, failure: FailureStory) -> Finding:
    """Return the failure's own message as finding, for a log without evidence of a cause."""
    item, about = failure.item, failure.item or failure.node
    if failure.cause == world.UNKNOWN_OBJECT.name and item and item not in case.belief.tracks:
        title = f"the mission names the object {item!r}, which was never in the belief"
        known = f"the belief had {listed(list(case.belief.tracks), 5) or 'nothing'}"
        reasons = (known, f'a key of the blackboard needs braces, as "{{{item}}}"')
        return failure.finding(failure.cause, about, title, reasons)
    message = failure.message or failure.sentence
    of = f" of {item}" if item and item not in message else ""
    reasons = ("nothing else in the log shows the cause",)
    title = f"{failure.name}{of} failed: {message}"
    return failure.finding(failure.cause, about, title, reasons, "the log does not tell")


def _unsorted(case: Investigation, outcome: ExplainedOutcome) -> list[str]:
    """Return the true items that are not at their destination at the end, although their turn had come."""
    if outcome.status == "success":
        return []
    wrong = [true for true, judged in case.verdicts.items() if not judged.is_in_place]
    over = outcome.status == "incomplete"
    return [true for true in wrong if over or case.gone(true) is not None or _settled(case, true)]


def _settled(case: Investigation, true: str) -> bool:
    """Whether an item could come to rest after its placement before the log ends."""
    done = placed_at(case, true)
    tried = any(f.item in case.believed.get(true, ()) and f.fate != "open" for f in case.failures)
    return tried if done is None else case.end > done + SETTLING_TIME


SETTLING_TIME = 0.4
"""Time within which a released item comes to rest, s."""


def _why_unsorted(case: Investigation, true: str, by_failure: Mapping[int, Finding]) -> Finding | None:
    """Return the finding about an item that is not at its destination, by its last placement or failure."""
    if (broken := explain_crushed_item(case, true)) is not None:
        return _why_crushed(case, true, broken, by_failure)
    names, done = case.believed.get(true, ()), placed_at(case, true)
    own = [f for f in case.failures if f.item in names and f.fate != "cured"]
    after = [f for f in own if done is None or f.time > done]
    answer = None if done is None else explain_unsorted(case, true)
    by_placing = answer is not None and answer.cause in ("mission.wrong_bin", "perception.mistaken")
    if answer is not None and (by_placing or not after):
        return answer
    findings = [by_failure[f.number] for f in after]
    sure = [finding for finding in findings if finding.confidence != "the log does not tell"]
    unsure = [by_failure[f.number] for f in after if f.number not in case.once(_answered_instead)]
    answer = next(reversed(sure or unsure), None) or explain_unsorted(case, true)
    if answer is not None and answer.cause == "mission.not_tried":  # a stop may have taken its time
        stopped = [f for f in case.failures if f.cause == "tree.timeout" and f.fate != "cured"]
        return by_failure[stopped[-1].number] if stopped else explain_unsorted(case, true)
    return _unseen(case, answer) if answer is not None and answer.cause == "item.never_seen" else answer


CRUSH_CAUSES = (
    "camera.", "wrist.", "joint.", "arm.", "gripper.", "item.heavy", "item.larger", "perception.mistaken",
)  # fmt: skip
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
    """Return the finding about a camera that was faulty at each look and so has not shown an item, or else
    the given finding."""
    for found in case.once(device_findings):
        shots = [shot.time for shot in case.once(looks) if shot.record.camera in found.about]
        faulty = (any(start - 1e-6 <= time <= end for start, end in found.spans) for time in shots)
        if found.cause.startswith("camera.") and all(faulty):
            return found
    return answer


def _root(
    case: Investigation,
    group: _Group,
    outcome: ExplainedOutcome,
    planted: Sequence[Stamped[event_types.FaultEvent]],
    cost: float,
    *,
    at_the_end: bool,
) -> RootCause:
    first = group.findings[0]
    ended = at_the_end or any(f.fate == "ended" for f in group.failures)
    missed = outcome.status in ("incomplete", "failure") and (group.items or first.cause.startswith("goal."))
    alike = [f for f in group.findings if f.item and f.item != first.item and f.item not in first.title]
    others = list(dict.fromkeys(f.item for f in alike))
    broken = (explain_crushed_item(case, true) for true in group.items if first.cause != "item.crushed")
    harm = [each.title for each in broken if each is not None]
    also = [f"the same happened to {', '.join(others)}"] if others else []
    return RootCause(
        cause=first.cause,
        title=first.title,
        failures=tuple(f.number for f in group.failures),
        ended_run=outcome.status != "success" and bool(ended or missed),
        reasons=(*dict.fromkeys(first.reasons), *harm, *also),
        item=first.item,
        time=first.time,
        seconds_lost=cost,
        planted=tuple(_injected_faults(case, group, planted)),
        confidence=first.confidence,
        against=first.against,
        items=tuple(case.name_of(true) for true in group.items),
        about=first.about,
    )


def _fitted(case: Investigation, root: RootCause) -> RootCause:
    """Return the root cause with the confidence that development situations give such causes."""
    if root.confidence == "the log does not tell":
        return root
    doubtful = root.confidence != "likely"
    rate = fitted_rate(root.cause, doubtful=doubtful, truth=case.world.is_true)
    return replace(root, confidence=stated(rate), doubtful=doubtful, rate=rate)


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


def _order(root: RootCause, *, ended_late: bool) -> tuple[bool, bool, bool, bool, int, float, float]:
    """Return the sort key of a root cause. `ended_late`: failures made the run reach its time limit."""
    limit = root.cause == "run.limit"
    return (
        root.cause not in RUN_CAUSES and not (limit and not ended_late),
        limit,
        not root.ended_run,
        root.confidence == "the log does not tell",
        -len(root.items),
        -root.seconds_lost,
        root.time or 0.0,
    )
