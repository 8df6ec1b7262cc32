"""Height maps of heaps and bins from one depth picture.

Map of a heap: a 5 × 5 median, back-projection, and for each cell the greatest height of its points. Between a
high and a low neighbour the picture shows nothing: the cells there are filled as solid columns.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from picktree.world import (
    Array,
    BeliefObject,
    Box,
    ObjectId,
    ObstacleBlock,
    PlanningScene,
    Pose,
    heap_geometry,
)
from picktree.world.scene import Bin, SceneDescription, destinations

from .camera_geometry import PosedCamera, rays_of
from .segmentation import SegmentationInput
from .tag_reading import read_tags

CELL = 0.002
"""Edge length of a cell, m."""
MAX_RISE = 2.0
"""Slope between neighbouring pixels from which on it is a cliff: a step of height over distance."""
MAX_GAP_CELLS = 60
"""Greatest length of a filled gap behind a cliff, cells."""
FLOOR_NOISE = 0.003
"""Height above the floor up to which depth is the floor's, m: noise alone would lift the finger tips."""
HOLE_ROUNDS = 2
"""Rounds in which single missing cells get the height of their highest neighbour."""
COARSE, HEIGHT_STEP = 6, 0.006
"""Edge length in cells, and step of height, m, of the columns that are collision geometry."""
EMPTY_HEIGHT, EMPTY_AREA = 0.007, 8e-5
"""Height above the floor, m, and area above it, m², up to which a tote counts as empty: depth has noise."""
HEAP_KIND = "heap"
"""Kind of a heap in the belief."""


def map_heights(
    picture: SegmentationInput, hidden: NDArray[np.bool_], region: heap_geometry.HeapRegion
) -> heap_geometry.HeightMap | None:
    """Return the height map of a region. `hidden` (h, w) marks pixels of the robot.

    None: the picture shows nothing of it.
    """
    cell, sight = CELL, picture.sight
    n, m = (max(1, round(length / cell)) for length in region.size)
    heights = np.full(n * m, -np.inf)
    points = _points(sight, picture.depth, hidden, region)
    if points is None:
        return None
    _raise_cells(heights, points, region, cell, (n, m))
    heights = heights.reshape(n, m)
    heights = _without_holes(heights)
    walls = np.zeros((n, m), dtype=np.bool_)
    if region.wall > 0.0:
        k = max(1, round(region.wall / cell))
        walls[:k] = walls[-k:] = walls[:, :k] = walls[:, -k:] = True
    seen = np.isfinite(heights)
    heights = np.where(heights < region.floor + FLOOR_NOISE, region.floor, heights)
    heights = np.where(seen, heights, np.nan)
    labels = _labels(sight, picture.label, region.frame, cell, heights)
    return heap_geometry.HeightMap.of(region.frame, cell, (region.floor, region.rim), heights, walls, labels)


def map_heaps(
    picture: SegmentationInput,
    hidden: NDArray[np.bool_],
    description: SceneDescription,
    colour: NDArray[np.uint8],
) -> dict[ObjectId, heap_geometry.HeightMap]:
    """Return the height maps of the heaps' regions that a picture shows.

    Tags are read in its colours (h, w, 3) if a rule of the scene uses them.
    """
    found: dict[ObjectId, heap_geometry.HeightMap] = {}
    tags = (
        tuple(read_tags(picture.sight, picture.depth, colour))
        if destinations.asks_for(description.destinations, "tag")
        else ()
    )
    for region in heap_geometry.heap_regions(description).values():
        heap = map_heights(picture, hidden, region)
        if heap is None:
            continue
        local = [(n, region.frame.inverse().apply(at)) for n, at in tags if region.covers(at[None])[0]]
        found[region.id] = replace(
            heap, tags=tuple(heap_geometry.MapTag(n, (float(x), float(y))) for n, (x, y, _) in local)
        )
    return found


