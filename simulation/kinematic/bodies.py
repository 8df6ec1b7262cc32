"""Bodies of the kinematic backend: they rest on a support, stay in fingers, or go into a hole nearby."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, replace
from functools import cache
from typing import TypeAlias

from picktree.simulation import Footprint, distance, footprint
from picktree.world import (
    Array,
    Box,
    CompoundMesh,
    ObjectId,
    Pose,
    Shape,
    Vector3,
    bottom,
    convex_parts,
    extents,
    hole_geometry,
    outline,
    planar_geometry,
)
from picktree.world.scene import CatalogueEntry, Fixture, Hole, SceneDescription

MAX_ENTRY_TILT = math.radians(3.0)
"""Largest tilt with which an item enters a hole, rad."""
MAX_ENTRY_ROTATION = math.radians(1.0)
"""Rotation about the hole up to which a box enters with any clearance, rad: the hand gives way."""
MIN_ENTERED_DEPTH = 0.002
"""Depth below the mouth from which an item is in the hole, m: more than a hand presses it into a surface."""
MAX_SEATED_OFFSET = 0.008
"""Distance beyond the walls' clearance up to which an item in a hole stays in it, m."""


@dataclass(frozen=True, slots=True)
class HoleBelow:
    """Hole that an item is over, or in."""

    fixture: ObjectId
    hole: Hole
    floor: float
    """Height of its bottom in the world, m."""
    pose: Pose
    """Pose in the world of the item upright in the hole, at its present height."""
    entered: bool
    """Whether the item is so deep in the hole that the walls hold it."""


class KinematicHoles:
    """Holes of level fixtures, at their true poses."""

    def __init__(self, fixtures: Iterable[Fixture]) -> None:
        self._holes = [(f.id, hole, f.pose @ hole.pose) for f in fixtures for hole in f.holes]

    def under(self, shape: Shape, pose: Pose) -> HoleBelow | None:
        """Return the hole into which an item at `pose` goes when it is lowered; None without such a hole."""
        for fixture, hole, mouth in self._holes:
            found = _under(fixture, hole, mouth, shape, pose)
            if found is not None:
                return found
        return None


def _under(fixture: ObjectId, hole: Hole, mouth: Pose, shape: Shape, pose: Pose) -> HoleBelow | None:
    left = hole_geometry.hole_clearance(hole, shape)
    if left is None or min(left) <= 0.0:
        return None
    item = mouth.inverse() @ pose
    x, y, _ = item.position
    entered = bottom(shape, item) < -MIN_ENTERED_DEPTH
    loose = MAX_SEATED_OFFSET if entered else hole.chamfer
    if hole.form == "round":
        off = max(0.0, math.hypot(x, y) - left[0] / 2)
    else:
        off = max(0.0, abs(x) - left[0] / 2, abs(y) - left[1] / 2)
    if off > loose:
        return None
    rotation = item.rotation()
    turn = _turn(hole, shape, rotation)
    if not entered:
        leaning = math.acos(min(1.0, abs(float(rotation[2, 2]))))
        if leaning > MAX_ENTRY_TILT or abs(turn) > max(
            MAX_ENTRY_ROTATION, (min(left) + 2 * hole.chamfer) / max(hole.size)
        ):
            return None
    seated = mouth @ _seated(hole, left, item, turn)
    return HoleBelow(fixture, hole, mouth.position[2] - hole.depth, seated, entered)


def _turn(hole: Hole, shape: Shape, rotation: Array) -> float:
    """Return the rotation of a box against the hole's sides about the vertical, rad; 0 for a round one."""
    if not isinstance(shape, Box) or hole.form == "round":
        return 0.0
    x, y, _ = shape.size
    axis = rotation[:, 0] if x >= y else rotation[:, 1]
    yaw = math.atan2(float(axis[1]), float(axis[0]))
    # A square hole or item has two equivalent orientations.
    period = math.pi / 2 if x == y or hole.size[0] == hole.size[1] else math.pi
    return (yaw + period / 2) % period - period / 2


