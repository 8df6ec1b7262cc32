"""Which of the patches in a picture is which object, when all of them are seen off by the same way.

What was seen through one camera with an error of its mounting is off alike. So the patches are not taken one
by one: every shift that brings some object onto some patch is tried on all of them, and the one that explains
most and is least counts, unless another one that takes another patch for the target explains nearly as much.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ...world.belief.planning_scene import BeliefObject
from ...world.values import ObjectId

if TYPE_CHECKING:
    from ...perception.fitting.known_object_fitting import Sighting

UNEXPLAINED = 0.010
"""What an object is worth that a shift brings nowhere near a patch, m: as one that is off by so much."""
LIKELY = 0.5
"""What a shift costs, as a share of its length: cameras hang nearly where they are believed to hang."""
CLEARLY = 0.006
"""A shift must explain things better by so much than one that takes another patch for the target, m."""


@dataclass(frozen=True, slots=True)
class Matched:
    """What became of one picture's patches."""

    target: Sighting | None
    """None: it was not recognised, or it is ambiguous."""
    others: tuple[Sighting, ...]
    """At most one for each other object, from its own patch."""
    ambiguous: bool
    """Whether there were two patches that the target may be, and nothing to tell them apart."""
    seen: int
    """How many patches the target may be, whether it fits them or not."""


@dataclass(frozen=True, slots=True)
class _Reading:
    cost: float
    taken: dict[ObjectId, Sighting]


def matched(target: BeliefObject, objects: Sequence[BeliefObject], found: Sequence[Sighting]) -> Matched:
    """The best reading of what was found; `objects` are those that were looked for, the target among them."""
    fitting = [s for s in found if math.isfinite(s.misfit)]
    seen = len({s.patch for s in found if s.object == target.id})
    believed = {o.id: o for o in objects}
    shifts = sorted({_shift(believed[s.object], s) for s in fitting})
    readings = [_read(shift, believed, fitting) for shift in shifts]
    mine = [r for r in readings if target.id in r.taken]
    best = min(mine or readings, key=lambda r: r.cost, default=_Reading(0.0, {}))
    own = best.taken.get(target.id)
    if own is not None:
        rivals = [r for r in readings if _contradicts(r, target.id, own.patch)]
        rival = min(rivals, key=lambda r: r.cost, default=None)
        if rival is not None and rival.cost < best.cost - CLEARLY:
            best, own = rival, rival.taken.get(target.id)
        elif rival is not None and rival.cost < best.cost + CLEARLY:
            return Matched(None, (), True, seen)
    return Matched(own, tuple(s for name, s in best.taken.items() if name != target.id), False, seen)


def _contradicts(reading: _Reading, target: ObjectId, patch: int) -> bool:
    """Whether it gives the target another patch, or the patch to another object."""
    return any((name == target) != (s.patch == patch) for name, s in reading.taken.items())


def _shift(one: BeliefObject, sighting: Sighting) -> tuple[float, float]:
    x, y, _ = sighting.pose.position
    return x - one.pose.position[0], y - one.pose.position[1]


def _read(
    shift: tuple[float, float], believed: dict[ObjectId, BeliefObject], fitting: Sequence[Sighting]
) -> _Reading:
    """Give each object the patch that is nearest after the shift, the nearest pairs first, each patch
    once."""
    pairs = sorted(
        (math.dist(_shift(believed[s.object], s), shift), str(s.object), s.patch, n)
        for n, s in enumerate(fitting)
    )
    taken: dict[ObjectId, Sighting] = {}
    patches: set[int] = set()
    cost = LIKELY * math.hypot(*shift) + UNEXPLAINED * len({s.object for s in fitting})
    for off, _, patch, n in pairs:
        sighting = fitting[n]
        if off < UNEXPLAINED and sighting.object not in taken and patch not in patches:
            taken[sighting.object] = sighting
            patches.add(patch)
            cost += off - UNEXPLAINED
    return _Reading(cost, taken)
