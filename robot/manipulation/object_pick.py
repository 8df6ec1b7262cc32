"""Pick of an object: approach of the best remaining candidate, grip, and lift with weighing on the way up.

The transfer is planned ahead. After a miss the object is looked for again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from picktree.robot import Handover
from picktree.world import Failure, ObjectId, event_types, grasp, planning, world_facts
from picktree.world import world as world_causes

from .candidate_search import CandidateSearch
from .compliant_closing import close
from .grip_force import GripForce, grip_force
from .held_object import GripCheck, measure_grip, release_object
from .object_grasps import leaning_object_grasps, object_grasps
from .pick_candidates import PLACE_STAGE, PickPlaceCandidate, count_rejections, describe_rejections
from .pick_place_motions import (
    LIFT_GUARD_FORCE,
    descend_until_contact,
    lift,
    plan_transfer_ahead,
    plan_transfer_from_here,
    take_transfer,
)
from .replanning import ReplanBudget, TargetMoved, TargetWatch, plan_after_stop
from .visual_servoing import servo_to_grasp
from .weighing import LiftWeighing, payload_force, register_payload, update_payload_mass

if TYPE_CHECKING:
    from picktree.robot import World
    from picktree.robot.control import Doing
    from picktree.robot.planning import LookaheadResult, MotionPlan
    from picktree.world import BeliefObject


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
    """Transfer that was planned during the approach; None without one."""
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
    refused = world.attempts.refusal(world_facts.GRASP, belief, world.scene)
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
        with world.step(task.node, "choose"):
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
                world.attempts.refuse(world_facts.GRASP, belief, world.scene, failure.message)
            raise failure
        candidate, watch = found, moved
        try:
            with world.step(task.node, "approach"):
                if task.servo and world.vision.hand is not None:
                    candidate = yield from servo_to_grasp(
                        world, found, task.node, task.speed, first=first, watch=watch
                    )
                    # Detections of the hand camera count; another camera may err by its mounting.
                    watch = None
                transfer = (
                    plan_transfer_ahead(world, candidate, task.speed, task.node) if task.onward else None
                )
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
        return world.gripper.overdue_failure() or (None if target is None else target())

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


CLEAR_LIFT_SHARE = 0.5
"""Share of the lift height above which an object is clear of its neighbours."""


@dataclass(frozen=True, slots=True, eq=False)
class ClosedGrip:
    """Closed fingers at a grasp, with their payload."""

    candidate: PickPlaceCandidate
    belief: BeliefObject
    """Object as believed before the fingers closed."""
    press: GripForce
    felt: GripCheck
    """Opening of the fingers. The load is not measured yet."""
    transfer: LookaheadResult | None
    """Transfer from the present configuration. None: the object is lifted straight up."""
    first: bool
    """Whether no candidate of this object has failed before."""


@dataclass(frozen=True, slots=True)
class LostGrasp:
    """Grasp that holds nothing after its lift, with the hand open again."""

    failure: Failure
    """Failure grasp.missed or grasp.slipped."""
    gripped: bool
    """Whether the object was between the fingers. Otherwise they met."""


def close_on_object(
    world: World, task: PickTask, approached: ApproachedPick, *, firmer: bool
) -> Doing[ClosedGrip]:
    """Close the fingers as the item needs and bears, and attach an object between them in the belief.

    `firmer`: whether the object slipped out of the usual grip before. The transfer is planned while the
    fingers close. Raises the failures of `close`.
    """
    candidate, transfer = approached.candidate, approached.transfer
    belief = world.scene.get(task.object)
    entry = world.description.find_entry(belief.kind)
    press = grip_force(entry, task.force, world.robot.description.gripper)
    if firmer:
        press = press.firmer()
    object_in_tcp = world.control.tcp.inverse() @ belief.pose
    if transfer is None and candidate.landing is not None and task.onward:
        transfer = plan_transfer_from_here(world, candidate, object_in_tcp, task.speed, task.node)
    with world.step(task.node, "close"):
        closed = yield from close(world, press, task.node)
    if closed.gave_way and transfer is not None:
        transfer = plan_transfer_from_here(world, candidate, object_in_tcp, task.speed, task.node)
    felt = GripCheck(closed.width, None)
    if not felt.empty:
        register_payload(world, press, entry, object_in_tcp)
        world.scene.attach(task.object, object_in_tcp)
    return ClosedGrip(candidate, belief, press, felt, transfer, approached.first)


def lift_object(world: World, task: PickTask, grip: ClosedGrip) -> Doing[LostGrasp | None]:
    """Lift the object and weigh it, on the way to its place or at rest.

    None: it is held. Otherwise the hand is open, the belief has the object below it, and the candidate counts
    as failed. Raises the failures of motions.
    """
    name = grip.candidate.grasp.name
    try:
        hold = yield from _lift(world, task, grip)
    except Failure:
        world.attempts.failed(task.node, task.object, name)
        _note_pick(world, task, grip, grip.felt)
        raise
    _note_pick(world, task, grip, hold)
    if hold.held:
        update_payload_mass(world, hold, grip.press)
        world.attempts.clear(task.node, task.object)
        return None
    world.attempts.failed(task.node, task.object, name)
    world.handover.drop()
    # Too little was felt during the whole lift: the object stayed behind, and the hand has moved on.
    release_object(world.scene, "not felt in the hand", left_at=grip.belief.pose)
    yield from world.gripper.open()
    cause, what = (
        (grasp.MISSED, "the fingers met and hold nothing")
        if grip.felt.empty
        else (grasp.SLIPPED, "it was between the fingers and slipped out")
        if hold.empty or hold.light is None
        else (grasp.MISSED, "the fingers hold something else")
    )
    failure = Failure(
        cause,
        f"{task.object}: {what} ({hold})",
        object=task.object,
        candidate=name,
        width=hold.width,
        load=hold.load,
        expected_width=grip.candidate.grasp.expected_width,
    )
    return LostGrasp(failure, gripped=not grip.felt.empty)


def _lift(world: World, task: PickTask, grip: ClosedGrip) -> Doing[GripCheck]:
    """Lift the object and measure the grip, on the way to the bin or at rest."""
    transfer = grip.transfer
    with world.step(task.node, "lift"):
        plan = None if transfer is None or grip.felt.empty else (yield from take_transfer(world, transfer))
        if plan is None:
            yield from lift(world, task.object, task.node)
        else:
            hold = yield from _lift_onward(world, task, grip, plan)
            if hold is not None:
                return hold
    with world.step(task.node, "weigh"):
        return (yield from measure_grip(world))


def _lift_onward(world: World, task: PickTask, grip: ClosedGrip, plan: MotionPlan) -> Doing[GripCheck | None]:
    """Lift the object as the first part of its transfer, and hand the moving arm over to the next skill.

    None: the arm has stopped, because the grip was in doubt or the path is blocked.
    """
    landing = grip.candidate.landing
    assert landing is not None, "a transfer leads to a place"
    weighing = LiftWeighing(world, plan.passes[0])
    guard = world.handling.guard + max(LIFT_GUARD_FORCE, payload_force(world))
    lifted = plan.passes[0] + world.tick
    try:
        yield from world.move.along(
            plan.trajectory, guard=guard, watch=weighing.watch, hand_over=lifted, node=task.node
        )
    except Failure as failure:
        in_doubt = failure.cause is grasp.SLIPPED
        if not in_doubt and not ReplanBudget(world, task.node, task.object).allows(failure):
            raise
        if failure.cause is planning.BLOCKED and not _is_clear(world, grip.candidate):
            yield from lift(world, task.object, task.node)
    if weighing.hold is not None:
        held = world.scene.get(task.object)
        if held.object_in_tcp is not None:
            left = Handover(task.object, held.object_in_tcp, landing, plan, world.scene.version)
            world.handover.leave(left)
    return weighing.hold


def _is_clear(world: World, candidate: PickPlaceCandidate) -> bool:
    """Return whether the hand has lifted the object out of its surroundings."""
    risen = world.control.tcp.position[2] - candidate.grasp.tcp_in_world.position[2]
    return risen > CLEAR_LIFT_SHARE * world.handling.approach


def _note_pick(world: World, task: PickTask, grip: ClosedGrip, hold: GripCheck) -> None:
    """Record one closing of the fingers, and the measured grip."""
    world.journal.note(
        event_types.PickEvent(
            f"{task.object}: {'held' if hold.held else 'not held'}",
            task.node,
            object=task.object,
            form=grip.belief.form,
            candidate=grip.candidate.grasp.name,
            held=hold.held,
            first_try=grip.first,
            width=hold.width,
            load=hold.load,
            force=world.gripper.force,
        )
    )


def relocate_object(world: World, task: PickTask, lost: LostGrasp) -> Doing[PickTask | None]:
    """Look for the object from the present pose, and return how it can be grasped again at once, if it can.

    This costs no motion; cameras on the hand come first. They may see an object that the hand hides from the
    others. An object that slipped is looked for by touch where it was gripped, unless it is seen elsewhere.
    """
    yield from world.control.settle()
    cameras = sorted(world.description.cameras, key=lambda camera: camera.on != "hand")
    for camera in cameras:
        summary = yield from world.vision.observe(camera.name)
        if task.object in summary.seen:
            _note_regrasp(world, task, lost, f"seen by {camera.name}")
            return task
    believed = world.scene.find(task.object)
    if lost.failure.cause is not grasp.SLIPPED or believed is None:
        return None
    _note_regrasp(world, task, lost, "it was lost where it was gripped")
    return replace(task, gently=True)


def _note_regrasp(world: World, task: PickTask, lost: LostGrasp, where: str) -> None:
    world.journal.note(
        event_types.RegraspEvent(
            f"{task.object} is grasped once more ({where}): {lost.failure.message}",
            task.node,
            object=task.object,
            where=where,
        )
    )
