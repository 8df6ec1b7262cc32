"""Pick of any thing from a heap: the best grasp of its height map, and the belief about the held thing."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from picktree.robot.perception import put_heap
from picktree.robot.planning import NamedGoal, OffsetGoal
from picktree.world import (
    BeliefObject,
    ConvexMesh,
    Failure,
    ObjectId,
    Pose,
    event_types,
    grasp,
    heap_geometry,
    perception,
    top,
)
from picktree.world import world as world_causes

from .candidate_search import CandidateSearch
from .compliant_closing import close
from .grip_force import GripForce, grip_force
from .heap_grasps import colour_between, grasps
from .held_object import GripCheck, inflated_hull, measure_grip, mesh_of
from .pick_candidates import PickPlaceCandidate, count_rejections, describe_rejections
from .pick_place_motions import LIFT_GUARD_FORCE, lift
from .replanning import plan_after_stop
from .weighing import register_payload, update_payload_mass

if TYPE_CHECKING:
    from picktree.robot import World
    from picktree.robot.control import Doing

RIM_CLEARANCE = 0.03
"""Clearance of a lifted thing above the rim of its tote, m."""
HULL_MARGIN = 0.006
"""Inflation of a thing's hull, m: cells of 2 mm, and parts of it that others hide."""
MAX_STEP = 0.006
"""Step of height between cells from which on they belong to two things, m."""
MAX_THING = 0.06
"""Distance from the grasp up to which cells may belong to the thing, m."""
RETRY_CAUSES = (grasp.MISSED, grasp.SLIPPED, world_causes.DISTURBED)
"""Failures of one grasp after which another one is tried."""


@dataclass(frozen=True, slots=True)
class HeapPickTask:
    """Pick of any thing of a tote, for the node that runs it."""

    tote: ObjectId
    node: str
    camera: str
    force: float
    """Greatest grip force of each finger, N."""
    speed: float
    """Share of the joints' speed limits, 0 … 1."""


def look_into_tote(world: World, task: HeapPickTask) -> Doing[BeliefObject]:
    """Look at the tote, and return its heap. Raises grasp.no_candidate when it is empty, and
    perception.not_found when the camera does not show it."""
    with world.step(task.node, "look"):
        yield from world.control.settle()
        before = world.vision.heaps.get(task.tote)
        yield from world.vision.observe(task.camera)
    if world.vision.heaps.get(task.tote) is before:
        raise Failure(perception.NOT_FOUND, f"{task.camera} does not show {task.tote}", object=task.tote)
    found = world.scene.find(heap_geometry.heap_id(task.tote))
    if found is None:
        raise Failure(grasp.NO_CANDIDATE, f"{task.tote} is empty", object=task.tote, empty=True)
    return found


def thing_in_hand(world: World) -> Doing[ObjectId | None]:
    """Return the thing that the hand holds already. None: it is empty, and open."""
    held = world.scene.held
    if held is None:
        return None
    hold = yield from measure_grip(world)
    if hold.held:
        return held.id
    yield from _let_go(world)
    return None


def pick_any(world: World, task: HeapPickTask, attempts: int) -> Doing[ObjectId]:
    """Pick some thing of the tote, and return its id. The arm ends above the rim with the thing in the hand.

    A place where a grasp has failed is barred until the depth there changes. Raises grasp.no_candidate, the
    failure of the last of `attempts` grasps, and the failures of motions.
    """
    for left in reversed(range(attempts)):
        belief = yield from look_into_tote(world, task)
        heap = world.vision.heaps[task.tote]
        candidate = yield from _find(world, task, belief)
        try:
            return (yield from _pick(world, task, belief, candidate))
        except Failure as failure:
            yield from _let_go(world)
            # The thing is still there, and so are its heights where the arm hides them from the camera.
            _store(world, task.tote, _barring(world, heap, candidate), "the grasp has failed")
            if left == 0 or failure.cause not in RETRY_CAUSES:
                raise
            yield from _clear_view(world, task)
    raise AssertionError("at least one attempt")


def _find(world: World, task: HeapPickTask, belief: BeliefObject) -> Doing[PickPlaceCandidate]:
    """Return the best grasp that the arm reaches, from the surest stage that has one, with its approach."""
    heap = world.vision.heaps[task.tote]
    trails, ranked = list[str](), 0
    for offered in grasps(heap, world.robot.description.gripper):
        ranked += len(offered)
        if not offered:
            continue
        search = CandidateSearch(world, belief, offered, task.node)
        with world.step(task.node, "choose"):
            found = yield from plan_after_stop(world, lambda s=search: s.find(speed=task.speed), task.node)
        if found is not None:
            return found
        trail = search.trail.entry()
        trails.append(describe_rejections(count_rejections(trail.tried, trail.into)))
    barred = f", {len(heap.barred)} places failed before and look the same" if heap.barred else ""
    why = "; ".join(trails) or "nothing is high and free enough for the fingers"
    raise Failure(
        grasp.NO_CANDIDATE,
        f"none of {ranked} grasps in {task.tote} is free and reachable: {why}{barred}",
        object=task.tote,
        candidates=ranked,
        barred=len(heap.barred),
    )


