"""Grasps of things in a heap, from its height map alone: no shape, no catalogue, no random numbers.

The hand is swept over the map by dilation, for each approach and twelve yaws. That gives the lowest height
of the finger tips at each cell. Profiles between the pads rank what is left. Height maps were searched for
places that a hand fits by Fischinger and Vincze (IROS 2012); here its dimensions come from the robot's model.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ...robots.description import GripperDescription
from ...world.belief.height_map import Heap, HeightMap
from ...world.values import Array, Pose
from .grasp_candidates import GraspCandidate
from .hand_shape import Block, HandShape

YAWS = 12
"""Closing directions over half a turn."""
OPENING_SHARES = (1.0, 0.8, 0.6, 0.42, 0.28)
"""Openings of the search as shares of the gripper's greatest one."""
TIP_CLEARANCE, SIDE_CLEARANCE, PALM_CLEARANCE = 0.002, 0.0015, 0.005
"""Clearance below the finger tips, at the sides of the fingers, and around the palm, m."""
WALL_CELLS = 5
"""Width of the square by which walls are enlarged for the hand, cells: the camera may hang 4 mm off."""
MAX_OVERLAP, USEFUL_OVERLAP = 0.028, 0.018
"""Greatest overlap of the pads with a thing, and the one from which on more is no better, m."""
CONTACT_LEVEL, DEEP_LEVEL = 0.003, 0.009
"""Heights above the finger tips at which the sides of a thing are compared, m."""
SAME_CONTACT = 0.003
"""Distance of a row's side from the outermost one up to which the pad touches it, m."""
KEPT_PER_SWEEP, BLOCK = 24, 4
"""Places that are profiled for each yaw and opening, at most one in a block of so many cells squared."""
PROFILE_ROWS, PROFILE_REACH, AXIS_REACH = 4, 22, 20
"""Half-sizes in cells: of a profile across and along the closing direction, and of the search for a thing's
ends."""
FAR_BELOW = np.float32(-1.0)
"""Height outside of the map, m: other checks are made there."""
MAX_CANDIDATES = 48
"""Greatest number of candidates of one stage."""
APART, APART_YAW = 0.008, math.radians(16.0)
"""Distance, m, and turn, rad, below which two grasps are alike: the better one is kept."""

Heights = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Tier:
    """Demands on the profile of a grasp."""

    overlap: float
    """Least overlap of the pads, m."""
    rows: int
    """Least number of rows, of nine, that each pad touches."""
    slope: float
    """Greatest slope of the sides, as distance over height."""
    skew: float
    """Greatest turn of the sides against the pads, as distance over length."""
    room: float
    """Least distance of the open pads from the thing, m."""
    solid: float
    """Least share of the cells between the pads that the thing fills."""


STRICT = Tier(0.011, 5, 0.6, 0.40, 0.003, 0.85)
LOOSE = Tier(0.0075, 3, 1.2, 0.75, 0.002, 0.60)


@dataclass(frozen=True, slots=True)
class Approach:
    """Approach directions that are tried together."""

    name: str
    tilt: float
    """Angle from the vertical, rad."""
    azimuths: int
    """Number of directions into which the hand is tilted."""
    tier: Tier


STAGES: tuple[tuple[Approach, ...], ...] = (
    (Approach("vertical", 0.0, 1, STRICT),),
    (Approach("tilted", math.radians(25.0), 8, STRICT),),
    (
        Approach("vertical, loose", 0.0, 1, LOOSE),
        Approach("tilted, loose", math.radians(25.0), 8, LOOSE),
    ),
    (
        Approach("tilted 20, loose", math.radians(20.0), 8, LOOSE),
        Approach("tilted 40, loose", math.radians(40.0), 8, LOOSE),
    ),
)
"""Approaches from the surest on. The next stage is tried when no grasp of the last one is left."""


@dataclass(frozen=True, eq=False)
class _View:
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


