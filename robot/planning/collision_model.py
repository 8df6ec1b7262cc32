"""Collision model: named convex bodies around the robot with their margins, and the robot among them in
pinocchio.

Measured: with 5 mm at an edge resolution of 0.03 rad no planned path grazed anything; without, 7 % did.
Fingers must reach flat items on the table, and a held object touches the table when its motion begins.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from enum import Enum, auto

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from picktree.world import (
    Array,
    BeliefObject,
    Box,
    ConvexMesh,
    Cylinder,
    PlanningScene,
    Pose,
    Shape,
    Sphere,
    convex_decomposition,
    extents,
)
from picktree.world.robot_model import se3

from .motion_plans import ContactPair


def _settle_coal() -> None:
    """Measure one distance. The first query of coal decides the last bits of all later results in a process.
    So each process starts with the same query."""
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
    """Return the convex parts of one object, all under its name: an obstacle's blocks are replaced by hulls.

    The columns of a heap have no hull: fingers reach down beside higher ones.
    """
    if not o.blocks:
        return (CollisionBody(o.id, o.shape, o.pose),)
    if o.role == "heap":
        return tuple(CollisionBody(o.id, Box(block.size), o.pose @ Pose(block.at)) for block in o.blocks)
    return tuple(
        CollisionBody(o.id, shape, o.pose @ Pose(at)) for shape, at in convex_decomposition.hulls_of(o.blocks)
    )


MIN_MARGIN = 1e-5
"""Least margin, m. Without any, coal's GJK sometimes reports bodies that lie deep in each other as apart.

