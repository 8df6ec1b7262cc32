"""Blobs: connected pixels of one colour with outline and depth, and which parts of the outline are real."""

from __future__ import annotations

import colorsys
from dataclasses import dataclass, field, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from picktree.world import ITEM_COLOURS, Array, Intrinsics, RgbdImage

from .camera_geometry import PosedCamera
from .silhouette_fitting import BlobOutline, support

MIN_SATURATION = 128
"""Saturation (of 255) above which a pixel is coloured. Items are above, fixtures and robot below."""
MIN_BRIGHTNESS = 24
"""Brightness (of 255) below which a hue means nothing."""

LABEL_NAMES: tuple[str, ...] = ("", *ITEM_COLOURS)
"""Name of each label; label 0 is no colour."""


def _label_of_hue() -> NDArray[np.uint8]:
    known = np.array([colorsys.rgb_to_hsv(*rgb)[0] for rgb in ITEM_COLOURS.values()])
    hues = np.arange(256)[:, None] / 255.0
    apart = np.abs((hues - known + 0.5) % 1.0 - 0.5)
    return (apart.argmin(axis=1) + 1).astype(np.uint8)


_LABEL_OF_HUE = _label_of_hue()


def labels(colour: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the index into LABEL_NAMES of each pixel (h, w) of an RGB picture (h, w, 3)."""
    hsv = np.asarray(cv2.cvtColor(colour, cv2.COLOR_RGB2HSV_FULL), dtype=np.uint8)
    coloured = (hsv[:, :, 1] > MIN_SATURATION) & (hsv[:, :, 2] > MIN_BRIGHTNESS)
    return np.asarray(cv2.LUT(hsv[:, :, 0], _LABEL_OF_HUE), np.uint8) * coloured


def label_of(name: str) -> int:
    """Return the label of a named colour; 0 for a colour that perception does not distinguish (grey,
    unknown)."""
    return LABEL_NAMES.index(name) if name in ITEM_COLOURS else 0


MAX_HIDDEN_BORDER_SHARE = 0.12
"""Greatest share of possibly hidden border at which a blob counts as whole."""
MAX_DEPTH_SAMPLES = 80
"""Number of pixels of a blob whose depth is kept for fits."""
MIN_HIDING_HEIGHT = 0.006
"""Height above a blob from which a neighbour hides the surface behind it, m."""
TOP_QUANTILE = 0.8
"""Quantile of the heights that is taken as the top: from above, most pixels show the top."""

Pixels = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class SegmentationInput:
    """Input of the segmentation; all arrays (h, w). Owners are filled in while patches are found."""

    sight: PosedCamera
    depth: Array
    """Depth along the optical axis, m; 0 where unknown."""
    height: Array
    """Height in the world, m; meaningless where the depth is unknown."""
    label: NDArray[np.uint8]
    """Label of each pixel's colour, see LABEL_NAMES; 0 for grey."""
    blocked: NDArray[np.bool_]
    """Pixels behind the robot, the held object, or walls and their margins: nothing is known there."""
    owner: NDArray[np.int32]
    """Number of the patch that owns the pixel, 0 for none."""
    patches: list[PixelPatch]

    def claim(self, rows: Pixels, columns: Pixels, label: int) -> PixelPatch:
        """Create a patch of these pixels. Former owners lose them."""
        depths = self.depth[rows, columns]
        heights = np.sort(self.height[rows, columns][depths > 0])
        top = float(heights[int(TOP_QUANTILE * len(heights))]) if len(heights) else float("nan")
        patch = PixelPatch(len(self.patches) + 1, label, rows, columns, top, len(heights))
        self.patches.append(patch)
        self.give_back(patch)
        return patch

    def give_back(self, patch: PixelPatch) -> None:
        """Return its pixels to the patch, also those that other patches have claimed."""
        self.owner[patch.rows, patch.columns] = patch.number


@dataclass(frozen=True, eq=False)
class PixelPatch:
    """Connected pixels of one colour."""

    number: int
    label: int
    rows: Pixels
    columns: Pixels
    top: float
    """Height of its upper parts in the world, m; NaN when no pixel has a depth."""
    measured: int
    """Number of pixels that have a depth."""


@dataclass(frozen=True, eq=False)
class Blob:
    """Patch with its outline, ready to be fitted."""

    patch: PixelPatch
    outline: BlobOutline
    hull: Array
    """Convex hull of the outline (k, 2), pixels."""
    middle: Array
    """Centroid of the pixels (2,)."""
    reach: tuple[Array, Array]
    """Support function of the hull and its reference point, see `silhouette_fitting.support`."""
    hidden_side: Array
    """Unit vector (2,) in the image towards the hidden border, beyond which the item may extend; zero without
    one."""
    rays: Array
    """World directions (s, 3) of sampled inner pixels, scaled so that depth × ray is the point."""
    depths: Array = field(repr=False)
    """Depths of the sampled pixels (s,), m."""

    @property
    def area(self) -> int:
        return len(self.patch.rows)

    @property
    def top(self) -> float:
        return self.patch.top

    @property
    def measured(self) -> int:
        return self.patch.measured

    @cached_property
    def whole(self) -> bool:
        """Whether (nearly) all of the border is real."""
        return float(1.0 - self.outline.real.mean()) <= MAX_HIDDEN_BORDER_SHARE


def connected_patches(mask: NDArray[np.bool_], least: int) -> list[tuple[Pixels, Pixels]]:
    """Return rows and columns of each connected patch of `mask` (h, w) with at least `least` pixels."""
    pixels = mask.view(np.uint8)
    left, upper, wide, high = (int(n) for n in cv2.boundingRect(pixels))
    pixels = pixels[upper : upper + high, left : left + wide]
    if not pixels.size:
        return []
    count, marks, stats, _ = cv2.connectedComponentsWithStats(pixels, connectivity=4)
    found: list[tuple[Pixels, Pixels]] = []
    for k in range(1, count):
        x, y, w, h, area = (int(n) for n in stats[k])
        if area >= least:
            rows, columns = np.nonzero(marks[y : y + h, x : x + w] == k)
            found.append((rows + y + upper, columns + x + left))
    return found


def outline_patch(picture: SegmentationInput, patch: PixelPatch) -> Blob:
    """Trace the outline of the patch. All neighbours must have been claimed before."""
    y, x = int(patch.rows.min()) - 1, int(patch.columns.min()) - 1
    h, w = int(patch.rows.max()) + 2 - y, int(patch.columns.max()) + 2 - x
    inside = np.zeros((h, w), dtype=np.bool_)
    inside[patch.rows - y, patch.columns - x] = True
    hidden = _hiding_pixels(picture, patch, y, x, h, w)
    points: list[Array] = []
    real: list[NDArray[np.bool_]] = []
    for axis in (0, 1):
        a, b = (inside[:-1], inside[1:]) if axis == 0 else (inside[:, :-1], inside[:, 1:])
        ha, hb = (hidden[:-1], hidden[1:]) if axis == 0 else (hidden[:, :-1], hidden[:, 1:])
        rows, columns = np.nonzero(a != b)
        at = np.stack([columns + x, rows + y], axis=1).astype(np.float64)
        at[:, 1 - axis] += 0.5
        points.append(at)
        real.append(~np.where(a[rows, columns], hb[rows, columns], ha[rows, columns]))
    outline = BlobOutline(np.concatenate(points), np.concatenate(real))
    hull = cv2.convexHull(outline.points.astype(np.float32))[:, 0].astype(np.float64)
    middle = np.array([patch.columns.mean(), patch.rows.mean()])
    rays, depths = _samples(picture, patch, inside, y, x)
    return Blob(patch, outline, hull, middle, support(hull), _hidden_direction(outline, middle), rays, depths)


def _hiding_pixels(
    picture: SegmentationInput, patch: PixelPatch, y: int, x: int, h: int, w: int
) -> NDArray[np.bool_]:
    """Select the pixels of the window (h, w) that may hide a part of the patch."""
    hidden = np.ones((h, w), dtype=np.bool_)
    rows, columns = picture.owner.shape
    y0, x0, y1, x1 = max(y, 0), max(x, 0), min(y + h, rows), min(x + w, columns)
    owner = picture.owner[y0:y1, x0:x1]
    window = picture.blocked[y0:y1, x0:x1].copy()
    for number in set(owner.ravel().tolist()) - {0, patch.number}:
        other = picture.patches[number - 1]
        if other.label == patch.label or other.top > patch.top + MIN_HIDING_HEIGHT:
            window |= owner == number
    hidden[y0 - y : y1 - y, x0 - x : x1 - x] = window
    return hidden


def notches(picture: SegmentationInput, blob: Blob) -> float:
    """Return the share of the blob's convex hull in which something behind or beside it is seen."""
    x, y, w, h = (int(n) for n in cv2.boundingRect(blob.hull.astype(np.float32)))
    corners = np.round(blob.hull - (x, y)).astype(np.int32)
    filled = cv2.fillConvexPoly(np.zeros((h, w), np.uint8), corners, 1)
    border = cv2.BORDER_CONSTANT  # what the fill has of the pixels beside the hull is no notch
    inside = cv2.erode(filled, np.ones((3, 3), np.uint8), borderType=border, borderValue=0).astype(np.bool_)
    inside[blob.patch.rows - y, blob.patch.columns - x] = False
    beside = int((inside & ~_hiding_pixels(picture, blob.patch, y, x, h, w)).sum())
    return beside / (beside + blob.area)


def _samples(
    picture: SegmentationInput, patch: PixelPatch, inside: NDArray[np.bool_], y: int, x: int
) -> tuple[Array, Array]:
    rows, columns = patch.rows - y, patch.columns - x
    inner = (
        inside[rows - 1, columns]
        & inside[rows + 1, columns]
        & inside[rows, columns - 1]
        & inside[rows, columns + 1]
    )
    if inner.sum() < 10:
        inner = np.ones(len(rows), dtype=np.bool_)
    depths = picture.depth[patch.rows, patch.columns]
    chosen = np.flatnonzero(inner & (depths > 0))
    chosen = chosen[:: max(1, len(chosen) // MAX_DEPTH_SAMPLES)]
    pixels = np.stack([patch.columns[chosen], patch.rows[chosen]], axis=1).astype(np.float64)
    return picture.sight.directions(pixels), depths[chosen]


def _hidden_direction(outline: BlobOutline, middle: Array) -> Array:
    if outline.real.all():
        return np.zeros(2)
    away = outline.points[~outline.real].mean(axis=0) - middle
    length = float(np.hypot(away[0], away[1]))
    return away / length if length > 1e-6 else np.zeros(2)


PIXEL_PITCH = 0.002
"""Distance of two pixels on the observed surface for which recognition was made, m. Finer outlines cost more
and show details that models lack."""


def downsample(image: RgbdImage) -> RgbdImage:
    """Thin a picture that was taken from near to the usual pixel distance; return it unchanged from afar."""
    known = image.depth[image.depth > 0]
    if not len(known):
        return image
    every = max(1, round(PIXEL_PITCH * image.intrinsics.fx / float(np.median(known))))
    if every == 1:
        return image
    colour, depth = image.colour[::every, ::every].copy(), image.depth[::every, ::every].copy()
    i = image.intrinsics
    h, w = depth.shape
    scaled = Intrinsics(w, h, i.fx / every, i.fy / every, i.cx / every, i.cy / every)
    return replace(image, colour=colour, depth=depth, intrinsics=scaled)


def cut_off(rows: Pixels, columns: Pixels, height: int, width: int) -> bool:
    """Whether these pixels touch the border of a picture of that size, and may extend beyond it."""
    return bool(
        (rows == 0).any()
        or (columns == 0).any()
        or (rows == height - 1).any()
        or (columns == width - 1).any()
    )
