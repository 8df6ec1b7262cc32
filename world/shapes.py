"""Geometric shapes of objects. Each is centred at its own frame; a cylinder's axis is z."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from .values import Array, Pose, Vector3


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
    """Convex hull of points, m, given about its centroid. `source` is the file of origin; it does not
    count in comparisons."""

    vertices: tuple[Vector3, ...]
    source: str = field(compare=False)


Shape: TypeAlias = Box | Cylinder | Sphere | ConvexMesh


def scaled(shape: Shape, factor: float) -> Shape:
    """The shape, `factor` times as large along each of its axes."""
    match shape:
        case Box((x, y, z)):
            return Box((x * factor, y * factor, z * factor))
        case Cylinder(radius, height):
            return Cylinder(radius * factor, height * factor)
        case Sphere(radius):
            return Sphere(radius * factor)
        case ConvexMesh(vertices, source):
            return ConvexMesh(tuple((x * factor, y * factor, z * factor) for x, y, z in vertices), source)


def corners(shape: Shape) -> Array:
    """Points (n, 3) whose convex hull contains the shape (a circle by its circumscribed octagon), m."""
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
        case ConvexMesh(vertices):
            return np.array(vertices)


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