It stops a micrometre from contact and looks no further (one of 2,000 configurations).
"""


@dataclass(frozen=True, slots=True, eq=False)
class NearPair:
    """Two bodies by their numbers, their signed distance, m, and its gradient over the joints, m/rad."""

    first: int
    second: int
    distance: float
    gradient: Array


class BodyDistances:
    """Distances between the pairs of one geometry model. Moved bodies are followed."""

    def __init__(
        self, model: pin.Model, geometry: pin.GeometryModel, names: Sequence[str], around: int
    ) -> None:
        """Precompute the bounding boxes. `around` is the number of the first body that is neither of the
        robot nor in its hand."""
        self._model = model
        self._geometry = geometry
        self._names = names
        self._data = model.createData()
        self._geometry_data = distance_request(geometry)
        boxes = [o.geometry.aabb_local for o in geometry.geometryObjects]
        low, high = np.array([b.min_ for b in boxes]), np.array([b.max_ for b in boxes])
        self._middles: Array = (low + high) / 2
        self._halves: Array = (high - low) / 2
        self._first = np.array([pair.first for pair in geometry.collisionPairs], dtype=np.int64)
        self._second = np.array([pair.second for pair in geometry.collisionPairs], dtype=np.int64)
        self._itself = self._second < around

    def nearest(self, full_q: Array, within: float = np.inf, *, itself: bool = False) -> ContactPair | None:
        """Return the nearest pair: names, signed distance and the point on `b`. None when none is nearer than
        `within` m.

        Pairs are of the robot (with the held object) and its surroundings, or with `itself` of the robot's
        own links.
        """
        pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._geometry_data, full_q)
        apart = np.where(self._itself == itself, self._apart(), np.inf)
        best: ContactPair | None = None
        for index in np.argsort(apart, kind="stable"):
            if apart[index] >= within:
                break
            found = pin.computeDistance(self._geometry, self._geometry_data, int(index))
            if found.min_distance < within:
                within = float(found.min_distance)
                x, y, z = (float(c) for c in found.getNearestPoint2())
                a, b = int(self._first[index]), int(self._second[index])
                best = ContactPair(self._names[a], self._names[b], within, (x, y, z))
        return best

    def closer(self, full_q: Array, margins: Array) -> list[tuple[int, float, Array]]:
        """Return every pair that is closer than its margin (bodies, bodies), m: its index, signed distance,
        and the point (3,) on its second body. Other pairs are not measured, because pinocchio keeps 27 kB for
        each pair that was measured."""
        pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._geometry_data, full_q)
        least = margins[self._first, self._second]
        found: list[tuple[int, float, Array]] = []
        for index in np.flatnonzero(self._apart() < np.maximum(least, MIN_MARGIN)).tolist():
            measured = pin.computeDistance(self._geometry, self._geometry_data, index)
            if measured.min_distance < least[index]:
                found.append((index, float(measured.min_distance), np.asarray(measured.getNearestPoint2())))
        return found

    def near(self, full_q: Array, within: float) -> list[NearPair]:
        """Return every pair nearer than `within` m, with the gradient of its distance over the joints."""
        model, data = self._model, self._data
        pin.computeJointJacobians(model, data, full_q)
        pin.updateGeometryPlacements(model, data, self._geometry, self._geometry_data, full_q)
        objects = self._geometry.geometryObjects
        found: list[NearPair] = []
        for index in np.flatnonzero(self._apart() < within):
            pair = self._geometry.collisionPairs[int(index)]
            measured = pin.computeDistance(self._geometry, self._geometry_data, int(index))
            distance = float(measured.min_distance)
            if distance >= within:
                continue
            # The normal of coal points from the first body to the second.
            normal, gradient = np.asarray(measured.normal), np.zeros(model.nv)
            points = measured.getNearestPoint1(), measured.getNearestPoint2()
            for body, point, sign in zip((pair.first, pair.second), points, (-1.0, 1.0), strict=True):
                joint = objects[body].parentJoint
                if joint:
                    six = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)
                    lever = np.asarray(point) - data.oMi[joint].translation
                    gradient += sign * (normal @ six[:3] + np.cross(lever, normal) @ six[3:])
            found.append(NearPair(pair.first, pair.second, distance, gradient))
        return found

    def _apart(self) -> Array:
        """Return the distances of the bounding boxes of all pairs, m: lower bounds of the bodies'
        distances."""
        placements = self._geometry_data.oMg
        turned = np.array([placement.rotation for placement in placements])
        at = np.array([placement.translation for placement in placements])
        middles = at + np.einsum("kij,kj->ki", turned, self._middles)
        halves = np.einsum("kij,kj->ki", np.abs(turned), self._halves)
        between = np.abs(middles[self._first] - middles[self._second])
        gaps = between - halves[self._first] - halves[self._second]
        return np.linalg.norm(np.maximum(gaps, 0.0), axis=1)


@dataclass(frozen=True, slots=True)
class CollisionGeometry:
    """One geometry, in the order in which pinocchio's model holds them."""

    name: str
    part: GeometryOwner
    joint: int


@dataclass(frozen=True, slots=True)
class CollisionModelKey:
    """Everything that the pairs and margins of a geometry model follow from; its bodies can be moved."""

    bodies: tuple[tuple[str, Shape, bool], ...]
    """Name, shape, and whether it is a support, of each body."""
    held: tuple[str, Shape] | None
    """Id and shape of the held object; None: the hand is empty."""
    allowed: frozenset[frozenset[str]]
    clearance: float


@dataclass(frozen=True, slots=True, eq=False)
class RobotCollisionGeometry:
    """Part of the collision geometry that is the same in every scene."""

    model: pin.Model
    geometry: pin.GeometryModel
    pieces: tuple[CollisionGeometry, ...]
    self_pairs: NDArray[np.bool_]
    tcp_joint: int
    tcp_in_joint: pin.SE3
    margins: Array
    """Margins (parts, parts) by the parts' values, m."""


class SplitGeometry:
    """Geometry model in the two parts of the broad phase: bodies that move with the robot, and bodies around
    it."""

    def __init__(self, robot: RobotCollisionGeometry, geometry: pin.GeometryModel, count: int) -> None:
        """Split a model with its pairs, whose first `count` bodies are the robot's and the held object."""
        self.robot = robot
        self.whole = geometry
        self.moving = geometry
        self.around = pin.GeometryModel()
        self.placed = 0
        """Number of times that bodies were placed."""
        # A manager widens the boxes of the bodies in its own model's pairs, each by the request at the pair's
        # number. With fewer requests than that takes all bodies stay in one manager.
        if len(geometry.collisionPairs) >= count - 1:
            self.moving, self.around = pin.GeometryModel(), geometry.copy()
            for k in range(count):
                self.moving.addGeometryObject(geometry.geometryObjects[k])
                self.around.geometryObjects[k].disableCollision = True
            for k in range(count - 1):
                self.moving.addCollisionPair(pin.CollisionPair(k, k + 1))