def _seated(hole: Hole, left: hole_geometry.Slack, item: Pose, turn: float) -> Pose:
    """Return the item's pose in the hole's frame: upright, between the walls, at its present height."""
    x, y, z = item.position
    rotation = item.rotation()
    yaw = math.atan2(float(rotation[1, 0]), float(rotation[0, 0])) - turn
    roll = 0.0 if rotation[2, 2] > 0.0 else math.pi
    if hole.form == "round":
        share = min(1.0, left[0] / 2 / max(math.hypot(x, y), 1e-12))
        x, y = share * x, share * y
    else:
        x = min(max(x, -left[0] / 2), left[0] / 2)
        y = min(max(y, -left[1] / 2), left[1] / 2)
    return Pose.from_rpy((x, y, z), (roll, 0.0, yaw))


MAX_SUPPORT_RISE = 0.005
"""Height above a body's lowest point up to which a surface counts as below it, m."""


@dataclass(frozen=True, slots=True)
class KinematicBody:
    """True state of one item."""

    id: ObjectId
    entry: CatalogueEntry
    colour: str
    pose: Pose
    friction: float
    present: bool = True
    """Whether the item is present; False after a fault has removed it."""
    scale: float = 1.0
    """Scale by faults, as a multiple of the catalogue's size; `entry` includes it."""

    def at(self, pose: Pose) -> KinematicBody:
        """Return the body at another pose in the world."""
        return KinematicBody(self.id, self.entry, self.colour, pose, self.friction, self.present, self.scale)


CERTAIN_OVERLAP = 1e-6
"""Depth inside an outline from which an overlap needs no test of edges, m: more than corners are rounded."""


@dataclass(frozen=True, slots=True, eq=False)
class Prism:
    """Vertical prism of a body: an outline from above and a level top, as support for other bodies."""

    id: str
    low: Vector3
    high: Vector3
    _centre: tuple[float, float]
    _outline: Callable[[], Footprint]
    """Outline about the origin; it is computed when it is first needed."""

    @classmethod
    def of(cls, name: str, shape: Shape, pose: Pose) -> Prism:
        lowest, highest = (bound.tolist() for bound in extents(shape, pose.rotation()))
        x, y, z = pose.position
        return cls(
            name,
            (x + lowest[0], y + lowest[1], z + lowest[2]),
            (x + highest[0], y + highest[1], z + highest[2]),
            (x, y),
            cache(lambda: footprint(shape, pose.orientation)),
        )

    @property
    def outline(self) -> Footprint:
        return self._outline().at(self._centre)

    def shifted(self, way: Vector3) -> Prism:
        dx, dy, dz = way
        cx, cy = self._centre
        (x0, y0, z0), (x1, y1, z1) = self.low, self.high
        low, high = (x0 + dx, y0 + dy, z0 + dz), (x1 + dx, y1 + dy, z1 + dz)
        return Prism(self.id, low, high, (cx + dx, cy + dy), self._outline)

    def covers(self, x: float, y: float) -> bool:
        """Return whether the point lies inside the outline."""
        if not (self.low[0] <= x <= self.high[0] and self.low[1] <= y <= self.high[1]):
            return False
        cx, cy = self._centre
        outline = self._outline()
        polygon, r = outline.polygon, outline.radius
        if len(polygon) == 1:
            return (x - cx) ** 2 + (y - cy) ** 2 <= r * r
        dx, dy = x - cx, y - cy
        ax, ay = polygon[-1]
        for bx, by in polygon:
            if (bx - ax) * (dy - ay) - (by - ay) * (dx - ax) < 0.0:
                return False
            ax, ay = bx, by
        return True

    def overlaps(self, other: Prism) -> bool:
        """Return whether the two outlines overlap."""
        return (
            self.low[0] < other.high[0]
            and other.low[0] < self.high[0]
            and self.low[1] < other.high[1]
            and other.low[1] < self.high[1]
            and (
                self._surrounds(other)
                or other._surrounds(self)
                or distance(self.outline, other.outline) <= 0.0
            )
        )

    def _surrounds(self, other: Prism) -> bool:
        """Return whether the outline is a box along the axes around that of `other`."""
        (x0, y0, _), (x1, y1, _), room = self.low, self.high, CERTAIN_OVERLAP
        return (
            x0 + room < other.low[0]
            and other.high[0] < x1 - room
            and y0 + room < other.low[1]
            and other.high[1] < y1 - room
            and self._fills_box()
        )

    def _fills_box(self) -> bool:
        (cx, cy), (x0, y0, _), (x1, y1, _) = self._centre, self.low, self.high
        xs, ys = (round(x0 - cx, 9), round(x1 - cx, 9)), (round(y0 - cy, 9), round(y1 - cy, 9))
        return set(self._outline().polygon) == {(x, y) for x in xs for y in ys}