def _labels(
    sight: PosedCamera, label: NDArray[np.uint8], frame: Pose, cell: float, heights: Array
) -> NDArray[np.uint8]:
    """Return the labels (n, m) of the pixels that show the tops of the cells."""
    n, m = heights.shape
    cells: NDArray[np.intp] = np.arange(n * m, dtype=np.intp)
    i, j = cells // m, cells % m
    tops = np.column_stack([(i + 0.5) * cell, (j + 0.5) * cell, np.nan_to_num(heights).ravel()])
    columns, rows = np.round(sight.pixels(frame.apply(tops))).astype(np.intp).T
    h, w = label.shape
    inside = (rows >= 0) & (rows < h) & (columns >= 0) & (columns < w) & np.isfinite(heights).ravel()
    found = np.zeros(n * m, dtype=np.uint8)
    found[inside] = label[rows[inside], columns[inside]]
    return found.reshape(n, m)


def update_heap(
    scene: PlanningScene,
    region: heap_geometry.HeapRegion,
    seen: heap_geometry.HeightMap,
    former: heap_geometry.Heap | None,
    now: float,
) -> heap_geometry.Heap:
    """Merge a new map of a region into the belief, and return its heap. Failed places are forgotten where the
    depth has changed."""
    there = seen.over(None if former is None else former.map)
    heap = heap_geometry.Heap(
        there, () if former is None else tuple(p for p in former.barred if p.holds(there))
    )
    put_heap(scene, region, there, now, "seen")
    return heap


def put_heap(
    scene: PlanningScene,
    region: heap_geometry.HeapRegion,
    heap: heap_geometry.HeightMap,
    now: float,
    reason: str,
) -> None:
    """Replace the belief about the heap in a region; an empty one is no object."""
    found = heap_object(region, heap, now)
    if found is None:
        scene.remove(heap_geometry.heap_id(region.id), f"{region.id}: nothing is left of the heap")
    else:
        scene.put(found, reason)


def heap_object(
    region: heap_geometry.HeapRegion, heap: heap_geometry.HeightMap, now: float
) -> BeliefObject | None:
    """Return the heap as an obstacle of merged columns, which are collision geometry. None: it is empty."""
    heights, walls = heap.heights(), heap.beside_walls()
    inner = np.where(walls, heap.floor, np.where(np.isfinite(heights), heights, heap.rim))
    seen = np.isfinite(heights) & ~walls
    if np.count_nonzero(seen & (heights > heap.floor + EMPTY_HEIGHT)) * heap.cell**2 < EMPTY_AREA:
        return None
    blocks = tuple(_merged_columns(inner, heap))
    x, y = region.size
    top = max(block.at[2] + block.size[2] / 2 for block in blocks) if blocks else heap.floor
    middle = (x / 2, y / 2, (heap.floor + top) / 2)
    shape = Box((x - 2 * region.wall, y - 2 * region.wall, max(1e-3, top - heap.floor)))
    moved = tuple(
        ObstacleBlock(b.size, (b.at[0] - middle[0], b.at[1] - middle[1], b.at[2] - middle[2])) for b in blocks
    )
    return BeliefObject(
        HEAP_KIND,
        "unknown",
        shape,
        "grey",
        region.frame @ Pose(middle),
        0.002,
        0.0,
        1.0,
        now,
        id=heap_geometry.heap_id(region.id),
        role="heap",
        place=str(region.id),
        blocks=moved,
    )


