"""Grasps of things in a heap, from its height map alone: no shape, no catalogue, no random numbers.

The hand is swept over the map by dilation, for each approach and twelve yaws. That gives the lowest height of
the finger tips at each cell. Profiles between the pads rank the remaining places. Height maps were searched
for places that a hand fits by Fischinger and Vincze (IROS 2012); here its dimensions come from the robot's
model.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from picktree.robot.perception import LABEL_NAMES
from picktree.world import Array, Pose, heap_geometry
from picktree.world.robot_model import GripperDescription

from .grasps import Block, GraspCandidate, HandShape
from .heap_views import CONTACT_LEVEL, FAR_BELOW, HeapView, Heights, Profile, heap_view, surfaces

OPENING_SHARES = (1.0, 0.75, 0.5, 0.3)
"""Openings of the search as shares of the gripper's greatest one."""
TIP_CLEARANCE, SIDE_CLEARANCE, PALM_CLEARANCE = 0.002, 0.0015, 0.002
"""Clearance below the finger tips, at the sides of the fingers, and around the palm, m."""
MAX_OVERLAP, MIN_OVERLAP = 0.028, 0.009
"""Greatest and least overlap of the pads with a thing, m."""
FULL_AREA, FULL_WIDTH, FULL_OVERLAP = 216e-6, 0.024, 0.015
"""Area, m², width and overlap, m, from which on more is no better."""
MIN_ROWS, MIN_ROOM, MAX_SLOPE = 4, 0.002, 0.8
"""Least rows, of nine, that each pad touches. Least distance of the open pads from the thing, m. Greatest
mean slope of its sides, as distance over height."""
MAX_PLACES_PER_SWEEP, BLOCK_EDGE, MAX_GRASPS_PER_YAW = 16, 4, 8
"""Places that are profiled for each yaw and opening, at most one in a block of so many cells squared. Grasps
that are kept for each yaw."""
MIXED_COST = 3.0
"""Cost of the share of colours between the pads other than the most frequent one: two things come at once."""
SAMPLED_ROWS, SAMPLED_SHARES, SAMPLED_HEIGHT = (-4, -2, 0, 2, 4), np.linspace(-0.45, 0.45, 9), 0.005
"""Places at which colours between the pads are sampled: rows, shares of the thing's width, and height above
the finger tips, m."""
MIN_SAMPLED = 0.008
"""Least width in which colours are sampled, m."""
CENTRINGS = 2
"""Number of times that the hand is moved to the middle of the thing between the pads."""
PROFILE_ROWS, PROFILE_REACH, AXIS_REACH = 4, 20, 20
"""Half-sizes in cells: of a profile across and along the closing direction, and of the search for a thing's
ends."""
MAX_CANDIDATES = 48
"""Greatest number of candidates of one stage."""
MIN_GRASP_DISTANCE, MIN_GRASP_YAW = 0.008, math.radians(16.0)
"""Distance, m, and turn, rad, below which two grasps are alike: the better one is kept."""


@dataclass(frozen=True, slots=True)
class Tier:
    """Demands on the profile of a grasp."""

    area: float
    """Least area of each pad that touches, m²."""
    overlap: float
    """Least overlap of the pads, m."""
    solid: float
    """Least share of the cells between the pads that the thing fills."""
    score: float = math.inf
    """Greatest score."""


STRICT_TIER = Tier(90e-6, 0.012, 0.85)
SURE_TIER, SURE_TILTED_TIER = replace(STRICT_TIER, score=1.35), replace(STRICT_TIER, score=1.1)
"""Scores up to which nearly all grasps hold: these come first, independent of other things near."""
LOOSE_TIER = Tier(65e-6, MIN_OVERLAP, 0.60)


@dataclass(frozen=True, slots=True)
class Approach:
    """Approach directions that are tried together."""

    name: str
    tilt: float
    """Angle from the vertical, rad."""
    leans: int
    """Number of directions over a whole turn into which the hand is tilted."""
    closings: tuple[float, ...]
    """Closing directions, from the lean, rad."""
    cost: float
    """Cost of the approach in the score of a grasp: tilted hands lose more."""


