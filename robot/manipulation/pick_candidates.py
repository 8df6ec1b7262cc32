"""Pick-place candidates: one grasp and one place each, with their stages and rejections.

The stages in order: geometry and kinematics of the grasp, then of the place, the cheapest first, and then
planning.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from picktree.robot import PlaceCandidate
from picktree.robot.planning import ContactPair, MotionPlan
from picktree.world import Array, Candidate, Candidates, Failure, ObjectId, Pose, StageCount

from .grasps import GraspCandidate

if TYPE_CHECKING:
    from picktree.robot.planning import ReachResult

RANKED_STAGE = "ranked"
HAND_STAGE = "hand fits"
PRE_GRASP_STAGE = "pre-grasp reached"
GRASP_STAGE = "grasp reached"
ROOM_STAGE = "room at the place"
PLACE_STAGE = "place reached"
APPROACH_STAGE = "approach planned"
TRANSFER_STAGE = "transfer planned"
STAGES = (
    RANKED_STAGE,
    HAND_STAGE,
    PRE_GRASP_STAGE,
    GRASP_STAGE,
    ROOM_STAGE,
    PLACE_STAGE,
    APPROACH_STAGE,
    TRANSFER_STAGE,
)
ACCEPTED_VERDICT = "accepted"


@dataclass(frozen=True, slots=True)
class RejectionCount:
    """Number of grasps that failed at a stage for one reason."""

    count: int
    words: str
    stage: str
    by: str
    name: str
    """Name of the first of these grasps."""


def count_rejections(tried: Iterable[Candidate], into: str) -> tuple[RejectionCount, ...]:
    """Return the rejections, most frequent first.

    An accepted grasp has none. A grasp whose places failed for several reasons counts for the one at the
    latest stage, or the more frequent one.
    """
    taken = {one.name for one in tried if one.verdict == ACCEPTED_VERDICT}
    last: dict[str, Candidate] = {}
    for one in tried:
        if one.name in taken or one.stage not in STAGES:
            continue
        before = last.get(one.name)
        if before is None or _stage_weight(one) > _stage_weight(before):
            last[one.name] = one
    alike: dict[tuple[str, str], list[Candidate]] = {}
    for one in last.values():
        alike.setdefault((one.stage, one.by or one.verdict), []).append(one)
    found = [
        RejectionCount(len(group), _rejection_words(group, into), group[0].stage, group[0].by, group[0].name)
        for group in alike.values()
    ]
    return tuple(sorted(found, key=lambda fate: -fate.count))


def describe_rejections(found: Sequence[RejectionCount], most: int = 4) -> str:
    """Return `11 the hand would touch red_block_2 (1.2 mm from it at best), 8 the pre-grasp is out of
    reach`."""
    parts = [f"{fate.count} {fate.words}" for fate in found[:most]]
    rest = sum(fate.count for fate in found[most:])
    return ", ".join([*parts, f"{rest} for other reasons"] if rest else parts)


def _stage_weight(one: Candidate) -> tuple[int, int]:
    return (STAGES.index(one.stage), one.count)


def _rejection_words(group: Sequence[Candidate], into: str) -> str:
    best = max(group, key=lambda one: one.gap)
    if best.stage == HAND_STAGE and best.by:
        near = (
            f"{best.gap * 1000:.1f} mm from it" if best.gap >= 0 else f"{-best.gap * 1000:.1f} mm deep in it"
        )
        return f"{best.verdict} ({near} at best)"
    if best.stage in (ROOM_STAGE, PLACE_STAGE) and into and best.by != into:
        return f"from there {into} cannot be reached ({best.verdict})"
    return best.verdict


_PLANNING_WORDS = {APPROACH_STAGE: "no way to the grasp", TRANSFER_STAGE: "no way to the place"}
_CONTACT_PATTERN = re.compile(r"(?:deep in|from) (\S+)$")
"""Body named at the end of a contact's description in the evidence of a planning failure."""


@dataclass(frozen=True, slots=True)
class StageRefusal:
    """Reason why a candidate failed a stage: text, obstacle, and distance to it, m (negative:
    penetration)."""

    stage: str
    words: str
    by: str = ""
    gap: float = 0.0


