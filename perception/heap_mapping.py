"""Height map of a heap from one depth picture.

A 5 × 5 median, back-projection, and for each cell the greatest height of its points. Between a high and a low
neighbour the picture shows nothing: the cells there are filled as solid columns.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..world.belief.height_map import HeightMap
from ..world.values import Array, Pose
from .geometry.camera_geometry import PosedCamera, rays_of

CELL = 0.002
"""Edge length of a cell, m."""
MAX_RISE = 2.0
"""Slope between neighbouring pixels from which on it is a cliff: a step of height over distance."""
MAX_GAP_CELLS = 60
"""Greatest length of a filled gap behind a cliff, cells."""
HOLE_ROUNDS = 2
"""Rounds in which single missing cells get the height of their highest neighbour."""


@dataclass(frozen=True, slots=True)
class HeapRegion:
    """Upright box in which a heap may lie: the inside of a tote, or a place on a table."""

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


def map_heights(
    sight: PosedCamera, depth: Array, hidden: NDArray[np.bool_], region: HeapRegion, cell: float = CELL
) -> HeightMap:
    """Return the height map of a region, seen at `depth` (h, w), m. `hidden` (h, w) marks pixels of the
    robot."""
    n, m = (max(1, round(length / cell)) for length in region.size)
    heights = np.full(n * m, -np.inf)
    points = _points(sight, depth, hidden, region)
    if points is not None:
        _raise_cells(heights, points, region, cell, (n, m))
    heights = heights.reshape(n, m)
    heights = _without_holes(heights)
    walls = np.zeros((n, m), dtype=np.bool_)
    if region.wall > 0.0:
        k = max(1, round(region.wall / cell))
        walls[:k] = walls[-k:] = walls[:, :k] = walls[:, -k:] = True
    seen = np.isfinite(heights)
    heights = np.where(seen, np.maximum(heights, region.floor), np.nan)
    return HeightMap.of(region.frame, cell, region.floor, max(region.rim, region.floor), heights, walls)


def _points(
    sight: PosedCamera, depth: Array, hidden: NDArray[np.bool_], region: HeapRegion
) -> Array | None:
    """Return the points (h, w, 3) of the picture's window about the region, in its frame; NaN: unknown."""
    x, y = region.size
    box = np.array(list(itertools.product((0.0, x), (0.0, y), (0.0, region.floor + region.reach))))
    before = sight.before(region.frame.apply(box))
    if not len(before):
        return None
    pixels = sight.pixels(before)
    h, w = depth.shape
    (u0, v0), (u1, v1) = np.floor(pixels.min(axis=0)) - 3, np.ceil(pixels.max(axis=0)) + 4
    rows = slice(int(np.clip(v0, 0, h)), int(np.clip(v1, 0, h)))
    columns = slice(int(np.clip(u0, 0, w)), int(np.clip(u1, 0, w)))
    window = np.ascontiguousarray(depth[rows, columns], dtype=np.float32)
    if window.shape[0] < 2 or window.shape[1] < 2:
        return None
    smooth = np.asarray(cv2.medianBlur(window, 5), dtype=np.float64)
    smooth[(window <= 0) | (smooth <= 0) | hidden[rows, columns]] = np.nan
    there = region.frame.inverse()
    rotation = there.rotation() @ sight.rotation
    points: Array = (rays_of(sight.intrinsics)[rows, columns] * smooth[:, :, None]) @ rotation.T
    points += there.apply(sight.origin)
    return points


def _raise_cells(
    heights: Array, points: Array, region: HeapRegion, cell: float, shape: tuple[int, int]
) -> None:
    """Raise the cells (n · m,) to the points that lie in them, and to the cliffs between neighbours."""
    _scatter(heights, points.reshape(-1, 3), region, cell, shape)
    for a, b in ((points[:, :-1], points[:, 1:]), (points[:-1], points[1:])):
        a, b = a.reshape(-1, 3), b.reshape(-1, 3)
        away = np.abs(b - a)
        span = np.maximum(away[:, 0], away[:, 1]) / cell
        wide = np.flatnonzero((span > 0.9) & (span < MAX_GAP_CELLS))
        if not len(wide):
            continue
        a, b, span = a[wide], b[wide], span[wide]
        count = np.ceil(span * 1.5).astype(np.int64)
        pair = np.repeat(np.arange(len(wide)), count)
        step = np.arange(len(pair)) - np.repeat(np.cumsum(count) - count, count)
        share = ((step + 1.0) / (count[pair] + 1.0))[:, None]
        between = a[pair] + share * (b[pair] - a[pair])
        cliff = away[wide][:, 2] > MAX_RISE * np.hypot(away[wide][:, 0], away[wide][:, 1])
        # Rays along the line of sight never reach the shadow behind an edge: it is solid up to the edge.
        shadow = cliff | (span > 3.0) & (away[wide][:, 2] > 2 * cell)
        between[:, 2] = np.where(shadow[pair], np.maximum(a[pair, 2], b[pair, 2]), between[:, 2])
        _scatter(heights, between, region, cell, shape)


def _scatter(heights: Array, points: Array, region: HeapRegion, cell: float, shape: tuple[int, int]) -> None:
    x, y, z = points.T
    with np.errstate(invalid="ignore"):
        i, j = np.floor(x / cell), np.floor(y / cell)
        kept = (i >= 0) & (i < shape[0]) & (j >= 0) & (j < shape[1]) & (z < region.floor + region.reach)
        kept &= z > region.floor - region.reach
    at = i[kept].astype(np.intp) * shape[1] + j[kept].astype(np.intp)
    np.maximum.at(heights, at, z[kept])


def _without_holes(heights: Array) -> Array:
    kernel = np.ones((3, 3), dtype=np.uint8)
    for _ in range(HOLE_ROUNDS):
        missing = ~np.isfinite(heights)
        if not missing.any():
            break
        around = np.asarray(cv2.dilate(np.where(missing, -1e3, heights), kernel), dtype=np.float64)
        heights = np.where(missing & (around > -1e2), around, heights)
    return heights
