"""What else the log tells of the moment of a failure, a sentence each."""

from __future__ import annotations

from collections.abc import Sequence

from ...logs.run_log import At
from ...logs.schema.records import Body, Event
from ...logs.visits import HALTED
from .causes.item_whereabouts import MISPLACED, SAMPLED
from .investigation.body_tracks import apart
from .investigation.case import Case
from .investigation.evidence import number
from .investigation.explanation import FailureStory
from .investigation.number_wording import distance, listed, place, seconds

_IN_MOTION = ("world.disturbed", "safety.", "control.")
LATELY = 5.0
"""What happened so long before a failure is told with it, s."""


def observed(case: Case, failure: FailureStory, planted: Sequence[At[Event]]) -> tuple[str, ...]:
    return (
        *_belief(case, failure),
        *_hand(case, failure),
        *_stops(case, failure),
        *_halted(case, failure),
        *_faults(case, failure, planted),
    )


def _belief(case: Case, failure: FailureStory) -> list[str]:
    """Where the item was believed to be, and where it truly was."""
    if not failure.item:
        return []
    before = failure.time - 1e-3  # the belief of the moment before, which the failure may have changed
    believed, true = case.belief.at(failure.item, before), case.pairs.get(failure.item)
    really = None if true is None else _really(case, failure, true)
    if believed is None:
        return [f"belief: {failure.item} is not known"]
    where = "in the hand" if believed.attached else f"at {place(believed.pose.position)}"
    told = [f"belief: {failure.item} {where}, last seen at {seconds(believed.last_seen)}"]
    if true is not None and _gone(case, failure, true):
        told.append(f"truth: {failure.item} is nowhere any more")
    elif really is not None and apart(really, believed) > MISPLACED:
        off = distance(apart(really, believed))
        told.append(f"truth: {failure.item} at {place(really.pose.position)}, {off} from the belief")
    return told


def _really(case: Case, failure: FailureStory, true: str) -> Body | None:
    """The item as it truly was just after the failure, unless the hand moved it about."""
    later = next((t for t in case.truth.times if t >= failure.time - 1e-6), case.end)
    then = case.belief.at(failure.item, later)
    carried = then is not None and then.attached
    return None if carried else case.truth.at(true, later)


def _gone(case: Case, failure: FailureStory, true: str) -> bool:
    gone = case.gone(true)
    return gone is not None and gone[1] <= failure.time + SAMPLED


def _hand(case: Case, failure: FailureStory) -> list[str]:
    joints = case.run.joints
    fingers = [n for n, name in enumerate(joints.names) if "finger" in name]
    told = number(failure, "width") is not None or not failure.cause.startswith(_IN_MOTION)
    if not fingers or told or not len(joints.times):
        return []
    at = max(int((joints.times <= failure.time + 1e-6).sum()) - 1, 0)
    width = float(joints.positions[at, fingers].sum())
    return [f"hand: the fingers were {max(width, 0.0) * 1000:.0f} mm open"]


def _stops(case: Case, failure: FailureStory) -> list[str]:
    visit = case.visit(failure)
    return [
        f"safety: the arm was stopped at {seconds(at.time)}: {at.record.message}"
        for at in case.events("safety_stop", start=visit.start, end=failure.time)
    ]


def _halted(case: Case, failure: FailureStory) -> list[str]:
    visit = case.visit(failure)
    stopped = [
        v.path.rsplit("/", 1)[-1]
        for v in case.family.visits
        if v.outcome == HALTED and v.last == visit.last and case.family.within(v, visit)
    ]
    return [f"stopped with it: {listed(stopped[::-1], 4)}"] if stopped else []


def _faults(case: Case, failure: FailureStory, planted: Sequence[At[Event]]) -> list[str]:
    true = case.pairs.get(failure.item)
    return [
        f"planted: {at.record.message} ({failure.time - at.time:.1f} s before)"
        for at in planted
        if true is not None
        and at.record.data.get("item") == true
        and failure.time - LATELY <= at.time <= failure.time
    ]
