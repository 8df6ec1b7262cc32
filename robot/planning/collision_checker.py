"""Collision checker: tests configurations of arm, gripper and held object against the believed scene, by
pinocchio and coal."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import product
from operator import attrgetter
from pathlib import Path
from typing import Final

import numpy as np
import pinocchio as pin

from picktree.files import disk_cache
from picktree.world import Array, BeliefObject, Bounds, PlanningScene, corners
from picktree.world.robot_model import (
    TCP_FRAME,
    LinkShape,
    RobotModel,
    fingerprint,
    joint_frame,
    pose_of,
    se3,
)
from picktree.world.scene import Bin, Fixture

from . import collision_model
from .collision_model import (
    GRIPPER_OWNERS,
    MIN_MARGIN,
    CoalShapes,
    CollisionBody,
    CollisionGeometry,
    CollisionMargins,
    CollisionModel,
    CollisionModelKey,
    GeometryOwner,
    MarginChecker,
    RobotCollisionGeometry,
    fixed_bodies,
    movable_bodies,
)
from .limits import ToolRoom
from .motion_plans import ContactPair

DISTANCE_DECIMALS = 9
"""Number of decimals to which distances in m are rounded."""
MAX_CACHED_MODELS = 2
"""Greatest number of geometry models in memory. Each pair of bodies takes 6 kB, a model of 94 bodies 6 MB; to
build a new one takes 2 ms."""


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """Part of the belief that a geometry model was built from."""

    fixtures: Mapping[str, Fixture]
    bins: Mapping[str, Bin]
    objects: tuple[BeliefObject, ...]
    allowed: frozenset[frozenset[str]]
    clearance: float

    def same(self, other: _Seen) -> bool:
        """Whether a geometry model of the other is one of this, with all poses."""
        return self.same_room(other) and self.same_belief(other)

    def same_room(self, other: _Seen) -> bool:
        """Whether fixtures and bins are the same. They are never changed in place; a supposed scene shares
        them."""
        return self.fixtures is other.fixtures and self.bins is other.bins

    def same_belief(self, other: _Seen) -> bool:
        mine = (self.objects, self.allowed, self.clearance)
        return mine == (other.objects, other.allowed, other.clearance)


@dataclass(frozen=True, slots=True, eq=False)
class Separation:
    """Two bodies near each other: names, signed distance and margin, m, and the distance's gradient (n,),
    m/rad.

    The gradient is over the arm's joints.
    """

    key: tuple[int, str]
    """Number of the robot's part, and name of the body: an obstacle of many blocks is one body."""
    a: str
    b: str
    distance: float
    margin: float
    gradient: Array


