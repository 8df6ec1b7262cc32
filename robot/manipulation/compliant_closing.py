"""Compliant closing: the hand gives way until both fingers touch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from picktree.robot.control import (
    CartesianStiffness,
    CompliantMotion,
    ContactDetector,
    ContactState,
)
from picktree.world import Array, event_types

from .grip_force import GripForce

if TYPE_CHECKING:
    from picktree.robot import World
    from picktree.robot.control import Doing, GripperControl

ONE_FINGER_FORCE = 2.5
"""Force across the fingers above which only one of them touches, N."""


EVEN_FORCE = 1.2
"""Force across the fingers below which both of them touch, or none, N."""


REST_OPENING_SPEED = 0.004
"""Speed of the opening below which the fingers are at rest, m/s."""


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
    """Compliant motion of the hand along the tool's y axis, until the fingers are at rest and press
    evenly."""

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
    """Return whether the fingers are at rest and press against something, or have met."""
    state = grip.state
    return abs(state.speed) < REST_OPENING_SPEED and state.force >= PRESSING_FORCE_SHARE * force


def close(world: World, pressure: GripForce, node: str) -> Doing[ClosingResult]:
    """Close the fingers with the arm at rest; they keep closing with `pressure.closing` afterwards.

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
    yield from grip.check_grip_force(begun)
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
