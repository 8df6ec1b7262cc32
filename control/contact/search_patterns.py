"""Search patterns over a surface, the rotations that they need, and detection of standstill."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator

import numpy as np

from ...world.values import Array


def rotation_about(axis: Array, angle: float) -> Array:
    """Return the rotation matrix (3, 3) about a unit vector (3,) by an angle, rad (Rodrigues)."""
    x, y, z = axis.tolist()
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * (cross @ cross)


def perpendicular_axes(up: Array) -> tuple[Array, Array]:
    """Return two unit vectors (3,) that span the plane perpendicular to `up`."""
    x = np.cross(np.array([0.0, 1.0, 0.0]) if abs(up[1]) < 0.9 else np.array([1.0, 0.0, 0.0]), up)
    x = x / float(np.linalg.norm(x))
    return x, np.cross(up, x)


def rotation_axis(rotation: Array) -> Array:
    """Return the unit axis (3,) of a rotation by less than half a turn; z for the identity."""
    r = rotation
    axis = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    size = float(np.linalg.norm(axis))
    return np.array([0.0, 0.0, 1.0]) if size < 1e-9 else axis / size


def rotated_towards(rotation: Array, towards: Array, share: float, about: Array, most: float) -> Array:
    """Return `rotation` (3, 3) turned by a share of the way to `towards`, at most `most` rad from `about`."""
    between = towards @ rotation.T
    angle = math.asin(min(1.0, float(np.linalg.norm(skew(between)))))
    moved = rotation_about(rotation_axis(between), share * angle) @ rotation
    away = moved @ about.T
    far = math.asin(min(1.0, float(np.linalg.norm(skew(away)))))
    return moved if far <= most else rotation_about(rotation_axis(away), most) @ about


def skew(r: Array) -> Array:
    """Return the rotation vector (3,) whose length is the sine of the angle; less than a quarter turn."""
    return 0.5 * np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])


class SettlingDetector:
    """Detector of standstill: a value that has changed little for a given time."""

    def __init__(self, time: float, little: float) -> None:
        self._time, self._little = time, little
        self._recent: deque[tuple[float, float]] = deque()

    def since(self, now: float, value: float) -> bool:
        """Add `value` at time `now`, s, and return whether all values of the last `time` s lie within
        `little`."""
        recent = self._recent
        recent.append((now, value))
        while now - recent[0][0] > self._time:
            recent.popleft()
        if now - recent[0][0] < 0.9 * self._time:
            return False
        values = [v for _, v in recent]
        return max(values) - min(values) < self._little


def spiral(pitch: float, radius: float, step: float) -> Iterator[tuple[float, float]]:
    """Yield points (x, y) of an Archimedean spiral out to `radius`, m, spaced by `step` m along it."""
    rise, angle = pitch / (2 * math.pi), 0.0
    while rise * angle <= radius:
        r = rise * angle
        yield r * math.cos(angle), r * math.sin(angle)
        angle += step / math.hypot(r, rise)


def grid(spacing: float, radius: float) -> Iterator[tuple[float, float]]:
    """Yield the middle and rings of points around it within the radius, m.

    No point of the disc is further than about 0.6 of the spacing from one of them.
    """
    yield 0.0, 0.0
    beyond = radius - 0.5 * spacing
    rings = math.ceil(max(0.0, beyond) / spacing)
    for ring in range(1, rings + 1):
        at = ring * (beyond + 0.15 * spacing) / rings
        for k in range(6 * ring):
            angle = math.pi * k / (3 * ring)
            yield at * math.cos(angle), at * math.sin(angle)
