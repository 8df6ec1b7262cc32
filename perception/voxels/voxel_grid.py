"""Voxel grid: sets of cells as sorted keys, and the obstacles of the belief that store them.

The belief holds blocks only. Cells are read back from them exactly, so that no second memory can differ from
it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...world.belief.planning_scene import BeliefObject, ObstacleBlock
from ...world.shapes import OBSTACLE_VOLUME, Box, ConvexMesh, Shape, convex_hull, extents, inside
from ...world.values import Array, Pose

CELL_SIZE: Array = np.array([0.01, 0.01, 0.02])
"""Edge lengths of a cell, m; the world's origin is a corner of one."""
MAX_HULL_VOLUME_RATIO = 1.25
"""Greatest volume of a hull that stands for the cells, as a multiple of theirs."""
HALF_DIAGONAL = float(np.linalg.norm(CELL_SIZE)) / 2

Keys: TypeAlias = NDArray[np.int64]
"""Cells, each packed into one number; sorted, without duplicates."""
Indices: TypeAlias = NDArray[np.int64]
"""Cells (n, 3) as numbers of cells from the origin along x, y, z."""

NO_CELLS: Keys = np.zeros(0, dtype=np.int64)
_OFFSET, _BITS = 1 << 19, 20
_MASK = (1 << _BITS) - 1
_NEIGHBOUR_OFFSETS = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)])


def cell_keys(cells: Indices) -> Keys:
    shifted = cells + _OFFSET
    return np.unique((shifted[:, 0] << (2 * _BITS)) | (shifted[:, 1] << _BITS) | shifted[:, 2])


def cell_indices(packed: Keys) -> Indices:
    parts = (packed >> (2 * _BITS), (packed >> _BITS) & _MASK, packed & _MASK)
    return np.stack(parts, axis=1) - _OFFSET


def cell_centres(packed: Keys) -> Array:
    """Centres of the cells in the world (n, 3), m."""
    return (cell_indices(packed) + 0.5) * CELL_SIZE


def adjacent_cells(packed: Keys, others: Keys) -> NDArray[np.bool_]:
    """Select the cells (n,) that are among the others or next to one of them."""
    around = cell_indices(packed)[:, None, :] + _NEIGHBOUR_OFFSETS[None] + _OFFSET
    near = (around[..., 0] << (2 * _BITS)) | (around[..., 1] << _BITS) | around[..., 2]
    return np.any(np.isin(near, others), axis=1)


def cells_in_body(shape: Shape, pose: Pose) -> Keys:
    """Return the cells whose centres lie in a body."""
    low, high = extents(shape, pose.rotation())
    first = np.floor((np.array(pose.position) + low) / CELL_SIZE).astype(np.int64)
    last = np.ceil((np.array(pose.position) + high) / CELL_SIZE).astype(np.int64)
    cells = _span(first, np.maximum(last, first))
    return cell_keys(cells[inside(shape, pose, (cells + 0.5) * CELL_SIZE)])


def cells_of(o: BeliefObject) -> Keys:
    """Return the cells of an obstacle of the belief."""
    if not o.blocks:
        return cells_in_body(o.shape, o.pose)
    return cell_keys(np.concatenate([_cells(block, np.array(o.pose.position)) for block in o.blocks]))


def _cells(block: ObstacleBlock, origin: Array) -> Indices:
    """Return the cells of a block of a body at `origin` (3,)."""
    middle, half = origin + block.at, np.array(block.size) / 2
    first = np.round((middle - half) / CELL_SIZE).astype(np.int64)
    last = np.round((middle + half) / CELL_SIZE).astype(np.int64)
    return _span(first, last)


def obstacle_from_cells(
    boxes: Sequence[tuple[Indices, Indices]],
) -> tuple[Shape, Pose, tuple[ObstacleBlock, ...]]:
    """Build an obstacle from boxes: the enclosing shape, its pose in the world, and each box as a block in
    it.

    A box is its first cell and the one after its last, (3,) each. The enclosing shape is the convex hull
    where that wastes little: a collision check then meets one body instead of many boxes. Otherwise it is the
    bounding box.
    """
    first = np.min([low for low, _ in boxes], axis=0)
    last = np.max([high for _, high in boxes], axis=0)
    middle = (first + last) * CELL_SIZE / 2
    blocks = tuple(
        ObstacleBlock(_vector((high - low) * CELL_SIZE), _vector((low + high) * CELL_SIZE / 2 - middle))
        for low, high in boxes
    )
    return _enclosing_shape(blocks), Pose(_vector(middle)), blocks


def _enclosing_shape(blocks: Sequence[ObstacleBlock]) -> Shape:
    signs = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    corners = np.concatenate([np.array(block.at) + signs * np.array(block.size) for block in blocks])
    low, high = corners.min(axis=0), corners.max(axis=0)
    if len(blocks) == 1:
        return Box(_vector(high - low))
    spans = [_cells(block, -low) for block in blocks]
    volume = len(cell_keys(np.concatenate(spans))) * float(np.prod(CELL_SIZE))
    hull = convex_hull(corners)
    if float(hull.volume) > MAX_HULL_VOLUME_RATIO * volume:
        return Box(_vector(high - low))
    vertices = np.unique(corners[hull.vertices], axis=0)
    return ConvexMesh(tuple(_vector(vertex) for vertex in vertices), OBSTACLE_VOLUME)


def _span(first: Indices, last: Indices) -> Indices:
    """Return all cells from `first` (3,) to `last` (3,), `last` excluded."""
    x, y, z = (max(0, int(n)) for n in last - first)
    return first + np.argwhere(np.ones((x, y, z), dtype=np.bool_)).astype(np.int64)


def _vector(numbers: Array) -> tuple[float, float, float]:
    x, y, z = (round(float(n), 6) for n in numbers)
    return x, y, z
