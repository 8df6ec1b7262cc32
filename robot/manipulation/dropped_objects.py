"""Belief of objects after a release, an exchange of bins, or motion of a belt."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ...world.belief.facts import RODE_ON, TAKEN_AWAY
from ...world.belief.planning_scene import FALLEN_SIGMA, PlanningScene
from ...world.scene.description import Bin, Fixture
from ...world.shapes import Box, bottom, top
from ...world.skill_events import BinEmptiedEvent
from ...world.values import ObjectId, Pose
from .release_poses import heap_heights

if TYPE_CHECKING:
    from ..control.trajectory_motion import Doing
    from ..world import World


def apply_bin_exchanges(world: World, node: str) -> tuple[ObjectId, ...]:
    """Apply bin exchanges that the belief does not contain yet, and return the emptied bins.

    Objects believed in such a bin are removed with their attempts, and so is the observed heap. What a new
    tote holds, the next look shows.
    """
    bins = world.noticed.exchanged(world.feed.read())
    for bin_id in bins:
        there = [o for o in world.scene.objects if o.place == bin_id and not o.attached]
        for each in there:
            world.scene.remove(each.id, TAKEN_AWAY)
            world.attempts.forget(each.id)
        inside = [each.id for each in there if each.role != "heap"]
        world.vision.bins.pop(bin_id, None)
        world.vision.heaps.pop(str(bin_id), None)
        other = "another" if world.scene.bins[bin_id].is_tote else "an empty one"
        world.journal.note(
            BinEmptiedEvent(
                f"{bin_id} is exchanged for {other}; {_items_are(len(inside))} gone with it",
                node,
                bin=bin_id,
                objects=tuple(inside),
            )
        )
    return bins


def forget_belt_items(world: World) -> tuple[ObjectId, ...]:
    """Remove the items on belts, which may run from now on, with their attempts, and return their ids."""
    belts = [world.description.fixture(belt.id) for belt in world.description.belts]
    riding = [
        o.id
        for o in world.scene.objects
        if o.role == "item" and not o.attached and any(_is_over(belt, o.pose) for belt in belts)
    ]
    for object_id in riding:
        world.scene.remove(object_id, RODE_ON)
        world.attempts.forget(object_id)
    return tuple(riding)


def _is_over(belt: Fixture, pose: Pose) -> bool:
    assert isinstance(belt.shape, Box)
    length, width, _ = belt.shape.size
    along, across, up = (belt.pose.inverse() @ pose).position
    return abs(along) <= length / 2 and abs(across) <= width / 2 and up > 0.0


def bin_fill_level(world: World, bin_: Bin) -> float:
    """Return the fill level of a bin, 0 … 1: mean height of its heap over the height of its inside.

    Each cell counts up to the rim, by observation and belief.
    """
    seen = world.vision.bins.get(bin_.id)
    heights = heap_heights(bin_, world.scene.objects, None if seen is None else seen.cells)
    low, high = bin_.inside()
    depth = high[2] - low[2]
    return float(np.clip(heights, 0.0, depth).mean()) / depth


def _items_are(items: int) -> str:
    return "1 item is" if items == 1 else f"{items} items are"


PUT_BACK = "it is a part of the heap again"
"""Reason why a thing leaves the belief when it is put back into a heap."""
DROPPED_CONFIDENCE = 0.3
"""Confidence in the estimated pose until the object is seen again."""


def open_gripper(world: World, reason: str, width: float | None = None) -> Doing[None]:
    """Open the fingers, by default fully, and remove the held object from the hand in the belief.

    A halt does the same: the fingers go on opening.
    """
    try:
        yield from world.gripper.open(width)
    except GeneratorExit:
        release_object(world.scene, reason)
        raise
    release_object(world.scene, reason)


def release_object(scene: PlanningScene, reason: str, *, left_at: Pose | None = None) -> None:
    """Detach the held object, and believe it at `left_at` in the world.

    By default it is straight below the hand, on the highest fixture or bin floor there. Over a heap it
    becomes a part of that.
    """
    held = scene.held
    if held is None:
        return
    if left_at is not None:
        held = replace(held, pose=left_at)
    x, y, z = held.pose.position
    support, place = support_height_at(scene, x, y) or 0.0, "table"
    for bin_ in scene.bins.values():
        local = bin_.pose.inverse().apply(np.array([x, y, z]))
        if abs(float(local[0])) <= bin_.size[0] / 2 and abs(float(local[1])) <= bin_.size[1] / 2:
            support, place = bin_.pose.position[2] + bin_.wall, bin_.id
    fallen = held.pose.shifted((0.0, 0.0, support - bottom(held.shape, held.pose)))
    if any(region.covers(np.array([fallen.position]))[0] for region in scene.regions.values()):
        scene.remove(held.id, PUT_BACK)
        return
    scene.put(
        replace(
            held,
            object_in_tcp=None,
            pose=fallen,
            place=place,
            confidence=DROPPED_CONFIDENCE,
            sigma_position=FALLEN_SIGMA,
        ),
        reason,
    )


def support_height_at(scene: PlanningScene, x: float, y: float) -> float | None:
    """Return the height of the highest fixture's top at a point of the world, never below 0. None: no
    fixture."""
    highest: float | None = None
    for fixture in scene.fixtures.values():
        if isinstance(fixture.shape, Box):
            local = fixture.pose.inverse().apply(np.array([x, y, fixture.pose.position[2]]))
            size = fixture.shape.size
            if abs(float(local[0])) <= size[0] / 2 and abs(float(local[1])) <= size[1] / 2:
                highest = max(highest or 0.0, top(fixture.shape, fixture.pose))
    return highest
