"""Is a configuration free? Arm, gripper and what it holds against the scene, by pinocchio and coal."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from ..robot.model import TCP_FRAME, RobotModel, se3
from ..scene.planning_scene import BeliefObject, PlanningScene, SceneSnapshot
from ..values import Array, Bounds, Pose, Vector3
from .bodies import Body, loose_bodies, still_bodies
from .coal_shapes import CoalShapes, hull
from .gaps import Gaps
from .margins import AROUND, GRIPPER, Margins, Part
from .requests import Contact


@dataclass(frozen=True, slots=True)
class _Piece:
    """One geometry, in the order in which pinocchio's model holds them."""

    name: str
    part: Part
    joint: int


INSIDE = 0.002
"""Distance of the tool to the edges of the workspace that planning keeps, m."""


@dataclass(frozen=True, slots=True)
class _Content:
    """What the geometry model was built for; when only `poses` differ, its geometries are moved."""

    bodies: tuple[tuple[str, object, bool], ...]
    poses: tuple[Pose, ...]
    held: tuple[str, object] | None
    held_in_tcp: Pose | None
    allowed: frozenset[frozenset[str]]
    clearance: float


class Checker:
    """One set of margins over the geometry. Broad phase and answers do not depend on earlier queries."""

    def __init__(self, model: pin.Model, geometry: pin.GeometryModel, margins: Array) -> None:
        self._model = model
        self.data = model.createData()
        self._geometry_data = pin.GeometryData(geometry)
        self._geometry_data.setSecurityMargins(geometry, margins, True, False)
        # The other managers of this library miss collisions; this one was compared with the naive test.
        self._manager = pin.BroadPhaseManager_DynamicAABBTreeCollisionManager(
            model, geometry, self._geometry_data
        )

    def free(self, full_q: Array) -> bool:
        return not pin.computeCollisions(self._model, self.data, self._manager, full_q, True)


