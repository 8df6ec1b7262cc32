"""Collision bodies and margins: everything around the robot as one list of named convex bodies for every
checker.

Measured: with 5 mm at an edge resolution of 0.03 rad no planned path grazed anything; without, 7 % did.
Fingers must reach flat items on the table, and a held object stands on it when its motion begins.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum, auto

import coal
import numpy as np
import pinocchio as pin

from ...world.belief.obstacle_hulls import hulls_of
from ...world.belief.planning_scene import BeliefObject, PlanningScene
from ...world.shapes import Box, ConvexMesh, Cylinder, Shape, Sphere, extents
from ...world.values import Array, Pose


def _settle_coal() -> None:
    """Measure one distance. What coal computes first decides the last bits of all later results in a process,
    so that it has to be the same in each."""
    box, here = coal.Box(1.0, 1.0, 1.0), coal.Transform3s(np.eye(3), np.zeros(3))
    there = coal.Transform3s(np.eye(3), np.array((1.6, 1.3, 2.4)))
    coal.distance(box, here, box, there, coal.DistanceRequest(), coal.DistanceResult())


_settle_coal()


class GeometryOwner(Enum):
    """Part of robot or scene that a geometry belongs to."""

    BASE = auto()
    """Links of the robot that no joint moves."""
    ARM = auto()
    HAND = auto()
    FINGER = auto()
    HELD = auto()
    SUPPORT = auto()
    OBSTACLE = auto()


GRIPPER_OWNERS = (GeometryOwner.HAND, GeometryOwner.FINGER, GeometryOwner.HELD)


@dataclass(frozen=True, slots=True)
class CollisionMargins:
    """Least distances between bodies, m; negative: tolerated depth."""

    arm: float = 0.005
    gripper: float = 0.003
    finger_support: float = 0.0005
    held_support: float = -0.002

    def between(self, a: GeometryOwner, b: GeometryOwner) -> float:
        """Return the least distance of two parts, in either order, m."""
        parts = {a, b}
        if GeometryOwner.ARM in parts or GeometryOwner.BASE in parts:
            return self.arm
        if parts == {GeometryOwner.FINGER, GeometryOwner.SUPPORT}:
            return self.finger_support
        if parts == {GeometryOwner.HELD, GeometryOwner.SUPPORT}:
            return self.held_support
        return self.gripper

    def table(self) -> Array:
        """Return `between` for all parts as a table: rows and columns by the parts' values."""
        table = np.zeros((len(GeometryOwner) + 1, len(GeometryOwner) + 1))
        for a in GeometryOwner:
            for b in GeometryOwner:
                table[a.value, b.value] = self.between(a, b)
        return table


MAX_CACHED_SHAPES = 512
"""Greatest number of shapes in memory: perceived obstacles have ever new sizes."""


class CoalShapes:
    """Geometries by shape, created once: they are immutable and shared by geometry models."""

    def __init__(self) -> None:
        self._made: dict[Shape, coal.CollisionGeometry] = {}

    def of(self, shape: Shape) -> coal.CollisionGeometry:
        made = self._made.get(shape)
        if made is None:
            if len(self._made) >= MAX_CACHED_SHAPES:
                self._made.clear()
            made = self._made[shape] = _coal_geometry(shape)
            # Without it the broad phase works with an empty box.
            made.computeLocalAABB()
        return made


def distance_request(geometry: pin.GeometryModel) -> pin.GeometryData:
    """Create scratch memory for distances that do not depend on earlier queries.

    By default each query starts where the last one of its pair ended, which moves the answer by up to 2 µm.
    """
    data = pin.GeometryData(geometry)
    with warnings.catch_warnings():
        # The documented replacement of the old switch does not switch this off.
        warnings.simplefilter("ignore", DeprecationWarning)
        for request in data.distanceRequests:
            request.enable_cached_gjk_guess = False
    return data


def _coal_geometry(shape: Shape) -> coal.CollisionGeometry:
    match shape:
        case Box((x, y, z)):
            return coal.Box(x, y, z)
        case Cylinder(radius, height):
            return coal.Cylinder(radius, height)
        case Sphere(radius):
            return coal.Sphere(radius)
        case ConvexMesh():
            points = coal.StdVec_Vec3s()
            for vertex in shape.vertices:
                points.append(np.array(vertex))
            return coal.ConvexBase.convexHull(points, True, "Qt")


@dataclass(frozen=True, slots=True)
class CollisionBody:
    """Convex part of a named body: a bin has five, an obstacle as many as its form takes."""

    name: str
    """Id of the fixture, bin or object; the name that `PlanningScene.allow` takes."""
    shape: Shape
    pose: Pose
    """Pose in the world."""
    support: bool = False
    """Whether it is a level board on which things are put: held objects and finger tips may come very close
    to it."""


def is_board(shape: Shape, pose: Pose) -> bool:
    """Whether the vertical extent is the least of the three: a table top, a shelf, a bin's floor."""
    low, high = extents(shape, pose.rotation())
    x, y, z = (float(d) for d in high - low)
    return z < x and z < y


def fixed_bodies(scene: PlanningScene) -> tuple[CollisionBody, ...]:
    """Return fixtures and the parts of the bins."""
    fixtures = [
        CollisionBody(f.id, f.shape, f.pose, is_board(f.shape, f.pose)) for f in scene.fixtures.values()
    ]
    parts = [
        CollisionBody(b.id, part, pose, is_board(part, pose))
        for b in scene.bins.values()
        for part, pose in b.parts()
    ]
    return (*fixtures, *parts)


def movable_bodies(objects: Iterable[BeliefObject]) -> tuple[CollisionBody, ...]:
    """Return the bodies of objects that are not in the hand."""
    return tuple(body for o in objects if not o.attached for body in bodies_of(o))


def bodies_of(o: BeliefObject) -> tuple[CollisionBody, ...]:
    """Return the convex parts of one object, all under its name: hulls stand for an obstacle's blocks.

    The columns of a heap stay as they are: fingers reach down beside higher ones.
    """
    if not o.blocks:
        return (CollisionBody(o.id, o.shape, o.pose),)
    if o.role == "heap":
        return tuple(CollisionBody(o.id, Box(block.size), o.pose @ Pose(block.at)) for block in o.blocks)
    return tuple(CollisionBody(o.id, shape, o.pose @ Pose(at)) for shape, at in hulls_of(o.blocks))
