"""Bodies of the kinematic backend: they rest on the support below them, or stay in the fingers that hold
them."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace

from ...world.scene.description import CatalogueEntry, Fixture, SceneDescription
from ...world.shapes import Shape, extents
from ...world.values import ObjectId, Pose, Vector3
from ..footprints import Footprint, distance, footprint
from .holes import HoleBelow, KinematicHoles

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


@dataclass(frozen=True, slots=True)
class Prism:
    """Vertical prism of a body: an outline from above and a level top, as support for other bodies."""

    id: str
    outline: Footprint
    low: tuple[float, float, float]
    high: tuple[float, float, float]

    @classmethod
    def of(cls, name: str, shape: Shape, pose: Pose) -> Prism:
        lowest, highest = extents(shape, pose.rotation())
        x, y, z = pose.position
        return cls(
            name,
            footprint(shape, pose.orientation).at(pose.position[:2]),
            (x + float(lowest[0]), y + float(lowest[1]), z + float(lowest[2])),
            (x + float(highest[0]), y + float(highest[1]), z + float(highest[2])),
        )

    def shifted(self, way: Vector3) -> Prism:
        dx, dy, dz = way
        cx, cy = self.outline.centre
        (x0, y0, z0), (x1, y1, z1) = self.low, self.high
        outline = self.outline.at((cx + dx, cy + dy))
        return Prism(self.id, outline, (x0 + dx, y0 + dy, z0 + dz), (x1 + dx, y1 + dy, z1 + dz))

    def covers(self, x: float, y: float) -> bool:
        """Return whether the point lies inside the outline."""
        if not (self.low[0] <= x <= self.high[0] and self.low[1] <= y <= self.high[1]):
            return False
        cx, cy = self.outline.centre
        polygon, r = self.outline.polygon, self.outline.radius
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
            and distance(self.outline, other.outline) <= 0.0
        )


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
        """Set an item at its pose, whatever is below."""
        self._items[body.id] = body
        if body.present and body.id != self.held:
            self._prisms[body.id] = Prism.of(body.id, body.entry.shape, body.pose)
            self._measure()

    def standing(self) -> tuple[tuple[KinematicBody, Prism], ...]:
        """Return the items that are present and not held, with their prisms."""
        return tuple((self._items[name], prism) for name, prism in self._prisms.items())

    def shift(self, items: Iterable[ObjectId], way: Vector3) -> None:
        """Move items horizontally by `way`, m, whatever is in the way."""
        for name in items:
            body = self._items[name]
            self._items[name] = replace(body, pose=body.pose.shifted(way))
            self._prisms[name] = self._prisms[name].shifted(way)

    def stand(self, obstacles: Iterable[Fixture]) -> None:
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
            self.put(replace(body, pose=body.pose.shifted((0.0, 0.0, floor - prism.low[2]))))

    def carry(self, pose: Pose) -> None:
        """Move the held item to a pose in the world."""
        assert self.held is not None
        self._items[self.held] = replace(self._items[self.held], pose=pose)

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
            body = replace(body, pose=hole.pose)
            prism = Prism.of(item, body.entry.shape, body.pose)
        if surface is not None:
            body = replace(body, pose=body.pose.shifted((0.0, 0.0, surface - prism.low[2])))
        self.put(body)

    def in_hole(self, body: KinematicBody) -> HoleBelow | None:
        """Return the hole that holds the body; None: no hole does."""
        hole = self._mouths.under(body.entry.shape, body.pose)
        return hole if hole is not None and hole.entered else None

    def below(self, prism: Prism) -> float | None:
        """Return the height of the highest top under the outline, m; None: there is none."""
        return max((top for _, top in self.tops_below(prism)), default=None)

    def tops_below(self, prism: Prism) -> list[tuple[str, float]]:
        """Return names and heights, m, of the tops under the outline. A fixture with a hole there counts with
        the hole's bottom."""
        limit = prism.low[2] + MAX_SUPPORT_RISE
        body = self._items.get(ObjectId(prism.id))
        hole = None if body is None else self._mouths.under(body.entry.shape, body.pose)
        tops = [
            (p.id, p.high[2])
            for p in (*self._fixed, *self._prisms.values())
            if p.high[2] <= limit
            and p.id != prism.id
            and (hole is None or p.id != hole.fixture)
            and p.overlaps(prism)
        ]
        return tops if hole is None else [*tops, (hole.fixture, hole.floor)]

    def tops(self, x: float, y: float, limit: float) -> list[tuple[str, float]]:
        """Return names and heights, m, of the tops at (x, y) that are no higher than `limit`."""
        return [
            (p.id, p.high[2])
            for p in (*self._fixed, *self._prisms.values())
            if p.high[2] <= limit and p.covers(x, y)
        ]

    def _measure(self) -> None:
        self.highest = max((p.high[2] for p in (*self._fixed, *self._prisms.values())), default=0.0)
