"""Straight legs near an object: descent, lift, lowering, withdrawal."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...world.belief.planning_scene import BeliefObject
from ...world.causes import Failure, planning
from ...world.scene.description import Bin
from ...world.shapes import bottom
from ...world.values import ObjectId
from ..control.soft_limits import distance_to_workspace_edge
from ..planning.requests import OffsetGoal, Request, Scaling
from .grasp_candidates import GraspCandidate

if TYPE_CHECKING:
    from ..control.trajectory_motion import Doing
    from ..world import World

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
            # What it lies on was not felt: its height is believed.
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
    """Return how much of the way down is free of obstacles, m. What hand and object feel may be touched.

    Less than the share `least` of it is none; where all of it is needed, that is the planner's failure.
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
