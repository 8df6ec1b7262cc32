"""Choosing among grasp candidates: the cheapest test first, until one passes them all."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..journal import CandidatesRanked, CandidateTried
from ..motion.posture import discomfort
from ..scene.planning_scene import BeliefObject
from ..values import Array, Pose
from .grasps import GraspCandidate
from .spots import heap, release_poses, spots

if TYPE_CHECKING:
    from ..world import World

STAGES = ("ranked", "hand fits", "pre-grasp reached", "grasp reached", "place reached")
EQUALS = 3
"""Of candidates with the best score that pass, so many are compared by how far the arm has to go."""


@dataclass(frozen=True, slots=True, eq=False)
class _Tested:
    """A candidate that passed, and the configuration (n,) over it; or why it did not."""

    over: Array | None
    verdict: str


def choose(
    world: World, belief: BeliefObject, candidates: Sequence[GraspCandidate], node: str
) -> Generator[None, None, GraspCandidate | None]:
    """The best candidate with which the object can be grasped *and* put where it belongs, or None.

    Among candidates of equal score the one with the shortest way for the arm. The trail, with the stage at
    which each one dropped out, goes to the journal; the collision checks are charged as thinking time.
    """
    counts: dict[str, int] = dict.fromkeys(STAGES, 0)
    counts["ranked"] = len(candidates)
    tried: list[CandidateTried] = []
    passed: list[tuple[float, GraspCandidate]] = []
    now = world.control.held_position
    with world.scene.allow(("gripper", belief.id)):
        for candidate in candidates:
            if passed and (len(passed) == EQUALS or candidate.score > passed[0][1].score + 1e-6):
                break
            tested = _test(world, belief, candidate, counts)
            tried.append(
                CandidateTried(candidate.name, candidate.tcp_in_world, candidate.score, tested.verdict)
            )
            if tested.over is not None:
                way = float(np.linalg.norm(tested.over - now)) + discomfort(world.robot, tested.over)
                passed.append((way, candidate))
    world.journal.note(CandidatesRanked(f"grasp by {node}", belief.id, counts, tuple(tried)))
    yield from world.plan.charge()
    return min(passed, key=lambda p: p[0])[1] if passed else None


def _test(world: World, belief: BeliefObject, candidate: GraspCandidate, counts: dict[str, int]) -> _Tested:
    tcp = candidate.tcp_in_world
    touched = world.queries.hand_contacts(
        tcp, candidate.opening, ignore=(belief.id,), margin=candidate.margin
    )
    if touched:
        return _Tested(None, f"the hand would touch {touched[0].b}")
    counts["hand fits"] += 1
    over_pose = tcp.shifted((0.0, 0.0, world.handling.approach))
    over = world.plan.reachable(over_pose, near=world.control.held_position)
    if over is None:
        return _Tested(None, "the pre-grasp is out of reach or in collision")
    counts["pre-grasp reached"] += 1
    grasp = world.plan.reachable(tcp, near=over)
    if grasp is None:
        return _Tested(None, "the grasp is out of reach or in collision")
    counts["grasp reached"] += 1
    if not _placeable(world, belief, tcp, grasp):
        return _Tested(None, "from this grasp the object cannot be put where it belongs")
    counts["place reached"] += 1
    return _Tested(over, "accepted")


def _placeable(world: World, belief: BeliefObject, tcp: Pose, near: Array) -> bool:
    """Whether some release pose over the object's destination is reached with this grasp."""
    to = world.scene.destination(belief.id)
    if to is None:
        return True
    bin_ = world.scene.bins[to]
    seen = world.eyes.bins.get(to)
    heights = heap(bin_, world.scene.objects, None if seen is None else seen.cells)
    object_in_tcp = tcp.inverse() @ belief.pose
    for spot in spots(bin_, heights, belief.shape, belief.pose.rotation())[:2]:
        for pose in release_poses(bin_, spot, belief.shape, object_in_tcp):
            if world.plan.reachable(pose, near=near) is not None:
                return True
    return False
