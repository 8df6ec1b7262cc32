"""Patches of one colour: their outline, their depth, and which borders are real."""

from __future__ import annotations

import colorsys
from dataclasses import dataclass, field, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from ...world.colours import ITEM_COLOURS
from ...world.protocols import Intrinsics, RgbdImage
from ...world.values import Array
from ..geometry.camera_geometry import PosedCamera
from ..geometry.silhouette_fitting import BlobOutline, support

SATURATED = 128
"""Of 255: items are more saturated than this, fixtures and robot less."""
BRIGHT = 24
"""Of 255: below it a hue means nothing."""

NAMES: tuple[str, ...] = ("", *ITEM_COLOURS)
"""Name of each label; label 0 is no colour."""


def _table() -> NDArray[np.uint8]:
    known = np.array([colorsys.rgb_to_hsv(*rgb)[0] for rgb in ITEM_COLOURS.values()])
    hues = np.arange(256)[:, None] / 255.0
    apart = np.abs((hues - known + 0.5) % 1.0 - 0.5)
    return (apart.argmin(axis=1) + 1).astype(np.uint8)


_LABEL_OF_HUE = _table()


def labels(colour: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Index into NAMES for each pixel (h, w) of an RGB picture (h, w, 3)."""
    hsv = np.asarray(cv2.cvtColor(colour, cv2.COLOR_RGB2HSV_FULL), dtype=np.uint8)
    coloured = (hsv[:, :, 1] > SATURATED) & (hsv[:, :, 2] > BRIGHT)
    return np.where(coloured, _LABEL_OF_HUE[hsv[:, :, 0]], 0).astype(np.uint8)


def label_of(name: str) -> int:
    """Label of a named colour; 0 for one that perception does not tell (grey, unknown)."""
    return NAMES.index(name) if name in ITEM_COLOURS else 0


WHOLE = 0.12
"""A blob counts as whole while no more than this share of its border may be hidden."""
SAMPLES = 80
"""Pixels of a blob whose depth is kept for judging."""
HIDES = 0.006
"""A neighbour that is higher by this hides what lies behind it, m."""
TOP = 0.8
"""Quantile of the heights that stands for the top: most of what is seen from above is top."""

Pixels = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class SegmentationInput:
    """What blobs are cut from; all arrays (h, w). The owners are filled in while patches are found."""

    sight: PosedCamera
    depth: Array
    """m along the optical axis, 0 where unknown."""
    height: Array
    """In the world, m; meaningless where the depth is unknown."""
    label: NDArray[np.uint8]
    """Colour of each pixel, see `hues`; 0 for grey."""
    blocked: NDArray[np.bool_]
    """Behind the robot, the held object, walls and their margins: nothing is known there."""
    owner: NDArray[np.int32]
    """Number of the patch that has the pixel, 0 for none."""
    patches: list[PixelPatch]

    def claim(self, rows: Pixels, columns: Pixels, label: int) -> PixelPatch:
        """A new patch of these pixels, which it takes from whoever had them."""
        depths = self.depth[rows, columns]
        heights = np.sort(self.height[rows, columns][depths > 0])
        top = float(heights[int(TOP * len(heights))]) if len(heights) else float("nan")
        patch = PixelPatch(len(self.patches) + 1, label, rows, columns, top, len(heights))
        self.patches.append(patch)
        self.owner[rows, columns] = patch.number
        return patch


@dataclass(frozen=True, eq=False)
class PixelPatch:
    """Pixels that hang together."""

    number: int
    label: int
    rows: Pixels
    columns: Pixels
    top: float
    """Height of its upper parts in the world, m; NaN when no pixel has a depth."""
    measured: int
    """How many pixels have a depth."""


@dataclass(frozen=True, eq=False)
class Blob:
    """A patch with its outline, ready to be fitted."""

    patch: PixelPatch
    outline: BlobOutline
    hull: Array
    """Convex hull of its outline (k, 2), pixels."""
    middle: Array
    """Centroid of its pixels (2,)."""
    reach: tuple[Array, Array]
    """Support function of the hull and the point that it is about, see `silhouettes.support`."""
    hidden_side: Array
    """Unit vector (2,) in the image towards where it may go on unseen; zero when nowhere."""
    rays: Array
    """World directions (s, 3) of sampled inner pixels, scaled so that depth × ray is the point."""
    depths: Array = field(repr=False)
    """Their depths (s,), m."""

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
        """Whether (nearly) all of its border is real."""
        return float(1.0 - self.outline.real.mean()) <= WHOLE


def connected_patches(mask: NDArray[np.bool_], least: int) -> list[tuple[Pixels, Pixels]]:
    """Rows and columns of each connected patch of `mask` (h, w) with at least so many pixels."""
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
    """The patch with its outline. All neighbours must have been claimed before."""
    y, x = int(patch.rows.min()) - 1, int(patch.columns.min()) - 1
    h, w = int(patch.rows.max()) + 2 - y, int(patch.columns.max()) + 2 - x
    inside = np.zeros((h, w), dtype=np.bool_)
    inside[patch.rows - y, patch.columns - x] = True
    hidden = _hiding(picture, patch, y, x, h, w)
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
    return Blob(patch, outline, hull, middle, support(hull), _towards(outline, middle), rays, depths)


def _hiding(
    picture: SegmentationInput, patch: PixelPatch, y: int, x: int, h: int, w: int
) -> NDArray[np.bool_]:
    """Which pixels of the window (h, w) may hide a part of the patch."""
    hidden = np.ones((h, w), dtype=np.bool_)
    rows, columns = picture.owner.shape
    y0, x0, y1, x1 = max(y, 0), max(x, 0), min(y + h, rows), min(x + w, columns)
    owner = picture.owner[y0:y1, x0:x1]
    window = picture.blocked[y0:y1, x0:x1].copy()
    for number in set(owner.ravel().tolist()) - {0, patch.number}:
        other = picture.patches[number - 1]
        if other.label == patch.label or other.top > patch.top + HIDES:
            window |= owner == number
    hidden[y0 - y : y1 - y, x0 - x : x1 - x] = window
    return hidden


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
    chosen = chosen[:: max(1, len(chosen) // SAMPLES)]
    pixels = np.stack([patch.columns[chosen], patch.rows[chosen]], axis=1).astype(np.float64)
    return picture.sight.directions(pixels), depths[chosen]


def _towards(outline: BlobOutline, middle: Array) -> Array:
    if outline.real.all():
        return np.zeros(2)
    away = outline.points[~outline.real].mean(axis=0) - middle
    length = float(np.hypot(away[0], away[1]))
    return away / length if length > 1e-6 else np.zeros(2)


PITCH = 0.002
"""Distance of two pixels on what is seen that recognising was made for, m: finer outlines cost more, and show
what models lack."""


def downsample(image: RgbdImage) -> RgbdImage:
    """Every so many rows and columns of a picture that was taken from near; the picture itself from afar."""
    known = image.depth[image.depth > 0]
    if not len(known):
        return image
    every = max(1, round(PITCH * image.intrinsics.fx / float(np.median(known))))
    if every == 1:
        return image
    colour, depth = image.colour[::every, ::every].copy(), image.depth[::every, ::every].copy()
    i = image.intrinsics
    h, w = depth.shape
    scaled = Intrinsics(w, h, i.fx / every, i.fy / every, i.cx / every, i.cy / every)
    return replace(image, colour=colour, depth=depth, intrinsics=scaled)


def cut_off(rows: Pixels, columns: Pixels, height: int, width: int) -> bool:
    """Whether these pixels go up to the border of a picture of that size, and may go on beyond."""
    return bool(
        (rows == 0).any()
        or (columns == 0).any()
        or (rows == height - 1).any()
        or (columns == width - 1).any()
    )
