"""Presentation of a held thing: poses before a camera, looks from both sides of the hand, and their evidence
about the thing."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from picktree.robot.perception import HeldView, segmentation
from picktree.robot.planning import MotionPlan, PoseGoal
from picktree.world import (
    Array,
    BeliefObject,
    Failure,
    ObjectId,
    Pose,
    convex_hull,
    event_types,
    grasp,
    perception,
)
from picktree.world.scene import destinations

from .held_object import check_held_object, inflated_hull, mesh_of
from .object_placement import PLACE_DEPENDENT_CAUSES
from .weighing import GripMonitor, payload_force

if TYPE_CHECKING:
    from picktree.robot import World
    from picktree.robot.control import Doing
    from picktree.world.scene import CameraDescription

MIN_SEEN_AREA = 5e-5
"""Area from which on a thing counts as seen, m²."""

AZIMUTHS = 12
"""Number of directions of the tool across the line of sight."""
TILTS = tuple(math.radians(angle) for angle in (45.0, 20.0, 0.0, -20.0))
"""Angles by which the finger tips point towards the camera, rad, the best first: the side that lay below was
not seen in the heap."""
DISTANCE_STEPS = (1.2, 1.6)
"""Distances from the camera, as multiples of the one at which the thing just fits into the picture."""
HIDDEN_MARGIN = 0.03
"""Distance by which a thing may extend beyond its seen part, m."""
LEAST_DISTANCE = 0.25
"""Least distance of a thing from the camera, m: the hand and the arm have to fit, too."""
HULL_MARGIN, HULL_GRID = 0.004, 0.002
"""Inflation of a seen hull, and grid of its points, m."""
MIN_COLOUR_AREA, MIN_COLOUR_SHARE = 1e-4, 0.12
"""Area, m², and share of the coloured surface from which on a colour is that of a thing."""


@dataclass(frozen=True, slots=True)
class PresentTask:
    """Presentation of one held thing, for the node that runs it."""

    object: ObjectId
    node: str
    camera: str
    looks: int
    """Greatest number of looks: one at each side of the hand."""
    until_classified: bool
    """Whether it ends as soon as all traits in the rules of the scene's destinations are known."""
    speed: float
    """Share of the joints' speed limits, 0 … 1."""


@dataclass(frozen=True, slots=True, eq=False)
class SeenThing:
    """Thing in the hand, by all looks at it."""

    points: Array
    """Points (n, 3) in the TCP frame, m."""
    colours: tuple[str, ...]
    """Colours with a surface of their own, the largest first."""
    tags: tuple[int, ...]
    size: float
    """Greatest distance of two points, m."""

    @classmethod
    def of(cls, views: Sequence[HeldView]) -> SeenThing:
        """Merge the looks; each has seen something."""
        points = np.concatenate([view.points for view in views])
        points = np.unique(np.round(points / HULL_GRID), axis=0) * HULL_GRID
        areas = sum(
            np.bincount(view.labels, view.areas, minlength=len(segmentation.LABEL_NAMES)) for view in views
        )
        areas = np.asarray(areas)[1:]
        enough = (areas > MIN_COLOUR_AREA) & (areas > MIN_COLOUR_SHARE * areas.sum())
        order = [int(k) for k in np.argsort(-areas, kind="stable") if enough[k]]
        hull = points[convex_hull(points).vertices]
        return cls(
            points,
            tuple(segmentation.LABEL_NAMES[k + 1] for k in order),
            tuple(sorted({number for view in views for number in view.tags})),
            float(np.linalg.norm(hull[:, None] - hull[None], axis=2).max()),
        )

    @property
    def double(self) -> str:
        """Sign of more than one thing, in words; empty without one."""
        if len(self.tags) > 1:
            return f"tags {', '.join(map(str, self.tags))}"
        if len(self.colours) > 1:
            return f"{' and '.join(self.colours)} surfaces"
        return ""


def present(world: World, task: PresentTask) -> Doing[None]:
    """Hold the thing before the camera, look at it, and refine its belief. The arm ends before the camera.

    Raises grasp.double for more than one thing in the hand, grasp.slipped for a lost thing,
    perception.not_found when no look shows it. It also raises the failures of cameras, planner and motions.
    """
    held, _ = yield from check_held_object(world, task.object)
    if _is_done(world, task):
        return
    camera = _camera(world, task)
    views, side, centre = list[HeldView](), 0, np.zeros(3)
    for look in range(task.looks):
        try:
            yield from _move_before(world, task, camera, side, centre)
        except Failure as failure:
            # It may have been seen from one side already.
            if failure.cause not in PLACE_DEPENDENT_CAUSES or look == 0:
                raise
            break
        side = -_side(world, camera)
        yield from world.control.settle()
        view = yield from world.vision.inspect(task.camera)
        if float(view.areas.sum()) < MIN_SEEN_AREA:
            continue
        views.append(view)
        seen = SeenThing.of(views)
        centre = (seen.points.min(axis=0) + seen.points.max(axis=0)) / 2
        _refine(world, task, seen, whole=len(views) == 2)
        if _is_done(world, task):
            return
    if not views:
        yield from check_held_object(world, task.object)
        message = f"{task.camera} shows nothing in the hand"
        raise Failure(perception.NOT_FOUND, message, object=held.id, looks=task.looks)


def _is_done(world: World, task: PresentTask) -> bool:
    """Return whether all traits in the rules of the destinations are known, and no other look is
    requested."""
    thing, rules = world.scene.get(task.object), world.description.destinations
    return task.until_classified and not destinations.unknown_traits(rules, thing)