class CollisionChecker:
    """Collision checker of one robot in the believed scene. Call `update` first; `checks` counts queries.

    With a `workspace` (in the world) a configuration is free only if the TCP is INSIDE m within it.

    Margins: see `CollisionMargins`. Names that a scene may allow to touch: object, fixture and bin ids,
    `arm`, and `gripper` (hand, fingers and held object).
    """

    def __init__(
        self, model: RobotModel, margins: CollisionMargins | None = None, workspace: Bounds | None = None
    ) -> None:
        self.model = model
        self.workspace = workspace
        self.room = None if workspace is None else ToolRoom.of(workspace)
        """Box in which the tool may be; None: anywhere."""
        self.checks = 0
        self._shapes = CoalShapes()
        self._robot = _robot(model, margins or CollisionMargins())
        self._tcp_offset: Array = self._robot.tcp_in_joint.translation.copy()
        self._tcp_reach = float(np.linalg.norm(self._tcp_offset))
        self._full_q = (model.full_q(np.zeros(model.n), 0.0),)
        """Configurations of arm and fingers, one of each opening."""
        joints = [model.full.joints[model.full.getJointId(name)] for name in model.description.joints]
        self._arm_v = [joint.idx_v for joint in joints]
        self._arm_q = _run([joint.idx_q for joint in joints])
        self._seen: _Seen | None = None
        self._still: tuple[CollisionBody, ...] = ()
        self._cached_models: list[tuple[_Seen, CollisionModel]] = []
        """Geometry models with their last belief, the most recently used first."""
        nothing = _Seen({}, {}, (), frozenset(), 0.0)
        self._now = self._built(CollisionModelKey((), None, frozenset(), 0.0), nothing)

    # ---- following the scene

    def update(self, scene: PlanningScene, *widths: float, clearance: float = 0.0) -> None:
        """Take over the present belief of the scene, and the opening of the fingers, m.

        With several openings, the ends between which the fingers move, each answer is for all of them.
        `clearance` m are added to all margins that are positive; tolerated depths do not change.
        """
        self._full_q = tuple(self.model.full_q(np.zeros(self.model.n), width) for width in widths)
        snapshot = scene.snapshot()
        seen = _Seen(scene.fixtures, scene.bins, snapshot.objects, snapshot.allowed, clearance)
        if self._seen is None or not seen.same_room(self._seen):
            self._still = fixed_bodies(scene)
        elif seen.same_belief(self._seen):
            return
        self._seen = seen
        for index, (known, built) in enumerate(self._cached_models):
            if seen.same(known):
                self._cached_models.insert(0, self._cached_models.pop(index))
                self._now = built
                return
        bodies = (*self._still, *movable_bodies(snapshot.objects))
        held = next((o for o in snapshot.objects if o.attached), None)
        self._now = self._built(
            CollisionModelKey(
                tuple((b.name, b.shape, b.support) for b in bodies),
                None if held is None else (held.id, held.shape),
                snapshot.allowed,
                clearance,
            ),
            seen,
        )
        self._now.place(bodies, None if held is None else held.object_in_tcp)

    def _built(self, content: CollisionModelKey, seen: _Seen) -> CollisionModel:
        """Return the geometry model of that content: a remembered one, or a new one. Both give the same
        answers."""
        index = next(
            (k for k, (_, built) in enumerate(self._cached_models) if built.content == content), None
        )
        if index is None:
            built = CollisionModel(self._robot, content, self._shapes)
        else:
            built = self._cached_models.pop(index)[1]
        self._cached_models.insert(0, (seen, built))
        del self._cached_models[MAX_CACHED_MODELS:]
        return built

    # ---- questions

    def free(self, q: Array, room: ToolRoom | None = None) -> bool:
        """Whether the arm at q keeps all margins, and its tool the workspace, or another `room`."""
        if room is not None:
            return self.check_with(self._now.full, q, room)
        return self._count_until((q,), hit=True) == 1

    def count_free(self, configurations: Array) -> int:
        """Return the number of configurations (m, n) before the first that is not free."""
        return self._count_until(configurations, hit=True)

    def count_blocked(self, configurations: Array) -> int:
        """Return the number of configurations (m, n) before the first that is free."""
        return self._count_until(configurations, hit=False)

    def _count_until(self, configurations: Collection[Array], *, hit: bool) -> int:
        checker = self._now.full
        inside = None if self.room is None else partial(self._inside, checker, self.room)
        count = checker.count_until(configurations, self._full_q, self._arm_q, hit=hit, inside=inside)
        self.checks += min(count + 1, len(configurations))
        return count

    def nearly_free(self, q: Array, room: ToolRoom | None = None) -> bool:
        """Whether the arm at q keeps halved positive margins: for samples between configurations found
        free. `room`: as in `free`."""
        return self.check_with(self._now.halved, q, room or self.room)

    def excusing(self, contacts: tuple[ContactPair, ...], slack: float) -> MarginChecker:
        """Return a checker in which the pairs of `contacts` may keep their present distance, or come `slack`
        m closer."""
        margins = self._now.least.copy()
        for contact in contacts:
            for i, j in self._indices(contact.a, contact.b):
                margin = min(margins[i, j], contact.distance - slack)
                margins[i, j] = margin if abs(margin) > MIN_MARGIN else -MIN_MARGIN
        return self._now.checker(margins)

    def check_with(self, checker: MarginChecker, q: Array, room: ToolRoom | None = None) -> bool:
        """Whether q is free by another checker of this robot, counted. `room`: the tool is to be in it."""
        self.checks += 1
        return all(map(checker.free, self._at(q))) and (room is None or self._inside(checker, room))

    def room_at(self, q: Array) -> ToolRoom | None:
        """Return the room of the tool, widened where it is outside at q (n,); None without a workspace."""
        return None if self.room is None else self.room.widened(np.array(self.model.tcp(q).position))

    def believed(self, name: str) -> BeliefObject | None:
        """Return the object of that id as last taken over; None for fixtures, bins and links."""
        objects = () if self._seen is None else self._seen.objects
        return next((o for o in objects if o.id == name), None)

    def contacts(self, q: Array) -> tuple[ContactPair, ...]:
        """Return every pair that is closer than its margin at q, the deepest first. Slow: for
        explanations."""
        self.checks += 1
        pairs, least, pieces = self._now.geometry.collisionPairs, self._now.least, self._now.pieces
        found: dict[int, ContactPair] = {}
        for full_q in self._at(q):
            for index, distance, point in self._now.gaps.closer(full_q, least):
                first, second = pairs[index].first, pairs[index].second
                # The last bits of results depend on memory addresses.
                x, y, z = point.round(DISTANCE_DECIMALS).tolist()
                depth = round(distance, DISTANCE_DECIMALS)
                margin = float(least[first, second])
                contact = ContactPair(pieces[first].name, pieces[second].name, depth, (x, y, z), margin)
                found[index] = min(contact, found.get(index, contact), key=attrgetter("distance"))
        return tuple(sorted(found.values(), key=attrgetter("distance")))

    def nearest(self, q: Array, within: float = np.inf, *, itself: bool = False) -> ContactPair | None:
        """Return the nearest of all pairs that may not touch at q, None when none is nearer than `within` m.

        Pairs are of the robot and its surroundings, or with `itself` of the robot's own links. Not counted:
        nothing is planned with it.
        """
        found = (self._now.gaps.nearest(full_q, within, itself=itself) for full_q in self._at(q))
        return min((c for c in found if c is not None), key=attrgetter("distance"), default=None)

    def separations(self, q: Array, within: float) -> tuple[Separation, ...]:
        """Return every pair that may not touch and whose distance is below its margin plus `within` m.
        Counted as one check."""
        self.checks += 1
        least, pieces = self._now.least, self._now.pieces
        found: list[Separation] = []
        reach = within + float(least.max(initial=0.0))
        for near in (near for full_q in self._at(q) for near in self._now.gaps.near(full_q, reach)):
            margin = float(least[near.first, near.second])
            if near.distance < margin + within:
                a, b = pieces[near.first], pieces[near.second]
                key, gradient = (near.first, b.name), near.gradient[self._arm_v]
                found.append(Separation(key, a.name, b.name, near.distance, margin, gradient))
        return tuple(found)

    def penetrates(self, contact: ContactPair, tolerance: float) -> bool:
        """Whether a contact is deeper than `tolerance` m below the tolerated depth of its pair."""
        allowed = min(
            (float(self._now.least[i, j]) for i, j in self._indices(contact.a, contact.b)), default=0.0
        )
        return contact.distance < min(0.0, allowed) - tolerance

    def _indices(self, a: str, b: str) -> list[tuple[int, int]]:
        pieces = list(enumerate(self._now.pieces))
        return [(i, j) for i, p in pieces for j, q in pieces[i + 1 :] if (p.name, q.name) == (a, b)]

    def _inside(self, checker: MarginChecker, room: ToolRoom) -> bool:
        """Whether the tool is in the room at the configuration that `checker` tested last."""
        # In most configurations the joint alone decides, which takes a third of the time.
        at, reach = checker.tool_joint.translation, self._tcp_reach
        return room.holds(at, reach) or room.holds(checker.tool_joint.act(self._tcp_offset))

    def _at(self, q: Array) -> tuple[Array, ...]:
        for full_q in self._full_q:
            full_q[self._arm_q] = q
        return self._full_q


