"""What the belief makes of the feed's lines: a bin that was exchanged is empty."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...world.belief.facts import RODE_ON, TAKEN_AWAY
from ...world.journal import Happened
from ...world.scene.description import Bin, Fixture
from ...world.shapes import Box
from ...world.values import ObjectId, Pose
from .bin_spots import heap

if TYPE_CHECKING:
    from ...cell.world import World


def notice_exchanges(world: World, node: str) -> tuple[ObjectId, ...]:
    """Let the belief follow exchanges that it does not know of yet; the bins that are empty now.

    What was believed in such a bin goes, with what was tried on it, and so does the heap that was seen.
    """
    bins = world.noticed.exchanged(world.feed.read())
    for bin_id in bins:
        inside = [o.id for o in world.scene.objects if o.place == bin_id and not o.attached]
        for object_id in inside:
            world.scene.remove(object_id, TAKEN_AWAY)
            world.attempts.forget(object_id)
        world.eyes.bins.pop(bin_id, None)
        world.journal.note(
            Happened(
                "bin_emptied",
                f"{bin_id} is exchanged for an empty one; {_counted(len(inside))} gone with it",
                node,
                {"bin": bin_id, "objects": [str(object_id) for object_id in inside]},
            )
        )
    return bins


def let_ride(world: World) -> tuple[ObjectId, ...]:
    """Forget where items lie on belts, which may run from now on, and what was tried on them there; who."""
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


def fill_of(world: World, bin_: Bin) -> float:
    """How full a bin is, from what was seen and what is believed to lie in it: the mean height of its heap
    over the height of its inside, each cell counting up to the rim. 0 … 1"""
    seen = world.eyes.bins.get(bin_.id)
    heights = heap(bin_, world.scene.objects, None if seen is None else seen.cells)
    low, high = bin_.inside()
    depth = high[2] - low[2]
    return float(np.clip(heights, 0.0, depth).mean()) / depth


def _counted(items: int) -> str:
    return "1 item is" if items == 1 else f"{items} items are"
