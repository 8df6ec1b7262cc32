"""Renderer of meshes with sun, sky and shadows: draws the fixed part once, the moving one per image."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from picktree.logs import triangle_meshes
from picktree.world import Array, Pose, Vector3

from .rasterizer import (
    Floats,
    Palette,
    Picture,
    RasterModel,
    Surfaces,
    TriangleCorners,
    draw_depth,
    place_models,
    unpack_marks,
)
from .viewpoint import PictureView

_SUN_DISTANCE = 30.0
"""Distance of the sun, m: far enough for parallel light, near enough for single precision."""
_SHADOW_EDGE_HALF_WIDTH = 0.009
"""Half the width of a shadow's edge, m."""
_OCCLUSION_RADIUS = 0.05
"""Distance up to which one surface occludes the sky for another, m."""
_GAMMA = 2.2


@dataclass(frozen=True, slots=True)
class LightingSetup:
    """Light and background."""

    background: tuple[float, float, float] = (0.955, 0.962, 0.972)
    floor: float = -0.04
    """Height of the ground on which shadows fall, m."""
    sun: Vector3 = (0.5, 0.7, 1.1)
    """Direction towards the light, in the world."""
    key: float = 0.58
    sky: float = 0.46
    ground: float = 0.26
    gloss: float = 0.10


@dataclass(frozen=True, slots=True, eq=False)
class PixelSamples:
    """Samples of an image: pixel, colour number, normal and position of each.

    Pixels are (n,), colour numbers (n,) with 0 for nothing and 1 for the ground. Normals (3, n) and positions
    (3, n), m, are in the camera's right, down, forward.
    """

    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    number: NDArray[np.intp]
    normal: Floats
    position: Floats

    @classmethod
    def of(
        cls,
        pixel: tuple[NDArray[np.intp], NDArray[np.intp]],
        place: tuple[Floats, Floats],
        marks: Floats,
        depth: Floats,
    ) -> PixelSamples:
        """Make samples. `place`: rays' right and down at depth 1. Marks (n, 3) and depth (n,) as
        rasterised."""
        number, normal = unpack_marks(marks)
        return cls(*pixel, number, normal, np.stack([place[0] * depth, place[1] * depth, depth]))


@dataclass(frozen=True, slots=True, eq=False)
class ShadowMap:
    """Distance (side, side) from the sun to the nearest surface, m.

    `least` and `most` are its minimum and maximum over a shadow's edge. `changed` marks differences from the
    map of the fixed part.
    """

    nearest: Floats
    least: Floats
    most: Floats
    changed: NDArray[np.bool_]


