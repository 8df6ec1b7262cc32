"""Choosing among grasp candidates: the cheapest test first, until one passes them all."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from typing import TYPE_CHECKING

from ..journal import CandidatesRanked, CandidateTried
from ..scene.planning_scene import BeliefObject
from ..values import Array, Pose
from .grasps import GraspCandidate
from .spots import heap, release_poses, spots

if TYPE_CHECKING:
    from ..world import World

STAGES = ("ranked", "hand fits", "grasp reached", "pre-grasp reached", "place reached")


def choose(
    world: World, belief: BeliefObject, candidates: Sequence[GraspCandidate], node: str
) -> Generator[None, None, GraspCandidate | None]:
    """The first candidate with which the object can be grasped *and* put where it belongs, or None.

    The trail, with the stage at which each one dropped out, goes to the journal; the collision checks
    are charged as thinking time.
    """
    counts = dict.fromkeys(STAGES, 0)
    counts["ranked"] = len(candidates)
    tried: list[CandidateTried] = []
    chosen: GraspCandidate | None = None
    with world.scene.allow(("gripper", belief.id)):
        for candidate in candidates:
            verdict = _verdict(world, belief, candidate, counts)
            tried.append(
                CandidateTried(candidate.name, candidate.tcp_in_world, candidate.score, verdict or "accepted")
            )
            if verdict is None:
                chosen = candidate
                break
    world.journal.note(CandidatesRanked(f"grasp by {node}", belief.id, counts, tuple(tried)))
    yield from world.plan.charge()
    return chosen


def _verdict(
    world: World, belief: BeliefObject, candidate: GraspCandidate, counts: dict[str, int]
) -> str | None:
    """Why the candidate is refused, or None."""
    tcp = candidate.tcp_in_world
    touched = world.queries.hand_contacts(
        tcp, candidate.opening, ignore=(belief.id,), margin=candidate.margin
    )
    if touched:
        return f"the hand would touch {touched[0].b}"
    counts["hand fits"] += 1
    grasp = world.plan.reachable(tcp, near=world.control.state.position)
    if grasp is None:
        return "the grasp is out of reach or in collision"
    counts["grasp reached"] += 1
    over = world.plan.reachable(tcp.shifted((0.0, 0.0, world.handling.approach)), near=grasp)
    if over is None:
        return "the pre-grasp is out of reach or in collision"
    counts["pre-grasp reached"] += 1
    if not _placeable(world, belief, tcp, grasp):
        return "from this grasp the object cannot be put where it belongs"
    counts["place reached"] += 1
    return None


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
