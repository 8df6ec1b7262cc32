"""Heaps: regions where things lie that are taken out without being recognised. A height map has one
height for each cell of a tote or a place on a table.
"""

from __future__ import annotations

import base64
import math
import zlib
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from picktree.world.scene import Bin, SceneDescription, Spawn

from .shapes import Box, top
from .values import Array, ObjectId, Pose

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
    """Thickness of the walls, m; 0: no walls."""
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
            on.setdefault(name, []).extend(spawn.rectangle)
    for name, corners in on.items():
        low, high = np.min(corners, axis=0) - PILE_RIM, np.max(corners, axis=0) + PILE_RIM
        fixture = scene.fixture(name)
        frame = Pose((float(low[0]), float(low[1]), top(fixture.shape, fixture.pose)))
        found[name] = HeapRegion(fixture.id, frame, (float(high[0] - low[0]), float(high[1] - low[1])))
    return found


def region_of(scene: SceneDescription, spawn: Spawn) -> str:
    """Return the name of the region of a heap: its tote, or the fixture with the highest level top below the
    middle of its area. Empty without one."""
    if spawn.into is not None:
        return str(spawn.into)
    x, y = np.mean(spawn.rectangle, axis=0)
    tops: list[tuple[float, str]] = []
    for fixture in scene.fixtures:
        rotation = fixture.pose.rotation()
        if isinstance(fixture.shape, Box) and abs(rotation[2, 2]) > 0.999:
            local = rotation.T @ (np.array([x, y, fixture.pose.position[2]]) - fixture.pose.position)
            if np.all(np.abs(local[:2]) <= np.array(fixture.shape.size[:2]) / 2):
                tops.append((top(fixture.shape, fixture.pose), str(fixture.id)))
    return max(tops, default=(0.0, ""))[1]


RESOLUTION = 1e-4
"""Step of the stored heights, m."""
CHANGED_DEPTH = 0.003
"""Change of the depth from which on a place counts as changed, m."""
BARRED_RADIUS = 0.012
"""Distance around a failed grasp within which no other one begins, m."""
WALL_SHADOW = 0.006
"""Distance from a wall up to which depth may belong to the wall, m."""
_UNSEEN, _WALL = -32768, -32767


def heap_id(tote: str) -> ObjectId:
    """Return the id in the belief of the heap in a tote or on a fixture."""
    return ObjectId(f"{tote}_heap")


@dataclass(frozen=True, slots=True)
class MapTag:
    """ArUco tag that was read in a heap."""

    number: int
    at: tuple[float, float]
    """Centre of the tag in the map's frame, m."""