def robot_geometry(model: RobotModel) -> tuple[pin.GeometryObject, ...]:
    """Return the bodies of the links on the joints of `model.full`, link by link from the root on.

    Hulls that were made before come from the disk cache.
    """
    shapes = model.collision_shapes()
    inputs = (fingerprint(shapes), model.full.saveToString())
    kept = disk_cache.cached_arrays(
        "robot-hulls", inputs, _MAKERS, lambda: {"archive": _hulls(model, shapes)}
    )
    return tuple(o.copy() for o in _unpacked(kept["archive"].tobytes()).geometryObjects)


_MAKERS: Final = (Path(__file__), collision_model, "coal", "pin")
"""Code that `robot_geometry` depends on."""


def _hulls(model: RobotModel, shapes: tuple[LinkShape, ...]) -> np.typing.NDArray[np.uint8]:
    """Return the geometry of the robot as pinocchio's archive, in which numbers are exact."""
    made, coals = pin.GeometryModel(), CoalShapes()
    for index, frame in enumerate(model.full.frames):
        if frame.type == pin.BODY:
            for n, part in enumerate(part for part in shapes if part.link == frame.name):
                placement = frame.placement * se3(part.pose_in_link)
                name = f"{part.link}_{n}"
                made.addGeometryObject(
                    pin.GeometryObject(name, frame.parentJoint, index, placement, coals.of(part.shape))
                )
    return np.frombuffer(made.saveToString().encode(), np.uint8)


