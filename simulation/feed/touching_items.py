"""Layout of touching items: orientations and places such that each item touches another."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...world.scene.description import Spawn
from ...world.shapes import Cylinder, Shape, Sphere
from ...world.values import Array, Quaternion, quaternion_product
from ..footprints import Footprint, distance, footprint

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
    low, high = np.array(spawn.area[0]), np.array(spawn.area[1])
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
                    _beside(shapes[k], turns[k], places, turned, outlines, rng)
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


def _beside(
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
