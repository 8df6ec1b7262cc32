"""Ground truth of the simulation, for its backends, the faults, the scorer and `/truth/*` only."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from picktree.world import (
    Body,
    Box,
    ObjectId,
    Pose,
    Shape,
    Sphere,
    Vector3,
    bottom,
    greatest_length,
    hole_geometry,
)
from picktree.world.scene import CatalogueEntry, Fixture, Hole

MAX_SUPPORTED_DEPTH = 0.001
"""Greatest depth below a board's top face at which an item still counts as on the board, m."""


@dataclass(frozen=True, slots=True)
class HoleSeating:
    """Seating of an item that reaches below the top face of a fixture with holes, at the nearest hole."""

    hole: ObjectId
    depth: float
    """Depth of the item's lowest point below the hole's mouth, along the hole, m."""
    bottom: float
    """Depth of the hole, m."""
    tilt: float
    """Angle between the item's own z and the hole's axis, rad."""
    off: float
    """Distance from the item's centre to the hole's axis, m."""
    over: bool
    """Whether the item's centre is within the hole's walls, seen from above."""
    fits: bool
    """Whether the item's form and size fit the hole."""
    penetration: float = 0.0
    """Greatest penetration of item and fixture within the last second, m. A large value means that the item
    was pushed through a wall."""


class HoledFixtures:
    """Fixtures with holes, at their true poses."""

    def __init__(self, fixtures: Iterable[Fixture]) -> None:
        self._boards = [f for f in fixtures if f.holes]

    def __bool__(self) -> bool:
        return bool(self._boards)

    def seat(self, shape: Shape, pose: Pose) -> HoleSeating | None:
        """Return the seating of an item at `pose` in the world; None for an item on a board or elsewhere."""
        for board in self._boards:
            assert isinstance(board.shape, Box)
            x, y, z = board.shape.size
            item = board.pose.inverse() @ pose
            across, along, _ = item.position
            lowest = bottom(shape, item)
            if (
                abs(across) > x / 2
                or abs(along) > y / 2
                or not -z / 2 - MAX_SUPPORTED_DEPTH < lowest < z / 2 - MAX_SUPPORTED_DEPTH
            ):
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
        hole_geometry.fits_hole(hole, shape),
    )


@dataclass(frozen=True, slots=True)
class TrueBody(Body):
    """True state of an item."""

    velocity: Vector3 = (0.0, 0.0, 0.0)
    """Velocity of the centre, m/s."""
    spin: Vector3 = (0.0, 0.0, 0.0)
    """Angular velocity in the world, rad/s."""
    present: bool = True
    """Whether the item is present; False after a fault or a bin exchange removed it. The pose is then the
    last one; for the scorer, that of an item that left with a bin is not kept."""
    taken_with: ObjectId | None = None
    """Bin with which the item left at an exchange; None: it did not."""
    crushed: float = 0.0
    """Force of the finger that crushed the item, N; 0 while it is whole."""
    brought_by: int | None = None
    """Entry of the feed that brought the item; None: it was there at the start."""
    seat: HoleSeating | None = None
    """Seating in a hole; None when it is in none."""
    mass: float | None = None
    """kg; None: not given, as in a log."""
    tag: int | None = None
    """Number of the ArUco tag on it; None: it has none."""

    @property
    def role(self) -> str:
        return "item"

    @property
    def size(self) -> float:
        """Greatest distance of two of its points, m."""
        return greatest_length(self.shape)

    @classmethod
    def of(cls, item_id: ObjectId, entry: CatalogueEntry, colour: str, pose: Pose) -> TrueBody:
        """Return the truth of a catalogue item at rest at `pose`."""
        return cls(entry.kind, entry.form, entry.shape, colour, pose, id=item_id, mass=entry.mass)


@dataclass(frozen=True, slots=True)
class TrueObstacle:
    """True state of an obstacle that is unknown to the robot. It is no item and has no score."""

    id: ObjectId
    shape: Shape
    colour: str
    pose: Pose
    """Pose in the world."""

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
