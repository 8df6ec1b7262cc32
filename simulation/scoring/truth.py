"""What is really there. Only the simulation's backends, the faults, the scorer and `/truth/*` may hold it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from ...world.belief.hole_matching import fits_hole
from ...world.scene.description import CatalogueEntry, Fixture, Form, Hole
from ...world.shapes import Box, Shape, Sphere, bottom
from ...world.values import ObjectId, Pose, Vector3

BELOW = 0.001
"""What is no lower than this below a board's top face stands on it, m."""


@dataclass(frozen=True, slots=True)
class HoleSeating:
    """An item that reaches below the top face of a fixture with holes, at the hole that is nearest to it."""

    hole: ObjectId
    depth: float
    """Of its lowest point below the mouth, along the hole, m."""
    bottom: float
    """Depth of the hole, m."""
    tilt: float
    """Between the item's own z and the hole, rad."""
    off: float
    """From the item's centre to the middle of the hole, across it, m."""
    over: bool
    """Its centre is within the walls, as seen from above."""
    fits: bool
    """Its form and size go with the hole."""
    penetration: float = 0.0
    """How deep it and the fixture were in each other at most within the last second, m: more than a hair, and
    it was pushed through a wall."""


class HoledFixtures:
    """The fixtures with holes, where they really stand."""

    def __init__(self, fixtures: Iterable[Fixture]) -> None:
        self._boards = [f for f in fixtures if f.holes]

    def __bool__(self) -> bool:
        return bool(self._boards)

    def seat(self, shape: Shape, pose: Pose) -> HoleSeating | None:
        """How an item at `pose` in the world is in a hole; None when it stands on a board or elsewhere."""
        for board in self._boards:
            assert isinstance(board.shape, Box)
            x, y, z = board.shape.size
            item = board.pose.inverse() @ pose
            across, along, _ = item.position
            lowest = bottom(shape, item)
            if abs(across) > x / 2 or abs(along) > y / 2 or not -z / 2 - BELOW < lowest < z / 2 - BELOW:
                continue
            return min((_seat(hole, shape, item) for hole in board.holes), key=lambda seat: seat.off)
        return None


def _seat(hole: Hole, shape: Shape, item_in_board: Pose) -> HoleSeating:
    item = hole.pose.inverse() @ item_in_board
    x, y, _ = item.position
    half_x, half_y = hole.size[0] / 2, hole.size[1] / 2
    over = math.hypot(x, y) < half_x if hole.form == "round" else abs(x) < half_x and abs(y) < half_y
    upright = 1.0 if isinstance(shape, Sphere) else min(1.0, abs(float(item.rotation()[2, 2])))
    return HoleSeating(
        hole.id,
        -bottom(shape, item),
        hole.depth,
        math.acos(upright),
        math.hypot(x, y),
        over,
        fits_hole(hole, shape),
    )


@dataclass(frozen=True, slots=True)
class TrueBody:
    """An item as it really is."""

    id: ObjectId
    kind: str
    form: Form
    shape: Shape
    colour: str
    pose: Pose
    """In the world."""
    velocity: Vector3 = (0.0, 0.0, 0.0)
    """Of the centre, m/s."""
    spin: Vector3 = (0.0, 0.0, 0.0)
    """rad/s"""
    present: bool = True
    """False when a fault or somebody with its bin has taken it away; the pose is where it was last."""
    taken_with: ObjectId | None = None
    """The bin with which it left when that was exchanged."""
    crushed: float = 0.0
    """Force of a finger that it did not survive, N; 0 while it is whole."""
    brought_by: int | None = None
    """Which entry of the feed has brought it; None: it was there when the run began."""
    seat: HoleSeating | None = None
    """How it is in a hole; None when it is in none."""

    @property
    def role(self) -> str:
        return "item"

    @classmethod
    def of(cls, item_id: ObjectId, entry: CatalogueEntry, colour: str, pose: Pose) -> TrueBody:
        """An item of the catalogue at rest at `pose`."""
        return cls(item_id, entry.kind, entry.form, entry.shape, colour, pose)


@dataclass(frozen=True, slots=True)
class TrueObstacle:
    """Something that the robot was not told of, as it really stands. No item: nobody scores it."""

    id: ObjectId
    shape: Shape
    colour: str
    pose: Pose
    """In the world."""

    @property
    def kind(self) -> str:
        return "unknown"

    @property
    def form(self) -> str:
        return "unknown"

    @property
    def role(self) -> str:
        return "obstacle"

    @classmethod
    def of(cls, body: Fixture) -> TrueObstacle:
        return cls(body.id, body.shape, body.colour, body.pose)
