"""Spawning: the items of a run's start, drawn from the stream `spawn` by scene and seed alone, also such
that each touches another.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from picktree.files import PicktreeError
from picktree.world import (
    Array,
    Cylinder,
    ObjectId,
    Pose,
    Quaternion,
    RandomStreams,
    Shape,
    Sphere,
    bottom,
    quaternion_product,
    scaled,
)
from picktree.world.scene import NO_UNCERTAINTY, CatalogueEntry, Fixture, SceneDescription, Spawn

from .footprints import Footprint, distance, footprint, support_height
from .heap_spawning import Stickers, draw_entries, pour_poses, upright_turn

MAX_ITEM_ATTEMPTS = 12
"""Number of attempts to place one item of a group."""
MAX_GROUP_ATTEMPTS = 6
"""Number of attempts to lay out a group."""
PLACE_CANDIDATES = 12
"""Number of places next to others, of which the nearest to the group's middle is taken: a group, not a
chain."""
TOUCHING_DISTANCE = 1e-4
"""Free distance of two touching items, m: nothing overlaps, and nothing moves when it settles."""
ALIGNED_SHARE = 0.9
"""Share of the items that are oriented like their neighbour."""


@dataclass(frozen=True, slots=True)
class TouchingLayout:
    """Orientations of the items, and their centres (2,), in the items' order."""

    turns: tuple[Quaternion, ...]
    places: tuple[Array, ...]


def lay_out_touching(
    spawn: Spawn,
    shapes: Sequence[Shape],
    turns: Sequence[Quaternion],
    taken: Sequence[Footprint],
    rng: np.random.Generator,
) -> TouchingLayout | None:
    """Lay out all items as a group within the area of `spawn`, its `gap` away from the outlines `taken`. None
    when there is no room for one."""
    for _ in range(MAX_GROUP_ATTEMPTS):
        found = _group(spawn, shapes, turns, taken, rng)
        if found is not None:
            return found
    return None


def _group(
    spawn: Spawn,
    shapes: Sequence[Shape],
    turns: Sequence[Quaternion],
    taken: Sequence[Footprint],
    rng: np.random.Generator,
) -> TouchingLayout | None:
    low, high = np.array(spawn.rectangle[0]), np.array(spawn.rectangle[1])
    order = [int(k) for k in rng.permutation(len(shapes))]
    turned = list(turns)
    places: dict[int, Array] = {}
    outlines: list[Footprint] = []
    for k in order:
        for _ in range(MAX_ITEM_ATTEMPTS):
            if not outlines:
                spot, turn = low + (high - low) * rng.uniform(0.3, 0.7, size=2), turns[k]
            else:
                middle = np.mean(list(places.values()), axis=0)
                found = [
                    _adjacent_place(shapes[k], turns[k], places, turned, outlines, rng)
                    for _ in range(PLACE_CANDIDATES)
                ]
                spot, turn = min(found, key=lambda f: math.dist(f[0], middle))
            one = footprint(shapes[k], turn).at(spot)
            free = all(distance(one, other) >= spawn.gap for other in taken)
            if free and bool((spot >= low).all() and (spot <= high).all()):
                places[k], turned[k] = spot, turn
                outlines.append(one)
                break
        else:
            return None
    return TouchingLayout(tuple(turned), tuple(places[k] for k in range(len(shapes))))


def _adjacent_place(
    shape: Shape,
    turn: Quaternion,
    places: dict[int, Array],
    turned: Sequence[Quaternion],
    outlines: Sequence[Footprint],
    rng: np.random.Generator,
) -> tuple[Array, Quaternion]:
    """Return a place next to an item of the group: straight towards it from outside, until the new item
    touches any."""
    anchor = list(places)[int(rng.integers(len(places)))]
    angle = float(rng.uniform(-math.pi, math.pi))
    aligned = rng.random() < ALIGNED_SHARE
    if aligned and not isinstance(shape, Sphere | Cylinder):
        yaw = 2.0 * math.atan2(turned[anchor][2], turned[anchor][3])
        turn = _about_z(yaw)
        angle = yaw + math.pi / 2 * int(rng.integers(4)) + float(rng.uniform(-0.05, 0.05))
    way = np.array([math.cos(angle), math.sin(angle)])
    one = footprint(shape, turn)
    far = max(o.reach + float(np.hypot(*(np.array(o.centre) - places[anchor]))) for o in outlines)
    off = far + one.reach + 0.01
    while True:
        spot = places[anchor] + way * off
        free = min(distance(one.at(spot), other) for other in outlines)
        if free <= TOUCHING_DISTANCE:
            return spot, turn
        # A step is never longer than the free distance; a little distance is kept, so that nothing
        # overlaps.
        off -= max(free - TOUCHING_DISTANCE / 2, TOUCHING_DISTANCE / 4)


