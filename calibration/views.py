"""Where a camera on the hand looks at a target from: spread around it, turned about many axes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..world.protocols import Intrinsics
from ..world.values import Array, Pose, Vector3

TILTS = (0.12, 0.5, 0.68)
"""Of the line of sight against the target's normal, in turn, rad."""
NEARER = (1.0, 1.15, 1.3)
"""Distances, in turn, as multiples of the nearest at which the target fills its share of the picture."""
FILLS = 0.8
"""Share of the picture's shorter side that the target may take."""
GOLDEN = 2.4
"""From view to view about the target's normal, rad: any number of them in a row is spread evenly."""
ROLL = 1.3
"""The same about the line of sight."""
ROLLS = (0.0, 0.5, -0.5, 1.0, -1.0, math.pi)
"""Other turns about the line of sight that will do, where a view is out of reach, rad."""


@dataclass(frozen=True, slots=True)
class Viewpoint:
    """A place to look from; any of the poses will do, the first is the best."""

    name: str
    camera_in_world: tuple[Pose, ...]


def viewpoints(target: Pose, size: Vector3, intrinsics: Intrinsics, count: int) -> tuple[Viewpoint, ...]:
    """`count` places around a target of that size (m) from which it is seen whole, one after another further
    round, nearer and further, straight from above and aslant."""
    across = math.hypot(size[0], size[1])
    shorter = min(intrinsics.width / intrinsics.fx, intrinsics.height / intrinsics.fy)
    nearest = across / (FILLS * shorter) + size[2] / 2
    return tuple(_viewpoint(target, size, nearest, number) for number in range(count))


def _viewpoint(target: Pose, size: Vector3, nearest: float, number: int) -> Viewpoint:
    tilt, distance = TILTS[number % len(TILTS)], nearest * NEARER[number // len(TILTS) % len(NEARER)]
    azimuth = GOLDEN * number
    up = target.rotation()
    top = np.array(target.position) + up[:, 2] * size[2] / 2
    aside = up @ np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    forward: Array = -(math.cos(tilt) * up[:, 2] + math.sin(tilt) * aside)
    first = np.cross(up @ np.array([-math.sin(azimuth), math.cos(azimuth), 0.0]), forward)
    second = np.cross(forward, first)
    poses: list[Pose] = []
    for roll in ROLLS:
        turn = ROLL * number + roll
        right = math.cos(turn) * first + math.sin(turn) * second
        axes = np.column_stack([right, np.cross(forward, right), forward])
        poses.append(Pose.from_rotation(top - distance * forward, axes))
    return Viewpoint(f"view {number + 1}", tuple(poses))
