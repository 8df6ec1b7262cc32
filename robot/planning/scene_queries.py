"""Scene queries without the arm, by python-fcl: whether a spot is free, and which bodies the hand would
touch.

The verifier of trajectories uses the same geometries.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import coal
import fcl
import numpy as np
from numpy.typing import NDArray

from picktree.files import disk_cache
from picktree.world import (
    OBSTACLE_VOLUME,
    Array,
    BeliefObject,
    Box,
    ConvexMesh,
    Cylinder,
    PlanningScene,
    Pose,
    Shape,
    Sphere,
    Vector3,
    convex_hull,
    corners,
)
from picktree.world.robot_model import RobotModel

from .collision_model import (
    MAX_CACHED_SHAPES,
    CoalShapes,
    CollisionBody,
    CollisionMargins,
    fixed_bodies,
    movable_bodies,
)
from .motion_plans import ContactPair

# No signed distance: where bodies touch, the search for the depth throws an exception that Python cannot
# catch, and the process dies (flexible-collision-library/fcl, issue 529).
_DISTANCE_REQUEST = fcl.DistanceRequest(enable_nearest_points=True)


@dataclass(frozen=True, slots=True, eq=False)
class FclSolid:
    """Convex geometry in its own frame with the corners (m, 3) of a hull around it, for bounding boxes."""

    geometry: fcl.CollisionGeometry
    corners: Array
    shape: Shape
    """Shape that it was made from, for measuring the depth of an overlap."""
    spare: list[fcl.CollisionObject] = field(default_factory=list[fcl.CollisionObject])
    """Unused objects of this solid, without a pose."""


class FclMovedSolid:
    """Solid at the pose that its python-fcl object has now.

    The object is used again: python-fcl keeps 32 bytes of each that it frees (0.7.0.8), and a pick takes
    hundreds.
    """

    def __init__(self, solid: FclSolid) -> None:
        self.solid = solid
        try:
            self.object = solid.spare.pop()
        except IndexError:
            self.object = fcl.CollisionObject(solid.geometry)

    def __del__(self) -> None:
        self.solid.spare.append(self.object)

    def move(self, rotation: Array, position: Array) -> None:
        """Move to a pose in the world, (3, 3) and (3,)."""
        self.object.setTransform(fcl.Transform(rotation, position))


class FclPlacedSolid(FclMovedSolid):
    """Solid at a pose in the world, with its axis-aligned bounds."""

    def __init__(self, solid: FclSolid, rotation: Array, position: Array) -> None:
        super().__init__(solid)
        self.move(rotation, position)
        points = solid.corners @ rotation.T + position
        self.low: Array = points.min(axis=0)
        self.high: Array = points.max(axis=0)


@lru_cache(maxsize=MAX_CACHED_SHAPES)
def solid(shape: Shape) -> FclSolid:
    match shape:
        case Box((x, y, z)):
            geometry = fcl.Box(x, y, z)
        case Cylinder(radius, height):
            geometry = fcl.Cylinder(radius, height)
        case Sphere(radius):
            geometry = fcl.Sphere(radius)
        case ConvexMesh():
            return hull(np.array(shape.vertices), keep=shape.source != OBSTACLE_VOLUME)
    return FclSolid(geometry, corners(shape), shape)


def hull(points: Array, *, keep: bool = True) -> FclSolid:
    """Return the convex hull of points (m, 3). `keep`: for later processes, in the disk cache."""
    makers = (Path(__file__), "numpy", "scipy")
    found = (
        disk_cache.cached_arrays("solid-hull", (points.tobytes(),), makers, lambda: _hull(points))
        if keep
        else _hull(points)
    )
    vertices, faces = found["vertices"], found["faces"]
    flat = np.column_stack([np.full(len(faces), 3, dtype=np.int64), faces]).ravel()
    x, y, z = vertices.T
    shape = ConvexMesh(tuple(zip(x.tolist(), y.tolist(), z.tolist(), strict=True)), "")
    return FclSolid(fcl.Convex(vertices, len(faces), flat), vertices, shape)


def _hull(points: Array) -> dict[str, NDArray[Any]]:
    """Return vertices (n, 3) of the hull and its triangles (m, 3), counter-clockwise from outside.

    Flat points, as a robot's mesh may have them, are joggled.
    """
    try:
        found = convex_hull(points)
    except RuntimeError:
        found = convex_hull(points, "QJ")
    own: NDArray[np.intp] = np.sort(found.vertices)
    vertices: Array = points[own]
    faces: NDArray[np.int64] = np.searchsorted(own, found.simplices).astype(np.int64)
    a, b, c = vertices[faces].transpose(1, 0, 2)
    normals: Array = found.equations[:, :3]
    inward = (np.cross(b - a, c - a) * normals).sum(axis=1) < 0.0
    faces[inward] = faces[inward, ::-1]
    return {"vertices": vertices, "faces": faces}


def place(shape: FclSolid, pose: Pose) -> FclPlacedSolid:
    return FclPlacedSolid(shape, pose.rotation(), np.array(pose.position))


@dataclass(frozen=True, slots=True)
class FclDistance:
    """Signed distance, m (negative: depth), and the nearest point of the second body in the world."""

    distance: float
    point: Vector3


def distance_between(a: FclMovedSolid, b: FclMovedSolid) -> FclDistance:
    """Measure the distance by python-fcl where the bodies are apart; the depth of an overlap by coal."""
    result = fcl.DistanceResult()
    fcl.distance(a.object, b.object, _DISTANCE_REQUEST, result)
    if result.min_distance > 0.0:
        x, y, z = (float(c) for c in result.nearest_points[1])
        return FclDistance(float(result.min_distance), (x, y, z))
    return _overlap(a, b)


def _overlap(a: FclMovedSolid, b: FclMovedSolid) -> FclDistance:
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.enable_signed_distance = True
    depth = coal.distance(*_coal_arguments(a), *_coal_arguments(b), request, result)
    x, y, z = (float(c) for c in result.getNearestPoint2())
    # The two libraries differ by rounding for bodies that just touch.
    return FclDistance(min(float(depth), 0.0), (x, y, z))


def _coal_arguments(body: FclMovedSolid) -> tuple[coal.CollisionGeometry, coal.Transform3s]:
    there = coal.Transform3s(body.object.getRotation(), body.object.getTranslation())
    return _COAL_SHAPES.of(body.solid.shape), there


_COAL_SHAPES = CoalShapes()


class SceneQueries:
    """Distances in the believed scene, by python-fcl. Objects in the hand are not part of it.

    It follows the scene by itself. Contacts come nearest first; `a` names the queried body, `b` the scene's
    id.
    """

    def __init__(self, model: RobotModel, scene: PlanningScene) -> None:
        self._gripper = model.description.gripper
        self._model = model
        self._scene = scene
        self._margins = CollisionMargins()
        self._hand = [(solid(shape), pose) for shape, pose in self._gripper.hand]
        self._fingers = {box: solid(box) for box, _ in self._gripper.finger_boxes}
        self._still = [(body, place(solid(body.shape), body.pose)) for body in fixed_bodies(scene)]
        self._known: dict[CollisionBody, FclPlacedSolid] = {}
        self._objects: tuple[BeliefObject, ...] | None = None
        self._around: list[tuple[CollisionBody, FclPlacedSolid]] = []
        self._low: Array = np.empty((0, 3))
        self._high: Array = np.empty((0, 3))

    def hand_contacts(
        self, tcp_in_world: Pose, width: float, ignore: Collection[str] = (), margin: float = 0.003
    ) -> list[ContactPair]:
        """Return contacts of hand and fingers, opened by `width` m, that are closer than `margin` at that
        pose.

        Fingers may come to 0.5 mm of a level board, unless `margin` is wider than the usual 3 mm.
        """
        hand = [("hand", s, tcp_in_world @ pose) for s, pose in self._hand]
        parts = (*hand, *self._placed_fingers(tcp_in_world, width))
        found = itertools.chain.from_iterable(self._contacts(*part, ignore, margin) for part in parts)
        return sorted(found, key=lambda contact: contact.distance)

    def hand_clearance(
        self, tcp_in_world: Pose, width: float, ignore: Collection[str], margin: float, least: float
    ) -> float:
        """Return the distance of the nearest of `hand_contacts`, m; inf without contacts.

        The search ends at the first contact that is closer than `least`.
        """
        nearest = math.inf
        hand = (("hand", s, tcp_in_world @ pose) for s, pose in self._hand)
        for part in (*self._placed_fingers(tcp_in_world, width), *hand):
            for contact in self._contacts(*part, ignore, margin):
                nearest = min(nearest, contact.distance)
                if nearest < least:
                    return nearest
        return nearest

    def _placed_fingers(self, tcp_in_world: Pose, width: float) -> Iterator[tuple[str, FclSolid, Pose]]:
        for box, pose in self._model.finger_boxes(width):
            yield "finger", self._fingers[box], tcp_in_world @ pose

    def _contacts(
        self, name: str, part: FclSolid, pose: Pose, ignore: Collection[str], margin: float
    ) -> Iterator[ContactPair]:
        """Yield the contacts of a part of the hand that are closer than its margin."""
        usual = margin <= self._margins.gripper
        finger_support = min(margin, self._margins.finger_support) if usual else margin
        for body, near in self._near(place(part, pose), ignore, margin):
            least = finger_support if name == "finger" and body.support else margin
            if near.distance < least:
                yield ContactPair(name, body.name, near.distance, near.point)

    def free(
        self, shape: Shape, pose: Pose, ignore: Collection[str] = (), margin: float = 0.0
    ) -> list[ContactPair]:
        """Return contacts of a shape at a pose in the world that are closer than `margin`; empty: it is
        free."""
        placed = place(solid(shape), pose)
        found = [
            ContactPair("shape", body.name, near.distance, near.point)
            for body, near in self._near(placed, ignore, margin)
            if near.distance < margin
        ]
        return sorted(found, key=lambda contact: contact.distance)

    def _near(
        self, part: FclPlacedSolid, ignore: Collection[str], margin: float
    ) -> Iterator[tuple[CollisionBody, FclDistance]]:
        """Yield bodies whose bounding boxes come within `margin` of the part's, with the exact distance."""
        self._follow()
        reach = max(0.0, margin)
        touched = np.all(self._low <= part.high + reach, axis=1) & np.all(
            self._high >= part.low - reach, axis=1
        )
        for k in np.flatnonzero(touched):
            body, other = self._around[int(k)]
            if body.name not in ignore:
                yield body, distance_between(part, other)

    def _follow(self) -> None:
        """Take over the present belief of the scene; unchanged bodies are kept."""
        objects = self._scene.objects
        if self._objects == objects:
            return
        known: dict[CollisionBody, FclPlacedSolid] = {}
        for body in movable_bodies(objects):
            before = self._known.get(body)
            known[body] = before if before is not None else place(solid(body.shape), body.pose)
        self._objects, self._known = objects, known
        self._around = [*self._still, *known.items()]
        self._low = np.array([placed.low for _, placed in self._around]).reshape(-1, 3)
        self._high = np.array([placed.high for _, placed in self._around]).reshape(-1, 3)
