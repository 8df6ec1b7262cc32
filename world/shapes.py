"""Geometric shapes of objects, and rays against them. Each shape is centred at its own frame; a cylinder's
axis is z."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from functools import lru_cache, reduce
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from picktree.files import library_parts

from .values import Array, Pose, Vector3

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull


@dataclass(frozen=True, slots=True)
class Box:
    """Edge lengths along x, y, z, m."""

    size: Vector3


@dataclass(frozen=True, slots=True)
class Cylinder:
    """Radius and height, m; the axis is z."""

    radius: float
    height: float


@dataclass(frozen=True, slots=True)
class Sphere:
    """Radius, m."""

    radius: float


@dataclass(frozen=True, slots=True)
class ConvexMesh:
    """Convex hull of points, m, given about its centre of mass. `source` is the file of origin; it does not
    count in comparisons."""

    vertices: tuple[Vector3, ...]
    source: str = field(compare=False)


@dataclass(frozen=True, slots=True)
class CompoundMesh(ConvexMesh):
    """Body of convex parts, m, about its centre of mass. Its `vertices` are those of its hull, which may
    replace it where only the space around the body matters."""

    parts: tuple[tuple[Vector3, ...], ...]
    """Corners of each convex part."""
    scale: float = field(default=1.0, compare=False)
    """Factor from the coordinates of its file to m."""


OBSTACLE_VOLUME = "volume"
"""Source of a convex mesh for cells of an unknown obstacle, which changes with each view."""
Shape: TypeAlias = Box | Cylinder | Sphere | ConvexMesh | CompoundMesh
"""Form of a body in its own frame, m."""


def scaled(shape: Shape, factor: float) -> Shape:
    """Return the shape, `factor` times as large along each of its axes."""
    match shape:
        case Box((x, y, z)):
            return Box((x * factor, y * factor, z * factor))
        case Cylinder(radius, height):
            return Cylinder(radius * factor, height * factor)
        case Sphere(radius):
            return Sphere(radius * factor)
        case CompoundMesh(vertices, source, parts, scale):
            larger = tuple(_scaled(part, factor) for part in parts)
            return CompoundMesh(_scaled(vertices, factor), source, larger, scale * factor)
        case ConvexMesh(vertices, source):
            return ConvexMesh(_scaled(vertices, factor), source)


def _scaled(vertices: tuple[Vector3, ...], factor: float) -> tuple[Vector3, ...]:
    return tuple((x * factor, y * factor, z * factor) for x, y, z in vertices)


@lru_cache(maxsize=256)
def convex_parts(mesh: ConvexMesh) -> tuple[ConvexMesh, ...]:
    """Return the convex bodies of which a mesh consists, in its own frame."""
    if isinstance(mesh, CompoundMesh):
        return tuple(ConvexMesh(part, mesh.source) for part in mesh.parts)
    return (mesh,)


@lru_cache(maxsize=256)
def corners(shape: Shape) -> Array:
    """Points (n, 3) whose convex hull contains the shape (a circle by its circumscribed octagon), m.

    The array is read-only.
    """
    points = _corners(shape)
    points.flags.writeable = False
    return points


def _corners(shape: Shape) -> Array:
    match shape:
        case Box(size):
            return np.array(list(itertools.product(*((-s / 2, s / 2) for s in size))))
        case Cylinder(radius, height):
            ring = radius / math.cos(math.pi / 8)
            return np.array(
                [
                    (ring * math.cos(k * math.pi / 4), ring * math.sin(k * math.pi / 4), z)
                    for k in range(8)
                    for z in (-height / 2, height / 2)
                ]
            )
        case Sphere(radius):
            return np.array(list(itertools.product((-radius, radius), repeat=3)))
        case ConvexMesh():
            return np.array(shape.vertices)


def extents(shape: Shape, rotation: Array) -> tuple[Array, Array]:
    """Lowest and highest coordinates (3,), (3,) of the shape turned by `rotation` (3, 3)."""
    match shape:
        case Sphere(radius):
            reach = np.full(3, radius)
            return -reach, reach
        case Cylinder(radius, height):
            axis = rotation[:, 2]
            reach = np.abs(axis) * height / 2 + radius * np.sqrt(np.maximum(0.0, 1.0 - axis**2))
            return -reach, reach
        case _:
            points = corners(shape) @ rotation.T
            return points.min(axis=0), points.max(axis=0)


def bottom(shape: Shape, pose: Pose) -> float:
    """Height of the lowest point of the shape at `pose`, in the parent frame, m."""
    return pose.position[2] + float(extents(shape, pose.rotation())[0][2])


def top(shape: Shape, pose: Pose) -> float:
    """Height of the highest point of the shape at `pose`, in the parent frame, m."""
    return pose.position[2] + float(extents(shape, pose.rotation())[1][2])


MIN_DIRECTION = 1e-12
"""Stands in for a zero component of a direction, so that slabs divide safely."""


def ray_hits(shape: Shape, rotation: Array, position: Array, origin: Array, directions: Array) -> Array:
    """Smallest s ≥ 0, (n,), with `origin + s·direction` on the shape; inf where the ray misses.

    `rotation` (3, 3) and `position` (3,) place the shape in the frame of `origin` (3,) and
    `directions` (n, 3), which need not be unit vectors.
    """
    near, far = ray_span(shape, rotation, position, origin, directions)
    return np.where((near <= far) & (far > 0.0), np.maximum(near, 0.0), np.inf)


def ray_span(
    shape: Shape, rotation: Array, position: Array, origin: Array, directions: Array
) -> tuple[Array, Array]:
    """Return where the rays enter and leave the shape, (n,) each; a ray that misses has near > far.

    Of a body that is not convex it is the first part that the ray meets.
    """
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
            return _first_spans([_hull_span(part, local, d) for part in convex_parts(shape)])


def _hull_span(hull: ConvexMesh, local: Array, d: Array) -> tuple[Array, Array]:
    normals, offsets = half_spaces(hull)
    speed = d @ normals.T
    speed = np.where(np.abs(speed) < MIN_DIRECTION, MIN_DIRECTION, speed)
    at = (offsets - normals @ local) / speed
    entering = speed < 0
    near = np.where(entering, at, -np.inf).max(axis=1)
    far = np.where(entering, np.inf, at).min(axis=1)
    return near, far


def _first_spans(spans: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Return the span of the first part that each ray meets ahead of it, or else behind it."""
    near, far = spans[0]
    for start, end in spans[1:]:
        met, known = start <= end, near <= far
        # Surfaces behind the origin hide nothing.
        ahead = np.where(end > 0.0, start, np.inf) < np.where(known & (far > 0.0), near, np.inf)
        taken = met & (ahead | ~known)
        near, far = np.where(taken, start, near), np.where(taken, end, far)
    return near, far