def _pick(
    world: World, task: HeapPickTask, belief: BeliefObject, candidate: PickPlaceCandidate
) -> Doing[ObjectId]:
    """Grasp, lift and weigh. Raises grasp.missed or grasp.slipped when nothing is held after the lift."""
    press = grip_force(None, task.force, world.robot.description.gripper)
    with world.step(task.node, "approach"):
        yield from world.control.settle()
        world.control.zero()
        world.gripper.start(candidate.grasp.opening)
        trajectory = candidate.approach.trajectory
        yield from world.move.along(
            trajectory, guard=world.handling.guard, watch=world.gripper.overdue_failure, node=task.node
        )
    with world.step(task.node, "close"):
        closed = yield from close(world, press, task.node)
    thing = _believe_thing(world, task, closed.width, press)
    hold = GripCheck(closed.width, None)
    try:
        with world.step(task.node, "lift"):
            yield from _lift_out(world, task, thing)
        with world.step(task.node, "weigh"):
            hold = yield from measure_grip(world)
    finally:
        _note(world, task, thing, candidate, hold)
    if hold.held and hold.load is not None:
        update_payload_mass(world, hold, press)
        return thing.id
    cause = grasp.MISSED if hold.empty else grasp.SLIPPED
    raise Failure(
        cause,
        f"{task.tote}: nothing is held after the lift ({hold})",
        object=task.tote,
        candidate=candidate.grasp.name,
        width=hold.width,
        load=hold.load,
    )


def _believe_thing(world: World, task: HeapPickTask, width: float, press: GripForce) -> BeliefObject:
    """Put the thing between the fingers into the belief, attached, and take it out of the heap's map."""
    heap = world.vision.heaps[task.tote]
    cells, tip = _cells_between(world, heap.map, width)
    shape, pose = _hull(heap.map, cells, tip)
    tcp = heap.map.frame.inverse() @ world.control.tcp
    colour = colour_between(heap.map, tcp, world.robot.description.gripper.tip, width)
    thing = BeliefObject(
        "unknown",
        "mesh",
        shape,
        colour,
        pose,
        0.01,
        0.3,
        0.5,
        world.clock.now,
        id=world.scene.new_id("thing"),
        place=task.tote,
        seen_size=_seen_size(heap.map, cells),
        tag=_tag_on(heap.map, cells),
    )
    heights = np.where(cells, np.minimum(heap.map.heights(), max(tip, heap.map.floor)), heap.map.heights())
    lowered = replace(heap, map=heap.map.with_heights(heights))
    _store(world, task.tote, lowered, "a thing was taken")
    world.scene.put(thing, "taken out of a heap")
    object_in_tcp = world.control.tcp.inverse() @ pose
    register_payload(world, press, None, object_in_tcp)
    world.scene.attach(thing.id, object_in_tcp)
    return world.scene.get(thing.id)


def _store(world: World, tote: ObjectId, heap: heap_geometry.Heap, reason: str) -> None:
    """Replace the belief about a tote's heap."""
    world.vision.heaps[str(tote)] = heap
    put_heap(world.scene, world.scene.regions[tote], heap.map, world.clock.now, reason)


def _cells_between(
    world: World, heap: heap_geometry.HeightMap, width: float
) -> tuple[NDArray[np.bool_], float]:
    """Return the cells (n, m) of the thing between the fingers, and the height of their tips, in the map's
    frame. Cells that hang together without a step belong to it."""
    tcp = world.control.tcp
    inverse = heap.frame.inverse()
    tip = inverse.apply(tcp.apply(np.array([0.0, 0.0, world.robot.description.gripper.tip])))
    heights = np.nan_to_num(heap.heights(), nan=-1.0)
    n, m = heap.shape
    i, j = np.meshgrid(np.arange(n), np.arange(m), indexing="ij")
    away = np.hypot((i + 0.5) * heap.cell - tip[0], (j + 0.5) * heap.cell - tip[1])
    high = (heights > tip[2]) & ~heap.beside_walls() & (away < MAX_THING)
    rough = np.ptp(np.stack([np.roll(heights, by, axis=(0, 1)) for by in ((0, 0), (1, 0), (0, 1))]), axis=0)
    joined = (high & (rough < MAX_STEP)).astype(np.uint8)
    parts = np.asarray(cv2.connectedComponents(joined, connectivity=4)[1], dtype=np.intp)
    near = parts[high & (away < max(width / 2, 0.006))]
    own = [part for part in np.unique(near) if part > 0]
    found = high & (np.isin(parts, own) | (away < 0.008))
    if not found.any():
        found = away < 0.008
    return found, float(tip[2])


