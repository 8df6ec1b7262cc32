"""Items that stand in holes: a camera sees of them what stands out, which is fitted as a shorter item."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

from ...world.belief.hole_matching import fits
from ...world.scene.description import CatalogueEntry, Fixture
from ...world.scene.holes import Hole
from ...world.shapes import Box, Cylinder, Shape, top
from ...world.values import ObjectId
from .resting_poses import Rest, rests

OFF = 0.012
"""The middle of what is seen of an item, its sides included, is this much off the hole in which it stands at
most, beside what is not known of where the hole is, m."""
SHOWS = 0.004
"""What stands out by less than this is not recognised, m."""


@dataclass(frozen=True, slots=True)
class Stub:
    """What stands out of a hole of an item that stands in it."""

    entry: CatalogueEntry
    """Of the whole item."""
    rest: Rest
    sunk: float
    """How far the item's centre is below that of what stands out, m."""


@dataclass(frozen=True, eq=False)
class Mouth:
    """A hole as perception believes it to be."""

    id: ObjectId
    at: tuple[float, float]
    """In the world, m."""
    height: float
    """Of the face around it, in the world, m."""
    reach: float
    """An item whose visible middle is nearer than this to the mouth's may stand in it, m."""
    sigma: float
    """Standard deviation of where it is, along each axis, m."""
    stubs: tuple[Stub, ...]
    """Of all kinds that fit."""

    @property
    def rests(self) -> tuple[Rest, ...]:
        return tuple(stub.rest for stub in self.stubs)

    def stub(self, rest: Rest) -> Stub | None:
        return next((stub for stub in self.stubs if stub.rest is rest), None)


class Mouths:
    """The holes of a scene, as it is believed to stand."""

    def __init__(self, fixtures: Iterable[Fixture], catalogue: Iterable[CatalogueEntry]) -> None:
        entries = tuple(catalogue)
        self._mouths = [_mouth(fixture, hole, entries) for fixture in fixtures for hole in fixture.holes]

    def near(self, x: float, y: float) -> Mouth | None:
        """The hole over which something is seen, if there is one."""
        away = [(math.dist((x, y), mouth.at), n) for n, mouth in enumerate(self._mouths)]
        if not away:
            return None
        distance, n = min(away)
        return self._mouths[n] if distance < self._mouths[n].reach else None


def spread(fixture: Fixture) -> float:
    """How far a point of the fixture may be from where it is believed to be, m."""
    most = fixture.uncertainty
    if not isinstance(fixture.shape, Box):
        return most.position
    x, y, _ = fixture.shape.size
    return most.position + most.angle * math.hypot(x, y) / 2


def _mouth(fixture: Fixture, hole: Hole, entries: Iterable[CatalogueEntry]) -> Mouth:
    x, y, _ = (fixture.pose @ hole.pose).position
    stubs = tuple(stub for entry in entries if (stub := _stub(entry, hole)) is not None)
    away = spread(fixture)
    # It is anywhere within its bounds, and nowhere else.
    sigma = max(1e-3, away / math.sqrt(3.0))
    return Mouth(hole.id, (x, y), top(fixture.shape, fixture.pose), OFF + away, sigma, stubs)


def _stub(entry: CatalogueEntry, hole: Hole) -> Stub | None:
    if not fits(hole, entry.shape):
        return None
    shape: Shape
    match entry.shape:
        case Cylinder(radius, height):
            left, shape = height - hole.depth, Cylinder(radius, height - hole.depth)
        case Box((x, y, z)):
            left, shape = z - hole.depth, Box((x, y, z - hole.depth))
        case _:
            return None
    if left < SHOWS:
        return None
    # The first way in which it can lie is upright, as the catalogue has it.
    rest = rests(replace(entry, shape=shape))[0]
    return Stub(entry, rest, hole.depth / 2)
