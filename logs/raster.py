"""A software rasteriser for still pictures: z-buffer, smooth shading, a soft shadow, darkened corners.

Plain numpy, so that a picture is the same on every machine and needs neither a display nor a GPU.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from ..world.values import Array, Vector3
from .meshes import Indices, Mesh, unit

Picture: TypeAlias = NDArray[np.uint8]

_BATCH = 300_000
"""Pixels that are looked at in one go: bounds the memory."""
_BAND = 30_000
_LARGE = 20_000
"""Pixels of a triangle's bounding box from which on it is drawn by itself."""
_GAMMA = 2.2


@dataclass(frozen=True, slots=True)
class View:
    """Where the picture is taken from: angles in rad (azimuth about the world's z from +x), lengths in m."""

    target: Vector3 = (0.36, 0.0, 0.21)
    distance: float = 2.4
    azimuth: float = math.radians(-30.0)
    elevation: float = math.radians(25.0)
    fov: float = math.radians(32.0)
    """Vertical."""

    def eye(self) -> Array:
        flat = math.cos(self.elevation)
        direction = (
            flat * math.cos(self.azimuth),
            flat * math.sin(self.azimuth),
            math.sin(self.elevation),
        )
        return np.array(self.target) + self.distance * np.array(direction)

    def axes(self) -> Array:
        """Rows: right, down, forward of the picture in the world."""
        forward = unit(np.array(self.target) - self.eye())
        right = unit(np.cross(forward, [0.0, 0.0, 1.0]))
        return np.stack([right, np.cross(forward, right), forward])


@dataclass(frozen=True, slots=True)
class Look:
    """Light and background."""

    background: tuple[float, float, float] = (0.955, 0.962, 0.972)
    floor: float = -0.04
    """Height of the ground on which shadows fall, m."""
    sun: Vector3 = (0.5, 0.7, 1.1)
    """Direction towards the light."""
    key: float = 0.58
    sky: float = 0.46
    ground: float = 0.26


@dataclass(frozen=True, slots=True, eq=False)
class _Fragments:
    """What is seen in each pixel (h, w): the face (-1: none), and its nearness (h, w)."""

    face: Indices
    nearness: Array


