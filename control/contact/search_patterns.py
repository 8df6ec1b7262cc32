"""Ways over a surface on which something is searched, and when what moves there stands."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator

import numpy as np

from ...world.values import Array


def rotation_about(axis: Array, angle: float) -> Array:
    """Rotation matrix (3, 3) about a unit vector (3,) by an angle, rad (Rodrigues)."""
    x, y, z = axis.tolist()
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * (cross @ cross)


def perpendicular_axes(up: Array) -> tuple[Array, Array]:
    """Two unit vectors (3,) that span the plane across `up`."""
    x = np.cross(np.array([0.0, 1.0, 0.0]) if abs(up[1]) < 0.9 else np.array([1.0, 0.0, 0.0]), up)
    x = x / float(np.linalg.norm(x))
    return x, np.cross(up, x)


def rotation_axis(rotation: Array) -> Array:
    """Unit axis (3,) of a rotation by less than half a turn; any where there is none."""
    r = rotation
    axis = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    size = float(np.linalg.norm(axis))
    return np.array([0.0, 0.0, 1.0]) if size < 1e-9 else axis / size


def rotated_towards(rotation: Array, towards: Array, share: float, about: Array, most: float) -> Array:
    """`rotation` (3, 3) turned a share of the way to `towards`, no further than `most` rad from `about`."""
    between = towards @ rotation.T
    angle = math.asin(min(1.0, float(np.linalg.norm(skew(between)))))
    moved = rotation_about(rotation_axis(between), share * angle) @ rotation
    away = moved @ about.T
    far = math.asin(min(1.0, float(np.linalg.norm(skew(away)))))
    return moved if far <= most else rotation_about(rotation_axis(away), most) @ about


def skew(r: Array) -> Array:
    """(3,) the axis of a rotation by less than a quarter turn, as long as the sine of its angle."""
    return 0.5 * np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])


class SettlingDetector:
    """Whether something has changed little for a while."""

    def __init__(self, time: float, little: float) -> None:
        self._time, self._little = time, little
        self._recent: deque[tuple[float, float]] = deque()

    def since(self, now: float, value: float) -> bool:
        """`value` at the time `now`, s: whether all values of the last while are this near to each other."""
        recent = self._recent
        recent.append((now, value))
        while now - recent[0][0] > self._time:
            recent.popleft()
        if now - recent[0][0] < 0.9 * self._time:
            return False
        values = [v for _, v in recent]
        return max(values) - min(values) < self._little


def spiral(pitch: float, radius: float, step: float) -> Iterator[tuple[float, float]]:
    """Points of an Archimedean spiral out to a radius, `step` m apart along it."""
    rise, angle = pitch / (2 * math.pi), 0.0
    while rise * angle <= radius:
        r = rise * angle
        yield r * math.cos(angle), r * math.sin(angle)
        angle += step / math.hypot(r, rise)


def grid(spacing: float, radius: float) -> Iterator[tuple[float, float]]:
    """The middle, then rings around it within the radius, so many that no point of it is further than about
    0.6 of the spacing from one of them."""
    yield 0.0, 0.0
    beyond = radius - 0.5 * spacing
    rings = math.ceil(max(0.0, beyond) / spacing)
    for ring in range(1, rings + 1):
        at = ring * (beyond + 0.15 * spacing) / rings
        for k in range(6 * ring):
            angle = math.pi * k / (3 * ring)
            yield at * math.cos(angle), at * math.sin(angle)
