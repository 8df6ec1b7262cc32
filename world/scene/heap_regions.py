"""Regions of heaps: where things lie that are taken out without being recognised."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..shapes import Box, top
from ..values import Array, ObjectId, Pose
from .description import Bin, SceneDescription, Spawn

PILE_RIM = 0.06
"""Width of the rim about the area of a pile, m: things slide and roll apart."""


@dataclass(frozen=True, slots=True)
class HeapRegion:
    """Upright box in which a heap may lie: the inside of a tote, or a place on a fixture."""

    id: ObjectId
    """Tote or fixture."""
    frame: Pose
    """Corner of the box in the world, at the height of the support; z up."""
    size: tuple[float, float]
    """Lengths along x and y with the walls, m."""
    wall: float = 0.0
    """Thickness of the walls, m; 0: there are none."""
    rim: float = 0.0
    """Height of the walls above the support, m."""
    floor: float = 0.0
    """Height of the tote's floor above the support, m."""
    reach: float = 0.25
    """Height above the floor up to which depth belongs to the heap, m."""

    @classmethod
    def of(cls, tote: Bin) -> HeapRegion:
        x, y, z = tote.size
        corner = tote.pose @ Pose((-x / 2, -y / 2, 0.0))
        return cls(tote.id, corner, (x, y), tote.wall, z, tote.wall)

    def covers(self, points: Array) -> NDArray[np.bool_]:
        """Select the points (n, 3) of the world that lie in the box, at any depth."""
        local = self.frame.inverse().apply(points)
        inside = np.all((local[:, :2] >= 0.0) & (local[:, :2] <= np.array(self.size)), axis=1)
        return inside & (local[:, 2] < self.floor + self.reach)


def heap_regions(scene: SceneDescription) -> dict[str, HeapRegion]:
    """Return the places where heaps may lie, by tote or fixture.

    They are the insides of totes, and on a fixture the rectangle about the areas of its heaps, with a rim.
    """
    found = {str(tote.id): HeapRegion.of(tote) for tote in scene.bins if tote.is_tote}
    on: dict[str, list[tuple[float, float]]] = {}
    for spawn in scene.spawn:
        if spawn.drop is not None and spawn.into is None and (name := region_of(scene, spawn)):
            on.setdefault(name, []).extend(spawn.area)
    for name, corners in on.items():
        low, high = np.min(corners, axis=0) - PILE_RIM, np.max(corners, axis=0) + PILE_RIM
        fixture = scene.fixture(name)
        frame = Pose((float(low[0]), float(low[1]), top(fixture.shape, fixture.pose)))
        found[name] = HeapRegion(fixture.id, frame, (float(high[0] - low[0]), float(high[1] - low[1])))
    return found


def region_of(scene: SceneDescription, spawn: Spawn) -> str:
    """Return the name of the region of a heap: its tote, or the fixture with the highest level top below the
    middle of its area. Empty when there is none."""
    if spawn.into is not None:
        return str(spawn.into)
    x, y = np.mean(spawn.area, axis=0)
    tops: list[tuple[float, str]] = []
    for fixture in scene.fixtures:
        rotation = fixture.pose.rotation()
        if isinstance(fixture.shape, Box) and abs(rotation[2, 2]) > 0.999:
            local = rotation.T @ (np.array([x, y, fixture.pose.position[2]]) - fixture.pose.position)
            if np.all(np.abs(local[:2]) <= np.array(fixture.shape.size[:2]) / 2):
                tops.append((top(fixture.shape, fixture.pose), str(fixture.id)))
    return max(tops, default=(0.0, ""))[1]
