"""Which item belongs into which hole: the one rule, for skills, checks of files and the scorer."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeAlias

from ..causes import Failure, world
from ..scene.description import Fixture, Hole
from ..shapes import Box, Cylinder, Shape, Sphere
from ..values import Pose
from .planning_scene import PlanningScene

Slack: TypeAlias = tuple[float, float]
"""How much wider a hole is than the item, along the hole's long side and across, m."""


def hole_clearance(hole: Hole, shape: Shape) -> Slack | None:
    """Return the clearance of an item that stands in the hole, on both sides together; negative where it
    is too wide. None when its form does not go with the hole's. Cylinders and spheres go into round holes,
    boxes into square holes and slots, meshes into none."""
    match shape:
        case Cylinder(radius, _) | Sphere(radius) if hole.form == "round":
            return hole.size[0] - 2 * radius, hole.size[1] - 2 * radius
        case Box((x, y, _)) if hole.form != "round":
            long, wide = max(hole.size), min(hole.size)
            return long - max(x, y), wide - min(x, y)
        case _:
            return None


def fits_hole(hole: Hole, shape: Shape) -> bool:
    """Whether an item of that shape goes into the hole with room on every side."""
    left = hole_clearance(hole, shape)
    return left is not None and min(left) > 0.0


def tightest_hole(holes: Iterable[Hole], shape: Shape) -> Hole | None:
    """Return the tightest hole that the item fits; None when it fits none."""
    loose = [
        (max(hole_clearance(hole, shape) or (0.0, 0.0)), n, hole)
        for n, hole in enumerate(holes)
        if fits_hole(hole, shape)
    ]
    return min(loose)[2] if loose else None


def named_holes(fixtures: Iterable[Fixture], name: str) -> tuple[Hole, ...] | None:
    """Return the holes that a name such as `board` or `board/left` stands for: all of a fixture, or one.
    None when it is neither."""
    for fixture in fixtures:
        if fixture.holes and fixture.id == name:
            return fixture.holes
        for hole in fixture.holes:
            if hole.id == name:
                return (hole,)
    return None


def find_hole(scene: PlanningScene, hole_id: str) -> tuple[Fixture, Hole]:
    """The hole of that id and the fixture in which it is. Raises Failure(world.unknown_object)."""
    for fixture in scene.fixtures.values():
        for hole in fixture.holes:
            if hole.id == hole_id:
                return fixture, hole
    known = [str(hole.id) for fixture in scene.fixtures.values() for hole in fixture.holes]
    raise Failure(world.UNKNOWN_OBJECT, f"the scene has no hole {hole_id!r}", object=hole_id, known=known)


def hole_in_world(scene: PlanningScene, hole_id: str) -> Pose:
    """Where the middle of the hole's mouth is believed to be; z points out of it.

    Raises Failure(world.unknown_object).
    """
    fixture, hole = find_hole(scene, hole_id)
    return fixture.pose @ hole.pose


def occupied(scene: PlanningScene, hole_id: str) -> bool:
    """Whether an object is believed to be in the hole."""
    return any(o.place == hole_id for o in scene.objects)


def fitting_hole(scene: PlanningScene, object_id: str, into: str | None = None) -> Hole | None:
    """The free hole into which the object belongs: by form and size, that which leaves it the least room.

    `into` is a fixture with holes, or one hole; default: the object's destination. None when that has no
    holes, or when the object fits no hole of it that is free. Raises Failure(world.unknown_object).
    """
    target = into if into is not None else scene.destination(object_id)
    holes = None if target is None else named_holes(scene.fixtures.values(), target)
    if holes is None:
        return None
    taken = {o.place for o in scene.objects if o.id != object_id}
    return tightest_hole((hole for hole in holes if hole.id not in taken), scene.get(object_id).shape)
