"""The trail of a choice: how far each candidate came, and what it was that stopped it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ...planning.requests import Contact
from ...world.causes import Failure
from ...world.journal import CandidatesRanked, CandidateTried
from ...world.values import ObjectId
from ..grasp.grasp_candidates import GraspCandidate
from .candidate_stages import APPROACH, RANKED, STAGES, TRANSFER

if TYPE_CHECKING:
    from ...planning.service.reachability import Reached

_WAYS = {APPROACH: "no way to the grasp", TRANSFER: "no way to the place"}
_PAIR = re.compile(r"(?:deep in|from) (\S+)$")
"""Of `failing.listed`."""


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why a candidate did not pass a stage: in words, what was in the way, and how near it was, m."""

    stage: str
    words: str
    by: str = ""
    gap: float = 0.0


def touching(stage: str, subject: str, contact: Contact) -> Refusal:
    """`the hand would touch red_block_2`, and how near it would be."""
    return Refusal(stage, f"{subject} would touch {contact.b}", contact.b, contact.distance)


def unreached(stage: str, subject: str, found: Reached) -> Refusal:
    """`the pre-grasp is out of reach`, `at the grasp panda_hand would be 3.1 mm deep in shelf`."""
    if found.contact is None:
        return Refusal(stage, f"{subject} is {found.why_not}")
    return Refusal(stage, f"at {subject} {found.why_not}", found.contact.b, found.contact.distance)


def planned(stage: str, failure: Failure) -> Refusal:
    """What the planner says, and the body that it names first."""
    by = next(iter(_named(failure)), "")
    return Refusal(stage, f"{_WAYS[stage]}: {failure.message}", by)


class Trail:
    """What became of the grasps of one object, and of the places that they lead to.

    A grasp counts at each stage that it, or one of its places, has passed.
    """

    def __init__(
        self, purpose: str, object_id: ObjectId, into: str, grasps: Sequence[GraspCandidate]
    ) -> None:
        self._purpose, self._object, self._into = purpose, object_id, into
        self._passed: dict[str, set[str]] = {stage: set() for stage in STAGES}
        self._passed[RANKED].update(grasp.name for grasp in grasps)
        self._tried: dict[tuple[str, str, str], CandidateTried] = {}

    def passed(self, grasp: GraspCandidate, stage: str) -> None:
        self._passed[stage].add(grasp.name)

    def refuse(self, grasp: GraspCandidate, cost: float, refusal: Refusal, place: str = "") -> None:
        """Places of one grasp that fail of the same thing at the same stage are counted as one."""
        key = (grasp.name, refusal.stage, refusal.by or refusal.words)
        tried = CandidateTried(
            grasp.name, grasp.tcp_in_world, cost, refusal.words, place, refusal.stage, refusal.by, refusal.gap
        )
        before = self._tried.get(key)
        if before is not None:
            nearer = before if before.gap >= tried.gap else tried
            tried = replace(nearer, place=before.place, score=before.score, count=before.count + 1)
        self._tried[key] = tried

    def accept(self, grasp: GraspCandidate, cost: float, place: str, stage: str) -> None:
        """The candidate that is taken, proven up to that stage."""
        self._tried[grasp.name, "", ""] = CandidateTried(
            grasp.name, grasp.tcp_in_world, cost, "accepted", place, stage
        )

    def count(self, stage: str) -> int:
        """Grasps that have passed a stage."""
        return len(self._passed[stage])

    def entry(self) -> CandidatesRanked:
        """For the journal."""
        stages = {stage: len(names) for stage, names in self._passed.items()}
        return CandidatesRanked(self._purpose, self._object, stages, tuple(self._tried.values()), self._into)


def _named(failure: Failure) -> Iterator[str]:
    """Bodies of the scene that the evidence names."""
    pairs = failure.evidence.get("pairs")
    for pair in pairs if isinstance(pairs, list) else ():
        match = _PAIR.search(str(pair))
        if match:
            yield match.group(1)
