"""Small turns of a tool, as rotation matrices (3, 3)."""

from __future__ import annotations

import math

import numpy as np

from ...world.values import Array


def turned(axis: Array, angle: float) -> Array:
    """Rotation matrix (3, 3) about a unit vector (3,) by an angle, rad (Rodrigues)."""
    x, y, z = axis.tolist()
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * (cross @ cross)


def plane(up: Array) -> tuple[Array, Array]:
    """Two unit vectors (3,) that span the plane across `up`."""
    x = np.cross(np.array([0.0, 1.0, 0.0]) if abs(up[1]) < 0.9 else np.array([1.0, 0.0, 0.0]), up)
    x = x / float(np.linalg.norm(x))
    return x, np.cross(up, x)


def axis_of(rotation: Array) -> Array:
    """Unit axis (3,) of a rotation by less than half a turn; any where there is none."""
    r = rotation
    axis = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    size = float(np.linalg.norm(axis))
    return np.array([0.0, 0.0, 1.0]) if size < 1e-9 else axis / size


def following(rotation: Array, towards: Array, share: float, about: Array, most: float) -> Array:
    """`rotation` (3, 3) turned a share of the way to `towards`, no further than `most` rad from `about`."""
    between = towards @ rotation.T
    angle = math.asin(min(1.0, float(np.linalg.norm(skew(between)))))
    moved = turned(axis_of(between), share * angle) @ rotation
    away = moved @ about.T
    far = math.asin(min(1.0, float(np.linalg.norm(skew(away)))))
    return moved if far <= most else turned(axis_of(away), most) @ about


def skew(r: Array) -> Array:
    """(3,) the axis of a rotation by less than a quarter turn, as long as the sine of its angle."""
    return 0.5 * np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
