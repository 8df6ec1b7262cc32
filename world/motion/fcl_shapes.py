"""Our shapes as python-fcl's geometries, and the signed distance of two placed ones."""

from __future__ import annotations

from dataclasses import dataclass

import fcl
import numpy as np

from ..shapes import Box, ConvexMesh, Cylinder, Shape, Sphere, corners
from ..values import Array, Pose, Vector3

_REQUEST = fcl.DistanceRequest(enable_nearest_points=True, enable_signed_distance=True)


@dataclass(frozen=True, slots=True)
class Solid:
    """A convex geometry in its own frame with the corners (m, 3) of a hull around it, for bounding boxes."""

    geometry: fcl.CollisionGeometry
    corners: Array


class Placed:
    """A solid at a pose in the world, with its axis-aligned bounds."""

    def __init__(self, solid: Solid, rotation: Array, position: Array) -> None:
        points = solid.corners @ rotation.T + position
        self.low: Array = points.min(axis=0)
        self.high: Array = points.max(axis=0)
        self.solid = solid
        self.object = fcl.CollisionObject(solid.geometry, fcl.Transform(rotation, position))


def solid(shape: Shape) -> Solid:
    match shape:
        case Box((x, y, z)):
            geometry = fcl.Box(x, y, z)
        case Cylinder(radius, height):
            geometry = fcl.Cylinder(radius, height)
        case Sphere(radius):
            geometry = fcl.Sphere(radius)
        case ConvexMesh(vertices):
            return hull(np.array(vertices))
    return Solid(geometry, corners(shape))


def hull(points: Array) -> Solid:
    """The convex hull of points (m, 3)."""
    # Imported here: it takes 0.3 s, and who only checks a mission needs no hulls.
    import trimesh

    mesh = trimesh.Trimesh(points, process=False).convex_hull
    vertices: Array = np.array(mesh.vertices, dtype=np.float64)
    faces = np.array(mesh.faces, dtype=np.int64)
    flat = np.column_stack([np.full(len(faces), 3, dtype=np.int64), faces]).ravel()
    return Solid(fcl.Convex(vertices, len(faces), flat), vertices)


def place(shape: Solid, pose: Pose) -> Placed:
    return Placed(shape, pose.rotation(), np.array(pose.position))


@dataclass(frozen=True, slots=True)
class Gap:
    """Signed distance, m (negative: depth), and the two nearest points in the world."""

    distance: float
    point_a: Vector3
    point_b: Vector3


def gap(a: Placed, b: Placed) -> Gap:
    return gap_of(a.object, b.object)


def gap_of(a: fcl.CollisionObject, b: fcl.CollisionObject) -> Gap:
    result = fcl.DistanceResult()
    fcl.distance(a, b, _REQUEST, result)
    (ax, ay, az), (bx, by, bz) = (tuple(float(c) for c in p) for p in result.nearest_points)
    return Gap(float(result.min_distance), (ax, ay, az), (bx, by, bz))


def bounds_apart(a: Placed, b: Placed, margin: float) -> bool:
    """Whether the bounding boxes are further apart than `margin`: then the bodies are, too."""
    return bool(np.any(a.low > b.high + margin) or np.any(b.low > a.high + margin))
