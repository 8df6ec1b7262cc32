"""Grip and lift of a pick: closing of the fingers, weighing on the way up, and what to do after a miss."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ...world.causes import Failure, grasp, planning
from ...world.skill_events import PickEvent, RegraspEvent
from ..world import Handover
from .compliant_closing import GripForce, close, grip_force
from .dropped_objects import release_object
from .hold_check import GripCheck, measure_grip
from .object_approach import ApproachedPick, PickTask
from .pick_candidates import PickPlaceCandidate
from .replanning import ReplanBudget
from .straight_lines import LIFT_GUARD_FORCE, lift
from .transfer_requests import plan_transfer_from_here, take_transfer
from .weighing import LiftWeighing, payload_force, register_payload, update_payload_mass

if TYPE_CHECKING:
    from ...world.belief.planning_scene import BeliefObject
    from ..control.trajectory_motion import Doing
    from ..planning.lookahead_planning import LookaheadResult
    from ..planning.requests import MotionPlan
    from ..world import World

CLEAR_LIFT_SHARE = 0.5
"""Share of the lift height above which an object is clear of its neighbours."""


@dataclass(frozen=True, slots=True, eq=False)
class ClosedGrip:
    """Closed fingers at a grasp, with what they are to carry."""

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
    plan = None if transfer is None or grip.felt.empty else (yield from take_transfer(world, transfer))
    if plan is None:
        yield from lift(world, task.object, task.node)
    else:
        hold = yield from _lift_onward(world, task, grip, plan)
        if hold is not None:
            return hold
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
        PickEvent(
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
        summary = yield from world.vision.look(camera.name)
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
        RegraspEvent(
            f"{task.object} is grasped once more ({where}): {lost.failure.message}",
            task.node,
            object=task.object,
            where=where,
        )
    )
