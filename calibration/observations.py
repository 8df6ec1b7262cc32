"""What a calibration has to go by: pictures of a target, and touches of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..world.journal import Plain
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
class DetectedTile:
    """A square in a picture. Pixels (column u, row v) are those of `Intrinsics`."""

    index: int
    """Of the square among those of the target."""
    pixel: tuple[float, float]
    """Centroid of its area in the picture."""
    depth: float
    """Along the optical axis where the ray of `depth_pixel` meets it, m: harmonic mean over its inside."""
    depth_pixel: tuple[float, float]
    depth_sigma: float
    """Standard error of that depth, from the scatter, m."""
    area: int
    """Pixels."""


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


SHOT, TOUCH = "calibration_shot", "calibration_touch"
"""Kinds of the events that a run's record keeps."""


@dataclass(frozen=True, slots=True)
class TargetImage:
    """One picture of the target."""

    camera: str
    on_hand: bool
    intrinsics: Intrinsics
    tcp: Pose
    """Of the arm at rest, in the world, by encoders and model."""
    believed: Pose
    """Of the optical frame in the TCP's frame, or in the world for a camera that hangs still."""
    tiles: tuple[DetectedTile, ...]

    def to_plain(self) -> dict[str, Plain]:
        i = self.intrinsics
        return {
            "camera": self.camera,
            "on_hand": self.on_hand,
            "intrinsics": [i.width, i.height, i.fx, i.fy, i.cx, i.cy],
            "tcp": _plain(self.tcp),
            "believed": _plain(self.believed),
            "tiles": [
                [t.index, *t.pixel, t.depth, *t.depth_pixel, t.depth_sigma, t.area] for t in self.tiles
            ],
        }

    @classmethod
    def from_plain(cls, data: dict[str, Any]) -> TargetImage:
        width, height, fx, fy, cx, cy = data["intrinsics"]
        return cls(
            data["camera"],
            data["on_hand"],
            Intrinsics(int(width), int(height), fx, fy, cx, cy),
            _pose(data["tcp"]),
            _pose(data["believed"]),
            tuple(
                DetectedTile(int(n), (u, v), z, (du, dv), sigma, int(area))
                for n, u, v, z, du, dv, sigma, area in data["tiles"]
            ),
        )


@dataclass(frozen=True, slots=True)
class TargetTouch:
    """The closed fingers at rest against a face of the target."""

    face: Vector3
    """Normal of the face, out of the target, in its frame."""
    tcp: Pose
    """In the world, by encoders and model."""
    force: float
    """With which they press, N."""
    name: str = ""

    def to_plain(self) -> dict[str, Plain]:
        return {"face": list(self.face), "tcp": _plain(self.tcp), "force": self.force, "name": self.name}

    @classmethod
    def from_plain(cls, data: dict[str, Any]) -> TargetTouch:
        x, y, z = data["face"]
        return cls((x, y, z), _pose(data["tcp"]), data["force"], data["name"])


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationData:
    """All that was seen and touched of one target."""

    shots: tuple[TargetImage, ...]
    touches: tuple[TargetTouch, ...]
    tips: Array
    """Corners (n, 3) of the closed fingers' pads in the TCP's frame, m."""


def _plain(pose: Pose) -> list[Plain]:
    return [*pose.position, *pose.orientation]


def _pose(numbers: list[float]) -> Pose:
    x, y, z, *turn = numbers
    a, b, c, d = turn
    return Pose((x, y, z), (a, b, c, d))