@lru_cache(maxsize=4)
def _unpacked(archive: bytes) -> pin.GeometryModel:
    loaded = pin.GeometryModel()
    loaded.loadFromString(archive.decode())
    return loaded


def _robot_piece(model: RobotModel, o: pin.GeometryObject) -> CollisionGeometry:
    frames = model.full.frames
    link = frames[o.parentFrame].name
    chain, at = [o.parentFrame], o.parentFrame
    while at > 0:
        at = frames[at].parentFrame
        chain.append(at)
    if o.parentJoint == 0:
        part = GeometryOwner.BASE
    elif link in model.description.gripper.fingers:
        part = GeometryOwner.FINGER
    elif joint_frame(model.full, model.description.flange_joint) in chain:
        part = GeometryOwner.HAND
    else:
        part = GeometryOwner.ARM
    return CollisionGeometry(link, part, o.parentJoint)


def _self_pairs(
    model: RobotModel, robot: tuple[pin.GeometryObject, ...], pieces: tuple[CollisionGeometry, ...]
) -> np.typing.NDArray[np.bool_]:
    disabled = {frozenset(pair) for pair in model.description.disabled_pairs}
    pairs = np.zeros((len(robot), len(robot)), dtype=np.bool_)
    for i, a in enumerate(pieces):
        for j in range(i + 1, len(pieces)):
            b = pieces[j]
            both_gripper = a.part in GRIPPER_OWNERS and b.part in GRIPPER_OWNERS
            pairs[i, j] = (
                a.joint != b.joint and not both_gripper and frozenset((a.name, b.name)) not in disabled
            )
    return pairs


def _robot(model: RobotModel, margins: CollisionMargins) -> RobotCollisionGeometry:
    objects = robot_geometry(model)
    pieces = tuple(_robot_piece(model, o) for o in objects)
    geometry = pin.GeometryModel()
    for o in objects:
        geometry.addGeometryObject(o)
    joint, placement = _tcp(model.full)
    pairs = _self_pairs(model, objects, pieces)
    return RobotCollisionGeometry(model.full, geometry, pieces, pairs, joint, placement, margins.table())


def _run(indices: list[int]) -> slice | list[int]:
    """Return indices as a slice where they are consecutive: writing through a slice is four times as fast."""
    first, count = indices[0], len(indices)
    return slice(first, first + count) if indices == list(range(first, first + count)) else indices


def _tcp(model: pin.Model) -> tuple[int, pin.SE3]:
    frame = model.frames[model.getFrameId(TCP_FRAME, pin.OP_FRAME)]
    return frame.parentJoint, frame.placement


MAX_GAP, MAX_DEPTH = 0.005, 0.02
"""Greatest gap between a link and the fixture under it, and how deep it may be sunk in, m."""


def standing_pairs(model: RobotModel, scene: PlanningScene) -> tuple[tuple[str, str], ...]:
    """Return each pair of a link and the fixture on which it is mounted.

    Such a link turns about the vertical alone, so that its gap to the ground under it never changes. Links
    that no joint moves are never checked against the surroundings.
    """
    if not model.standing_links:
        return ()
    lowest = _lowest(model)
    under = [f.id for f in scene.fixtures.values() if lowest - MAX_GAP <= _top(f) <= lowest + MAX_DEPTH]
    if not under:
        return ()
    checker = CollisionChecker(model)
    checker.update(scene, 0.0)
    touching = checker.contacts(model.named("home"))
    return tuple((c.a, c.b) for c in touching if c.a in model.standing_links and c.b in under)


def _lowest(model: RobotModel) -> float:
    """Return the height of the lowest point of the links that turn on their ground, m."""
    first = model.full.getJointId(model.description.joints[0])
    # All of them turn about the vertical: their heights are the same at each configuration.
    joint = pose_of(model.full.jointPlacements[first])
    lowest = np.inf
    for o in robot_geometry(model):
        if o.parentJoint == first:
            o.geometry.computeLocalAABB()
            low, high = o.geometry.aabb_local.min_, o.geometry.aabb_local.max_
            box = np.array(list(product(*zip(low.tolist(), high.tolist(), strict=True))))
            lowest = min(lowest, float((joint @ pose_of(o.placement)).apply(box)[:, 2].min()))
    return lowest


def _top(fixture: Fixture) -> float:
    return float(fixture.pose.apply(corners(fixture.shape))[:, 2].max())
