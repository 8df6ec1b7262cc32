"""Grip force, and compliant closing of the fingers until both touch.

The force suffices for weight, friction and acceleration, within the limit of a fragile item. Two fingers hold
at most a weight of 2 μ F (Coulomb). The fingers are coupled: one that touches alone exerts the drive force of
both, and the momentum of both at the impact. A fragile item has to survive that, too.

The fingers of a parallel gripper move together. Where the hand is off the middle of an object, one of them
touches first. It pushes a light object along, which does no harm. A heavy one pushes back: the wrist measures
it, and the arm becomes soft across the fingers until they are centred.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from picktree.robot.control import (
    OPENING_FORCE,
    CartesianStiffness,
    CompliantMotion,
    ContactDetector,
    ContactState,
)
from picktree.robot.planning import CARRYING_ACCELERATION
from picktree.world import GRAVITY, Array, event_types
from picktree.world.robot_model import GripperDescription
from picktree.world.scene import MIN_FELT_MASS, CatalogueEntry

if TYPE_CHECKING:
    from picktree.robot import World
    from picktree.robot.control import Doing, GripperControl


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
    least = MIN_GRIP_FORCE if entry.mass >= MIN_FELT_MASS else LIGHT_GRIP_FORCE
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


ONE_FINGER_FORCE = 2.5
"""Force across the fingers above which only one of them touches, N."""
EVEN_FORCE = 1.2
"""Force across the fingers below which both of them touch, or none, N."""
STANDING_OPENING_SPEED = 0.004
"""Speed of the opening below which the fingers stand, m/s."""
PRESSING_FORCE_SHARE = 0.6
"""Share of the commanded force from which the drive presses against something."""
CLOSING_STIFFNESS = CartesianStiffness(linear=(1500.0, 0.0, 1500.0), angular=40.0, frame="tool")
"""Stiffness of the arm that gives way across the fingers: the tool's y axis, the closing direction."""
MAX_COMPLIANCE_TIME = 1.0
"""Longest time for which the hand gives way, s."""
MAX_COMPLIANCE_TRAVEL = 0.015
"""Greatest distance that the hand gives way, m."""
CLOSING_SPARE_TIME = 0.7
"""Time beyond the travel time at the fingers' speed, s."""


@dataclass(frozen=True, slots=True)
class ClosingResult:
    """Result of closing the fingers."""

    width: float
    """Opening, m."""
    gave_way: float
    """Distance that the hand moved along the closing direction, m; 0 when it did not give way."""
    aside: float
    """Remaining force across the fingers, N."""


class ClosingCompliance(CompliantMotion):
    """Compliant motion of the hand along the tool's y axis, until the fingers stand and press evenly."""

    def __init__(self, grip: GripperControl, force: float) -> None:
        """`force`: closing force of each finger, N."""
        super().__init__()
        self._grip = grip
        self._press = force
        self._even = 0.0

    def step(self, felt: ContactState) -> None:
        axis = self.turn[:, 1]
        way = felt.position - self.origin
        # Only the closing direction is free: the anchor goes along with the tool there.
        self.position = self.origin + axis * float(axis @ way)
        across = abs(float(axis @ felt.force))
        even = across < EVEN_FORCE and fingers_settled(self._grip, self._press)
        self._even = self._even + felt.period if even else 0.0
        if self._even >= 0.03 or abs(float(axis @ way)) > MAX_COMPLIANCE_TRAVEL:
            self.finished = True


def fingers_settled(grip: GripperControl, force: float) -> bool:
    """Return whether the fingers stand and press against something, or have met."""
    state = grip.state
    return abs(state.speed) < STANDING_OPENING_SPEED and state.force >= PRESSING_FORCE_SHARE * force


def close(world: World, pressure: GripForce, node: str) -> Doing[ClosingResult]:
    """Close the fingers with the arm at rest; they go on closing with `pressure.closing` afterwards.

    Raises the failures of `ArmMotion.comply`, and control.gripper where the fingers do not move or press as
    commanded.
    """
    control, grip = world.control, world.gripper
    q = control.state.position
    axis = world.robot.tcp(q).rotation()[:, 1]
    zero = control.wrist.over(0.05, q)
    detector = ContactDetector(ONE_FINGER_FORCE, EVEN_FORCE)
    seen = world.clock.now
    detector.watch(control.wrist.since(seen - 0.1))
    speed = pressure.speed or world.robot.description.gripper.speed
    until = seen + grip.width / (2 * speed) + CLOSING_SPARE_TIME
    grip.start(0.0, pressure.closing, pressure.speed)
    begin, begun = np.array(control.tcp.position), grip.width
    gave = False
    while world.clock.now < until:
        yield
        detector.watch(control.wrist.since(seen))
        seen = world.clock.now
        if abs(_across(detector, axis)) > ONE_FINGER_FORCE and not gave:
            gave = True
            course = ClosingCompliance(grip, pressure.closing)
            yield from world.move.comply(
                course, MAX_COMPLIANCE_TIME, node=node, stiffness=CLOSING_STIFFNESS, zero=zero
            )
            detector = ContactDetector(ONE_FINGER_FORCE, EVEN_FORCE)
            until = world.clock.now + CLOSING_SPARE_TIME
            seen = world.clock.now
        if fingers_settled(grip, pressure.closing):
            break
    way = float(axis @ (np.array(control.tcp.position) - begin)) if gave else 0.0
    left = control.wrist.over(0.02, control.state.position)[:3] - zero[:3]
    yield from grip.sound(begun)
    closed = ClosingResult(grip.width, way, float(axis @ left))
    if gave:
        world.journal.note(
            event_types.CentredEvent(
                f"the hand gave way by {abs(way) * 1000:.1f} mm until both fingers touched",
                node,
                way=way,
                aside=closed.aside,
                width=closed.width,
            )
        )
    return closed


def _across(detector: ContactDetector, axis: Array) -> float:
    """Return the contact force along the closing direction, N."""
    return 0.0 if detector.contact is None else float(axis @ np.array(detector.contact.force))
