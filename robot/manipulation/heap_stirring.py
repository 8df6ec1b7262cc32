"""Stirring: strokes through a heap, with a look after each, until things lie where the hand gets hold of
them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from ...world.belief.height_map import HeightMap, heap_id
from ...world.belief.planning_scene import BeliefObject
from ...world.causes import Failure, grasp, matches, planning, push
from ...world.planar_geometry import PlanarPose
from ...world.skill_events import PushEvent
from ...world.values import Array, ObjectId, Pose
from .heap_pick import RIM_CLEARANCE, HeapPickTask, look_into_tote, rim_height
from .heap_strokes import HeapStroke, heap_strokes
from .push_arcs import straight
from .push_stroke import (
    STEP_BACK_HEIGHT,
    configuration_above_start,
    follow_course,
    move_to_start,
    samples,
    step_back,
)
from .stroke_course import DRAG_STIFFNESS, DragMotion, PushMotion

if TYPE_CHECKING:
    from ..control.trajectory_motion import Doing
    from ..world import World

MAX_TESTED_STROKES = 16
"""Greatest number of strokes that are tested for reachability."""
MAX_TRIED_STARTS = 4
"""Greatest number of strokes whose start is tried."""
DRAG_FORCE = 10.0
"""Force with which the fingers press on a thing that they drag, N."""
CHANGED_HEIGHT, CHANGED_AREA = 0.005, 2e-4
"""Change of height, m, and area of it, m², from which on a heap counts as changed."""


def stir(world: World, task: HeapPickTask, strokes: int) -> Doing[None]:
    """Push through the heap of a tote until things lie elsewhere. The arm ends out of the view.

    Raises push.no_stroke when no stroke is free and reachable, push.stalled when the heap is as it was after
    `strokes` of them, and the failures of cameras and motions.
    """
    told: list[str] = []
    for _ in range(strokes):
        belief = yield from _look(world, task)
        before = world.vision.heaps[task.tote].map
        one, start = yield from _begin(world, task, belief.id)
        told.append(f"{one.name}: {yield from _execute(world, task, one, start)}")
        yield from world.control.settle()
        yield from world.vision.look(task.camera)
        if heap_changed(before, world.vision.heaps[task.tote].map):
            world.attempts.clear(task.node, belief.id)
            text = f"{task.tote} is stirred: {'; '.join(told)}"
            world.journal.note(PushEvent(text, task.node, object=task.tote, strokes=tuple(told)))
            return
    message = f"the heap in {task.tote} is as it was: {'; '.join(told)}"
    raise Failure(push.STALLED, message, object=task.tote, strokes=told)


def heap_changed(before: HeightMap, after: HeightMap) -> bool:
    """Return whether things lie elsewhere in a later map of the same place."""
    if before.shape != after.shape:
        return True
    change = np.abs(after.heights() - before.heights()) > CHANGED_HEIGHT
    inner = (change & ~before.beside_walls()).astype(np.uint8)
    # Edges of things flicker from look to look, by one or two cells.
    whole = cv2.morphologyEx(inner, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    return bool(np.count_nonzero(whole) * before.cell**2 > CHANGED_AREA)


def _look(world: World, task: HeapPickTask) -> Doing[BeliefObject]:
    """Look into the tote, and return its heap. Raises push.no_stroke when it is empty."""
    try:
        return (yield from look_into_tote(world, task))
    except Failure as failure:
        if failure.cause is not grasp.NO_CANDIDATE:
            raise
        raise Failure(push.NO_STROKE, failure.message, object=task.tote, empty=True) from None


def _begin(world: World, task: HeapPickTask, heap: ObjectId) -> Doing[tuple[HeapStroke, Pose]]:
    """Move to the start of the best stroke that the arm gets to; return it with the TCP pose there.

    Raises push.no_stroke, and the failures of motions.
    """
    refused: Failure | None = None
    for _ in range(MAX_TRIED_STARTS):
        one, over, flipped = _choose(world, task)
        world.attempts.failed(task.node, heap, one.name)
        opening = _opening(world, one)
        start = one.tcp_at(0.0, world.robot.fingers.reach(opening), flipped)
        try:
            yield from move_to_start(world, over, start, opening, task.node, (heap,))
        except Failure as failure:
            if not matches("planning.*", failure.cause) or failure.cause is planning.START_IN_COLLISION:
                raise
            refused = failure
        else:
            return one, start
    assert refused is not None
    raise refused


def _choose(world: World, task: HeapPickTask) -> tuple[HeapStroke, Array, bool]:
    """Return the best stroke that the arm can follow, with the configuration (n,) above its start, and
    whether the hand is flipped. Strokes that were made in vain come last. Raises push.no_stroke."""
    offered = heap_strokes(world.vision.heaps[task.tote].map, world.robot.description.gripper)
    fresh = world.attempts.remaining(task.node, heap_id(task.tote), offered)
    why: list[str] = []
    rim, heap = rim_height(world, task.tote) + RIM_CLEARANCE, (heap_id(task.tote),)
    for one in fresh[:MAX_TESTED_STROKES]:
        opening, rise = _opening(world, one), max(world.handling.approach, rim - one.tips)
        tip = world.robot.fingers.reach(opening)
        refusals: list[str] = []
        for flipped in (False, True):
            poses = [one.tcp_at(way, tip, flipped) for way in samples(0.0, one.length)]
            over = configuration_above_start(world, poses, opening, heap, rise=rise, beside=heap)
            if not isinstance(over, str):
                return one, over, flipped
            refusals.append(over)
        why.append(f"{one.name}: {refusals[0]}")
    told = "; ".join(why[:4]) or "the hand has no room beside anything"
    raise Failure(
        push.NO_STROKE,
        f"none of {len(offered)} strokes in {task.tote} is free and reachable: {told}",
        object=task.tote,
        refused=why,
    )


def _opening(world: World, one: HeapStroke) -> float:
    """Return the opening of the fingers during a stroke, m."""
    return world.robot.description.gripper.max_width if one.posture.open else 0.0


def _execute(world: World, task: HeapPickTask, one: HeapStroke, start: Pose) -> Doing[str]:
    """Make the stroke from its start, and move out of the view. Return what was felt, in words."""
    x, y, _ = start.position
    path = straight(PlanarPose(x, y, one.start.yaw), one.length)
    mass, names = world.robot.hand_mass, (heap_id(task.tote),)
    if one.drags:
        course = DragMotion(path, task.speed, task.force, DRAG_FORCE, mass)
        force = yield from follow_course(world, course, names, task.node, DRAG_STIFFNESS)
    else:
        course = PushMotion(path, PlanarPose(0.0, 0.0), 0.0, task.speed, task.force, mass, through=True)
        force = yield from follow_course(world, course, names, task.node)
    rise = max(STEP_BACK_HEIGHT, rim_height(world, task.tote) + RIM_CLEARANCE - one.tips)
    yield from step_back(world, names, task.node, rise)
    way = f"{course.reached * 1000:.0f} mm"
    if course.blocked:
        return f"blocked at {force:.1f} N after {way}"
    return f"moved on {way}" if course.touched_at is not None else f"nothing was felt on {way}"