def touching(stage: str, subject: str, contact: ContactPair) -> StageRefusal:
    """Return the refusal for a contact: `the hand would touch red_block_2`, with the distance."""
    return StageRefusal(stage, f"{subject} would touch {contact.b}", contact.b, contact.distance)


def unreached(stage: str, subject: str, found: ReachResult) -> StageRefusal:
    """Return the refusal `the pre-grasp is out of reach` or `at the grasp panda_hand would be 3.1 mm deep in
    shelf`."""
    if found.contact is None:
        return StageRefusal(stage, f"{subject} is {found.why_not}")
    return StageRefusal(stage, f"at {subject} {found.why_not}", found.contact.b, found.contact.distance)


def planned(stage: str, failure: Failure) -> StageRefusal:
    """Return the refusal for a planning failure, with the first body that it names."""
    by = next(iter(_named_bodies(failure)), "")
    return StageRefusal(stage, f"{_PLANNING_WORDS[stage]}: {failure.message}", by)


class CandidateTrail:
    """Results of the grasps of one object, and of their places.

    A grasp counts at each stage that it, or one of its places, has passed.
    """

    def __init__(self, purpose: str, object_id: ObjectId, into: str) -> None:
        self._purpose, self._object, self._into = purpose, object_id, into
        self._passed: dict[str, set[str]] = {stage: set() for stage in STAGES}
        self._tried: dict[tuple[str, str, str], Candidate] = {}

    def passed(self, grasp: GraspCandidate, stage: str) -> None:
        self._passed[stage].add(grasp.name)

    def refuse(self, grasp: GraspCandidate, cost: float, refusal: StageRefusal, place: str = "") -> None:
        """Record a refusal. Places of one grasp with the same reason at the same stage count together."""
        key = (grasp.name, refusal.stage, refusal.by or refusal.words)
        tried = Candidate(
            grasp.name,
            grasp.tcp_in_world.position,
            grasp.tcp_in_world.orientation,
            cost,
            refusal.words,
            place,
            refusal.stage,
            refusal.by,
            refusal.gap,
        )
        before = self._tried.get(key)
        if before is not None:
            nearer = before if before.gap >= tried.gap else tried
            tried = replace(nearer, place=before.place, score=before.score, count=before.count + 1)
        self._tried[key] = tried

    def accept(self, grasp: GraspCandidate, cost: float, place: str, stage: str) -> None:
        """Record the accepted candidate, tested up to that stage."""
        self._tried[grasp.name, "", ""] = Candidate(
            grasp.name,
            grasp.tcp_in_world.position,
            grasp.tcp_in_world.orientation,
            cost,
            "accepted",
            place,
            stage,
        )

    def count(self, stage: str) -> int:
        """Return the number of grasps that have passed a stage."""
        return len(self._passed[stage])

    def entry(self) -> Candidates:
        """Return the journal entry."""
        stages = tuple(StageCount(stage, len(names)) for stage, names in self._passed.items())
        return Candidates(self._purpose, self._object, stages, tuple(self._tried.values()), self._into)


def _named_bodies(failure: Failure) -> Iterator[str]:
    """Yield the bodies of the scene in the failure's evidence."""
    pairs = failure.evidence.get("pairs")
    for pair in pairs if isinstance(pairs, list) else ():
        match = _CONTACT_PATTERN.search(str(pair))
        if match:
            yield match.group(1)


@dataclass(frozen=True, slots=True, eq=False)
class PickPlaceCandidate:
    """Grasp and place of an object with their configurations (n,), rad."""

    object: ObjectId
    grasp: GraspCandidate
    landing: PlaceCandidate | None
    """Place of the release. None: no rule gives a destination."""
    object_in_tcp: Pose
    """Expected pose of the held object in the TCP frame."""
    over: Array
    """Configuration (n,) of the pre-grasp, rad; the straight descent begins there."""
    at: Array
    """Configuration (n,) where the fingers close, rad."""
    above: Array | None
    """Configuration (n,) over the place, rad. None: there is no place."""
    cost: float
    """Cost, s; lower is better, see `CandidateSearch`."""
    approach: MotionPlan
    """Motion plan from the arm's configuration to the pre-grasp and straight down, as one motion."""
