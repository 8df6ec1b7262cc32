"""A whole candidate: one grasp, and one place that it leads to.

The stages that a candidate passes, in this order: two of geometry and kinematics for the grasp, two for
the place, the cheapest first, and then what is planned.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ...cell.handover import PlaceCandidate
from ...planning.kinematics.configuration_cost import configuration_cost
from ...planning.requests import ContactPair, MotionPlan
from ...world.causes import Failure
from ...world.journal import CandidateEntry, CandidateSearchEntry
from ...world.values import Array, ObjectId, Pose
from ..grasp.grasp_candidates import GraspCandidate

if TYPE_CHECKING:
    from ...planning.service.reachability import ReachResult
    from ...robots.model import RobotModel


RANKED = "ranked"
HAND = "hand fits"
PRE_GRASP = "pre-grasp reached"
GRASP = "grasp reached"
ROOM = "room at the place"
PLACE = "place reached"
APPROACH = "approach planned"
TRANSFER = "transfer planned"
STAGES = (RANKED, HAND, PRE_GRASP, GRASP, ROOM, PLACE, APPROACH, TRANSFER)


ACCEPTED = "accepted"


class TriedCandidate(Protocol):
    """`world.journal.CandidateTried`, or what a log holds of it."""

    @property
    def name(self) -> str: ...
    @property
    def verdict(self) -> str: ...
    @property
    def stage(self) -> str: ...
    @property
    def by(self) -> str: ...
    @property
    def gap(self) -> float: ...
    @property
    def count(self) -> int: ...


@dataclass(frozen=True, slots=True)
class RejectionCount:
    """So many grasps dropped out at a stage for one reason."""

    count: int
    words: str
    stage: str
    by: str
    name: str
    """Of the first of these grasps."""


def count_rejections(tried: Iterable[TriedCandidate], into: str) -> tuple[RejectionCount, ...]:
    """The most frequent first. A grasp that was accepted has none; one whose places failed for several
    reasons has the one that it came furthest with, or that was more frequent."""
    taken = {one.name for one in tried if one.verdict == ACCEPTED}
    last: dict[str, TriedCandidate] = {}
    for one in tried:
        if one.name in taken or one.stage not in STAGES:
            continue
        before = last.get(one.name)
        if before is None or _weight(one) > _weight(before):
            last[one.name] = one
    alike: dict[tuple[str, str], list[TriedCandidate]] = {}
    for one in last.values():
        alike.setdefault((one.stage, one.by or one.verdict), []).append(one)
    found = [
        RejectionCount(len(group), _words(group, into), group[0].stage, group[0].by, group[0].name)
        for group in alike.values()
    ]
    return tuple(sorted(found, key=lambda fate: -fate.count))


def describe_rejections(found: Sequence[RejectionCount], most: int = 4) -> str:
    """`11 the hand would touch red_block_2 (1.2 mm from it at best), 8 the pre-grasp is out of reach`."""
    parts = [f"{fate.count} {fate.words}" for fate in found[:most]]
    rest = sum(fate.count for fate in found[most:])
    return ", ".join([*parts, f"{rest} for other reasons"] if rest else parts)


def _weight(one: TriedCandidate) -> tuple[int, int]:
    return (STAGES.index(one.stage), one.count)


def _words(group: Sequence[TriedCandidate], into: str) -> str:
    best = max(group, key=lambda one: one.gap)
    if best.stage == HAND and best.by:
        near = (
            f"{best.gap * 1000:.1f} mm from it" if best.gap >= 0 else f"{-best.gap * 1000:.1f} mm deep in it"
        )
        return f"{best.verdict} ({near} at best)"
    if best.stage in (ROOM, PLACE) and into and best.by != into:
        return f"from there {into} cannot be reached ({best.verdict})"
    return best.verdict


_WAYS = {APPROACH: "no way to the grasp", TRANSFER: "no way to the place"}
_PAIR = re.compile(r"(?:deep in|from) (\S+)$")
"""Of `failing.listed`."""


@dataclass(frozen=True, slots=True)
class StageRefusal:
    """Why a candidate did not pass a stage: in words, what was in the way, and how near it was, m."""

    stage: str
    words: str
    by: str = ""
    gap: float = 0.0


def touching(stage: str, subject: str, contact: ContactPair) -> StageRefusal:
    """`the hand would touch red_block_2`, and how near it would be."""
    return StageRefusal(stage, f"{subject} would touch {contact.b}", contact.b, contact.distance)


def unreached(stage: str, subject: str, found: ReachResult) -> StageRefusal:
    """`the pre-grasp is out of reach`, `at the grasp panda_hand would be 3.1 mm deep in shelf`."""
    if found.contact is None:
        return StageRefusal(stage, f"{subject} is {found.why_not}")
    return StageRefusal(stage, f"at {subject} {found.why_not}", found.contact.b, found.contact.distance)


def planned(stage: str, failure: Failure) -> StageRefusal:
    """What the planner says, and the body that it names first."""
    by = next(iter(_named(failure)), "")
    return StageRefusal(stage, f"{_WAYS[stage]}: {failure.message}", by)


class CandidateTrail:
    """What became of the grasps of one object, and of the places that they lead to.

    A grasp counts at each stage that it, or one of its places, has passed.
    """

    def __init__(
        self, purpose: str, object_id: ObjectId, into: str, grasps: Sequence[GraspCandidate]
    ) -> None:
        self._purpose, self._object, self._into = purpose, object_id, into
        self._passed: dict[str, set[str]] = {stage: set() for stage in STAGES}
        self._passed[RANKED].update(grasp.name for grasp in grasps)
        self._tried: dict[tuple[str, str, str], CandidateEntry] = {}

    def passed(self, grasp: GraspCandidate, stage: str) -> None:
        self._passed[stage].add(grasp.name)

    def refuse(self, grasp: GraspCandidate, cost: float, refusal: StageRefusal, place: str = "") -> None:
        """Places of one grasp that fail of the same thing at the same stage are counted as one."""
        key = (grasp.name, refusal.stage, refusal.by or refusal.words)
        tried = CandidateEntry(
            grasp.name, grasp.tcp_in_world, cost, refusal.words, place, refusal.stage, refusal.by, refusal.gap
        )
        before = self._tried.get(key)
        if before is not None:
            nearer = before if before.gap >= tried.gap else tried
            tried = replace(nearer, place=before.place, score=before.score, count=before.count + 1)
        self._tried[key] = tried

    def accept(self, grasp: GraspCandidate, cost: float, place: str, stage: str) -> None:
        """The candidate that is taken, proven up to that stage."""
        self._tried[grasp.name, "", ""] = CandidateEntry(
            grasp.name, grasp.tcp_in_world, cost, "accepted", place, stage
        )

    def count(self, stage: str) -> int:
        """Grasps that have passed a stage."""
        return len(self._passed[stage])

    def entry(self) -> CandidateSearchEntry:
        """For the journal."""
        stages = {stage: len(names) for stage, names in self._passed.items()}
        return CandidateSearchEntry(
            self._purpose, self._object, stages, tuple(self._tried.values()), self._into
        )


def _named(failure: Failure) -> Iterator[str]:
    """Bodies of the scene that the evidence names."""
    pairs = failure.evidence.get("pairs")
    for pair in pairs if isinstance(pairs, list) else ():
        match = _PAIR.search(str(pair))
        if match:
            yield match.group(1)


DETOUR = 0.4
"""What a radian of detour (`posture.discomfort`) is worth as time, s."""


def joint_travel_time(robot: RobotModel, a: Array, b: Array) -> float:
    """The least time from a to b (n,), and what an uncomfortable b is worth, s."""
    return float(np.max(np.abs(b - a) / robot.velocity_limit)) + DETOUR * configuration_cost(robot, b)


def known_travel_time(robot: RobotModel, a: Pose, x: float, y: float) -> float:
    """The part of `estimated_travel_time` that is known of a point before the hand's direction there is,
    s."""
    base = robot.description.base_in_world.inverse()
    there = base.apply(np.array([x, y, 0.0]))
    facing = math.atan2(float(there[1]), float(there[0]))
    return abs(_wrapped(facing - _turns(base @ a)[0])) / float(robot.velocity_limit[0])


def estimated_travel_time(robot: RobotModel, a: Pose, b: Pose) -> float:
    """The time from one TCP pose to another before any configuration is known, s. It only says what to look
    at first: an arm on an upright base turns its first joint to face a point, its last to turn the hand."""
    base = robot.description.base_in_world.inverse()
    (facing_a, yaw_a), (facing_b, yaw_b) = (_turns(base @ pose) for pose in (a, b))
    slew = _wrapped(facing_b - facing_a) / float(robot.velocity_limit[0])
    turn = _wrapped((yaw_b - facing_b) - (yaw_a - facing_a)) / float(robot.velocity_limit[-1])
    return max(abs(slew), abs(turn))


def _turns(tcp: Pose) -> tuple[float, float]:
    """Azimuth of a position, and the direction of the TCP's y axis, seen from above, rad."""
    x, y, _ = tcp.position
    closing = tcp.rotation()[:, 1]
    return math.atan2(y, x), math.atan2(float(closing[1]), float(closing[0]))


def _wrapped(angle: float) -> float:
    return (angle + math.pi) % (2 * math.pi) - math.pi


@dataclass(frozen=True, slots=True, eq=False)
class PickPlaceCandidate:
    """A grasp and where the object goes from it, with the configurations (n,) rad that belong to it."""

    object: ObjectId
    grasp: GraspCandidate
    landing: PlaceCandidate | None
    """None: no rule says where the object belongs."""
    object_in_tcp: Pose
    """As it will be held, if all is as believed."""
    over: Array
    """Above the grasp, where the straight way down begins."""
    at: Array
    """Where the fingers close."""
    above: Array | None
    """Over the landing; None without one."""
    cost: float
    """Lower is better, see `stream`."""
    approach: MotionPlan
    """From where the arm is to the pre-grasp and straight down, as one motion."""
