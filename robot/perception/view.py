"""Perceived view: detections, unexplained patches and bin heights of one picture.

It has free space and visibility of bodies, too. The height map of the heap in a bin is computed here.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from ...world.belief.height_map import HeightMap
from ...world.scene.description import Bin, Form
from ...world.shapes import Box, Shape, Sphere, ray_hits
from ...world.values import Array, ObjectId, Pose
from . import segmentation
from .camera_geometry import PosedCamera, rays_of
from .polygons import covered_area
from .resting_poses import part_points
from .robot_mask import fill
from .segmentation import SegmentationInput

MIN_DEPTH_BEHIND = 0.010
"""Depth beyond a body's believed surface from which the body is not there, m."""


@dataclass(frozen=True, slots=True)
class Detection:
    """One recognised item."""

    kind: str
    form: Form
    shape: Shape
    colour: str
    pose: Pose
    """Pose in the world."""
    sigma_position: float
    """Standard deviation of the position along each axis, m."""
    sigma_angle: float
    """Standard deviation of the angle about the vertical, rad; π for a body of revolution."""
    confidence: float
    """Confidence, 0 … 1."""
    turn: float = 0.0
    """Turn about the vertical that looks the same, rad; 0 for a body without heading."""
    place: str = "table"
    """`table`, or the id of the bin or hole that it lies in."""


@dataclass(frozen=True, slots=True, eq=False)
class UnexplainedPatch:
    """Patch of depth that no known body explains, with its upright bounding box from the support up."""

    shape: Box
    pose: Pose
    colour: str
    rows: NDArray[np.intp]
    """Rows of its pixels (n,); all of them have a depth."""
    columns: NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class BinView:
    """Heights seen inside a bin. Cells count along the bin's x (rows) and y (columns)."""

    cells: Array
    """Height of the heap above the bin's floor (n, n), m; NaN where it was not seen."""

    def over(self, former: BinView | None) -> BinView:
        """Fill the unseen cells with those of a former view."""
        if former is None:
            return self
        return BinView(np.where(np.isfinite(self.cells), self.cells, former.cells))

    def highest(self) -> float:
        """Return the greatest height of all seen cells, m; 0 when none was seen."""
        return float(np.nanmax(self.cells)) if np.isfinite(self.cells).any() else 0.0


@dataclass(frozen=True, slots=True)
class BodyVisibility:
    """Pixel counts of a picture where a body is believed."""

    total: int
    """Pixels of the silhouette, inside the picture or not."""
    visible: int
    """Number of these that are neither masked, nor behind something nearer, nor without depth."""
    empty: int
    """Number of visible pixels that show something behind the body, or another colour."""

    @property
    def seen_empty(self) -> bool:
        """Whether the body clearly is not there."""
        return self.visible >= max(6, 0.3 * self.total) and self.empty >= 0.7 * self.visible

    @property
    def borne_out(self) -> bool:
        """Whether the visible part of the place looks as if the body were there."""
        return self.visible >= 6 and self.empty <= 0.1 * self.visible

    @property
    def hidden(self) -> bool:
        """Whether too little of the place was visible for a statement."""
        return self.visible < max(6, 0.3 * self.total)


@dataclass(frozen=True, eq=False)
class PerceivedView:
    """Findings of one picture, and the picture itself for later questions about believed bodies."""

    camera: str
    stamp: float
    detections: tuple[Detection, ...]
    unexplained: tuple[UnexplainedPatch, ...]
    bins: Mapping[ObjectId, BinView]
    sight: PosedCamera
    depth: Array
    """Depth of each pixel (h, w), m; 0 where unknown."""
    label: NDArray[np.uint8]
    """Label of each pixel's colour (h, w), see `segmentation.NAMES`."""
    blocked: NDArray[np.bool_]
    """Pixels without information (h, w): robot, held object, walls."""
    reach: NDArray[np.float32]
    """Length of each pixel's ray through free space (h, w), m: to the seen surface, or a little beyond what
    never moves.

    0 where the robot is in the way, inf where the depth is unknown.
    """
    supports: Callable[[Array], Array]
    """Support heights below points, see `backdrop.SupportSurfaces.supports`."""
    robot: Callable[[Array, float], NDArray[np.bool_]]
    """Selection of the points (n, 3) of the world within a distance, m, of the robot and of what it holds."""
    heaps: Mapping[ObjectId, HeightMap] = field(default_factory=dict[ObjectId, HeightMap])
    """Height maps of the totes that the picture shows."""

    def look(self, shape: Shape, pose: Pose, colour: str) -> BodyVisibility:
        """Count what the picture shows where the body should be."""
        rows, columns, total = self._silhouette(shape, pose)
        if not len(rows):
            return BodyVisibility(total, 0, 0)
        pixels = np.stack([columns, rows], axis=1).astype(np.float64)
        surface = ray_hits(
            shape,
            pose.rotation(),
            np.array(pose.position),
            self.sight.origin,
            self.sight.directions(pixels),
        )
        depth, label = self.depth[rows, columns], self.label[rows, columns]
        known = np.isfinite(surface) & ~self.blocked[rows, columns] & (depth > 0)
        own = segmentation.label_of(colour)
        there = label == own if own else np.abs(depth - surface) <= MIN_DEPTH_BEHIND
        visible = known & (there | (depth > surface - MIN_DEPTH_BEHIND))
        return BodyVisibility(total, int(visible.sum()), int((visible & ~there).sum()))

    def _silhouette(self, shape: Shape, pose: Pose) -> tuple[NDArray[np.intp], NDArray[np.intp], int]:
        """Return rows and columns of the pixels that the body covers, and their number without the picture's
        borders."""
        where = Pose(pose.position) if isinstance(shape, Sphere) else pose
        parts = [where.apply(points) for points in part_points(shape)]
        points = np.concatenate(parts)
        if len(self.sight.before(points)) != len(points):
            # A part of it is next to or behind the camera: too near for a statement.
            nothing = np.zeros(0, dtype=np.intp)
            return nothing, nothing, 0
        hulls = [cv2.convexHull(self.sight.pixels(part).astype(np.float32)) for part in parts]
        h, w = self.depth.shape
        x, y, wide, high = (int(n) for n in cv2.boundingRect(np.concatenate(hulls)))
        x0, y0, x1, y1 = max(x, 0), max(y, 0), min(x + wide, w), min(y + high, h)
        total = int(covered_area([hull[:, 0].astype(np.float64) for hull in hulls]))
        if x0 >= x1 or y0 >= y1:
            return np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp), total
        mask = np.zeros((y1 - y0, x1 - x0), dtype=np.uint8)
        for hull in hulls:
            fill(mask, hull[:, 0].astype(np.float64) - np.array([x0, y0]))
        rows, columns = np.nonzero(mask)
        return rows + y0, columns + x0, max(total, len(rows))


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
    return BinView(heights)