@dataclass(frozen=True, slots=True, eq=False)
class _Triangles:
    """Triangles on a picture: corners (n, 3, 2) in pixels, and for each a plane (n, 3): a value that is
    linear on the picture is plane @ (x, y, 1)."""

    corners: Array
    edges: Array
    """(n, 3, 3): for each corner the plane of its weight, which is 1 there and 0 at the others."""
    nearness: Array

    @classmethod
    def of(cls, corners: Array, nearness: Array) -> _Triangles:
        """`nearness` (n, 3) of the corners: 1/depth in perspective, height in a parallel projection."""
        x, y = corners[:, :, 0], corners[:, :, 1]
        area = (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (y[:, 1] - y[:, 0]) * (x[:, 2] - x[:, 0])
        area = np.where(np.abs(area) > 1e-9, area, np.inf)
        edges = np.empty((len(corners), 3, 3))
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            edges[:, k, 0] = (y[:, i] - y[:, j]) / area
            edges[:, k, 1] = (x[:, j] - x[:, i]) / area
            edges[:, k, 2] = (x[:, i] * y[:, j] - x[:, j] * y[:, i]) / area
        return cls(corners, edges, np.einsum("nk,nki->ni", nearness, edges))


def render(mesh: Mesh, view: View, size: tuple[int, int], look: Look | None = None, fine: int = 2) -> Picture:
    """RGB (h, w, 3) of the mesh in the world, drawn `fine` times as large and then averaged."""
    look = look or Look()
    width, height = size[0] * fine, size[1] * fine
    eye, axes = view.eye(), view.axes()
    focal = height / 2 / math.tan(view.fov / 2)
    seen = (mesh.vertices - eye) @ axes.T
    depth = seen[:, 2]
    safe = np.maximum(depth, 1e-6)
    points = np.stack([seen[:, 0] / safe * focal + width / 2, seen[:, 1] / safe * focal + height / 2], axis=1)
    triangles = _Triangles.of(points[mesh.faces], 1.0 / safe[mesh.faces])
    in_front = depth[mesh.faces].min(axis=1, initial=np.inf) > 0.05
    fragments = _rasterise(triangles, in_front, width, height)

    rays = _rays(width, height, focal) @ axes
    hit = fragments.face >= 0
    position, normal, colour = _surface(mesh, triangles, fragments, rays, eye)
    on_floor = _floor(mesh, hit, rays, eye, look, position)
    normal[on_floor] = (0.0, 0.0, 1.0)

    there = hit | on_floor
    lit = _lit(mesh, position, normal, there, look)
    small = (slice(fine // 2, None, fine), slice(fine // 2, None, fine))
    open_sky = _openness(position[small], normal[small], there[small], axes, eye, focal / fine)
    open_sky = cv2.resize(open_sky, (width, height), interpolation=cv2.INTER_LINEAR).astype(np.float64)
    return _shade(look, fine, hit, on_floor, normal, colour, lit, open_sky)


def _rays(width: int, height: int, focal: float) -> Array:
    """Direction (h, w, 3) through each pixel in right, down, forward; forward is 1."""
    rays = np.ones((height, width, 3))
    rays[:, :, 0] = (np.arange(width) + 0.5 - width / 2) / focal
    rays[:, :, 1] = ((np.arange(height) + 0.5 - height / 2) / focal).reshape(-1, 1)
    return rays


def _floor(
    mesh: Mesh, hit: NDArray[np.bool_], rays: Array, eye: Array, look: Look, position: Array
) -> NDArray[np.bool_]:
    """Pixels that show the ground near the scene, where shadows may lie; sets their positions."""
    if len(mesh.faces) == 0:
        return np.zeros_like(hit)
    down = ~hit & (rays[:, :, 2] < -1e-3)
    distance = np.where(down, (look.floor - eye[2]) / np.where(down, rays[:, :, 2], -1.0), 0.0)
    ground = eye[:2] + rays[:, :, :2] * distance[:, :, None]
    low, high = mesh.vertices[:, :2].min(axis=0), mesh.vertices[:, :2].max(axis=0)
    near = down.copy()
    for k in range(2):
        near &= np.asarray(ground[:, :, k] > low[k] - 0.8) & np.asarray(ground[:, :, k] < high[k] + 0.8)
    position[near, :2] = ground[near]
    position[near, 2] = look.floor
    return near


def _rasterise(triangles: _Triangles, visible: NDArray[np.bool_], width: int, height: int) -> _Fragments:
    corners = triangles.corners
    low = np.clip(np.floor(corners.min(axis=1) - 0.5), 0, [width, height]).astype(np.int64)
    high = np.clip(np.ceil(corners.max(axis=1) + 0.5), 0, [width, height]).astype(np.int64)
    spans = np.maximum(high - low, 0)
    counts = np.where(visible, spans[:, 0] * spans[:, 1], 0)
    nearest = np.zeros((height, width))
    face = np.full((height, width), -1, np.int64)
    # Large triangles one by one, where numpy's broadcasting does the work; small ones together.
    for tri in np.flatnonzero(counts > _LARGE):
        window = (slice(int(low[tri, 1]), int(high[tri, 1])), slice(int(low[tri, 0]), int(high[tri, 0])))
        _draw(triangles, int(tri), window, nearest, face)
    _draw_small(triangles, low, spans, counts, nearest, face)
    return _Fragments(face, nearest)


def _draw(
    triangles: _Triangles, tri: int, window: tuple[slice, slice], nearest: Array, face: Indices
) -> None:
    """One triangle into its window (rows, columns) of the picture."""
    rows, columns = window
    x = np.arange(columns.start, columns.stop, dtype=np.float64) + 0.5
    y = np.arange(rows.start, rows.stop, dtype=np.float64).reshape(-1, 1) + 0.5
    inside = np.ones((len(y), len(x)), np.bool_)
    for a, b, c in triangles.edges[tri].tolist():
        inside &= np.asarray(a * x + (b * y + c) >= 0)
    a, b, c = triangles.nearness[tri].tolist()
    near = a * x + (b * y + c)
    won = inside & np.asarray(near > nearest[window])
    nearest[window][won] = near[won]
    face[window][won] = tri


def _draw_small(
    triangles: _Triangles, low: Indices, spans: Indices, counts: Indices, nearest: Array, face: Indices
) -> None:
    """All triangles whose bounding box has at most _LARGE pixels, many at once."""
    width = nearest.shape[1]
    order = np.flatnonzero((counts > 0) & (counts <= _LARGE))
    batches = np.cumsum(counts[order]) // _BATCH
    flat_nearest, flat_face = nearest.ravel(), face.ravel()
    for batch in np.unique(batches):
        chosen = order[batches == batch]
        tri = np.repeat(chosen, counts[chosen])
        first = np.repeat(np.cumsum(counts[chosen]) - counts[chosen], counts[chosen])
        row, column = np.divmod(np.arange(len(tri)) - first, spans[tri, 0])
        x, y = low[tri, 0] + column, low[tri, 1] + row
        inside = np.ones(len(tri), np.bool_)
        for k in range(3):
            inside &= _on_plane(triangles.edges[:, k], tri, x, y) >= 0
        tri, pixel = tri[inside], (y * width + x)[inside]
        near = _on_plane(triangles.nearness, tri, x[inside], y[inside])
        np.maximum.at(flat_nearest, pixel, near)
        won = near >= flat_nearest[pixel]
        flat_face[pixel[won]] = tri[won]


def _on_plane(planes: Array, tri: Indices, x: Indices, y: Indices) -> Array:
    """Value of the planes (n, 3) of triangles (m,) at the centres of pixels (m,), (m,)."""
    return np.asarray(planes[tri, 0] * (x + 0.5) + planes[tri, 1] * (y + 0.5) + planes[tri, 2])


def _surface(
    mesh: Mesh, triangles: _Triangles, fragments: _Fragments, rays: Array, eye: Array
) -> tuple[Array, Array, Array]:
    """Position, normal and colour (h, w, 3) of what each pixel shows."""
    hit = fragments.face >= 0
    shape = (*hit.shape, 3)
    position, normal, colour = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    rows, columns = np.nonzero(hit)
    face, nearness = fragments.face[hit], fragments.nearness[hit]
    position[hit] = eye + rays[hit] / nearness[:, None]
    corner_nearness = np.stack(
        [
            (triangles.nearness[:, :2] * triangles.corners[:, k]).sum(axis=1) + triangles.nearness[:, 2]
            for k in range(3)
        ],
        axis=1,
    )
    mixed = np.zeros((len(face), 3))
    for k in range(3):
        weight = _on_plane(triangles.edges[:, k], face, columns, rows) * corner_nearness[face, k]
        mixed += weight[:, None] * mesh.normals[face, k]
    normal[hit] = unit(mixed)
    colour[hit] = mesh.colours[face]
    return position, normal, colour


def _lit(mesh: Mesh, position: Array, normal: Array, there: NDArray[np.bool_], look: Look) -> Array:
    """Share 0 … 1 of the sun that reaches each pixel (h, w), by a shadow map with a soft edge."""
    lit = np.ones(there.shape)
    if len(mesh.faces) == 0:
        return lit
    sun = unit(np.array(look.sun))
    right = unit(np.cross([0.0, 1.0, 0.0], sun))
    axes = np.stack([right, np.cross(sun, right), sun])
    seen = mesh.vertices @ axes.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    corner = low @ axes
    side = 1400
    scale = (side - 20) / float(np.max(high[:2] - low[:2]))
    points = (seen[:, :2] - low[:2]) * scale + 10
    triangles = _Triangles.of(points[mesh.faces], (seen[:, 2] - low[2] + 1.0)[mesh.faces])
    top = _rasterise(triangles, np.ones(len(mesh.faces), np.bool_), side, side).nearness
    top[top == 0.0] = -np.inf

    taps = [(r * math.cos(t), r * math.sin(t)) for r, n in ((1.5, 5), (4.5, 9)) for t in _turn(n)]
    for rows, columns in _bands(there):
        up = normal[rows, columns]
        place = (position[rows, columns] + up * 0.003 - corner) @ axes.T
        u, v = place[:, 0] * scale + 10, place[:, 1] * scale + 10
        height = place[:, 2] + 1.002
        # Farther taps on a slanted surface lie higher by themselves.
        slope = np.sqrt(1 / np.maximum(up @ sun, 0.15) ** 2 - 1) / scale
        spins = ((columns * 5 + rows * 3) % 4) / 4 * (math.pi / 3)
        cosines, sines = np.cos(spins), np.sin(spins)
        reached = np.zeros(len(place))
        for du, dv in taps:
            x = np.clip(u + du * cosines - dv * sines, 0, side - 1).astype(np.int64)
            y = np.clip(v + du * sines + dv * cosines, 0, side - 1).astype(np.int64)
            reached += top[y, x] <= height + np.minimum(slope * math.hypot(du, dv), 0.03)
        lit[rows, columns] = reached / len(taps)
    return lit


def _bands(there: NDArray[np.bool_]) -> Iterator[tuple[Indices, Indices]]:
    """Rows and columns of the true pixels, some ten thousand at a time: that stays in the cache."""
    rows, columns = np.nonzero(there)
    for start in range(0, len(rows), _BAND):
        yield rows[start : start + _BAND], columns[start : start + _BAND]


def _openness(
    position: Array, normal: Array, there: NDArray[np.bool_], axes: Array, eye: Array, focal: float
) -> NDArray[np.float32]:
    """Share 0 … 1 of the sky that each pixel (h, w) sees, from its neighbours on the picture only."""
    height, width = there.shape
    radius = 0.06
    steps = [(r, float(t)) for r, n in ((0.15, 4), (0.4, 6), (0.9, 8)) for t in _turn(n)]
    openness = np.ones(there.shape, np.float32)
    for rows, columns in _bands(there):
        here, up = position[rows, columns], normal[rows, columns]
        reach = radius * focal / ((here - eye) @ axes[2])
        closed = np.zeros(len(here))
        spins = ((columns * 7 + rows * 13) % 8) / 8 * (2 * math.pi)
        for share, turn in steps:
            x = np.clip(columns + share * reach * np.cos(turn + spins), 0, width - 1).astype(np.int64)
            y = np.clip(rows + share * reach * np.sin(turn + spins), 0, height - 1).astype(np.int64)
            to = position[y, x] - here
            length = np.sqrt(np.einsum("pi,pi->p", to, to)) + 1e-6
            rise = np.einsum("pi,pi->p", to, up) / length - 0.12
            closed += np.maximum(rise, 0.0) * np.clip(2.0 - length / radius, 0.0, 1.0) * there[y, x]
        openness[rows, columns] = np.clip(1.0 - 1.7 * closed / len(steps), 0.25, 1.0)
    return cv2.GaussianBlur(openness, (0, 0), 1.1).astype(np.float32)


def _turn(n: int) -> Array:
    return np.arange(n, dtype=np.float64) * (2 * math.pi / n) + 0.3 * n


def _shade(
    look: Look,
    fine: int,
    hit: NDArray[np.bool_],
    on_floor: NDArray[np.bool_],
    normal: Array,
    colour: Array,
    lit: Array,
    open_sky: Array,
) -> Picture:
    """Light everything, blend the floor into the background, and average down."""
    height, width = hit.shape
    fall = np.linspace(1.015, 0.965, height)[:, None, None]
    image = np.tile(np.array(look.background), (height, width, 1)) * fall
    shade = 1.0 - 0.2 * (1.0 - lit[on_floor]) - 0.35 * (1.0 - open_sky[on_floor])
    image[on_floor] *= shade[:, None]

    sun = unit(np.array(look.sun))
    up = normal[hit][:, 2]
    ambient = look.ground + (look.sky - look.ground) * (0.5 + 0.5 * up)
    direct = look.key * np.maximum(normal[hit] @ sun, 0.0) * lit[hit]
    light = ambient * open_sky[hit] + direct
    image[hit] = (colour[hit] ** _GAMMA * light[:, None]) ** (1 / _GAMMA)
    small = cv2.resize(
        np.clip(image, 0.0, 1.0), (width // fine, height // fine), interpolation=cv2.INTER_AREA
    )
    return np.round(small * 255.0).astype(np.uint8)
