"""Whether something is in the hand: the opening tells held from empty, the load on the wrist tells what."""

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


EMPTY_WIDTH = 0.002
"""Fingers that are closer than this hold nothing, m."""
LEAST_LOAD = 0.012 * GRAVITY
"""Weight of 12 g: the least load that counts as held, N."""
GONE = 0.5
"""Share of the load that must be gone after a release."""


@dataclass(frozen=True, slots=True)
class GripCheck:
    """What the hand feels: opening in m, load in N since the last tare."""

    width: float
    load: float | None

    @property
    def empty(self) -> bool:
        """The fingers met."""
        return self.width <= EMPTY_WIDTH

    @property
    def loaded(self) -> bool:
        """The wrist carries something; taken as true when the load was not measured."""
        return self.load is None or self.load >= LEAST_LOAD

    @property
    def held(self) -> bool:
        return not self.empty and self.loaded

    def __str__(self) -> str:
        """`opening 40.2 mm, load 1.18 N`, without a minus before a zero."""
        return f"opening {self.width * 1000:.1f} mm, load {round(self.load or 0.0, 2) + 0.0:.2f} N"


def is_released(before: float, after: float) -> bool:
    """Whether the load on the wrist, N, says that the fingers have let go."""
    return before - after >= GONE * before


def check_held_object(
    world: World, object_id: ObjectId
) -> Generator[None, None, tuple[BeliefObject, GripCheck]]:
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
    hold = GripCheck(world.grip.width, world.control.load())
    if not hold.held:
        yield from fail_as_slipped(world, object_id, hold, "was lost on the way")
    return held, hold


def fail_as_slipped(
    world: World, object_id: ObjectId, hold: GripCheck, what: str
) -> Generator[None, None, None]:
    """Believe that it is gone, open the fingers and fail with grasp.slipped."""
    release_object(world.scene, "no longer felt in the hand")
    world.control.wrist.carry(None)
    yield from world.grip.open()
    raise Failure(
        grasp.SLIPPED, f"{object_id} {what} ({hold})", object=object_id, width=hold.width, load=hold.load
    )