VERTICAL = Approach("vertical", 0.0, 1, tuple(math.pi * k / 12 for k in range(12)), 0.0)
TILTED = Approach("tilted", math.radians(25.0), 24, (math.pi / 2,), 0.3)
MORE_TILTED = Approach("tilted 45", math.radians(45.0), 24, (math.pi / 2,), 0.8)
"""Hands that close across their lean: the pads stay parallel to upright sides."""
OVER_RIM = Approach("tilted 35", math.radians(35.0), 16, (0.0, math.pi / 4, 3 * math.pi / 4), 0.8)
"""Hands of which one side is higher than the other: the palm reaches over a wall."""
STAGES: tuple[tuple[Tier, tuple[Approach, ...]], ...] = (
    (SURE_TIER, (VERTICAL,)),
    (SURE_TILTED_TIER, (TILTED, MORE_TILTED)),
    (STRICT_TIER, (VERTICAL, TILTED, MORE_TILTED)),
    (LOOSE_TIER, (VERTICAL, TILTED, MORE_TILTED)),
    (LOOSE_TIER, (OVER_RIM,)),
)
"""Approaches from the surest on. The next stage is tried when no grasp of the last one is left."""


@dataclass(frozen=True, slots=True)
class _Graded:
    """Place of a grasp with the measures of its profile."""

    sweep: _Sweep
    at: tuple[int, int]
    """Row and column of the sweep's image."""
    tips: float
    """Height of the finger tips in the sweep's view, m."""
    half: int
    """Half the opening, cells."""
    width: float
    score: float
    area: float
    overlap: float
    solid: float
    """Area, m², overlap, m, and solid share of its profile."""

    def meets(self, tier: Tier) -> bool:
        enough = self.area >= tier.area and self.overlap >= tier.overlap and self.solid >= tier.solid
        return enough and self.score <= tier.score


def grasps(
    heap: heap_geometry.Heap,
    gripper: GripperDescription,
    stages: Sequence[tuple[Tier, Sequence[Approach]]] = STAGES,
) -> Iterator[tuple[GraspCandidate, ...]]:
    """Yield the grasps of a heap stage by stage, best first, without those at barred places.

    An approach is searched when a stage with it is requested.
    """
    shape = HandShape.of(gripper)
    searched: dict[Approach, list[_Graded]] = {}
    for tier, approaches in stages:
        found: list[_Graded] = []
        for approach in approaches:
            if approach not in searched:
                searched[approach] = _search(heap.map, shape, approach)
            found += [one for one in searched[approach] if one.meets(tier)]
        ranked = (one.sweep.candidate(one) for one in sorted(found, key=lambda one: one.score))
        yield tuple(_distinct(ranked, heap, np.array([0.0, 0.0, gripper.tip])))


def colour_between(heap: heap_geometry.HeightMap, tcp: Pose, tip: float, width: float) -> str:
    """Return the most frequent colour between the pads; `grey` without any colour.

    `tcp`: TCP in the map's frame; `tip`: reach of the finger tips beyond it, m; `width`: opening, m.
    """
    x, y = np.meshgrid(np.array(SAMPLED_ROWS) * heap.cell, SAMPLED_SHARES * max(width, MIN_SAMPLED))
    points = tcp.apply(np.column_stack([x.ravel(), y.ravel(), np.full(x.size, tip - SAMPLED_HEIGHT)]))
    counts = np.bincount(heap.labels_at(points), minlength=len(LABEL_NAMES))[1:]
    return LABEL_NAMES[1 + int(counts.argmax())] if counts.any() else "grey"


def _distinct(ranked: Iterable[GraspCandidate], heap: heap_geometry.Heap, tip: Array) -> list[GraspCandidate]:
    """Return the better of each two grasps that are alike, both ways round: half a turn looks the same.

    Grasps at barred places are left out.
    """
    kept: list[GraspCandidate] = []
    for one in ranked:
        near = (
            o
            for o in kept
            if math.dist(o.tcp_in_world.position, one.tcp_in_world.position) < MIN_GRASP_DISTANCE
        )
        if all(o.tcp_in_world.angle(one.tcp_in_world) > MIN_GRASP_YAW for o in near) and not heap.bars(
            one.tcp_in_world.apply(tip)
        ):
            kept.append(one)
        if len(kept) == MAX_CANDIDATES // 2:
            break
    turn = Pose(orientation=(0.0, 0.0, 1.0, 0.0))
    turned = (
        replace(one, name=f"{one.name} turned", tcp_in_world=one.tcp_in_world @ turn, score=one.score + 1e-3)
        for one in kept
    )
    return [one for pair in zip(kept, turned, strict=True) for one in pair]


