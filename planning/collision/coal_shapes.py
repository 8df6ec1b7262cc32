"""Our shapes as coal's collision geometries."""

from __future__ import annotations

import warnings

import coal
import numpy as np
import pinocchio as pin

from ...world.shapes import Box, ConvexMesh, Cylinder, Shape, Sphere

KEPT = 512
"""Shapes remembered at once: perceived obstacles have ever new sizes."""


class CoalShapes:
    """Geometries by shape, made once: they are immutable and shared by geometry models."""

    def __init__(self) -> None:
        self._made: dict[Shape, coal.CollisionGeometry] = {}

    def of(self, shape: Shape) -> coal.CollisionGeometry:
        made = self._made.get(shape)
        if made is None:
            if len(self._made) >= KEPT:
                self._made.clear()
            made = self._made[shape] = _make(shape)
            # Without it the broad phase works with an empty box.
            made.computeLocalAABB()
        return made


def measuring(geometry: pin.GeometryModel) -> pin.GeometryData:
    """Scratch memory for distances that depend on no earlier query: by default each begins where the last one
    of its pair ended, which moves the answer by up to 2 µm."""
    data = pin.GeometryData(geometry)
    with warnings.catch_warnings():
        # What is said to replace the old switch does not switch this off.
        warnings.simplefilter("ignore", DeprecationWarning)
        for request in data.distanceRequests:
            request.enable_cached_gjk_guess = False
    return data


def hull(geometry: coal.CollisionGeometry) -> coal.CollisionGeometry:
    """The convex hull of a triangle mesh; a primitive as it is."""
    if isinstance(geometry, coal.BVHModelOBBRSS):
        geometry.buildConvexHull(True, "Qt")
        geometry = geometry.convex
    geometry.computeLocalAABB()
    return geometry


def _make(shape: Shape) -> coal.CollisionGeometry:
    match shape:
        case Box((x, y, z)):
            return coal.Box(x, y, z)
        case Cylinder(radius, height):
            return coal.Cylinder(radius, height)
        case Sphere(radius):
            return coal.Sphere(radius)
        case ConvexMesh(vertices):
            points = coal.StdVec_Vec3s()
            for vertex in vertices:
                points.append(np.array(vertex))
            return coal.ConvexBase.convexHull(points, True, "Qt")
