"""Motions of a pick and place: straight legs near the object, requests for the motions between them.

Approach, descent, lift, transfer, lowering, withdrawal; transfers are planned ahead.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from picktree.robot.control import distance_to_workspace_edge
from picktree.robot.planning import (
    HeldObject,
    JointGoal,
    LineGoal,
    MotionPlan,
    OffsetGoal,
    PoseGoal,
    Request,
    Scaling,
)
from picktree.world import Array, BeliefObject, Failure, ObjectId, Pose, bottom, planning, top
from picktree.world.scene import Bin

from .grasps import GraspCandidate
from .pick_candidates import PickPlaceCandidate

if TYPE_CHECKING:
    from picktree.robot import World
    from picktree.robot.control import Doing
    from picktree.robot.planning import LookaheadResult
    from picktree.world.robot_model import RobotModel

NEIGHBOUR_DISTANCE = 0.02
"""Clearance below which neighbours may be grazed during the lift, m. The open hand has cleared them
before."""
DOWNWARDS, UPWARDS = (0.0, 0.0, -1.0), (0.0, 0.0, 1.0)
MIN_LOWERING_SHARE = 0.2
"""Share of the way down below which it is not begun beside an obstacle."""
SETTLING_TRAVEL = 0.001
"""Greatest travel of the tool while the arm settles before a guarded move, m."""
LIFT_GUARD_FORCE = 10.0
"""Force that lifting an object may add to the guard of a motion, N."""


def descend_until_contact(
    world: World, candidate: GraspCandidate, object_id: ObjectId, node: str
) -> Doing[None]:
    """Descend the last bit onto a flat object until contact; other objects need none."""
    if not candidate.flat:
        return
    # Fingers on knuckles reach further out when they close.
    fingers = world.robot.fingers
    at_grip, opened = fingers.reach(candidate.expected_width), fingers.reach(candidate.opening)
    way = world.handling.felt_way + (world.robot.description.gripper.tip - opened)
    tool = world.control.tcp.position
    # Tips that retract far as they open may stay behind the TCP, which then comes to the edge first.
    room = distance_to_workspace_edge(world.description.limits.workspace, tool, np.array(DOWNWARDS))
    room -= SETTLING_TRAVEL
    with world.scene.allow(("gripper", object_id)):
        contact = False
        if min(way, room) > 0.0:
            felt = yield from world.move.guarded(
                DOWNWARDS,
                min(way, room),
                force=world.handling.touch,
                speed=world.handling.touch_speed,
                node=node,
            )
            contact = felt.contact
        rise = 0.0
        if contact:
            rise = world.handling.back_off + max(0.0, at_grip - opened)
        elif room < way:
            # The fingers did not touch its support: the height of that is believed.
            seen = world.scene.get(object_id)
            support = bottom(seen.shape, seen.pose)
            rise = support + at_grip + world.handling.back_off - world.control.tcp.position[2]
        if rise > 0.0:
            yield from _move_up(world, rise, 0.5, node)


def lift(world: World, object_id: ObjectId, node: str, rise: float | None = None) -> Doing[None]:
    """Lift the hand straight up from between the neighbours, with or without the object, by `rise` m.

    Default: the approach.
    """
    guard = world.handling.guard + (0.0 if world.scene.held is None else LIFT_GUARD_FORCE)
    near = [name for name in _neighbours(world) if name != object_id]
    with world.scene.allow(*(("gripper", name) for name in (object_id, *near))):
        yield from _move_up(world, world.handling.approach if rise is None else rise, 0.3, node, guard)


def lift_off(world: World, node: str) -> Doing[None]:
    """Lift the object straight up, off its support or out of a recess, until something holds it back."""
    handling = world.handling
    yield from world.move.guarded(
        UPWARDS,
        handling.approach,
        force=handling.guard + LIFT_GUARD_FORCE,
        speed=handling.lower_speed,
        node=node,
    )


def lower(world: World, held: BeliefObject, bin_: Bin | None, node: str) -> Doing[None]:
    """Lower the object until contact, or into a bin as far as the finger tips stay above its rim.

    Beside an obstacle the whole arm must have room: the wrist does not feel contacts of the arm itself, and
    something may have been seen there since its way was planned. Into a bin the object is lowered so far and
    falls from there. Raises planning.no_path or .start_in_collision for a point that is not reached.
    """
    if bin_ is None:
        way = world.handling.approach + world.handling.felt_way
    else:
        way = lowering(world, bin_, world.control.tcp.position[2], bottom(held.shape, held.pose))
    if way > world.handling.felt_way and any(o.role == "obstacle" for o in world.scene.objects):
        least = 1.0 if bin_ is None else MIN_LOWERING_SHARE
        way = yield from _room_beside_obstacles(world, held, way, least, node)
    if way > world.handling.felt_way:
        yield from world.move.guarded(
            DOWNWARDS, way, force=world.handling.touch, speed=world.handling.lower_speed, node=node
        )


def _room_beside_obstacles(
    world: World, held: BeliefObject, way: float, least: float, node: str
) -> Doing[float]:
    """Return the length of the way down that is free of unknown obstacles, m. Contact with fixtures, bins and
    items is allowed.

    0 when less than the share `least` of `way` is free. With `least` 1 it raises the planner's failure.
    """
    others = [str(o.id) for o in world.scene.objects if o.role != "obstacle" and o.id != held.id]
    felt = (*map(str, world.scene.fixtures), *map(str, world.scene.bins), *others)
    pairs = tuple((part, name) for name in felt for part in ("gripper", str(held.id)))
    down = OffsetGoal((0.0, 0.0, -way), least_fraction=least)
    try:
        plan = yield from world.plan.solve(
            Request(down, allowed=pairs, scaling=world.handling.slowly), node=node
        )
    except Failure as failure:
        if least == 1.0 or failure.cause not in (planning.NO_PATH, planning.START_IN_COLLISION):
            raise
        return 0.0
    return world.control.tcp.position[2] - world.robot.tcp(plan.trajectory.end).position[2]


def lowering(world: World, bin_: Bin, tcp: float, low: float) -> float:
    """Return how far the hand may be lowered into a bin, m: the finger tips stay above its rim.

    `tcp`, `low`: heights of the TCP and of the object's lowest point in the world, m.
    """
    rim = bin_.pose.position[2] + bin_.size[2]
    tips = tcp - world.robot.description.gripper.tip
    floor = bin_.pose.position[2] + bin_.wall
    return min(tips - rim - world.handling.rim_clearance, low - floor)


def withdraw(
    world: World, node: str, rise: float | None = None, scaling: Scaling | None = None
) -> Doing[None]:
    """Move straight up from the released object by `rise` m, as far as that is free.

    Default: half the approach, slowly.
    """
    rise = world.handling.approach / 2 if rise is None else rise
    with world.scene.allow(*(("gripper", name) for name in _neighbours(world))):
        yield from _move_up(world, rise, 0.2, node, world.handling.guard, scaling)


def _neighbours(world: World) -> list[str]:
    """Return the bodies that the hand may graze where it is."""
    near = world.queries.hand_contacts(world.control.tcp, world.gripper.width, margin=NEIGHBOUR_DISTANCE)
    return [str(contact.b) for contact in near]


def _move_up(
    world: World,
    rise: float,
    least_fraction: float,
    node: str,
    guard: float | None = None,
    scaling: Scaling | None = None,
) -> Doing[None]:
    """Move the hand straight up by `rise` m, at least by that share of it. `guard`: force limit, N.

    `scaling`: by default that of slow lines.
    """
    up = OffsetGoal((0.0, 0.0, rise), least_fraction)
    plan = yield from world.plan.line(up, scaling=scaling or world.handling.slowly, node=node)
    yield from world.move.along(plan.trajectory, guard=guard, node=node)


MIN_LIFT_SHARE = 0.3
"""Share of the straight way up or down that must be free. The rest is skipped."""
MAX_START_ERROR = 0.005
"""Start error above which a plan belongs to another configuration, rad in any joint."""
DESCENT_SPEED = 0.5
"""Speed onto a grasp, as a share of that of travel: at full speed a misplaced object is hit too hard."""
SLOW_DESCENT_COST = 0.5
"""Time that the slow descent of a narrow grasp takes longer, s."""
MAX_SLOW_SHARE = 0.9
"""Share of the way down from which on all of it is slow."""
MAX_TOP_ERROR = 0.010
"""Height above the believed top of an object at which a finger may meet it, m."""


def approach(
    world: World,
    object_id: ObjectId,
    grasp: GraspCandidate,
    over: Array,
    speed: float,
    *,
    gently: bool = False,
) -> tuple[Request, ...]:
    """Return the requests from the arm's configuration to the pre-grasp `over` (n,) and straight down onto
    the grasp.

    The fingers move to the grasp's opening on the way there. For a flat object the descent ends early; the
    rest is a guarded move. If a finger may come down on an object, the last part is slow enough for the guard
    to stop the arm in time. With `gently` all of the descent is.
    """
    widest, narrowest = world.gripper.span(grasp.opening)
    scaling = world.handling.scaling(speed)
    travel = Request(JointGoal(over), width=widest, narrowest=narrowest, scaling=scaling)
    down = descend_request(world, object_id, grasp, speed)
    distance = math.inf if gently else contact_distance(world, object_id, grasp)
    if distance == 0.0:
        return (travel, down)
    share = line_speed_share(world.robot, over, grasp.tcp_in_world, world.handling.touch_speed)
    slow = replace(down, scaling=replace(down.scaling, velocity=min(share, down.scaling.velocity)))
    if distance >= MAX_SLOW_SHARE * world.handling.approach:
        return (travel, slow)
    return (travel, replace(down, target=LineGoal(grasp.before(distance))), slow)


def descend_request(world: World, object_id: ObjectId, grasp: GraspCandidate, speed: float) -> Request:
    """Return the request from the pre-grasp straight down. For a flat object it ends early; the rest is a
    guarded move."""
    felt = world.handling.felt_way / 2 if grasp.flat else 0.0
    down = LineGoal(grasp.tcp_in_world.shifted((0.0, 0.0, felt)))
    pairs = tuple(("gripper", name) for name in touchable(world, object_id))
    scaling = world.handling.scaling(DESCENT_SPEED * speed)
    return Request(down, width=grasp.opening, allowed=pairs, scaling=scaling)


def contact_distance(world: World, object_id: ObjectId, grasp: GraspCandidate) -> float:
    """Return the last part of the way to a grasp on which a finger may come down on an object, m.

    It begins above the highest of the objects that the hand comes close to. 0: the fingers are open wide
    enough.
    """
    if not grasp.narrow:
        return 0.0
    near = world.queries.hand_contacts(grasp.tcp_in_world, grasp.opening, margin=NEIGHBOUR_DISTANCE)
    others = [world.scene.find(ObjectId(contact.b)) for contact in near]
    objects = [world.scene.get(object_id), *(each for each in others if each is not None)]
    highest = max(top(each.shape, each.pose) for each in objects)
    tips = grasp.tcp_in_world.position[2] - world.robot.description.gripper.tip
    return max(highest + MAX_TOP_ERROR - tips, 0.0)


def line_speed_share(model: RobotModel, start: Array, end: Pose, speed: float) -> float:
    """Return the share (0, 1] of the joints' speed limits at which the TCP moves straight at `speed` m/s.

    It moves from the configuration `start` (n,), rad, to the pose `end` in the world.
    """
    way = np.array(end.position) - np.array(model.tcp(start).position)
    twist = np.concatenate([way / max(float(np.linalg.norm(way)), 1e-9), np.zeros(3)])
    joints = np.linalg.pinv(model.jacobian(start)) @ twist
    return min(1.0, speed * float((np.abs(joints) / model.velocity_limit).max()))


def touchable(world: World, object_id: ObjectId) -> tuple[ObjectId, ...]:
    """Return the bodies that the hand may touch at a grasp: the object, and the tote of a heap.

    The map of a heap has the walls of its tote, and its grasps keep the hand from them.
    """
    belief = world.scene.find(object_id)
    return (object_id, ObjectId(belief.place)) if belief and belief.role == "heap" else (object_id,)


def transfer_requests(
    world: World,
    holding: HeldObject,
    start: Array,
    width: float,
    over: Array | tuple[Pose, ...],
    drop: float,
    speed: float,
) -> tuple[Request, ...]:
    """Return the requests from a grasp (n,) with the object straight up, over the bin, and down by `drop` m.

    `over`: configuration (n,) over the place, or TCP poses of which one is reached.
    """
    handling, scaling = world.handling, world.handling.scaling(speed)
    tcp = world.robot.tcp(start)
    near = world.queries.hand_contacts(tcp, width, ignore=(holding.object,), margin=NEIGHBOUR_DISTANCE)
    neighbours = tuple(("gripper", name) for name in sorted({contact.b for contact in near}))
    goal = PoseGoal(over) if isinstance(over, tuple) else JointGoal(over)
    up = OffsetGoal((0.0, 0.0, handling.approach), least_fraction=MIN_LIFT_SHARE)
    legs = [
        Request(up, start, width, holding, neighbours, scaling=scaling),
        Request(goal, width=width, holding=holding, scaling=scaling),
    ]
    if drop > 0.0:
        legs.append(lower_request(world, drop, speed, width, holding))
    return tuple(legs)


def lower_request(
    world: World, drop: float, speed: float, width: float | None = None, holding: HeldObject | None = None
) -> Request:
    """Return the request straight down with a held object, where no contact is expected."""
    down = OffsetGoal((0.0, 0.0, -drop), least_fraction=MIN_LIFT_SHARE)
    return Request(down, width=width, holding=holding, scaling=world.handling.scaling(speed))


def plan_transfer_ahead(
    world: World, candidate: PickPlaceCandidate, speed: float, node: str
) -> LookaheadResult | None:
    """Plan the transfer of a candidate ahead, from the configuration of its grasp.

    None: it has no place, or it is flat, so that its grasp height is known only after contact.
    """
    if candidate.above is None or candidate.landing is None or candidate.grasp.flat:
        return None
    holding = HeldObject(candidate.object, candidate.object_in_tcp)
    width, drop = candidate.grasp.expected_width, candidate.landing.drop
    legs = transfer_requests(world, holding, candidate.at, width, candidate.above, drop, speed)
    return world.plan.ahead(legs, node=node, rounded=world.handling.rounded)


def plan_transfer_from_here(
    world: World, candidate: PickPlaceCandidate, object_in_tcp: Pose, speed: float, node: str
) -> LookaheadResult:
    """Plan the transfer of a candidate with a place ahead, from the present configuration."""
    assert candidate.landing is not None
    holding = HeldObject(candidate.object, object_in_tcp)
    tcp = world.control.tcp
    # The object is held higher or lower than planned; it must land at the planned place.
    moved = candidate.grasp.tcp_in_world.position[2] - tcp.position[2]
    above = candidate.landing.above.shifted((0.0, 0.0, -moved))
    start = world.control.held_position
    width, drop = candidate.grasp.expected_width, candidate.landing.drop
    legs = transfer_requests(world, holding, start, width, (above,), drop, speed)
    return world.plan.ahead(legs, node=node, rounded=world.handling.rounded)


def take_transfer(world: World, transfer: LookaheadResult) -> Doing[MotionPlan | None]:
    """Return a transfer that was planned ahead. None: it is refused, or starts at another configuration."""
    try:
        plan = yield from world.plan.take(transfer)
    except Failure:
        return None
    if plan is None:
        return None
    off = float(np.abs(plan.trajectory.start - world.control.held_position).max())
    return plan if off < MAX_START_ERROR else None
