"""Straight legs near an object: descent, lift, lowering, withdrawal."""

from __future__ import annotations

from collections.abc import Generator
from typing import TYPE_CHECKING

from ...planning.requests import OffsetGoal
from ...world.belief.planning_scene import BeliefObject
from ...world.scene.description import Bin
from ...world.shapes import bottom
from ...world.values import ObjectId
from .grasp_candidates import GraspCandidate

if TYPE_CHECKING:
    from ...skill_world.world import World

Steps = Generator[None, None, None]

NEIGHBOUR_DISTANCE = 0.02
"""Clearance below which neighbours may be grazed during the lift, m. The open hand has cleared them
before."""
DOWNWARDS, UPWARDS = (0.0, 0.0, -1.0), (0.0, 0.0, 1.0)
LIFT_GUARD_FORCE = 10.0
"""Force that lifting an object may add to the guard of a motion, N."""


def descend_until_contact(world: World, candidate: GraspCandidate, object_id: ObjectId, node: str) -> Steps:
    """Descend the last bit onto a flat object until contact; other objects need none."""
    if not candidate.flat:
        return
    # Fingers on knuckles reach further out when they close.
    fingers = world.robot.fingers
    at_grip, opened = fingers.reach(candidate.expected_width), fingers.reach(candidate.opening)
    way = world.handling.felt_way + (world.robot.description.gripper.tip - opened)
    with world.scene.allow(("gripper", object_id)):
        felt = yield from world.move.guarded(
            DOWNWARDS, way, force=world.handling.touch, speed=world.handling.touch_speed, node=node
        )
        if felt.contact:
            rise = world.handling.back_off + max(0.0, at_grip - opened)
            up = OffsetGoal((0.0, 0.0, rise), least_fraction=0.5)
            plan = yield from world.plan.line(up, scaling=world.handling.slowly, node=node)
            yield from world.move.along(plan.trajectory, node=node)


def lift(world: World, object_id: ObjectId, node: str) -> Steps:
    """Lift the hand straight up from between the neighbours, with or without the object."""
    held = world.scene.held
    near = [
        ("gripper", str(c.b))
        for c in world.queries.hand_contacts(
            world.control.tcp, world.gripper.width, margin=NEIGHBOUR_DISTANCE
        )
        if c.b != object_id
    ]
    with world.scene.allow(("gripper", object_id), *near):
        up = OffsetGoal((0.0, 0.0, world.handling.approach), least_fraction=0.3)
        plan = yield from world.plan.line(up, scaling=world.handling.slowly, node=node)
        guard = world.handling.guard + (0.0 if held is None else LIFT_GUARD_FORCE)
        yield from world.move.along(plan.trajectory, guard=guard, node=node)


def lift_off(world: World, node: str) -> Steps:
    """Lift the object straight up, off its support or out of a recess, until something holds it back."""
    handling = world.handling
    yield from world.move.guarded(
        UPWARDS,
        handling.approach,
        force=handling.guard + LIFT_GUARD_FORCE,
        speed=handling.lower_speed,
        node=node,
    )


def lower(world: World, held: BeliefObject, bin_: Bin | None, node: str) -> Steps:
    """Lower the object until contact, or into a bin as far as the finger tips stay above its rim."""
    if bin_ is None:
        way = world.handling.approach + world.handling.felt_way
    else:
        rim = bin_.pose.position[2] + bin_.size[2]
        tips = world.control.tcp.position[2] - world.robot.description.gripper.tip
        floor = bin_.pose.position[2] + bin_.wall
        way = min(tips - rim - world.handling.rim_clearance, bottom(held.shape, held.pose) - floor)
    if way > world.handling.felt_way:
        yield from world.move.guarded(
            DOWNWARDS, way, force=world.handling.touch, speed=world.handling.lower_speed, node=node
        )


def withdraw(world: World, node: str) -> Steps:
    """Move straight up from the released object, as far as that is free."""
    near = [
        ("gripper", str(c.b))
        for c in world.queries.hand_contacts(
            world.control.tcp, world.gripper.width, margin=NEIGHBOUR_DISTANCE
        )
    ]
    with world.scene.allow(*near):
        up = OffsetGoal((0.0, 0.0, world.handling.approach / 2), least_fraction=0.2)
        plan = yield from world.plan.line(up, scaling=world.handling.slowly, node=node)
        yield from world.move.along(plan.trajectory, node=node)
