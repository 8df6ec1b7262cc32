"""Space carving: unexplained patches of one view, the cells that they occupy, and the cells that no ray
clears."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from ...world.shapes import Box
from ...world.values import Array, Pose
from .. import segmentation
from ..fitting.view import PerceivedView, UnexplainedPatch
from ..segmentation import Pixels, SegmentationInput, connected_patches
from .voxel_grid import CELL_SIZE, HALF_DIAGONAL, NO_CELLS, Indices, Keys, cell_centres, cell_keys

MIN_RAISED_DEPTH = 0.012
"""Least distance of grey depth in front of the background that counts as something, m."""
MIN_PATCH_PIXELS = 20
"""Least number of pixels of a patch; fewer are noise."""
MIN_OBSTACLE_HEIGHT = 0.004
"""Least height of an obstacle over its support, m. Anything flatter is a mark on the table."""
BACKING_DEPTH_TOLERANCE, MIN_BACKING_NEIGHBOURS = 0.02, 3
"""Difference in depth within which pixels back each other, m, and least number of such neighbours among
eight."""
MIN_PIXELS_NEXT_TO_ARM = 60
"""Least number of pixels of a patch next to the robot: the model's edge leaves slivers."""


def unexplained_patches(
    picture: SegmentationInput,
    backdrop: Array,
    robot: NDArray[np.bool_],
    in_heap: Callable[[Array], NDArray[np.bool_]],
) -> list[tuple[Pixels, Pixels]]:
    """Find patches of unsaturated depth in front of the `backdrop` (h, w) that nothing known explains.

    Points (n, 3) of the world that are `in_heap`, in a bin, are left out.
    """
    raised = (picture.depth > 0) & np.isfinite(backdrop) & (picture.label == 0)
    raised &= backdrop - picture.depth > MIN_RAISED_DEPTH
    raised &= ~picture.blocked
    if int(raised.sum()) < MIN_PATCH_PIXELS:
        return []
    rows, columns = np.nonzero(raised)
    raised[rows, columns] = ~in_heap(points_of(picture, rows, columns))
    items = cv2.dilate((picture.owner > 0).astype(np.uint8), np.ones((5, 5), np.uint8))
    opened = cv2.morphologyEx(
        (raised & (items == 0) & _pixels_with_backing(picture.depth, raised)).astype(np.uint8),
        cv2.MORPH_OPEN,
        np.ones((3, 3), np.uint8),
    )
    beside = cv2.dilate(robot.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(np.bool_)
    return [
        (rows, columns)
        for rows, columns in connected_patches(opened.astype(np.bool_), MIN_PATCH_PIXELS)
        if len(rows) >= MIN_PIXELS_NEXT_TO_ARM or not beside[rows, columns].any()
    ]


def _pixels_with_backing(depth: Array, raised: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Select pixels with enough neighbours of their own depth. At edges a sensor may mix near and far; such a
    pixel is isolated between the two."""
    h, w = depth.shape
    padded = np.pad(np.where(raised, depth, 0.0), 1)
    backing = np.zeros(depth.shape, dtype=np.int8)
    for dy in (0, 1, 2):
        for dx in (0, 1, 2):
            if (dy, dx) != (1, 1):
                backing += np.abs(padded[dy : dy + h, dx : dx + w] - depth) < BACKING_DEPTH_TOLERANCE
    return raised & (backing >= MIN_BACKING_NEIGHBOURS)


def bounding_box_of(
    picture: SegmentationInput, rows: Pixels, columns: Pixels, support: float
) -> UnexplainedPatch | None:
    """Return the unexplained patch with its upright bounding box, from its support up; None when it is as
    flat as the support."""
    depths = picture.depth[rows, columns]
    seen = depths > 0
    if int(seen.sum()) < 4:
        return None
    rows, columns, depths = rows[seen], columns[seen], depths[seen]
    points = points_of(picture, rows, columns)
    top = float(np.percentile(points[:, 2], 95.0))
    if top - support < MIN_OBSTACLE_HEIGHT:
        return None
    (x, y), (long, wide), turn = cv2.minAreaRect((points[:, :2] * 1000).astype(np.float32))
    pixel = float(np.median(depths)) / picture.sight.intrinsics.fx
    size = (long / 1000 + pixel, wide / 1000 + pixel, top - support)
    middle = (x / 1000, y / 1000, (top + support) / 2)
    labels = picture.label[rows, columns]
    label = int(np.bincount(labels).argmax())
    pose = Pose.from_rpy(middle, (0.0, 0.0, math.radians(turn)))
    return UnexplainedPatch(Box(size), pose, segmentation.LABEL_NAMES[label] or "grey", rows, columns)


def points_of(picture: SegmentationInput, rows: Pixels, columns: Pixels) -> Array:
    """Return the points (n, 3) of the world that the pixels show, m."""
    rays = picture.sight.directions(np.stack([columns, rows], axis=1).astype(np.float64))
    return picture.sight.origin + rays * picture.depth[rows, columns][:, None]


PIXEL_HALF_WIDTH = 2.0
"""Half width of the square that each pixel stands for, pixels: at edges every second pixel is lost."""
CLEARING_SIGMAS = 2.5
"""Sigmas of depth noise by which the surface must lie beyond a cell, so that the ray passes the cell."""
DEPTH_NOISE = 0.002
"""Standard deviation of the depth at 0.7 m, m; it grows with the square."""
MIN_WINDOW_DEPTH_SHARE, MIN_MIDDLE_DEPTH_SHARE = 0.3, 0.01
"""Least share of pixels with a depth for a statement about a whole cell, and about its middle."""
MEDIAN_WIDTH = 5
"""Width of the median filter of the depth, pixels: tops that noise makes uneven would become many boxes."""


def occupied_cells(view: PerceivedView, patches: Sequence[UnexplainedPatch]) -> Keys:
    """Return the cells that the patches occupy, from the seen surface down to its possible support.

    Cells that rays pass through as a whole are left out, as below a suspended bar.
    """
    surface = [_surface_points(view, patch) for patch in patches]
    if not surface:
        return NO_CELLS
    columns = _cell_columns(np.concatenate(surface), view)
    return columns[~_cells_passed_by_rays(view, columns, HALF_DIAGONAL, window=True)]


def retained_cells(view: PerceivedView, known: Keys) -> Keys:
    """Return the known cells that no ray passes: hidden, out of the view, or seen again."""
    return known[~_cells_passed_by_rays(view, known, 0.0, window=False)] if len(known) else known


def surface_of(view: PerceivedView, patch: UnexplainedPatch) -> Keys:
    """Return the cells in which the patch's surface lies."""
    return cell_keys(np.floor(_surface_points(view, patch) / CELL_SIZE).astype(np.int64))


def _surface_points(view: PerceivedView, patch: UnexplainedPatch) -> Array:
    """Return points (n, 3) on the patch's surface: the middle and the corners of each pixel."""
    rows, columns = patch.rows, patch.columns
    y, x = int(rows.min()), int(columns.min())
    window = np.zeros((int(rows.max()) - y + 1, int(columns.max()) - x + 1), dtype=np.float32)
    window[rows - y, columns - x] = view.depth[rows, columns]
    smooth = np.asarray(cv2.medianBlur(window, MEDIAN_WIDTH), dtype=np.float64)[rows - y, columns - x]
    raw = view.depth[rows, columns]
    # At borders the median takes the background's depth.
    depth = np.where(np.abs(smooth - raw) < 4 * CLEARING_SIGMAS * DEPTH_NOISE, smooth, raw)
    middle = np.stack([columns, rows], axis=1).astype(np.float64)
    offsets = np.array(
        [
            (0.0, 0.0),
            (-PIXEL_HALF_WIDTH, -PIXEL_HALF_WIDTH),
            (-PIXEL_HALF_WIDTH, PIXEL_HALF_WIDTH),
            (PIXEL_HALF_WIDTH, -PIXEL_HALF_WIDTH),
            (PIXEL_HALF_WIDTH, PIXEL_HALF_WIDTH),
        ]
    )
    points = [view.sight.origin + view.sight.directions(middle + o) * depth[:, None] for o in offsets]
    return np.concatenate(points)


def _cell_columns(points: Array, view: PerceivedView) -> Keys:
    """Return the cells that hold the points (n, 3), and those below them down to the supports."""
    supports = view.supports(points)
    upper = points[:, 2] > supports
    cells = np.floor(points[upper] / CELL_SIZE).astype(np.int64)
    # A cell that holds the support belongs to the obstacle on it.
    lowest = np.floor(supports[upper] / CELL_SIZE[2] + 1e-6).astype(np.int64)
    places, column = np.unique(cells[:, :2], axis=0, return_inverse=True)
    column = column.reshape(-1)
    tops = np.full(len(places), np.iinfo(np.int64).min)
    np.maximum.at(tops, column, cells[:, 2])
    bottoms = np.full(len(places), np.iinfo(np.int64).max)
    np.minimum.at(bottoms, column, np.minimum(lowest, cells[:, 2]))
    heights = tops - bottoms + 1
    stacked: Indices = np.empty((int(heights.sum()), 3), dtype=np.int64)
    stacked[:, :2] = np.repeat(places, heights, axis=0)
    starts = np.repeat(np.cumsum(heights) - heights, heights)
    stacked[:, 2] = np.arange(len(stacked)) - starts + np.repeat(bottoms, heights)
    return cell_keys(stacked)


def _cells_passed_by_rays(
    view: PerceivedView, cells: Keys, clear: float, *, window: bool
) -> NDArray[np.bool_]:
    """Select the cells (n,) that rays pass, to surfaces more than `clear` m behind their middles.

    With `window` all rays of a cell must pass, else those through its middle.
    """
    points = cell_centres(cells)
    depth = (points - view.sight.origin) @ view.sight.rotation[:, 2]
    pixels = np.round(view.sight.pixels(points)).astype(np.int64)
    h, w = view.reach.shape
    inside = (depth > 0.05) & (pixels >= 0).all(axis=1) & (pixels < (w, h)).all(axis=1)
    radius = np.ones(len(cells), dtype=np.int64)
    if window:
        radius = np.ceil(view.sight.intrinsics.fx * HALF_DIAGONAL / np.maximum(depth, 0.05)).astype(np.int64)
        radius = np.minimum(radius, max(h, w) // 4)
    needed = depth + clear + CLEARING_SIGMAS * DEPTH_NOISE * (depth / 0.7) ** 2
    least = MIN_WINDOW_DEPTH_SHARE if window else MIN_MIDDLE_DEPTH_SHARE
    measured = view.depth > 0
    passed = np.zeros(len(cells), dtype=np.bool_)
    for r in np.unique(radius[inside]).tolist():
        of = inside & (radius == r)
        u, v = pixels[of].T
        # Only the part of the picture with these cells is filtered.
        y0, y1 = max(int(v.min()) - r, 0), min(int(v.max()) + r + 1, h)
        x0, x1 = max(int(u.min()) - r, 0), min(int(u.max()) + r + 1, w)
        size = (2 * r + 1, 2 * r + 1)
        nearest = cv2.erode(view.reach[y0:y1, x0:x1], np.ones(size, np.uint8))
        known = cv2.blur(measured[y0:y1, x0:x1].astype(np.float32), size)
        passed[of] = (nearest[v - y0, u - x0] > needed[of]) & (known[v - y0, u - x0] >= least)
    return passed
