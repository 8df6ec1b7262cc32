"""Unknown obstacles as voxel volumes of the belief: unexplained depth adds cells, rays that pass remove them,
hidden cells stay.

A cell is occupied when something unexplained was seen in it or above it, and no ray has passed it since.
Cells stay where the picture shows nothing of them: behind the robot, behind nearer bodies, out of the view. A
newly seen obstacle may extend there: adjacent cells behind the robot, or out of the view, are occupied. They
stay until rays pass them, or until no seen cell is left next to them.

Voxel grid: sets of cells as sorted keys, and the obstacles of the belief that store them. The belief holds
blocks only. Cells are read back from them exactly, so that no second memory can differ from it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TypeAlias, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from picktree.world import (
    Array,
    BeliefObject,
    Body,
    Box,
    ObjectId,
    ObstacleBlock,
    PlanningScene,
    Pose,
    Shape,
    Vector3,
    convex_decomposition,
    extents,
    inside,
)

from . import segmentation
from .segmentation import Pixels, SegmentationInput, connected_patches
from .view import PerceivedView, UnexplainedPatch

MIN_OBSTACLE_CELLS = 6
"""Least number of connected cells in which something was seen; fewer are noise."""
SAME_OBSTACLE_DISTANCE = 0.05
"""Distance to a former obstacle that left its place, within which an unexplained body is the same, m."""

CELL_SIZE: Array = np.array([0.01, 0.01, 0.02])
"""Edge lengths of a cell, m; the world's origin is a corner of one."""
HALF_DIAGONAL = float(np.linalg.norm(CELL_SIZE)) / 2
AnyBody = TypeVar("AnyBody", bound=Body)
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
    return _cells_of_blocks(o.pose.position, o.blocks)


def supposed_cells_of(o: BeliefObject) -> Keys:
    """Return the cells of an obstacle of the belief in which nothing was seen."""
    return _cells_of_blocks(o.pose.position, tuple(block for block in o.blocks if block.supposed))


@lru_cache(maxsize=256)
def _cells_of_blocks(position: Vector3, blocks: tuple[ObstacleBlock, ...]) -> Keys:
    if not blocks:
        return NO_CELLS
    keys = cell_keys(np.concatenate([_cells(block, np.array(position)) for block in blocks]))
    keys.flags.writeable = False
    return keys


def _cells(block: ObstacleBlock, origin: Array) -> Indices:
    """Return the cells of a block of a body at `origin` (3,)."""
    middle, half = origin + block.at, np.array(block.size) / 2
    first = np.round((middle - half) / CELL_SIZE).astype(np.int64)
    last = np.round((middle + half) / CELL_SIZE).astype(np.int64)
    return _span(first, last)


def obstacle_from_cells(
    seen: Sequence[tuple[Indices, Indices]], supposed: Sequence[tuple[Indices, Indices]] = ()
) -> tuple[Shape, Pose, tuple[ObstacleBlock, ...]]:
    """Build an obstacle: the enclosing shape, its pose in the world, and each box as a block in it.

    In the `supposed` boxes nothing was seen. A box is its first cell and the one after its last, (3,) each.
    The enclosing shape is the convex hull where that wastes little, otherwise the bounding box.
    """
    boxes = [*seen, *supposed]
    first = np.min([low for low, _ in boxes], axis=0)
    last = np.max([high for _, high in boxes], axis=0)
    middle = (first + last) * CELL_SIZE / 2
    blocks = tuple(
        ObstacleBlock(
            _vector((high - low) * CELL_SIZE), _vector((low + high) * CELL_SIZE / 2 - middle), n >= len(seen)
        )
        for n, (low, high) in enumerate(boxes)
    )
    return _enclosing_shape(blocks), Pose(_vector(middle)), blocks


def _enclosing_shape(blocks: Sequence[ObstacleBlock]) -> Shape:
    """Return the hull if a single one encloses all blocks, else their bounding box."""
    hull = convex_decomposition.hull_of(blocks)
    if hull is not None:
        return hull
    middles, halves = np.array([block.at for block in blocks]), np.array([block.size for block in blocks]) / 2
    return Box(_vector((middles + halves).max(axis=0) - (middles - halves).min(axis=0)))


