"""Transfer of the held object to its place: plan over a bin or a point, monitored motion, release."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from picktree.robot.planning import LegFailure, MotionPlan, PoseGoal, Request, Scaling
from picktree.world import BeliefObject, Failure, ObjectId, Pose, bottom, grasp, place, planning, top
from picktree.world import world as world_causes
from picktree.world.scene import Bin

from .held_object import check_held_object, confirm_release, drop_held_object, release_held_object
from .pick_place_motions import lower, lower_request, withdraw
from .release_poses import bin_target, blocked, levels, opens_freely, place_candidates, put_down_poses
from .replanning import BeliefWatch, PlaceWatch, PutDownWatch, ReplanBudget, plan_after_stop
from .weighing import GripMonitor, is_fragile, payload_force, update_payload_mass

if TYPE_CHECKING:
    from picktree.robot import Handover, PlaceCandidate, World
    from picktree.robot.control import Doing
    from picktree.world import Trajectory

PLACE_DEPENDENT_CAUSES = (planning.NO_IK, planning.GOAL_IN_COLLISION, planning.NO_PATH, planning.BUDGET)
"""Causes for which another place may succeed."""


@dataclass(frozen=True, slots=True)
class PlaceTask:
    """Place of one held object, for the node that runs it."""

    object: ObjectId
    node: str
    into: ObjectId
    """Bin; empty: the object is put down at a point."""
    at: tuple[float, ...]
    """Point x, y, z in the world for the object's underside, m; empty: it goes into the bin."""
    speed: float
    """Share of the joints' speed limits, 0 … 1."""

    def bin(self, world: World) -> Bin:
        """Return the bin. Raises world.unknown_object."""
        bin_ = world.scene.bins.get(self.into)
        if bin_ is None:
            raise Failure(
                world_causes.UNKNOWN_OBJECT,
                f"there is no bin {self.into!r}",
                object=self.object,
                known=list(world.scene.bins),
            )
        return bin_


@dataclass(frozen=True, slots=True)
class ReleaseSpot:
    """Spot of the release: the bin's cell, or `point`."""

    name: str
    floor: float = 0.0
    """Height of the heap above the bin's floor, m."""
    weight: float | None = None
    """Weight of the object as felt on arrival, N. None: it has to be measured at rest."""


@dataclass(frozen=True, slots=True, eq=False)
class PlacePlan:
    """Plan of the transfer to a spot, with the monitor of its room."""

    motion: MotionPlan
    spot: ReleaseSpot
    room: BeliefWatch


MAX_FALSE_ALARMS = 4
"""Number of stops of one carrying motion by the load after which the load on the move is not believed."""


@dataclass(frozen=True, slots=True)
class _CarryMonitor:
    """Monitor of a carrying motion, called each tick: is the object held, and is there room at the place?"""

    grip: GripMonitor
    room: BeliefWatch

    def __call__(self) -> Failure | None:
        return self.grip.watch() or self.room()


def carry_to_place(world: World, task: PlaceTask) -> Doing[ReleaseSpot]:
    """Move the arm with the held object over its place, and return the spot that it has reached.

    The motion that another skill handed over for this place is continued. The arm stops and replans when the
    fingers move, an obstacle blocks the path, or the spot is taken. Raises grasp.slipped, place.full,
    place.occupied, world.unknown_object, and the failures of planner and motions.

    Where the load on the move has seemed gone `MAX_FALSE_ALARMS` times and the fingers still held the
    object at rest, only the fingers are watched: the hand's mass may be wrong.
    """
    alarms = 0
    replans = ReplanBudget(world, task.node, task.object)
    spot = yield from _finish_handover(world, task, replans)
    while spot is None:
        held = yield from measure_held_object(world, task.object)

        def ask(held: BeliefObject = held) -> Doing[PlacePlan]:
            return _plan_to_point(world, task, held) if task.at else _plan_to_bin(world, task, held)

        plan = yield from plan_after_stop(world, ask, task.node, after=replans.made)
        guard = world.handling.guard + payload_force(world)
        above = math.inf if alarms >= MAX_FALSE_ALARMS else -math.inf
        watch = _CarryMonitor(GripMonitor(world, above), plan.room)
        motion = world.move.along(plan.motion.trajectory, guard=guard, watch=watch, node=task.node)
        if (yield from _arrives(motion, replans)):
            spot = replace(plan.spot, weight=watch.grip.weight)
        alarms += watch.grip.load_gone
    return spot