def _camera(world: World, task: PresentTask) -> CameraDescription:
    """Return the camera. Raises perception.not_found for one that is not there, or moves with the hand."""
    fixed = {camera.name: camera for camera in world.description.cameras if camera.on == "world"}
    if task.camera not in fixed:
        raise Failure(
            perception.NOT_FOUND,
            f"there is no fixed camera {task.camera!r} to hold {task.object} before",
            object=task.object,
            known=list(fixed),
        )
    return fixed[task.camera]


def presenting_poses(camera: Pose, distance: float, tilt: float, centre: Array, side: int) -> Iterator[Pose]:
    """Yield TCP poses in the world that show the thing at `centre` (3,) in the TCP frame to a camera.

    The thing lies on the line of sight, `distance` m before the camera. The fingers are beside it, so that
    they do not hide it. `side`: 1 and -1 for the sides of the hand, 0 for both.
    """
    right, _, ahead = camera.rotation().T
    up = np.cross(ahead, right)
    at = np.array(camera.position) + distance * ahead
    for k in range(AZIMUTHS):
        angle = 2 * math.pi * k / AZIMUTHS
        across = math.cos(angle) * right + math.sin(angle) * up
        tool = math.cos(tilt) * across - math.sin(tilt) * ahead
        for one in (1, -1) if side == 0 else (side,):
            closing = one * np.cross(ahead, across)
            rotation = np.column_stack([np.cross(closing, tool), closing, tool])
            yield Pose.from_rotation(at - rotation @ centre, rotation)


def _side(world: World, camera: CameraDescription) -> int:
    """Return the side of the hand that faces the camera, as `presenting_poses` counts them."""
    towards = -camera.pose.rotation()[:, 2]
    return 1 if float(world.control.tcp.rotation()[:, 0] @ towards) > 0 else -1


def _move_before(
    world: World, task: PresentTask, camera: CameraDescription, side: int, centre: Array
) -> Doing[None]:
    """Move the arm to a pose before the camera that shows `centre` (3,) in the TCP frame.

    The arm stops when the fingers move, and continues when the thing is still held; else the skill fails with
    grasp.slipped.
    """
    for last in (False, False, True):
        plan = yield from _plan_before(world, task, camera, side, centre)
        guard, watch = world.handling.guard + payload_force(world), GripMonitor(world).watch
        try:
            yield from world.move.along(plan.trajectory, guard=guard, watch=watch, node=task.node)
            return
        except Failure as failure:
            if failure.cause is not grasp.SLIPPED:
                raise
            yield from check_held_object(world, task.object)
            if last:
                raise


def _plan_before(
    world: World, task: PresentTask, camera: CameraDescription, side: int, centre: Array
) -> Doing[MotionPlan]:
    """Plan to a pose before the camera, the best tilt first."""
    intrinsics, held = camera.intrinsics, world.scene.get(task.object)
    half = math.atan(min(intrinsics.width / intrinsics.fx, intrinsics.height / intrinsics.fy) / 2)
    fits = (held.size / 2 + HIDDEN_MARGIN) / math.sin(half)
    refused: Failure | None = None
    distances = [max(step * fits, LEAST_DISTANCE) for step in DISTANCE_STEPS]
    for tilt in TILTS:
        goal = PoseGoal(
            tuple(
                pose
                for distance in distances
                for pose in presenting_poses(camera.pose, distance, tilt, centre, side)
            )
        )
        scaling = world.handling.scaling(task.speed, world.scene.held)
        try:
            return (yield from world.plan.to(goal, scaling=scaling, node=task.node))
        except Failure as failure:
            if failure.cause not in PLACE_DEPENDENT_CAUSES:
                raise
            refused = failure
    assert refused is not None
    raise refused


def _refine(world: World, task: PresentTask, seen: SeenThing, *, whole: bool) -> None:
    """Update the belief with the result of the looks. `whole`: whether both sides were seen, so that the hull
    is known.

    Raises grasp.double.
    """
    held = world.scene.get(task.object)
    if held.kind == "unknown":
        tags = {"tag": seen.tags[0]} if len(seen.tags) == 1 else {}
        colours = {"colour": seen.colours[0]} if seen.colours else {}
        size = seen.size if whole else max(seen.size, held.size)
        refined = replace(held, **tags, **colours, seen_size=size, last_seen=world.clock.now)
        if whole:
            refined = _with_hull(world, refined, seen.points)
        world.scene.put(refined, "looked at in the hand")
    world.journal.note(
        event_types.PresentEvent(
            f"{held.id} is looked at in the hand: {', '.join(seen.colours) or 'no colour'}, "
            f"{seen.size * 1000:.0f} mm" + "".join(f", tag {number}" for number in seen.tags),
            task.node,
            object=held.id,
            whole=whole,
            colours=seen.colours,
            tags=tuple(map(str, seen.tags)),
            size=seen.size,
            mass=held.mass,
        )
    )
    if seen.double:
        raise Failure(
            grasp.DOUBLE,
            f"more than one thing is in the hand with {held.id}: {seen.double}",
            object=held.id,
            colours=list(seen.colours),
            tags=list(map(str, seen.tags)),
            size=seen.size,
        )


def _with_hull(world: World, held: BeliefObject, points: Array) -> BeliefObject:
    """Return the thing with the hull of its seen points (n, 3) in the TCP frame and of the finger tips'
    opening, inflated."""
    half = world.gripper.width / 2
    points = np.concatenate([points, [[0.0, half, 0.0], [0.0, -half, 0.0]]])
    points = points[convex_hull(points).vertices]
    shape, in_tcp = mesh_of(inflated_hull(points, HULL_MARGIN))
    return replace(held, shape=shape, object_in_tcp=in_tcp, pose=world.control.tcp @ in_tcp)