class Shadows:
    """Shadows by shadow mapping: which samples the sun reaches."""

    def __init__(self, sun: Array, low: Array, high: Array, eye: Array, axes: Array, side: int) -> None:
        """Prepare an empty map over the box `low` … `high`, in the world.

        `sun` points towards the sun. `eye` and `axes` are the camera's, in the world. `side` is the map's
        side in texels.
        """
        ends = np.stack([low, high])
        corners = np.array([[ends[i, 0], ends[j, 1], ends[k, 2]] for i, j, k in np.ndindex(2, 2, 2)])
        middle = (low + high) / 2
        right = triangle_meshes.unit(np.cross([0.0, 1.0, 0.0], sun))
        world_axes = np.stack([right, np.cross(-sun, right), -sun])
        place = middle + sun * _SUN_DISTANCE
        seen = (corners - place) @ world_axes.T
        half = float(np.abs(seen[:, :2] / seen[:, 2:]).max()) * 1.02
        self._fov = 2 * math.atan(half)
        self._between = (float(seen[:, 2].min()) - 1.0, float(seen[:, 2].max()) + 1.0)
        self._focal, self._side = side / 2 / half, side
        self._texel = _SUN_DISTANCE / self._focal
        self._from_camera = np.eye(4)
        self._from_camera[:3, :3] = world_axes @ axes.T
        self._from_camera[:3, 3] = world_axes @ (eye - place)
        self._sun = (axes @ sun).astype(np.float32)
        self._fixed = np.full((side, side), self._between[1], np.float32)

    def keep(self, fixed: TriangleCorners) -> None:
        """Draw the bodies that cast shadows in every image."""
        draw_depth(fixed, self._fixed, self._from_camera, self._fov, self._between)

    def cast(self, moving: TriangleCorners) -> ShadowMap:
        """Return the map with the moving bodies."""
        nearest = self._fixed.copy()
        draw_depth(moving, nearest, self._from_camera, self._fov, self._between)
        reach = math.ceil(_SHADOW_EDGE_HALF_WIDTH / self._texel)
        window = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
        changed = cv2.dilate((nearest < self._fixed - np.float32(1e-3)).view(np.uint8), window)
        return ShadowMap(
            nearest,
            cv2.erode(nearest, window).astype(np.float32, copy=False),
            cv2.dilate(nearest, window).astype(np.float32, copy=False),
            changed.view(np.bool_),
        )

    def texels(self, samples: PixelSamples) -> NDArray[np.intp]:
        """Return the position of each sample on the flat map, (n,)."""
        u, v, _ = self._seen(samples)
        return self._flat(u, v)

    def lit(self, cast: ShadowMap, samples: PixelSamples) -> Floats:
        """Return the share 0 … 1 of the sun that reaches each sample."""
        u, v, depth = self._seen(samples)
        # Distances to the sun vary within a texel on a slanted surface, so a slope tolerance is subtracted.
        facing = np.maximum(component_along(self._sun, samples.normal), np.float32(0.15))
        slope = np.sqrt(1 / (facing * facing) - 1)
        depth -= 0.002 + np.minimum(slope * np.float32(_SHADOW_EDGE_HALF_WIDTH + self._texel), 0.03)
        flat = self._flat(u, v)
        lit = (depth <= np.take(cast.least, flat)).astype(np.float32)
        edge = np.flatnonzero((lit == 0) & (depth <= np.take(cast.most, flat)))
        if len(edge):
            lit[edge] = self._reached(cast.nearest, u[edge], v[edge], depth[edge], samples, edge)
        side = np.float32(self._side)
        lit[(u < 0) | (v < 0) | (u >= side) | (v >= side)] = 1  # nothing beyond the map casts a shadow
        return lit

    def _seen(self, samples: PixelSamples) -> tuple[Floats, Floats, Floats]:
        """Return column and row on the map, and distance from the sun, m."""
        x, y, z = samples.position
        turn, place = self._from_camera[:3, :3].astype(np.float32), self._from_camera[:3, 3].tolist()
        depth = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z + np.float32(place[2])
        scale = np.float32(self._focal) / depth
        middle = np.float32(self._side / 2)
        u = (turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z + np.float32(place[0])) * scale + middle
        v = (turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z + np.float32(place[1])) * scale + middle
        return u, v, depth

    def _flat(self, u: Array | Floats, v: Array | Floats) -> NDArray[np.intp]:
        most = np.float32(self._side - 1)
        row, column = (np.minimum(np.maximum(a, 0), most).astype(np.int32) for a in (v, u))
        return (row * self._side + column).astype(np.intp)

    def _reached(
        self,
        nearest: Floats,
        u: Floats,
        v: Floats,
        depth: Floats,
        samples: PixelSamples,
        edge: NDArray[np.intp],
    ) -> Floats:
        """Return the share for samples near a shadow's edge, from some positions around each."""
        radius = _SHADOW_EDGE_HALF_WIDTH / self._texel
        taps = [(r * radius, t) for r, n in ((0.3, 5), (0.65, 8), (0.95, 11)) for t in spread_angles(n)]
        # Rotated from pixel to pixel, so that few taps make no bands.
        turned = (samples.columns[edge] * 5 + samples.rows[edge] * 3) % 4
        spin = turned.astype(np.float32) * np.float32(0.21)
        cosine, sine = np.cos(spin), np.sin(spin)
        reached = np.zeros(len(edge), np.float32)
        for r, t in taps:
            du, dv = np.float32(r * math.cos(t)), np.float32(r * math.sin(t))
            flat = self._flat(u + (du * cosine - dv * sine), v + (du * sine + dv * cosine))
            reached += depth <= np.take(nearest, flat)
        return reached / np.float32(len(taps))