def measure_held_object(world: World, object_id: ObjectId) -> Doing[BeliefObject]:
    """Measure grip and payload at rest, and return the held object. Raises grasp.slipped."""
    held, hold = yield from check_held_object(world, object_id)
    update_payload_mass(world, hold)
    return held


def _finish_handover(world: World, task: PlaceTask, replans: ReplanBudget) -> Doing[ReleaseSpot | None]:
    """Finish the motion that was handed over, if it brings the object to its place.

    None: there is no such motion, or it was stopped; the arm is at rest.
    """
    left, going = world.handover.take(), world.move.ongoing
    if left is None or going is None or not _fits(world, task, left, going.trajectory):
        yield from world.move.rest()
        return None
    room = PlaceWatch(world, world.scene.get(task.object), left.landing)
    if left.version != world.scene.version and room.judged() is not None:
        yield from world.move.rest()
        return None
    guard = world.handling.guard + payload_force(world)
    watch = _CarryMonitor(GripMonitor(world), room)
    arrived = yield from _arrives(world.move.finish(guard=guard, watch=watch, node=task.node), replans)
    return ReleaseSpot(left.landing.spot, left.landing.height, watch.grip.weight) if arrived else None


def _fits(world: World, task: PlaceTask, left: Handover, going: Trajectory) -> bool:
    """Return whether the handover concerns this object and this bin, and the object is still held.

    Changes of the belief are checked during the motion: free path, and room at the place.
    """
    held = world.scene.held
    return (
        not task.at
        and going is left.plan.trajectory
        and (left.object, left.landing.into) == (task.object, task.into)
        and held is not None
        and (held.id, held.object_in_tcp) == (left.object, left.object_in_tcp)
    )


def _arrives(motion: Doing[None], replans: ReplanBudget) -> Doing[bool]:
    """Follow a motion to its end.

    Return False when it was stopped: the fingers moved, an obstacle blocked it, or the place was taken.
    """
    try:
        yield from motion
    except Failure as failure:
        # The load is measured again at rest: the fingers may still hold the object.
        if failure.cause is not grasp.SLIPPED and not replans.allows(failure, place.OCCUPIED):
            raise
        return False
    return True


def _plan_to_bin(world: World, task: PlaceTask, held: BeliefObject) -> Doing[PlacePlan]:
    """Plan over the bin, the lowest release over the lowest part of its heap first. Raises place.full."""
    assert held.object_in_tcp is not None
    bin_ = task.bin(world)
    target = bin_target(world, held, bin_.id)
    if not target.cells:
        raise Failure(
            place.FULL,
            f"{bin_.id} is full: its heap is {target.heights.min() * 1000:.0f} mm high at its lowest",
            object=task.object,
            bin=bin_.id,
        )
    refused: Failure | None = None
    for level in levels(target):
        over = place_candidates(world, target, level, held.shape, held.object_in_tcp)
        in_tcp, width = held.object_in_tcp, world.gripper.width
        over = [at for at in over if opens_freely(world, at, held, in_tcp, width)] or over
        try:
            plan = yield from _plan_down(world, task, over)
        except Failure as failure:
            if failure.cause not in PLACE_DEPENDENT_CAUSES:
                raise
            refused = failure
            continue
        ends = world.robot.tcp(plan.trajectory.end)
        reached = min(over, key=lambda landing: landing.above.angle(ends))
        spot = ReleaseSpot(level.spot.name, level.spot.height)
        return PlacePlan(plan, spot, PlaceWatch(world, held, reached))
    assert refused is not None
    raise refused


def _plan_down(world: World, task: PlaceTask, over: Sequence[PlaceCandidate]) -> Doing[MotionPlan]:
    """Plan to a pose above the bin, and straight down from it as far as that is free."""
    goal, held = PoseGoal(tuple(landing.above for landing in over)), world.scene.held
    # Parts of an unknown thing may be hidden: it is lowered until contact instead.
    drop = 0.0 if held is not None and held.kind == "unknown" else over[0].drop
    scaling = world.handling.scaling(task.speed, held)
    if drop > 0.0:
        legs = (Request(goal, scaling=scaling), lower_request(world, drop, task.speed))
        try:
            return (yield from world.plan.through(legs, node=task.node, rounded=world.handling.rounded))
        except LegFailure as failure:
            if failure.leg != 1:
                raise
    return (yield from world.plan.to(goal, scaling=scaling, node=task.node))