def _span(first: Indices, last: Indices) -> Indices:
    """Return all cells from `first` (3,) to `last` (3,), `last` excluded."""
    x, y, z = (max(0, int(n)) for n in last - first)
    return first + np.argwhere(np.ones((x, y, z), dtype=np.bool_)).astype(np.int64)


def _vector(numbers: Array) -> tuple[float, float, float]:
    x, y, z = (round(float(n), 6) for n in numbers)
    return x, y, z


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


def points_of(picture: SegmentationInput | PerceivedView, rows: Pixels, columns: Pixels) -> Array:
    """Return the points (n, 3) of the world that the pixels show, m."""
    rays = picture.sight.directions(np.stack([columns, rows], axis=1).astype(np.float64))
    return picture.sight.origin + rays * picture.depth[rows, columns][:, None]


PIXEL_HALF_WIDTH = 1.0
"""Half width of the square that each pixel covers, pixels: at edges every second pixel is lost. With 2 pixels
volumes were 5 mm wider all round; with half a pixel 1 % of a post was left out."""
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


UNSEEN_REACH = 0.05
"""Distance over which an obstacle may extend where the picture shows nothing, m."""
ROBOT_MARGIN = 0.03
"""Distance from the robot within which nothing else is supposed, m."""
MIN_CELL_DEPTH = 0.05
"""Least depth of a cell that a picture shows, m."""
_SIDES = np.array([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)])


def unseen_cells(view: PerceivedView, cells: Keys) -> Keys:
    """Return the cells into which an obstacle of the given cells may extend, where the picture shows nothing.

    They are at the same heights, are connected to the cells, and are at most UNSEEN_REACH away, behind the
    robot or beyond the picture's edge. No ray passes them.
    """
    reached, front = cells, cells
    for _ in range(round(UNSEEN_REACH / float(CELL_SIZE[0]))):
        around = (cell_indices(front)[:, None, :] + _SIDES[None]).reshape(-1, 3)
        beside = np.setdiff1d(cell_keys(around), reached, assume_unique=True)
        # A cell and those above and below it: `>>` leaves their place on the table.
        front = beside[np.isin(beside >> _BITS, beside[_outside_view(view, beside)] >> _BITS)]
        front = front[~_cells_passed_by_rays(view, front, 0.0, window=False)]
        front = front[~view.robot(cell_centres(front), ROBOT_MARGIN)]
        reached = np.union1d(reached, front)
        if not len(front):
            break
    return np.setdiff1d(reached, cells, assume_unique=True)


def _outside_view(view: PerceivedView, cells: Keys) -> NDArray[np.bool_]:
    """Select the cells (n,) behind the robot or beyond the picture's edge, above their supports."""
    points = cell_centres(cells)
    depth, pixels, inside = _projected(view, cells)
    unseen = ~inside
    within = np.flatnonzero(inside)
    columns, rows = pixels[within].T
    # Before the robot a ray passes, too.
    unseen[within] = (view.reach[rows, columns] == 0) & (depth[within] > view.depth[rows, columns])
    return unseen & (points[:, 2] > view.supports(points))


def _projected(view: PerceivedView, cells: Keys) -> tuple[Array, Indices, NDArray[np.bool_]]:
    """Return depths (n,) of the cells' middles, m, their pixels (n, 2), and whether the picture has them."""
    points = cell_centres(cells)
    depth = (points - view.sight.origin) @ view.sight.rotation[:, 2]
    pixels = np.round(view.sight.pixels(points)).astype(np.int64)
    h, w = view.reach.shape
    inside = (depth > MIN_CELL_DEPTH) & (pixels >= 0).all(axis=1) & (pixels < (w, h)).all(axis=1)
    return depth, pixels, inside


def in_picture(view: PerceivedView, cells: Keys) -> NDArray[np.bool_]:
    """Select the cells (n,) whose middles are within the picture, hidden or not."""
    return _projected(view, cells)[2]


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
    offsets = PIXEL_HALF_WIDTH * np.array([(0.0, 0.0), (-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)])
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
    depth, pixels, inside = _projected(view, cells)
    h, w = view.reach.shape
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