BOX_MARGIN = 1e-3
"""Distance beyond the greatest margin up to which bounding boxes count as touching, m."""


class MarginChecker:
    """Checker with one set of margins over the geometry. Its answers do not depend on earlier queries.

    The naive manager compares the bounding boxes of all pairs. Up to 200 bodies that costs less than keeping
    a tree of them, half at 30. SaP and AABBTreeArray miss collisions; this one was compared with the naive
    test. The bodies around have a manager of their own: their boxes are computed when they have moved, not
    in each check, and not compared with each other.
    """

    def __init__(self, geometry: SplitGeometry, margins: Array) -> None:
        robot = geometry.robot
        self.model = robot.model
        self.data = robot.model.createData()
        self.tool_joint = self.data.oMi[robot.tcp_joint]
        """Pose in the world at the last tested configuration: a view of the memory that pinocchio writes."""
        self._geometry = geometry
        self._geometry_data = pin.GeometryData(geometry.whole)
        self._geometry_data.setSecurityMargins(geometry.whole, margins, True, False)
        # The boxes of the robot's bodies are widened by as much as any pair needs, those around not at all.
        widened = 2.0 * (max(0.0, float(margins.max(initial=0.0))) + BOX_MARGIN)
        for _, request in zip(
            geometry.moving.collisionPairs, self._geometry_data.collisionRequests, strict=False
        ):
            request.break_distance = widened - request.security_margin
        manager = pin.BroadPhaseManager_NaiveCollisionManager
        self._moving = manager(self.model, geometry.moving, self._geometry_data)
        self._around = manager(self.model, geometry.around, self._geometry_data)
        self._answer = pin.CollisionCallBackDefault(geometry.whole, self._geometry_data, True)
        self._placed = -1

    def free(self, full_q: Array) -> bool:
        return self.count_until((full_q,), (full_q,), slice(None), hit=True) == 1

    def count_until(
        self,
        configurations: Collection[Array],
        postures: Sequence[Array],
        arm: slice | list[int],
        *,
        hit: bool,
        inside: Callable[[], bool] | None = None,
    ) -> int:
        """Return the number of configurations of `arm` before the first that is not free, or without `hit`
        before the first that is.

        `postures`: configurations of the whole robot, in which that of the arm is inserted. It must be free
        in all. `inside` returns whether the tool is in its permitted room; None: it may be everywhere.
        """
        model, data, geometry, geometry_data = (
            self.model,
            self.data,
            self._geometry.whole,
            self._geometry_data,
        )
        place, update, collide = pin.updateGeometryPlacements, self._moving.update, self._moving.collide
        around, answer = self._around, self._answer
        if self._placed != self._geometry.placed:
            self._placed = self._geometry.placed
            place(model, data, geometry, geometry_data, postures[0])
            around.update()
        # The parts of pinocchio's computeCollisions: to find that among its overloads takes a microsecond.
        for count, q in enumerate(configurations):
            touches = False
            for full_q in postures:
                full_q[arm] = q
                place(model, data, geometry, geometry_data, full_q)
                update()
                touches = collide(around, answer) or collide(answer)
                if touches:
                    break
            if (touches or (inside is not None and not inside())) is hit:
                return count
        return len(configurations)


