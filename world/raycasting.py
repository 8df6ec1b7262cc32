"""Rays against shapes: what depth a camera would measure on a body that is known."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from .shapes import Box, ConvexMesh, Cylinder, Shape, Sphere
from .values import Array, Pose

MIN_DIRECTION = 1e-12
"""Stands in for a zero component of a direction, so that slabs divide safely."""


def cast(shape: Shape, rotation: Array, position: Array, origin: Array, directions: Array) -> Array:
    """Smallest s ≥ 0, (n,), with `origin + s·direction` on the shape; inf where the ray misses.

    `rotation` (3, 3) and `position` (3,) place the shape in the frame of `origin` (3,) and
    `directions` (n, 3), which need not be unit vectors.
    """
    near, far = span(shape, rotation, position, origin, directions)
    return np.where((near <= far) & (far > 0.0), np.maximum(near, 0.0), np.inf)


def span(
    shape: Shape, rotation: Array, position: Array, origin: Array, directions: Array
) -> tuple[Array, Array]:
    """Where the rays enter and leave the convex shape, (n,) each; a ray that misses has near > far."""
    local = (origin - position) @ rotation
    d = directions @ rotation
    match shape:
        case Box(size):
            return _slabs(local, d, np.array(size) / 2)
        case Sphere(radius):
            return _quadratic((d * d).sum(axis=1), d @ local, float(local @ local) - radius**2)
        case Cylinder(radius, height):
            x, y = local[0], local[1]
            side = _quadratic(
                d[:, 0] ** 2 + d[:, 1] ** 2, d[:, 0] * x + d[:, 1] * y, float(x * x + y * y) - radius**2
            )
            caps = _slabs(local[2:], d[:, 2:], np.array([height / 2]))
            return np.maximum(side[0], caps[0]), np.minimum(side[1], caps[1])
        case ConvexMesh():
            normals, offsets = half_spaces(shape)
            speed = d @ normals.T
            speed = np.where(np.abs(speed) < MIN_DIRECTION, MIN_DIRECTION, speed)
            at = (offsets - normals @ local) / speed
            entering = speed < 0
            near = np.where(entering, at, -np.inf).max(axis=1)
            far = np.where(entering, np.inf, at).min(axis=1)
            return near, far


def _slabs(local: Array, d: Array, half: Array) -> tuple[Array, Array]:
    d = np.where(np.abs(d) < MIN_DIRECTION, MIN_DIRECTION, d)
    middle, reach = -local / d, np.abs(half / d)
    return (middle - reach).max(axis=1), (middle + reach).min(axis=1)


def _quadratic(a: Array, b: Array, c: float) -> tuple[Array, Array]:
    """Roots of a·s² + 2·b·s + c; near > far where there are none."""
    a = np.maximum(a, MIN_DIRECTION)
    root = b * b - a * c
    hit = root >= 0.0
    reach = np.sqrt(np.where(hit, root, 0.0))
    return np.where(hit, (-b - reach) / a, np.inf), np.where(hit, (-b + reach) / a, -np.inf)


@lru_cache(maxsize=256)
def half_spaces(mesh: ConvexMesh) -> tuple[Array, Array]:
    """Outward unit normals (m, 3) and offsets (m,) of the faces: inside is n·x ≤ offset."""
    equations = np.unique(np.round(ConvexHull(np.array(mesh.vertices)).equations, 9), axis=0)
    return equations[:, :3].copy(), -equations[:, 3]


def inside(shape: Shape, pose: Pose, points: Array, margin: float = 0.0) -> NDArray[np.bool_]:
    """Which points (n, 3) of the world lie in the shape at `pose`, or not further than `margin` m beside its
    faces."""
    local = (points - np.array(pose.position)) @ pose.rotation()
    match shape:
        case Box(size):
            return np.all(np.abs(local) <= np.array(size) / 2 + margin, axis=1)
        case Sphere(radius):
            return (local * local).sum(axis=1) <= (radius + margin) ** 2
        case Cylinder(radius, height):
            round_ = local[:, 0] ** 2 + local[:, 1] ** 2 <= (radius + margin) ** 2
            return round_ & (np.abs(local[:, 2]) <= height / 2 + margin)
        case ConvexMesh():
            normals, offsets = half_spaces(shape)
            return np.all(local @ normals.T <= offsets + margin, axis=1)
