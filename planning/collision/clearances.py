"""How close bodies may come to each other, by what they are. One place for all margins.

Measured: with 5 mm at an edge resolution of 0.03 rad no planned path grazed anything; without, 7 % did.
Fingers must reach flat items on the table, and a held object stands on it when its motion begins.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto

import numpy as np

from ...world.values import Array


class GeometryOwner(Enum):
    """What a geometry is a part of."""

    BASE = auto()
    """Links of the robot that no joint moves."""
    ARM = auto()
    HAND = auto()
    FINGER = auto()
    HELD = auto()
    SUPPORT = auto()
    OBSTACLE = auto()


GRIPPER = (GeometryOwner.HAND, GeometryOwner.FINGER, GeometryOwner.HELD)
AROUND = (GeometryOwner.SUPPORT, GeometryOwner.OBSTACLE)


@dataclass(frozen=True, slots=True)
class CollisionMargins:
    """Least distances, m; negative: depth that is tolerated."""

    arm: float = 0.005
    gripper: float = 0.003
    finger_support: float = 0.0005
    held_support: float = -0.002

    def between(self, a: GeometryOwner, b: GeometryOwner) -> float:
        """The least distance of two parts, in either order."""
        parts = {a, b}
        if GeometryOwner.ARM in parts or GeometryOwner.BASE in parts:
            return self.arm
        if parts == {GeometryOwner.FINGER, GeometryOwner.SUPPORT}:
            return self.finger_support
        if parts == {GeometryOwner.HELD, GeometryOwner.SUPPORT}:
            return self.held_support
        return self.gripper

    def table(self) -> Array:
        """`between` for all parts: rows and columns by the parts' values."""
        table = np.zeros((len(GeometryOwner) + 1, len(GeometryOwner) + 1))
        for a in GeometryOwner:
            for b in GeometryOwner:
                table[a.value, b.value] = self.between(a, b)
        return table