def grasps(
    heap: Heap, gripper: GripperDescription, stages: Sequence[Sequence[Approach]] = STAGES
) -> Iterator[tuple[GraspCandidate, ...]]:
    """Yield the grasps of a heap stage by stage, best first, without those at barred places.

    A stage is computed when it is requested: a vertical one takes about 40 ms, a tilted one 200 ms.
    """
    shape = HandShape.of(gripper)
    for stage in stages:
        found: list[GraspCandidate] = []
        for approach in stage:
            for k in range(approach.azimuths):
                azimuth = 2 * math.pi * k / approach.azimuths
                found += _search(heap.map, shape, approach, azimuth)
        tip = np.array([0.0, 0.0, gripper.tip])
        free = [one for one in found if not heap.bars(one.tcp_in_world.apply(tip))]
        yield tuple(_distinct(sorted(free, key=lambda one: (one.score, one.name))))


def _distinct(ranked: Sequence[GraspCandidate]) -> list[GraspCandidate]:
    """Return the better of each two grasps that are alike, both ways round: half a turn looks the same."""
    kept: list[GraspCandidate] = []
    for one in ranked:
        near = (o for o in kept if math.dist(o.tcp_in_world.position, one.tcp_in_world.position) < APART)
        if all(o.tcp_in_world.angle(one.tcp_in_world) > APART_YAW for o in near):
            kept.append(one)
        if len(kept) == MAX_CANDIDATES // 2:
            break
    turn = Pose(orientation=(0.0, 0.0, 1.0, 0.0))
    turned = (
        replace(one, name=f"{one.name} turned", tcp_in_world=one.tcp_in_world @ turn, score=one.score + 1e-3)
        for one in kept
    )
    return [one for pair in zip(kept, turned, strict=True) for one in pair]


def _view(heap: HeightMap, tilt: float, azimuth: float) -> _View:
    """Return the heap as seen along an approach that is tilted towards `azimuth`, rad."""
    heights, walls = heap.heights(), heap.beside_walls()
    unknown = ~np.isfinite(heights)
    low = max(heap.rim, float(np.nanmax(np.where(walls, -1.0, heights), initial=heap.floor)))
    solid = np.where(unknown, low if unknown.mean() < 0.5 else heap.floor + 0.05, heights)
    near = cv2.dilate(heap.walls().astype(np.uint8), np.ones((WALL_CELLS, WALL_CELLS), np.uint8)) > 0
    solid = np.where(near, np.maximum(solid, heap.rim), solid)
    things = np.where(unknown | walls, heap.floor - 0.01, heights)
    if tilt == 0.0:
        pad = int(0.03 / heap.cell)
        wide = [np.pad(h.astype(np.float32), pad, constant_values=float(FAR_BELOW)) for h in (solid, things)]
        corner = np.full(2, (0.5 - pad) * heap.cell)
        return _View(np.eye(3), corner, heap.cell, wide[0], wide[1])
    lean = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    z = math.cos(tilt) * np.array([0.0, 0.0, 1.0]) + math.sin(tilt) * lean
    x = np.cross([-lean[1], lean[0], 0.0], z)
    axes = np.column_stack([x, np.cross(z, x), z])
    both = [_columns(h, heap.cell, heap.floor) @ axes for h in (solid, things)]
    corner = both[0][:, :2].min(axis=0) - 0.02
    shape = np.ceil((both[0][:, :2].max(axis=0) + 0.02 - corner) / heap.cell).astype(int) + 1
    first, second = (_raster(points, corner, heap.cell, shape) for points in both)
    return _View(axes, corner, heap.cell, first, second)