def _about_z(yaw: float) -> Quaternion:
    return quaternion_product((0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)), (0.0, 0.0, 0.0, 1.0))


TUMBLE_HEIGHT = 0.1
"""Free fall of a tumbled item, m."""
MAX_PLACE_ATTEMPTS = 100
"""Number of random places that are tried for an outline."""
MAX_LAYOUT_ATTEMPTS = 3
"""Number of attempts for a layout of all outlines."""
MAX_RELAXATION_ROUNDS = 100
"""Greatest number of rounds in which crowded outlines are pushed apart."""


@dataclass(frozen=True, slots=True)
class SpawnedItem:
    """Item at its initial pose, before it settles."""

    id: ObjectId
    entry: CatalogueEntry
    colour: str
    pose: Pose
    """Pose in the world; the lowest point touches the support, or is above it when the item is dropped."""
    dropped: bool
    """Whether the item falls from `pose` instead of resting there."""
    brought_by: int | None = None
    """Entry of the feed that brought the item; None: it was there at the start."""
    stickers: Stickers | None = None
    """Faces of a thing of the assortment that carry its tag; None: the item is of the catalogue."""
    heap: int | None = None
    """Entry of `spawn` that pours the item into a heap; None: it is in no heap at the start."""
    tag: int | None = None
    """Number of the ArUco tag on its faces; None: it has none."""
    rolls: bool = False
    """Whether nothing brakes its rolling. A thing of the assortment has corners, and others beside it in a
    tote."""


@dataclass(frozen=True, slots=True)
class LooseItem:
    """Item of a load without a place."""

    kind: str
    colour: str
    turn: Quaternion
    """Orientation in the world."""


def spawn_items(scene: SceneDescription, seed: int) -> tuple[SpawnedItem, ...]:
    """Return every item of the scene with its id, colour and pose.

    Raises PicktreeError when an area is too small for its items or nothing is below it.
    """
    streams = RandomStreams(seed)
    taken = occupied_outlines(scene)
    items: list[SpawnedItem] = []
    for n, spawn in enumerate(scene.spawn):
        where = f"{scene.source or scene.name}: spawn[{n}]"
        rng = streams.at("spawn", n)
        if spawn.drop is not None:
            heap = draw_heap(scene, spawn, rng, where, taken)
            items += [replace(item, id=item_id(len(items) + k), heap=n) for k, item in enumerate(heap)]
            continue
        load = draw_load(scene, spawn, rng)
        shapes = [scene.entry(item.kind).shape for item in load]
        beside = None
        if spawn.touching:
            beside = lay_out_touching(spawn, shapes, [item.turn for item in load], taken, rng)
            if beside is None:
                raise _too_small(where, spawn, len(load))
            load = [replace(item, turn=turn) for item, turn in zip(load, beside.turns, strict=True)]
        outlines = [footprint(shape, item.turn) for shape, item in zip(shapes, load, strict=True)]
        places = beside.places if beside is not None else lay_out(spawn, outlines, taken, rng)
        if places is None:
            raise _too_small(where, spawn, len(load))
        for item, place in zip(load, places, strict=True):
            name = item_id(len(items))
            items.append(set_down(scene, spawn, item, place, name, where))
        taken += [o.at(p) for o, p in zip(outlines, places, strict=True)]
    return tuple(items)