class AmbientOcclusion:
    """Ambient occlusion: the share of the sky that each pixel sees, estimated from its neighbours in the
    image."""

    def __init__(self, width: int, height: int, focal: float) -> None:
        """Prepare for images of that size; `focal` in pixels."""
        self._focal = focal
        self._right = ((np.arange(width) + 0.5 - width / 2) / focal).astype(np.float32)
        self._down = ((np.arange(height) + 0.5 - height / 2) / focal).astype(np.float32).reshape(-1, 1)

    def reach(self, depth: float) -> float:
        """Return the distance up to which a surface at that depth (m) may change the occlusion of a pixel,
        pixels."""
        return _OCCLUSION_RADIUS * self._focal / depth + 1.5

    def open(self, marks: Floats, depth: Floats, window: tuple[slice, slice]) -> Floats:
        """Return the share 0 … 1 for the pixels of a window (rows, columns), of marks (h, w, 3) and depth (h,
        w)."""
        rows, columns = window
        number, normal = unpack_marks(marks[window].reshape(-1, 3))
        own = depth[window]
        nx, ny, nz = normal.reshape(3, *own.shape)
        # 1/depth is linear on a plane, so it may be interpolated.
        near = np.float32(1) / depth
        right, down = self._right[columns], self._down[rows]
        column = np.arange(columns.start, columns.stop, dtype=np.float32)
        row = np.arange(rows.start, rows.stop, dtype=np.float32).reshape(-1, 1)
        # A few directions, rotated from pixel to pixel, so that few taps make no bands.
        spin = ((column * 7 + row * 13) % 4) * np.float32(math.pi / 8)
        reach = np.float32(_OCCLUSION_RADIUS * self._focal) * near[window]
        cosine, sine = reach * np.cos(spin), reach * np.sin(spin)
        x, y = right * own, down * own
        closed = np.zeros_like(own)
        per_pixel = np.float32(1 / self._focal)
        for share, turn in ((r, t) for r, n in ((0.2, 4), (0.5, 5), (0.95, 6)) for t in spread_angles(n)):
            a, b = np.float32(share * math.cos(turn)), np.float32(share * math.sin(turn))
            du, dv = a * cosine - b * sine, a * sine + b * cosine
            there = cv2.remap(near, column + du, row + dv, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            z = 1 / there
            tx = (right + du * per_pixel) * z - x
            ty = (down + dv * per_pixel) * z - y
            tz = z - own
            length = np.sqrt(tx * tx + ty * ty + tz * tz) + np.float32(1e-6)
            rise = (tx * nx + ty * ny + tz * nz) / length - np.float32(0.12)
            fade = np.minimum(np.maximum(2 - length * np.float32(1 / _OCCLUSION_RADIUS), 0), 1)
            closed += np.maximum(rise, 0) * fade
        openness = np.clip(1 - np.float32(1.7 / 15) * closed, 0.25, 1)
        openness[(number == 0).reshape(own.shape)] = 1
        return cv2.GaussianBlur(openness, (0, 0), 0.9).astype(np.float32)


def shade_samples(
    samples: PixelSamples,
    lit: Floats,
    openness: Floats,
    look: LightingSetup,
    axes: Array,
    table: Floats,
    behind: Floats,
) -> Floats:
    """Return the colour (n, 3), 0 … 1, of samples with their shares of the sun, `lit`, and of the sky,
    `openness`.

    `axes` are the camera's in the world, `table` the colours by number, `behind` (n, 3) the background.
    """
    sun = axes @ triangle_meshes.unit(np.array(look.sun))
    halfway = triangle_meshes.unit(sun + axes @ -axes[2])
    up = component_along((axes @ np.array([0.0, 0.0, 1.0])).astype(np.float32), samples.normal)
    ambient = look.ground + (look.sky - look.ground) * (0.5 + 0.5 * up)
    light = (
        ambient * openness
        + look.key * np.maximum(component_along(sun.astype(np.float32), samples.normal), 0) * lit
    )
    colour = np.take(table, samples.number, axis=0) * (light ** np.float32(1 / _GAMMA))[:, None]
    shine = np.maximum(component_along(halfway.astype(np.float32), samples.normal), 0) ** 24
    colour += (np.float32(look.gloss) * shine * lit)[:, None]
    ground = np.flatnonzero(samples.number <= 1)
    dark = np.where(
        samples.number[ground] == 1, 1 - 0.2 * (1 - lit[ground]) - 0.35 * (1 - openness[ground]), 1
    )
    colour[ground] = behind[ground] * dark[:, None]
    return colour.astype(np.float32)


def spread_angles(n: int) -> list[float]:
    """Return n angles spread over a turn, rad."""
    return [2 * math.pi * k / n + 0.3 * n for k in range(n)]


def component_along(direction: Floats, normal: Floats) -> Floats:
    """Return the component of the normals (3, n) in that direction, (n,)."""
    a, b, c = direction
    return a * normal[0] + b * normal[1] + c * normal[2]


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
        fixed: triangle_meshes.Mesh,
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

    def model(self, mesh: triangle_meshes.Mesh) -> RasterModel:
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
        shadows = Shadows(
            triangle_meshes.unit(np.array(self._look.sun)), low, high, self._eye, self._axes, _SHADOW_MAP_SIDE
        )
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
    mesh: triangle_meshes.Mesh,
    view: PictureView,
    size: tuple[int, int],
    look: LightingSetup | None = None,
    fine: int = 2,
) -> Picture:
    """Render one mesh in the world as RGB (h, w, 3)."""
    studio = MeshRenderer(triangle_meshes.join_meshes([]), view, size, look, fine)
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
