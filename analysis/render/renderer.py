"""Renderer of meshes: the fixed part is drawn once, the moving part into each image."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from ...logs.triangle_meshes import Mesh, join_meshes, unit
from ...world.values import Array, Pose
from .lighting import AmbientOcclusion, LightingSetup, PixelSamples, ShadowMap, Shadows, shade_samples
from .rasterizer import Floats, Palette, Picture, RasterModel, Surfaces, TriangleCorners, place_models
from .viewpoint import PictureView

_MIN_CONTRAST = 9
"""Difference between neighbours, in steps of 255, above which a pixel is sampled finely."""
_SHADOW_MAP_SIDE = 1024
"""Side of the shadow map, texels."""
_DEPTH_TOLERANCE = np.float32(0.99995)
"""Factor on a depth below which it counts as nearer: the rasteriser also changes covered depths by some
millionths."""
_MAX_SHADOW_HEIGHT, _SHADOW_MARGIN = 1.25, 0.3
"""Height up to which bodies cast shadows, and distance around the fixed part within which they do, m."""


@dataclass(frozen=True, slots=True, eq=False)
class _Still:
    """Fixed part: its surfaces, its lighting, and its finished image."""

    surfaces: Surfaces
    shadows: Shadows
    texels: NDArray[np.intp]
    """Position of each pixel on the shadow map, (h, w)."""
    openness: Floats
    """Share of the sky, (h/2, w/2)."""
    picture: Picture


class MeshRenderer:
    """Renderer of images of one size from one view.

    Each pixel is shaded once; where neighbours differ, `fine` × `fine` samples of it are averaged (Mitchell
    1987, "Generating antialiased images at low sampling densities"). Where the moving part is neither visible
    nor casts a shadow, the image of the fixed part is used.
    """

    def __init__(
        self,
        fixed: Mesh,
        view: PictureView,
        size: tuple[int, int],
        look: LightingSetup | None = None,
        fine: int = 2,
    ) -> None:
        self.view, self.size = view, size
        self._look, self._fine = look or LightingSetup(), fine
        self._eye, self._axes = view.eye(), view.axes()
        self._palette = Palette()
        self._fixed = fixed
        self._fixed_corners = self._placed([(self.model(fixed), Pose())])
        width, height = size
        focal = view.focal(height)
        self._right = (((np.arange(width * fine) + 0.5) / fine - width / 2) / focal).astype(np.float32)
        self._down = (((np.arange(height * fine) + 0.5) / fine - height / 2) / focal).astype(np.float32)
        fall = np.linspace(1.015, 0.965, height, dtype=np.float32)[:, None]
        self._background = np.minimum(fall * np.array(self._look.background, np.float32), 1.0)
        self._sky = AmbientOcclusion(width // 2, height // 2, focal / 2)
        self._still: _Still | None = None

    def model(self, mesh: Mesh) -> RasterModel:
        """Prepare a mesh once for many images."""
        return RasterModel.of(mesh, self._palette)

    def picture(self, moving: Sequence[tuple[RasterModel, Pose]]) -> Picture:
        """Return RGB (h, w, 3) of the fixed part and of these models in the world."""
        if self._still is None:
            self._still = self._drawn_still(moving)
        still = self._still
        corners = self._placed(moving)
        picture = still.picture.copy()
        if not len(corners.positions):
            return picture
        surfaces = still.surfaces.copy()
        surfaces.draw(corners, self.view.fov)
        frame = _Frame(surfaces, self._fine, still.shadows.cast(corners))
        covered = (frame.depth < _every(still.surfaces.depth, self._fine) * _DEPTH_TOLERANCE).view(np.uint8)
        if covered.any():
            nearest = float(frame.depth[covered.view(np.bool_)].min())
            reach = 2 * math.ceil(self._sky.reach(nearest))
            window = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
            covered = cv2.dilate(covered, window).astype(np.uint8, copy=False)
        changed = covered.view(np.bool_) | np.take(frame.cast.changed, still.texels)
        frame.openness[:] = still.openness
        window = _window_of(covered[1::2, 1::2])
        frame.openness[window] = self._sky.open(frame.small_marks, frame.small_depth, window)
        self._shade(picture, frame, still.shadows, changed)
        return picture

    def _drawn_still(self, moving: Sequence[tuple[RasterModel, Pose]]) -> _Still:
        """Draw the fixed part, with the ground and a shadow map large enough for the first moving part."""
        low, high = self._bounds(moving)
        shadows = Shadows(unit(np.array(self._look.sun)), low, high, self._eye, self._axes, _SHADOW_MAP_SIDE)
        shadows.keep(self._fixed_corners)
        surfaces = Surfaces.none(self.size[0] * self._fine, self.size[1] * self._fine)
        if self._eye[2] > self._look.floor:
            ground = self._placed([(_ground(low, high, self._look.floor), Pose())])
            surfaces.draw(self._fixed_corners.with_(ground), self.view.fov)
        else:
            surfaces.draw(self._fixed_corners, self.view.fov)
        frame = _Frame(surfaces, self._fine, shadows.cast(self._placed([])))
        whole = (slice(0, self.size[1] // 2), slice(0, self.size[0] // 2))
        frame.openness[:] = self._sky.open(frame.small_marks, frame.small_depth, whole)
        every = np.ones(frame.depth.shape, np.bool_)
        texels = shadows.texels(self._samples(frame, every)).reshape(every.shape)
        picture = np.empty((*every.shape, 3), np.uint8)
        self._shade(picture, frame, shadows, every)
        return _Still(surfaces, shadows, texels, frame.openness, picture)

    def _placed(self, models: Sequence[tuple[RasterModel, Pose]]) -> TriangleCorners:
        axes, eye = self._axes, self._eye
        return place_models(
            (model, axes @ pose.rotation(), axes @ (np.array(pose.position) - eye)) for model, pose in models
        )

    def _bounds(self, moving: Sequence[tuple[RasterModel, Pose]]) -> tuple[Array, Array]:
        """Return the ends of a box in the world around everything, from the ground to some height above.

        With a fixed part, the moving part does not count. Otherwise processes that begin with different
        frames of a film would draw different shadows.
        """
        around = self._fixed.vertices
        if not len(around):
            places = [m.positions @ p.rotation().T + np.array(p.position) for m, p in moving]
            around = np.concatenate([np.zeros((1, 3)), *places])
        floor = self._look.floor
        margin = np.array([_SHADOW_MARGIN, _SHADOW_MARGIN, 0.0])
        low, high = around.min(axis=0) - margin, around.max(axis=0) + margin
        low[2], high[2] = min(low[2], floor), max(high[2], floor + _MAX_SHADOW_HEIGHT)
        return low, high

    def _samples(self, frame: _Frame, wanted: NDArray[np.bool_]) -> PixelSamples:
        """Return one sample for each of these pixels (h, w)."""
        rows, columns = np.nonzero(wanted)
        place = (_along_side(self._right, self._fine)[columns], _along_side(self._down, self._fine)[rows])
        return PixelSamples.of((rows, columns), place, frame.marks[rows, columns], frame.depth[rows, columns])

    def _shade(self, picture: Picture, frame: _Frame, shadows: Shadows, wanted: NDArray[np.bool_]) -> None:
        """Draw these pixels (h, w) again."""
        samples = self._samples(frame, wanted)
        openness = frame.wide_openness
        picture[samples.rows, samples.columns] = _rgb_bytes(self._lit(samples, frame, shadows, openness))
        fine = self._fine
        if fine < 2:
            return
        window = np.ones((3, 3), np.uint8)
        contrast = cv2.split(cv2.subtract(cv2.dilate(picture, window), cv2.erode(picture, window)))
        most = cv2.max(cv2.max(contrast[0], contrast[1]), contrast[2])
        rows, columns = np.nonzero((most > _MIN_CONTRAST) & wanted)
        if not len(rows):
            return
        down, right = np.repeat(np.arange(fine), fine), np.tile(np.arange(fine), fine)
        y = (rows[:, None] * fine + down).ravel()
        x = (columns[:, None] * fine + right).ravel()
        many = (rows.repeat(fine * fine), columns.repeat(fine * fine))
        surfaces = frame.surfaces
        samples = PixelSamples.of(
            many, (self._right[x], self._down[y]), surfaces.marks[y, x], surfaces.depth[y, x]
        )
        colours = np.clip(self._lit(samples, frame, shadows, openness), 0, 1)
        colours = colours.reshape(len(rows), fine * fine, 3)
        picture[rows, columns] = _rgb_bytes(np.einsum("pki->pi", colours) / np.float32(fine * fine))

    def _lit(self, samples: PixelSamples, frame: _Frame, shadows: Shadows, openness: Floats) -> Floats:
        return shade_samples(
            samples,
            shadows.lit(frame.cast, samples),
            openness[samples.rows, samples.columns],
            self._look,
            self._axes,
            self._palette.table(),
            self._background[samples.rows],
        )


class _Frame:
    """Surfaces of one image, with those of every pixel and of every second pixel."""

    def __init__(self, surfaces: Surfaces, fine: int, cast: ShadowMap) -> None:
        self.surfaces, self.cast = surfaces, cast
        self.depth = _every(surfaces.depth, fine)
        self.marks = _every(surfaces.marks, fine)
        height, width = (side // 2 * 2 for side in self.depth.shape)
        self.small_depth = np.ascontiguousarray(self.depth[1:height:2, 1:width:2])
        self.small_marks = self.marks[1:height:2, 1:width:2]
        self.openness = np.ones_like(self.small_depth)

    @cached_property
    def wide_openness(self) -> Floats:
        """Share of the sky for every pixel."""
        height, width = self.depth.shape
        return cv2.resize(self.openness, (width, height), interpolation=cv2.INTER_LINEAR).astype(np.float32)


def render(
    mesh: Mesh, view: PictureView, size: tuple[int, int], look: LightingSetup | None = None, fine: int = 2
) -> Picture:
    """Render one mesh in the world as RGB (h, w, 3)."""
    studio = MeshRenderer(join_meshes([]), view, size, look, fine)
    return studio.picture([(studio.model(mesh), Pose())])


def _every(samples: Floats, fine: int) -> Floats:
    """Return the sample that represents each pixel."""
    return samples[fine // 2 :: fine, fine // 2 :: fine]


def _along_side(samples: Floats, fine: int) -> Floats:
    return samples[fine // 2 :: fine]


def _window_of(mask: NDArray[np.uint8]) -> tuple[slice, slice]:
    """Return the smallest window (rows, columns) with all set pixels; at least one pixel."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return slice(0, 1), slice(0, 1)
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def _ground(low: Array, high: Array, height: float) -> RasterModel:
    """Return the part of the ground on which shadows may fall."""
    (x0, y0), (x1, y1) = low[:2] - 0.8, high[:2] + 0.8
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y0), (x1, y1), (x0, y1)]
    positions = np.array([(x, y, height) for x, y in corners], np.float32)
    return RasterModel(positions, np.tile(np.array([0, 0, 1], np.float32), (6, 1)), np.ones(6, np.float32))


def _rgb_bytes(colours: Floats) -> Picture:
    return np.clip(colours * np.float32(255) + np.float32(0.5), 0, 255).astype(np.uint8)
