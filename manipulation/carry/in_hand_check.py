"""Whether what should be in the hand is there, and what to do when it is not."""

from __future__ import annotations

from collections.abc import Generator
from typing import TYPE_CHECKING

from ...world.belief.planning_scene import BeliefObject
from ...world.causes import Failure, grasp
from ...world.values import ObjectId
from ..place.dropped_objects import let_go
from .hold_check import Hold

if TYPE_CHECKING:
    from ...cell.world import World


def felt_in_hand(world: World, object_id: ObjectId) -> Generator[None, None, tuple[BeliefObject, Hold]]:
    """The object that the hand holds, felt at rest. Raises Failure(grasp.slipped) when it holds another, or
    it is no longer there."""
    held = world.scene.held
    if held is None or held.id != object_id:
        raise Failure(
            grasp.SLIPPED,
            f"{object_id} is not in the hand",
            object=object_id,
            held=held.id if held else None,
        )
    yield from world.control.settle()
    hold = Hold(world.grip.width, world.control.load())
    if not hold.held:
        yield from lost(world, object_id, hold, "was lost on the way")
    return held, hold


def lost(world: World, object_id: ObjectId, hold: Hold, what: str) -> Generator[None, None, None]:
    """Believe that it is gone, open the fingers and fail with grasp.slipped."""
    let_go(world.scene, "no longer felt in the hand")
    world.control.wrist.carry(None)
    yield from world.grip.open()
    raise Failure(
        grasp.SLIPPED, f"{object_id} {what} ({hold})", object=object_id, width=hold.width, load=hold.load
    )