Grid = NDArray[np.bool_]
Span = tuple[Indices, Indices]
"""First cell of a box and the one after its last, (3,) each."""


def merge_cells(packed: Keys) -> list[Span]:
    """Cover the cells with boxes that contain nothing else.

    Greedy: from the first cell that is not covered yet the larger of two boxes is taken. One grows upwards
    and then along x and y, the other along y and x. Boxes may overlap, which reduces their number.
    """
    if not len(packed):
        return []
    cells = cell_indices(packed)
    origin = cells.min(axis=0)
    filled: Grid = np.zeros(tuple(cells.max(axis=0) - origin + 1), dtype=np.bool_)
    filled[tuple((cells - origin).T)] = True
    left = filled.copy()
    spans: list[Span] = []
    while left.any():
        seed = np.array(np.unravel_index(int(left.argmax()), left.shape), dtype=np.int64)
        low, high = max(
            (_grow_box(filled, seed, order) for order in ((2, 0, 1), (2, 1, 0))),
            key=lambda span: int(np.prod(span[1] - span[0])),
        )
        left[tuple(slice(a, b) for a, b in zip(low.tolist(), high.tolist(), strict=True))] = False
        spans.append((low, high))
    return [(low + origin, high + origin) for low, high in spans]


def _grow_box(filled: Grid, seed: Indices, order: tuple[int, ...]) -> Span:
    """Grow the box about one cell along the axes in this order, as long as all of it is filled."""
    low, high = seed.copy(), seed + 1
    for axis in order:
        sides = [slice(a, b) for a, b in zip(low.tolist(), high.tolist(), strict=True)]
        sides[axis] = slice(None)
        others = tuple(k for k in range(3) if k != axis)
        full = np.all(filled[tuple(sides)], axis=others)
        empty = np.flatnonzero(~full)
        at = int(seed[axis])
        below, above = empty[empty < at], empty[empty > at]
        low[axis] = below[-1] + 1 if len(below) else 0
        high[axis] = above[0] if len(above) else len(full)
    return low, high


ITEM_MARGIN = 0.003
"""Distance from a recognised item within which the middles of cells belong to it, m."""
MAX_NOISE_SHARE = 0.03
"""Greatest share of new cells at the surface, and of cells that are gone, that is put down to noise."""
MIN_ITEM_SHARE = 0.4
"""Least share of an obstacle's cells in a recognised item at which the obstacle was that item."""
REASON_FIRST_SEEN = "depth that nothing explains"
REASON_SEEN_AGAIN = "seen again"
REASON_GREW = "more of it was seen"
REASON_CLEARED = "rays pass through parts of it"
REASON_CHANGED = "it was seen to take up other space"
REASON_GONE = "its place was seen without it"


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """Connected cells, and the patches of the view that show them."""

    cells: Keys
    patches: tuple[UnexplainedPatch, ...]


def update_volumes(
    scene: PlanningScene,
    view: PerceivedView,
    patches: Sequence[UnexplainedPatch],
    items: Sequence[BeliefObject],
    now: float,
) -> list[ObjectId]:
    """Update the obstacles of `scene` with a view; `items` are those that the view shows. Returns the ids of
    removed obstacles."""
    former = {o.id: cells_of(o) for o in scene.objects if o.role == "obstacle" and not o.attached}
    if not former and not patches:
        return []
    new = _outside_items(occupied_cells(view, patches), items)
    kept = {
        name: _outside_items(retained_cells(view, _unless_item(cells, items)), items)
        for name, cells in former.items()
    }
    hidden = _hidden_parts(scene, view, new, former.values())
    still = np.concatenate([NO_CELLS, *kept.values()])
    before = _supposed(scene, former)
    # A pixel at the border reaches beyond the picture. No ray would ever pass what it takes up there.
    shown = np.union1d(new[in_picture(view, new)], np.setdiff1d(still, before))
    cells = np.unique(np.concatenate([new, hidden, still]))
    supposed = np.setdiff1d(np.union1d(cells, before), shown)
    seen = _components(cells, supposed, view, patches)
    names = _match_former(seen, former)
    for name, each in zip(names, seen, strict=True):
        _store_obstacle(
            scene,
            name or scene.new_id("obstacle"),
            each,
            former.get(name, NO_CELLS) if name else NO_CELLS,
            supposed,
            now,
        )
    gone = [name for name in former if name not in names]
    for name in gone:
        scene.remove(name, REASON_GONE)
    return gone


