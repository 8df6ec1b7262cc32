"""Perceived view: detections, unexplained patches and bin heights of one picture.

It has free space and visibility of bodies, too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from picktree.world import Array, Body, Box, ObjectId, Pose, Shape, Sphere, heap_geometry, ray_hits

from . import segmentation
from .camera_geometry import PosedCamera
from .resting_poses import covered_area, part_points
from .robot_mask import fill

CERTAIN_CONFIDENCE = 0.6
"""Confidence from which a detection is an object of its own, even next to hidden objects."""
MIN_DEPTH_BEHIND = 0.010
"""Depth beyond a body's believed surface from which the body is not there, m."""


@dataclass(frozen=True, slots=True)
class Detection(Body):
    """One recognised item, which has no id yet."""

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
    reported: bool = False
    """Whether another process has recognised it. Then kind and colour may be wrong in single pictures."""


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
class RecognisedPatch:
    """Patch of one colour that was recognised in this picture, with its contents."""

    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    label: int
    """Label of its colour, see `segmentation.LABEL_NAMES`."""
    top: float
    """Height of its upper parts in the world, m."""
    detections: tuple[int, ...]
    """Indices of its detections in the view."""
    unexplained: tuple[UnexplainedPatch, ...]
    certain: bool
    """Whether each detection in it is certain."""


class BinView:
    """Heights seen inside a bin. Cells count along the bin's x (rows) and y (columns)."""

    def __init__(self, heights: Array | Callable[[], Array]) -> None:
        """`heights`: the cells, or a function that computes them when they are read first."""
        self._heights = heights

    @cached_property
    def cells(self) -> Array:
        """Height of the heap above the bin's floor (n, n), m; NaN where it was not seen."""
        heights = self._heights() if callable(self._heights) else self._heights
        self._heights = heights  # The picture is no longer needed.
        return heights

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
    def is_empty(self) -> bool:
        """Whether the body clearly is not there."""
        return self.visible >= max(6, 0.3 * self.total) and self.empty >= 0.7 * self.visible

    @property
    def is_confirmed(self) -> bool:
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
    """Label of each pixel's colour (h, w), see `segmentation.LABEL_NAMES`."""
    blocked: NDArray[np.bool_]
    """Pixels without information (h, w): robot, held object, walls."""
    reach: NDArray[np.float32]
    """Length of each pixel's ray through free space (h, w), m: to the seen surface, or a little beyond
    fixtures and bins.

    0 where the robot is in the way, inf where the depth is unknown.
    """
    supports: Callable[[Array], Array]
    """Support heights below points, see `backdrop.SupportSurfaces.supports`."""
    robot: Callable[[Array, float], NDArray[np.bool_]]
    """Selection of the points (n, 3) of the world within a distance, m, of the robot and of the held
    object."""
    heaps: Mapping[ObjectId, heap_geometry.HeightMap] = field(
        default_factory=dict[ObjectId, heap_geometry.HeightMap]
    )
    """Height maps of the totes that the picture shows."""
    confirmed: tuple[ObjectId, ...] = ()
    """Known objects whose pixels have not changed since they were recognised."""
    recognised: tuple[RecognisedPatch, ...] = ()
    """Patches that were recognised in this picture."""

    def look(self, shape: Shape, pose: Pose, colour: str) -> BodyVisibility:
        """Count the pixels of each kind at the believed place of the body."""
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