def _plan_to_point(world: World, task: PlaceTask, held: BeliefObject) -> Doing[PlacePlan]:
    """Plan over the point. Raises place.occupied."""
    assert held.object_in_tcp is not None
    if len(task.at) != 3:
        raise Failure(
            world_causes.UNKNOWN_OBJECT,
            f"`at` needs three numbers x, y, z, not {list(task.at)}",
            object=task.object,
        )
    x, y, z = task.at
    poses = put_down_poses((x, y, z), held.shape, held.object_in_tcp)
    by = blocked(world.queries, held, poses[0])
    if by is not None:
        raise Failure(place.OCCUPIED, f"{by} stands where {task.object} should go", object=task.object, by=by)
    room = PutDownWatch(world, held, poses[0])
    over = PoseGoal(tuple(pose.shifted((0.0, 0.0, world.handling.approach)) for pose in poses))
    scaling = world.handling.scaling(task.speed, held)
    motion = yield from world.plan.to(over, scaling=scaling, node=task.node)
    return PlacePlan(motion, ReleaseSpot("point"), room)


def lower_and_release(world: World, task: PlaceTask, spot: ReleaseSpot) -> Doing[BeliefObject]:
    """Lower the held object to its spot, open the fingers and withdraw; return the object.

    Raises grasp.slipped when it is not held before, and place.missed when it still hangs on the open hand.
    """
    with world.step(task.node, "lower"):
        hanging = spot.weight
        if hanging is None:
            yield from measure_held_object(world, task.object)
            hanging = world.control.load()
        held = world.scene.get(task.object)
        yield from lower(world, held, None if task.at else task.bin(world), task.node)
    with world.step(task.node, "release"):
        return (yield from _release(world, task, spot, hanging))


def _release(world: World, task: PlaceTask, spot: ReleaseSpot, hanging: float) -> Doing[BeliefObject]:
    """Open the fingers at the spot and withdraw; `hanging`: weight of the object as felt before, N."""
    held = world.scene.get(task.object)
    resting = held.pose if task.at else _resting_pose(task.bin(world), held, spot)
    fragile = is_fragile(world, held.kind)
    if not task.at and not fragile:
        fallen = yield from drop_held_object(world, held, resting, hanging, task.into)
        yield from _rise_above(world, task, top(held.shape, resting))
        if fallen:
            return held
        # An object that hangs on a finger falls when the fingers are fully open.
        yield from world.gripper.open()
    else:
        yield from release_held_object(world, held, resting, task.into or "table", "placed")
    if task.at:
        yield from withdraw(world, task.node)
    elif fragile:
        yield from _withdraw_if_free(world, task.node)
    yield from confirm_release(world, held, hanging, place.MISSED)
    return held


def _resting_pose(bin_: Bin, held: BeliefObject, spot: ReleaseSpot) -> Pose:
    """Return the pose in which the object is believed to come to rest in the bin."""
    floor = bin_.pose.position[2] + bin_.wall + max(0.0, spot.floor)
    return held.pose.shifted((0.0, 0.0, min(0.0, floor - bottom(held.shape, held.pose))))


def _rise_above(world: World, task: PlaceTask, height: float) -> Doing[None]:
    """Move the fingers straight up from around a released object, to `height` m in the world.

    The next motion may leave sideways, and the fingers may close for it.
    """
    tips = world.control.tcp.position[2] - world.robot.description.gripper.tip
    rise = height + world.handling.rim_clearance - tips
    if rise > 0.0:
        yield from _withdraw_if_free(world, task.node, rise, world.handling.scaling(task.speed))


def _withdraw_if_free(
    world: World, node: str, rise: float | None = None, scaling: Scaling | None = None
) -> Doing[None]:
    """Withdraw straight up as far as possible, away from bodies that the hand would crush; see `withdraw`."""
    try:
        yield from withdraw(world, node, rise, scaling)
    except Failure as failure:
        if failure.cause not in (*PLACE_DEPENDENT_CAUSES, planning.START_IN_COLLISION):
            raise
