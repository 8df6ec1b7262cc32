"""Item fitting: each catalogue entry in each stable pose is fitted to a blob's outline and compared with its
depth.

Blob splitting: a blob of several touching items of one colour is cut, fitted, and its pixels are reassigned
between fits.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Generator, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from picktree.world import Array, Pose, extents, inside, ray_hits

from .backdrop import SupportSurface
from .camera_geometry import PosedCamera
from .resting_poses import StablePose, leaning_poses
from .segmentation import LABEL_NAMES, Blob, Pixels, SegmentationInput, notches, outline_patch
from .silhouette_fitting import (
    OUTLIER_SIGMAS,
    StandingPose,
    distances_outside,
    fit_outline,
    likely_turns,
    seen_turns,
    silhouette,
)
from .view import Detection

HEIGHT_GATE = 0.009
"""Difference between the tops of a stable pose and of the blob from which on the pose is not tried, m."""
MAX_HOVER_HEIGHT = 0.025
"""Greatest height above the table of an item that leans or lies on another, m. A higher blob is a part of
something else."""
OUTLINE_GATE = 2.5
"""Error of a start's support function above which the start is not tried, pixels (root mean square)."""
LARGE_GATE = 0.06
"""The same gate for large blobs, as a share of their size: starts are 10° apart."""
MAX_STARTS = 12
"""Number of starts whose depth is compared; the fit begins with the best of them."""
MIN_START_DIFFERENCE = math.radians(15.0)
"""Difference of turns from which a start is another one, rad: a fit corrects smaller ones."""
RANKING_STRIDE = 3
"""Step between the depths that rank the starts."""
FIT_ROUNDS = 5
"""Greatest number of steps of a fit."""
MIN_HEIGHT_CORRECTION = 0.002
"""Median depth error above which the believed height is corrected, m."""
MODEL_DEPTH_SIGMA = 0.0004
"""Part of the depth's standard deviation for steep surfaces and rounded edges, m."""
MIN_STEEP_HEIGHT = 0.1
"""Height of an item from which its side faces matter in a picture from above, m."""
STEEP_PIXELS = 0.8
"""Position error of a pixel's ray along each axis of the picture, pixels."""
GOOD_MISFIT = 1.5
"""Misfit below which no other explanation is needed; a perfect one is about 0.8."""
POOR_MISFIT = 4.0
"""Misfit above which a hypothesis explains nothing."""
POOR_MISFIT_IN_BIN = 2.6
"""The same in a bin, where leaning items are not forced into a shape."""
LEANING_MISFIT = 2.5
"""Misfit of all poses on a face above which leaning ones are tried."""
MAX_LEANING_DROP = 0.03
"""Greatest distance by which the top of a leaning item, an edge, may be higher than a blob's, m."""
MIN_SHOWN_SHARE = 0.4
"""Share of the silhouette below which a blob may be a part of anything."""
PIXEL_GRID_ERROR = 0.12
"""Error of a position from the pixel grid, pixels. More outline points do not reduce it: along an edge
parallel to the grid all err alike."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One item at one pose, and how badly it explains a blob."""

    stand: StandingPose
    misfit: float
    """Mean square of outline and depth residuals in sigmas, each capped at OUTLIER²; ≈ 0.8 is perfect."""
    weight: float
    """Number of residuals in the misfit: half of weight × misfit is a negative log-likelihood."""
    covariance: Array
    """Covariance of x, y, yaw (3, 3); m², m·rad, rad²."""
    shown: float
    """Share of the silhouette that the blob fills."""
    supported: bool
    """Whether the item rests on the support; else it floats at the measured height."""

    @property
    def cost(self) -> float:
        return 0.5 * self.weight * self.misfit


T = TypeVar("T")
Fitting: TypeAlias = Generator[None, None, T]
"""Computation that yields after each fit of a body to a blob."""


@dataclass(eq=False)
class FitCount:
    """Number of fits that were computed."""

    fits: int = 0


