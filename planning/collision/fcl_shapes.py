"""Shapes as python-fcl geometries, and the signed distance of two placed ones."""

from __future__ import annotations

from dataclasses import dataclass

import coal
import fcl
import numpy as np

from ...world.shapes import Box, ConvexMesh, Cylinder, Shape, Sphere, corners
from ...world.values import Array, Pose, Vector3
from .collision_bodies import CoalShapes

# No signed distance: where bodies touch, the search for the depth throws an exception that Python cannot
# catch, and the process dies (flexible-collision-library/fcl, issue 529).
_DISTANCE_REQUEST = fcl.DistanceRequest(enable_nearest_points=True)


@dataclass(frozen=True, slots=True)
class FclSolid:
    """Convex geometry in its own frame with the corners (m, 3) of a hull around it, for bounding boxes."""

    geometry: fcl.CollisionGeometry
    corners: Array
    shape: Shape
    """Shape that it was made from, for measuring the depth of an overlap."""


@dataclass(frozen=True, slots=True)
class FclMovedSolid:
    """Solid at the pose that its python-fcl object has now."""

    solid: FclSolid
    object: fcl.CollisionObject


class FclPlacedSolid:
    """Solid at a pose in the world, with its axis-aligned bounds."""

    def __init__(self, solid: FclSolid, rotation: Array, position: Array) -> None:
        points = solid.corners @ rotation.T + position
        self.low: Array = points.min(axis=0)
        self.high: Array = points.max(axis=0)
        self.solid = solid
        self.object = fcl.CollisionObject(solid.geometry, fcl.Transform(rotation, position))


def solid(shape: Shape) -> FclSolid:
    match shape:
        case Box((x, y, z)):
            geometry = fcl.Box(x, y, z)
        case Cylinder(radius, height):
            geometry = fcl.Cylinder(radius, height)
        case Sphere(radius):
            geometry = fcl.Sphere(radius)
        case ConvexMesh(vertices):
            return hull(np.array(vertices))
    return FclSolid(geometry, corners(shape), shape)


def hull(points: Array) -> FclSolid:
    """Return the convex hull of points (m, 3)."""
    # Imported here: it takes 0.3 s, and a check of a mission needs no hulls.
    import trimesh

    mesh = trimesh.Trimesh(points, process=False).convex_hull
    vertices: Array = np.array(mesh.vertices, dtype=np.float64)
    faces = np.array(mesh.faces, dtype=np.int64)
    flat = np.column_stack([np.full(len(faces), 3, dtype=np.int64), faces]).ravel()
    x, y, z = vertices.T
    shape = ConvexMesh(tuple(zip(x.tolist(), y.tolist(), z.tolist(), strict=True)), "")
    return FclSolid(fcl.Convex(vertices, len(faces), flat), vertices, shape)


def place(shape: FclSolid, pose: Pose) -> FclPlacedSolid:
    return FclPlacedSolid(shape, pose.rotation(), np.array(pose.position))


@dataclass(frozen=True, slots=True)
class FclDistance:
    """Signed distance, m (negative: depth), and the two nearest points in the world."""

    distance: float
    point_a: Vector3
    point_b: Vector3


def distance_between(a: FclPlacedSolid | FclMovedSolid, b: FclPlacedSolid | FclMovedSolid) -> FclDistance:
    """Measure the distance by python-fcl where the bodies are apart; the depth of an overlap by coal."""
    result = fcl.DistanceResult()
    fcl.distance(a.object, b.object, _DISTANCE_REQUEST, result)
    if result.min_distance > 0.0:
        (ax, ay, az), (bx, by, bz) = (tuple(float(c) for c in p) for p in result.nearest_points)
        return FclDistance(float(result.min_distance), (ax, ay, az), (bx, by, bz))
    return _overlap(a, b)


def _overlap(a: FclPlacedSolid | FclMovedSolid, b: FclPlacedSolid | FclMovedSolid) -> FclDistance:
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.enable_signed_distance = True
    depth = coal.distance(*_coal_arguments(a), *_coal_arguments(b), request, result)
    (ax, ay, az), (bx, by, bz) = (
        tuple(float(c) for c in p) for p in (result.getNearestPoint1(), result.getNearestPoint2())
    )
    # The two libraries differ by rounding for bodies that just touch.
    return FclDistance(min(float(depth), 0.0), (ax, ay, az), (bx, by, bz))


def _coal_arguments(body: FclPlacedSolid | FclMovedSolid) -> tuple[coal.CollisionGeometry, coal.Transform3s]:
    there = coal.Transform3s(body.object.getRotation(), body.object.getTranslation())
    return _COAL_SHAPES.of(body.solid.shape), there


_COAL_SHAPES = CoalShapes()


def bounds_apart(a: FclPlacedSolid, b: FclPlacedSolid, margin: float) -> bool:
    """Whether the bounding boxes are further apart than `margin`, m: then the bodies are, too."""
    return bool(np.any(a.low > b.high + margin) or np.any(b.low > a.high + margin))