def _supposed(scene: PlanningScene, names: Iterable[ObjectId]) -> Keys:
    """Return the cells of these obstacles in which nothing was seen yet."""
    return np.unique(np.concatenate([NO_CELLS, *(supposed_cells_of(scene.get(name)) for name in names)]))


def _hidden_parts(scene: PlanningScene, view: PerceivedView, new: Keys, former: Iterable[Keys]) -> Keys:
    """Return the cells that new parts of obstacles may take up where the picture shows nothing.

    New cells next to former ones do not count: the space behind them was evaluated before, and the rim of an
    obstacle comes and goes.
    """
    known = np.unique(np.concatenate([NO_CELLS, *former]))
    fresh = new[~adjacent_cells(new, known)] if len(known) else new
    items = [o for o in scene.objects if o.role == "item"]
    return _outside_items(unseen_cells(view, fresh), items) if len(fresh) else NO_CELLS


def bodies_near(cells: Keys, bodies: Iterable[AnyBody], margin: float) -> list[AnyBody]:
    """Return the bodies that may contain a cell within `margin` m, by their bounding spheres."""
    if not len(cells):
        return []
    points = cell_centres(cells)
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin

    def may_touch(body: Body) -> bool:
        radius = float(np.linalg.norm(np.maximum(*np.abs(extents(body.shape, np.eye(3))))))
        at = np.array(body.pose.position)
        return bool((at + radius >= low).all() and (at - radius <= high).all())

    return [body for body in bodies if may_touch(body)]


def _outside_items(cells: Keys, items: Sequence[BeliefObject]) -> Keys:
    for item in bodies_near(cells, items, ITEM_MARGIN):
        cells = cells[~inside(item.shape, item.pose, cell_centres(cells), ITEM_MARGIN)]
    return cells


def _unless_item(cells: Keys, items: Sequence[BeliefObject]) -> Keys:
    """Return no cells when they were a recognised item: cells that it hides now are not kept."""
    points = cell_centres(cells)
    for item in bodies_near(cells, items, float(CELL_SIZE[0])):
        if inside(item.shape, item.pose, points, float(CELL_SIZE[0])).mean() > MIN_ITEM_SHARE:
            return NO_CELLS
    return cells


def _components(
    cells: Keys, supposed: Keys, view: PerceivedView, patches: Sequence[UnexplainedPatch]
) -> list[_Seen]:
    """Group cells that are connected as seen from above, the largest group first.

    A group needs seen cells: supposed cells go with the last seen cells next to them.
    """
    if not len(cells):
        return []
    mark = _groups(cells)
    groups = [cells[mark == k] for k in range(1, int(mark.max()) + 1)]
    groups = [g for g in groups if np.isin(g, supposed, invert=True).sum() >= MIN_OBSTACLE_CELLS]
    groups.sort(key=lambda g: (-len(g), int(g[0])))
    surfaces = [(patch, surface_of(view, patch)) for patch in patches]
    return [
        _Seen(g, tuple(patch for patch, surface in surfaces if len(np.intersect1d(g, surface)) > 0))
        for g in groups
    ]


def _groups(cells: Keys) -> NDArray[np.intp]:
    """Number the groups of cells that are connected as seen from above, from 1: that of each cell (n,)."""
    columns = cell_indices(cells)[:, :2]
    origin = columns.min(axis=0)
    at = tuple((columns - origin).T)
    plan = np.zeros(tuple(columns.max(axis=0) - origin + 1), dtype=np.uint8)
    plan[at] = 1
    _, marks = cv2.connectedComponents(cv2.dilate(plan, np.ones((3, 3), np.uint8)), connectivity=8)
    return np.asarray(marks, dtype=np.intp)[at]