def _search(heap: heap_geometry.HeightMap, hand: HandShape, approach: Approach) -> list[_Graded]:
    """Return the grasps along the approach's directions that meet the loosest demands."""
    found: list[_Graded] = []
    seen = surfaces(heap)
    for k in range(approach.leans):
        view = heap_view(heap, seen, approach.tilt, 2 * math.pi * k / approach.leans)
        leaning = f"{approach.name} to {360.0 * k / approach.leans:.0f}" if approach.tilt else approach.name
        for yaw in approach.closings:
            found += _Sweep(view, yaw, hand, leaning, heap, approach.cost).grasps()
    return found


class _Sweep:
    """Search of one view for one closing direction, in an image whose columns lie along it."""

    def __init__(
        self,
        view: HeapView,
        yaw: float,
        hand: HandShape,
        name: str,
        heap: heap_geometry.HeightMap,
        cost: float,
    ) -> None:
        self._view, self._yaw, self._hand, self._name, self._heap = view, yaw, hand, name, heap
        self._cost = cost
        # Image pixel (column, row) = (along the closing direction, across it).
        c, s = math.cos(yaw), math.sin(yaw)
        self._to_view = np.array([[c, -s], [s, c]])
        """Turn offsets (along, across) of the image into offsets (x, y) of the view."""
        outline = view.outline @ self._to_view
        low, high = outline.min(axis=0), outline.max(axis=0)
        along, across = np.ceil(high - low).astype(int) + 1
        size = (int(along), int(across))
        self._middle = (np.array(size) - 1) / 2
        self._centre = self._to_view @ ((low + high) / 2)
        # cv2 maps (column, row) of the image to (column, row) of the source: source row is x, column is y.
        matrix = np.array([[s, c, 0.0], [c, -s, 0.0]])
        matrix[:, 2] = self._centre[::-1] - matrix[:, :2] @ self._middle
        flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
        self.solid, self.things = (
            cv2.warpAffine(image, matrix, size, flags=flags, borderMode=cv2.BORDER_CONSTANT, borderValue=-1.0)
            for image in (view.solid, view.things)
        )
        across = 2 * round(hand.fingers[0].half_x / view.cell) + 1
        self._top = cv2.dilate(self.things, np.ones((across, 1), np.uint8))
        """Height of the highest thing across the pads, (n, m) m."""
        self._halves = [round(share * hand.max_width / 2 / view.cell) for share in OPENING_SHARES]
        """Half the openings, cells."""
        palm = self._swept(hand.palm, PALM_CLEARANCE, PALM_CLEARANCE, (-1, 1))
        left, right = (self._swept(hand.fingers, SIDE_CLEARANCE, TIP_CLEARANCE, (side,)) for side in (-1, 1))
        self._lowest = np.stack(
            [
                np.maximum(palm, np.maximum(_shifted(left, -half), _shifted(right, half)))
                for half in self._halves
            ]
        )
        """Lowest height of the finger tips at which the hand is free, for each opening, (k, n, m) m."""

    def _swept(self, blocks: Sequence[Block], gap: float, below: float, sides: Sequence[int]) -> Heights:
        """Return the lowest heights of the finger tips at which blocks are free, (n, m) m.

        The blocks reach from the pad's face, or from the middle of the hand, to the given sides.
        """
        swept: list[Heights] = []
        for block in blocks:
            rows, wide = (math.ceil((reach + gap) / self._view.cell) for reach in (block.half_x, block.outer))
            left, right = wide * (-1 in sides), wide * (1 in sides)
            kernel = np.ones((2 * rows + 1, left + right + 1), np.uint8)
            above = np.float32(block.above - below)
            swept.append(cv2.dilate(self.solid, kernel, anchor=(left, rows)) - above)
        return np.maximum.reduce(swept)

    def grasps(self) -> list[_Graded]:
        """Return the graded grasps of this closing direction, with the hand centred on the gripped thing."""
        picked = np.concatenate([self._places(k) for k in range(len(self._halves))])
        for _ in range(CENTRINGS):
            picked = np.unique(self._inside(picked), axis=0)
            if not len(picked):
                return []
            first, last = self._profile(picked).ends
            picked[:, 2] += np.round((first + last) / 2 * (first <= last)).astype(np.intp)
        picked = np.unique(self._inside(picked), axis=0)
        return self._graded(picked) if len(picked) else []

    def _inside(self, picked: NDArray[np.intp]) -> NDArray[np.intp]:
        """Select the places (k, 3) of the image where both pads are within the walls."""
        n, m = self.things.shape
        k, row, column = picked.T
        picked = picked[(row >= 0) & (row < n) & (column >= 0) & (column < m)]
        k, row, column = picked.T
        points = self._points(picked[:, 1:], self._tips(picked))
        aside = (np.array(self._halves)[k] * self._view.cell)[:, None] * self._closing()
        return picked[self._heap.inside(points - aside) & self._heap.inside(points + aside)]

    def _places(self, k: int) -> NDArray[np.intp]:
        """Return the best places (n, 3) of an opening: its index, row and column of the image."""
        half, m = self._halves[k], self.things.shape[1]
        # The middle third alone: what the pads close on is about centred.
        top = cv2.dilate(self._top, np.ones((1, max(3, 2 * half // 3) | 1), np.uint8))
        lowest = np.maximum(self._lowest[k], top - np.float32(MAX_OVERLAP), out=self._lowest[k])
        at = np.flatnonzero((top - lowest >= np.float32(MIN_OVERLAP)) & (lowest > FAR_BELOW / 2))
        top = top.ravel()[at]
        worth = np.minimum(top - lowest.ravel()[at], 0.018) + 0.05 * top
        order = np.argsort(-worth, kind="stable")
        row, column = np.divmod(at[order], m)
        kept = np.sort(np.unique(row // BLOCK_EDGE * m + column // BLOCK_EDGE, return_index=True)[1])[
            :MAX_PLACES_PER_SWEEP
        ]
        return np.column_stack([np.full(len(kept), k), row[kept], column[kept]])

    def _profile(self, picked: NDArray[np.intp]) -> Profile:
        """Return the profiles of places (k, 3)."""
        n, m = self.things.shape
        rows = np.arange(-PROFILE_ROWS, PROFILE_ROWS + 1)
        columns = np.arange(-PROFILE_REACH, PROFILE_REACH + 1)
        r, c = picked[:, 1, None] + rows, picked[:, 2, None] + columns
        patch = self.things[np.clip(r, 0, n - 1)[:, :, None], np.clip(c, 0, m - 1)[:, None, :]]
        halves = np.array(self._halves)[picked[:, 0]]
        between = np.abs(columns) <= halves[:, None]
        patch = np.where(between[:, None, :], patch, FAR_BELOW)
        return Profile(patch, self._tips(picked), halves, columns, self._view.cell)

    def _tips(self, picked: NDArray[np.intp]) -> Heights:
        """Return the heights (k,) of the finger tips at places (k, 3), m."""
        return self._lowest[picked[:, 0], picked[:, 1], picked[:, 2]]

    def _points(self, at: NDArray[np.intp] | Array, heights: Array | Heights) -> Array:
        """Return the points (k, 3) in the map's frame of pixels (k, 2) at heights (k,) of the view, m."""
        offsets = (at[:, ::-1] - self._middle) @ self._to_view.T
        across = self._view.corner + (self._centre + offsets) * self._view.cell
        return np.column_stack([across, heights]) @ self._view.axes.T

    def _closing(self) -> Array:
        """Return the closing direction (3,) in the map's frame."""
        return self._view.axes @ np.array([math.cos(self._yaw), math.sin(self._yaw), 0.0])

    def _graded(self, picked: NDArray[np.intp]) -> list[_Graded]:
        """Return the places whose profiles meet the loosest demands, the best ones first."""
        profile, cell = self._profile(picked), self._view.cell
        first, last = profile.ends
        area, overlap, slope, solid, room = (
            profile.area, profile.overlap, profile.slope, profile.solid, profile.room
        )  # fmt: skip
        off, width = np.abs(first + last) / 2 * cell, (last - first + 1) * cell
        score = (
            self._cost
            + 2.0 * np.maximum(0.0, 1.0 - area / FULL_AREA)
            + np.maximum(0.0, 1.0 - width / FULL_WIDTH)
            + 2.0 * np.maximum(0.0, 1.0 - overlap / FULL_OVERLAP)
            + 0.5 * width / self._hand.max_width
            + slope
            + off / 0.01
            + self._aside(picked, profile.tips) / 0.03
            + 0.5 * (1.0 - np.minimum(room, 0.012) / 0.012)
        )
        kept = (area >= LOOSE_TIER.area) & (overlap >= LOOSE_TIER.overlap) & (solid >= LOOSE_TIER.solid)
        kept &= (profile.rows >= MIN_ROWS) & (room >= MIN_ROOM) & (slope <= MAX_SLOPE)
        kept &= (off <= 1.5 * cell) & (first < last)
        score += MIXED_COST * self._mixed(picked, first, last, profile.tips)
        best = [k for k in np.argsort(score, kind="stable") if kept[k]][:MAX_GRASPS_PER_YAW]
        return [
            _Graded(
                self,
                (int(picked[k, 1]), int(picked[k, 2])),
                float(profile.tips[k]),
                self._halves[int(picked[k, 0])],
                float(width[k]),
                float(score[k]),
                float(area[k]),
                float(overlap[k]),
                float(solid[k]),
            )
            for k in best
        ]

    def _mixed(
        self, picked: NDArray[np.intp], first: NDArray[np.intp], last: NDArray[np.intp], tips: Heights
    ) -> Array:
        """Return the share (k,) of the coloured cells between the pads without the most frequent colour."""
        rows, shares = np.meshgrid(SAMPLED_ROWS, SAMPLED_SHARES, indexing="ij")
        row = picked[:, 1, None] + rows.ravel()
        middle, width = picked[:, 2] + (first + last) / 2, last - first + 1
        column = middle[:, None] + shares.ravel() * width[:, None]
        heights = np.repeat(tips + np.float32(SAMPLED_HEIGHT), rows.size)
        at: Array = np.column_stack([row.ravel(), column.ravel()]).astype(np.float64)
        points = self._points(at, heights)
        labels = self._heap.labels_at(points).reshape(row.shape)
        counts = np.stack([np.count_nonzero(labels == one, axis=1) for one in range(1, len(LABEL_NAMES))])
        return 1.0 - counts.max(axis=0) / np.maximum(1, counts.sum(axis=0))

    def _aside(self, picked: NDArray[np.intp], tips: Heights) -> Array:
        """Return the distance of the thing's middle from the pads, across the closing direction, m."""
        reach = np.arange(-AXIS_REACH, AXIS_REACH + 1)
        n, m = self.things.shape
        r = np.clip(picked[:, 1, None] + reach[None, :], 0, n - 1)
        c = np.clip(picked[:, 2, None, None] + np.arange(-2, 3), 0, m - 1)
        strip = self.things[r[:, :, None], c].max(axis=2) >= tips[:, None] + CONTACT_LEVEL
        ahead = np.logical_and.accumulate(strip[:, AXIS_REACH:], axis=1).sum(axis=1)
        behind = np.logical_and.accumulate(strip[:, AXIS_REACH::-1], axis=1).sum(axis=1)
        return np.abs(ahead - behind) / 2 * self._view.cell

    def candidate(self, graded: _Graded) -> GraspCandidate:
        """Return the grasp of a graded place."""
        z, closing = self._view.axes[:, 2], self._closing()
        rotation = np.column_stack([np.cross(closing, -z), closing, -z])
        point = self._points(np.array([graded.at]), np.array([graded.tips + self._hand.tip]))[0]
        pose = self._heap.frame @ Pose.from_rotation((point[0], point[1], point[2]), rotation)
        opening = min(2 * graded.half * self._view.cell, self._hand.max_width)
        name = (
            f"{self._name} yaw {math.degrees(self._yaw):.0f} width {opening * 1000:.0f} "
            f"at {point[0] * 1000:.0f} {point[1] * 1000:.0f}"
        )
        tilted = bool(z[2] < 1.0)
        margin = SIDE_CLEARANCE / 2
        enclosed = max(0.0, float(self._heap.rim - point[2] + self._hand.tip) / float(z[2]))
        return GraspCandidate(
            name, pose, opening, graded.width, margin, False, graded.score, tilted, enclosed
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