def _merged_columns(heights: Array, heap: heap_geometry.HeightMap) -> Iterator[ObstacleBlock]:
    """Yield boxes from the floor up in the map's frame: coarse cells of the same rounded height, merged."""
    n, m = (-(-length // COARSE) for length in heights.shape)
    padded = np.full((n * COARSE, m * COARSE), heap.floor)
    padded[: heights.shape[0], : heights.shape[1]] = heights
    coarse = padded.reshape(n, COARSE, m, COARSE).max(axis=(1, 3)) - heap.floor
    steps = np.where(coarse > EMPTY_HEIGHT, np.ceil(coarse / HEIGHT_STEP), 0).astype(np.intp)
    side = COARSE * heap.cell
    for i, j in np.ndindex(n, m):
        step = steps[i, j]
        if step == 0:
            continue
        wide = 1
        while j + wide < m and steps[i, j + wide] == step:
            wide += 1
        deep = 1
        while i + deep < n and bool((steps[i + deep, j : j + wide] == step).all()):
            deep += 1
        steps[i : i + deep, j : j + wide] = 0
        size = (deep * side, wide * side, float(step) * HEIGHT_STEP)
        yield ObstacleBlock(size, ((i + deep / 2) * side, (j + wide / 2) * side, heap.floor + size[2] / 2))


def _points(
    sight: PosedCamera, depth: Array, hidden: NDArray[np.bool_], region: heap_geometry.HeapRegion
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
    heights: Array, points: Array, region: heap_geometry.HeapRegion, cell: float, shape: tuple[int, int]
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


def _scatter(
    heights: Array, points: Array, region: heap_geometry.HeapRegion, cell: float, shape: tuple[int, int]
) -> None:
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


DEFAULT_CELLS = 3
CELL_HEIGHT_QUANTILE = 0.9
"""Quantile of the heights in a cell that counts as its height."""
QUANTILE_SIGMAS = 1.28
"""Sigmas of depth noise by which that quantile lies above an even surface."""
WALL_MARGIN = 0.006
"""Distance from a wall below which a point may belong to the wall, m."""
MAX_HEAP_ABOVE_RIM = 0.2
"""Greatest height of a heap above the rim, m."""
PIXEL_STRIDE = 2
"""Step between the rows, and between the columns, of the picture that are used."""
MIN_CELL_PIXELS = 8
"""Least number of pixels for the height of a cell; with fewer it stays unknown."""


def bin_height_map(
    picture: SegmentationInput,
    blocked: NDArray[np.bool_],
    bin_: Bin,
    noise: float,
    cells: int = DEFAULT_CELLS,
) -> Array:
    """Compute the heights in the cells of a bin (n, n), m; NaN where the picture shows nothing.

    `blocked` (h, w) marks pixels of the robot; `noise` is the depth's standard deviation at 0.7 m."""
    heights = np.full((cells, cells), np.nan)
    low, high = bin_.inside()
    reach = np.array([high[0], high[1], high[2] + MAX_HEAP_ABOVE_RIM])
    box = np.array(list(itertools.product((low[0], reach[0]), (low[1], reach[1]), (low[2], reach[2]))))
    before = picture.sight.before(bin_.pose.apply(box))
    if not len(before):
        return heights
    corners = picture.sight.pixels(before)
    h, w = picture.depth.shape
    (u0, v0), (u1, v1) = np.floor(corners.min(axis=0)), np.ceil(corners.max(axis=0)) + 1
    x0, y0 = int(np.clip(u0, 0, w)), int(np.clip(v0, 0, h))
    x1, y1 = int(np.clip(u1, 0, w)), int(np.clip(v1, 0, h))
    depth = picture.depth[y0:y1:PIXEL_STRIDE, x0:x1:PIXEL_STRIDE]
    used = (depth > 0) & ~blocked[y0:y1:PIXEL_STRIDE, x0:x1:PIXEL_STRIDE]
    depths = depth[used]
    rays = rays_of(picture.sight.intrinsics)[y0:y1:PIXEL_STRIDE, x0:x1:PIXEL_STRIDE][used]
    camera_in_bin = bin_.pose.rotation().T @ picture.sight.rotation
    points = (rays * depths[:, None]) @ camera_in_bin.T + bin_.pose.inverse().apply(picture.sight.origin)
    inside = (
        (points[:, 0] > low[0] + WALL_MARGIN)
        & (points[:, 0] < high[0] - WALL_MARGIN)
        & (points[:, 1] > low[1] + WALL_MARGIN)
        & (points[:, 1] < high[1] - WALL_MARGIN)
        & (points[:, 2] > low[2] - 0.02)
    )
    points, depths = points[inside], depths[inside]
    index = np.zeros(len(points), dtype=np.intp)
    for axis in (0, 1):
        share = (points[:, axis] - low[axis]) / (high[axis] - low[axis])
        index = index * cells + np.clip((share * cells).astype(np.intp), 0, cells - 1)
    spread = noise * (float(depths.mean()) / 0.7) ** 2 if len(depths) else 0.0
    for k in range(cells * cells):
        own = points[index == k, 2]
        if len(own) >= MIN_CELL_PIXELS:
            rank = int(CELL_HEIGHT_QUANTILE * len(own))
            top = float(np.partition(own, rank)[rank]) - QUANTILE_SIGMAS * spread
            heights[k // cells, k % cells] = max(0.0, top - low[2])
    return heights