def _match_former(seen: Sequence[_Seen], former: dict[ObjectId, Keys]) -> list[ObjectId | None]:
    """Match each group to the id of a former obstacle; None for a new one.

    The former obstacle that shares most cells comes first, then one close by that shares none with any.
    """
    shared = [
        (len(np.intersect1d(each.cells, cells)), n, name)
        for n, each in enumerate(seen)
        for name, cells in former.items()
    ]
    names: list[ObjectId | None] = [None] * len(seen)
    left = list(former)
    for count, n, name in sorted(shared, key=lambda s: -s[0]):
        if count > 0 and names[n] is None and name in left:
            names[n] = name
            left.remove(name)
    for n, each in enumerate(seen):
        if names[n] is None and left:
            middle = cell_centres(each.cells).mean(axis=0)
            away = {
                name: float(np.linalg.norm(cell_centres(former[name]).mean(axis=0) - middle)) for name in left
            }
            nearest = min(left, key=lambda name: (away[name], name))
            if away[nearest] < SAME_OBSTACLE_DISTANCE:
                names[n] = nearest
                left.remove(nearest)
    return names


def _store_obstacle(
    scene: PlanningScene, name: ObjectId, seen: _Seen, before: Keys, supposed: Keys, now: float
) -> None:
    known = scene.find(name)
    cells = seen.cells
    if known is not None:
        gone = np.setdiff1d(before, cells, assume_unique=True)
        # Edges come and go with the noise: cells next to occupied ones stay occupied.
        cells = np.union1d(cells, gone[adjacent_cells(gone, cells)])
        found = np.setdiff1d(np.intersect1d(supposed_cells_of(known), cells), supposed)
        if _is_unchanged(cells, before) and len(found) <= MAX_NOISE_SHARE * len(cells):
            if seen.patches:
                scene.put(replace(known, last_seen=now), REASON_SEEN_AGAIN)
            return
    assumed = np.isin(cells, supposed)
    shape, pose, blocks = obstacle_from_cells(merge_cells(cells[~assumed]), merge_cells(cells[assumed]))
    colour = _colour(seen.patches) or (known.colour if known is not None else "grey")
    last_seen = now if seen.patches or known is None else known.last_seen
    belief = BeliefObject(
        "unknown",
        "unknown",
        shape,
        colour,
        pose,
        0.005,
        0.1,
        0.5,
        last_seen,
        id=name,
        role="obstacle",
        blocks=blocks,
    )
    scene.put(belief, _reason(cells, before))


def _is_unchanged(cells: Keys, before: Keys) -> bool:
    """Whether nothing is new and nothing is gone, apart from noise: few cells at the surface."""
    new = np.setdiff1d(cells, before, assume_unique=True)
    gone = np.setdiff1d(before, cells, assume_unique=True)
    if len(new) > MAX_NOISE_SHARE * len(cells) or len(gone) > MAX_NOISE_SHARE * len(before):
        return False
    return bool(adjacent_cells(new, before).all()) and _largest_group(gone) < MIN_OBSTACLE_CELLS


def _largest_group(cells: Keys) -> int:
    """Return the number of cells of the largest group that is connected as seen from above."""
    return 0 if not len(cells) else int(np.bincount(_groups(cells)).max())


def _reason(cells: Keys, before: Keys) -> str:
    if not len(before):
        return REASON_FIRST_SEEN
    more = len(np.setdiff1d(cells, before, assume_unique=True)) > 0
    less = len(np.setdiff1d(before, cells, assume_unique=True)) > 0
    return REASON_CHANGED if more and less else REASON_CLEARED if less else REASON_GREW


def _colour(patches: Sequence[UnexplainedPatch]) -> str | None:
    """Colour of the largest patch; None without patches."""
    largest = max(patches, key=lambda patch: len(patch.rows), default=None)
    return None if largest is None else largest.colour