@dataclass(frozen=True, eq=False)
class ItemFitter:
    """Fits of stable poses to blobs. `noise` is the depth's standard deviation at 0.7 m, m; `model` is added
    to it."""

    rests: tuple[StablePose, ...]
    sight: PosedCamera
    noise: float
    model: float = MODEL_DEPTH_SIGMA
    count: FitCount = field(default_factory=FitCount)
    exact: bool = False
    """Whether fits start at the turns of exact silhouettes that the usual search does not find."""

    def explain(
        self, blob: Blob, support: float, content: float = GOOD_MISFIT, hover: float = MAX_HOVER_HEIGHT
    ) -> Fitting[list[Hypothesis]]:
        """Return hypotheses for the blob, best first, at most one for each entry and manner of support.

        `support` is the height under the blob in the world, m. When no item on the support has a misfit below
        `content`, items that lie on others are tried, too, up to `hover` m above it.

        Before anything floats, the turns of items on the support are searched by their exact silhouettes.
        """
        found = yield from self._fits(blob, support, True, hover)
        if blob.whole and all(f.misfit > max(content, GOOD_MISFIT) for f in found):
            found += yield from replace(self, exact=True)._fits(blob, support, True, hover)
        if all(f.misfit > content for f in found):
            found += yield from self._fits(blob, support, False, hover)
        if blob.whole and all(f.misfit > LEANING_MISFIT for f in found):
            leaning = replace(self, rests=self.leaning)
            found += yield from leaning._fits(blob, support, False, hover, MAX_LEANING_DROP)
        found.sort(key=_rank)
        best: dict[tuple[str, bool], Hypothesis] = {}
        for one in found:
            best.setdefault((one.stand.rest.entry.kind, one.supported), one)
        return list(best.values())

    @property
    def leaning(self) -> tuple[StablePose, ...]:
        """Poses of the entries that lean on something else."""
        entries = {rest.entry.kind: rest.entry for rest in self.rests}.values()
        return tuple(rest for entry in entries for rest in leaning_poses(entry))

    def judged(self, blob: Blob, start: StandingPose, rounds: int) -> Hypothesis:
        """Fit one body to the blob from a start near its pose. The height changes only where the depth
        clearly demands it."""
        known = self._judge(blob, start, True, rounds)
        _, off = self._depth_misfit(blob, known.stand)
        if not len(off) or abs(float(np.median(off))) < MIN_HEIGHT_CORRECTION:
            return known
        moved = self._judge(blob, known.stand, False, rounds)
        return moved if moved.misfit < known.misfit else known

    def refined(self, blob: Blob, start: StandingPose, supported: bool) -> Hypothesis:
        """Fit one body to the blob from a start near its pose. Its height changes only when it is not
        `supported`."""
        return self._judge(blob, start, supported, FIT_ROUNDS)

    def max_count(self, blob: Blob) -> int:
        """Return the greatest number of items that may make up the blob, by its area and that of the smallest
        stable pose."""
        depth = float(blob.depths.mean()) if len(blob.depths) else 1.0
        if not self.rests:
            return 0
        least = min(rest.footprint for rest in self.rests) * (self.sight.intrinsics.fx / depth) ** 2
        return int(blob.area / (0.6 * least))

    def _fits(
        self, blob: Blob, support: float, supported: bool, hover: float, sink: float = HEIGHT_GATE
    ) -> Fitting[list[Hypothesis]]:
        starts: list[tuple[float, StandingPose]] = []
        origin, ray = self.sight.origin, self.sight.directions(blob.middle[None])[0]
        for rest in self.rests:
            below = support if supported else blob.top - rest.height
            above = blob.top - support
            if supported and not rest.least_top - HEIGHT_GATE <= above <= rest.height + HEIGHT_GATE:
                continue
            if not supported and not support - sink <= below <= support + hover:
                continue
            x, y = (origin + ray * ((below + rest.height / 2 - origin[2]) / ray[2]))[:2].tolist()
            stand = StandingPose(rest, np.array((x, y, below + rest.below)), 0.0)
            if self._fits_in_size(blob, stand):
                starts += self._starts(blob, stand)
        return (yield from self._best(blob, starts, supported))

    def _fits_in_size(self, blob: Blob, stand: StandingPose) -> bool:
        """Whether the area of the blob can be that of the silhouette at this pose."""
        rest, away = stand.rest, self.sight.origin - stand.centre
        depth = abs(float(away @ self.sight.rotation[:, 2]))
        pixels = (self.sight.intrinsics.fx / (depth - rest.height / 2)) ** 2
        slant = float(np.hypot(away[0], away[1])) / max(0.05, float(away[2]))
        most = 1.3 * (rest.footprint + rest.height * slant * 2 * rest.reach) * pixels + 8.0
        return blob.area <= most and (not blob.whole or blob.area >= 0.7 * rest.footprint * pixels - 8.0)

    def _best(
        self, blob: Blob, starts: list[tuple[float, StandingPose]], supported: bool
    ) -> Fitting[list[Hypothesis]]:
        """Fit the starts, the likeliest first, until the remaining ones cannot be better."""
        if blob.whole:
            gate = max(OUTLINE_GATE, LARGE_GATE * math.sqrt(blob.area))
            starts = [s for s in starts if s[0] < gate**2]
        starts.sort(key=lambda s: s[0])
        ranked = [
            (left + self._depth_misfit(blob, stand, RANKING_STRIDE)[0], stand)
            for left, stand in starts[:MAX_STARTS]
        ]
        ranked.sort(key=lambda r: r[0])
        found: list[Hypothesis] = []
        for score, stand in ranked:
            if found and min(f.misfit for f in found) < GOOD_MISFIT and score > 1.5 * ranked[0][0] + 0.7:
                break
            found.append(self._judge(blob, stand, supported, FIT_ROUNDS))
            yield
        return found

    def _starts(self, blob: Blob, stand: StandingPose) -> list[tuple[float, StandingPose]]:
        rest = stand.rest
        keep = 4 if rest.turn > np.pi else 2
        starts = likely_turns(self.sight, stand, blob.reach, keep)
        if self.exact:
            tried = [start.yaw for _, start in starts]
            exact = seen_turns(self.sight, stand, blob.reach, keep)
            starts = [(s, start) for s, start in exact if not _is_near(start.yaw, tried, rest.turn)]
        if blob.whole:
            return [(s + rest.unlikely, stand) for s, stand in starts]
        moved: list[tuple[float, StandingPose]] = []
        for left, start in starts:
            corners = np.concatenate(silhouette(self.sight, start))
            beyond = float((corners @ blob.hidden_side).max() - (blob.hull @ blob.hidden_side).max())
            depth = float((start.centre - self.sight.origin) @ self.sight.rotation[:, 2])
            shift = (
                self.sight.rotation[:2, :2]
                @ blob.hidden_side
                * (max(0.0, beyond) * depth / self.sight.intrinsics.fx)
            )
            centre = start.centre + np.array([shift[0], shift[1], 0.0])
            moved.append((left + rest.unlikely, replace(start, centre=centre)))
        return moved

    def _judge(self, blob: Blob, start: StandingPose, supported: bool, rounds: int) -> Hypothesis:
        self.count.fits += 1
        fitted = fit_outline(self.sight, blob.outline, start, rounds)
        depth, off = self._depth_misfit(blob, fitted.stand)
        if not supported and len(off):
            rise = float(np.sort(off)[len(off) // 2])
            lifted = fitted.stand.centre + np.array([0.0, 0.0, rise])
            fitted = fit_outline(self.sight, blob.outline, replace(fitted.stand, centre=lifted), 2)
            depth, _ = self._depth_misfit(blob, fitted.stand)
        contour, measured = float(len(blob.outline.points)), float(blob.measured)
        weight = contour + measured
        misfit = (fitted.misfit * contour + depth * measured) / weight
        shown = min(1.0, blob.area / max(1.0, fitted.area))
        return Hypothesis(fitted.stand, misfit, weight, fitted.covariance, shown, supported)

    def _depth_misfit(self, blob: Blob, stand: StandingPose, every: int = 1) -> tuple[float, Array]:
        """Return the mean square of the depth residuals in sigmas, capped, and the residuals (k,), m.

        A residual is positive where the measured surface is nearer than the model. Only rays that meet the
        model count in the second.
        """
        rays, depths = blob.rays[::every], blob.depths[::every]
        if not len(depths):
            return 1.0, depths
        model = ray_hits(stand.rest.entry.shape, stand.turned, stand.centre, self.sight.origin, rays)
        off = model - depths
        sigma: float | Array = self.noise * (float(depths[0]) / 0.7) ** 2 + self.model
        if stand.rest.height > MIN_STEEP_HEIGHT:
            sigma = np.hypot(sigma, self._steepness(stand, rays, model))
        square = np.add.reduce(np.minimum((off / sigma) ** 2, OUTLIER_SIGMAS**2)) / len(depths)
        return float(square), off[np.isfinite(model)]

    def _steepness(self, stand: StandingPose, rays: Array, model: Array) -> Array:
        """Return the change of the model's depth (k,) within the position error of a pixel, m. The depth of a
        side face changes by millimetres from pixel to pixel."""
        aside = (
            (self.sight.rotation[:, 0] + self.sight.rotation[:, 1]) * STEEP_PIXELS / self.sight.intrinsics.fx
        )
        beside = ray_hits(stand.rest.entry.shape, stand.turned, stand.centre, self.sight.origin, rays + aside)
        change = np.zeros(len(model))
        both = np.isfinite(model) & np.isfinite(beside)
        change[both] = np.abs(beside[both] - model[both])
        return change


def _is_near(yaw: float, others: Iterable[float], turn: float) -> bool:
    """Return whether a turn looks the same as one of the others, about, for a body that looks the same after
    `turn`, rad."""
    return not turn or any(abs(math.remainder(yaw - other, turn)) < MIN_START_DIFFERENCE for other in others)


def _rank(one: Hypothesis) -> float:
    """Sort key, lower is better: the cost, with a handicap for floating items and unlikely faces."""
    return one.cost + (0.0 if one.supported else 12.0) + 10.0 * one.stand.rest.unlikely


def is_clear(hypothesis: Hypothesis, poor: float = POOR_MISFIT) -> bool:
    """Whether the hypothesis explains its blob, and the blob shows enough of the item."""
    return hypothesis.misfit < poor and hypothesis.shown >= MIN_SHOWN_SHARE


def detection_from(
    sight: PosedCamera, blob: Blob, hypotheses: list[Hypothesis], floor: SupportSurface
) -> Detection:
    best = hypotheses[0]
    rest = best.stand.rest
    entry = rest.entry
    turn = rest.turn
    yaw = best.stand.yaw if not turn else (best.stand.yaw + turn / 2) % turn - turn / 2
    stand = StandingPose(rest, best.stand.centre, yaw if turn else 0.0)
    loose = math.sqrt(max(1.0, best.misfit)) / max(0.3, best.shown)
    variance = best.covariance
    position = math.sqrt(max(float(variance[0, 0]), float(variance[1, 1]))) * loose
    angle = math.pi if not turn else min(math.pi, math.sqrt(float(variance[2, 2])) * loose)
    pixel = float((stand.centre - sight.origin) @ sight.rotation[:, 2]) / sight.intrinsics.fx
    position = math.hypot(position, PIXEL_GRID_ERROR * pixel)
    return Detection(
        entry.kind,
        entry.form,
        entry.shape,
        LABEL_NAMES[blob.patch.label],
        Pose.from_rotation(stand.centre, stand.turned),
        position + (0.0 if best.supported else 1e-3),
        max(angle, 2e-3),
        _confidence(hypotheses),
        turn,
        floor.place,
    )


def _confidence(hypotheses: list[Hypothesis]) -> float:
    """Return a confidence 0 … 1: high for a good fit to a whole blob that no other kind explains nearly as
    well."""
    best = hypotheses[0]
    fit = float(np.clip((POOR_MISFIT - best.misfit) / (POOR_MISFIT - 1.2), 0.05, 1.0))
    others = [h.cost for h in hypotheses if h.stand.rest.entry.kind != best.stand.rest.entry.kind]
    lead = min(others, default=math.inf) - best.cost
    certain = 1.0 / (1.0 + math.exp(-min(lead, 60.0) / 4.0))
    seen = 0.4 + 0.6 * best.shown
    return round(fit * certain * seen * (1.0 if best.supported else 0.7), 4)


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
"""Misfit below which a part on the table is not lifted onto others."""
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
) -> Fitting[list[BlobPart] | None]:
    """Split the blob into at most `most` items. Returns None when no split explains it clearly better than
    `misfit`."""
    convex = notches(picture, blob) < MAX_NOTCHES
    limit = MAX_SPLIT_MISFIT_SHARE * misfit
    if convex:
        limit = min(limit, MAX_FLUSH_MISFIT)
    fitting = _CutFitting(picture, fitter, blob, support)
    best: list[BlobPart] | None = None
    for count in range(2, min(most, fitter.max_count(blob)) + 1):
        for cut in _cuts(picture, blob, count):
            parts = yield from fitting.refined(cut, limit)
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

    def refined(self, cut: NDArray[np.intp], limit: float) -> Fitting[list[BlobPart] | None]:
        """Fit the parts of a cut and move its borders. None when that cannot come to a misfit of `limit`."""
        parts = yield from self._fitted(cut, MAX_REFINEMENT * limit)
        for _ in range(2):
            if parts is None:
                return None
            stands = [part.hypotheses[0].stand for part in parts]
            shared = item_costs(self.picture, self.blob, stands).argmin(axis=0)
            if (shared == cut).all():
                break
            cut = shared
            again = yield from self._fitted(cut, _misfit(parts))
            if again is None:
                break
            parts = again
        return parts if parts is not None and _are_distinct(parts) else None

    def _fitted(self, cut: NDArray[np.intp], limit: float) -> Fitting[list[BlobPart] | None]:
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
            hypotheses: list[Hypothesis] = []
            if piece.measured:
                hypotheses = yield from self.fitter.explain(piece, self.support, MIN_STACKED_MISFIT)
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
