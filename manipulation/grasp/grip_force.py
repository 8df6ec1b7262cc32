"""How hard to grip: as firmly as weight, friction and acceleration need, as gently as the item wants.

Two fingers hold what weighs at most 2 μ F (Coulomb). A finger that touches alone takes the drive of both, for
they are coupled, and the momentum of both at the impact; a fragile item has to survive that, too.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from ...control.execution.gripper_motion import OPENING
from ...robots.description import GripperDescription
from ...world.scene.description import CatalogueEntry
from ...world.values import GRAVITY

ACCELERATION = 9.0
"""Greatest of the hand on its fast transfers, as measured, m/s²."""
SAFETY = 2.0
"""The fingers hold so many times what pulls: friction and mass of a kind are known roughly."""
LEAST = 8.0
"""Gentler is not needed unless an item is fragile, N."""
SHARE = 0.4
"""Of its limit with which a fragile item is gripped at least."""
SHAKEN = 2.0
"""Force that the fingers' own inertia may add on a fast transfer, N: measured up to 1.9."""
UNKNOWN = 30.0
"""For what the catalogue does not know, N."""
ALONE = 2.0
"""Times the force of a finger that one gets which touches alone."""
IMPACT = 55.0
"""Force of an impact of the fingers beyond their drive's, for each m/s, N: measured up to 47."""
UNEVEN = 1.15
"""By which a finger may press harder than its drive: than the other one, and when the grip becomes firmer."""
GENTLE = 0.3
"""Share of its limit with which the fingers close on a fragile item."""
DRAGGED = 0.4
"""Share of an item's friction on the table that a finger may push it with before the other one touches."""
LIGHT = 2.5
"""Friction on the table up to which an item may be pushed along while the fingers close, N."""
SLOWEST = 0.005
"""m/s"""
FIRMER = 1.5
"""By which the grip grows when something slips."""


@dataclass(frozen=True, slots=True)
class GripForce:
    """Forces of a finger, N, and its speed for one grasp."""

    closing: float
    """Until both fingers touch."""
    grip: float
    """To lift and carry what is believed to be gripped."""
    most: float
    """Never above this."""
    speed: float | None
    """Of each finger while they close, m/s; None for as fast as they can."""
    friction: float
    """Between item and pads."""

    def firmer(self) -> GripForce:
        """For what has slipped out of a grip like this one."""
        return replace(self, grip=min(self.grip * FIRMER**2, self.most))

    def carrying(self, mass: float) -> float:
        """The grip for an item that turned out to weigh so much, kg; not gentler than it was."""
        return min(max(self.grip, required_force(mass, self.friction)), self.most)


def opening_force(catalogue: Iterable[CatalogueEntry]) -> float:
    """With which the fingers open in a scene of such items, so that nothing beside them is crushed, N."""
    limits = [entry.force_limit for entry in catalogue if entry.force_limit is not None]
    return min([OPENING, *(GENTLE * limit for limit in limits)])


def required_force(mass: float, friction: float) -> float:
    """Force of each finger for a mass, kg, on a fast transfer, N."""
    if friction <= 0.0:
        return float("inf")
    return SAFETY * mass * (GRAVITY + ACCELERATION) / (2.0 * friction)


def grip_force(entry: CatalogueEntry | None, bound: float, gripper: GripperDescription) -> GripForce:
    """For an item of that kind, with at most `bound` N a finger."""
    bound = min(bound, gripper.max_force)
    if entry is None:
        force = min(UNKNOWN, bound)
        return GripForce(force, force, bound, None, 1.0)
    friction = entry.friction * gripper.pad_contact.friction
    wanted = max(required_force(entry.mass, friction), LEAST)
    most, closing, speed = bound, bound, None
    limit = entry.force_limit
    if limit is not None:
        # Carried sideways, the item leans on one finger, and so do the fingers.
        shaken = SHAKEN + entry.mass * ACCELERATION / 2
        most = min(bound, max(limit - shaken, limit / 2) / UNEVEN)
        wanted = max(required_force(entry.mass, friction), min(LEAST, SHARE * limit))
        closing = GENTLE * limit
        fastest = (limit / UNEVEN - ALONE * closing) / IMPACT
        speed = max(fastest, SLOWEST) if fastest < gripper.speed else None
    grip = min(wanted, most)
    on_table = entry.friction * entry.mass * GRAVITY
    if on_table > LIGHT:
        closing = min(closing, DRAGGED * on_table)
    return GripForce(min(closing, grip), grip, most, speed, friction)
