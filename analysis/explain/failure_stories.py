"""The failures of a run, each as a story: where it came up, why, and what became of it."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from ...files.value_wording import listed
from ...logs.run_account import Failure, RunAccount
from ...logs.run_log import Stamped
from ...logs.schema.records import BodyRecord, Candidates, Plan
from ...logs.visits import HALTED, Visit, VisitTree
from ...robot.manipulation.pick_candidates import count_rejections
from ...world.belief.height_map import heap_id
from ...world.causes import Cause, all_causes, remedy_of
from ...world.run_events import FaultEvent
from ...world.skill_events import SafetyStopEvent
from .body_tracks import horizontal_distance
from .case import Investigation
from .explanation import CandidateChoice, FailureStory, RejectedCandidate, number
from .item_whereabouts import MISPLACED
from .number_wording import distance, place, seconds

if TYPE_CHECKING:
    from ...logs.run_record import RunRecord


PLANS = 3
"""Failing plans in a row that are told."""


def choices_before(run: RunRecord, source: Visit) -> tuple[CandidateChoice, ...]:
    """Those within the visit that failed and of its item, or of the heap in it, in the order of time."""
    names = (source.item, heap_id(source.item))
    found = [
        _of_candidates(at)
        for at in run.candidates
        if source.start - 1e-6 <= at.time <= source.end + 1e-6 and at.record.object in names
    ]
    plans = [at for at in run.plans if source.start - 1e-6 <= at.time <= source.end + 1e-6]
    refused = [at for at in plans if at.record.outcome != "found"]
    if refused and plans[-1] is refused[-1]:
        found.append(_of_plans(refused, len(plans), source.item))
    return tuple(sorted(found, key=lambda choice: choice.time))


def _of_candidates(at: Stamped[Candidates]) -> CandidateChoice:
    record = at.record
    stages = tuple((stage.name, stage.count) for stage in record.stages)
    found = count_rejections(record.tried, record.into)
    if found:
        rejections = tuple(RejectedCandidate(f.name, f.words, f.count, f.stage, f.by) for f in found)
        return CandidateChoice(at.time, record.purpose, record.object, stages, rejections)
    refused = Counter(c.verdict for c in record.tried if c.verdict != "accepted")
    names: dict[str, str] = {}
    for candidate in record.tried:
        names.setdefault(candidate.verdict, candidate.name)
    return CandidateChoice(
        at.time,
        record.purpose,
        record.object,
        stages,
        tuple(RejectedCandidate(names[reason], reason, count) for reason, count in refused.most_common()),
    )


def _of_plans(refused: list[Stamped[Plan]], plans: int, item: str) -> CandidateChoice:
    """Plans that failed with the same words, numbers aside, are told as one."""
    alike: dict[str, list[Stamped[Plan]]] = {}
    for at in refused:
        words = re.sub(r"[\d.]+", "#", f"{at.record.outcome} {at.record.message}")
        alike.setdefault(words, []).append(at)
    return CandidateChoice(
        refused[-1].time,
        "plan",
        item,
        (("asked for", plans), ("found", plans - len(refused))),
        tuple(
            RejectedCandidate(
                group[0].record.request, f"{group[0].record.outcome}: {group[0].record.message}", len(group)
            )
            for group in sorted(alike.values(), key=len, reverse=True)
        ),
    )


_IN_MOTION = ("world.disturbed", "safety.", "control.")
LATELY = 5.0
"""Time before a failure whose events are told with it, s."""


def failure_context(
    case: Investigation, failure: FailureStory, planted: Sequence[Stamped[FaultEvent]]
) -> tuple[str, ...]:
    return (
        *_belief(case, failure),
        *_hand(case, failure),
        *_stops(case, failure),
        *_halted(case, failure),
        *_faults(case, failure, planted),
    )


def _belief(case: Investigation, failure: FailureStory) -> list[str]:
    """Where the item was believed to be, and where it truly was."""
    if not failure.item:
        return []
    before = failure.time - 1e-3  # the belief of the moment before, which the failure may have changed
    believed, true = case.belief.at(failure.item, before), case.pairs.get(failure.item)
    really = None if true is None else _really(case, failure, true)
    bins = case.scene.bins if case.scene else ()
    if believed is None and any(failure.item == bin_.id for bin_ in bins):
        return []
    if believed is None:
        return [f"belief: {failure.item} is not known"]
    where = "in the hand" if believed.attached else f"at {place(believed.pose.position)}"
    told = [f"belief: {failure.item} {where}, last seen at {seconds(believed.last_seen)}"]
    if true is not None and _gone(case, failure, true):
        told.append(f"truth: {failure.item} is nowhere any more")
    elif really is not None and horizontal_distance(really, believed) > MISPLACED:
        off = distance(horizontal_distance(really, believed))
        told.append(f"truth: {failure.item} at {place(really.pose.position)}, {off} from the belief")
    return told


def _really(case: Investigation, failure: FailureStory, true: str) -> BodyRecord | None:
    """The item as it truly was just after the failure, unless the hand moved it about."""
    later = next((t for t in case.truth.times if t >= failure.time - 1e-6), case.end)
    then = case.belief.at(failure.item, later)
    carried = then is not None and then.attached
    return None if carried else case.truth.at(true, later)


def _gone(case: Investigation, failure: FailureStory, true: str) -> bool:
    gone = case.gone(true)
    return gone is not None and gone[1] <= failure.time + case.sampled


def _hand(case: Investigation, failure: FailureStory) -> list[str]:
    gripper = case.run.gripper
    told = number(failure, "width") is not None or not failure.cause.startswith(_IN_MOTION)
    if told or not len(gripper.times):
        return []
    at = max(int((gripper.times <= failure.time + 1e-6).sum()) - 1, 0)
    width = float(gripper.widths[at])
    return [f"hand: the fingers were {max(width, 0.0) * 1000:.0f} mm open"]


def _stops(case: Investigation, failure: FailureStory) -> list[str]:
    visit = case.visit(failure)
    return [
        f"safety: the arm was stopped at {seconds(at.time)}: {at.record.message}"
        for at in case.events(SafetyStopEvent, start=visit.start, end=failure.time)
    ]


def _halted(case: Investigation, failure: FailureStory) -> list[str]:
    visit = case.visit(failure)
    stopped = [
        v.name
        for v in case.family.visits
        if v.outcome == HALTED and v.last == visit.last and case.family.within(v, visit)
    ]
    return [f"stopped with it: {listed(stopped[::-1], 4)}"] if stopped else []


def _faults(case: Investigation, failure: FailureStory, planted: Sequence[Stamped[FaultEvent]]) -> list[str]:
    true = case.pairs.get(failure.item)
    return [
        f"planted: {at.record.message} ({failure.time - at.time:.1f} s before)"
        for at in planted
        if true is not None and at.record.item == true and failure.time - LATELY <= at.time <= failure.time
    ]


def failures_of(run: RunRecord, account: RunAccount) -> tuple[FailureStory, ...]:
    """Every failure with a cause, in the order of their times. A false condition is none."""
    causes = {cause.name: cause for cause in all_causes()}
    charged: set[int | None] = {None}
    found: list[FailureStory] = []
    before: list[Visit] = []
    for failure in account.failures:
        story = _story(run, len(found), failure, causes.get(failure.source.cause))
        episode = account.recovery.of_failure(story.cause, story.time, story.node)
        lost = 0.0 if episode in charged or episode is None else account.recovery.episodes[episode].seconds
        charged.add(episode)
        follows = _follows(failure.source, before, account.tree)
        found.append(replace(story, because_of=follows, episode=episode, seconds_lost=lost))
        before.append(failure.source)
    return tuple(found)


def _story(run: RunRecord, number: int, failure: Failure, cause: Cause | None) -> FailureStory:
    source, course = failure.source, failure.course
    node = source.origin or source.path
    known = run.tree_at(source.end).nodes
    return FailureStory(
        number=number,
        time=source.end,
        tick=source.last,
        visit=source.number,
        node=node,
        id=next((n.id for n in known if n.path == node), source.id),
        item=source.item,
        attempt=source.attempt,
        cause=source.cause,
        sentence=cause.sentence if cause else "",
        remedy=remedy_of(cause, source.evidence) if cause else "",
        message=source.message,
        evidence=source.evidence,
        chain=course.chain,
        handled_by=course.handled_by,
        fate=course.fate,
        fate_by=course.fate_by,
        fate_at=course.fate_at,
        because_of=None,
        choices=choices_before(run, source),
        observed=(),
    )


def _follows(source: Visit, before: Sequence[Visit], family: VisitTree) -> int | None:
    """Return the number of the earlier failure that this one follows from."""
    for earlier_number in reversed(range(len(before))):
        earlier = before[earlier_number]
        if _within_the_answer(source, earlier, family) or _consequence(source, earlier, family):
            return earlier_number
    return None


def _within_the_answer(source: Visit, earlier: Visit, family: VisitTree) -> bool:
    """Whether it failed while the earlier failure was being dealt with: in a handler, or in giving up."""
    lineage = {v.parent: v for v in (source, *family.above(source))}
    ours = earlier
    for above in family.above(earlier):
        if above.number in lineage:
            branch = lineage[above.number]
            answers = above.id in _ANSWERING and branch.path != ours.path and branch.number > ours.number
            between = (v for v in family.children(above) if ours.number < v.number < branch.number)
            return answers and all(v.path != ours.path for v in between)
        ours = above
    return False


_ANSWERING = frozenset({"Recover", "RecoveryNode"})


def _consequence(source: Visit, earlier: Visit, family: VisitTree) -> bool:
    """Whether the earlier failure lost the item, left it in the hand, or would only be met again."""
    if source.evidence.get("unchanged") is True:
        return (earlier.item, earlier.cause) == (source.item, source.cause)
    held = source.evidence.get("held")
    if isinstance(held, str) and held:
        return held == earlier.item != source.item
    if "held" in source.evidence and source.id != "Grasp":  # nothing was in the hand
        return earlier.id == "Grasp" and earlier.item == source.item
    if source.cause == "control.tracking" and earlier.cause == "tree.timeout":
        return source.end - earlier.end < BRAKING  # the arm had not come to rest when it was to go on
    if not source.item or source.item != earlier.item or source.cause == earlier.cause:
        return False
    if source.cause not in _LOST or earlier.cause not in _LOSING:
        return False
    shared = {v.number for v in family.above(earlier)} & {v.number for v in family.above(source)}
    return any(family.visits[n].item == source.item for n in shared)


BRAKING = 1.0
"""The arm is at rest so long after it was halted, s."""
_LOSING = frozenset(
    {"grasp.missed", "grasp.slipped", "world.disturbed", "place.missed", "world.unknown_object"}
)
_LOST = frozenset({"world.unknown_object", "grasp.slipped", "perception.not_found", "grasp.no_candidate"})
