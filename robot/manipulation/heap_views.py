"""Heights of a heap as seen along an approach of the hand, and profiles between its pads."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from picktree.world import Array, heap_geometry

FAR_BELOW = np.float32(-1.0)
"""Height outside of the map, m: other checks are made there."""
CONTACT_LEVEL, DEEP_LEVEL = 0.001, 0.007
"""Heights above the finger tips at which the sides of a thing are compared, m."""
CONTACT_HEIGHT, MIN_CONTACT = 0.012, 0.004
"""Height of the pad up to which contact counts, and the height from which on a row is touched, m."""

Heights = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class HeapView:
    """Heights of a heap as seen along an approach: solid columns away from the hand."""

    axes: Array
    """Axes of the view in the map's frame, as columns (3, 3); z points back to the hand."""
    corner: Array
    """Middle of cell (0, 0) in the view, (2,) m."""
    cell: float
    solid: Heights
    """Heights of everything (n, n), m; x along rows, y along columns."""
    things: Heights
    """Heights without walls and unknown cells (n, n), m."""

    @cached_property
    def outline(self) -> Array:
        """First and last cells (k, 2) of the rows in which something is."""
        there = self.solid > FAR_BELOW / 2
        rows = np.flatnonzero(there.any(axis=1))
        first = there[rows].argmax(axis=1)
        last = there.shape[1] - 1 - there[rows, ::-1].argmax(axis=1)
        return np.column_stack([np.tile(rows, 2), np.concatenate([first, last])]).astype(np.float64)


def surfaces(heap: heap_geometry.HeightMap) -> tuple[Heights, Heights]:
    """Return the heights (n, m) of all surfaces, and those of seen things alone, m in the map's frame.

    Walls have their known places. Depth next to a wall may be the wall's: no cell there is higher than the
    things beside that strip. Cells that were never seen are as high as the rim.
    """
    heights, walls = heap.heights(), heap.walls()
    unknown, beside = ~np.isfinite(heights), heap.beside_walls()
    heights = np.where(unknown, heap.floor, heights).astype(np.float32)
    side = 2 * round(heap_geometry.WALL_SHADOW / heap.cell) + 1
    inner = cv2.dilate(np.where(beside, np.float32(heap.floor), heights), np.ones((side, side), np.uint8))
    heights = np.where(beside, np.minimum(heights, inner), heights)
    highest = np.float32(max(heap.rim, float(heights.max())))
    solid = np.where(unknown, highest if unknown.mean() < 0.5 else np.float32(heap.floor + 0.05), heights)
    solid = np.where(walls, np.float32(heap.rim), solid)
    return solid, np.where(unknown | walls, np.float32(heap.floor - 0.01), heights)


def heap_view(
    heap: heap_geometry.HeightMap, seen: tuple[Heights, Heights], tilt: float, azimuth: float
) -> HeapView:
    """Return a heap with its `surfaces` as seen along an approach that is tilted towards `azimuth`, rad."""
    solid, things = seen
    if tilt == 0.0:
        corner = np.full(2, 0.5 * heap.cell)
        return HeapView(np.eye(3), corner, heap.cell, solid, things)
    lean = np.array([math.cos(azimuth), math.sin(azimuth)])
    side = np.array([-lean[1], lean[0]])
    n, m = heap.shape
    along, across = np.abs([lean, side]) @ (n, m)
    size = (math.ceil(across), math.ceil(along * math.cos(tilt)))
    # Rows lie along the lean, so far apart that their floors are a cell apart in the view.
    source = np.column_stack([side, lean / math.cos(tilt)])
    matrix = np.zeros((2, 3))
    matrix[:, :2] = source[::-1]
    matrix[:, 2] = (m - 1) / 2, (n - 1) / 2
    matrix[:, 2] -= matrix[:, :2] @ ((np.array(size) - 1) / 2)
    flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    turned = [
        np.asarray(
            cv2.warpAffine(h, matrix, size, flags=flags, borderValue=float(FAR_BELOW)),
            np.float32,
        )
        for h in (solid, things)
    ]
    middle = np.array([n, m]) * heap.cell / 2
    lags = math.ceil(float(solid.max()) * math.sin(tilt) / heap.cell) + 1
    steps: Array = np.arange(size[1], dtype=np.float64) - (size[1] - 1) / 2
    d = np.asarray(steps * heap.cell / math.cos(tilt) + float(middle @ lean), np.float32)
    both = [_sheared(h, d, heap.cell, tilt, lags) for h in turned]
    x = np.array([*(lean * math.cos(tilt)), -math.sin(tilt)])
    z = np.array([*(lean * math.sin(tilt)), math.cos(tilt)])
    axes = np.column_stack([x, [*side, 0.0], z])
    first = middle @ lean * math.cos(tilt) - ((size[1] - 1) / 2 + lags) * heap.cell
    corner = np.array([first, middle @ side - (size[0] - 1) / 2 * heap.cell])
    return HeapView(axes, corner, heap.cell, both[0], both[1])


