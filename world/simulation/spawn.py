"""Where items stand when a run begins: drawn from the stream `spawn`, from scene and seed alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import PicktreeError
from ..scene.description import CatalogueEntry, SceneDescription, Spawn
from ..shapes import bottom
from ..streams import Streams
from ..values import Array, ObjectId, Pose, Quaternion, quaternion_product
from .footprints import Footprint, distance, footprint, support_height

TUMBLE_HEIGHT = 0.1
"""Free fall of a tumbled item, m."""
DARTS = 100
LAYOUTS = 3
RELAXATIONS = 100


@dataclass(frozen=True, slots=True)
class SpawnedItem:
    """An item as it is put into the world, before it settles."""

    id: ObjectId
    entry: CatalogueEntry
    colour: str
    pose: Pose
    """In the world; the lowest point touches what is below, or hangs above it when dropped."""
    dropped: bool
    """It falls from `pose` instead of standing there."""


def spawn_items(scene: SceneDescription, seed: int) -> tuple[SpawnedItem, ...]:
    """Every item of the scene with its id, colour and pose.

    Raises PicktreeError when an area is too small for its items or nothing is below it.
    """
    streams = Streams(seed)
    taken = _standing(scene)
    items: list[SpawnedItem] = []
    for n, spawn in enumerate(scene.spawn):
        rng = streams.at("spawn", n)
        entries = [scene.entry(kind) for kind, number in spawn.counts for _ in range(number)]
        colours = _colours(spawn, len(entries), rng)
        turns = _turns(spawn, entries, rng)
        outlines = [footprint(e.shape, q) for e, q in zip(entries, turns, strict=True)]
        places = _layout(spawn, outlines, taken, rng, f"{scene.source or scene.name}: spawn[{n}]")
        for entry, colour, turn, place in zip(entries, colours, turns, places, strict=True):
            x, y = float(place[0]), float(place[1])
            z = support_height(scene.fixtures, x, y)
            if z is None:
                raise PicktreeError(
                    f"{scene.source or scene.name}: spawn[{n}]: no fixture is below ({x:.3f}, {y:.3f}); "
                    "the area must lie over a table"
                )
            z += TUMBLE_HEIGHT if spawn.tumbled else 0.0
            pose = Pose((x, y, z - bottom(entry.shape, Pose(orientation=turn))), turn)
            items.append(SpawnedItem(ObjectId(f"item_{len(items):02d}"), entry, colour, pose, spawn.tumbled))
        taken += [o.at(p) for o, p in zip(outlines, places, strict=True)]
    return tuple(items)


def _standing(scene: SceneDescription) -> list[Footprint]:
    """Outlines of bins, and of fixtures that stand on another fixture."""
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
    return bins + raised


def _colours(spawn: Spawn, number: int, rng: np.random.Generator) -> list[str]:
    colours = [spawn.colours[k % len(spawn.colours)] for k in range(number)]
    return [colours[k] for k in rng.permutation(number)]


def _turns(spawn: Spawn, entries: Sequence[CatalogueEntry], rng: np.random.Generator) -> list[Quaternion]:
    """Orientation of each item; the share `lying` of the cylinders lies, rounded at random."""
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


def _layout(
    spawn: Spawn,
    outlines: Sequence[Footprint],
    taken: Sequence[Footprint],
    rng: np.random.Generator,
    where: str,
) -> list[Array]:
    """Centres (2,) such that no two outlines are closer than the gap; the widest is placed first."""
    low, high = _corners(spawn)
    order = sorted(range(len(outlines)), key=lambda k: -outlines[k].reach)
    for _ in range(LAYOUTS):
        places: dict[int, Array] = {}
        for k in order:
            others = [*taken, *(outlines[j].at(p) for j, p in places.items())]
            for _ in range(DARTS):
                spot = rng.uniform(low, high)
                if _clear(outlines[k].at(spot), others, spawn.gap):
                    places[k] = spot
                    break
            else:
                break
        if len(places) == len(outlines):
            return [places[k] for k in range(len(outlines))]
    relaxed = _relaxed(spawn, outlines, taken, rng)
    if relaxed is None:
        size = " × ".join(f"{s:.2f}" for s in high - low)
        raise PicktreeError(
            f"{where}: the area of {size} m is too small for {len(outlines)} items with a gap of "
            f"{spawn.gap * 1000:.0f} mm; make it larger, or ask for fewer items or a smaller gap"
        )
    return relaxed


def _corners(spawn: Spawn) -> tuple[Array, Array]:
    low, high = spawn.area
    return np.array(low), np.array(high)


def _clear(one: Footprint, others: Sequence[Footprint], gap: float) -> bool:
    return all(
        math.dist(one.centre, other.centre) >= one.reach + other.reach + gap or distance(one, other) >= gap
        for other in others
    )


def _relaxed(
    spawn: Spawn, outlines: Sequence[Footprint], taken: Sequence[Footprint], rng: np.random.Generator
) -> list[Array] | None:
    """A layout for crowded areas: start anywhere and push apart what is too close."""
    low, high = _corners(spawn)
    for _ in range(LAYOUTS):
        places = [rng.uniform(low, high) for _ in outlines]
        for _ in range(RELAXATIONS):
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
