"""Holes of the kinematic backend: an item over a hole, and near enough, goes into it; an item in a hole stays
in it.

The model is idealised. An item enters a hole when it fits between the walls, with the chamfer's help, and
then has the hole's bottom below it. Below a small depth the walls push a held item back into its clearance,
as stiffly as a table, without a torque. There is no friction and no jamming. An item released there comes to
stand upright, and fingers do not push it out again.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from ...world.belief.hole_matching import Slack, hole_clearance
from ...world.scene.description import Fixture, Hole
from ...world.shapes import Box, Shape, bottom
from ...world.values import Array, ObjectId, Pose

MAX_ENTRY_TILT = math.radians(3.0)
"""Largest tilt with which an item enters a hole, rad."""
MAX_ENTRY_ROTATION = math.radians(1.0)
"""Rotation about the hole up to which a box enters with any clearance, rad: the hand gives way."""
MIN_ENTERED_DEPTH = 0.002
"""Depth below the mouth from which an item is in the hole, m: more than a hand presses it into a surface."""
MAX_SEATED_OFFSET = 0.008
"""Distance beyond the walls' clearance up to which an item in a hole stays in it, m."""


@dataclass(frozen=True, slots=True)
class HoleBelow:
    """Hole that an item is over, or in."""

    fixture: ObjectId
    hole: Hole
    floor: float
    """Height of its bottom in the world, m."""
    pose: Pose
    """Pose in the world of the item as it would stand in the hole: upright, at its present height."""
    entered: bool
    """Whether the item is so deep in the hole that the walls hold it."""


class KinematicHoles:
    """Holes of level fixtures, at their true poses."""

    def __init__(self, fixtures: Iterable[Fixture]) -> None:
        self._holes = [(f.id, hole, f.pose @ hole.pose) for f in fixtures for hole in f.holes]

    def under(self, shape: Shape, pose: Pose) -> HoleBelow | None:
        """Return the hole into which an item at `pose` goes when it is lowered; None when there is none."""
        for fixture, hole, mouth in self._holes:
            found = _under(fixture, hole, mouth, shape, pose)
            if found is not None:
                return found
        return None


def _under(fixture: ObjectId, hole: Hole, mouth: Pose, shape: Shape, pose: Pose) -> HoleBelow | None:
    left = hole_clearance(hole, shape)
    if left is None or min(left) <= 0.0:
        return None
    item = mouth.inverse() @ pose
    x, y, _ = item.position
    entered = bottom(shape, item) < -MIN_ENTERED_DEPTH
    loose = MAX_SEATED_OFFSET if entered else hole.chamfer
    if hole.form == "round":
        off = max(0.0, math.hypot(x, y) - left[0] / 2)
    else:
        off = max(0.0, abs(x) - left[0] / 2, abs(y) - left[1] / 2)
    if off > loose:
        return None
    rotation = item.rotation()
    turn = _turn(hole, shape, rotation)
    if not entered:
        leaning = math.acos(min(1.0, abs(float(rotation[2, 2]))))
        if leaning > MAX_ENTRY_TILT or abs(turn) > max(
            MAX_ENTRY_ROTATION, (min(left) + 2 * hole.chamfer) / max(hole.size)
        ):
            return None
    seated = mouth @ _seated(hole, left, item, turn)
    return HoleBelow(fixture, hole, mouth.position[2] - hole.depth, seated, entered)


def _turn(hole: Hole, shape: Shape, rotation: Array) -> float:
    """Return the rotation of a box against the hole's sides about the vertical, rad; 0 for a round one."""
    if not isinstance(shape, Box) or hole.form == "round":
        return 0.0
    x, y, _ = shape.size
    axis = rotation[:, 0] if x >= y else rotation[:, 1]
    yaw = math.atan2(float(axis[1]), float(axis[0]))
    # A square hole or item has two equivalent orientations.
    period = math.pi / 2 if x == y or hole.size[0] == hole.size[1] else math.pi
    return (yaw + period / 2) % period - period / 2


def _seated(hole: Hole, left: Slack, item: Pose, turn: float) -> Pose:
    """Return the item's pose in the hole's frame: upright, between the walls, at its present height."""
    x, y, z = item.position
    rotation = item.rotation()
    yaw = math.atan2(float(rotation[1, 0]), float(rotation[0, 0])) - turn
    roll = 0.0 if rotation[2, 2] > 0.0 else math.pi
    if hole.form == "round":
        share = min(1.0, left[0] / 2 / max(math.hypot(x, y), 1e-12))
        x, y = share * x, share * y
    else:
        x = min(max(x, -left[0] / 2), left[0] / 2)
        y = min(max(y, -left[1] / 2), left[1] / 2)
    return Pose.from_rpy((x, y, z), (roll, 0.0, yaw))
