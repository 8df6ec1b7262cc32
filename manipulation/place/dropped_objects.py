"""Where an object is believed to be once the hand has let go of it in the open."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ...world.belief.planning_scene import PlanningScene
from ...world.shapes import Box, bottom, top

if TYPE_CHECKING:
    from ...cell.world import World

UNSURE = 0.3
"""Confidence in the guess, until the object is seen again."""


def open_hand(world: World, reason: str, width: float | None = None) -> Generator[None, None, None]:
    """Open the fingers, by default fully; what they held is then believed to be gone from the hand.

    So it is when this is halted on the way: the fingers go on opening.
    """
    try:
        yield from world.grip.open(width)
    except GeneratorExit:
        let_go(world.scene, reason)
        raise
    let_go(world.scene, reason)


def let_go(scene: PlanningScene, reason: str) -> None:
    """Detach what is held and believe it straight below, on the highest fixture or bin floor there."""
    held = scene.held
    if held is None:
        return
    x, y, z = held.pose.position
    support, place = board_at(scene, x, y) or 0.0, "table"
    for bin_ in scene.bins.values():
        local = bin_.pose.inverse().apply(np.array([x, y, z]))
        if abs(float(local[0])) <= bin_.size[0] / 2 and abs(float(local[1])) <= bin_.size[1] / 2:
            support, place = bin_.pose.position[2] + bin_.wall, bin_.id
    fallen = held.pose.shifted((0.0, 0.0, support - bottom(held.shape, held.pose)))
    scene.put(
        replace(held, object_in_tcp=None, pose=fallen, place=place, confidence=UNSURE, sigma_position=0.02),
        reason,
    )


def board_at(scene: PlanningScene, x: float, y: float) -> float | None:
    """Height of the highest fixture's top at a point of the world, never below 0; None beside all of them."""
    highest: float | None = None
    for fixture in scene.fixtures.values():
        if isinstance(fixture.shape, Box):
            local = fixture.pose.inverse().apply(np.array([x, y, fixture.pose.position[2]]))
            size = fixture.shape.size
            if abs(float(local[0])) <= size[0] / 2 and abs(float(local[1])) <= size[1] / 2:
                highest = max(highest or 0.0, top(fixture.shape, fixture.pose))
    return highest
