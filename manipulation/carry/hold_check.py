"""Grip check: the opening tells a held object from an empty hand, the load on the wrist confirms it."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ...world.belief.planning_scene import BeliefObject
from ...world.causes import Failure, grasp
from ...world.values import GRAVITY, ObjectId
from ..place.dropped_objects import release_object

if TYPE_CHECKING:
    from ...cell.world import World


MAX_EMPTY_WIDTH = 0.002
"""Opening up to which the fingers hold nothing, m."""
MIN_HELD_LOAD = 0.012 * GRAVITY
"""Least load that counts as held, N: the weight of 12 g."""
MIN_RELEASED_SHARE = 0.5
"""Share of the load that must be gone after a release."""


@dataclass(frozen=True, slots=True)
class GripCheck:
    """Measurement of the hand: opening, m, and load since the last tare, N. None: load not measured."""

    width: float
    load: float | None

    @property
    def empty(self) -> bool:
        """Whether the fingers have met."""
        return self.width <= MAX_EMPTY_WIDTH

    @property
    def loaded(self) -> bool:
        """Whether the wrist carries something; True when the load was not measured."""
        return self.load is None or self.load >= MIN_HELD_LOAD

    @property
    def held(self) -> bool:
        return not self.empty and self.loaded

    def __str__(self) -> str:
        """Return `opening 40.2 mm, load 1.18 N`, without a minus before a zero."""
        return f"opening {self.width * 1000:.1f} mm, load {round(self.load or 0.0, 2) + 0.0:.2f} N"


def is_released(before: float, after: float) -> bool:
    """Return whether the change of the load on the wrist, N, shows a release."""
    return before - after >= MIN_RELEASED_SHARE * before


def check_held_object(
    world: World, object_id: ObjectId
) -> Generator[None, None, tuple[BeliefObject, GripCheck]]:
    """Measure the grip at rest, and return the held object with it.

    Raises Failure(grasp.slipped) when the hand holds another object, or none.
    """
    held = world.scene.held
    if held is None or held.id != object_id:
        raise Failure(
            grasp.SLIPPED,
            f"{object_id} is not in the hand",
            object=object_id,
            held=held.id if held else None,
        )
    yield from world.control.settle()
    hold = GripCheck(world.gripper.width, world.control.load())
    if not hold.held:
        yield from fail_as_slipped(world, object_id, hold, "was lost on the way")
    return held, hold


def fail_as_slipped(
    world: World, object_id: ObjectId, hold: GripCheck, what: str
) -> Generator[None, None, None]:
    """Remove the object from the hand in the belief, open the fingers and raise Failure(grasp.slipped)."""
    release_object(world.scene, "no longer felt in the hand")
    world.control.wrist.carry(None)
    yield from world.gripper.open()
    raise Failure(
        grasp.SLIPPED, f"{object_id} {what} ({hold})", object=object_id, width=hold.width, load=hold.load
    )