def _columns(heights: Array, cell: float, floor: float) -> Array:
    """Return points (k, 3) on the tops of columns, and on their sides down to the lowest neighbour, m."""
    n, m = heights.shape
    lowest = np.asarray(cv2.erode(heights, np.ones((3, 3), np.uint8)), np.float64)
    depth: Array = np.ceil((heights - np.maximum(lowest, floor - 0.01)) / cell)
    count: NDArray[np.intp] = np.maximum(1, depth).astype(np.intp).ravel()
    cells: NDArray[np.intp] = np.arange(n * m, dtype=np.intp)
    at: NDArray[np.intp] = np.repeat(cells, count)
    step = np.arange(len(at)) - np.repeat(np.cumsum(count) - count, count)
    z = heights.ravel()[at] - step * cell
    return np.column_stack([(at // m + 0.5) * cell, (at % m + 0.5) * cell, z])


def _raster(points: Array, corner: Array, cell: float, shape: NDArray[np.intp]) -> Heights:
    """Return the greatest height of the points in each cell; gaps between cells take their neighbours'."""
    heights = np.full(int(shape[0] * shape[1]), FAR_BELOW, dtype=np.float32)
    index = np.round((points[:, :2] - corner) / cell).astype(np.intp)
    inside = np.all((index >= 0) & (index < shape), axis=1)
    flat = index[inside, 0] * shape[1] + index[inside, 1]
    np.maximum.at(heights, flat, points[inside, 2].astype(np.float32))
    heights = heights.reshape(int(shape[0]), int(shape[1]))
    around = cv2.dilate(heights, np.ones((3, 3), np.uint8))
    return np.where(heights <= FAR_BELOW, around, heights).astype(np.float32)


def _search(heap: HeightMap, hand: HandShape, approach: Approach, azimuth: float) -> list[GraspCandidate]:
    """Return the grasps along one approach direction."""
    view = _view(heap, approach.tilt, azimuth)
    found: list[GraspCandidate] = []
    for k in range(YAWS):
        found += _Sweep(view, math.pi * k / YAWS, hand, approach, heap).grasps(math.degrees(azimuth))
    return found


class _Sweep:
    """Search of one view for one closing direction, in an image whose columns lie along it."""

    def __init__(self, view: _View, yaw: float, hand: HandShape, approach: Approach, heap: HeightMap) -> None:
        self._view, self._yaw, self._hand, self._approach, self._heap = view, yaw, hand, approach, heap
        n, m = view.solid.shape
        side = math.ceil(math.hypot(n, m))
        # Image pixel (column, row) = (along the closing direction, across it).
        c, s = math.cos(yaw), math.sin(yaw)
        self._to_view = np.array([[c, -s], [s, c]])
        """Turn offsets (along, across) of the image into offsets (x, y) of the view."""
        self._middle, self._centre = (side - 1) / 2, np.array([(n - 1) / 2, (m - 1) / 2])
        # cv2 maps (column, row) of the image to (column, row) of the source: source row is x, column is y.
        matrix = np.array([[s, c, 0.0], [c, -s, 0.0]])
        matrix[:, 2] = self._centre[::-1] - matrix[:, :2] @ np.full(2, self._middle)
        flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
        self.solid, self.things = (
            cv2.warpAffine(
                image, matrix, (side, side), flags=flags, borderMode=cv2.BORDER_CONSTANT, borderValue=-1.0
            )
            for image in (view.solid, view.things)
        )
        self._palm = self._lowest_tip(hand.palm, PALM_CLEARANCE, PALM_CLEARANCE, 0.0)

    def _lowest_tip(self, blocks: Sequence[Block], gap: float, below: float, offset: float) -> Heights:
        """Return the lowest height of the finger tips at which blocks on both sides are free, (n, n) m."""
        cell = self._view.cell
        lowest = np.full(self.solid.shape, FAR_BELOW, dtype=np.float32)
        for block in blocks:
            rows = 2 * math.ceil((block.half_x + gap) / cell) + 1
            inner, outer = offset + block.inner, offset + block.outer + gap
            wide = max(1, math.ceil((outer - inner) / cell) + 1)
            swept = cv2.dilate(self.solid, np.ones((rows, wide | 1), np.uint8)) - np.float32(
                block.above - below
            )
            shift = round((inner + outer) / 2 / cell)
            for sign in (-1, 1):
                lowest = np.maximum(lowest, _shifted(swept, sign * shift))
        return lowest

    def grasps(self, azimuth: float) -> list[GraspCandidate]:
        found: list[GraspCandidate] = []
        for share in OPENING_SHARES:
            found += self._at_opening(share * self._hand.max_width, azimuth)
        return found

    def _at_opening(self, opening: float, azimuth: float) -> list[GraspCandidate]:
        cell, tier = self._view.cell, self._approach.tier
        pad = self._hand.fingers[0]
        lowest = self._lowest_tip(self._hand.fingers, SIDE_CLEARANCE, TIP_CLEARANCE, opening / 2)
        lowest = np.maximum(lowest, self._palm)
        rows = 2 * round(pad.half_x / cell) + 1
        # The middle third alone: what the pads close on is centred.
        wide = max(3, round(opening / 3 / cell)) | 1
        top = cv2.dilate(self.things, np.ones((rows, wide), np.uint8))
        tips = np.maximum(lowest, top - np.float32(MAX_OVERLAP))
        overlap = np.where(tips > FAR_BELOW / 2, top - tips, -1.0)
        allowed = overlap >= tier.overlap
        points, aside = self._points(np.argwhere(allowed), tips[allowed]), opening / 2 * self._closing()
        allowed[allowed] = self._heap.inside(points - aside) & self._heap.inside(points + aside)
        picked = _best_of_blocks(np.minimum(overlap, USEFUL_OVERLAP) + 0.05 * top, allowed)
        if not len(picked):
            return []
        return self._ranked(picked, tips[picked[:, 0], picked[:, 1]], opening, azimuth)

    def _points(self, at: NDArray[np.intp], heights: Array | Heights) -> Array:
        """Return the points (k, 3) in the map's frame of pixels (k, 2) at heights (k,) of the view, m."""
        offsets = (at[:, ::-1] - self._middle) @ self._to_view.T
        across = self._view.corner + (self._centre + offsets) * self._view.cell
        return np.column_stack([across, heights]) @ self._view.axes.T

    def _closing(self) -> Array:
        """Return the closing direction (3,) in the map's frame."""
        return self._view.axes @ np.array([math.cos(self._yaw), math.sin(self._yaw), 0.0])

    def _ranked(
        self, picked: NDArray[np.intp], tips: Heights, opening: float, azimuth: float
    ) -> list[GraspCandidate]:
        """Return the picked places whose profiles meet the tier's demands."""
        cell, tier = self._view.cell, self._approach.tier
        rows = np.arange(-PROFILE_ROWS, PROFILE_ROWS + 1)
        columns = np.arange(-PROFILE_REACH, PROFILE_REACH + 1)
        n = len(self.things)
        r = np.clip(picked[:, 0, None, None] + rows[None, :, None], 0, n - 1)
        c = np.clip(picked[:, 1, None, None] + columns[None, None, :], 0, n - 1)
        patch = self.things[r, c]
        between = np.abs(columns) * cell <= opening / 2
        patch = np.where(between, patch, FAR_BELOW)
        low, high = (patch >= (tips[:, None, None] + level) for level in (CONTACT_LEVEL, DEEP_LEVEL))
        there: NDArray[np.bool_] = np.asarray(low.any(axis=2), dtype=np.bool_)
        sides = [_side(mask, flip, columns) for mask in (low, high) for flip in (False, True)]
        left, right, left_deep, right_deep = sides
        first, last = np.where(there, left, 99).min(axis=1), np.where(there, right, -99).max(axis=1)
        same = SAME_CONTACT / cell
        on_left, on_right = there & (left <= first[:, None] + same), there & (right >= last[:, None] - same)
        slope = (DEEP_LEVEL - CONTACT_LEVEL) / cell
        first_deep = np.where(on_left & high.any(axis=2), left_deep, 99).min(axis=1)
        last_deep = np.where(on_right & high.any(axis=2), right_deep, -99).max(axis=1)
        lean = np.maximum(first_deep - first, last - last_deep) / slope
        skew = np.maximum(_skew(left, on_left, rows), _skew(right, on_right, rows))
        inside = (columns >= first[:, None, None]) & (columns <= last[:, None, None])
        spanned = inside & there[:, :, None]
        filled = np.count_nonzero(low & spanned, axis=(1, 2))
        solid = filled / np.maximum(1, np.count_nonzero(spanned, axis=(1, 2)))
        room = opening / 2 - np.maximum(-first, last) * cell
        touching = np.minimum(on_left.sum(axis=1), on_right.sum(axis=1))
        kept = (touching >= tier.rows) & (lean <= tier.slope) & (skew <= tier.skew)
        kept &= (room >= tier.room) & (solid >= tier.solid)
        top = patch.max(axis=(1, 2))
        overlap = np.minimum(top - tips, USEFUL_OVERLAP)
        off = np.abs(first + last) / 2 * cell
        aside = self._aside(picked, tips)
        width = (last - first + 1) * cell
        score = (
            0.5 * width / self._hand.max_width
            + (USEFUL_OVERLAP - overlap) / 0.012
            + off / 0.02
            + 0.5 * aside / 0.02
            + 0.4 * lean
            + 0.4 * skew
            + (9 - touching) / 18
            + 0.5 * (1.0 - np.minimum(room, 0.012) / 0.012)
            + 0.6 * (float(np.nanmax(self.things)) - top) / 0.05
            + (0.5 if self._approach.tilt else 0.0)
        )
        return [
            self._candidate(picked[k], float(tips[k]), opening, float(width[k]), float(score[k]) / 3, azimuth)
            for k in np.flatnonzero(kept)
        ]

    def _aside(self, picked: NDArray[np.intp], tips: Heights) -> Array:
        """Return the distance of the thing's middle from the pads, across the closing direction, m."""
        reach = np.arange(-AXIS_REACH, AXIS_REACH + 1)
        n = len(self.things)
        r = np.clip(picked[:, 0, None] + reach[None, :], 0, n - 1)
        c = np.clip(picked[:, 1, None, None] + np.arange(-2, 3), 0, n - 1)
        strip = self.things[r[:, :, None], c].max(axis=2) >= tips[:, None] + CONTACT_LEVEL
        ahead = np.logical_and.accumulate(strip[:, AXIS_REACH:], axis=1).sum(axis=1)
        behind = np.logical_and.accumulate(strip[:, AXIS_REACH::-1], axis=1).sum(axis=1)
        return np.abs(ahead - behind) / 2 * self._view.cell

    def _candidate(
        self, at: NDArray[np.intp], tip: float, opening: float, width: float, score: float, azimuth: float
    ) -> GraspCandidate:
        z, closing = self._view.axes[:, 2], self._closing()
        rotation = np.column_stack([np.cross(closing, -z), closing, -z])
        point = self._points(at[None], np.array([tip + self._hand.tip]))[0]
        pose = self._heap.frame @ Pose.from_rotation((point[0], point[1], point[2]), rotation)
        leaning = "" if self._approach.tilt == 0.0 else f" to {azimuth:.0f}"
        name = (
            f"{self._approach.name}{leaning} yaw {math.degrees(self._yaw):.0f} width {opening * 1000:.0f} "
            f"at {point[0] * 1000:.0f} {point[1] * 1000:.0f}"
        )
        return GraspCandidate(
            name, pose, opening, width, SIDE_CLEARANCE / 2, False, score, self._approach.tilt > 0.0
        )


def _shifted(image: Heights, columns: int) -> Heights:
    """Return the image as seen from `columns` further on: out(r, c) = in(r, c + columns)."""
    out = np.full_like(image, FAR_BELOW)
    n = image.shape[1]
    if columns >= 0:
        out[:, : n - columns] = image[:, columns:]
    else:
        out[:, -columns:] = image[:, : n + columns]
    return out


def _best_of_blocks(worth: Array, allowed: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the best allowed cell (k, 2) of each block of cells, of the best blocks only."""
    n = len(worth) // BLOCK
    cut = n * BLOCK
    ranked = np.where(allowed, worth, -np.inf)[:cut, :cut]
    blocks = ranked.reshape(n, BLOCK, n, BLOCK).transpose(0, 2, 1, 3).reshape(n * n, BLOCK * BLOCK)
    best = blocks.max(axis=1)
    order = np.argsort(-best, kind="stable")[:KEPT_PER_SWEEP]
    order = order[np.isfinite(best[order])]
    inner = blocks[order].argmax(axis=1)
    return np.column_stack([order // n * BLOCK + inner // BLOCK, order % n * BLOCK + inner % BLOCK])


def _side(mask: NDArray[np.bool_], last: bool, columns: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the first or last set column (k, rows) of each row."""
    index = (mask[:, :, ::-1] if last else mask).argmax(axis=2)
    return columns[len(columns) - 1 - index] if last else columns[index]


def _skew(side: NDArray[np.intp], touched: NDArray[np.bool_], rows: NDArray[np.intp]) -> Array:
    """Return the slope of a side along the pads (k,), by least squares over the touched rows."""
    count = np.maximum(1, touched.sum(axis=1))
    row = np.where(touched, rows, 0)
    at = np.where(touched, side, 0)
    mean_row, mean_at = row.sum(axis=1) / count, at.sum(axis=1) / count
    spread = (row * row).sum(axis=1) - count * mean_row**2
    shared = (row * at).sum(axis=1) - count * mean_row * mean_at
    return np.abs(shared / np.maximum(spread, 1e-9)) * (spread > 1e-9)
