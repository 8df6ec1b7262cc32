"""Put-down of the held object on the nearest free spot of a fixture, for a retreat."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from ...world.belief.planning_scene import BeliefObject
from ...world.causes import Failure, place
from ...world.shapes import top
from ...world.skill_events import PutDownEvent
from ..planning.requests import OffsetGoal, PoseGoal, Request, Scaling
from .clearing import FREE_PATH_THRESHOLDS, REDUCED_SPEED, WARY_SPEED, RetreatMotion
from .dropped_objects import support_height_at
from .hold_check import release_held_object
from .homing import observe_with_fixed_cameras
from .release_poses import blocked, put_down_poses
from .straight_lines import DOWNWARDS

if TYPE_CHECKING:
    from ...world.values import Array, Pose, Vector3
    from ..control.trajectory_motion import Doing
    from ..world import World

SPOT_RING_RADII = (0.0, 0.05, 0.10, 0.16, 0.24)
"""Distances from the object at which spots are tried, m."""
SPOTS_PER_RING = 8
"""Spots on each ring."""
MAX_SPOT_ATTEMPTS = 4
"""Maximum number of free spots to which a path is planned."""
LEVEL_RADIUS = 0.05
"""Distance from the middle of a spot within which the fixture must be level, m."""
LEVEL_TOLERANCE = 0.001
"""Height by which a fixture may exceed the support and still count as level with it, m."""
HAND_SPOT_CLEARANCE = 0.01
"""Clearance of the hand at a spot, m."""
LOWERING_SPARE = 0.02
"""Travel of the lowering beyond the believed distance to the support, m."""


def put_down(world: World, leaving: RetreatMotion, scaling: Scaling, node: str) -> Doing[None]:
    """Lower the held object onto a free spot of a fixture near it, until contact, and release it.

    Fails with place.occupied where there is no such spot; the object is then still in the hand.
    """
    held = world.scene.held
    if held is None:
        return
    seen = yield from observe_with_fixed_cameras(world)
    why = "no spot near it is free"
    tries = 0
    for spot in _free_spots(world, held):
        if tries == MAX_SPOT_ATTEMPTS or leaving.late:
            break
        tries += 1
        assert held.object_in_tcp is not None
        over = tuple(
            pose.shifted((0.0, 0.0, world.handling.approach))
            for pose in put_down_poses(spot, held.shape, held.object_in_tcp)
            if _hand_has_room(world, held, pose, spot[2])
        )
        try:
            plan = yield from world.plan.to(PoseGoal(over), scaling=scaling, node=node)
            lowering = _lowering(world, held, spot[2], plan.trajectory.end)
            yield from world.plan.solve(lowering, node=node)
            wary = leaving.touched or not seen
            way = world.move.slowed(plan.trajectory, WARY_SPEED if wary else REDUCED_SPEED)
            result = yield from leaving.follow(way, FREE_PATH_THRESHOLDS)
        except Failure as failure:
            if not failure.cause.name.startswith("planning."):
                raise
            why = failure.message
            continue
        if not result.completed:
            yield from leaving.touched_on_the_way(result, f"to a spot for {held.id}")
            why = "something is in the way to it"
            continue
        yield from _lower(world, held, node)
        yield from leaving.up()
        return
    raise Failure(
        place.OCCUPIED,
        f"{held.id} cannot be put down: {why}; it is still in the hand",
        object=held.id,
        spots=tries,
    )


def _lowering(world: World, held: BeliefObject, height: float, start: Array) -> Request:
    """Return the request straight down from `start` (n,), rad, to a support at `height` m.

    The wrist does not feel contacts of the arm itself. So the whole arm must have room on the line before a
    guarded move follows it. Its end, where the object touches, is left out.
    """
    handling = world.handling
    down = OffsetGoal((0.0, 0.0, handling.felt_way - handling.approach))
    pairs = tuple((part, board) for board in _boards(world, height) for part in ("gripper", str(held.id)))
    return Request(down, start, allowed=pairs, scaling=handling.slowly)


def _lower(world: World, held: BeliefObject, node: str) -> Doing[None]:
    """Lower the object until contact, and release it."""
    handling = world.handling
    yield from world.move.guarded(
        DOWNWARDS,
        handling.approach + LOWERING_SPARE,
        force=handling.touch,
        speed=handling.touch_speed,
        node=node,
    )
    resting = world.scene.get(held.id).pose
    yield from release_held_object(world, held, resting, "table", "put down by a retreat")
    world.journal.note(PutDownEvent(f"{held.id} is put down", node, object=held.id))


def _free_spots(world: World, held: BeliefObject) -> Iterator[Vector3]:
    """Yield free points on fixtures for the object's underside, nearest first."""
    assert held.object_in_tcp is not None
    x, y, _ = held.pose.position
    for ring in SPOT_RING_RADII:
        for k in range(SPOTS_PER_RING if ring else 1):
            angle = 2 * math.pi * k / SPOTS_PER_RING
            at = (x + ring * math.cos(angle), y + ring * math.sin(angle))
            height = _level_height(world, at)
            if height is None:
                continue
            spot = (*at, height)
            poses = put_down_poses(spot, held.shape, held.object_in_tcp)
            if blocked(world.queries, held, poses[0]) is None and any(
                _hand_has_room(world, held, p, height) for p in poses
            ):
                yield spot


def _hand_has_room(world: World, held: BeliefObject, tcp_in_world: Pose, height: float) -> bool:
    """Return whether the hand has room there with the fingers opened for the release; `height` of the
    support, m."""
    opened = min(world.gripper.width + world.handling.release, world.robot.description.gripper.max_width)
    ignored = (str(held.id), *_boards(world, height))
    return not world.queries.hand_contacts(tcp_in_world, opened, ignored, margin=HAND_SPOT_CLEARANCE)


def _boards(world: World, height: float) -> tuple[str, ...]:
    """Return the names of the fixtures that are not higher than the support at `height` m."""
    fixtures = world.scene.fixtures.items()
    return tuple(str(name) for name, f in fixtures if top(f.shape, f.pose) <= height + LEVEL_TOLERANCE)


def _level_height(world: World, at: tuple[float, float]) -> float | None:
    """Return the height of the support below a point. None: it is not level around the point."""
    x, y = at
    around = [
        (0.0, 0.0),
        (LEVEL_RADIUS, 0.0),
        (-LEVEL_RADIUS, 0.0),
        (0.0, LEVEL_RADIUS),
        (0.0, -LEVEL_RADIUS),
    ]
    heights = [support_height_at(world.scene, x + dx, y + dy) for dx, dy in around]
    return heights[0] if len(set(heights)) == 1 else None
