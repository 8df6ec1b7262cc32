"""Blob splitting: a blob of several touching items of one colour is cut, fitted, and its pixels are
reassigned between fits."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ...world.shapes import extents, inside, ray_hits
from ...world.values import Array, Pose
from .item_fitting import Hypothesis, ItemFitter
from .segmentation import Blob, Pixels, SegmentationInput, notches, outline_patch
from .silhouette_fitting import StandingPose, distances_outside, silhouette

MAX_PARTS = 4
"""Greatest number of items that one blob is split into."""
MAX_SPLIT_MISFIT_SHARE = 0.7
"""Greatest misfit of a split, as a share of the whole blob's."""
GOOD_SPLIT_MISFIT = 1.3
"""Misfit below which the search for more parts ends."""
MAX_NOTCHES = 0.12
"""Share of notches in its convex hull up to which a blob may be one body, larger than any item. Touching
items leave notches between them, unless they are flush."""
MAX_FLUSH_MISFIT, MAX_FLUSH_SHARED_VOLUME = 0.9, 0.08
"""Greatest misfit of flush items, and greatest share of one's volume inside another. Rows of items measure
0.5 to 0.85, and 0.04; items that do not add up to a long body exceed one of the limits."""
MIN_STACKED_MISFIT = 2.2
"""Misfit below which a part that stands on the table is not lifted onto others."""
MAX_PART_MISFIT = 5.5
"""Misfit of a part above which its cut is given up."""
MAX_REFINEMENT = 2.0
"""Factor of the misfit that would be taken, up to which the first fit of a cut is refined. Of 204 splits of
touching and tumbled items that were taken, none began above 1.5."""
MIN_PART_PIXELS = 8
"""Least number of pixels of a part."""
OUTSIDE_COST = 1.5
"""Cost of a pixel at the edge of an item's silhouette, and greatest cost of one inside it."""
MIN_PART_DISTANCE = 0.010
"""Least distance between the centres of two parts, m."""
MAX_SHARED_VOLUME = 0.3
"""Share of a part's volume inside another part from which one of them does not exist: a leaning item is cut
into such parts. Estimated poses of items that touch overlap by less."""
_LATTICE, _FINE_LATTICE = (
    (np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1).reshape(-1, 3) + 0.5) / n
    for n in (7, 20)
)
"""Points (343, 3) and (8000, 3) of the unit cube."""


@dataclass(frozen=True, eq=False)
class BlobPart:
    """Piece of a blob with its hypotheses, best first."""

    blob: Blob
    hypotheses: list[Hypothesis]


def split_blob(
    picture: SegmentationInput, fitter: ItemFitter, blob: Blob, support: float, misfit: float, most: int
) -> list[BlobPart] | None:
    """Split the blob into at most `most` items. None when no split explains it clearly better than
    `misfit`."""
    convex = notches(picture, blob) < MAX_NOTCHES
    limit = MAX_SPLIT_MISFIT_SHARE * misfit
    if convex:
        limit = min(limit, MAX_FLUSH_MISFIT)
    fitting = _CutFitting(picture, fitter, blob, support)
    best: list[BlobPart] | None = None
    for count in range(2, min(most, fitter.at_most(blob)) + 1):
        for cut in _cuts(picture, blob, count):
            parts = fitting.refined(cut, limit)
            if parts is None or _misfit(parts) > limit or (convex and not _are_flush(parts)):
                continue
            best, limit = parts, 0.9 * _misfit(parts)
        if best is not None and _misfit(best) < GOOD_SPLIT_MISFIT:
            break
    for piece in [blob] if best is None else [part.blob for part in best]:
        picture.give_back(piece.patch)
    return best


def _cuts(picture: SegmentationInput, blob: Blob, count: int) -> list[NDArray[np.intp]]:
    """Propose cuts of the blob: for each a part number of every pixel (n,)."""
    rows, columns = blob.patch.rows, blob.patch.columns
    spots = np.stack([columns, rows], axis=1).astype(np.float64)
    centred = spots - spots.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    cuts = [_clusters(spots, centred @ axes[:, 1], count)]
    heights = _smooth_heights(picture, rows, columns)
    if count == 2 and float(np.percentile(heights, 90) - np.percentile(heights, 15)) > 0.012:
        cuts.append(_clusters(heights[:, None], heights, 2))
    elif count > 2:
        cuts.append(_clusters(spots, np.arctan2(centred[:, 1], centred[:, 0]), count))
    return cuts


def _smooth_heights(picture: SegmentationInput, rows: Pixels, columns: Pixels) -> Array:
    """Return the heights of the pixels (n,), averaged over their neighbours of known depth, m."""
    y, x = int(rows.min()), int(columns.min())
    window = (slice(y, int(rows.max()) + 1), slice(x, int(columns.max()) + 1))
    known = (picture.depth[window] > 0).astype(np.float64)
    total = cv2.blur(picture.height[window] * known, (3, 3))
    return (total / np.maximum(cv2.blur(known, (3, 3)), 1e-6))[rows - y, columns - x]


