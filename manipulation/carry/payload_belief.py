"""What the hand carries: what the catalogue says of it until it is weighed, and what follows from it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...control.wrist.payload_estimate import SPREAD, Payload
from ...world.scene.description import CatalogueEntry
from ...world.values import GRAVITY, Pose
from ..grasp.grip_force import ACCELERATION, Pressure
from .hold_check import Hold

if TYPE_CHECKING:
    from ...cell.world import World

NEAR = (SPREAD / 3, SPREAD / 3, SPREAD / 3)
"""Standard deviation of where its centre is believed, m."""
VAGUE = 0.25
"""Standard deviation of a mass in the catalogue, as a share of it."""
WEIGHED = 0.005
"""Of a mass that was weighed, kg."""
FRAGILE = 20.0
"""N"""
LIGHT = 0.4
"""What carrying so much does to the wrist on a fast transfer, the guard of a motion has room for, kg."""


def take_up(world: World, press: Pressure, entry: CatalogueEntry | None, object_in_tcp: Pose) -> None:
    """The fingers hold something: press for its believed weight, and know it as the wrist's payload."""
    world.grip.bound = press.most
    world.grip.press(press.grip)
    if entry is not None:
        centre = object_in_tcp.position
        world.control.wrist.carry(Payload(entry.mass, VAGUE * entry.mass, centre, NEAR))


def weighed(world: World, hold: Hold, press: Pressure | None = None) -> None:
    """It is off the ground and was weighed: know that, and press for what it weighs."""
    if hold.load is None:
        return
    mass = hold.load / GRAVITY
    before = world.control.wrist.payload
    centre = (0.0, 0.0, 0.0) if before is None else before.centre
    world.control.wrist.carry(Payload(mass, WEIGHED, centre, NEAR))
    firm = 0.0 if press is None else press.carrying(mass)
    if firm > world.grip.force:
        world.grip.press(firm)


def is_fragile(world: World, kind: str) -> bool:
    """Whether items of that kind are crushed by what a hand bumps them with."""
    limits = [e.force_limit for e in world.description.catalogue if e.kind == kind]
    return any(limit is not None and limit < FRAGILE for limit in limits)


def burden(world: World) -> float:
    """Force on the wrist that carrying adds on a fast transfer beyond what a guard leaves room for, N."""
    payload = world.control.wrist.payload
    return 0.0 if payload is None else max(0.0, payload.mass - LIGHT) * (GRAVITY + ACCELERATION)
