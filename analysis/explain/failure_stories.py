"""The failures of a run, each as a story: where it came up, why, and what became of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from ...logs.episodes.cure_names import Names
from ...logs.visits import Visit
from ...world.causes import Cause, all_causes
from .candidate_choices import choices_before
from .investigation.explanation import FailureStory
from .investigation.failure_course import Courses
from .investigation.visit_tree import Family

if TYPE_CHECKING:
    from ...logs.run_record import RunRecord


def failures_of(run: RunRecord, family: Family) -> tuple[FailureStory, ...]:
    """Every failure with a cause, in the order of their times. A false condition is none."""
    end = run.ticks.times[-1] if run.ticks.times else 0.0
    names = Names(node for at in run.trees for node in at.record.nodes)
    courses = Courses(family, run.events, end, names)
    causes = {cause.name: cause for cause in all_causes()}
    found: list[FailureStory] = []
    before: list[Visit] = []
    for source in family.sources():
        story = _story(run, len(found), source, courses, causes.get(source.cause))
        found.append(replace(story, because_of=_follows(source, before, family)))
        before.append(source)
    return tuple(found)


def _story(run: RunRecord, number: int, source: Visit, courses: Courses, cause: Cause | None) -> FailureStory:
    course = courses.of(source)
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
        remedy=cause.remedy if cause else "",
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


def _follows(source: Visit, before: Sequence[Visit], family: Family) -> int | None:
    """The number of the earlier failure that this one follows from."""
    for number in reversed(range(len(before))):
        earlier = before[number]
        if _within_the_answer(source, earlier, family) or _consequence(source, earlier, family):
            return number
    return None


def _within_the_answer(source: Visit, earlier: Visit, family: Family) -> bool:
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


def _consequence(source: Visit, earlier: Visit, family: Family) -> bool:
    """Whether the earlier failure lost the item, or left it in the hand, and that is what fails now."""
    held = source.evidence.get("held")
    if isinstance(held, str) and held:
        return held == earlier.item != source.item
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