def draw_heap(
    scene: SceneDescription,
    spawn: Spawn,
    rng: np.random.Generator,
    where: str,
    taken: list[Footprint] | None = None,
) -> list[SpawnedItem]:
    """Return the items of a heap, numbered from 0 on: above their place, or packed side by side.

    The outlines of packed items are added to those that are `taken`. Raises PicktreeError when an item does
    not fit into the place; `where` is the entry's place for the message.
    """
    drawn = draw_entries(scene, spawn, rng)
    entries = [entry for entry, _ in drawn]
    colours = _colours(spawn, len(drawn), rng)
    numbers = scene.assortment.tags if scene.assortment is not None else ()
    tags: list[int | None] = [None] * len(drawn)
    if numbers:
        tags = [numbers[int(k) % len(numbers)] for k in rng.permutation(len(drawn))]
    if spawn.drop == "packed":
        turns = _turns(spawn, entries, rng)
        upright = [
            turn if stickers is None else quaternion_product(turn, upright_turn(entry.shape))
            for turn, (entry, stickers) in zip(turns, drawn, strict=True)
        ]
        poses = _pack(scene, spawn, entries, upright, rng, [] if taken is None else taken, where)
    else:
        turns = _turns(replace(spawn, tumbled=True), entries, rng)
        poses = pour_poses(scene, spawn, entries, turns, rng, where)
    dropped = spawn.drop != "packed"
    in_tote = spawn.into is not None
    items: list[SpawnedItem] = []
    for k, (entry, stickers) in enumerate(drawn):
        tag, rolls = (None, False) if stickers is None else (tags[k], in_tote)
        name = item_id(k)
        spawned = SpawnedItem(name, entry, colours[k], poses[k], dropped, None, stickers)
        items.append(replace(spawned, tag=tag, rolls=rolls))
    return items


def _pack(
    scene: SceneDescription,
    spawn: Spawn,
    entries: Sequence[CatalogueEntry],
    turns: Sequence[Quaternion],
    rng: np.random.Generator,
    taken: list[Footprint],
    where: str,
) -> list[Pose]:
    """Return poses of items side by side on their support, and add their outlines to `taken`."""
    outlines = [footprint(entry.shape, turn) for entry, turn in zip(entries, turns, strict=True)]
    places = lay_out(spawn, outlines, taken, rng)
    if places is None:
        raise _too_small(where, spawn, len(entries))
    taken += [outline.at(place) for outline, place in zip(outlines, places, strict=True)]
    return [
        _standing(scene, entry.shape, turn, place, where)
        for entry, turn, place in zip(entries, turns, places, strict=True)
    ]


def item_id(number: int) -> ObjectId:
    """Return the name of an item; items are numbered in the order in which they come into a run."""
    return ObjectId(f"item_{number:02d}")


def item_number(name: ObjectId) -> int:
    """Return the number of an item, of which `item_id` is the name."""
    return int(name.removeprefix("item_"))


def draw_load(scene: SceneDescription, spawn: Spawn, rng: np.random.Generator) -> list[LooseItem]:
    """Draw the items of an entry, in the order of its kinds."""
    entries = [scene.entry(kind) for kind, number in spawn.counts.items() for _ in range(number)]
    colours = _colours(spawn, len(entries), rng)
    turns = _turns(spawn, entries, rng)
    return [LooseItem(e.kind, c, q) for e, c, q in zip(entries, colours, turns, strict=True)]


def set_down(
    scene: SceneDescription, spawn: Spawn, item: LooseItem, place: Array, name: ObjectId, where: str
) -> SpawnedItem:
    """Place an item over `place` (2,), touching the support below, or above it when it is dropped.

    Raises PicktreeError when nothing is below; `where` is the entry's place for the message.
    """
    entry = scene.entry(item.kind)
    drop = TUMBLE_HEIGHT if spawn.tumbled else 0.0
    pose = _standing(scene, entry.shape, item.turn, place, where, drop)
    return SpawnedItem(name, entry, item.colour, pose, spawn.tumbled)


def _standing(
    scene: SceneDescription, shape: Shape, turn: Quaternion, place: Array, where: str, drop: float = 0.0
) -> Pose:
    """Return the pose of a shape over `place` (2,), its lowest point `drop` m above the support.

    Raises PicktreeError when nothing is below; `where` is the entry's place for the message.
    """
    x, y = float(place[0]), float(place[1])
    z = support_height(scene.fixtures, x, y)
    if z is None:
        raise PicktreeError(
            f"{where}: no fixture is below ({x:.3f}, {y:.3f}); the area must lie over a table"
        )
    z += drop
    return Pose((x, y, z - bottom(shape, Pose(orientation=turn))), turn)


def _too_small(where: str, spawn: Spawn, items: int) -> PicktreeError:
    """Return the error for an area without room for its items."""
    low, high = _corners(spawn)
    size = " × ".join(f"{s:.2f}" for s in high - low)
    return PicktreeError(
        f"{where}: the area of {size} m is too small for {items} items with a gap of "
        f"{spawn.gap * 1000:.0f} mm; make it larger, or ask for fewer items or a smaller gap"
    )


