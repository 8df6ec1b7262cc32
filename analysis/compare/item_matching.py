"""Which item of one run is which item of another.

The ids are the robot's own: `red_block_3` is the third red block that it found, so two runs may number the
same block differently. With one seed the same things stand in the same places at first, so a place decides;
what it leaves over, and everything when the seeds differ, is paired by the order of discovery among those of
one kind and colour. With different seeds a pair is therefore no more than two of a kind.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

from ...world.values import Vector3
from ..run import Run

NEAR = 0.02
"""m. Half an item: more than perception errs, less than two items are apart."""

Basis: TypeAlias = Literal["place", "order"]


@dataclass(frozen=True, slots=True)
class Sighting:
    """An object when the robot first believed in it, or at the moment from which runs are compared."""

    id: str
    kind: str
    colour: str
    place: Vector3
    """In the world, m."""


@dataclass(frozen=True, slots=True)
class ItemPair:
    a: str
    b: str
    basis: Basis
    """`place`: it stood in the same place. `order`: it is of the same kind and colour, and so many of those
    were known before."""


@dataclass(frozen=True, slots=True)
class ItemMatch:
    """The objects of two runs, by their ids."""

    pairs: tuple[ItemPair, ...]
    only_a: tuple[str, ...]
    only_b: tuple[str, ...]

    @property
    def a_by_b(self) -> Mapping[str, str]:
        """What the run A calls an object of B."""
        return {pair.b: pair.a for pair in self.pairs}


def match_items(a: Run, b: Run, *, since: float = 0.0) -> ItemMatch:
    """Pair the objects of two runs; those that are known at `since` (simulated s) where they are then."""
    in_a, in_b = sightings(a, since), sightings(b, since)
    pairs: list[ItemPair] = []
    if a.info.seed == b.info.seed:
        near = sorted(
            (math.dist(one.place, other.place), one.id != other.id, n, m)
            for n, one in enumerate(in_a)
            for m, other in enumerate(in_b)
            if (one.kind, one.colour) == (other.kind, other.colour)
        )
        taken_a: set[int] = set()
        taken_b: set[int] = set()
        for distance, _, n, m in near:
            if distance <= NEAR and n not in taken_a and m not in taken_b:
                taken_a.add(n)
                taken_b.add(m)
                pairs.append(ItemPair(in_a[n].id, in_b[m].id, "place"))
    left_a = _left(in_a, (pair.a for pair in pairs))
    left_b = _left(in_b, (pair.b for pair in pairs))
    for sort, ones in left_a.items():
        for one, other in zip(ones, left_b.get(sort, ()), strict=False):
            pairs.append(ItemPair(one, other, "order"))
    paired_a, paired_b = {pair.a for pair in pairs}, {pair.b for pair in pairs}
    order = {sighting.id: n for n, sighting in enumerate(in_a)}
    return ItemMatch(
        tuple(sorted(pairs, key=lambda pair: order[pair.a])),
        tuple(s.id for s in in_a if s.id not in paired_a),
        tuple(s.id for s in in_b if s.id not in paired_b),
    )


def sightings(run: Run, since: float = 0.0) -> tuple[Sighting, ...]:
    """Every object of the belief once, in the order of discovery; from `since` (simulated s) on."""
    found: dict[str, Sighting] = {}
    known = run.log.belief_at(since) or next(run.log.beliefs(since), None)
    begin = since
    if known is not None:
        begin = max(since, known.time)
        for body in known.record.bodies:
            found[body.id] = Sighting(body.id, body.kind, body.colour, body.pose.position)
    for at in run.log.beliefs(begin):
        for body in at.record.bodies:
            if body.id not in found:
                found[body.id] = Sighting(body.id, body.kind, body.colour, body.pose.position)
    return tuple(found.values())


def _left(known: Iterable[Sighting], paired: Iterable[str]) -> dict[tuple[str, str], list[str]]:
    """The ids that are not paired yet, by kind and colour."""
    done = set(paired)
    left: dict[tuple[str, str], list[str]] = {}
    for sighting in known:
        if sighting.id not in done:
            left.setdefault((sighting.kind, sighting.colour), []).append(sighting.id)
    return left