Placed: TypeAlias = tuple[planar_geometry.PlanarOutline, planar_geometry.PlanarPose]
"""Outline from above in its own frame, and its pose in the plane."""
Top: TypeAlias = tuple[float, float, float, float, float, Prism]
"""Box around a level top: low x and y, high x and y, height, m; and its body."""


class KinematicBodies:
    """All items of a run over the fixtures and bins of its scene."""

    def __init__(self, scene: SceneDescription, items: Iterable[KinematicBody]) -> None:
        parts = [(f.id, f.shape, f.pose) for f in scene.fixtures]
        parts += [(b.id, box, pose) for b in scene.bins for box, pose in b.parts()]
        self._fixed = tuple(Prism.of(name, shape, pose) for name, shape, pose in parts)
        self._scenery = self._fixed
        self._mouths = KinematicHoles(scene.fixtures)
        self._items: dict[ObjectId, KinematicBody] = {}
        self._prisms: dict[ObjectId, Prism] = {}
        self._outlines: dict[ObjectId, tuple[KinematicBody, Placed]] = {}
        self._tops: tuple[Top, ...] | None = None
        """Tops of all bodies that are not held; None: to be collected again."""
        self.held: ObjectId | None = None
        self.highest = 0.0
        """Height of the highest top of all bodies that are not held, m."""
        self.replace_all(items, None)

    @property
    def items(self) -> tuple[KinematicBody, ...]:
        """All items that did not leave with a bin, those removed by faults included."""
        return tuple(self._items.values())

    @property
    def fixed(self) -> tuple[Prism, ...]:
        """Static bodies: fixtures, parts of bins, obstacles."""
        return self._fixed

    @property
    def present(self) -> tuple[KinematicBody, ...]:
        return tuple(body for body in self._items.values() if body.present)

    def __getitem__(self, item: ObjectId) -> KinematicBody:
        return self._items[item]

    def __contains__(self, item: object) -> bool:
        return item in self._items

    def replace_all(self, items: Iterable[KinematicBody], held: ObjectId | None) -> None:
        self._items = {body.id: body for body in items}
        self.held = held
        self._prisms = {b.id: Prism.of(b.id, b.entry.shape, b.pose) for b in self.present if b.id != held}
        self._measure()

    def put(self, body: KinematicBody) -> None:
        """Set an item at its pose, without a check of its support."""
        self._items[body.id] = body
        if body.present and body.id != self.held:
            self._prisms[body.id] = Prism.of(body.id, body.entry.shape, body.pose)
            self._measure()

    def standing(self) -> tuple[tuple[KinematicBody, Prism], ...]:
        """Return the items that are present and not held, with their prisms."""
        return tuple((self._items[name], prism) for name, prism in self._prisms.items())

    def outline(self, item: ObjectId) -> Placed:
        """Return the item's outline from above."""
        body, known = self._items[item], self._outlines.get(item)
        if known is None or known[0] is not body:
            shape, pose = body.entry.shape, body.pose
            known = self._outlines[item] = body, (outline(shape, pose), planar_geometry.planar(shape, pose))
        return known[1]

    def shift(self, items: Iterable[ObjectId], way: Vector3) -> None:
        """Move items horizontally by `way`, m, without a check for collisions."""
        for name in items:
            body = self._items[name]
            self._items[name] = body.at(body.pose.shifted(way))
            self._prisms[name] = self._prisms[name].shifted(way)
        self._tops = None

    def replace_obstacles(self, obstacles: Iterable[Fixture]) -> None:
        """Replace the obstacles among the static bodies. Items on an obstacle that is gone come down."""
        self._fixed = (*self._scenery, *(Prism.of(f.id, f.shape, f.pose) for f in obstacles))
        self.settle()

    def fall(self, item: ObjectId, floor: float) -> None:
        """Let an item fall straight down onto a static body below, or else onto the floor."""
        body = self._items[item]
        prism = Prism.of(item, body.entry.shape, body.pose)
        if any(p.overlaps(prism) and p.high[2] <= prism.low[2] + MAX_SUPPORT_RISE for p in self._fixed):
            self.drop(item)
        else:
            self.put(body.at(body.pose.shifted((0.0, 0.0, floor - prism.low[2]))))

    def carry(self, pose: Pose) -> None:
        """Move the held item to a pose in the world."""
        assert self.held is not None
        self._items[self.held] = self._items[self.held].at(pose)

    def take(self, item: ObjectId, pose: Pose) -> None:
        """Take an item into the fingers; items on it come down."""
        self.held = item
        self._prisms.pop(item, None)
        self.carry(pose)
        self.settle()

    def let_go(self) -> None:
        """Release the held item; it drops straight down."""
        if self.held is not None:
            item, self.held = self.held, None
            self.drop(item)

    def remove(self, item: ObjectId) -> None:
        if self.held == item:
            self.held = None
        self._items[item] = replace(self._items[item], present=False)
        self._prisms.pop(item, None)
        self.settle()

    def forget(self, items: Collection[ObjectId]) -> None:
        """Delete items that left with their bin; items on them come down."""
        for item in items:
            self.held = None if self.held == item else self.held
            del self._items[item]
            self._prisms.pop(item, None)
        if items:
            self.settle()

    def settle(self) -> None:
        """Let all unsupported items come down, the lowest first."""
        self._tops = None
        for prism in sorted(self._prisms.values(), key=lambda p: p.low[2]):
            self.drop(ObjectId(prism.id))
        self._measure()

    def drop(self, item: ObjectId) -> None:
        """Lower an item with its orientation onto the highest support below; without one it stays."""
        body = self._items[item]
        prism = Prism.of(item, body.entry.shape, body.pose)
        surface = self.below(prism)
        hole = self._mouths.under(body.entry.shape, body.pose)
        if hole is not None and surface == hole.floor:
            body = body.at(hole.pose)
            prism = Prism.of(item, body.entry.shape, body.pose)
        if surface is not None:
            body = body.at(body.pose.shifted((0.0, 0.0, surface - prism.low[2])))
        self.put(body)

    def in_hole(self, body: KinematicBody) -> HoleBelow | None:
        """Return the hole that holds the body; None: no hole does."""
        hole = self._mouths.under(body.entry.shape, body.pose)
        return hole if hole is not None and hole.entered else None

    def below(self, prism: Prism) -> float | None:
        """Return the height of the highest top under the outline, m; None without one."""
        return max((top for _, top in self.tops_below(prism)), default=None)

    def tops_below(self, prism: Prism) -> list[tuple[str, float]]:
        """Return names and heights, m, of the tops under the outline. A fixture with a hole there counts with
        the hole's bottom."""
        limit = prism.low[2] + MAX_SUPPORT_RISE
        (x0, y0, _), (x1, y1, _) = prism.low, prism.high
        body = self._items.get(ObjectId(prism.id))
        hole = None if body is None else self._mouths.under(body.entry.shape, body.pose)
        tops = [
            (p.id, top)
            for low_x, low_y, high_x, high_y, top, p in self._level_tops()
            if top <= limit
            and low_x < x1
            and x0 < high_x
            and low_y < y1
            and y0 < high_y
            and p.id != prism.id
            and (hole is None or p.id != hole.fixture)
            and p.overlaps(prism)
        ]
        return tops if hole is None else [*tops, (hole.fixture, hole.floor)]

    def tops(self, x: float, y: float, limits: tuple[float, float]) -> list[tuple[str, float]]:
        """Return names and heights, m, of the tops at (x, y) above the first limit, up to the second one."""
        low, high = limits
        return [
            (p.id, top)
            for low_x, low_y, high_x, high_y, top, p in self._level_tops()
            if low < top <= high and low_x <= x <= high_x and low_y <= y <= high_y and p.covers(x, y)
        ]

    def _level_tops(self) -> tuple[Top, ...]:
        if self._tops is None:
            bodies = [*self._fixed]
            for name, prism in self._prisms.items():
                bodies += self._parts(self._items[name]) or (prism,)
            self._tops = tuple((*p.low[:2], *p.high[:2], p.high[2], p) for p in bodies)
        return self._tops

    def _parts(self, body: KinematicBody) -> list[Prism]:
        """Return the prisms of the convex parts of a body, which has a hollow between them; empty: none."""
        if not isinstance(body.entry.shape, CompoundMesh):
            return []
        return [Prism.of(body.id, part, body.pose) for part in convex_parts(body.entry.shape)]

    def _measure(self) -> None:
        self._tops = None
        self.highest = max((p.high[2] for p in (*self._fixed, *self._prisms.values())), default=0.0)