class Collision:
    """The robot in the believed scene. Call `update` before asking; `checks` counts what was asked.

    With a `workspace` (in the world) a configuration is free only if the TCP is INSIDE m within it.

    Margins: see `Margins`. Names that a scene may allow to touch: object, fixture and bin ids, `arm`, and
    `gripper` (hand, fingers and what they hold).
    """

    def __init__(
        self, model: RobotModel, margins: Margins | None = None, workspace: Bounds | None = None
    ) -> None:
        self.model = model
        self._workspace = workspace
        self._margin_table = (margins or Margins()).table()
        self.checks = 0
        self._shapes = CoalShapes()
        self._robot = robot_geometry(model)
        self._robot_pieces = tuple(_robot_piece(model, o) for o in self._robot)
        self._self_pairs = _self_pairs(model, self._robot, self._robot_pieces)
        self._tcp_joint, self._tcp_in_joint = _tcp(model.full)
        self._full_q = model.full_q(np.zeros(model.n), 0.0)
        self._arm_q = [model.full.joints[model.full.getJointId(j)].idx_q for j in model.description.joints]
        self._seen: tuple[SceneSnapshot, PlanningScene] | None = None
        self._still: tuple[Body, ...] = ()
        self._build(_Content((), (), None, None, frozenset(), 0.0), ())

    # ---- following the scene

    def update(self, scene: PlanningScene, width: float, *, clearance: float = 0.0) -> None:
        """Take over what the scene believes now, and the opening of the fingers, m.

        `clearance` m are added to all margins that are positive; tolerated depths stay as they are.
        """
        self._full_q = self.model.full_q(self._full_q[self._arm_q], width)
        snapshot = scene.snapshot()
        if self._seen is None or self._seen[1] is not scene:
            self._still = still_bodies(scene)
        elif (self._seen[0].objects, self._seen[0].allowed, self._content.clearance) == (
            snapshot.objects,
            snapshot.allowed,
            clearance,
        ):
            return
        self._seen = (snapshot, scene)
        bodies = (*self._still, *loose_bodies(snapshot.objects))
        held = next((o for o in snapshot.objects if o.attached), None)
        content = _Content(
            tuple((b.name, b.shape, b.support) for b in bodies),
            tuple(b.pose for b in bodies),
            None if held is None else (held.id, held.shape),
            None if held is None else held.object_in_tcp,
            snapshot.allowed,
            clearance,
        )
        old = self._content
        if replace(old, poses=content.poses) != content:
            self._build(content, bodies, held)
        elif old.poses != content.poses:
            first = self._geometry.ngeoms - len(bodies)
            for index, (before, now) in enumerate(zip(old.poses, content.poses, strict=True)):
                if before != now:
                    self._geometry.geometryObjects[first + index].placement = se3(now)
            self._content = content

    def _build(self, content: _Content, bodies: tuple[Body, ...], held: BeliefObject | None = None) -> None:
        geometry = pin.GeometryModel()
        pieces = list(self._robot_pieces)
        for o in self._robot:
            geometry.addGeometryObject(
                pin.GeometryObject(o.name, o.parentJoint, o.parentFrame, o.placement, o.geometry)
            )
        if held is not None and held.object_in_tcp is not None:
            placement = self._tcp_in_joint * se3(held.object_in_tcp)
            geometry.addGeometryObject(
                pin.GeometryObject("held", self._tcp_joint, 0, placement, self._shapes.of(held.shape))
            )
            pieces.append(_Piece(held.id, Part.HELD, self._tcp_joint))
        for index, body in enumerate(bodies):
            shape = self._shapes.of(body.shape)
            geometry.addGeometryObject(pin.GeometryObject(f"around {index}", 0, 0, se3(body.pose), shape))
            pieces.append(_Piece(body.name, Part.SUPPORT if body.support else Part.OBSTACLE, 0))
        self._geometry, self._pieces, self._content = geometry, tuple(pieces), content
        geometry.setCollisionPairs(self._pairs())
        self._least = self._least_distances()
        self._full = Checker(self.model.full, geometry, self._least)
        self._halved: Checker | None = None
        self._distances: tuple[pin.Data, pin.GeometryData] | None = None
        self._gaps: Gaps | None = None

    def _pairs(self) -> np.typing.NDArray[np.bool_]:
        count, robots = len(self._pieces), len(self._robot_pieces)
        pairs = np.zeros((count, count), dtype=np.bool_)
        pairs[:robots, :robots] = self._self_pairs
        for i, a in enumerate(self._pieces):
            for j in range(max(i + 1, robots), count):
                pairs[i, j] = self._meets(a, self._pieces[j])
        return pairs

    def _meets(self, a: _Piece, b: _Piece) -> bool:
        """Whether a piece of the robot or what it holds is checked against `b`, held or around."""
        if b.part is Part.HELD:
            return a.part in (Part.BASE, Part.ARM) and a.joint != b.joint
        if a.part in AROUND or a.part is Part.BASE:
            return False
        allowed = self._content.allowed
        if not allowed:
            return True
        side = "gripper" if a.part in GRIPPER else "arm"
        return frozenset((side, b.name)) not in allowed and frozenset((a.name, b.name)) not in allowed

    def _least_distances(self) -> Array:
        parts = [piece.part.value for piece in self._pieces]
        least = self._margin_table[np.ix_(parts, parts)]
        return np.where(least > 0, least + self._content.clearance, least)

    # ---- questions

    def free(self, q: Array) -> bool:
        """Whether the arm at q keeps all margins, and its tool the workspace."""
        self.checks += 1
        return self._full.free(self._at(q)) and self._inside(self._full)

    def nearly_free(self, q: Array) -> bool:
        """The same with positive margins halved: for what lies between configurations found free."""
        self.checks += 1
        if self._halved is None:
            margins = np.where(self._least > 0, self._least / 2, self._least)
            self._halved = Checker(self.model.full, self._geometry, margins)
        return self._halved.free(self._at(q)) and self._inside(self._halved)

    def excusing(self, contacts: tuple[Contact, ...], slack: float) -> Checker:
        """A checker in which the pairs of `contacts` may come as close as they are, and `slack` m closer."""
        margins = self._least.copy()
        for contact in contacts:
            for i, j in self._indices(contact.a, contact.b):
                margins[i, j] = min(margins[i, j], contact.distance - slack)
        return Checker(self.model.full, self._geometry, margins)

    def asked(self, checker: Checker, q: Array) -> bool:
        """Ask another checker of this robot about q, and count it."""
        self.checks += 1
        return checker.free(self._at(q))

    def contacts(self, q: Array) -> tuple[Contact, ...]:
        """Every pair that is closer than its margin at q, the deepest first. Slow: for explanations."""
        self.checks += 1
        if self._distances is None:
            self._distances = (self.model.full.createData(), pin.GeometryData(self._geometry))
        data, geometry_data = self._distances
        pin.updateGeometryPlacements(self.model.full, data, self._geometry, geometry_data, self._at(q))
        found: list[Contact] = []
        for index, pair in enumerate(self._geometry.collisionPairs):
            distance = pin.computeDistance(self._geometry, geometry_data, index)
            if distance.min_distance < self._least[pair.first, pair.second]:
                a, b = self._pieces[pair.first], self._pieces[pair.second]
                x, y, z = (float(c) for c in distance.getNearestPoint2())
                point: Vector3 = (x, y, z)
                found.append(Contact(a.name, b.name, float(distance.min_distance), point))
        return tuple(sorted(found, key=lambda contact: contact.distance))

    def nearest(self, q: Array, within: float = np.inf, *, itself: bool = False) -> Contact | None:
        """The pair that is nearest at q, of all that may not touch, if nearer than `within` m: with what is
        around, or with `itself` among the robot's own links. Not counted: nothing is planned with it."""
        if self._gaps is None:
            names = [piece.name for piece in self._pieces]
            around = sum(piece.part not in AROUND for piece in self._pieces)
            self._gaps = Gaps(self.model.full, self._geometry, names, around)
        return self._gaps.nearest(self._at(q), within, itself=itself)

    def penetrates(self, contact: Contact, tolerance: float) -> bool:
        """Whether a contact is deeper than `tolerance` m and than what is tolerated of its pair anyway."""
        allowed = min((float(self._least[i, j]) for i, j in self._indices(contact.a, contact.b)), default=0.0)
        return contact.distance < min(0.0, allowed) - tolerance

    def _indices(self, a: str, b: str) -> list[tuple[int, int]]:
        pieces = list(enumerate(self._pieces))
        return [(i, j) for i, p in pieces for j, q in pieces[i + 1 :] if (p.name, q.name) == (a, b)]

    def _inside(self, checker: Checker) -> bool:
        """Whether the tool is within the workspace at the configuration that `checker` saw last."""
        if self._workspace is None:
            return True
        tool = (checker.data.oMi[self._tcp_joint] * self._tcp_in_joint).translation
        return self._workspace.contains(tool, INSIDE)

    def _at(self, q: Array) -> Array:
        self._full_q[self._arm_q] = q
        return self._full_q


