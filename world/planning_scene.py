"""Belief: the robot's planning scene, and the only state of the scene that skills, recovery and trees
read."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Literal, TypeAlias

from picktree.world.scene import Bin, Fixture

from .causes import Failure, world
from .heap_geometry import HeapRegion
from .record import Body
from .shapes import greatest_length
from .values import ObjectId, Pose, Vector3

Role: TypeAlias = Literal["item", "obstacle", "heap"]
FALLEN_SIGMA = 0.02
"""Standard deviation of the position along each axis of an object that fell out of the hand and was not seen
since, m. It marks such objects: a detection never has exactly this value."""


@dataclass(frozen=True, slots=True)
class ObstacleBlock:
    """An upright box that is a part of an obstacle, along the axes of the obstacle's frame."""

    size: Vector3
    """Edge lengths, m."""
    at: Vector3
    """Centre of the block, m."""
    supposed: bool = False
    """Whether nothing was seen in it: the obstacle may extend there, where the picture showed nothing."""


@dataclass(frozen=True, slots=True)
class BeliefObject(Body):
    """One movable body of the belief. While attached, its pose follows from the TCP."""

    sigma_position: float
    """Standard deviation of the position along each axis, m."""
    sigma_angle: float
    """Standard deviation of the rotation about the vertical, rad."""
    confidence: float
    """0 … 1"""
    last_seen: float
    """Simulated seconds."""
    role: Role = field(default="item", kw_only=True)
    """`item`: fitted to the catalogue, or a thing lifted out of a heap. `obstacle`: depth that no known body
    explains. `heap`: the contents of a tote or a pile."""
    object_in_tcp: Pose | None = None
    """Set while the object is attached to the gripper."""
    place: str = "table"
    """Believed place: `table`, a bin's id, `hand`, or `aside`."""
    blocks: tuple[ObstacleBlock, ...] = ()
    """Known parts of an obstacle. If their convex hull wastes little, it is the `shape`, else that is their
    bounding box; collisions are checked with `obstacle_hulls`. Empty for items, and for obstacles of older
    logs."""
    mass: float | None = None
    """Mass weighed in the hand, kg; None: not weighed."""
    seen_size: float | None = None
    """Greatest length of its part that a camera saw, m; None: that of its shape."""

    tag: int | None = None
    """Number of the ArUco tag that was read on it; None: none was."""

    @property
    def attached(self) -> bool:
        return self.object_in_tcp is not None

    @property
    def size(self) -> float:
        """Greatest distance of two of its points, m."""
        return greatest_length(self.shape) if self.seen_size is None else self.seen_size


@dataclass(frozen=True, slots=True)
class SceneSnapshot:
    """An immutable picture of the belief."""

    version: int
    objects: tuple[BeliefObject, ...]
    allowed: frozenset[frozenset[str]]

    def of(self, object_id: str) -> BeliefObject | None:
        return next((o for o in self.objects if o.id == object_id), None)


@dataclass(frozen=True, slots=True)
class BeliefChange:
    """One change: `before` is None for a new object, `after` for a removed one."""

    version: int
    reason: str
    before: BeliefObject | None
    after: BeliefObject | None