def _hull(heap: heap_geometry.HeightMap, cells: NDArray[np.bool_], tip: float) -> tuple[ConvexMesh, Pose]:
    """Return the hull of the seen surface, inflated, and its pose in the world.

    It reaches down to the tote's floor: the part below the finger tips is hidden, and may belong to the
    thing.
    """
    i, j = np.nonzero(cells)
    heights = np.nan_to_num(heap.heights()[i, j], nan=tip)
    x, y = (i + 0.5) * heap.cell, (j + 0.5) * heap.cell
    above = np.column_stack([x, y, np.maximum(heights, tip + 0.004)]).astype(np.float64)
    points = np.concatenate([above, np.column_stack([x, y, np.full(len(x), min(tip, heap.floor))])])
    return mesh_of(heap.frame.apply(inflated_hull(points, HULL_MARGIN)))


def _tag_on(heap: heap_geometry.HeightMap, cells: NDArray[np.bool_]) -> int | None:
    """Return the number of the tag on a thing's cells (n, m). None: none was read, or different ones."""
    found: set[int] = set()
    for tag in heap.tags:
        i, j = (int(at / heap.cell) for at in tag.at)
        if 0 <= i < heap.shape[0] and 0 <= j < heap.shape[1] and cells[i, j]:
            found.add(tag.number)
    return found.pop() if len(found) == 1 else None


def _seen_size(heap: heap_geometry.HeightMap, cells: NDArray[np.bool_]) -> float:
    """Return the greatest distance of two seen points of a thing, m."""
    i, j = np.nonzero(cells & np.isfinite(heap.heights()))
    points = np.column_stack([i * heap.cell, j * heap.cell, heap.heights()[i, j]])
    points = points[:: 1 + len(points) // 500]
    return heap.cell + float(np.linalg.norm(points[:, None] - points[None], axis=2).max(initial=0.0))


def _lift_out(world: World, task: HeapPickTask, thing: BeliefObject) -> Doing[None]:
    """Lift the thing straight up until it is above the rim."""
    bottom = thing.pose.position[2] - (top(thing.shape, thing.pose) - thing.pose.position[2])
    rise = rim_height(world, task.tote) + RIM_CLEARANCE - bottom
    names = (task.tote, heap_geometry.heap_id(task.tote))
    with world.scene.allow(*((side, name) for side in ("gripper", thing.id) for name in names)):
        yield from lift(world, thing.id, task.node, max(rise, world.handling.approach))


def _let_go(world: World) -> Doing[None]:
    """Open the hand after a failed grasp. The resting place of a thing in it is unknown."""
    held = world.scene.held
    if held is not None:
        world.scene.remove(held.id, "the grasp has failed")
        world.control.wrist.carry(None)
    yield from world.gripper.open()


def _clear_view(world: World, task: HeapPickTask) -> Doing[None]:
    """Move the empty hand straight up above the rim, as far as that is free, and home: the camera sees the
    tote."""
    tips = world.control.tcp.position[2] - world.robot.description.gripper.tip
    rise = rim_height(world, task.tote) + RIM_CLEARANCE - tips
    guard = world.handling.guard + LIFT_GUARD_FORCE
    yield from world.move.rest()
    if rise > 0.0:
        up = OffsetGoal((0.0, 0.0, rise), least_fraction=0.1)
        with world.scene.allow(("gripper", task.tote), ("gripper", heap_geometry.heap_id(task.tote))):
            line = yield from world.plan.line(up, scaling=world.handling.slowly, node=task.node)
            yield from world.move.along(line.trajectory, guard=guard, node=task.node)
    scaling = world.handling.scaling(task.speed)
    plan = yield from world.plan.to(NamedGoal("home"), scaling=scaling, node=task.node)
    yield from world.move.along(plan.trajectory, guard=guard, node=task.node)


def rim_height(world: World, tote: ObjectId) -> float:
    """Return the height of the rim in the world, m; of a pile without walls that of its highest point."""
    heap = world.vision.heaps[tote].map
    top = heap.rim if heap.walls().any() else float(np.nanmax(heap.heights(), initial=heap.floor))
    return heap.frame.position[2] + top


def _barring(world: World, heap: heap_geometry.Heap, candidate: PickPlaceCandidate) -> heap_geometry.Heap:
    """Return the heap with the place of a failed grasp barred, until the depth there changes."""
    tip = world.robot.description.gripper.tip
    point = candidate.grasp.tcp_in_world.apply(np.array([0.0, 0.0, tip]))
    x, y, _ = heap.map.frame.inverse().apply(point)
    return replace(heap, barred=(*heap.barred, heap_geometry.BarredPlace.of(heap.map, float(x), float(y))))


def _note(
    world: World, task: HeapPickTask, thing: BeliefObject, candidate: PickPlaceCandidate, hold: GripCheck
) -> None:
    held = hold.load is not None and hold.held
    world.journal.note(
        event_types.PickEvent(
            f"{thing.id} from {task.tote}: {'held' if held else 'not held'}",
            task.node,
            object=thing.id,
            form=thing.form,
            candidate=candidate.grasp.name,
            held=held,
            width=hold.width,
            load=hold.load,
            force=world.gripper.force,
        )
    )
