"""Homing of a retreat: planned, under joint impedance, with a new path after an unknown obstacle."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...world.causes import Failure, planning
from ..planning.requests import NamedGoal, Scaling
from .clearing import FREE_PATH_THRESHOLDS, REDUCED_SPEED, WARY_SPEED, RetreatMotion

if TYPE_CHECKING:
    from ..control.trajectory_motion import Doing
    from ..world import World

MAX_HOMING_ATTEMPTS = 4
"""Maximum number of attempts to plan and follow a path home."""
DETOUR_LENGTH = 0.15
"""Length of the motion away from an obstacle before the next attempt, m of TCP travel."""
AT_POSE_TOLERANCE = 2e-3
"""Greatest joint distance to the named pose at which the arm is there, rad."""


def go_home(world: World, leaving: RetreatMotion, pose: str, scaling: Scaling, node: str) -> Doing[bool]:
    """Move the arm to a named pose. False: there is no safe path; `leaving.tried` has the attempts."""
    looked = yield from observe_with_fixed_cameras(world)
    for attempt in range(MAX_HOMING_ATTEMPTS):
        if leaving.late:
            return False
        if attempt:
            looked = yield from observe_with_fixed_cameras(world)
        try:
            key = node if attempt == 0 else f"{node} again {attempt}"
            plan = yield from world.plan.to(NamedGoal(pose), scaling=scaling, node=key)
            wary = leaving.touched or not looked
            trajectory = world.move.slowed(plan.trajectory, WARY_SPEED if wary else REDUCED_SPEED)
            result = yield from leaving.follow(trajectory, FREE_PATH_THRESHOLDS)
        except Failure as failure:
            if not failure.cause.name.startswith("planning."):
                raise
            leaving.tried.append(f"to {pose}: {failure.message}")
            if failure.cause is planning.GOAL_IN_COLLISION:
                return False
            yield from leaving.out()
            yield from leaving.up(DETOUR_LENGTH, always=True)
            continue
        if result.completed:
            yield from _move_to_exact_pose(world, pose, scaling, node)
            return True
        if result.noticed is not None:
            leaving.tried.append(f"to {pose}: {result.noticed.message}")
            continue
        yield from leaving.touched_on_the_way(result, f"to {pose}")
        yield from leaving.out()
        yield from leaving.up(DETOUR_LENGTH, always=True)
    return False


def observe_with_fixed_cameras(world: World) -> Doing[bool]:
    """Take an image with every camera that is not on the hand, and return whether one was obtained.

    A camera without an image is skipped.
    """
    seen = False
    for camera in world.description.cameras:
        if camera.on == "hand":
            continue
        try:
            yield from world.vision.look(camera.name)
            seen = True
        except Failure as failure:
            if not failure.cause.name.startswith("perception."):
                raise
    return seen


def _move_to_exact_pose(world: World, pose: str, scaling: Scaling, node: str) -> Doing[None]:
    """Move the rest of the way with the stiff servo: the soft spring leaves an error."""
    off = float(np.abs(world.control.state.position - world.robot.named(pose)).max())
    if off < AT_POSE_TOLERANCE:
        return
    plan = yield from world.plan.to(NamedGoal(pose), scaling=scaling, node=node)
    yield from world.move.along(plan.trajectory, guard=world.handling.guard, node=node)