class CollisionModel:
    """Geometry model for one content; `place` moves the bodies and the held object."""

    def __init__(self, robot: RobotCollisionGeometry, content: CollisionModelKey, shapes: CoalShapes) -> None:
        self.content = content
        self._robot = robot
        self._poses: list[Pose | None] = [None] * len(content.bodies)
        self._held_in_tcp: Pose | None = None
        self.geometry = robot.geometry.copy()
        pieces = list(robot.pieces)
        if content.held is not None:
            name, shape = content.held
            joint, at = robot.tcp_joint, robot.tcp_in_joint
            self.geometry.addGeometryObject(pin.GeometryObject("held", joint, 0, at, shapes.of(shape)))
            pieces.append(CollisionGeometry(name, GeometryOwner.HELD, joint))
        self._first = len(pieces)
        nowhere = pin.SE3.Identity()
        for index, (name, shape, support) in enumerate(content.bodies):
            self.geometry.addGeometryObject(
                pin.GeometryObject(f"around {index}", 0, 0, nowhere, shapes.of(shape))
            )
            pieces.append(
                CollisionGeometry(name, GeometryOwner.SUPPORT if support else GeometryOwner.OBSTACLE, 0)
            )
        self.pieces = tuple(pieces)
        self.geometry.setCollisionPairs(self._pairs())
        self._split = SplitGeometry(robot, self.geometry, self._first)
        self.least = self._least_distances()
        self.full = self.checker(self.least)
        self._halved: MarginChecker | None = None
        self._gaps: BodyDistances | None = None

    def place(self, bodies: Sequence[CollisionBody], held_in_tcp: Pose | None) -> None:
        """Set the poses of the content's bodies in the world, and of the held object in the hand."""
        objects = self.geometry.geometryObjects
        self._split.placed += 1
        for index, body in enumerate(bodies):
            if self._poses[index] != body.pose:
                self._poses[index] = body.pose
                objects[self._first + index].placement = se3(body.pose)
        if held_in_tcp is not None and held_in_tcp != self._held_in_tcp:
            self._held_in_tcp = held_in_tcp
            objects[self._first - 1].placement = self._robot.tcp_in_joint * se3(held_in_tcp)

    def checker(self, margins: Array) -> MarginChecker:
        """Return a checker with a margin of its own for each pair of pieces."""
        return MarginChecker(self._split, margins)

    @property
    def halved(self) -> MarginChecker:
        """Checker with positive margins halved."""
        if self._halved is None:
            self._halved = self.checker(np.where(self.least > 0, self.least / 2, self.least))
        return self._halved

    @property
    def gaps(self) -> BodyDistances:
        if self._gaps is None:
            names = [piece.name for piece in self.pieces]
            self._gaps = BodyDistances(self._robot.model, self.geometry, names, self._first)
        return self._gaps

    def _pairs(self) -> NDArray[np.bool_]:
        """Return the checked pairs as a mask (all, all), above the diagonal."""
        robots = len(self._robot.pieces)
        pairs = np.zeros((len(self.pieces), len(self.pieces)), dtype=np.bool_)
        pairs[:robots, :robots] = self._robot.self_pairs
        for i, piece in enumerate(self.pieces[: self._first]):
            if i < robots and self._first > robots:
                # The held object can meet the arm, but not the link that carries the hand.
                carried = piece.joint == self._robot.tcp_joint
                pairs[i, robots] = piece.part in (GeometryOwner.BASE, GeometryOwner.ARM) and not carried
            if piece.part is not GeometryOwner.BASE:
                pairs[i, self._first :] = self._may_not_touch(piece)
        return pairs

    def _may_not_touch(self, a: CollisionGeometry) -> NDArray[np.bool_]:
        """Return the mask (bodies,) of the surrounding bodies that `a`, of the robot or held, is checked
        against."""
        allowed = self.content.allowed
        checked = np.ones(len(self.content.bodies), dtype=np.bool_)
        if allowed:
            side = "gripper" if a.part in GRIPPER_OWNERS else "arm"
            for k, (name, _, _) in enumerate(self.content.bodies):
                if frozenset((side, name)) in allowed or frozenset((a.name, name)) in allowed:
                    checked[k] = False
        return checked

    def _least_distances(self) -> Array:
        parts = [piece.part.value for piece in self.pieces]
        least = self._robot.margins[np.ix_(parts, parts)]
        least = np.where(least > 0, least + self.content.clearance, least)
        return np.where(np.abs(least) < MIN_MARGIN, MIN_MARGIN, least)