def _sheared(heights: Heights, d: Heights, cell: float, tilt: float, lags: int) -> Heights:
    """Return the heights along a tilted approach of solid columns in rows at `d` along the lean, m.

    A point of a column appears the more rows before its floor, the higher it is.
    """
    n, m = heights.shape
    out = np.full((n + lags, m), FAR_BELOW, dtype=np.float32)
    step, up = cell / math.sin(tilt), np.float32(math.cos(tilt))
    base = (d * np.float32(math.sin(tilt)))[:, None]
    tops = base + heights * up
    for lag in range(min(lags, math.floor(float(heights.max()) / step + 0.5)) + 1):
        # Of two columns that appear at the same place the higher one is nearer to the hand: it comes later.
        reached = (heights >= np.float32((lag - 0.5) * step)).view(np.uint8)
        raised = np.minimum(tops, base + np.float32((lag + 0.5) * step) * up)
        cv2.copyTo(raised, reached, out[lags - lag : lags - lag + n])
    return out


@dataclass(frozen=True, eq=False)
class Profile:
    """Heights between the pads at places (k,), and the contacts of the closing pads."""

    patch: Heights
    """Heights (k, rows, columns), m; rows lie along the pads, columns along the closing direction."""
    tips: Heights
    """Heights of the finger tips (k,), m."""
    halves: NDArray[np.intp]
    """Half the openings (k,), cells."""
    columns: NDArray[np.intp]
    cell: float

    @cached_property
    def ends(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """First and last columns (k,) that are filled; nothing: first after last."""
        return self._ends(CONTACT_LEVEL)

    def _ends(self, level: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        filled = self.patch.max(axis=1) >= (self.tips + np.float32(level))[:, None]
        last = len(self.columns) - 1 - filled[:, ::-1].argmax(axis=1)
        first, there = filled.argmax(axis=1), filled.any(axis=1)
        return np.where(there, self.columns[first], 1), np.where(there, self.columns[last], -1)

    @cached_property
    def overlap(self) -> Heights:
        """Height of the things above the finger tips (k,), m."""
        return self.patch.max(axis=(1, 2)) - self.tips

    @cached_property
    def room(self) -> Array:
        """Distance of the open pads from the thing (k,), m."""
        first, last = self.ends
        return np.asarray(self.halves - np.maximum(-first, last), np.float64) * self.cell

    @cached_property
    def contact(self) -> Heights:
        """Height of each row that each pad touches (2, k, rows), m."""
        k, most = np.arange(len(self.patch)), len(self.columns) - 1
        found: list[Heights] = []
        for end, inwards in zip(self.ends, (1, -1), strict=True):
            column = end + most // 2
            inner = np.clip(column + inwards, 0, most)
            found.append(np.maximum(self.patch[k, :, column], self.patch[k, :, inner]))
        return np.clip(np.stack(found) - self.tips[:, None], 0.0, CONTACT_HEIGHT)

    @cached_property
    def area(self) -> Array:
        """Area of the pad that touches less (k,), m²."""
        return self.contact.sum(axis=2).min(axis=0) * self.cell

    @cached_property
    def rows(self) -> NDArray[np.intp]:
        """Number of rows of the pad that touches fewer (k,); 0: one does not touch at its middle."""
        touched = self.contact > MIN_CONTACT
        middle = touched.shape[2] // 2
        return (np.count_nonzero(touched, axis=2) * touched[:, :, middle]).min(axis=0)

    @cached_property
    def slope(self) -> Array:
        """Mean slope of both sides (k,), as distance over height."""
        (first, last), (first_deep, last_deep) = self.ends, self._ends(DEEP_LEVEL)
        rise = (DEEP_LEVEL - CONTACT_LEVEL) / self.cell
        return (first_deep - first + last - last_deep) / 2 / rise

    @cached_property
    def solid(self) -> Array:
        """Share of the cells between the ends that are filled (k,)."""
        low = self.patch >= (self.tips + np.float32(CONTACT_LEVEL))[:, None, None]
        first, last = self.ends
        width = (last - first + 1) * low.any(axis=2).sum(axis=1)
        return low.sum(axis=(1, 2)) / np.maximum(1, width)