class PlanningScene:
    """Objects by id over immutable fixtures and bins; each change has a version number.

    `destination` is the scene file's rule: it names the bin where an object belongs, or None.
    """

    def __init__(
        self,
        fixtures: Iterable[Fixture],
        bins: Iterable[Bin],
        destination: Callable[[BeliefObject], ObjectId | None] = lambda _: None,
        regions: Mapping[str, HeapRegion] = MappingProxyType({}),
    ) -> None:
        """`regions`: places where heaps may lie, by tote or fixture."""
        self.regions = regions
        self.fixtures: Mapping[str, Fixture] = {f.id: f for f in fixtures}
        self.bins: Mapping[str, Bin] = {b.id: b for b in bins}
        """Bins and totes."""
        self._destination = destination
        self._objects: dict[ObjectId, BeliefObject] = {}
        self._allowed: dict[frozenset[str], int] = {}
        self._standing: frozenset[frozenset[str]] = frozenset()
        self._changes: list[BeliefChange] = []
        self._version = 0
        self._numbers: dict[str, int] = {}

    @property
    def version(self) -> int:
        return self._version

    @property
    def objects(self) -> tuple[BeliefObject, ...]:
        """Objects in the order of their ids' creation."""
        return tuple(self._objects.values())

    def snapshot(self) -> SceneSnapshot:
        return SceneSnapshot(self._version, self.objects, self._standing.union(self._allowed))

    def find(self, object_id: str) -> BeliefObject | None:
        return self._objects.get(ObjectId(object_id))

    def get(self, object_id: str) -> BeliefObject:
        """Return the object of that id. Raises Failure(world.unknown_object) for an unknown id."""
        found = self.find(object_id)
        if found is None:
            raise Failure(
                world.UNKNOWN_OBJECT,
                f"no object {object_id!r} in the planning scene",
                object=object_id,
                known=[str(o) for o in self._objects],
            )
        return found

    def destination(self, object_id: str) -> ObjectId | None:
        """Return the bin for the object by the scene's rules."""
        return self._destination(self.get(object_id))

    @property
    def held(self) -> BeliefObject | None:
        """The object that is attached to the gripper."""
        return next((o for o in self._objects.values() if o.attached), None)

    def new_id(self, stem: str) -> ObjectId:
        """Return an id that was never used before, such as `red_block_2`."""
        n = self._numbers.get(stem, 0) + 1
        self._numbers[stem] = n
        return ObjectId(f"{stem}_{n}")

    def put(self, belief: BeliefObject, reason: str) -> None:
        """Add the object, or replace its belief. A weighed mass is kept."""
        before = self._objects.get(belief.id)
        if belief.mass is None and before is not None and before.mass is not None:
            belief = replace(belief, mass=before.mass)
        if before != belief:
            self._objects[belief.id] = belief
            self._changed(reason, before, belief)

    def remove(self, object_id: str, reason: str) -> None:
        before = self._objects.pop(ObjectId(object_id), None)
        if before is not None:
            self._changed(reason, before, None)

    def attach(self, object_id: str, object_in_tcp: Pose) -> None:
        """Attach the object: it moves with the TCP, for collision checking."""
        self.put(
            replace(self.get(object_id), object_in_tcp=object_in_tcp, place="hand"), "attached to the gripper"
        )

    def detach(self, object_id: str, pose: Pose, place: str, reason: str = "released") -> None:
        """Detach the object from the hand; it is believed to rest at `pose` in the world from now on."""
        self.put(replace(self.get(object_id), object_in_tcp=None, pose=pose, place=place), reason)

    def carry(self, tcp_in_world: Pose) -> None:
        """Move the attached object with the TCP; no new version: nothing new is known."""
        held = self.held
        if held is not None and held.object_in_tcp is not None:
            self._objects[held.id] = replace(held, pose=tcp_in_world @ held.object_in_tcp)

    def weighed(self, object_id: str, mass: float) -> None:
        """Set the object's mass, kg; no new version: nothing that plans depend on is new."""
        self._objects[ObjectId(object_id)] = replace(self.get(object_id), mass=mass)

    def confirm(self, names: Iterable[ObjectId], now: float) -> None:
        """Set the time at which these objects were last seen, where they are believed, to `now`, s; no new
        version: nothing new is known."""
        for name in names:
            self._objects[name] = replace(self.get(name), last_seen=now)

    @contextmanager
    def allow(self, *pairs: tuple[str, str]) -> Generator[None]:
        """Allow collisions between pairs of names (ids, `gripper`, `arm`) meanwhile."""
        keys = [frozenset(pair) for pair in pairs]
        for key in keys:
            self._allowed[key] = self._allowed.get(key, 0) + 1
        try:
            yield
        finally:
            for key in keys:
                self._allowed[key] -= 1
                if not self._allowed[key]:
                    del self._allowed[key]

    def allow_mounting(self, pairs: Iterable[tuple[str, str]]) -> None:
        """Allow these pairs of a link and a fixture to touch from now on: the link is mounted on the
        fixture."""
        self._standing |= {frozenset(pair) for pair in pairs}

    def allowed(self, a: str, b: str) -> bool:
        key = frozenset((a, b))
        return key in self._allowed or key in self._standing

    def supposing(
        self,
        held: ObjectId | None = None,
        object_in_tcp: Pose | None = None,
        *,
        allowed: Iterable[tuple[str, str]] = (),
    ) -> PlanningScene:
        """Return a copy for planning, with `held` attached instead of the object in the hand. These pairs
        of names may touch in it. Raises Failure(world.unknown_object)."""
        copy = PlanningScene((), (), regions=self.regions)
        copy.fixtures, copy.bins = self.fixtures, self.bins
        copy._destination = self._destination
        copy._objects = dict(self._objects)
        copy._allowed = self._allowed | {frozenset(pair): 1 for pair in allowed}
        copy._standing = self._standing
        copy._version = self._version
        if held is not None:
            for other in copy.objects:
                if other.attached:
                    copy._objects[other.id] = replace(other, object_in_tcp=None)
            copy._objects[held] = replace(self.get(held), object_in_tcp=object_in_tcp, place="hand")
        return copy

    def take_changes(self) -> tuple[BeliefChange, ...]:
        """Return the changes since the last call, for the record."""
        changes = tuple(self._changes)
        self._changes.clear()
        return changes

    def _changed(self, reason: str, before: BeliefObject | None, after: BeliefObject | None) -> None:
        self._version += 1
        self._changes.append(BeliefChange(self._version, reason, before, after))

    def state(self) -> tuple[SceneSnapshot, Mapping[str, int]]:
        """Return the state for `restore`; taken when no collision is temporarily allowed."""
        return self.snapshot(), dict(self._numbers)

    def restore(self, snapshot: SceneSnapshot, numbers: Mapping[str, int]) -> None:
        self._objects = {o.id: o for o in snapshot.objects}
        self._version = snapshot.version
        self._numbers = dict(numbers)
        self._allowed.clear()
        self._changes.clear()
