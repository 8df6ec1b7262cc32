"""What stands around the robot, as one list of named convex bodies for every collision checker."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ...world.belief.planning_scene import BeliefObject, PlanningScene
from ...world.shapes import Box, ConvexMesh, Shape, extents
from ...world.values import Pose


@dataclass(frozen=True, slots=True)
class Body:
    """One convex part of what a name stands for: a bin has five, an obstacle often one, else its blocks."""

    name: str
    """Id of the fixture, bin or object; the name that `PlanningScene.allow` takes."""
    shape: Shape
    pose: Pose
    """In the world."""
    support: bool = False
    """A level board to put things on: held objects and finger tips may come very close to it."""


def is_board(shape: Shape, pose: Pose) -> bool:
    """Whether its vertical extent is the least of the three: a table top, a shelf, a bin's floor."""
    low, high = extents(shape, pose.rotation())
    x, y, z = (float(d) for d in high - low)
    return z < x and z < y


def still_bodies(scene: PlanningScene) -> tuple[Body, ...]:
    """Fixtures and the parts of the bins."""
    fixtures = [Body(f.id, f.shape, f.pose, is_board(f.shape, f.pose)) for f in scene.fixtures.values()]
    parts = [
        Body(b.id, part, pose, is_board(part, pose)) for b in scene.bins.values() for part, pose in b.parts()
    ]
    return (*fixtures, *parts)


def loose_bodies(objects: Iterable[BeliefObject]) -> tuple[Body, ...]:
    """Objects that are not in the hand."""
    return tuple(body for o in objects if not o.attached for body in bodies_of(o))


def bodies_of(o: BeliefObject) -> tuple[Body, ...]:
    """The convex parts of one object, all under its name: a hull stands for its blocks."""
    if not o.blocks or isinstance(o.shape, ConvexMesh):
        return (Body(o.id, o.shape, o.pose),)
    return tuple(Body(o.id, Box(block.size), o.pose @ Pose(block.at)) for block in o.blocks)
