"""Approach of a pick: the best remaining candidate, the motion to its grasp, and its transfer planned
ahead."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ...world.belief.facts import GRASP
from ...world.causes import Failure, grasp
from ...world.causes import world as world_causes
from ...world.values import ObjectId
from .object_grasps import leaning_object_grasps, object_grasps
from .pick_candidates import PLACE_STAGE, PickPlaceCandidate, count_rejections, describe_rejections
from .pick_stream import CandidateSearch
from .replanning import ReplanBudget, TargetMoved, TargetWatch, plan_after_stop
from .straight_lines import descend_until_contact
from .transfer_requests import plan_transfer_ahead
from .visual_servoing import servo_to_grasp

if TYPE_CHECKING:
    from ..control.trajectory_motion import Doing
    from ..planning.lookahead_planning import LookaheadResult
    from ..world import World


@dataclass(frozen=True, slots=True)
class PickTask:
    """Pick of one object, for the node that runs it."""

    object: ObjectId
    node: str
    force: float
    """Greatest grip force of each finger, N."""
    speed: float
    """Share of the joints' speed limits, 0 … 1."""
    onward: bool
    """Whether the object is carried on to its place in the same motion."""
    servo: bool
    """Whether a camera on the hand corrects the grasp."""
    gently: bool = False
    """Whether the hand comes down slowly: the object may lie elsewhere than believed."""


@dataclass(frozen=True, slots=True, eq=False)
class ApproachedPick:
    """Candidate with the arm at its grasp and the fingers open."""

    candidate: PickPlaceCandidate
    transfer: LookaheadResult | None
    """Transfer that was planned during the approach. None: there is none."""
    first: bool
    """Whether no candidate of this object has failed before."""


class TransferRefused(Failure):
    """Planning failure of a candidate's transfer. It stops the arm on the way to the grasp."""


def approach_object(world: World, task: PickTask) -> Doing[ApproachedPick]:
    """Move the arm to the grasp of the best remaining candidate.

    The arm stops and replans when an obstacle blocks the path, or the object is seen elsewhere. Raises
    grasp.no_candidate, perception.ambiguous, and the failures of motions.
    """
    replans = ReplanBudget(world, task.node, task.object)
    approached = None
    while approached is None:
        approached = yield from _approach_or_stop(world, task, replans)
    return approached


def _approach_or_stop(world: World, task: PickTask, replans: ReplanBudget) -> Doing[ApproachedPick | None]:
    """Approach the best candidate with a transfer. None: the arm stopped on the way, and a new search may
    help."""
    belief = world.scene.get(task.object)
    moved = TargetWatch(world, belief)
    gripper = world.robot.description.gripper
    ranked, leaning = object_grasps(belief, gripper), False
    refused = world.attempts.refusal(GRASP, belief, world.scene)
    if refused is not None:
        raise Failure(
            grasp.NO_CANDIDATE,
            f"{refused}; nothing has changed around it since",
            object=task.object,
            unchanged=True,
        )
    first = world.attempts.count(task.node, task.object) == 0
    offered = world.attempts.remaining(task.node, task.object, ranked)
    search = CandidateSearch(world, belief, offered, task.node)
    while True:
        found = yield from plan_after_stop(
            world, lambda: search.find(speed=task.speed, gently=task.gently), task.node
        )
        if found is None and search.cramped and not leaning:
            leaning, more = True, leaning_object_grasps(belief, gripper)
            ranked += more
            offered += (fresh := world.attempts.remaining(task.node, task.object, more))
            search.add(fresh)
            continue
        if found is None:
            tried_before = len(ranked) - len(offered)
            failure = _no_candidate(search, task.object, len(ranked), tried_before)
            by_geometry = failure.cause is grasp.NO_CANDIDATE and search.refused is None
            if by_geometry and not tried_before and world.plan.as_usual:
                world.attempts.refuse(GRASP, belief, world.scene, failure.message)
            raise failure
        candidate, watch = found, moved
        try:
            if task.servo and world.vision.hand is not None:
                candidate = yield from servo_to_grasp(
                    world, found, task.node, task.speed, first=first, watch=watch
                )
                # Detections of the hand camera count; another camera may err by its mounting.
                watch = None
            transfer = plan_transfer_ahead(world, candidate, task.speed, task.node) if task.onward else None
            yield from _move_to_grasp(world, task, candidate, transfer, watch)
        except TransferRefused as failure:
            search.refuse(candidate, failure)
        except TargetMoved as failure:
            if not replans.allows(failure, world_causes.DISTURBED):
                raise
            return None
        except Failure as failure:
            if not replans.allows(failure):
                world.attempts.failed(task.node, task.object, candidate.grasp.name)
                raise
            return None
        else:
            return ApproachedPick(candidate, transfer, first)


def _move_to_grasp(
    world: World,
    task: PickTask,
    candidate: PickPlaceCandidate,
    transfer: LookaheadResult | None,
    target: TargetWatch | None,
) -> Doing[None]:
    """Move to the pre-grasp and down in one motion.

    Raises TransferRefused over the pre-grasp when no transfer is known to exist from there, and TargetMoved.
    """

    def stop() -> Failure | None:
        # Asked no earlier, so that a planning worker has the time until then.
        if transfer is not None and over <= world.clock.now and transfer.ready <= world.clock.now:
            refused = transfer.answer
            if isinstance(refused, Failure):
                return TransferRefused(refused.cause, refused.message, **refused.evidence)
        return world.gripper.late() or (None if target is None else target())

    yield from world.control.settle()
    world.control.zero()
    world.gripper.start(candidate.grasp.opening)
    plan = candidate.approach
    over = world.clock.now + (plan.passes[0] if plan.passes else 0.0)
    yield from world.move.along(plan.trajectory, guard=world.handling.guard, watch=stop, node=task.node)
    yield from descend_until_contact(world, candidate.grasp, task.object, task.node)


def _no_candidate(search: CandidateSearch, object_id: ObjectId, ranked: int, tried_before: int) -> Failure:
    """Return the planner's last failure when some grasp has a reachable place, else grasp.no_candidate."""
    if search.refused is not None and search.trail.count(PLACE_STAGE):
        return search.refused
    trail = search.trail.entry()
    why = (
        describe_rejections(count_rejections(trail.tried, trail.into))
        or "nothing of it fits between the fingers"
    )
    return Failure(
        grasp.NO_CANDIDATE,
        f"none of {ranked} grasps of {object_id} is free, reachable and leads to a place: {why}",
        object=object_id,
        candidates=ranked,
        tried_before=tried_before,
    )