def occupied_outlines(scene: SceneDescription) -> list[Footprint]:
    """Return the outlines of bins, of fixtures on top of another fixture, and of hidden obstacles."""
    bins = [
        footprint(box, pose.orientation).at(pose.position[:2]) for b in scene.bins for box, pose in b.parts()
    ]
    raised: list[Footprint] = []
    for fixture in scene.fixtures:
        x, y, _ = fixture.pose.position
        others = [f for f in scene.fixtures if f.id != fixture.id]
        below = support_height(others, x, y)
        if below is not None and bottom(fixture.shape, fixture.pose) > below - 1e-3:
            raised.append(footprint(fixture.shape, fixture.pose.orientation).at((x, y)))
    return bins + raised + [footprint(f.shape, f.pose.orientation).at(f.pose.position) for f in scene.unknown]


def _colours(spawn: Spawn, number: int, rng: np.random.Generator) -> list[str]:
    colours = [spawn.colours[k % len(spawn.colours)] for k in range(number)]
    return [colours[k] for k in rng.permutation(number)]


def _turns(spawn: Spawn, entries: Sequence[CatalogueEntry], rng: np.random.Generator) -> list[Quaternion]:
    """Draw the orientation of each item; the share `lying` of the cylinders lies, rounded at random."""
    cylinders = [k for k, e in enumerate(entries) if e.form == "cylinder"]
    lying = set(rng.permutation(cylinders)[: int(spawn.lying * len(cylinders) + rng.random())].tolist())
    turns: list[Quaternion] = []
    for k in range(len(entries)):
        yaw = float(rng.uniform(-math.pi, math.pi))
        free = rng.standard_normal(4)
        if spawn.tumbled:
            x, y, z, w = (float(c) for c in free / np.linalg.norm(free))
            turns.append((x, y, z, w))
            continue
        about_z = (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
        side = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
        turns.append(quaternion_product(about_z, side) if k in lying else about_z)
    return turns


def lay_out(
    spawn: Spawn, outlines: Sequence[Footprint], taken: Sequence[Footprint], rng: np.random.Generator
) -> list[Array] | None:
    """Return centres (2,) such that no two outlines are closer than the gap; the widest is placed first. None
    when there is no room for all."""
    for _ in range(MAX_LAYOUT_ATTEMPTS):
        places = _random_places(spawn, outlines, taken, rng, all_or_none=True)
        if len(places) == len(outlines):
            return [places[k] for k in range(len(outlines))]
    return _relaxed_places(spawn, outlines, taken, rng)


def lay_out_some(
    spawn: Spawn, outlines: Sequence[Footprint], taken: Sequence[Footprint], rng: np.random.Generator
) -> Mapping[int, Array]:
    """Lay out as many outlines as find room: centres by the number of the outline."""
    places = lay_out(spawn, outlines, taken, rng)
    if places is not None:
        return dict(enumerate(places))
    return _random_places(spawn, outlines, taken, rng, all_or_none=False)


def _random_places(
    spawn: Spawn,
    outlines: Sequence[Footprint],
    taken: Sequence[Footprint],
    rng: np.random.Generator,
    *,
    all_or_none: bool,
) -> dict[int, Array]:
    """Place each outline at the first free one of several random places; `all_or_none` ends with the first
    outline without one."""
    low, high = _corners(spawn)
    places: dict[int, Array] = {}
    for k in sorted(range(len(outlines)), key=lambda k: -outlines[k].reach):
        others = [*taken, *(outlines[j].at(p) for j, p in places.items())]
        for _ in range(MAX_PLACE_ATTEMPTS):
            spot = rng.uniform(low, high)
            if _clear(outlines[k].at(spot), others, spawn.gap):
                places[k] = spot
                break
        else:
            if all_or_none:
                break
    return places


def _corners(spawn: Spawn) -> tuple[Array, Array]:
    low, high = spawn.rectangle
    return np.array(low), np.array(high)


def _clear(one: Footprint, others: Sequence[Footprint], gap: float) -> bool:
    return all(
        math.dist(one.centre, other.centre) >= one.reach + other.reach + gap or distance(one, other) >= gap
        for other in others
    )


def _relaxed_places(
    spawn: Spawn, outlines: Sequence[Footprint], taken: Sequence[Footprint], rng: np.random.Generator
) -> list[Array] | None:
    """Lay out a crowded area: begin at random places and push apart outlines that are too close. None when
    that fails."""
    low, high = _corners(spawn)
    for _ in range(MAX_LAYOUT_ATTEMPTS):
        places = [rng.uniform(low, high) for _ in outlines]
        for _ in range(MAX_RELAXATION_ROUNDS):
            crowded = False
            for k, outline in enumerate(outlines):
                one = outline.at(places[k])
                for j, other in enumerate([*taken, *(outlines[i].at(places[i]) for i in range(k))]):
                    away = np.subtract(one.centre, other.centre)
                    if float(np.hypot(*away)) >= one.reach + other.reach + spawn.gap:
                        continue
                    lack = spawn.gap - distance(one, other)
                    if lack <= 0:
                        continue
                    crowded = True
                    away = away / max(1e-9, float(np.hypot(*away))) * (lack / 2 + 5e-4)
                    places[k] = np.clip(places[k] + away, low, high)
                    if j >= len(taken):
                        i = j - len(taken)
                        places[i] = np.clip(places[i] - away, low, high)
                    one = outline.at(places[k])
            if not crowded:
                return places
    return None


BROUGHT_BY_FAULT = -1
"""Value of `brought_by` for items that a fault has added."""
APPEARANCE_HEIGHT = 5e-4
"""Height above the support at which an item appears, m."""
MIN_ITEM_CLEARANCE = 5e-4
"""Clearance that a new or enlarged item needs around it, m."""


def placed_item(
    scene: SceneDescription, name: ObjectId, kind: str, colour: str, place: tuple[float, float], yaw: float
) -> SpawnedItem:
    """Return a catalogue item with its centre over `place` (x, y), m, turned by `yaw` about z, rad.

    Raises PicktreeError when no fixture is below.
    """
    x, y = place
    height = support_height(scene.fixtures, x, y)
    if height is None:
        raise PicktreeError(f"nothing is below ({x:.3f}, {y:.3f})")
    entry = scene.entry(kind)
    turn = Pose(orientation=(0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)))
    pose = turn.shifted((x, y, height - bottom(entry.shape, turn) + APPEARANCE_HEIGHT))
    return SpawnedItem(name, entry, colour, pose, dropped=False, brought_by=BROUGHT_BY_FAULT)


