"""Grip force: enough for weight, friction and acceleration, and within the limit of a fragile item.

Two fingers hold at most a weight of 2 μ F (Coulomb). The fingers are coupled: one that touches alone exerts
the drive force of both, and the momentum of both at the impact. A fragile item has to survive that, too.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from ...control.execution.gripper_motion import OPENING_FORCE
from ...robots.description import GripperDescription
from ...world.scene.description import CatalogueEntry
from ...world.values import GRAVITY

MAX_TRANSFER_ACCELERATION = 9.0
"""Greatest measured acceleration of the hand on fast transfers, m/s²."""
GRIP_SAFETY_FACTOR = 2.0
"""Safety factor of the grip force: friction and mass of a kind are known roughly."""
MIN_GRIP_FORCE = 8.0
"""Least grip force for items that are not fragile, N."""
MIN_FRAGILE_SHARE = 0.4
"""Least grip force for a fragile item, as a share of its limit."""
FINGER_INERTIA_FORCE = 2.0
"""Force that the fingers' inertia may add on a fast transfer, N; measured up to 1.9."""
UNKNOWN_GRIP_FORCE = 30.0
"""Grip force for objects that the catalogue does not contain, N."""
SINGLE_FINGER_FACTOR = 2.0
"""Force on a finger that touches alone, as a multiple of its share when both touch."""
IMPACT_FORCE_PER_SPEED = 55.0
"""Force of a finger's impact beyond its drive's, N for each m/s; measured up to 47."""
UNEVEN_FORCE_FACTOR = 1.15
"""Greatest force of a finger over its drive's: one finger exceeds the other, and the force overshoots when it
is increased."""
FRAGILE_CLOSING_SHARE = 0.3
"""Closing force on a fragile item, as a share of its limit."""
MAX_DRAG_SHARE = 0.4
"""Force of one finger before the other touches, as a share of the item's friction on the table."""
MAX_DRAG_FRICTION = 2.5
"""Friction on the table up to which an item may be pushed along while the fingers close, N."""
MIN_CLOSING_SPEED = 0.005
"""Least closing speed of a finger, m/s."""
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
    return GRIP_SAFETY_FACTOR * mass * (GRAVITY + MAX_TRANSFER_ACCELERATION) / (2.0 * friction)


def grip_force(entry: CatalogueEntry | None, bound: float, gripper: GripperDescription) -> GripForce:
    """Return the grip force for an item of that kind, with at most `bound` N on each finger."""
    bound = min(bound, gripper.max_force)
    if entry is None:
        force = min(UNKNOWN_GRIP_FORCE, bound)
        return GripForce(force, force, bound, None, 1.0)
    friction = entry.friction * gripper.pad_contact.friction
    wanted = max(required_force(entry.mass, friction), MIN_GRIP_FORCE)
    most, closing, speed = bound, bound, None
    limit = entry.force_limit
    if limit is not None:
        # On a sideways transfer the item leans on one finger, and so do the fingers.
        shaken = FINGER_INERTIA_FORCE + entry.mass * MAX_TRANSFER_ACCELERATION / 2
        most = min(bound, max(limit - shaken, limit / 2) / UNEVEN_FORCE_FACTOR)
        wanted = max(required_force(entry.mass, friction), min(MIN_GRIP_FORCE, MIN_FRAGILE_SHARE * limit))
        closing = FRAGILE_CLOSING_SHARE * limit
        fastest = (limit / UNEVEN_FORCE_FACTOR - SINGLE_FINGER_FACTOR * closing) / IMPACT_FORCE_PER_SPEED
        speed = max(fastest, MIN_CLOSING_SPEED) if fastest < gripper.speed else None
    grip = min(wanted, most)
    on_table = entry.friction * entry.mass * GRAVITY
    if on_table > MAX_DRAG_FRICTION:
        closing = min(closing, MAX_DRAG_SHARE * on_table)
    return GripForce(min(closing, grip), grip, most, speed, friction)