def robot_geometry(model: RobotModel) -> tuple[pin.GeometryObject, ...]:
    """The URDF's collision geometry on the joints of `model.full`; meshes as their convex hulls."""
    urdf = model.description.urdf
    folder = str(Path(urdf).parent)
    loaded = pin.buildGeomFromUrdf(model.full, urdf, pin.COLLISION, package_dirs=[folder])
    for o in loaded.geometryObjects:
        o.geometry = hull(o.geometry)
    return tuple(loaded.geometryObjects)


def _robot_piece(model: RobotModel, o: pin.GeometryObject) -> _Piece:
    frames = model.full.frames
    link = frames[o.parentFrame].name
    chain, at = [link], o.parentFrame
    while at > 0:
        at = frames[at].parentFrame
        chain.append(frames[at].name)
    if o.parentJoint == 0:
        part = Part.BASE
    elif link in model.description.gripper.fingers:
        part = Part.FINGER
    elif model.description.flange_joint in chain:
        part = Part.HAND
    else:
        part = Part.ARM
    return _Piece(link, part, o.parentJoint)


def _self_pairs(
    model: RobotModel, robot: tuple[pin.GeometryObject, ...], pieces: tuple[_Piece, ...]
) -> np.typing.NDArray[np.bool_]:
    disabled = {frozenset(pair) for pair in model.description.disabled_pairs}
    pairs = np.zeros((len(robot), len(robot)), dtype=np.bool_)
    for i, a in enumerate(pieces):
        for j in range(i + 1, len(pieces)):
            b = pieces[j]
            both_gripper = a.part in GRIPPER and b.part in GRIPPER
            pairs[i, j] = (
                a.joint != b.joint and not both_gripper and frozenset((a.name, b.name)) not in disabled
            )
    return pairs


def _tcp(model: pin.Model) -> tuple[int, pin.SE3]:
    frame = model.frames[model.getFrameId(TCP_FRAME)]
    return frame.parentJoint, frame.placement