def _clusters(values: Array, order: Array, count: int) -> NDArray[np.intp]:
    """Cluster values (n, d) by Lloyd's algorithm, started with equal shares along `order` (n,)."""
    part = np.empty(len(values), dtype=np.intp)
    part[np.argsort(order, kind="stable")] = np.arange(len(values)) * count // len(values)
    for _ in range(8):
        centres = np.stack(
            [values[part == k].mean(axis=0) if (part == k).any() else values[0] for k in range(count)]
        )
        part = ((values[:, None, :] - centres) ** 2).sum(axis=2).argmin(axis=1)
    return part


@dataclass(frozen=True, eq=False)
class _CutFitting:
    """Fits of the parts into which one blob is cut. A cut is a part number of every pixel (n,)."""

    picture: SegmentationInput
    fitter: ItemFitter
    blob: Blob
    support: float
    """Height of the support under the blob, m."""

    def refined(self, cut: NDArray[np.intp], limit: float) -> list[BlobPart] | None:
        """Fit the parts of a cut and move its borders. None when that cannot come to a misfit of `limit`."""
        parts = self._fitted(cut, MAX_REFINEMENT * limit)
        for _ in range(2):
            if parts is None:
                return None
            stands = [part.hypotheses[0].stand for part in parts]
            shared = item_costs(self.picture, self.blob, stands).argmin(axis=0)
            if (shared == cut).all():
                break
            cut = shared
            again = self._fitted(cut, _misfit(parts))
            if again is None:
                break
            parts = again
        return parts if parts is not None and _are_distinct(parts) else None

    def _fitted(self, cut: NDArray[np.intp], limit: float) -> list[BlobPart] | None:
        """Return each part's hypotheses. None when a part is too small or fits nothing, or when the parts
        together have a misfit above `limit`: the first of them may be enough for that."""
        rows, columns = self.blob.patch.rows, self.blob.patch.columns
        members = [cut == k for k in range(int(cut.max()) + 1)]
        if any(int(m.sum()) < MIN_PART_PIXELS for m in members):
            return None
        patches = [self.picture.claim(rows[m], columns[m], self.blob.patch.label) for m in members]
        pieces = [outline_patch(self.picture, patch) for patch in patches]
        left = limit * sum(len(piece.outline.points) + piece.measured for piece in pieces)
        parts: list[BlobPart] = []
        for piece in pieces:
            hypotheses = (
                self.fitter.explain(piece, self.support, MIN_STACKED_MISFIT) if piece.measured else []
            )
            if not hypotheses or hypotheses[0].misfit > MAX_PART_MISFIT:
                return None
            left -= hypotheses[0].misfit * hypotheses[0].weight
            if left < 0.0:
                return None
            parts.append(BlobPart(piece, hypotheses))
        return parts


def item_costs(picture: SegmentationInput, blob: Blob, stands: Sequence[StandingPose]) -> Array:
    """Return how badly the item at each of k poses explains each pixel of the blob (k, n).

    Inside its silhouette the cost is at most `OUTSIDE_COST`; outside, that and the distance from it, pixels.
    """
    rows, columns = blob.patch.rows, blob.patch.columns
    pixels = np.stack([columns, rows], axis=1).astype(np.float64)
    depths = picture.depth[rows, columns]
    rays = picture.sight.directions(pixels)
    costs: list[Array] = []
    for stand in stands:
        outside = distances_outside(silhouette(picture.sight, stand), pixels)
        surface = ray_hits(stand.rest.entry.shape, stand.turned, stand.centre, picture.sight.origin, rays)
        off = np.where(depths > 0, np.minimum(np.abs(surface - depths) / 0.006, OUTSIDE_COST), 0.0)
        costs.append(np.where(outside == 0.0, off, OUTSIDE_COST + outside))
    return np.stack(costs)


def _misfit(parts: list[BlobPart]) -> float:
    weight = sum(p.hypotheses[0].weight for p in parts)
    return sum(p.hypotheses[0].misfit * p.hypotheses[0].weight for p in parts) / weight


def _are_flush(parts: list[BlobPart]) -> bool:
    """Return whether hardly any of a part is inside another: only then may there be no notch between them."""
    return all(
        share <= MAX_FLUSH_SHARED_VOLUME for a, b in _pairs(parts) for share in _shares(a, b, _FINE_LATTICE)
    )


def _are_distinct(parts: list[BlobPart]) -> bool:
    """Return whether the parts can be there together: solid items are not inside each other."""
    return all(
        float(np.linalg.norm(a.centre - b.centre)) > MIN_PART_DISTANCE
        and max(_shares(a, b, _LATTICE)) <= MAX_SHARED_VOLUME
        for a, b in _pairs(parts)
    )


def _pairs(parts: list[BlobPart]) -> Iterable[tuple[StandingPose, StandingPose]]:
    return itertools.combinations([part.hypotheses[0].stand for part in parts], 2)


def _shares(one: StandingPose, other: StandingPose, lattice: Array) -> tuple[float, float]:
    """Return the share of each item's volume that lies in the other, by a lattice (n, 3) of points."""
    return _share_inside(one, other, lattice), _share_inside(other, one, lattice)


def _share_inside(one: StandingPose, other: StandingPose, lattice: Array) -> float:
    turn, shape = one.turned, one.rest.entry.shape
    low, high = extents(shape, np.eye(3))
    local = low + (high - low) * lattice
    own = local[inside(shape, Pose(), local)]
    there = Pose.from_rotation(other.centre, other.turned)
    return float(inside(other.rest.entry.shape, there, own @ turn.T + one.centre).mean())