def enlarged_item(entry: CatalogueEntry, pose: Pose, factor: float) -> tuple[CatalogueEntry, Pose]:
    """Return the entry scaled by `factor`, and its pose with the lowest point at the same height."""
    larger = replace(entry, shape=scaled(entry.shape, factor))
    lift = bottom(entry.shape, pose) - bottom(larger.shape, pose)
    return larger, pose.shifted((0.0, 0.0, lift))


def walls(scene: SceneDescription) -> Iterable[tuple[Shape, Pose]]:
    """Return the parts of the bins, in which nothing may appear."""
    return ((box, pose) for each in scene.bins for box, pose in each.parts())


def displace_fixtures(scene: SceneDescription, seed: int, *, level: bool = False) -> SceneDescription:
    """Return the scene with its fixtures at their true poses, for the simulation only; the robot gets the
    scene as given. `level`: fixtures are shifted and turned, but not tilted."""
    if all(fixture.uncertainty == NO_UNCERTAINTY for fixture in scene.fixtures):
        return scene
    streams = RandomStreams(seed)
    return replace(scene, fixtures=tuple(_displaced(fixture, streams, level) for fixture in scene.fixtures))


def _displaced(fixture: Fixture, streams: RandomStreams, level: bool) -> Fixture:
    """Return the fixture displaced within its bounds. It is shifted along its x and y and turned about its z,
    evenly distributed, and tilted about a random level axis through its middle."""
    most = fixture.uncertainty
    if most == NO_UNCERTAINTY:
        return fixture
    rng = streams.at(f"fixture/{fixture.id}", 0)
    x, y = (float(rng.uniform(-most.position, most.position)) for _ in range(2))
    yaw = float(rng.uniform(-most.angle, most.angle))
    tilt, towards = float(rng.uniform(0.0, most.angle)), float(rng.uniform(-math.pi, math.pi))
    tilt = 0.0 if level else tilt
    lean = math.sin(tilt / 2)
    leaning = (lean * math.cos(towards), lean * math.sin(towards), 0.0, math.cos(tilt / 2))
    turning = (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
    really = Pose((x, y, 0.0), quaternion_product(leaning, turning))
    return replace(fixture, pose=fixture.pose @ really)