def _slabs(local: Array, d: Array, half: Array) -> tuple[Array, Array]:
    flat = np.abs(d) < MIN_DIRECTION
    if np.count_nonzero(flat):
        d = np.where(flat, MIN_DIRECTION, d)
    middle, reach = -local / d, np.abs(half / d)
    # Column by column: numpy is slow along an axis of three.
    near, far = (middle - reach).T, (middle + reach).T
    return reduce(np.maximum, near), reduce(np.minimum, far)


def _quadratic(a: Array, b: Array, c: float) -> tuple[Array, Array]:
    """Return the roots of a·s² + 2·b·s + c; near > far without real roots."""
    a = np.maximum(a, MIN_DIRECTION)
    root = b * b - a * c
    hit = root >= 0.0
    reach = np.sqrt(np.where(hit, root, 0.0))
    return np.where(hit, (-b - reach) / a, np.inf), np.where(hit, (-b + reach) / a, -np.inf)


@lru_cache(maxsize=256)
def greatest_length(shape: Shape) -> float:
    """Return the greatest distance of two points of the shape, m."""
    match shape:
        case Box(size):
            return math.hypot(*size)
        case Sphere(radius):
            return 2.0 * radius
        case Cylinder(radius, height):
            return math.hypot(2.0 * radius, height)
        case ConvexMesh():
            points = np.array(shape.vertices)
            return float(np.linalg.norm(points[:, None] - points[None], axis=2).max())


def convex_hull(points: Array, options: str | None = None) -> ConvexHull:
    """Return the convex hull of points (n, 2) or (n, 3), by qhull. `options` are qhull's own.

    Raises: RuntimeError: The points have no extent in one direction, and are not joggled (option `QJ`).
    """
    kind = library_parts.library_part(
        "scipy.spatial._qhull", "scipy.spatial.ConvexHull", "scipy.linalg", "scipy._lib"
    )
    return kind(points, qhull_options=options)


@lru_cache(maxsize=256)
def half_spaces(mesh: ConvexMesh) -> tuple[Array, Array]:
    """Outward unit normals (m, 3) and offsets (m,) of the hull's faces: inside is n·x ≤ offset."""
    equations = np.unique(np.round(convex_hull(np.array(mesh.vertices)).equations, 9), axis=0)
    return equations[:, :3].copy(), -equations[:, 3]


def inside(shape: Shape, pose: Pose, points: Array, margin: float = 0.0) -> NDArray[np.bool_]:
    """Select the points (n, 3) of the world in the shape at `pose`, or at most `margin` m away from its
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
            found = np.zeros(len(local), dtype=np.bool_)
            for part in convex_parts(shape):
                normals, offsets = half_spaces(part)
                found |= np.all(local @ normals.T <= offsets + margin, axis=1)
            return found
