"""Lighting of an image: sun with soft shadows, sky, and ambient occlusion."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ...logs.triangle_meshes import unit
from ...world.values import Array, Vector3
from .rasterizer import Floats, TriangleCorners, draw_depth, unpack_marks

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
        right = unit(np.cross([0.0, 1.0, 0.0], sun))
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
    sun = axes @ unit(np.array(look.sun))
    halfway = unit(sun + axes @ -axes[2])
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
