"""Bin fill: height map of the heap in a bin, from one picture."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from ..world.scene.description import Bin
from .fitting.view import BinView
from .segmentation.blobs import SegmentationInput

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
) -> BinView:
    """Compute the height map of a bin. `blocked` (h, w) marks pixels of the robot; `noise` is the depth's
    standard deviation at 0.7 m."""
    heights = np.full((cells, cells), np.nan)
    low, high = bin_.inside()
    reach = np.array([high[0], high[1], high[2] + MAX_HEAP_ABOVE_RIM])
    box = np.array(list(itertools.product((low[0], reach[0]), (low[1], reach[1]), (low[2], reach[2]))))
    before = picture.sight.before(bin_.pose.apply(box))
    if not len(before):
        return BinView(heights)
    corners = picture.sight.pixels(before)
    h, w = picture.depth.shape
    (u0, v0), (u1, v1) = np.floor(corners.min(axis=0)), np.ceil(corners.max(axis=0)) + 1
    x0, y0 = int(np.clip(u0, 0, w)), int(np.clip(v0, 0, h))
    x1, y1 = int(np.clip(u1, 0, w)), int(np.clip(v1, 0, h))
    depth = picture.depth[y0:y1:PIXEL_STRIDE, x0:x1:PIXEL_STRIDE]
    rows, columns = np.nonzero((depth > 0) & ~blocked[y0:y1:PIXEL_STRIDE, x0:x1:PIXEL_STRIDE])
    depths = depth[rows, columns]
    pixels = np.stack([columns * PIXEL_STRIDE + x0, rows * PIXEL_STRIDE + y0], axis=1).astype(np.float64)
    rays = picture.sight.directions(pixels)
    points = bin_.pose.inverse().apply(picture.sight.origin + rays * depths[:, None])
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
    order = np.lexsort((points[:, 2], index))
    ends = np.searchsorted(index[order], np.arange(cells * cells + 1))
    ordered = points[order, 2]
    spread = noise * (float(depths.mean()) / 0.7) ** 2 if len(depths) else 0.0
    for k in range(cells * cells):
        count = int(ends[k + 1] - ends[k])
        if count >= MIN_CELL_PIXELS:
            top = float(ordered[ends[k] + int(CELL_HEIGHT_QUANTILE * count)]) - QUANTILE_SIGMAS * spread
            heights[k // cells, k % cells] = max(0.0, top - low[2])
    return BinView(heights)
