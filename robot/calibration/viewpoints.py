"""Viewpoints of the hand's camera around a calibration target."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from picktree.world import Array, Intrinsics, Pose, Vector3

VIEW_TILTS = (0.12, 0.5, 0.68)
"""Angles between line of sight and target normal of successive views, rad."""


VIEW_DISTANCES = (1.0, 1.15, 1.3)
"""Distances of successive views, as multiples of the nearest at which the target fills its share of the
image."""


MAX_IMAGE_SHARE = 0.8
"""Maximum share of the image's shorter side that the target fills."""


ROLL_STEP = 1.3
"""Rotation about the line of sight from view to view, rad."""


@dataclass(frozen=True, slots=True)
class Viewpoint:
    """Viewpoint: camera poses of which any one will do; the first is the best."""

    name: str
    camera_in_world: tuple[Pose, ...]


def viewpoints(target: Pose, size: Vector3, intrinsics: Intrinsics, count: int) -> tuple[Viewpoint, ...]:
    """Return `count` viewpoints from which a target of `size` (m) is seen whole. Successive views go round
    the target at varied distances and tilts."""
    across = math.hypot(size[0], size[1])
    shorter = min(intrinsics.width / intrinsics.fx, intrinsics.height / intrinsics.fy)
    nearest = across / (MAX_IMAGE_SHARE * shorter) + size[2] / 2
    return tuple(_viewpoint(target, size, nearest, number) for number in range(count))


def _viewpoint(target: Pose, size: Vector3, nearest: float, number: int) -> Viewpoint:
    tilt, distance = (
        VIEW_TILTS[number % len(VIEW_TILTS)],
        nearest * VIEW_DISTANCES[number // len(VIEW_TILTS) % len(VIEW_DISTANCES)],
    )
    azimuth = 2.4 * number  # rad: spreads any number of views evenly
    up = target.rotation()
    top = np.array(target.position) + up[:, 2] * size[2] / 2
    aside = up @ np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    forward: Array = -(math.cos(tilt) * up[:, 2] + math.sin(tilt) * aside)
    first = np.cross(up @ np.array([-math.sin(azimuth), math.cos(azimuth), 0.0]), forward)
    second = np.cross(forward, first)
    poses: list[Pose] = []
    for roll in (0.0, 0.5, -0.5, 1.0, -1.0, math.pi):  # rad about the line of sight
        turn = ROLL_STEP * number + roll
        right = math.cos(turn) * first + math.sin(turn) * second
        axes = np.column_stack([right, np.cross(forward, right), forward])
        poses.append(Pose.from_rotation(top - distance * forward, axes))
    return Viewpoint(f"view {number + 1}", tuple(poses))