@dataclass(frozen=True, slots=True)
class HeightMap:
    """Heights above the frame's origin: solid columns from the floor up. Cells that were never seen are
    unknown, not free."""

    frame: Pose
    """Frame of the map in the world: the corner of cell (0, 0), z up."""
    cell: float
    """Edge length of a cell, m."""
    shape: tuple[int, int]
    """Number of cells along x and y."""
    floor: float
    """Height of the floor in the frame, m."""
    rim: float
    """Height of the walls in the frame, m; that of the floor without walls."""
    packed: str = field(repr=False)
    """Heights in steps of `RESOLUTION`, compressed."""
    packed_labels: str = field(repr=False)
    """Labels of the cells' colours, compressed."""
    tags: tuple[MapTag, ...] = ()
    """ArUco tags that were read."""

    @classmethod
    def of(
        cls,
        frame: Pose,
        cell: float,
        levels: tuple[float, float],
        heights: Array,
        walls: NDArray[np.bool_],
        labels: NDArray[np.uint8],
    ) -> HeightMap:
        """Return the map of heights (n, m), m; NaN: never seen. `levels`: floor and rim. `walls` (n, m) marks
        cells of a tote's walls; `labels` (n, m) are colours, 0: none."""
        steps = np.where(np.isfinite(heights), np.round(np.nan_to_num(heights) / RESOLUTION), _UNSEEN)
        steps = np.where(walls, _WALL, steps).astype("<i2")
        packed, tints = (
            base64.b64encode(zlib.compress(values.tobytes(), 1)).decode() for values in (steps, labels)
        )
        floor, rim = levels
        return cls(frame, cell, (heights.shape[0], heights.shape[1]), floor, rim, packed, tints)

    def heights(self) -> Array:
        """Return the heights (n, m), m, read-only; NaN: never seen. Walls have the rim's height."""
        return _unpacked(self)[0]

    def walls(self) -> NDArray[np.bool_]:
        """Return the cells (n, m) of walls, read-only."""
        return _unpacked(self)[1]

    def beside_walls(self) -> NDArray[np.bool_]:
        """Return the cells (n, m) of walls and next to them: depth there may belong to the wall."""
        import cv2  # slow to import

        side = 2 * round(WALL_SHADOW / self.cell) + 1
        wide = cv2.dilate(self.walls().astype(np.uint8), np.ones((side, side), np.uint8))
        return wide.astype(np.bool_)

    def inside(self, points: Array) -> NDArray[np.bool_]:
        """Select the points (k, 3) of the frame on the inner side of the walls; all points without walls.

        A finger beyond a wall closes on it.
        """
        far = (np.array(self.shape) - 1) * self.cell
        within = np.all((points[:, :2] > self.cell) & (points[:, :2] < far), axis=1)
        return within | (self.rim <= self.floor)

    def over(self, former: HeightMap | None) -> HeightMap:
        """Fill the unseen cells with those of a former map of the same place."""
        if former is None or (former.frame, former.shape) != (self.frame, self.shape):
            return self
        heights, seen = self.heights(), np.isfinite(self.heights())
        labels = np.where(seen, self.labels(), former.labels())
        levels, walls = (self.floor, self.rim), self.walls()
        filled = np.where(seen, heights, former.heights())
        return replace(HeightMap.of(self.frame, self.cell, levels, filled, walls, labels), tags=self.tags)

    def labels(self) -> NDArray[np.uint8]:
        """Return the labels (n, m) of the cells' colours, read-only; 0: no colour."""
        raw = zlib.decompress(base64.b64decode(self.packed_labels))
        return np.frombuffer(raw, np.uint8).reshape(self.shape)

    def labels_at(self, points: Array) -> NDArray[np.uint8]:
        """Return the labels (…) of the cells at points (…, 3) of the frame; 0 outside of the map."""
        i, j = (np.floor(points[..., k] / self.cell).astype(np.intp) for k in (0, 1))
        n, m = self.shape
        there = (i >= 0) & (i < n) & (j >= 0) & (j < m)
        found = self.labels()[np.clip(i, 0, n - 1), np.clip(j, 0, m - 1)]
        return np.where(there, found, 0).astype(np.uint8)

    def with_heights(self, heights: Array) -> HeightMap:
        """Return the map with other heights (n, m), m."""
        levels, walls = (self.floor, self.rim), self.walls()
        return replace(
            HeightMap.of(self.frame, self.cell, levels, heights, walls, self.labels()), tags=self.tags
        )

    def centres(self, cells: NDArray[np.intp]) -> Array:
        """Return the middles (k, 2) of cells (k, 2) in the frame, m."""
        return (cells.astype(np.float64) + 0.5) * self.cell

    def around(self, x: float, y: float, radius: float) -> Array:
        """Return the heights (k,) within a square of half-width `radius` m about a point of the frame, m."""
        rows, columns = (
            slice(max(0, int((at - radius) / self.cell)), max(0, int((at + radius) / self.cell) + 1))
            for at in (x, y)
        )
        return self.heights()[rows, columns].ravel()


@lru_cache(maxsize=8)
def _unpacked(packed: HeightMap) -> tuple[Array, NDArray[np.bool_]]:
    steps = np.frombuffer(zlib.decompress(base64.b64decode(packed.packed)), "<i2").reshape(packed.shape)
    heights = np.where(steps == _UNSEEN, np.nan, steps * RESOLUTION)
    walls = steps == _WALL
    heights[walls] = packed.rim
    heights.flags.writeable = walls.flags.writeable = False
    return heights, walls


@dataclass(frozen=True, slots=True)
class BarredPlace:
    """Place of a failed grasp, with the depth that was seen there before."""

    at: tuple[float, float]
    """Point in the map's frame, m."""
    heights: tuple[float, ...]
    """Heights about it before the attempt, m; -1: never seen."""

    @classmethod
    def of(cls, heap: HeightMap, x: float, y: float) -> BarredPlace:
        return cls((x, y), tuple(np.nan_to_num(heap.around(x, y, BARRED_RADIUS), nan=-1.0).tolist()))

    def holds(self, heap: HeightMap) -> bool:
        """Return whether the depth there is unchanged since the attempt."""
        now = np.nan_to_num(heap.around(*self.at, BARRED_RADIUS), nan=-1.0)
        if len(now) != len(self.heights):
            return False
        return float(np.mean(np.abs(now - np.array(self.heights)) > CHANGED_DEPTH)) < 0.25


@dataclass(frozen=True, slots=True)
class Heap:
    """Heap of a belief object: its height map, and the places where grasps have failed."""

    map: HeightMap
    barred: tuple[BarredPlace, ...] = ()

    def bars(self, point: Array) -> bool:
        """Return whether a grasp failed at a point of the world, and the depth there is still the same."""
        x, y, _ = self.map.frame.inverse().apply(point)
        return any(
            math.hypot(x - place.at[0], y - place.at[1]) < BARRED_RADIUS and place.holds(self.map)
            for place in self.barred
        )
