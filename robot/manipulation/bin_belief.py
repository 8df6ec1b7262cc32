"""Belief of bins and belts: exchanges of bins, fill levels, and items that a running belt takes away."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from picktree.world import Box, ObjectId, Pose, event_types, world_facts
from picktree.world.scene import Bin, Fixture

from .release_poses import heap_heights

if TYPE_CHECKING:
    from picktree.robot import World


def apply_bin_exchanges(world: World, node: str) -> tuple[ObjectId, ...]:
    """Apply bin exchanges that the belief does not contain yet, and return the emptied bins.

    Objects believed in such a bin are removed with their attempts, and so is the observed heap. The next look
    shows the content of a new tote.
    """
    bins = world.noticed.exchanged(world.feed.read())
    for bin_id in bins:
        there = [o for o in world.scene.objects if o.place == bin_id and not o.attached]
        for each in there:
            world.scene.remove(each.id, world_facts.TAKEN_AWAY)
            world.attempts.forget(each.id)
        inside = [each.id for each in there if each.role != "heap"]
        world.vision.bins.pop(bin_id, None)
        world.vision.heaps.pop(str(bin_id), None)
        items = "1 item is" if len(inside) == 1 else f"{len(inside)} items are"
        other = "another" if world.scene.bins[bin_id].is_tote else "an empty one"
        world.journal.note(
            event_types.BinEmptiedEvent(
                f"{bin_id} is exchanged for {other}; {items} gone with it",
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
        world.scene.remove(object_id, world_facts.RODE_ON)
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
