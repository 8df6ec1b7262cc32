"""Grip force: required by mass and friction, and limited by the item."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from picktree.robot.control import (
    OPENING_FORCE,
)
from picktree.robot.planning import CARRYING_ACCELERATION
from picktree.world import GRAVITY
from picktree.world.robot_model import GripperDescription
from picktree.world.scene import MIN_DETECTABLE_MASS, CatalogueEntry

if TYPE_CHECKING:
    pass

GRIP_SAFETY_FACTOR = 2.0
"""Safety factor of the grip force: friction and mass of a kind are known roughly."""


LIGHT_GRIP_FORCE = 3.0
"""Least grip force for items that the wrist does not feel, N. A firm grip deforms what is soft or thin."""


MIN_GRIP_FORCE = 8.0
"""Least grip force for items that are not fragile, N."""


MIN_FRAGILE_SHARE = 0.4
"""Least grip force for a fragile item, as a share of its limit."""


FINGER_INERTIA_FORCE = 2.0
"""Force that the fingers' inertia may add on a fast transfer, N; measured up to 1.9."""


SINGLE_FINGER_FACTOR = 2.0
"""Force on a finger that touches alone, as a multiple of its share when both touch."""


IMPACT_FORCE_PER_SPEED = 55.0
"""Force of a finger's impact beyond its drive's, N for each m/s; measured up to 47."""


UNEVEN_FORCE_FACTOR = 1.15
"""Greatest force of a finger over its drive's while they close: one finger exceeds the other."""


TIGHTENING_FACTOR = 1.25
"""Greatest force of a finger over its drive's when that is increased at once; measured up to 1.22."""


FRAGILE_CLOSING_SHARE = 0.3
"""Closing force on a fragile item, as a share of its limit."""


MAX_DRAG_SHARE = 0.4
"""Force of one finger before the other touches, as a share of the item's friction on the table."""


MAX_DRAG_FRICTION = 2.5
"""Friction on the table up to which an item may be pushed along while the fingers close, N."""


SLIP_GRIP_FACTOR = 1.5
"""Factor of the grip force after a slip."""


@dataclass(frozen=True, slots=True)
class GripForce:
    """Forces of a finger, N, and its speed for one grasp."""

    closing: float
    """Force until both fingers touch, N."""
    grip: float
    """Force to lift and carry the object as believed, N."""
    most: float
    """Greatest force, N."""
    speed: float | None
    """Speed of each finger while it closes, m/s. None: full speed."""
    friction: float
    """Friction coefficient between item and pads."""

    def firmer(self) -> GripForce:
        """Return the grip force for an object that has slipped out of this one."""
        return replace(self, grip=min(self.grip * SLIP_GRIP_FACTOR**2, self.most))

    def carrying(self, mass: float) -> float:
        """Return the grip force for a weighed mass, kg; never less than before."""
        return min(max(self.grip, required_force(mass, self.friction)), self.most)


def opening_force(catalogue: Iterable[CatalogueEntry]) -> float:
    """Return the opening force in a scene of such items, N: neighbours must not be crushed."""
    limits = [entry.force_limit for entry in catalogue if entry.force_limit is not None]
    return min([OPENING_FORCE, *(FRAGILE_CLOSING_SHARE * limit for limit in limits)])


def required_force(mass: float, friction: float) -> float:
    """Return the force of each finger for a mass, kg, on a fast transfer, N."""
    if friction <= 0.0:
        return float("inf")
    return GRIP_SAFETY_FACTOR * mass * (GRAVITY + CARRYING_ACCELERATION) / (2.0 * friction)


def grip_force(entry: CatalogueEntry | None, bound: float, gripper: GripperDescription) -> GripForce:
    """Return the grip force for an item of that kind, with at most `bound` N on each finger."""
    bound = min(bound, gripper.max_force)
    if entry is None:
        force = min(30.0, bound)  # N: the catalogue does not contain it
        return GripForce(force, force, bound, None, 1.0)
    friction = entry.friction * gripper.pad_contact.friction
    least = MIN_GRIP_FORCE if entry.mass >= MIN_DETECTABLE_MASS else LIGHT_GRIP_FORCE
    wanted = max(required_force(entry.mass, friction), least)
    most, closing, speed = bound, bound, None
    limit = entry.force_limit
    if limit is not None:
        # On a sideways transfer the item leans on one finger, and so do the fingers.
        shaken = FINGER_INERTIA_FORCE + entry.mass * CARRYING_ACCELERATION / 2
        most = min(bound, max(limit - shaken, limit / 2) / TIGHTENING_FACTOR)
        wanted = max(required_force(entry.mass, friction), min(least, MIN_FRAGILE_SHARE * limit))
        closing = FRAGILE_CLOSING_SHARE * limit
        fastest = (limit / UNEVEN_FORCE_FACTOR - SINGLE_FINGER_FACTOR * closing) / IMPACT_FORCE_PER_SPEED
        speed = max(fastest, 0.005) if fastest < gripper.speed else None  # m/s
    grip = min(wanted, most)
    on_table = entry.friction * entry.mass * GRAVITY
    if on_table > MAX_DRAG_FRICTION:
        closing = min(closing, MAX_DRAG_SHARE * on_table)
    return GripForce(min(closing, grip), grip, most, speed, friction)
